//! Own steps of the subdomains between two reflections.

use super::{Coupled, pair};
use crate::interface::Interface;
use crate::owned::{Cuts, Owned};
use crate::phase::Phase;
use crate::subdomain::{Announce, StepEnd, Subdomain};
use crate::{Real, Result};
use std::ops::Range;

/// Group of subdomains that step together because effects act between them.
#[derive(Debug, Clone)]
pub(super) struct Lockstep {
    /// Numbers of the subdomains, ascending.
    pub(super) members: Vec<usize>,
    /// Numbers of the pair effects between them.
    pub(super) pairs: Vec<usize>,
}

impl Lockstep {
    /// Groups `count` subdomains by the pairs between which effects act.
    pub(super) fn groups(count: usize, pairs: &[[usize; 2]]) -> Vec<Self> {
        let mut group: Vec<usize> = (0..count).collect();
        for [a, b] in pairs {
            let (low, high) = (group[*a].min(group[*b]), group[*a].max(group[*b]));
            group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
        }
        let firsts = (0..count).filter(|k| group[*k] == *k);
        let lockstep = |first: usize| Self {
            members: (0..count).filter(|k| group[*k] == first).collect(),
            pairs: (0..pairs.len())
                .filter(|p| group[pairs[*p][0]] == first)
                .collect(),
        };
        firsts.map(lockstep).collect()
    }
}

/// Entries of an interface's coupling matrices on unknowns with a moving support, for the work of the
/// multipliers on the support.
#[derive(Debug)]
pub(super) struct Held<T> {
    /// Coarse side, fine side; `None` if no support moves there.
    sides: [Option<HeldSide<T>>; 2],
    components: usize,
}

#[derive(Debug)]
struct HeldSide<T> {
    /// Multiplier, unknown, entry with the sign of the force; sorted by unknowns.
    entries: Vec<(usize, usize, T)>,
    cuts: Cuts,
}

impl<T: Real> HeldSide<T> {
    fn new(owned: &Owned, mut entries: Vec<(usize, usize, T)>, components: usize) -> Self {
        // Sums run over units of nodes, so entries are sorted by unknowns.
        entries.sort_by_key(|e| (e.1, e.0));
        Self {
            cuts: Cuts::at_units(owned.clone(), entries.iter().map(|e| e.1 / components)),
            entries,
        }
    }
}

impl<T: Real> Held<T> {
    pub(super) fn new(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Self {
        let components = interface.components();
        // Multipliers act by −Bᵀλ on the coarse and by +Bᵀλ on the fine model.
        let sides = [(0, -T::one()), (1, T::one())].map(|(m, sign)| {
            let s = &subdomains[interface.sides()[m]];
            let moving: std::collections::HashSet<usize> =
                s.moving().flat_map(|m| m.dofs.iter().copied()).collect();
            if moving.is_empty() {
                return None;
            }
            let matrix = interface.coupling_matrix(m)?;
            let matching = matrix.iter().filter(|(_, (_, j))| moving.contains(j));
            let entries = matching.map(|(b, (i, j))| (i, j, sign * *b)).collect();
            Some(HeldSide::new(&s.owned(), entries, components))
        });
        Self { sides, components }
    }

    /// Keeps this rank's entries of partitioned models.
    pub(super) fn restrict(&mut self, owned: [&Owned; 2]) {
        let d = self.components;
        for (side, owned) in self.sides.iter_mut().zip(owned) {
            let Some(side) = side else { continue };
            let local_entry = |(i, j, b): &(usize, usize, T)| Some((*i, owned.local(j / d)? * d + j % d, *b));
            *side = HeldSide::new(owned, side.entries.iter().filter_map(local_entry).collect(), d);
        }
    }

    /// Power of the multipliers on moving supports \[W\], over all ranks.
    pub(super) fn power(&self, lambda: &[T], v: [&[T]; 2]) -> T {
        let side_power = |(side, v): (&Option<HeldSide<T>>, &[T])| {
            let side = side.as_ref()?;
            let part = |range: Range<usize>| {
                let entries = side.entries[range].iter();
                [entries.map(|(i, j, b)| *b * lambda[*i] * v[*j]).sum()]
            };
            Some(side.cuts.sum(1, &part)[0])
        };
        self.sides.iter().zip(v).filter_map(side_power).sum()
    }
}

impl<T: Real> Coupled<T> {
    /// Returns the time \[s\] that lies the given number of macro steps after the present one.
    pub(super) fn instant(&self, steps: usize) -> T {
        // A product, not a sum: round-off does not grow with the steps.
        self.start_time + T::of((self.step + steps) as f64) * self.dt
    }

    /// Makes the own steps of all subdomains up to the next reflection; `draw` is true if invariants will be
    /// evaluated then.
    pub(super) fn own_steps_of_all(&mut self, draw: bool, announce: &mut Announce<'_>) -> Result<()> {
        for g in 0..self.lockstep.len() {
            let first = self.lockstep[g].members[0];
            let (steps, dt) = (
                self.subdomains[first].own_steps(),
                self.subdomains[first].own_dt(),
            );
            for j in 1..=steps {
                let last = j == steps;
                // The last own step ends exactly at the macro step: a sum of quotients would be off by
                // round-off.
                let time = if last {
                    self.instant(1)
                } else {
                    self.instant(0) + T::of(j as f64) * dt
                };
                let number = self.step * steps + j;
                let step_end = StepEnd {
                    time,
                    since: dt,
                    dt,
                    number,
                };
                self.own_step(g, step_end, draw && last, announce)?;
                // Works of the last own step are added after the reflection, with corrected velocities.
                if !last {
                    self.account_own(g, announce);
                }
            }
        }
        Ok(())
    }

    /// Makes one own step of a lockstep group; `keep` as in [`Subdomain::predict`].
    pub(super) fn own_step(
        &mut self,
        group: usize,
        step_end: StepEnd<T>,
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        for &k in &self.lockstep[group].members {
            announce(Phase::Predict(k));
            self.subdomains[k].predict(k, step_end, keep, announce)?;
            // Implicit steps know the work of their supports now, explicit ones after the reflection.
            self.ledger.supports += self.subdomains[k].work_within();
        }
        self.add_pair_forces(group, |_| step_end, announce)
    }

    /// Adds the forces of the group's pair effects and accelerates the subdomains that wait for them.
    pub(super) fn add_pair_forces(
        &mut self,
        group: usize,
        step_end: impl Fn(&Subdomain<T>) -> StepEnd<T>,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        for &k in &self.lockstep[group].pairs {
            announce(Phase::Pair(k));
            let p = &mut self.pairs[k];
            let [a, b] = pair(&mut self.subdomains, p.sides[0], p.sides[1]);
            // Both sides make the same own steps.
            let end = step_end(a);
            let ((first, f), (second, g)) = (a.loaded_at(end), b.loaded_at(end));
            p.line.add_forces([&first, &second], [f, g])?;
        }
        for &k in &self.lockstep[group].members {
            let s = &mut self.subdomains[k];
            if s.is_paired() {
                announce(Phase::Predict(k));
                let end = step_end(s);
                s.accelerate(end);
            }
        }
        Ok(())
    }

    /// Adds the works of an own step that no reflection follows.
    fn account_own(&mut self, group: usize, announce: &mut Announce<'_>) {
        announce(Phase::Ledger);
        for &k in &self.lockstep[group].members {
            self.ledger.supports += self.subdomains[k].account();
        }
        for &k in &self.lockstep[group].pairs {
            self.pairs[k].account(&self.subdomains);
        }
    }
}

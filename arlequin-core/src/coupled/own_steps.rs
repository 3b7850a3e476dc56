//! What subdomains do between two reflections.

use super::{Coupled, pair};
use crate::interface::Interface;
use crate::phase::Phase;
use crate::ranks::{Cuts, Portion};
use crate::subdomain::{Announce, Reached, Subdomain};
use crate::{Real, Result};
use std::ops::Range;
use std::sync::Arc;

/// Subdomains that step together, since effects act between them.
#[derive(Debug, Clone)]
pub(super) struct Lockstep {
    /// Their numbers, ascending.
    pub(super) members: Vec<usize>,
    /// Numbers of the effects between them.
    pub(super) pairs: Vec<usize>,
}

impl Lockstep {
    /// Groups of `count` subdomains with effects between these.
    pub(super) fn of(count: usize, pairs: &[[usize; 2]]) -> Vec<Self> {
        let mut group: Vec<usize> = (0..count).collect();
        for [a, b] in pairs {
            let (low, high) = (group[*a].min(group[*b]), group[*a].max(group[*b]));
            group.iter_mut().filter(|g| **g == high).for_each(|g| *g = low);
        }
        let firsts = (0..count).filter(|k| group[*k] == *k);
        let of = |first: usize| Self {
            members: (0..count).filter(|k| group[*k] == first).collect(),
            pairs: (0..pairs.len())
                .filter(|p| group[pairs[*p][0]] == first)
                .collect(),
        };
        firsts.map(of).collect()
    }
}

/// Entries of the coupling matrices of an interface on unknowns that move as prescribed: the forces on them
/// are work.
#[derive(Debug)]
pub(super) struct Held<T> {
    /// Coarse side, fine side; none where nothing moves.
    sides: [Option<HeldSide<T>>; 2],
    components: usize,
}

#[derive(Debug)]
struct HeldSide<T> {
    /// Multiplier, unknown, entry with the sign of the force; by unknowns.
    entries: Vec<(usize, usize, T)>,
    cuts: Cuts,
    portion: Option<Arc<Portion>>,
}

impl<T: Real> HeldSide<T> {
    fn new(mut entries: Vec<(usize, usize, T)>, components: usize) -> Self {
        entries.sort_by_key(|e| (e.1, e.0));
        Self {
            cuts: Cuts::at_units(entries.iter().map(|e| e.1 / components)),
            entries,
            portion: None,
        }
    }
}

impl<T: Real> Held<T> {
    pub(super) fn new(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> Self {
        let components = interface.components();
        let sides = [(0, -T::one()), (1, T::one())].map(|(m, sign)| {
            let s = &subdomains[interface.sides()[m]];
            let moving: std::collections::HashSet<usize> =
                s.moving().flat_map(|m| m.dofs.iter().copied()).collect();
            if moving.is_empty() {
                return None;
            }
            let matrix = interface.coupling_matrix(m)?;
            let all = matrix.iter().filter(|(_, (_, j))| moving.contains(j));
            let entries = all.map(|(b, (i, j))| (i, j, sign * *b)).collect();
            Some(HeldSide::new(entries, components))
        });
        Self { sides, components }
    }

    /// From now on models are in parts.
    pub(super) fn share_out(&mut self, portions: [Option<&Arc<Portion>>; 2]) {
        let d = self.components;
        for (side, portion) in self.sides.iter_mut().zip(portions) {
            let (Some(side), Some(portion)) = (side, portion) else {
                continue;
            };
            let here = |(i, j, b): &(usize, usize, T)| Some((*i, portion.local(j / d)? * d + j % d, *b));
            *side = HeldSide::new(side.entries.iter().filter_map(here).collect(), d);
            side.portion = Some(portion.clone());
        }
    }

    /// Power of the multipliers on moving supports \[W\], on all ranks.
    pub(super) fn power(&self, lambda: &[T], v: [&[T]; 2]) -> T {
        let of = |(side, v): (&Option<HeldSide<T>>, &[T])| {
            let side = side.as_ref()?;
            let part = |range: Range<usize>| {
                let all = side.entries[range].iter();
                [all.map(|(i, j, b)| *b * lambda[*i] * v[*j]).sum()]
            };
            Some(side.cuts.sum(side.portion.as_deref(), 1, &part)[0])
        };
        self.sides.iter().zip(v).filter_map(of).sum()
    }
}

impl<T: Real> Coupled<T> {
    /// Time \[s\] so long after the start of the steps made so far.
    pub(super) fn instant(&self, steps: usize) -> T {
        self.start_time + T::of((self.step + steps) as f64) * self.dt
    }

    /// All own steps of all subdomains up to the next reflection; `draw` says whether invariants will be
    /// asked for.
    pub(super) fn own_steps_of_all(&mut self, draw: bool, announce: &mut Announce<'_>) -> Result<()> {
        for g in 0..self.lockstep.len() {
            let first = self.lockstep[g].members[0];
            let (steps, dt) = (
                self.subdomains[first].own_steps(),
                self.subdomains[first].own_dt(),
            );
            for j in 1..=steps {
                let last = j == steps;
                let time = if last {
                    self.instant(1)
                } else {
                    self.instant(0) + T::of(j as f64) * dt
                };
                let reached = Reached { time, since: dt, dt };
                self.own_step(g, reached, draw && last, announce)?;
                if !last {
                    self.account_own(g, announce);
                }
            }
        }
        Ok(())
    }

    /// One own step of those that step together.
    pub(super) fn own_step(
        &mut self,
        group: usize,
        reached: Reached<T>,
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        for &k in &self.lockstep[group].members {
            announce(Phase::Predict(k));
            self.subdomains[k].predict(k, reached, keep, announce)?;
            self.ledger.supports += self.subdomains[k].work_within();
        }
        self.add_pair_forces(group, |_| reached, announce)
    }

    /// Forces between subdomains that step together, then the accelerations of all they act on.
    pub(super) fn add_pair_forces(
        &mut self,
        group: usize,
        reached: impl Fn(&Subdomain<T>) -> Reached<T>,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        for &k in &self.lockstep[group].pairs {
            announce(Phase::Pair(k));
            let p = &mut self.pairs[k];
            let [a, b] = pair(&mut self.subdomains, p.sides[0], p.sides[1]);
            let at = reached(a);
            let ((here, f), (there, g)) = (a.loaded_at(at), b.loaded_at(at));
            p.line.effect.add_forces([&here, &there], [f, g])?;
        }
        for &k in &self.lockstep[group].members {
            let s = &mut self.subdomains[k];
            if s.is_paired() {
                announce(Phase::Predict(k));
                let at = reached(s);
                s.accelerate(at);
            }
        }
        Ok(())
    }

    /// Works of an own step that no reflection follows.
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

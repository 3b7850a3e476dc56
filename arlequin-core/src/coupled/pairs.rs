//! Effects between two subdomains in a run, and what all effects of a run did.

use super::Coupled;
use crate::effect::{Attached, EffectLine, HostPair, PairEffect, PairSpec, StepDemand};
use crate::error::invalid;
use crate::interface::{Interface, coupled_nodes};
use crate::model::Finding;
use crate::phase::Phase;
use crate::subdomain::Subdomain;
use crate::{Real, Result};

/// A pair effect at work.
pub(crate) struct Pair<T: Real> {
    pub(crate) sides: [usize; 2],
    pub(crate) line: Attached<T, dyn PairEffect<T>>,
}

impl<T: Real> std::fmt::Debug for Pair<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pair")
            .field("sides", &self.sides)
            .field("effect", &self.line.effect.name())
            .finish_non_exhaustive()
    }
}

impl<T: Real> Pair<T> {
    /// Adds the work of this instant; both sides make the same steps.
    pub(crate) fn account(&mut self, subdomains: &[Subdomain<T>]) {
        let dt = subdomains[self.sides[0]].own_dt();
        let v = self.sides.map(|s| &subdomains[s].state().v[..]);
        let work = dt * self.line.effect.power(v);
        self.line.add(work);
    }
}

/// Refuses sides that are not two different subdomains.
pub(super) fn check<T: Real>(spec: &PairSpec<T>, count: usize) -> Result<()> {
    let [a, b] = spec.sides;
    if a != b && a.max(b) < count {
        return Ok(());
    }
    let what = format!("subdomains of '{}'", spec.effect.name());
    let rule = format!("must be two different ones of {count}; within one, use an effect on it");
    Err(invalid(&what, format_args!("{a} and {b}"), &rule))
}

/// Attaches effects between subdomains, telling them which nodes interfaces tie to the other side.
pub(super) fn attach<T: Real>(
    pairs: Vec<PairSpec<T>>,
    subdomains: &[Subdomain<T>],
    interfaces: &[Interface<T>],
) -> Result<Vec<Pair<T>>> {
    let mut out = Vec::with_capacity(pairs.len());
    for p in pairs {
        let mut tied = [Vec::new(), Vec::new()];
        for i in interfaces {
            for (m, mine) in tied.iter_mut().enumerate() {
                let [own, other] = [p.sides[m], p.sides[1 - m]];
                let Some(side) = (0..2).find(|&s| i.sides[s] == own && i.sides[1 - s] == other) else {
                    continue;
                };
                mine.resize(subdomains[own].model().layout().nodes, false);
                for node in coupled_nodes(&i.coupling[side], i.components()) {
                    mine[node] = true;
                }
            }
        }
        let sides = p.sides.map(|s| subdomains[s].host());
        out.push(Pair {
            sides: p.sides,
            line: Attached::new(p.effect.attach(&HostPair { sides, tied })?),
        });
    }
    Ok(out)
}

/// What effects between subdomains demand of the step of one.
pub(super) fn demands<T: Real>(pairs: &[Pair<T>], subdomain: usize) -> Vec<StepDemand<T>> {
    let of = |p: &Pair<T>| {
        let [a, b] = p.line.effect.step_demand();
        let [first, second] = p.sides.map(|s| s == subdomain);
        match (first, second) {
            (true, _) => Some(a),
            (_, true) => Some(b),
            _ => None,
        }
    };
    pairs.iter().filter_map(of).collect()
}

impl<T: Real> Coupled<T> {
    /// All effects that are on, and what they did: those of the models first, then those that were added,
    /// then those between two models.
    pub fn effects(&self) -> Vec<EffectLine<T>> {
        let single = self.subdomains.iter().enumerate();
        let between = self.pairs.iter().enumerate();
        let between = between.map(|(k, p)| p.line.line(p.line.effect.name().to_owned(), Phase::Pair(k)));
        single
            .flat_map(|(k, s)| s.effect_lines(k))
            .chain(between)
            .collect()
    }

    /// What the present state would need effects for that are not on.
    pub fn watch(&self) -> Vec<(String, Finding)> {
        let of = |s: &Subdomain<T>| {
            let on =
                |name: &str| s.effects().any(|e| e.name() == name) || s.model().effects().contains(&name);
            let found = s.watch();
            found
                .into_iter()
                .filter(|f| !on(f.effect))
                .map(|f| (s.model().name().to_owned(), f))
                .collect::<Vec<_>>()
        };
        self.subdomains.iter().flat_map(of).collect()
    }

    /// Energy \[J\] that effects have created, `work + stored − supplied` of those that must not and do:
    /// zero but for round-off where their laws are sound.
    pub fn created(&self) -> T {
        let single: T = self.subdomains.iter().map(Subdomain::created).sum();
        single + self.pairs.iter().map(|p| p.line.created()).sum()
    }
}

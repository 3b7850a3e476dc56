//! Pair effects, which act between two subdomains, and the list of all effects of a run with their works.

use super::Coupled;
use crate::effect::{Attached, EffectLine, HostPair, PairEffect, PairSpec, StepDemand};
use crate::error::invalid;
use crate::interface::{Interface, coupled_nodes};
use crate::model::Finding;
use crate::phase::{Phase, SetupPhase};
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result};

/// Pair effect with its two subdomains and its line of the ledger.
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
    /// Adds the work of this instant \[J\]. Both sides make own steps of the same length.
    pub(crate) fn account(&mut self, subdomains: &[Subdomain<T>]) {
        let dt = subdomains[self.sides[0]].own_dt();
        let v = self.sides.map(|s| &subdomains[s].state().v[..]);
        let work = dt * self.line.effect.power(v);
        self.line.add(work);
    }
}

/// Refuses a pair effect whose sides are not two different subdomains out of `count`.
pub(super) fn check<T: Real>(spec: &PairSpec<T>, count: usize) -> Result<()> {
    let [a, b] = spec.sides;
    if a != b && a.max(b) < count {
        return Ok(());
    }
    let what = format!("subdomains of '{}'", spec.effect.name());
    let rule = format!("must be two different ones of {count}; within one, use an effect on it");
    Err(invalid(&what, format_args!("{a} and {b}"), &rule))
}

/// Returns the two sides of a pair effect, with the nodes of each that interfaces tie to the other.
fn hosts<'a, T: Real>(
    sides: [usize; 2],
    subdomains: &'a [Subdomain<T>],
    interfaces: &[Interface<T>],
) -> HostPair<'a, T> {
    let mut tied = [Vec::new(), Vec::new()];
    for i in interfaces {
        for (m, mask) in tied.iter_mut().enumerate() {
            let [subdomain, partner] = [sides[m], sides[1 - m]];
            let Some(side) = (0..2).find(|&s| i.sides[s] == subdomain && i.sides[1 - s] == partner) else {
                continue;
            };
            // Stays empty where no interface ties the two sides.
            mask.resize(subdomains[subdomain].model().layout().nodes, false);
            for node in coupled_nodes(&i.coupling[side], i.components()) {
                mask[node] = true;
            }
        }
    }
    let sides = sides.map(|s| subdomains[s].host());
    HostPair { sides, tied }
}

/// Attaches pair effects; each one gets the nodes of its sides that interfaces tie to the other side.
pub(super) fn attach<T: Real>(
    pairs: Vec<PairSpec<T>>,
    subdomains: &[Subdomain<T>],
    interfaces: &[Interface<T>],
    announce: &mut dyn FnMut(SetupPhase),
) -> Result<Vec<Pair<T>>> {
    let mut out = Vec::with_capacity(pairs.len());
    for (k, p) in pairs.into_iter().enumerate() {
        announce(SetupPhase::Pair(k));
        let hosts = hosts(p.sides, subdomains, interfaces);
        out.push(Pair {
            sides: p.sides,
            line: Attached::new(p.effect.attach(&hosts)?),
        });
    }
    Ok(out)
}

/// Returns the demands of pair effects on the step of one subdomain.
pub(super) fn demands<T: Real>(pairs: &[Pair<T>], subdomain: usize) -> Vec<StepDemand<T>> {
    let demand = |p: &Pair<T>| {
        let [a, b] = p.line.effect.step_demand();
        let [first, second] = p.sides.map(|s| s == subdomain);
        match (first, second) {
            (true, _) => Some(a),
            (_, true) => Some(b),
            _ => None,
        }
    };
    pairs.iter().filter_map(demand).collect()
}

impl<T: Real> Coupled<T> {
    /// Refuses new weights of `subdomains` where a pair effect acts between two of them that an interface
    /// ties: the nodes that are tied, and touch nothing, would change.
    pub(super) fn check_pairs(&self, subdomains: &[usize]) -> Result<()> {
        for p in &self.pairs {
            let is_tied = |i: &Interface<T>| p.sides.iter().all(|s| i.sides.contains(s));
            if p.sides.iter().any(|s| subdomains.contains(s)) && self.interfaces.iter().any(is_tied) {
                let name = p.line.effect.name();
                return Err(Error::Unsupported {
                    model: self.subdomains[p.sides[0]].model().name().to_owned(),
                    what: format!(
                        "change its weights: '{name}' acts between it and a model that an interface ties to it; leave the effect out"
                    ),
                });
            }
        }
        Ok(())
    }

    /// Gives pair effects the new weights of `subdomains`.
    pub(super) fn reweigh_pairs(&mut self, subdomains: &[usize]) -> Result<()> {
        for p in &mut self.pairs {
            if p.sides.iter().any(|s| subdomains.contains(s)) {
                p.line
                    .reweigh(&hosts(p.sides, &self.subdomains, &self.interfaces))?;
            }
        }
        Ok(())
    }

    /// Lists all effects that are on with their works: for each model its own effects, then those that were
    /// added; last the pair effects.
    pub fn effects(&self) -> Vec<EffectLine<T>> {
        let single = self.subdomains.iter().enumerate();
        let between = self.pairs.iter().enumerate();
        let between = between.map(|(k, p)| p.line.line(p.line.effect.name().to_owned(), Phase::Pair(k)));
        single
            .flat_map(|(k, s)| s.effect_lines(k))
            .chain(between)
            .collect()
    }

    /// Returns findings in the present state that need an effect which is not on, each with the name of its
    /// model.
    pub fn watch(&self) -> Vec<(String, Finding)> {
        let missing = |s: &Subdomain<T>| {
            let is_on = |name: &str| {
                s.effects().any(|e| e.name() == name) || s.model().views().effects.contains(&name)
            };
            let findings = s.watch();
            findings
                .into_iter()
                .filter(|f| !is_on(f.effect))
                .map(|f| (s.model().name().to_owned(), f))
                .collect::<Vec<_>>()
        };
        self.subdomains.iter().flat_map(missing).collect()
    }

    /// Energy \[J\] created by effects that must not create any, `work + stored − supplied`; round-off if
    /// their laws are sound.
    pub fn created(&self) -> T {
        let single: T = self.subdomains.iter().map(Subdomain::created).sum();
        single + self.pairs.iter().map(|p| p.line.created()).sum()
    }
}

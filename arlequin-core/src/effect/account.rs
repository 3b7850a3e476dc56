//! What effects did: one line each, for reports.

use super::{Pair, StepDemand};
use crate::coupled::Coupled;
use crate::observer::Phase;
use crate::{Real, Subdomain};

/// What one effect did since the start.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectLine<T> {
    /// Subdomain and effect, as `model/effect`; for effects between two, their own name.
    pub name: String,
    /// The phase of a step in which it is computed; `None` for what is part of a model's forces.
    pub phase: Option<Phase>,
    /// Work on the models \[J\], negative where energy left them; `None` for effects that do none of their own.
    pub work: Option<T>,
    /// Half of the work of the last instant \[J\]: the half step that is still to come.
    pub pending: T,
    /// Energy the effect holds \[J\].
    pub stored: T,
    /// Energy it took from outside \[J\]; `None` for loads.
    pub supplied: Option<T>,
    /// Figures of its own.
    pub facts: Vec<(String, f64)>,
}

impl<T: Real> EffectLine<T> {
    /// Energy that is gone for good \[J\]: `supplied − work − stored`, the work taken up to the present instant.
    pub fn dissipated(&self) -> Option<T> {
        Some(self.supplied? - (self.work? - self.pending) - self.stored)
    }
}

/// Critical step \[s\] under demands, from that without.
pub(crate) fn shortened<T: Real>(free: T, demands: impl Iterator<Item = StepDemand<T>>) -> T {
    let (two, half) = (T::of(2.0), T::of(0.5));
    let omega = two / free;
    let bare = omega * omega;
    let (mut square, mut rate, mut gain) = (bare, T::zero(), T::one());
    for d in demands {
        square += d.stiffness;
        gain *= d.gain;
        rate += d.damping + d.viscosity * bare;
    }
    // The same bits as without effects where they demand nothing.
    let limit = if square == bare && gain == T::one() {
        free
    } else {
        two / (square * gain).sqrt()
    };
    let zeta = rate * limit * half * half;
    limit * ((T::one() + zeta * zeta).sqrt() - zeta)
}

impl<T: Real> Coupled<T> {
    /// All effects that are on, and what they did: those of the models first, then those that were added, then those
    /// between two models.
    pub fn effects(&self) -> Vec<EffectLine<T>> {
        let single = self.subdomains.iter().enumerate();
        let between = self.pairs.iter().enumerate().map(|(k, p)| EffectLine {
            name: p.effect.name().to_owned(),
            phase: Some(Phase::Pair(k)),
            work: Some(p.work),
            pending: p.last_work * T::of(0.5),
            stored: p.effect.stored(),
            supplied: p.effect.supplied(),
            facts: p.effect.facts(),
        });
        single
            .flat_map(|(k, s)| s.effect_lines(k))
            .chain(between)
            .collect()
    }

    /// What the present state would need effects for that are not on.
    pub fn watch(&self) -> Vec<(String, super::Finding)> {
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

    /// Energy \[J\] that effects have created, `work + stored − supplied` of those that must not and do: zero but for
    /// round-off where their laws are sound.
    pub fn created(&self) -> T {
        let of = |s: &Subdomain<T>| -> T {
            let works = s.works.iter().zip(&s.last_works);
            s.effects
                .iter()
                .zip(works)
                .filter_map(|(e, (w, last))| {
                    let work = *w - *last * T::of(0.5);
                    e.supplied().map(|from| (work + e.stored() - from).max(T::zero()))
                })
                .sum()
        };
        let single: T = self.subdomains.iter().map(of).sum();
        single + self.pairs.iter().map(Pair::created).sum()
    }
}

impl<T: Real> Subdomain<T> {
    fn effect_lines(&self, own: usize) -> Vec<EffectLine<T>> {
        let name = |effect: &str| format!("{}/{effect}", self.model().name());
        let mut out = Vec::new();
        for effect in self.model().effects() {
            let taken = self.evolved.filter(|e| e.effect == *effect);
            out.push(EffectLine {
                name: name(effect),
                phase: taken.map(|_| Phase::Evolve(own)),
                work: taken.map(|e| e.work),
                pending: T::zero(),
                stored: T::zero(),
                supplied: taken.map(|_| T::zero()),
                facts: taken.map_or_else(Vec::new, |_| self.model().facts()),
            });
        }
        let works = self.works.iter().zip(&self.last_works);
        for (k, (e, (w, last))) in self.effects.iter().zip(works).enumerate() {
            out.push(EffectLine {
                name: name(e.name()),
                phase: Some(Phase::Effect(own, k)),
                work: Some(*w),
                pending: *last * T::of(0.5),
                stored: e.stored(),
                supplied: e.supplied(),
                facts: e.facts(),
            });
        }
        out
    }
}

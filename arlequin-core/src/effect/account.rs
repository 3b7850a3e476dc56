//! Accounts of effects: one line for each, for reports.

use super::{AnyEffect, Effect, Host, HostPair, Instant, PairEffect, StepDemand};
use crate::phase::Phase;
use crate::record::Record;
use crate::{Real, Result};

/// Account of one effect since the start.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectLine<T> {
    /// Subdomain and effect, as `model/effect`; for an effect between two subdomains, its own name.
    pub name: String,
    /// Phase of a step in which the effect is computed; `None` for a part of a model's forces.
    pub phase: Option<Phase>,
    /// Work on the models \[J\], negative where energy left them; `None` for an effect that does no work of
    /// its own.
    pub work: Option<T>,
    /// Half of the work of the last instant \[J\], which belongs to the half step still to come.
    pub pending: T,
    /// Energy that the effect holds \[J\].
    pub stored: T,
    /// Energy that the effect took from outside \[J\]; `None` for loads.
    pub supplied: Option<T>,
    /// Figures of the effect: names (with units) and values.
    pub facts: Vec<(String, f64)>,
}

impl<T: Real> EffectLine<T> {
    /// Energy lost for good \[J\]: `supplied − work − stored`, with the work up to the present instant.
    pub fn dissipated(&self) -> Option<T> {
        Some(self.supplied? - (self.work? - self.pending) - self.stored)
    }
}

/// Critical step \[s\] under the demands of effects, from the critical step `free` without them.
pub(crate) fn shortened<T: Real>(free: T, demands: impl Iterator<Item = StepDemand<T>>) -> T {
    let (two, half) = (T::of(2.0), T::of(0.5));
    let omega = two / free;
    let bare = omega * omega;
    let (mut square, mut rate, mut gain) = (bare, T::zero(), T::one());
    for d in demands {
        square += d.stiffness;
        gain *= d.gain;
        // Damping of the stiffness grows with the frequency: `viscosity ω²` at the highest one.
        rate += d.damping + d.viscosity * bare;
    }
    // Where effects demand nothing, keep the bits of `free`.
    let limit = if square == bare && gain == T::one() {
        free
    } else {
        two / (square * gain).sqrt()
    };
    // `ζ = c/(2ω)` with `ω = 2/limit`. Effects see velocities half a step old, so that damping shortens the
    // step.
    let zeta = rate * limit * half * half;
    limit * ((T::one() + zeta * zeta).sqrt() - zeta)
}

/// An attached effect, on one subdomain or between two, with its line of the ledger.
pub(crate) struct Attached<T, E: ?Sized> {
    pub(crate) effect: Box<E>,
    work: T,
    /// Work of the last instant.
    last_work: T,
    /// True if weights changed at this instant and the effect stayed: its forces stay as well.
    kept: bool,
}

impl<T: Real> Attached<T, dyn Effect<T>> {
    /// Gives the effect the weights of `host` ([`Effect::reweigh`]).
    pub(crate) fn reweigh(&mut self, host: &Host<'_, T>) -> Result<()> {
        self.effect.reweigh(host)?;
        self.kept = true;
        Ok(())
    }

    /// Adds the forces of the effect at an instant. Contacts that stayed through a change of weights at this
    /// instant push as before it: anew, they would take the step that led here for a second one, and their
    /// obstacles would lose half a step of their motion.
    pub(crate) fn add_forces(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        if std::mem::take(&mut self.kept) && self.effect.add_contact(f) {
            return Ok(());
        }
        self.effect.add_forces(instant, f)
    }
}

impl<T: Real> Attached<T, dyn PairEffect<T>> {
    /// Gives the effect the weights of `hosts` ([`PairEffect::reweigh`]).
    pub(crate) fn reweigh(&mut self, hosts: &HostPair<'_, T>) -> Result<()> {
        self.effect.reweigh(hosts)?;
        self.kept = true;
        Ok(())
    }

    /// Adds the forces of the effect at an instant; right after a change of weights, those of before it.
    pub(crate) fn add_forces(&mut self, instants: [&Instant<'_, T>; 2], f: [&mut [T]; 2]) -> Result<()> {
        let [first, second] = f;
        if std::mem::take(&mut self.kept) {
            let [a, b] =
                [(0, &mut *first), (1, &mut *second)].map(|(side, f)| self.effect.add_contact(side, f));
            if a && b {
                return Ok(());
            }
        }
        self.effect.add_forces(instants, [first, second])
    }
}

impl<T: Real, E: AnyEffect<T> + ?Sized> Attached<T, E> {
    pub(crate) fn new(effect: Box<E>) -> Self {
        Self {
            effect,
            work: T::zero(),
            last_work: T::zero(),
            kept: false,
        }
    }

    /// Work on the models since the start \[J\].
    pub(crate) fn work(&self) -> T {
        self.work
    }

    /// Adds the work of an instant \[J\].
    pub(crate) fn add(&mut self, work: T) {
        self.last_work = work;
        self.work += work;
    }

    /// Adds the work of a whole step \[J\], none of which is pending.
    pub(crate) fn add_whole(&mut self, work: T) {
        self.last_work = T::zero();
        self.work += work;
    }

    /// Energy that the effect has created \[J\], `work + stored − supplied` but not below zero; positive only
    /// if its law is wrong.
    pub(crate) fn created(&self) -> T {
        // Half of the last work belongs to the half step that is still to come.
        let work = self.work - self.last_work * T::of(0.5);
        let excess = |supplied: T| (work + self.effect.stored() - supplied).max(T::zero());
        self.effect.supplied().map_or_else(T::zero, excess)
    }

    /// Account of the effect, under the name that reports give it.
    pub(crate) fn line(&self, name: String, phase: Phase) -> EffectLine<T> {
        EffectLine {
            name,
            phase: Some(phase),
            work: Some(self.work),
            pending: self.last_work * T::of(0.5),
            stored: self.effect.stored(),
            supplied: self.effect.supplied(),
            facts: self.effect.facts(),
        }
    }

    pub(crate) fn restore(&mut self, work: T, from: &Record<T>) -> Result<()> {
        (self.work, self.last_work) = (work, T::zero());
        self.effect.restore(from)
    }
}

//! What effects did: one line each, for reports.

use super::{AnyEffect, StepDemand};
use crate::phase::Phase;
use crate::record::Record;
use crate::{Real, Result};

/// What one effect did since the start.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectLine<T> {
    /// Subdomain and effect, as `model/effect`; for effects between two, their own name.
    pub name: String,
    /// The phase of a step in which it is computed; `None` for what is part of a model's forces.
    pub phase: Option<Phase>,
    /// Work on the models \[J\], negative where energy left them; `None` for effects that do none of their
    /// own.
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
    /// Energy that is gone for good \[J\]: `supplied − work − stored`, the work taken up to the present
    /// instant.
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

/// An effect at work, on one subdomain or between two, with its line of the ledger.
pub(crate) struct Attached<T, E: ?Sized> {
    pub(crate) effect: Box<E>,
    work: T,
    /// What the last instant added to it.
    last: T,
}

impl<T: Real, E: AnyEffect<T> + ?Sized> Attached<T, E> {
    pub(crate) fn new(effect: Box<E>) -> Self {
        Self {
            effect,
            work: T::zero(),
            last: T::zero(),
        }
    }

    /// Work on the models since the start \[J\].
    pub(crate) fn work(&self) -> T {
        self.work
    }

    /// Adds the work of an instant \[J\].
    pub(crate) fn add(&mut self, work: T) {
        self.last = work;
        self.work += work;
    }

    /// Adds the work of a whole step, of which nothing is still to come \[J\].
    pub(crate) fn add_whole(&mut self, work: T) {
        self.last = T::zero();
        self.work += work;
    }

    /// Energy \[J\] the effect has created, `work + stored − supplied`: above zero only where its law is at
    /// fault.
    pub(crate) fn created(&self) -> T {
        let work = self.work - self.last * T::of(0.5);
        let of = |from: T| (work + self.effect.stored() - from).max(T::zero());
        self.effect.supplied().map_or_else(T::zero, of)
    }

    /// What it did, under the name that reports give it.
    pub(crate) fn line(&self, name: String, phase: Phase) -> EffectLine<T> {
        EffectLine {
            name,
            phase: Some(phase),
            work: Some(self.work),
            pending: self.last * T::of(0.5),
            stored: self.effect.stored(),
            supplied: self.effect.supplied(),
            facts: self.effect.facts(),
        }
    }

    pub(crate) fn restore(&mut self, work: T, from: &Record<T>) -> Result<()> {
        (self.work, self.last) = (work, T::zero());
        self.effect.restore(from)
    }
}

//! How a participant steps between two reflections.

use super::Subdomain;
use crate::{Real, Result};

/// How a participant of a run gets from one reflection to the next, a step of the run `ΔT` later.
///
/// Reflections leave `½vᵀMv` of all participants together as it is and touch no positions, so that every
/// participant may step as it likes in between, as long as it keeps its own energy (docs/method.md).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum OwnStep<T> {
    /// In one step of its own, unless [`crate::TimeStep::Chosen`] finds that it needs more.
    #[default]
    Same,
    /// In so many steps of its own, at least one.
    Ratio(usize),
    /// In as few steps as keep each at or below this share, in (0, 1], of its own critical step.
    Fraction(T),
    /// In one implicit step that has no critical one: average acceleration, for linear continua.
    Implicit,
}

/// What was chosen: the number of own steps in a step of the run, and their length \[s\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace<T> {
    pub(super) steps: usize,
    pub(super) dt: T,
}

impl<T: Real> Subdomain<T> {
    /// Says how it steps between two reflections; [`OwnStep::Same`] unless said otherwise.
    #[must_use]
    pub fn with_step(mut self, own: OwnStep<T>) -> Self {
        self.own = own;
        self
    }

    /// How it was asked to step.
    pub fn step_choice(&self) -> OwnStep<T> {
        self.own
    }

    /// Number of its own steps in a step of the run; set when the run is built.
    pub fn own_steps(&self) -> usize {
        self.pace.steps
    }

    /// Length of its own steps \[s\]; zero before the run is built.
    pub fn own_dt(&self) -> T {
        self.pace.dt
    }

    /// Takes so many own steps in a step of the run.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] where it is to step implicitly and cannot.
    pub(crate) fn set_pace(&mut self, run: T, steps: usize) -> Result<()> {
        let dt = if steps == 1 {
            run
        } else {
            run / T::of(steps as f64)
        };
        self.pace = Pace { steps, dt };
        match self.own {
            OwnStep::Implicit => self.make_implicit(),
            _ => Ok(()),
        }
    }
}

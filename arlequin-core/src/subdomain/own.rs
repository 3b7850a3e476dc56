//! Own steps of a participant between two reflections.

use super::Subdomain;
use crate::{Real, Result};

/// How a participant of a run gets from one reflection to the next, one macro step `ΔT` later.
///
/// Reflections keep `½vᵀMv` of all participants together and change no positions. Every participant may
/// therefore step as it likes in between, as long as it keeps its own energy (docs/method.md).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum OwnStep<T> {
    /// One own step, unless [`crate::TimeStep::Chosen`] finds that more are needed.
    #[default]
    Same,
    /// This number of own steps, at least one.
    Ratio(usize),
    /// Smallest number of own steps that keeps each at or below this share, in (0, 1], of the critical step
    /// of the participant.
    Fraction(T),
    /// One implicit step without a critical step: average acceleration, for linear continua.
    Implicit,
}

/// Number of own steps in a macro step, and their length \[s\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace<T> {
    pub(super) steps: usize,
    pub(super) dt: T,
}

impl<T: Real> Subdomain<T> {
    /// Sets how the model steps between two reflections; [`OwnStep::Same`] by default.
    #[must_use]
    pub fn with_step(mut self, step: OwnStep<T>) -> Self {
        self.requested_step = step;
        self
    }

    /// Requested own step.
    pub fn step_choice(&self) -> OwnStep<T> {
        self.requested_step
    }

    /// Number of own steps in a macro step; set when the run is built.
    pub fn own_steps(&self) -> usize {
        self.pace.steps
    }

    /// Length of an own step \[s\]; zero before the run is built.
    pub fn own_dt(&self) -> T {
        self.pace.dt
    }

    /// Sets the number of own steps in a macro step `run` \[s\].
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] if an implicit step was requested and the model cannot make it.
    pub(crate) fn set_pace(&mut self, run: T, steps: usize) -> Result<()> {
        let dt = if steps == 1 {
            run
        } else {
            run / T::of(steps as f64)
        };
        self.pace = Pace { steps, dt };
        match self.requested_step {
            OwnStep::Implicit => self.make_implicit(),
            _ => Ok(()),
        }
    }
}

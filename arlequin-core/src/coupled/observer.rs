//! Observers watch a run: probes, output, progress, timing. The core itself prints and writes nothing.

use super::Coupled;
use super::ledger::EnergySample;
use super::warning::Warning;
use crate::Real;
use std::ops::ControlFlow;

pub use crate::phase::{Phase, SetupPhase};

/// The macro step that was just made.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport<T> {
    /// Steps made so far.
    pub step: usize,
    /// Time \[s\].
    pub time: T,
    /// Energy balance, at steps where the ledger was evaluated.
    pub energy: Option<EnergySample<T>>,
}

/// Watches a run. Phases may be announced from a worker thread.
pub trait Observer<T: Real>: Send {
    /// Called before each phase of a step.
    fn phase(&mut self, _: Phase) {}

    /// Called once for each warning, at the end of the step in which it arose. Warnings of the set-up come
    /// before the first step. [`Coupled::warnings`] keeps all warnings.
    fn warning(&mut self, _: &Warning) {}

    /// Called after each step; `Break` ends the run.
    ///
    /// # Errors
    /// Ends the run with that error.
    fn observe(&mut self, run: &Coupled<T>, report: &StepReport<T>) -> crate::Result<ControlFlow<()>>;
}

/// An observer that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl<T: Real> Observer<T> for Silent {
    fn observe(&mut self, _: &Coupled<T>, _: &StepReport<T>) -> crate::Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

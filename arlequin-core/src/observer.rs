//! Observers watch a run: probes, output, progress, timing. The core itself prints and writes nothing.

use crate::Real;
use crate::coupled::Coupled;
use crate::ledger::EnergySample;
use std::ops::ControlFlow;

/// What a step is doing; announced so that an observer with a clock can tell where time goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// Prediction and internal forces of a subdomain.
    Predict(usize),
    /// A model changes itself (subdomain); only where one does.
    Evolve(usize),
    /// Forces of an effect (subdomain, effect); only where there is one.
    Effect(usize, usize),
    /// Forces of an effect between two subdomains (its number); only where there is one.
    Pair(usize),
    /// Multiplier solve and correction.
    Interface,
    /// Energy ledger.
    Ledger,
    /// Observers.
    Observe,
}

/// The step that was just made.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport<T> {
    /// Steps made so far.
    pub step: usize,
    /// Time \[s\].
    pub time: T,
    /// Balance, at steps where the ledger was drawn.
    pub energy: Option<EnergySample<T>>,
}

/// Watches a run. Phases may be announced from a worker thread.
pub trait Observer<T: Real>: Send {
    /// Called before each phase of a step.
    fn phase(&mut self, _: Phase) {}

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

//! News of a run while it goes on, and its results.

use super::checkpoint::Checkpoint;
use crate::error::Result;
use crate::output::curves::CurveLine;
use crate::output::fragments::Piece;
use crate::output::summary::Summary;
use crate::output::tables::Table;
use arlequin::core::{Coupled, Subdomain};
use arlequin::dem_beam::fracture::SharedLog;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Receives news of a run and may end it.
pub trait Observer {
    /// Receives a warning, once, as soon as it is known.
    fn warning(&mut self, _text: &str) {}
    /// Called after each step, with the planned number of steps. `Break` ends the run; one with a folder can
    /// be resumed.
    fn step(&mut self, _run: &Coupled<f64>, _planned: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
    /// Called after the last step; the results are gathered next.
    fn stepped(&mut self) {}
    /// Draws the tables of probes, energy and effects if the scene asks for plots; the folder is finished
    /// afterwards.
    ///
    /// # Errors
    /// Plots that cannot be drawn or written.
    fn plot(&mut self, _folder: &Path, _title: &str, _tables: [&Table; 3]) -> Result<()> {
        Ok(())
    }
    /// Draws one probe over another; called after [`Self::plot`].
    ///
    /// # Errors
    /// A plot that cannot be drawn or written.
    fn plot_curve(&mut self, _folder: &Path, _title: &str, _curve: &CurveLine) -> Result<()> {
        Ok(())
    }
}

/// An observer that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Reason for which the steps ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// All steps are made.
    Complete,
    /// The observer ended the run.
    Interrupted,
    /// A crack ran into an overlap, and the scene asks to end there.
    IntoOverlap,
}

impl End {
    /// Returns whether [`super::resume`] can continue the run.
    pub(super) fn can_resume(self) -> bool {
        matches!(self, Self::Interrupted | Self::IntoOverlap)
    }
}

/// Recorded values of a run.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Summary, as in `summary.json`.
    pub summary: Summary,
    /// Probes over time; names have units.
    pub probes: Table,
    /// Energy, works and momenta over time \[J, kg m/s\].
    pub energy: Table,
    /// Figures of effects over time.
    pub effects: Table,
    /// Curves of one probe over another.
    pub curves: Vec<CurveLine>,
    /// Fragments into which bodies broke, at the times of the frames; for partitioned models on rank 0 only.
    pub fragments: Vec<Piece>,
}

/// Results of a run.
#[derive(Debug)]
pub struct Results {
    /// Recorded values.
    pub recorded: Recorded,
    /// The models in their last state: displacements, velocities, multipliers.
    pub run: Coupled<f64>,
    /// Logs of broken bonds by model, if its bonds can break.
    pub breaks: Vec<Option<SharedLog>>,
    /// Reason for which the steps ended.
    pub end: End,
    /// Planned number of steps.
    pub planned: usize,
    /// Folder of the results, if any.
    pub folder: Option<PathBuf>,
    /// Checkpoint for the remaining steps of a run without a folder.
    pub(super) remaining: Option<Box<Checkpoint>>,
}

impl Results {
    /// Returns the summary.
    pub fn summary(&self) -> &Summary {
        &self.recorded.summary
    }

    /// Returns times \[s\] and values of a probe.
    pub fn probe(&self, name: &str) -> Option<(&[f64], &[f64])> {
        let k = self.summary().probes.keys().position(|n| n == name)?;
        Some((&self.recorded.probes.times, &self.recorded.probes.columns[k]))
    }

    /// Returns a model in its last state.
    pub fn model(&self, name: &str) -> Option<&Subdomain<f64>> {
        let models = self.run.subdomains();
        models.iter().find(|s| s.model().name() == name)
    }
}

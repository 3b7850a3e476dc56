//! A sweep: one scene with many settings, each compared with a reference, to learn what accuracy costs in
//! time.
//!
//! The caller provides a [`Runner`] that makes one run, for instance in a process of its own.

pub mod conclude;
mod curve;
mod kept;
mod plan;
mod result;

pub use crate::spec::sweep::{Hook, Mark, SweepFile};
pub use curve::{Curve, Errors};
pub use plan::Member;
pub use result::{HookRow, Measured, PHASES, Run, Seconds, Sweep, hook_rows};

use super::suggest::{self, Prediction};
use crate::Progress;
use crate::error::{Error, Result, key, write};
use crate::output::mark;
use crate::scene::{Scene, Source};
use crate::spec::sweep::Reference;
use kept::Kept;
use std::collections::BTreeMap;
use std::path::Path;

/// Makes the runs of a sweep.
pub trait Runner {
    /// Makes one run and writes its results to `folder`.
    ///
    /// # Errors
    /// Failures of the runner itself; a failed run is an [`Outcome`].
    fn run(&self, member: &Member, folder: &Path) -> Result<Outcome>;
    /// Returns whether the user has stopped the sweep.
    fn stopped(&self) -> bool {
        false
    }
}

/// How a run ended.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// The run has written its `summary.json`.
    Complete,
    /// The run failed with this message.
    Failed(String),
    /// The user interrupted the run.
    Interrupted,
}

/// A sweep whose file, scenes and reference curves have been checked.
#[derive(Debug)]
pub struct PlannedSweep {
    file: SweepFile,
    members: Vec<Member>,
    curves: BTreeMap<String, Curve>,
}

/// Reads a sweep file.
///
/// # Errors
/// A text that is not a sweep file.
pub fn read(source: &Source) -> Result<SweepFile> {
    toml::from_str(&source.text).map_err(|e: toml::de::Error| Error::Syntax {
        message: e.message().to_owned(),
        span: e.span(),
    })
}

impl PlannedSweep {
    /// Plans the runs and reads the reference curves, so that all mistakes in the input are found here.
    ///
    /// # Errors
    /// A mistake in the sweep file or in the scene of a run.
    pub fn new(source: &Source) -> Result<Self> {
        let file = read(source)?;
        let members = plan::members(&file, &source.folder)?;
        for m in members.iter().filter(|m| file.suggest && m.swept) {
            suggest::readable(Scene::read(&m.scene)?.assign(&m.set)?.spec())
                .map_err(|e| key("suggest", format!("cannot speak of run '{}': {e}", m.label)))?;
        }
        let mut curves = BTreeMap::new();
        if let Some(Reference::Curves(tables)) = &file.reference {
            for (name, table) in tables {
                let place = format!("reference.curves.{name}");
                curves.insert(name.clone(), Curve::new(&place, table, &source.folder)?);
            }
        }
        Ok(Self {
            file,
            members,
            curves,
        })
    }

    /// The sweep file.
    pub fn file(&self) -> &SweepFile {
        &self.file
    }

    /// Returns the label of the first run without finished results in a folder.
    pub fn unfinished(&self, out: &Path) -> Option<&str> {
        let store = Kept::new(out, &self.file);
        let mut missing = self.members.iter().filter(|m| store.finished(m).is_none());
        missing.next().map(|m| m.label.as_str())
    }

    /// Makes the runs in a folder and draws the conclusion. Finished runs there are reused unless `fresh` is
    /// set.
    ///
    /// # Errors
    /// Files that cannot be read or written; failed runs are part of the result.
    pub fn make(self, out: &Path, fresh: bool, runner: &dyn Runner, progress: Progress<'_>) -> Result<Sweep> {
        let store = Kept::new(out, &self.file);
        std::fs::create_dir_all(&store.folder).map_err(write(&store.folder))?;
        let mut runs: Vec<Run> = self.members.iter().map(Run::planned).collect();
        for (k, (m, r)) in self.members.iter().zip(&mut runs).enumerate() {
            if runner.stopped() {
                break;
            }
            progress(&m.label, k, self.members.len());
            let known = if fresh { None } else { store.finished(m) };
            r.reused = known.is_some();
            let outcome = match known {
                Some(summary) => Ok(summary),
                None => store.run(m, runner)?,
            };
            match outcome {
                Ok(summary) => {
                    r.take(&summary, m, &self.file);
                    if self.file.suggest && m.swept {
                        r.predicted = Some(predicted(&store.folder.join(&m.label), m, r.reused)?);
                    }
                }
                Err(Outcome::Failed(words)) => {
                    r.status = "failed";
                    r.error = Some(words);
                }
                // Interrupted: this run and those behind it stay missing.
                Err(_) => break,
            }
        }
        self.conclude(runs, &store, runner.stopped())
    }

    /// Compares the runs with the reference and draws the conclusion.
    fn conclude(self, mut runs: Vec<Run>, store: &Kept, interrupted: bool) -> Result<Sweep> {
        let Self { file, mut curves, .. } = self;
        let probes = |label: &str| curve::probes(&store.folder.join(label).join(mark::TABLES[0]));
        if let Some(Reference::Run(_)) = &file.reference {
            // `reference_first` put the reference first; it has no result if it failed or was not reached.
            if runs[0].status == "complete" {
                let reference = probes(&runs[0].label)?;
                curves = reference
                    .into_iter()
                    .map(|(n, s)| (n, Curve::Samples(s)))
                    .collect();
                result::compare_measures(&mut runs);
            }
        }
        for r in runs.iter_mut().filter(|r| r.status == "complete") {
            r.compare(&probes(&r.label)?, &curves, &file);
        }
        result::mark_pareto(&mut runs);
        let failed = runs.iter().any(|r| r.status == "failed");
        let status = match (interrupted, failed) {
            (true, _) => "interrupted",
            (_, true) => "failed",
            _ => "complete",
        };
        Ok(Sweep::new(&file, runs, status))
    }
}

/// Returns what `suggest` predicts for a finished run.
fn predicted(folder: &Path, m: &Member, reused: bool) -> Result<Prediction> {
    let path = folder.join("predicted.json");
    if let Some(known) = kept::read(&path).filter(|_| reused) {
        return Ok(known);
    }
    let prediction = suggest::predict_as_given(&Scene::read(&m.scene)?.assign(&m.set)?)?;
    // Kept beside the results, because its times depend on the machine and its load.
    kept::put(&path, &prediction)?;
    Ok(prediction)
}

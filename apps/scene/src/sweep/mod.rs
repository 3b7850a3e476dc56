//! A sweep: one scene with many settings, each held against a reference; what accuracy costs in time.
//!
//! How a run is made is the caller's: a [`Runner`] makes one, so that each may have a process of its own.

pub mod conclude;
mod curve;
mod kept;
mod plan;
mod result;
pub(crate) mod spec;

pub use curve::{Curve, Errors};
pub use plan::Member;
pub use result::{HookRow, Measured, PHASES, Run, Seconds, Sweep, hook_rows};
pub use spec::{Hook, Mark, SweepFile};

use crate::Progress;
use crate::error::{Error, Result, key, write};
use crate::suggest::{self, Prediction};
use crate::{Scene, Source};
use kept::Kept;
use spec::Reference;
use std::collections::BTreeMap;
use std::path::Path;

/// Makes the runs of a sweep.
pub trait Runner {
    /// Makes a run, whose results go to `folder`.
    ///
    /// # Errors
    /// Failures of the caller; those of the run are an [`Outcome`].
    fn run(&self, member: &Member, folder: &Path) -> Result<Outcome>;
    /// Whether the user has ended the sweep.
    fn stopped(&self) -> bool {
        false
    }
}

/// What came of a run.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// It has written its `summary.json`.
    Complete,
    /// Its words.
    Failed(String),
    /// By its user.
    Interrupted,
}

/// A sweep whose input is sound.
#[derive(Debug)]
pub struct PlannedSweep {
    file: SweepFile,
    members: Vec<Member>,
    curves: BTreeMap<String, Curve>,
}

/// Reads a sweep file.
///
/// # Errors
/// Text that is no sweep.
pub fn read(source: &Source) -> Result<SweepFile> {
    toml::from_str(&source.text).map_err(|e: toml::de::Error| Error::Syntax {
        message: e.message().to_owned(),
        span: e.span(),
    })
}

impl PlannedSweep {
    /// Plans the runs and reads the reference curves; all mistakes of the input show here.
    ///
    /// # Errors
    /// What is wrong with the sweep or with the scene of a run.
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

    /// Label of the first run that is not finished in a folder.
    pub fn unfinished(&self, out: &Path) -> Option<&str> {
        let kept = Kept::new(out, &self.file);
        let mut missing = self.members.iter().filter(|m| kept.finished(m).is_none());
        missing.next().map(|m| m.label.as_str())
    }

    /// Makes the runs into a folder, those that are finished there only with `fresh`, and draws the
    /// conclusion.
    ///
    /// # Errors
    /// What cannot be read or written; failed runs are part of the result.
    pub fn make(self, out: &Path, fresh: bool, runner: &dyn Runner, progress: Progress<'_>) -> Result<Sweep> {
        let kept = Kept::new(out, &self.file);
        std::fs::create_dir_all(&kept.folder).map_err(write(&kept.folder))?;
        let mut runs: Vec<Run> = self.members.iter().map(Run::planned).collect();
        for (k, (m, r)) in self.members.iter().zip(&mut runs).enumerate() {
            if runner.stopped() {
                break;
            }
            progress(&m.label, k, self.members.len());
            let known = if fresh { None } else { kept.finished(m) };
            r.reused = known.is_some();
            let made = match known {
                Some(summary) => Ok(summary),
                None => kept.run(m, runner)?,
            };
            match made {
                Ok(summary) => {
                    r.take(&summary, m, &self.file);
                    if self.file.suggest && m.swept {
                        r.predicted = Some(predicted(&kept.folder.join(&m.label), m, r.reused)?);
                    }
                }
                Err(Outcome::Failed(words)) => {
                    r.status = "failed";
                    r.error = Some(words);
                }
                Err(_) => break,
            }
        }
        self.conclude(runs, &kept, runner.stopped())
    }

    /// Holds the runs against the reference.
    fn conclude(self, mut runs: Vec<Run>, kept: &Kept, interrupted: bool) -> Result<Sweep> {
        let Self { file, mut curves, .. } = self;
        let probes = |label: &str| curve::probes(&kept.folder.join(label).join("probes.csv"));
        if let Some(Reference::Run(_)) = &file.reference {
            // It was put first, and is missing only if it failed or was not reached.
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

/// What `suggest` predicts of a finished run, kept beside its results: its times are those of this machine
/// at that hour.
fn predicted(folder: &Path, m: &Member, reused: bool) -> Result<Prediction> {
    let path = folder.join("predicted.json");
    if let Some(known) = kept::read(&path).filter(|_| reused) {
        return Ok(known);
    }
    let found = suggest::predict_as_given(&Scene::read(&m.scene)?.assign(&m.set)?)?;
    kept::put(&path, &found)?;
    Ok(found)
}

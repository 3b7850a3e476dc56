//! Sweeps: many runs, one after another, in this process.

use crate::border::{outside, raised};
use crate::error::Fault;
use crate::scene::Watch;
use arlequin_scene::output::mark;
use arlequin_scene::sweep::{Member, Outcome, PlannedSweep, Runner};
use arlequin_scene::{End, RunFolder, Scene, Source};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Makes the runs of a sweep in this process, and keeps the error that stopped one of them.
struct InProcess(Mutex<Option<Fault>>);

impl InProcess {
    fn stop(&self) -> std::sync::MutexGuard<'_, Option<Fault>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Runner for InProcess {
    fn run(&self, member: &Member, folder: &Path) -> arlequin_scene::Result<Outcome> {
        let mut watch = Watch::new(None, None);
        let scene = Scene::read(&member.scene).and_then(|s| s.assign(&member.set));
        let outcome = scene.and_then(|s| {
            // The sweep knows which runs are finished; all others may be overwritten.
            let folder = RunFolder::new(&s, Some(folder), true)?;
            s.prepare()?.run_into(folder, &mut watch)
        });
        Ok(match outcome {
            Ok(r) if r.end == End::Interrupted => {
                *self.stop() = watch.stop;
                Outcome::Interrupted
            }
            Ok(_) => Outcome::Complete,
            // Ctrl-C during a set-up arrives as an error.
            Err(e) => match raised() {
                Some(raised) => {
                    *self.stop() = Some(raised.into());
                    Outcome::Interrupted
                }
                None => Outcome::Failed(e.to_string()),
            },
        })
    }

    fn stopped(&self) -> bool {
        self.stop().is_some()
    }
}

/// Makes the runs of a sweep file into a folder, draws the conclusion, and returns the text of its
/// `sweep.json`.
#[pyfunction]
pub(crate) fn sweep(
    py: Python<'_>,
    path: PathBuf,
    out: PathBuf,
    fresh: bool,
    listener: Option<Py<PyAny>>,
) -> PyResult<String> {
    outside(py, || {
        let source = Source::read(&path)?;
        let fault = |e| Fault::of_scene(e, &source);
        let planned = PlannedSweep::new(&source).map_err(fault)?;
        // A mistake in the file leaves no folder behind.
        mark::claim("out", &out)?;
        let runner = InProcess(Mutex::new(None));
        let report_progress = |label: &str, done: usize, total: usize| {
            let Some(listener) = &listener else { return };
            let reported = Python::attach(|py| {
                listener
                    .call_method1(py, "member", (label, done, total))
                    .map(drop)
            });
            if let Err(e) = reported {
                *runner.stop() = Some(e.into());
            }
        };
        let results = planned
            .make(&out, fresh, &runner, &report_progress)
            .map_err(fault)?;
        // What an interrupted sweep has reached is written as well.
        let text = results.write(&out)?;
        match runner.stop().take() {
            Some(e) => Err(e),
            None => Ok(text),
        }
    })
}

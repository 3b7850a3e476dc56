//! A scene that is ready to run, its run in memory or in a folder, and resuming a run that was stopped.

use super::checkpoint::Checkpoint;
use super::folder::{Keep, RunFolder};
use super::results::{Observer, Results};
use super::session::Session;
use crate::error::{Error, Result, key};
use crate::output::writer::writer;
use crate::output::{Folder, mark};
use crate::ranks::together;
use crate::scene::Scene;
use crate::setup::{self, Built, lower};
use arlequin::core::Coupled;
use arlequin::core::ranks::Communicator;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A scene with everything built, ready to run.
#[derive(Debug)]
pub struct Prepared {
    pub(crate) scene: Scene,
    pub(crate) built: Built,
    /// Duration of the set-up \[s\].
    pub(crate) setup: f64,
}

impl Scene {
    /// Meshes, packs and couples everything that the scene describes. Collective.
    ///
    /// # Errors
    /// Mistakes in the scene: the key, its value, the limit and the remedy.
    pub fn prepare(&self) -> Result<Prepared> {
        self.prepare_with(&mut |_, _, _| ())
    }

    /// Prepares the scene like [`Self::prepare`]; calls `announce` with the name of each phase of the set-up
    /// as it begins, and two zeros. While spheres are packed, it is called again with the name of the phase,
    /// the percentage done and 100.
    ///
    /// # Errors
    /// See [`Self::prepare`].
    pub fn prepare_with(&self, announce: &mut dyn FnMut(&str, usize, usize)) -> Result<Prepared> {
        let prepared = Prepared::new(self, announce).map_err(|e| lower::written(self.spec(), e));
        self.ranks().together(prepared)
    }
}

impl Prepared {
    fn new(scene: &Scene, report: &mut dyn FnMut(&str, usize, usize)) -> Result<Self> {
        let begin = Instant::now();
        // An unknown format is refused before minutes of packing.
        writer(&scene.spec().output)?;
        let built = setup::build_from(scene.spec(), scene.folder(), scene.ranks(), report)?;
        Ok(Self {
            scene: scene.clone(),
            built,
            setup: begin.elapsed().as_secs_f64(),
        })
    }

    /// Returns the coupled models before the first step.
    pub fn coupled(&self) -> &Coupled<f64> {
        &self.built.run
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns everything that was built.
    pub fn built(&self) -> &Built {
        &self.built
    }

    /// Returns the warnings known before the first step.
    pub fn warnings(&self) -> &[String] {
        &self.built.warnings
    }

    /// Makes all steps and returns the results; writes no files.
    ///
    /// # Errors
    /// Failures of the run, such as values that are not finite or energy that grows.
    pub fn run(self, observer: &mut dyn Observer) -> Result<Results> {
        self.start(None, observer)
    }

    /// Makes all steps and writes the results into a folder, which gets its name when the run has ended.
    ///
    /// # Errors
    /// Failures of the run, with a note of the results that were kept; files that cannot be written.
    pub fn run_into(self, folder: RunFolder, observer: &mut dyn Observer) -> Result<Results> {
        let keep = self.scene.ranks().together(Keep::begin(folder))?;
        self.start(Some(keep), observer)
    }

    fn start(self, keep: Option<Keep>, observer: &mut dyn Observer) -> Result<Results> {
        Session::new(&self.scene, self.built, keep, self.setup, None)?.complete(observer)
    }
}

/// A run that was killed, interrupted or ended at an overlap, ready to continue.
#[derive(Debug)]
pub struct Resumed {
    prepared: Prepared,
    /// Folder of the results, if any.
    target: Option<PathBuf>,
    saved: Checkpoint,
}

/// Reads the last checkpoint of a folder, `DIR` or `DIR.unfinished`, and builds its scene. The results will
/// be in `DIR`.
///
/// # Errors
/// A checkpoint that cannot be used: damaged, of another version, or of files that have changed.
pub fn resume(target: &Path) -> Result<Resumed> {
    resume_on(target, None)
}

/// Resumes as one rank of several; their number may differ from that of the run that wrote the checkpoint.
///
/// # Errors
/// Errors of [`resume`]; checkpoints that differ between ranks.
pub fn resume_on(target: &Path, communicator: Option<Arc<dyn Communicator>>) -> Result<Resumed> {
    let target = Folder::target(target);
    let saved = together(communicator.as_ref(), last_checkpoint(&target))?;
    Resumed::from_checkpoint(saved, Some(target), communicator)
}

/// Reads the last checkpoint of a folder and refuses one that does not fit.
fn last_checkpoint(target: &Path) -> Result<Checkpoint> {
    let place = Folder::left_behind(target);
    let saved = Checkpoint::read(&place)?;
    let refuse = |reason: String| {
        Err(Error::Checkpoint {
            path: place.join(mark::CHECKPOINT),
            reason,
        })
    };
    if place != target && target.exists() {
        return refuse(format!(
            "belongs to a run that is to replace {}, which exists; move that away, then resume",
            target.display()
        ));
    }
    // Another version may compute other bits, so that the run would not be continued but changed.
    if saved.version != env!("CARGO_PKG_VERSION") {
        return refuse(format!(
            "was written by version {}, this is {}; resume it with the version that wrote it",
            saved.version,
            env!("CARGO_PKG_VERSION")
        ));
    }
    Ok(saved)
}

impl Results {
    /// Prepares to continue a run that its observer or a crack ended. The results have the same bits as
    /// without the stop and include the values recorded so far. The scene is built again.
    ///
    /// # Errors
    /// A run without remaining steps, files of the scene that have changed, a checkpoint in a folder that
    /// cannot be used.
    pub fn resume(self) -> Result<Resumed> {
        match (self.remaining, &self.folder) {
            (Some(remaining), _) => Resumed::from_checkpoint(*remaining, None, None),
            (None, Some(folder)) if self.end.can_resume() => resume(folder),
            _ => Err(key(
                "time",
                "all steps are made; prepare the scene with a later end",
            )),
        }
    }
}

impl Resumed {
    /// Builds the scene of a checkpoint.
    fn from_checkpoint(
        saved: Checkpoint,
        target: Option<PathBuf>,
        communicator: Option<Arc<dyn Communicator>>,
    ) -> Result<Self> {
        let begin = Instant::now();
        // The checkpoint holds the text of the scene: changes to the scene file since then do not count.
        let mut scene = together(communicator.as_ref(), saved.origin.scene())?;
        if let Some(c) = &communicator {
            scene = scene.on_ranks(c.clone())?;
            let step = saved.snapshot.step as u64;
            // Ranks on different file systems may hold checkpoints of different steps.
            scene.ranks().agree("the checkpoint", step)?;
        }
        let built = Prepared::new(&scene, &mut |_, _, _| ());
        let mut prepared = together(communicator.as_ref(), built)?;
        prepared.setup = begin.elapsed().as_secs_f64();
        Ok(Self {
            prepared,
            target,
            saved,
        })
    }

    /// Makes the remaining steps. A run with a folder writes its results there.
    ///
    /// # Errors
    /// Errors of [`Prepared::run_into`].
    pub fn run(self, observer: &mut dyn Observer) -> Result<Results> {
        let Self {
            prepared,
            target,
            saved,
        } = self;
        let ranks = prepared.scene.ranks();
        let keep = target.map(|t| {
            let origin = saved.origin.clone();
            ranks.together(Keep::reopen(&t, origin, ranks.leads()))
        });
        let keep = keep.transpose()?;
        let session = Session::new(&prepared.scene, prepared.built, keep, prepared.setup, Some(saved))?;
        session.complete(observer)
    }
}

//! A scene that is ready to run, its run in memory or into a folder, and how one that was stopped goes on.

mod folder;
mod session;
mod statics;
mod summary;

pub(crate) use folder::Keep;
pub use folder::RunFolder;
pub(crate) use session::Session;
pub use statics::LoadStep;

use crate::checkpoint::{self, Checkpoint};
use crate::error::{Error, Result, key};
use crate::output::curves::CurveLine;
use crate::output::{Folder, fragments::Piece, summary::Summary};
use crate::ranks::{Ranks, together};
use crate::recorder::Table;
use crate::scene::Scene;
use crate::setup::{self, Built};
use crate::wake::{self, Asleep, Stage};
use arlequin::core::ranks::Communicator;
use arlequin::core::{Coupled, Subdomain};
use arlequin::dem_beam::fracture::SharedLog;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What hears of a run while it goes on, and may end it.
pub trait Observer {
    /// Something a user should know, once, the moment it is known.
    fn warning(&mut self, _text: &str) {}
    /// A step is made, one of so many; `Break` ends the run here, and a kept one can go on later.
    fn step(&mut self, _run: &Coupled<f64>, _planned: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
    /// No more steps follow, or none before a sleeping model wakes; results are put together.
    fn stepped(&mut self) {}
    /// The scene asks for plots of the tables (probes, energy, effects), in a folder that is not finished
    /// before they are there.
    ///
    /// # Errors
    /// What cannot be drawn or written.
    fn plot(&mut self, _folder: &Path, _title: &str, _tables: [&Table; 3]) -> Result<()> {
        Ok(())
    }
    /// The same for one probe over another; called after [`Self::plot`].
    ///
    /// # Errors
    /// What cannot be drawn or written.
    fn plot_curve(&mut self, _folder: &Path, _title: &str, _curve: &CurveLine) -> Result<()> {
        Ok(())
    }
}

/// Hears nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Why the steps ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// All are made.
    Complete,
    /// The observer ended them.
    Interrupted,
    /// A sleeping model wakes.
    Woken,
    /// A crack ran into an overlap, and the scene ends there.
    IntoOverlap,
}

impl End {
    /// Whether [`resume`] can go on from there.
    fn goes_on(self) -> bool {
        matches!(self, Self::Interrupted | Self::IntoOverlap)
    }
}

/// What was recorded of a run.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// The run in figures, as `summary.json` has them.
    pub summary: Summary,
    /// Probes over time; names with unit.
    pub probes: Table,
    /// Energy, works and momenta over time \[J, kg m/s\].
    pub energy: Table,
    /// Figures of the effects over time.
    pub effects: Table,
    /// One probe over another.
    pub curves: Vec<CurveLine>,
    /// Pieces into which bodies fell, at the instants of the frames; of bodies in parts on the first rank
    /// alone.
    pub fragments: Vec<Piece>,
}

/// What a run leaves.
#[derive(Debug)]
pub struct Results {
    /// What was recorded.
    pub recorded: Recorded,
    /// The same of the time in which a model slept, if it woke.
    pub asleep: Option<Recorded>,
    /// The run in its last state: displacements, velocities, multipliers.
    pub run: Coupled<f64>,
    /// What broke, by model, where bonds can.
    pub breaks: Vec<Option<SharedLog>>,
    /// Why the steps ended.
    pub end: End,
    /// Steps that were planned.
    pub planned: usize,
    /// Folder of the results, if they are kept.
    pub folder: Option<PathBuf>,
    /// What the steps that are left need, if there are any and no folder has it.
    rest: Option<Box<Checkpoint>>,
}

impl Results {
    /// The run as it can go on after its observer, or a crack that ran into an overlap, ended it: with the
    /// same bits as one that was not stopped, and with what was recorded so far. The scene is built anew.
    ///
    /// # Errors
    /// A run that has no steps left; files of the scene that changed since; a checkpoint in a folder that
    /// cannot be used.
    pub fn resume(self) -> Result<Resumed> {
        match (self.rest, &self.folder) {
            (Some(rest), _) => Resumed::of(*rest, None, self.asleep, None),
            (None, Some(folder)) if self.end.goes_on() => resume(folder),
            _ => Err(key(
                "time",
                "all steps are made; prepare the scene with a later end",
            )),
        }
    }

    /// The run in figures.
    pub fn summary(&self) -> &Summary {
        &self.recorded.summary
    }

    /// Times \[s\] and values of a probe.
    pub fn probe(&self, name: &str) -> Option<(&[f64], &[f64])> {
        let k = self.summary().probes.keys().position(|n| n == name)?;
        Some((&self.recorded.probes.times, &self.recorded.probes.columns[k]))
    }

    /// A model in its last state.
    pub fn model(&self, name: &str) -> Option<&Subdomain<f64>> {
        let all = self.run.subdomains();
        all.iter().find(|s| s.model().name() == name)
    }
}

/// A scene with everything built, ready to run.
#[derive(Debug)]
pub struct Prepared {
    pub(crate) scene: Scene,
    pub(crate) built: Built,
    /// The scene as long as a model sleeps.
    pub(crate) asleep: Option<Asleep>,
    /// Seconds the set-up took.
    pub(crate) setup: f64,
}

impl Prepared {
    pub(crate) fn new(scene: &Scene, tell: &mut dyn FnMut(&str)) -> Result<Self> {
        let begin = Instant::now();
        let (asleep, built) = match &scene.spec().wake {
            None => {
                let built = setup::build_from(scene.spec(), scene.folder(), None, scene.ranks(), tell)?;
                (None, built)
            }
            Some(wake) => {
                let (asleep, built) = wake::prepare(scene, wake, tell)?;
                (Some(asleep), built)
            }
        };
        Ok(Self {
            scene: scene.clone(),
            built,
            asleep,
            setup: begin.elapsed().as_secs_f64(),
        })
    }

    /// The coupled models before the first step; as they are once all models are awake.
    pub fn coupled(&self) -> &Coupled<f64> {
        &self.built.run
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Everything that was built; as it is once all models are awake.
    pub fn built(&self) -> &Built {
        &self.built
    }

    /// What a user should know before the first step.
    pub fn warnings(&self) -> &[String] {
        &self.built.warnings
    }

    /// Makes all steps and returns what they gave; writes nothing.
    ///
    /// # Errors
    /// Failures of the run: results that are not finite, energy that grows.
    pub fn run(self, observer: &mut dyn Observer) -> Result<Results> {
        self.start(None, observer)
    }

    /// The same, and writes the results into a folder that appears when the run has ended.
    ///
    /// # Errors
    /// As those of [`Self::run`], with what is kept; files that cannot be written.
    pub fn run_into(self, folder: RunFolder, observer: &mut dyn Observer) -> Result<Results> {
        let keep = self.scene.ranks().together(Keep::begin(folder))?;
        self.start(Some(keep), observer)
    }

    fn start(self, keep: Option<Keep>, observer: &mut dyn Observer) -> Result<Results> {
        match self.asleep {
            Some(asleep) => {
                // It is built anew from the state at waking; until then its memory is free.
                drop(self.built);
                wake::run(&self.scene, asleep, keep, self.setup, None, observer)
            }
            None => Session::new(&self.scene, self.built, keep, self.setup, None)?.complete(observer),
        }
    }
}

/// A run that was killed, interrupted or ended at an overlap, ready to go on.
#[derive(Debug)]
pub struct Resumed {
    prepared: Prepared,
    /// Folder of its results, if they are kept.
    target: Option<PathBuf>,
    saved: Checkpoint,
    /// What was recorded while a model slept, where no folder has it.
    slept: Option<Recorded>,
}

/// Reads the last checkpoint of a folder and builds its scene.
///
/// # Errors
/// A checkpoint that cannot be used: damaged, of another version, of files that have changed since.
pub fn resume(target: &Path) -> Result<Resumed> {
    resume_on(target, None)
}

/// The same as one rank of several, whatever the number of ranks that wrote the checkpoint.
///
/// # Errors
/// Those of [`resume`], and checkpoints that differ between ranks.
pub fn resume_on(target: &Path, communicator: Option<Arc<dyn Communicator>>) -> Result<Resumed> {
    let saved = together(communicator.as_ref(), left(target))?;
    Resumed::of(saved, Some(target.to_owned()), None, communicator)
}

/// The last checkpoint of a folder.
fn left(target: &Path) -> Result<Checkpoint> {
    let place = Folder::left_behind(target);
    let saved = Checkpoint::read(&place)?;
    let refuse = |reason: String| {
        Err(Error::Checkpoint {
            path: place.join(checkpoint::NAME),
            reason,
        })
    };
    if place != target && target.exists() {
        return refuse(format!(
            "belongs to a run that is to replace {}, which exists; move that away, then resume",
            target.display()
        ));
    }
    if saved.version != env!("CARGO_PKG_VERSION") {
        return refuse(format!(
            "was written by version {}, this is {}; resume it with the version that wrote it",
            saved.version,
            env!("CARGO_PKG_VERSION")
        ));
    }
    Ok(saved)
}

/// A scene from where a model woke.
fn awake(scene: &Scene, start: &setup::Start) -> Result<Prepared> {
    Ok(Prepared {
        built: setup::build_from(
            scene.spec(),
            scene.folder(),
            Some(start),
            &Ranks::default(),
            &mut |_| (),
        )?,
        asleep: None,
        setup: 0.0,
        scene: scene.clone(),
    })
}

impl Resumed {
    /// Builds the scene of a checkpoint.
    fn of(
        saved: Checkpoint,
        target: Option<PathBuf>,
        slept: Option<Recorded>,
        communicator: Option<Arc<dyn Communicator>>,
    ) -> Result<Self> {
        let begin = Instant::now();
        let mut scene = together(communicator.as_ref(), saved.origin.scene())?;
        if let Some(c) = &communicator {
            scene = scene.on_ranks(c.clone())?;
            let step = saved.snapshot.step as u64;
            scene.ranks().agree("the checkpoint", step)?;
        }
        let made = match &saved.wake {
            Some(Stage::Awake { start, .. }) => awake(&scene, start),
            _ => Prepared::new(&scene, &mut |_| ()),
        };
        let mut prepared = together(communicator.as_ref(), made)?;
        prepared.setup = begin.elapsed().as_secs_f64();
        Ok(Self {
            prepared,
            target,
            saved,
            slept,
        })
    }

    /// Makes the steps that are left; a run in a folder writes its results there.
    ///
    /// # Errors
    /// As those of [`Prepared::run_into`].
    pub fn run(self, observer: &mut dyn Observer) -> Result<Results> {
        let Self {
            prepared,
            target,
            mut saved,
            slept,
        } = self;
        let ranks = prepared.scene.ranks();
        let keep = target.map(|t| {
            let origin = saved.origin.clone();
            ranks.together(Keep::reopen(&t, origin, ranks.leads()))
        });
        let keep = keep.transpose()?;
        let stage = saved.wake.take();
        let setup = prepared.setup;
        match (prepared.asleep, stage) {
            (Some(mut asleep), Some(stage)) => {
                asleep.go_on(&stage);
                if let Some(keep) = &keep {
                    keep.take_back(wake::ASLEEP)?;
                }
                wake::run(&prepared.scene, asleep, keep, setup, Some(saved), observer)
            }
            (_, stage) => {
                let session = Session::new(&prepared.scene, prepared.built, keep, setup, Some(saved))?;
                let done = match stage {
                    Some(Stage::Awake { start, report }) => wake::finish(session, start, *report, observer),
                    _ => session.complete(observer),
                };
                done.map(|r| Results { asleep: slept, ..r })
            }
        }
    }
}

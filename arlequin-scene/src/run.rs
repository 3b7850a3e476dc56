//! `arlequin run` and `arlequin resume`.

use crate::checkpoint::{self, Checkpoint, Origin};
use crate::crossing::{self, Crossing};
use crate::error::{Error, Result};
use crate::output::packing::PackingLine;
use crate::output::summary::{self, Energy, Summary, WakeReport, WallSeconds};
use crate::output::{Folder, Frames, Place, put, tables};
use crate::recorder::{self, PhaseClock, Recorder};
use crate::scene::{Scene, Source};
use crate::setup::{self, Bounds, Built, Strangers};
use crate::wake::{self, Stage};
use arlequin::core::Coupled;
use arlequin::dem_beam::fracture::SharedLog;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a caller hears of a run, and how it ends one.
pub trait Listener {
    /// Everything is built and the first file is about to be written: from here on an interruption keeps results.
    ///
    /// # Errors
    /// Whatever keeps the caller from listening.
    fn begins(&mut self) -> Result<()> {
        Ok(())
    }
    /// Something a user should know, once, the moment it is known.
    fn warning(&mut self, _text: &str) {}
    /// So many of all steps are made.
    fn step(&mut self, _made: usize, _of: usize) {}
    /// All steps of this run, or of its first part, are made.
    fn stepped(&mut self) {}
    /// Whether to end the run after this step; it can go on later.
    fn stops(&self) -> bool {
        false
    }
}

/// Hears nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Deaf;

impl Listener for Deaf {}

/// What a run leaves.
#[derive(Debug, Clone)]
pub struct Finished {
    /// What there is to say of it.
    pub summary: Summary,
    /// The same as `summary.json` has it.
    pub json: String,
    /// Folder of the results.
    pub folder: PathBuf,
    /// Steps that were planned.
    pub planned: usize,
    /// Why the steps ended.
    pub end: End,
}

/// What the operations on a scene start from.
#[derive(Debug)]
pub struct Input<'a> {
    /// Its file.
    pub source: &'a Source,
    /// The scene, changes included.
    pub scene: Scene,
    /// The changes, as given.
    pub set: &'a [String],
}

/// Runs a scene and writes its results.
///
/// # Errors
/// What is wrong with the scene, before the first file is written; failures of the run, with what is kept.
pub fn run(
    input: &Input<'_>,
    out: Option<&Path>,
    force: bool,
    listener: &mut dyn Listener,
) -> Result<Finished> {
    let begin = Instant::now();
    let target = out.map_or_else(|| default_folder(input), Path::to_owned);
    let place = Place::new(&target, force, &inputs(input)?);
    place.check()?;
    if let Some(asleep) = &input.scene.wake {
        return wake::run(input, asleep, place, listener);
    }
    let origin = Origin::of(input.source, input.set)?;
    let built = setup::build(&input.scene, input.source.folder())?;
    listener.begins()?;
    Session::new(input, built, Folder::begin(place)?, origin)?.whole(begin, listener)
}

/// Files a run reads.
fn inputs(input: &Input<'_>) -> Result<Vec<PathBuf>> {
    let folder = input.source.folder();
    let named = input.source.files(input.set)?;
    let named = named.iter().map(|f| folder.join(f));
    Ok(std::iter::once(input.source.path.clone()).chain(named).collect())
}

/// Goes on with the run of a folder from its last checkpoint.
///
/// # Errors
/// A checkpoint that cannot be used; failures of the run.
pub fn resume(target: &Path, listener: &mut dyn Listener) -> Result<Finished> {
    let begin = Instant::now();
    let place = Folder::left_behind(target);
    let saved = Checkpoint::read(&place)?;
    if place != target && target.exists() {
        return Err(Error::Checkpoint {
            path: place.join(checkpoint::NAME),
            reason: format!(
                "belongs to a run that is to replace {}, which exists; move that away, then resume",
                target.display()
            ),
        });
    }
    if saved.version != env!("CARGO_PKG_VERSION") {
        return Err(Error::Checkpoint {
            path: place.join(checkpoint::NAME),
            reason: format!(
                "was written by version {}, this is {}; resume it with the version that wrote it",
                saved.version,
                env!("CARGO_PKG_VERSION")
            ),
        });
    }
    let (source, set) = (saved.origin.source()?, saved.origin.set.clone());
    let input = Input {
        scene: source.scene(&saved.origin.set)?,
        source: &source,
        set: &set,
    };
    if let (Some(stage), Some(wake)) = (saved.wake.clone(), &input.scene.wake) {
        return wake::resume(&input, wake, target, saved, stage, listener);
    }
    let built = setup::build(&input.scene, source.folder())?;
    listener.begins()?;
    let origin = saved.origin.clone();
    Session::new(&input, built, Folder::reopen(target)?, origin)?.rest(saved, begin, listener)
}

/// Why the steps ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// All are made.
    Complete,
    /// The user ended them.
    Interrupted,
    /// A sleeping model wakes.
    Woken,
    /// A bond broke in an overlap, and the scene ends there.
    IntoOverlap,
}

impl End {
    /// Whether `resume` can go on from there.
    fn goes_on(self) -> bool {
        matches!(self, Self::Interrupted | Self::IntoOverlap)
    }
}

/// How a run ended.
enum Status {
    /// By plan or by its user.
    Ended(End),
    /// By an error, in words.
    Failed(String),
}

impl Status {
    fn name(&self) -> &'static str {
        match self {
            Self::Ended(End::Complete) => "complete",
            Self::Ended(End::Interrupted) => "interrupted",
            Self::Ended(End::Woken) => "woken",
            Self::Ended(End::IntoOverlap) => "stopped-at-overlap",
            Self::Failed(_) => "failed",
        }
    }
}

/// A run with everything that records it.
pub struct Session<'a> {
    input: &'a Input<'a>,
    run: Coupled<f64>,
    steps: usize,
    recorder: Recorder,
    clock: PhaseClock,
    folder: Folder,
    origin: Origin,
    setup: f64,
    resumed_at: Option<usize>,
    /// How far a scene with `[wake]` has come, for the checkpoints.
    pub stage: Option<Stage>,
    breaks: Vec<Option<SharedLog>>,
    strangers: Strangers,
    packings: Vec<Option<PackingLine>>,
    bounds: Bounds,
}

impl<'a> Session<'a> {
    /// Records the state before the first step.
    pub fn new(input: &'a Input<'a>, built: Built, folder: Folder, origin: Origin) -> Result<Self> {
        let settings = &input.scene.output;
        let vtu = folder.subfolder("vtu")?;
        let breaks = built.drawn.iter().map(|d| d.breaks.clone()).collect();
        let packings = built.drawn.iter().map(|d| d.packing.clone()).collect();
        let frames = Frames::new(vtu, &settings.fields, &built.run, built.drawn, built.mediators);
        Ok(Self {
            recorder: Recorder::new(
                &built.run,
                built.probes,
                frames,
                settings.probe_every,
                built.frame_every,
                built.warnings,
            )?,
            input,
            run: built.run,
            steps: built.steps,
            clock: PhaseClock::new(),
            folder,
            origin,
            setup: 0.0,
            resumed_at: None,
            stage: None,
            breaks,
            strangers: built.strangers,
            packings,
            bounds: built.bounds,
        })
    }

    /// Says a warning the moment it is known, once, and keeps it for the summary.
    pub fn warn(&mut self, text: String, listener: &mut dyn Listener) {
        if self.recorder.warn(text.clone()) {
            listener.warning(&text);
        }
    }

    /// Ends the set-up that began then.
    pub fn begun(&mut self, then: Instant) {
        self.setup = then.elapsed().as_secs_f64();
    }

    /// The run.
    pub fn coupled(&self) -> &Coupled<f64> {
        &self.run
    }

    /// Makes all steps of a run whose set-up began then, and writes the results.
    fn whole(mut self, begin: Instant, listener: &mut dyn Listener) -> Result<Finished> {
        self.begun(begin);
        self.complete(listener)
    }

    /// Goes on from a checkpoint likewise.
    fn rest(mut self, saved: Checkpoint, begin: Instant, listener: &mut dyn Listener) -> Result<Finished> {
        self.restore(saved)?;
        self.whole(begin, listener)
    }

    /// Takes the state of a checkpoint.
    pub fn restore(&mut self, saved: Checkpoint) -> Result<()> {
        let restored = self.run.restore(&saved.snapshot);
        restored.map_err(|e| Error::Checkpoint {
            path: self.folder.path().join(checkpoint::NAME),
            reason: format!("does not fit the run that its scene gives: {e}"),
        })?;
        self.recorder.resume(saved.records)?;
        self.resumed_at = Some(saved.snapshot.step);
        Ok(())
    }

    /// Makes the steps that are left and writes the results.
    fn complete(mut self, listener: &mut dyn Listener) -> Result<Finished> {
        let end = self.advance(listener, &mut |_, _| false);
        self.conclude(end, None)
    }

    /// Writes the results of the steps made, however they ended, and ends the folder.
    pub fn conclude(mut self, end: Result<End>, wake: Option<WakeReport>) -> Result<Finished> {
        let written = end.and_then(|end| {
            if end.goes_on() {
                self.save()?;
            }
            Ok((end, self.write_results(end, wake.clone())?))
        });
        let (end, (summary, text)) = match written {
            Ok(done) => done,
            Err(e) => return Err(self.salvage(e, wake)),
        };
        let place = self.folder.finish(false)?;
        if end == End::Complete {
            // Only now: killed in between, the run would have neither results nor a checkpoint.
            checkpoint::remove(&place)?;
        }
        Ok(Finished {
            summary,
            json: text,
            folder: place,
            planned: self.steps,
            end,
        })
    }

    /// Writes the results of the steps made and moves them into a folder inside; the folder is free for another run.
    pub fn put_aside(mut self, name: &str) -> Result<Folder> {
        if let Err(e) = self.write_results(End::Woken, None) {
            return Err(self.salvage(e, None));
        }
        match self.folder.put_aside(name) {
            Ok(()) => Ok(self.folder),
            Err(e) => Err(self.folder.keep(e)),
        }
    }

    /// Keeps what a run computed before it failed: every file that can still be written. A run that made no step has
    /// nothing.
    fn salvage(mut self, error: Error, wake: Option<WakeReport>) -> Error {
        if self.run.steps() == 0 {
            return error;
        }
        self.clock.enter(None);
        let path = self.folder.path().to_owned();
        let mut tries = vec![
            tables::write(&path, &self.recorder),
            tables::breaks(&path, &self.run, &self.breaks),
            self.recorder.frames.finish(&path.join("results.pvd")),
        ];
        if self.input.scene.output.plots {
            let plots = self.folder.subfolder("plots");
            tries.push(plots.and_then(|p| tables::draw(&p, &self.recorder, title(self.input))));
        }
        let mut summary = self.summary(Status::Failed(error.to_string()), 0.0);
        summary.wake = wake;
        tries.push(self.write_summary(&summary).map(|_| ()));
        let lost: Vec<String> = tries
            .into_iter()
            .filter_map(|t| Some(t.err()?.to_string()))
            .collect();
        let mut what = format!("the {} steps before are kept", self.run.steps());
        if !lost.is_empty() {
            what += &format!(", but for what failed too ({})", lost.join("; "));
        }
        match self.folder.finish(true) {
            Ok(place) => error.kept(what, &place),
            Err(e) => Error::Kept {
                source: Box::new(error),
                what: format!("{what}; {e};"),
                place: path,
            },
        }
    }

    fn write_results(&mut self, end: End, wake: Option<WakeReport>) -> Result<(Summary, String)> {
        let after = Instant::now();
        self.recorder.finish(&self.run)?;
        tables::write(self.folder.path(), &self.recorder)?;
        tables::breaks(self.folder.path(), &self.run, &self.breaks)?;
        self.recorder
            .frames
            .finish(&self.folder.path().join("results.pvd"))?;
        if self.input.scene.output.plots {
            tables::draw(
                &self.folder.subfolder("plots")?,
                &self.recorder,
                title(self.input),
            )?;
        }
        for w in summary::findings(&self.run, &self.strangers) {
            self.recorder.warn(w);
        }
        let mut summary = self.summary(Status::Ended(end), after.elapsed().as_secs_f64());
        summary.wake = wake;
        let text = self.write_summary(&summary)?;
        Ok((summary, text))
    }

    fn write_summary(&self, summary: &Summary) -> Result<String> {
        let text = serde_json::to_string_pretty(summary).map_err(|e| Error::System {
            what: "writing summary.json",
            message: e.to_string(),
        })?;
        let path = self.folder.path().join("summary.json");
        put(&path, &[text.as_bytes()])?;
        Ok(text)
    }

    /// What there is to say, after so many seconds of writing.
    fn summary(&self, status: Status, writing: f64) -> Summary {
        let [stepping, observing] = self.clock.split();
        let wall = WallSeconds {
            setup: self.setup,
            stepping,
            output: observing + writing,
            phases: self.clock.phases(&self.run),
        };
        let mut summary = summarise(self.input, &self.run, &self.recorder, wall, status);
        summary.resumed_at_step = self.resumed_at;
        summary.models = summary::models(&self.run, &self.packings);
        summary.effect_ledger = summary::effects(&self.run, &self.clock);
        summary.into_overlap = crossing::found(&self.run, &self.breaks);
        summary
    }

    /// Makes the steps until the user or `woken`, which may change the stage, ends them before the last.
    pub fn advance(
        &mut self,
        listener: &mut dyn Listener,
        woken: &mut dyn FnMut(&Coupled<f64>, &mut Option<Stage>) -> bool,
    ) -> Result<End> {
        self.recorder.warnings.iter().for_each(|w| listener.warning(w));
        let every = self.input.scene.output.checkpoint_every;
        let mut end = End::Complete;
        // Once is enough: the state that follows is as odd.
        let mut strange = !self.bounds.watch(&self.run).is_empty();
        let mut crossing = Crossing::since(&self.breaks);
        for made in self.run.steps() + 1..=self.steps {
            let energy = recorder::step(&mut self.run, &mut self.clock)?;
            let drawn = energy.is_some();
            self.recorder.observe(&mut self.run, energy)?;
            if drawn && !strange {
                let odd = self.bounds.watch(&self.run);
                strange = !odd.is_empty();
                odd.into_iter().for_each(|w| self.warn(w, listener));
            }
            listener.step(made, self.steps);
            let (said, ends) = crossing.watch(self.input, &self.run, &self.breaks);
            said.into_iter().for_each(|w| self.warn(w, listener));
            if made == self.steps {
                break;
            }
            if ends {
                end = End::IntoOverlap;
                break;
            }
            if woken(&self.run, &mut self.stage) {
                end = End::Woken;
                break;
            }
            if every.is_some_and(|n| made.is_multiple_of(n)) {
                self.save()?;
            }
            if listener.stops() {
                end = End::Interrupted;
                break;
            }
        }
        listener.stepped();
        self.clock.enter(None);
        Ok(end)
    }

    /// Writes a checkpoint.
    pub fn save(&self) -> Result<()> {
        Checkpoint {
            version: env!("CARGO_PKG_VERSION").into(),
            origin: self.origin.clone(),
            snapshot: self.run.snapshot(),
            records: self.recorder.records(),
            wake: self.stage.clone(),
        }
        .write(self.folder.path())
    }
}

fn default_folder(input: &Input<'_>) -> PathBuf {
    let stem = input.source.path.file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

fn title<'a>(input: &'a Input<'_>) -> &'a str {
    input.scene.title.as_deref().unwrap_or_default()
}

fn summarise(
    input: &Input<'_>,
    run: &Coupled<f64>,
    r: &Recorder,
    wall_seconds: WallSeconds,
    status: Status,
) -> Summary {
    let plan = run.plan();
    Summary {
        scene: input.source.path.display().to_string(),
        title: input.scene.title.clone(),
        status: status.name(),
        error: match status {
            Status::Failed(words) => Some(words),
            Status::Ended(_) => None,
        },
        version: env!("CARGO_PKG_VERSION"),
        resumed_at_step: None,
        wake: None,
        into_overlap: Vec::new(),
        set: input.set.to_vec(),
        threads: rayon::current_num_threads(),
        models: Vec::new(),
        dt: plan.dt,
        critical_dt: plan.critical_dt,
        steps: run.steps(),
        time: run.time(),
        frames: r.frames.count(),
        wall_seconds,
        peak_bytes: summary::process_bytes("VmHWM:"),
        energy: Energy {
            initial: r.initial_energy,
            last: run.energy(),
            h_drift_max: run.drift(),
            created_max: run.top_created(),
            start_loss: run.start_loss(),
            ledger: run.works().into_iter().map(|w| (w.name, w.work)).collect(),
        },
        momentum: summary::momentum(run),
        interface: summary::interfaces(run, &r.residuals),
        effects: plan.effects,
        effect_ledger: Vec::new(),
        probes: summary::probes(r),
        warnings: r.warnings.clone(),
    }
}

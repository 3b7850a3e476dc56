//! Runs a scene with `[wake]`: a model sleeps until the strain or stress of the model in its place reaches a
//! limit.

mod hand_over;
mod sleep;
mod watch;

use super::checkpoint::{Checkpoint, Stage};
use super::folder::Keep;
use super::results::{End, Observer, Results};
use super::session::Session;
use crate::error::{Result, key};
use crate::output::mark;
use crate::output::summary::{Momentum, WakeReport};
use crate::ranks::Ranks;
use crate::scene::Scene;
use crate::setup::{self, Built, LoweredScene, Start, model_index};
use crate::spec::Wake;
use arlequin::core::Coupled;
use hand_over::HandOver;
use std::time::Instant;
use watch::Watch;

/// Subfolder with the results of the time in which the model slept.
pub(crate) const ASLEEP: &str = mark::PART;

/// The sleeping scene, ready to run, and the transfer from it to the full scene.
#[derive(Debug)]
pub(crate) struct Asleep {
    pub(crate) scene: Scene,
    pub(crate) built: Built,
    watch: Watch,
    hand_over: HandOver,
}

/// Prepares the sleeping scene. Also builds the full scene, so that its errors show before the first step.
pub(crate) fn prepare(
    scene: &Scene,
    wake: &Wake,
    report: &mut dyn FnMut(&str, usize, usize),
) -> Result<(Asleep, Built)> {
    let asleep = sleep::scene(scene, wake)?;
    let awake = build(scene, None, report)?;
    let spec = asleep.spec();
    let built = build(&asleep, None, report)?;
    let carrier = model_index("wake.by", &wake.by, spec)?;
    let watch = Watch::new(wake, carrier, spec.model[&wake.by].kind, &built.models[carrier])?;
    let hand_over = HandOver::new(wake, &awake, &built.run, &built.models)?;
    let asleep = Asleep {
        scene: asleep,
        built,
        watch,
        hand_over,
    };
    Ok((asleep, awake))
}

/// Builds a scene at its start, or from the state in which a model woke. The models are whole on every rank.
pub(super) fn build(
    scene: &Scene,
    start: Option<&Start>,
    report: &mut dyn FnMut(&str, usize, usize),
) -> Result<Built> {
    setup::build_from(scene.spec(), scene.folder(), start, &Ranks::default(), report)
}

impl Asleep {
    /// Continues the watch of a checkpoint.
    pub(crate) fn restore_watch(&mut self, stage: &Stage) {
        if let Stage::Asleep { highest, place } = stage {
            self.watch.highest = (*highest, (*place).into());
        }
    }
}

impl LoweredScene {
    /// Refuses a scene with `[wake]`, for commands that do not support it.
    ///
    /// # Errors
    /// A scene with `[wake]`.
    pub fn refuse_wake(&self, command: &str) -> Result<()> {
        match &self.wake {
            None => Ok(()),
            Some(_) => Err(key(
                "wake",
                format!("'arlequin {command}' runs no scene whose models change; remove [wake]"),
            )),
        }
    }
}

/// Runs the sleeping scene from its start or from a checkpoint, and then the full scene if the model wakes.
pub(crate) fn run(
    scene: &Scene,
    asleep: Asleep,
    keep: Option<Keep>,
    setup: f64,
    saved: Option<Checkpoint>,
    observer: &mut dyn Observer,
) -> Result<Results> {
    let Some(wake) = &scene.spec().wake else {
        return Err(key("wake", "is gone; it is what a model sleeps by"));
    };
    let mut watch = asleep.watch;
    let mut session = Session::new(&asleep.scene, asleep.built, keep, setup, saved)?;
    session.stage = Some(watch.stage());
    let end = session.advance(observer, &mut |run, stage| {
        let woken = watch.look(run);
        *stage = Some(watch.stage());
        woken
    });
    let mut report = sleeping_report(wake, &watch);
    if !matches!(end, Ok(End::Woken)) {
        return session.conclude(end, Some(report), observer);
    }
    let begin = Instant::now();
    // Builds the full scene before files are moved: if this fails, the results so far are complete.
    let next = asleep.hand_over.start(session.coupled());
    let next = next.and_then(|s| Ok((build(scene, Some(&s), &mut |_, _, _| ())?, s)));
    let (built, start) = match next {
        Ok(next) => next,
        Err(e) => return session.conclude(Err(e), Some(report), observer),
    };
    report.record_waking(session.coupled());
    let (slept, keep) = session.put_aside(ASLEEP, observer)?;
    report.record_awake(&built.run);
    let session = Session::new(scene, built, keep, begin.elapsed().as_secs_f64(), None)?;
    let mut done = finish(session, start, report, observer)?;
    done.asleep = Some(slept);
    Ok(done)
}

/// Makes the remaining steps after the model woke.
pub(crate) fn finish(
    mut session: Session<'_>,
    start: Start,
    report: WakeReport,
    observer: &mut dyn Observer,
) -> Result<Results> {
    session.stage = Some(Stage::Awake {
        start,
        report: Box::new(report.clone()),
    });
    if session.checkpoints() {
        // Replaces the last checkpoint of the sleeping scene, whose results have been put aside.
        session.save()?;
    }
    let end = session.advance(observer, &mut |_, _| false);
    session.conclude(end, Some(report), observer)
}

impl WakeReport {
    /// Records the state in which the model wakes.
    fn record_waking(&mut self, asleep: &Coupled<f64>) {
        self.woken = true;
        self.time = Some(asleep.time());
        self.step = Some(asleep.steps());
        self.energy_before = Some(asleep.energy());
        self.momentum_before = Some(Momentum::from_run(asleep));
    }

    /// Records the state in which the full scene starts.
    fn record_awake(&mut self, awake: &Coupled<f64>) {
        self.energy_after = Some(awake.energy());
        self.jump = self.energy_after.zip(self.energy_before).map(|(a, b)| a - b);
        self.momentum_after = Some(Momentum::from_run(awake));
    }
}

/// Returns the report before the model wakes.
fn sleeping_report(wake: &Wake, watch: &Watch) -> WakeReport {
    let (value, place) = watch.highest;
    WakeReport {
        woken: false,
        model: wake.model.clone(),
        by: wake.by.clone(),
        criterion: watch.criterion().to_owned(),
        limit: watch.limit(),
        value: value.is_finite().then_some(value),
        place: value.is_finite().then_some(place.coords.into()),
        ..WakeReport::default()
    }
}

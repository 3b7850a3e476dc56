//! Runs a scene with `[wake]`: a model sleeps until the one that stands in for it is strained enough.

mod hand_over;
mod sleep;
mod watch;

use crate::checkpoint::{Checkpoint, Origin};
use crate::error::{Result, key};
use crate::output::summary::{Momentum, WakeReport};
use crate::output::{Folder, Place, mark};
use crate::run::{End, Finished, Input, Listener, Session};
use crate::scene::{Scene, Wake};
use crate::setup::{self, Built, Start, model_index};
use hand_over::HandOver;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;
use watch::Watch;

/// Folder of what was recorded while the model slept.
const ASLEEP: &str = mark::PART;

/// The sleeping scene, ready to run, and what leads from there to the scene as given.
struct Bed {
    scene: Scene,
    built: Built,
    watch: Watch,
    hand_over: HandOver,
}

/// Prepares the sleep. The scene as given is built as well, so that what is wrong with it is found before the first step.
fn bed(input: &Input<'_>, wake: &Wake) -> Result<(Bed, Built)> {
    let scene = sleep::scene(input, wake)?;
    let folder = input.source.folder();
    let awake = setup::build(&input.scene, folder)?;
    let built = setup::build(&scene, folder)?;
    let carrier = model_index("wake.by", &wake.by, &scene)?;
    let watch = Watch::new(wake, carrier, scene.model[&wake.by].kind, &built.drawn[carrier])?;
    let hand_over = HandOver::new(wake, &awake, &built.run, &built.drawn)?;
    let bed = Bed {
        scene,
        built,
        watch,
        hand_over,
    };
    Ok((bed, awake))
}

/// The sleeping scene and both builds, for `check`.
pub fn both(input: &Input<'_>, wake: &Wake) -> Result<(Scene, Built, Built)> {
    let (bed, awake) = bed(input, wake)?;
    Ok((bed.scene, bed.built, awake))
}

/// Refuses a scene with `[wake]` where a command does not know it.
pub fn refuse(scene: &Scene, command: &str) -> Result<()> {
    match &scene.wake {
        None => Ok(()),
        Some(_) => Err(key(
            "wake",
            format!("'arlequin {command}' runs no scene whose models change; remove [wake]"),
        )),
    }
}

/// How far a scene with `[wake]` has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Stage {
    /// The model sleeps.
    Asleep {
        /// Largest value seen.
        highest: f64,
        /// Where \[m\].
        place: [f64; 3],
    },
    /// It woke.
    Awake {
        /// The state handed over.
        start: Start,
        /// What is known of the waking.
        report: Box<WakeReport>,
    },
}

/// A scene on its way through both parts.
struct Way<'a> {
    input: &'a Input<'a>,
    wake: &'a Wake,
    origin: Origin,
    listener: &'a mut dyn Listener,
}

/// Runs both parts of the scene.
pub fn run(input: &Input<'_>, wake: &Wake, place: Place, listener: &mut dyn Listener) -> Result<Finished> {
    let begin = Instant::now();
    let origin = Origin::of(input.source, input.set)?;
    let (bed, awake) = bed(input, wake)?;
    // It is built anew from the state at waking; until then its memory is free.
    drop(awake);
    listener.begins()?;
    let folder = Folder::begin(place)?;
    let way = Way {
        input,
        wake,
        origin,
        listener,
    };
    way.sleep(bed, folder, None, begin)
}

/// Goes on with a run that was killed or interrupted, asleep or awake.
pub fn resume(
    input: &Input<'_>,
    wake: &Wake,
    target: &Path,
    saved: Checkpoint,
    stage: Stage,
    listener: &mut dyn Listener,
) -> Result<Finished> {
    let begin = Instant::now();
    let way = Way {
        input,
        wake,
        origin: saved.origin.clone(),
        listener,
    };
    match stage {
        Stage::Asleep { highest, place } => {
            let (mut bed, awake) = bed(input, wake)?;
            drop(awake);
            bed.watch.highest = (highest, place.into());
            way.listener.begins()?;
            let folder = Folder::reopen(target)?;
            folder.take_back(ASLEEP)?;
            way.sleep(bed, folder, Some(saved), begin)
        }
        Stage::Awake { start, report } => {
            let built = setup::build_from(&input.scene, input.source.folder(), Some(&start))?;
            way.listener.begins()?;
            let folder = Folder::reopen(target)?;
            let mut session = Session::new(input, built, folder, way.origin.clone())?;
            session.restore(saved)?;
            session.begun(begin);
            way.finish(session, start, *report)
        }
    }
}

impl Way<'_> {
    /// Runs the sleeping scene from its start or from a checkpoint, and the scene as given if the model wakes.
    fn sleep(self, bed: Bed, folder: Folder, saved: Option<Checkpoint>, begin: Instant) -> Result<Finished> {
        let asleep = Input {
            source: self.input.source,
            scene: bed.scene,
            set: self.input.set,
        };
        let mut watch = bed.watch;
        let mut session = Session::new(&asleep, bed.built, folder, self.origin.clone())?;
        session.stage = Some(watch.stage());
        if let Some(saved) = saved {
            session.restore(saved)?;
        }
        session.begun(begin);
        let end = session.advance(self.listener, &mut |run, stage| {
            let woken = watch.look(run);
            *stage = Some(watch.stage());
            woken
        });
        let mut report = report_of(self.wake, &watch);
        if !matches!(end, Ok(End::Woken)) {
            return session.conclude(end, Some(report));
        }
        let begin = Instant::now();
        // Before anything is put aside: if it fails, the results so far are whole.
        let (input, folder) = (self.input, self.input.source.folder());
        let next = bed.hand_over.start(session.coupled());
        let next = next.and_then(|s| Ok((setup::build_from(&input.scene, folder, Some(&s))?, s)));
        let (built, start) = match next {
            Ok(next) => next,
            Err(e) => return session.conclude(Err(e), Some(report)),
        };
        let run = session.coupled();
        report.woken = true;
        report.time = Some(run.time());
        report.step = Some(run.steps());
        report.energy_before = Some(run.energy());
        report.momentum_before = Some(Momentum::of(run));
        let folder = session.put_aside(ASLEEP)?;
        report.energy_after = Some(built.run.energy());
        report.jump = report.energy_after.zip(report.energy_before).map(|(a, b)| a - b);
        report.momentum_after = Some(Momentum::of(&built.run));
        let mut session = Session::new(self.input, built, folder, self.origin.clone())?;
        session.begun(begin);
        self.finish(session, start, report)
    }

    /// Makes the steps that are left after the model woke.
    fn finish(self, mut session: Session<'_>, start: Start, report: WakeReport) -> Result<Finished> {
        session.stage = Some(Stage::Awake {
            start,
            report: Box::new(report.clone()),
        });
        if self.input.scene.output.checkpoint_every.is_some() {
            // Takes the place of the last one asleep, whose results have been put aside.
            session.save()?;
        }
        let end = session.advance(self.listener, &mut |_, _| false);
        session.conclude(end, Some(report))
    }
}

/// What is known before the model wakes.
fn report_of(wake: &Wake, watch: &Watch) -> WakeReport {
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

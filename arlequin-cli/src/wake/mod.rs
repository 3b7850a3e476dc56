//! Runs a scene with `[wake]`: a model sleeps until the one that stands in for it is strained enough.

mod hand_over;
mod sleep;
mod watch;

use crate::Input;
use crate::build::{self, Built, model_index};
use crate::checkpoint::Origin;
use crate::error::{Result, key};
use crate::output::Folder;
use crate::output::summary::{Momentum, WakeReport};
use crate::run::{End, Session, watch_interrupt};
use crate::scene::{Scene, Wake};
use hand_over::HandOver;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;
use watch::Watch;

/// Folder of what was recorded while the model slept.
const ASLEEP: &str = "asleep";

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
    let awake = build::build(&input.scene, folder)?;
    let built = build::build(&scene, folder)?;
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
pub(crate) fn both(input: &Input<'_>, wake: &Wake) -> Result<(Scene, Built, Built)> {
    let (bed, awake) = bed(input, wake)?;
    Ok((bed.scene, bed.built, awake))
}

/// Refuses a scene with `[wake]` where a command does not know it.
pub(crate) fn refuse(scene: &Scene, command: &str) -> Result<()> {
    match &scene.wake {
        None => Ok(()),
        Some(_) => Err(key(
            "wake",
            format!("'arlequin {command}' runs no scene whose models change; remove [wake]"),
        )),
    }
}

/// Runs both parts of the scene.
pub(crate) fn run(input: &Input<'_>, wake: &Wake, target: &Path, force: bool) -> Result<ExitCode> {
    let begin = Instant::now();
    let origin = Origin::of(input.source, input.set)?;
    let (bed, awake) = bed(input, wake)?;
    // It is built anew from the state at waking; until then its memory is free.
    drop(awake);
    let stop = watch_interrupt()?;
    let folder = Folder::begin(target, force, false)?;
    let asleep = Input {
        source: input.source,
        scene: bed.scene,
        set: input.set,
        threads: input.threads,
        json: input.json,
    };
    let mut watch = bed.watch;
    let mut session = Session::new(&asleep, bed.built, folder, origin.clone())?;
    session.begun(begin);
    let end = session.advance(&stop, &mut |run| watch.look(run))?;
    let mut report = report_of(wake, &watch);
    if end != End::Woken {
        return session.conclude(end, Some(report));
    }
    let begin = Instant::now();
    let start = bed.hand_over.start(session.coupled())?;
    let run = session.coupled();
    report.woken = true;
    report.time = Some(run.time());
    report.step = Some(run.steps());
    report.energy_before = Some(run.energy());
    report.momentum_before = Some(Momentum::of(run));
    let folder = session.put_aside(ASLEEP)?;
    let built = build::build_from(&input.scene, input.source.folder(), Some(&start))?;
    report.energy_after = Some(built.run.energy());
    report.jump = report.energy_after.zip(report.energy_before).map(|(a, b)| a - b);
    report.momentum_after = Some(Momentum::of(&built.run));
    let mut session = Session::new(input, built, folder, origin)?;
    session.begun(begin);
    let end = session.advance(&stop, &mut |_| false)?;
    session.conclude(end, Some(report))
}

/// What is known before the model wakes.
fn report_of(wake: &Wake, watch: &Watch) -> WakeReport {
    let (value, place) = watch.highest;
    WakeReport {
        woken: false,
        model: wake.model.clone(),
        by: wake.by.clone(),
        criterion: watch.criterion(),
        limit: watch.limit(),
        value: value.is_finite().then_some(value),
        place: value.is_finite().then_some(place.coords.into()),
        ..WakeReport::default()
    }
}

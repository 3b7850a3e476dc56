//! `arlequin run` and `arlequin resume`.

use crate::Input;
use crate::build::{self, Built, Strangers};
use crate::checkpoint::{self, Checkpoint, Origin};
use crate::error::{Error, Result, write};
use crate::output::packing::PackingLine;
use crate::output::plots::{self, Curve, Plot};
use crate::output::summary::{self, Energy, ProbeLine, Summary, WakeReport, WallSeconds};
use crate::output::{Folder, Frames, check_free, csv};
use crate::recorder::{self, ENERGY_COLUMNS, PhaseClock, Recorder};
use crate::report::{self, Progress};
use crate::scene::{Precision, Quantity};
use crate::spectrum;
use crate::wake::{self, Stage};
use arlequin::core::{Coupled, Real};
use arlequin::dem_beam::fracture::{Break, SharedLog, locked};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Exit code of a run that the user ended (128 + SIGINT).
const INTERRUPTED: u8 = 130;

/// Runs a scene and writes its results.
pub(crate) fn run(input: &Input<'_>, out: Option<&Path>, force: bool) -> Result<ExitCode> {
    let begin = Instant::now();
    let target = out.map_or_else(|| default_folder(input), Path::to_owned);
    check_free(&target, force)?;
    if let Some(asleep) = &input.scene.wake {
        return wake::run(input, asleep, &target, force);
    }
    let origin = Origin::of(input.source, input.set)?;
    let built = build::build(&input.scene, input.source.folder())?;
    // Made only now: Ctrl-C during the set-up leaves nothing behind.
    let stop = watch_interrupt()?;
    let lasting = input.scene.output.checkpoint_every.is_some();
    let start = |lasting| Folder::begin(&target, force, lasting);
    match input.scene.time.precision {
        Precision::Double => Session::new(input, built, start(lasting)?, origin)?.whole(begin, &stop),
        Precision::Single => {
            let built = built.narrowed()?;
            Session::new(input, built, start(lasting)?, origin)?.whole(begin, &stop)
        }
    }
}

/// Goes on with the run of a folder from its last checkpoint.
pub(crate) fn resume(target: &Path, threads: usize, json: bool) -> Result<ExitCode> {
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
        threads,
        json,
    };
    if let (Some(stage), Some(wake)) = (saved.wake.clone(), &input.scene.wake) {
        return wake::resume(&input, wake, target, saved, stage);
    }
    let built = build::build(&input.scene, source.folder())?;
    let stop = watch_interrupt()?;
    let origin = saved.origin.clone();
    let open = || Folder::reopen(target);
    match input.scene.time.precision {
        Precision::Double => Session::new(&input, built, open()?, origin)?.rest(saved, begin, &stop),
        Precision::Single => {
            let built = built.narrowed()?;
            Session::new(&input, built, open()?, origin)?.rest(saved, begin, &stop)
        }
    }
}

/// Why the steps ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// All are made.
    Complete,
    /// The user ended them.
    Interrupted,
    /// A sleeping model wakes.
    Woken,
}

impl End {
    fn status(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Interrupted => "interrupted",
            Self::Woken => "woken",
        }
    }
}

/// A run with everything that records it.
pub(crate) struct Session<'a, T: Real> {
    input: &'a Input<'a>,
    run: Coupled<T>,
    steps: usize,
    recorder: Recorder,
    clock: PhaseClock,
    folder: Folder,
    origin: Origin,
    setup: f64,
    resumed_at: Option<usize>,
    /// How far a scene with `[wake]` has come, for the checkpoints.
    pub(crate) stage: Option<Stage>,
    breaks: Vec<Option<SharedLog>>,
    strangers: Strangers,
    packings: Vec<Option<PackingLine>>,
    warnings: Vec<String>,
}

impl<'a, T: Real> Session<'a, T> {
    /// Records the state before the first step.
    pub(crate) fn new(input: &'a Input<'a>, built: Built<T>, folder: Folder, origin: Origin) -> Result<Self> {
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
            warnings: built.warnings,
        })
    }

    /// Ends the set-up that began then.
    pub(crate) fn begun(&mut self, then: Instant) {
        self.setup = then.elapsed().as_secs_f64();
    }

    /// The run.
    pub(crate) fn coupled(&self) -> &Coupled<T> {
        &self.run
    }

    /// Makes all steps of a run whose set-up began then, and writes the results.
    fn whole(mut self, begin: Instant, stop: &AtomicBool) -> Result<ExitCode> {
        self.begun(begin);
        self.complete(stop)
    }

    /// Goes on from a checkpoint likewise.
    fn rest(mut self, saved: Checkpoint, begin: Instant, stop: &AtomicBool) -> Result<ExitCode> {
        self.restore(saved)?;
        self.whole(begin, stop)
    }

    /// Takes the state of a checkpoint.
    pub(crate) fn restore(&mut self, saved: Checkpoint) -> Result<()> {
        let restored = self.run.restore(&saved.snapshot.rounded());
        restored.map_err(|e| Error::Checkpoint {
            path: self.folder.path().join(checkpoint::NAME),
            reason: format!("does not fit the run that its scene gives: {e}"),
        })?;
        self.recorder.resume(saved.records)?;
        self.resumed_at = Some(saved.snapshot.step);
        Ok(())
    }

    /// Makes the steps that are left and writes the results.
    fn complete(mut self, stop: &AtomicBool) -> Result<ExitCode> {
        let end = self.advance(stop, &mut |_, _| false)?;
        if end == End::Interrupted {
            self.save()?;
        }
        self.conclude(end, None)
    }

    /// Writes the results of the steps made and ends the folder.
    pub(crate) fn conclude(mut self, end: End, wake: Option<WakeReport>) -> Result<ExitCode> {
        let (summary, text) = self.write_results(end, wake)?;
        let place = self.folder.finish()?;
        if end == End::Complete {
            // Only now: killed in between, the run would have neither results nor a checkpoint.
            checkpoint::remove(&place)?;
        }
        if self.input.json {
            report::json(&text);
        } else {
            report::finished(&summary, &place, self.steps);
        }
        Ok(if end == End::Interrupted {
            ExitCode::from(INTERRUPTED)
        } else {
            ExitCode::SUCCESS
        })
    }

    /// Writes the results of the steps made and moves them into a folder inside; the folder is free for another run.
    pub(crate) fn put_aside(mut self, name: &str) -> Result<Folder> {
        self.write_results(End::Woken, None)?;
        self.folder.put_aside(name)?;
        Ok(self.folder)
    }

    fn write_results(&mut self, end: End, wake: Option<WakeReport>) -> Result<(Summary, String)> {
        let after = Instant::now();
        self.recorder.finish(&self.run)?;
        write_tables(self.folder.path(), &self.recorder)?;
        write_breaks(self.folder.path(), &self.run, &self.breaks)?;
        self.recorder
            .frames
            .finish(&self.folder.path().join("results.pvd"))?;
        if self.input.scene.output.plots {
            draw_plots(&self.folder, &self.recorder, title(self.input))?;
        }
        let [stepping, observing] = self.clock.split();
        let wall = WallSeconds {
            setup: self.setup,
            stepping,
            output: observing + after.elapsed().as_secs_f64(),
            phases: self.clock.phases(&self.run),
        };
        let mut summary = summarise(self.input, &self.run, &self.recorder, wall, end);
        summary.resumed_at_step = self.resumed_at;
        summary.models = summary::models(&self.run, &self.packings);
        summary.warnings.extend(self.warnings.iter().cloned());
        summary
            .warnings
            .extend(summary::findings(&self.run, &self.strangers));
        summary.effect_ledger = summary::effects(&self.run, &self.clock);
        summary.wake = wake;
        let text = serde_json::to_string_pretty(&summary).map_err(|e| Error::System {
            what: "writing summary.json",
            message: e.to_string(),
        })?;
        let path = self.folder.path().join("summary.json");
        std::fs::write(&path, &text).map_err(write(&path))?;
        Ok((summary, text))
    }

    /// Makes the steps until the user or `woken`, which may change the stage, ends them before the last.
    pub(crate) fn advance(
        &mut self,
        stop: &AtomicBool,
        woken: &mut dyn FnMut(&Coupled<T>, &mut Option<Stage>) -> bool,
    ) -> Result<End> {
        let every = self.input.scene.output.checkpoint_every;
        let progress = Progress::new(self.steps);
        let mut end = End::Complete;
        for made in self.run.steps() + 1..=self.steps {
            let energy = recorder::step(&mut self.run, &mut self.clock)?;
            self.recorder.observe(&mut self.run, energy)?;
            progress.set(made);
            if made == self.steps {
                break;
            }
            if woken(&self.run, &mut self.stage) {
                end = End::Woken;
                break;
            }
            if every.is_some_and(|n| made.is_multiple_of(n)) {
                self.save()?;
            }
            if stop.load(Ordering::Relaxed) {
                end = End::Interrupted;
                break;
            }
        }
        self.clock.enter(None);
        Ok(end)
    }

    /// Writes a checkpoint.
    pub(crate) fn save(&self) -> Result<()> {
        Checkpoint {
            version: env!("CARGO_PKG_VERSION").into(),
            origin: self.origin.clone(),
            snapshot: self.run.snapshot().rounded(),
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

/// A flag that Ctrl-C raises.
pub(crate) fn watch_interrupt() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(|e| Error::System {
        what: "watching for Ctrl-C",
        message: e.to_string(),
    })?;
    Ok(stop)
}

fn write_tables(folder: &Path, r: &Recorder) -> Result<()> {
    let mut names = vec!["time [s]".to_owned()];
    names.extend(
        r.readers
            .iter()
            .map(|p| format!("{} {}", p.name, p.quantity.label())),
    );
    csv(&folder.join("probes.csv"), &names, &columns(&r.probes))?;
    let mut names = vec!["time [s]".to_owned()];
    names.extend(ENERGY_COLUMNS.map(str::to_owned));
    names.extend(r.works.iter().map(|w| format!("work {w} [J]")));
    csv(&folder.join("energy.csv"), &names, &columns(&r.energy))?;
    if r.fact_names.is_empty() {
        return Ok(());
    }
    let mut names = vec!["time [s]".to_owned()];
    names.extend(r.fact_names.iter().cloned());
    csv(&folder.join("effects.csv"), &names, &columns(&r.facts))
}

/// One table of broken bonds per model whose bonds can break.
fn write_breaks<T: Real>(folder: &Path, run: &Coupled<T>, breaks: &[Option<SharedLog>]) -> Result<()> {
    let names = [
        "time [s]",
        "bond [-]",
        "first particle [-]",
        "second particle [-]",
        "released [J]",
        "distance [m]",
    ];
    for (s, log) in run.subdomains().iter().zip(breaks) {
        let Some(log) = log else { continue };
        let log = locked(log);
        let column = |f: fn(&Break) -> f64| log.events().iter().map(f).collect::<Vec<f64>>();
        let table = [
            column(|e| e.time),
            column(|e| f64::from(e.bond)),
            column(|e| f64::from(e.pair[0])),
            column(|e| f64::from(e.pair[1])),
            column(|e| e.released),
            column(|e| e.distance),
        ];
        let path = folder.join(format!("fracture-{}.csv", s.model().name()));
        let columns: Vec<&[f64]> = table.iter().map(Vec::as_slice).collect();
        csv(&path, &names.map(str::to_owned), &columns)?;
    }
    Ok(())
}

fn columns(table: &recorder::Table) -> Vec<&[f64]> {
    let times = std::iter::once(table.times.as_slice());
    times.chain(table.columns.iter().map(Vec::as_slice)).collect()
}

fn draw_plots(folder: &Folder, r: &Recorder, title: &str) -> Result<()> {
    let path = folder.subfolder("plots")?;
    for (quantity, file, name, unit) in [
        (Quantity::Displacement, "displacement.svg", "displacement", "m"),
        (Quantity::Velocity, "velocity.svg", "velocity", "m/s"),
        (Quantity::Rotation, "rotation.svg", "rotation", "rad"),
    ] {
        let mine = r.readers.iter().zip(&r.probes.columns);
        let curves = mine
            .filter(|(p, _)| p.quantity == quantity)
            .map(|(p, c)| Curve {
                name: p.name.clone(),
                times: &r.probes.times,
                values: c.clone(),
            })
            .collect();
        let title = headline(title, name);
        let plot = Plot::over_time(title, name, unit, curves);
        plots::draw(&path.join(file), &plot)?;
    }
    let curve = |name: &str, k: usize| Curve {
        name: name.to_owned(),
        times: &r.energy.times,
        values: r.energy.columns.get(k).cloned().unwrap_or_default(),
    };
    let curves = vec![curve("kinetic", 0), curve("internal", 1), curve("invariant H", 3)];
    let plot = Plot::over_time(headline(title, "energy"), "energy", "J", curves);
    plots::draw(&path.join("energy.svg"), &plot)?;
    let mut curves: Vec<_> = r
        .works
        .iter()
        .enumerate()
        .map(|(k, w)| curve(w, ENERGY_COLUMNS.len() + k))
        .collect();
    curves.push(curve("unexplained drift of H", 5));
    let plot = Plot::over_time(
        headline(title, "energy ledger"),
        "work since the start",
        "J",
        curves,
    );
    plots::draw(&path.join("ledger.svg"), &plot)
}

fn headline(title: &str, what: &str) -> String {
    if title.is_empty() {
        what.to_owned()
    } else {
        format!("{title}: {what}")
    }
}

fn summarise<T: Real>(
    input: &Input<'_>,
    run: &Coupled<T>,
    r: &Recorder,
    wall_seconds: WallSeconds,
    end: End,
) -> Summary {
    let plan = run.plan();
    Summary {
        scene: input.source.path.display().to_string(),
        title: input.scene.title.clone(),
        status: end.status(),
        version: env!("CARGO_PKG_VERSION"),
        resumed_at_step: None,
        wake: None,
        set: input.set.to_vec(),
        threads: input.threads,
        models: Vec::new(),
        precision: input.scene.time.precision.name(),
        dt: plan.dt,
        critical_dt: plan.critical_dt,
        steps: run.steps(),
        time: run.time().as_f64(),
        frames: r.frames.count(),
        wall_seconds,
        peak_bytes: summary::process_bytes("VmHWM:"),
        energy: Energy {
            initial: r.initial_energy,
            last: run.energy().as_f64(),
            h_drift_max: run.drift().as_f64(),
            created_max: run.top_created().as_f64(),
            start_loss: run.start_loss().as_f64(),
            ledger: run
                .works()
                .into_iter()
                .map(|w| (w.name, w.work.as_f64()))
                .collect(),
        },
        interface: summary::interfaces(run, &r.residuals),
        effects: plan.effects,
        effect_ledger: Vec::new(),
        probes: probe_lines(r),
        warnings: Vec::new(),
    }
}

fn probe_lines(r: &Recorder) -> std::collections::BTreeMap<String, ProbeLine> {
    let times = &r.probes.times;
    let step = match times.as_slice() {
        [first, .., last] => (last - first) / (times.len() - 1) as f64,
        _ => 0.0,
    };
    let line = |(p, values): (&build::Reader, &Vec<f64>)| {
        let line = ProbeLine {
            quantity: p.quantity.label(),
            last: values.last().copied().unwrap_or_default(),
            mean: values.iter().sum::<f64>() / values.len().max(1) as f64,
            min: values.iter().copied().fold(f64::INFINITY, f64::min),
            max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            frequencies: spectrum::frequencies(values, step),
        };
        (p.name.clone(), line)
    };
    r.readers.iter().zip(&r.probes.columns).map(line).collect()
}

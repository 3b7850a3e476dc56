//! `arlequin run` and `arlequin resume`.

use crate::error::{Error, Result};
use crate::ranks::{self, OtherRanks};
use crate::report::{self, Progress};
use arlequin::core::{Coupled, interrupt};
use arlequin_scene::output::curves::CurveLine;
use arlequin_scene::output::json;
use arlequin_scene::{End, LinkLine, Observer, Results, RunFolder, Scene, Table};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Exit code of a run that the user ended (128 + SIGINT).
pub(crate) const INTERRUPTED: u8 = 130;

/// Set by Ctrl-C and SIGTERM, once [`watch_interrupt`] has installed the handler.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
/// True once time stepping has begun: a second signal then no longer ends the process at once.
static STEPS: AtomicBool = AtomicBool::new(false);

/// Runs a scene and writes its results.
pub(crate) fn run(scene: &Scene, out: Option<&Path>, force: bool, as_json: bool) -> Result<ExitCode> {
    // Reports errors of the scene before errors of its folder, in the same words as `arlequin check`.
    scene.check_tables()?;
    let folder = RunFolder::new(scene, out, force)?;
    watch_links(scene)?;
    let prepared = scene.prepare_with(&mut report::phase_reporter())?;
    report::holdings(&prepared.built().holdings, as_json);
    finished(&prepared.run_into(folder, &mut Terminal::new(as_json)?)?, as_json)
}

/// Continues the run of a folder from its last checkpoint.
pub(crate) fn resume(target: &Path, communicator: OtherRanks, as_json: bool) -> Result<ExitCode> {
    watch_interrupt()?;
    let resumed = arlequin_scene::resume_on(target, communicator)?;
    finished(&resumed.run(&mut Terminal::new(as_json)?)?, as_json)
}

/// Reports the results of a run and returns the exit code.
fn finished(results: &Results, as_json: bool) -> Result<ExitCode> {
    let summary = results.summary();
    // Every rank has the same summary, so only rank 0 prints it.
    let leads = ranks::leads();
    if as_json && leads {
        report::line(&json("writing summary.json", summary)?);
    } else if let Some(folder) = results.folder.as_ref().filter(|_| leads && !as_json) {
        report::finished(summary, folder, results.planned);
    }
    Ok(if results.end == End::Interrupted {
        ExitCode::from(INTERRUPTED)
    } else {
        ExitCode::SUCCESS
    })
}

/// Observer for a user at a terminal: prints warnings, shows a progress bar, stops on Ctrl-C.
struct Terminal {
    json: bool,
    bar: Progress,
    stop: Arc<AtomicBool>,
}

impl Terminal {
    /// Begins to watch for Ctrl-C. Before this call Ctrl-C ends the process at once, which is safe because
    /// a set-up without links to other programs leaves nothing behind.
    fn new(json: bool) -> Result<Self> {
        let stop = watch_interrupt()?;
        STEPS.store(true, Ordering::Relaxed);
        Ok(Self {
            json,
            bar: Progress::default(),
            stop,
        })
    }
}

impl Observer for Terminal {
    fn warning(&mut self, text: &str) {
        if !self.json {
            report::warning(text);
        }
    }
    fn step(&mut self, run: &Coupled<f64>, planned: usize) -> ControlFlow<()> {
        self.bar.show("steps", run.steps(), planned);
        if self.stop.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
    fn stepped(&mut self) {
        self.bar.clear();
    }
    fn plot(&mut self, folder: &Path, title: &str, tables: [&Table; 3]) -> Result<()> {
        report::plot::run(folder, title, tables)
    }
    fn plot_curve(&mut self, folder: &Path, title: &str, curve: &CurveLine) -> Result<()> {
        report::plot::one_over_another(folder, title, curve)
    }
}

/// Returns the flag that Ctrl-C and SIGTERM set, and installs the signal handler on the first call. The
/// flag also ends waits for other programs and packings. A second signal during the set-up ends the
/// process.
pub(crate) fn watch_interrupt() -> Result<Arc<AtomicBool>> {
    if let Some(stop) = STOP.get() {
        return Ok(stop.clone());
    }
    let stop = STOP.get_or_init(Arc::default).clone();
    let flag = stop.clone();
    let raise = move || {
        // During the steps the loop ends by itself and writes its results; a set-up may take minutes.
        if flag.swap(true, Ordering::Relaxed) && !STEPS.load(Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
    };
    ctrlc::set_handler(raise).map_err(|e| Error::System {
        what: "watching for signals",
        message: e.to_string(),
    })?;
    interrupt::listen(is_interrupted);
    Ok(stop)
}

/// Watches for Ctrl-C if the set-up of the scene starts programs, so that these programs end with it.
pub(crate) fn watch_links(scene: &Scene) -> Result<()> {
    if !LinkLine::list(scene).is_empty() {
        watch_interrupt()?;
    }
    Ok(())
}

/// Returns whether Ctrl-C or SIGTERM arrived.
pub(crate) fn is_interrupted() -> bool {
    STOP.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

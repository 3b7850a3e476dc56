//! `arlequin run` and `arlequin resume`.

use crate::error::{Error, Result};
use crate::report::{self, Progress};
use arlequin_scene::Input;
use arlequin_scene::run::{self, End, Finished, Listener};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a run that the user ended (128 + SIGINT).
pub(crate) const INTERRUPTED: u8 = 130;

/// Runs a scene and writes its results.
pub(crate) fn run(input: &Input<'_>, out: Option<&Path>, force: bool, json: bool) -> Result<ExitCode> {
    Ok(said(
        &run::run(input, out, force, &mut Terminal::new(json))?,
        json,
    ))
}

/// Goes on with the run of a folder from its last checkpoint.
pub(crate) fn resume(target: &Path, json: bool) -> Result<ExitCode> {
    Ok(said(&run::resume(target, &mut Terminal::new(json))?, json))
}

/// Reports what a run left.
fn said(done: &Finished, json: bool) -> ExitCode {
    if json {
        report::line(&done.json);
    } else {
        report::finished(&done.summary, &done.folder, done.planned);
    }
    if done.end == End::Interrupted {
        ExitCode::from(INTERRUPTED)
    } else {
        ExitCode::SUCCESS
    }
}

/// A user at a terminal, who sees warnings and a bar and may press Ctrl-C.
struct Terminal {
    json: bool,
    bar: Progress,
    stop: Arc<AtomicBool>,
}

impl Terminal {
    fn new(json: bool) -> Self {
        Self {
            json,
            bar: Progress::default(),
            stop: Arc::default(),
        }
    }
}

impl Listener for Terminal {
    /// Watches for Ctrl-C only now: during the set-up it leaves nothing behind.
    fn begins(&mut self) -> Result<()> {
        self.stop = watch_interrupt()?;
        Ok(())
    }
    fn warning(&mut self, text: &str) {
        if !self.json {
            report::warning(text);
        }
    }
    fn step(&mut self, made: usize, of: usize) {
        self.bar.show("steps", made, of);
    }
    fn stepped(&mut self) {
        self.bar.clear();
    }
    fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
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

//! All printing of the program, and the files that it writes for people: text, Markdown, HTML, SVG. The
//! libraries supply the data and print nothing.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command line talks to its user, and does so here only"
)]

mod calibrate;
pub(crate) mod hard;
pub(crate) mod plot;
mod progress;
pub(crate) mod reference;
mod run;
pub(crate) mod sweep;
pub(crate) mod sweep_docs;
mod sweep_page;
pub(crate) mod verify;
mod work_precision;

pub(crate) use calibrate::text as calibration;
pub(crate) use run::{comparison, finished, holdings, not_started, plan, proposal};

use crate::error::Result;
pub(crate) use progress::Progress;
use serde::Serialize;
use std::sync::OnceLock;

// Amount of output. No doc comment: clap would print it as the help of the program.
#[derive(Debug, Default, Clone, Copy, clap::Args)]
pub(crate) struct Loudness {
    /// Print every phase of a set-up as it begins, and its time.
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Print only errors and the output of --json.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
}

impl Loudness {
    /// Returns `self` on the rank that prints, and quiet on all others.
    pub(crate) fn of_rank(self, leads: bool) -> Self {
        if leads {
            return self;
        }
        Self {
            verbose: false,
            quiet: true,
        }
    }
}

static LOUDNESS: OnceLock<Loudness> = OnceLock::new();

/// Sets the amount of output; later calls change nothing.
pub(crate) fn set_loudness(how: Loudness) {
    let _ = LOUDNESS.set(how);
}

fn loudness() -> Loudness {
    LOUDNESS.get().copied().unwrap_or_default()
}

/// Returns a function that shows the phases of a set-up and their progress, until it is dropped.
pub(crate) fn phase_reporter() -> impl FnMut(&str, usize, usize) {
    let progress = Progress::default();
    move |phase, done, total| progress.phase(phase, done, total)
}

/// Prints an error.
pub(crate) fn error(text: &str) {
    eprint!("{text}");
}

/// Prints a warning to the error stream while a run is still going on.
pub(crate) fn warning(text: &str) {
    if loudness().quiet {
        return;
    }
    eprintln!("warning    {text}");
}

/// Prints a line.
pub(crate) fn line(text: &str) {
    println!("{text}");
}

/// Prints text without adding a line end.
pub(crate) fn text(text: &str) {
    print!("{text}");
}

/// Returns a result as JSON.
pub(crate) fn pretty(what: &impl Serialize) -> Result<String> {
    arlequin_scene::output::json("writing JSON", what)
}

/// Prints a result as JSON, or as text with `words`.
pub(crate) fn result<T: Serialize>(what: &T, json: bool, words: impl FnOnce(&T)) -> Result<()> {
    if json {
        line(&pretty(what)?);
    } else if !loudness().quiet {
        words(what);
    }
    Ok(())
}

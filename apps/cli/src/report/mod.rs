//! All printing of the program, and the files that it writes for people: text, Markdown, HTML, SVG. Data
//! come from the libraries, which know nothing of this.
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
pub(crate) use run::{comparison, finished, held, holdings, plan, proposal};

use crate::error::Result;
pub(crate) use progress::Progress;
use serde::Serialize;
use std::sync::OnceLock;

// How much the program says. No comment for documentation: it would become the help of the program.
#[derive(Debug, Default, Clone, Copy, clap::Args)]
pub(crate) struct Loudness {
    /// Say more: every phase of a set-up as it begins, and what it took.
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Say nothing but errors and what was asked for with --json.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
}

impl Loudness {
    /// Of ranks one speaks.
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

/// Sets once for all how much is said.
pub(crate) fn speak(how: Loudness) {
    let _ = LOUDNESS.set(how);
}

fn loudness() -> Loudness {
    LOUDNESS.get().copied().unwrap_or_default()
}

/// Shows the phases of a set-up as they begin, until it is dropped.
pub(crate) fn phase_teller() -> impl FnMut(&str) {
    let progress = Progress::default();
    move |phase| progress.phase(phase)
}

/// Shows an error.
pub(crate) fn error(text: &str) {
    eprint!("{text}");
}

/// Shows a warning beside the results: while steps are made, before they end.
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

/// Prints text that ends its own lines.
pub(crate) fn text(text: &str) {
    print!("{text}");
}

/// A result as JSON.
pub(crate) fn pretty(what: &impl Serialize) -> Result<String> {
    arlequin_scene::output::json("writing JSON", what)
}

/// Prints a result as JSON, or in words.
pub(crate) fn result<T: Serialize>(what: &T, json: bool, words: impl FnOnce(&T)) -> Result<()> {
    if json {
        line(&pretty(what)?);
    } else if !loudness().quiet {
        words(what);
    }
    Ok(())
}

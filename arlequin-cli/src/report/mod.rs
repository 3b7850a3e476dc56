//! All printing of the program, and the files that it writes for people: text, Markdown, HTML, SVG. Data come from the
//! libraries, which know nothing of this.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command line talks to its user, and does so here only"
)]

mod calibrate;
pub(crate) mod hard;
pub(crate) mod plot;
mod run;
pub(crate) mod sweep;
pub(crate) mod sweep_docs;
mod sweep_page;
pub(crate) mod verify;
mod work_precision;

pub(crate) use calibrate::text as calibration;
pub(crate) use run::{comparison, finished, plan, proposal};

use crate::error::Result;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Duration;

/// Says what a set-up is at, a line as each phase begins, to a user at a terminal.
pub(crate) fn phase_teller() -> impl FnMut(&str) {
    let terminal = std::io::stderr().is_terminal();
    move |phase| {
        if terminal {
            eprintln!("set-up     {phase} ...");
        }
    }
}

/// A bar with the time to go on a terminal, a new one for each thing that is done; nothing elsewhere.
#[derive(Debug, Default)]
pub(crate) struct Progress(Mutex<Option<(String, ProgressBar)>>);

impl Progress {
    /// What a library tells of its progress.
    pub(crate) fn teller(&self) -> impl Fn(&str, usize, usize) + Sync {
        |what, done, of| self.show(what, done, of)
    }

    /// So much of so many is done.
    pub(crate) fn show(&self, what: &str, done: usize, of: usize) {
        let Ok(mut shown) = self.0.lock() else { return };
        if shown.as_ref().is_none_or(|s| s.0 != what) {
            if let Some((_, bar)) = shown.take() {
                bar.finish_and_clear();
            }
            *shown = Some((what.to_owned(), bar(what, of)));
        }
        if let Some((_, bar)) = &*shown {
            bar.set_position(done as u64);
        }
    }

    /// Says what is done at the moment.
    pub(crate) fn at(&self, label: &str) {
        if let Ok(Some((_, bar))) = self.0.lock().as_deref() {
            bar.set_message(format!(": {label}"));
        }
    }

    /// Takes the bar away.
    pub(crate) fn clear(&self) {
        if let Some((_, bar)) = self.0.lock().ok().and_then(|mut s| s.take()) {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

fn bar(what: &str, of: usize) -> ProgressBar {
    let bar = ProgressBar::new(of as u64);
    if !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
        return bar;
    }
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what}{{msg}}, {{elapsed}} gone, {{eta}} to go");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    // Twice a second: the bar must not take time from the run.
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// Shows an error.
pub(crate) fn error(text: &str) {
    eprint!("{text}");
}

/// Shows a warning beside the results: while steps are made, before they end.
pub(crate) fn warning(text: &str) {
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
    } else {
        words(what);
    }
    Ok(())
}

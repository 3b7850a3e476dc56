//! All printing of the program, and the files that it writes for people: text, Markdown, HTML, SVG. The
//! libraries supply the data and print nothing.

/// Prints a formatted line.
macro_rules! print_line {
    ($($text:tt)+) => {
        $crate::report::line(&format!($($text)+))
    };
}

/// Prints a formatted text behind its label, wrapped to the width of the terminal.
macro_rules! entry {
    ($label:expr, $($text:tt)+) => {
        $crate::report::entry($label, &format!($($text)+))
    };
}

mod calibrate;
pub(crate) mod compare;
mod finished;
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
pub(crate) use finished::finished;
pub(crate) use run::{comparison, holdings, not_started, plan, proposal};

use crate::error::Result;
pub(crate) use progress::Progress;
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

// Amount of output. No doc comment: clap would print it as the help of the program.
#[derive(Debug, Default, Clone, Copy, clap::Args)]
pub(crate) struct Loudness {
    /// Print everything about a run, and every phase of a set-up as it begins.
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

/// Prints a text to the error stream. If nobody reads that stream, nothing is left to be told.
pub(crate) fn error(text: &str) {
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

/// Returns whether both streams go to one place, a terminal or a log, where their reader sees them together.
#[cfg(unix)]
fn streams_meet() -> bool {
    use std::os::fd::{AsFd, BorrowedFd};
    use std::os::unix::fs::MetadataExt;
    // Device and number of the file tell a common log, which no terminal query would find.
    let place = |stream: BorrowedFd<'_>| {
        let file = std::fs::File::from(stream.try_clone_to_owned().ok()?);
        file.metadata().ok().map(|m| [m.dev(), m.ino()])
    };
    let report = place(std::io::stdout().as_fd());
    report.is_some() && report == place(std::io::stderr().as_fd())
}

#[cfg(not(unix))]
fn streams_meet() -> bool {
    use std::io::IsTerminal;
    std::io::stdout().is_terminal() && std::io::stderr().is_terminal()
}

/// Warnings that the reader of the report has seen during the run.
static SHOWN: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Prints a warning to the error stream while a run is still going on.
pub(crate) fn warning(text: &str) {
    if loudness().quiet {
        return;
    }
    error(&wrapped("warning", text, width()));
    // Only then is the warning left out of the report: elsewhere its reader has not seen it.
    if streams_meet() {
        SHOWN
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(text.to_owned());
    }
}

/// Returns whether the user has already seen a warning above the report.
fn was_shown(text: &str) -> bool {
    let shown = SHOWN.lock().unwrap_or_else(PoisonError::into_inner);
    shown.iter().any(|s| s == text)
}

/// Prints a line.
pub(crate) fn line(line: &str) {
    text(&format!("{line}\n"));
}

/// Prints a text behind its label, wrapped to the width of the terminal.
pub(crate) fn entry(label: &str, entry: &str) {
    text(&wrapped(label, entry, width()));
}

/// Returns the width of the terminal \[columns\]; 80 if the output goes elsewhere.
pub(crate) fn width() -> usize {
    // Longer lines are hard to read, and narrower columns split every line.
    terminal_size::terminal_size().map_or(80, |(w, _)| usize::from(w.0).clamp(40, 120))
}

/// Columns of a label.
const LABEL: usize = 11;

/// Returns a text in lines of at most `width` columns behind its label.
fn wrapped(label: &str, text: &str, width: usize) -> String {
    let mut out = String::new();
    for (k, line) in split(text, width.saturating_sub(LABEL)).iter().enumerate() {
        let label = if k == 0 { label } else { "" };
        out += format!("{label:<LABEL$}{line}").trim_end();
        out.push('\n');
    }
    out
}

/// Splits a text into lines of at most `width` columns, at least one. Words are never split.
fn split(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        // Characters and not bytes: Greek letters and units take several bytes.
        let used = lines.last().map_or(0, |l| l.chars().count());
        if used > 0 && used + 1 + word.chars().count() > width {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            *line += word;
        }
    }
    lines
}

/// Returns a path as a word that can be pasted into a shell.
fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    // A path that needs no quotes stays as the user wrote it.
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=,:@%".contains(c);
    if text.chars().all(is_plain) {
        text
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// Prints text without adding a line end. A reader that closes the pipe early, such as `head`, is no error; a
/// full disk ends the program with a message.
pub(crate) fn text(text: &str) {
    let mut out = std::io::stdout().lock();
    // With a flush, so that a full disk is noticed here and not after the end of the program.
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            error(&format!("error: standard output cannot be written: {e}\n"));
            std::process::exit(1);
        }
        _ => {}
    }
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

//! What a sweep tells its user.
#![allow(
    clippy::print_stdout,
    reason = "a command line talks to its user; this is the part of it that speaks of sweeps"
)]

use super::conclude::{percent, seconds};
use super::result::Sweep;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

/// A bar over the runs on a terminal; nothing elsewhere.
#[derive(Debug)]
pub(crate) struct Bar(ProgressBar);

impl Bar {
    /// Bar over a number of runs.
    pub(crate) fn new(runs: usize) -> Self {
        let bar = ProgressBar::new(runs as u64);
        if std::io::stderr().is_terminal() {
            let style =
                ProgressStyle::with_template("{bar:30} run {pos}/{len}: {msg}, {elapsed} gone, {eta} to go");
            if let Ok(style) = style {
                bar.set_style(style);
            }
            // Twice a second: the bar must not take time from the run.
            bar.enable_steady_tick(Duration::from_millis(500));
        } else {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        Self(bar)
    }

    /// Begins a run.
    pub(crate) fn at(&self, k: usize, label: &str) {
        self.0.set_position(k as u64);
        self.0.set_message(label.to_owned());
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Reports a sweep.
pub(crate) fn finished(s: &Sweep, out: &Path) {
    println!("sweep      {}", s.title);
    for r in &s.runs {
        let time = |x: Option<f64>| x.map_or_else(|| "-".into(), seconds);
        let error = |x: Option<f64>| x.map_or_else(|| "-".into(), percent);
        let mark = if r.pareto { "*" } else { " " };
        match r.status {
            "complete" => println!(
                "{mark} {:<44} {:>8} unknowns, set-up {:>8}, steps {:>8}, error u {:>8}, v {:>8}",
                r.label,
                r.unknowns.unwrap_or_default(),
                time(r.seconds.setup),
                time(r.seconds.stepping),
                error(r.errors.displacement),
                error(r.errors.velocity),
            ),
            status => println!(
                "{mark} {:<44} {status} {}",
                r.label,
                r.error.as_deref().unwrap_or("")
            ),
        }
    }
    let reused = s.runs.iter().filter(|r| r.reused).count();
    let fresh = s
        .runs
        .iter()
        .filter(|r| r.status == "complete" && !r.reused)
        .count();
    println!("runs       {fresh} made, {reused} taken from before, * on the Pareto front");
    for line in &s.conclusion {
        println!("           {line}");
    }
    if s.status == "interrupted" {
        println!("interrupted by Ctrl-C: the same command goes on with what is missing");
    }
    println!("results    {}", out.join("report.html").display());
}

/// Reports written documentation.
pub(crate) fn documented(path: &Path) {
    println!("written    {}", path.display());
}

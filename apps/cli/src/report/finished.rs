//! The short report of a run: the facts that matter first, everything else with `--verbose`.

use super::{entry, loudness, run, shell_word, was_shown};
use crate::figures::{self, si};
use arlequin_scene::output::summary::{InterfaceLine, ModelLine, Summary};
use std::path::Path;

/// Largest number of peaks of probes in a short report.
const PEAKS: usize = 4;

/// Reports a finished or interrupted run whose results are in `place`.
pub(crate) fn finished(s: &Summary, place: &Path, planned: usize) {
    if loudness().quiet {
        return;
    }
    entry("run", &headline(s, planned));
    facts(s, place);
    for w in s.warnings.iter().filter(|w| !was_shown(w)) {
        entry("warning", w);
    }
    entry("energy", &energy(s));
    works(s);
    if loudness().verbose {
        run::details(s);
    } else {
        s.models.iter().for_each(model);
        s.interface.iter().for_each(overlap);
    }
    let w = &s.wall_seconds;
    entry!(
        "time",
        "{:.2} s: set-up {:.2} s, steps {:.2} s, output {:.2} s, {} threads",
        w.total,
        w.setup,
        w.stepping,
        w.output,
        s.threads
    );
    print_line!("results    {}", place.display());
    let next = if s.status == "interrupted" {
        "resume"
    } else {
        "view"
    };
    print_line!("next: arlequin {next} {}", shell_word(place));
}

/// Prints the figures of the results: peaks, the largest stress, broken bonds, fragments.
fn facts(s: &Summary, place: &Path) {
    let summary = serde_json::to_value(s).unwrap_or_default();
    let figures = figures::read(place, &summary);
    let (peaks, others): (Vec<_>, Vec<_>) = figures.into_iter().partition(|[name, _]| name == "peak");
    let shown = if loudness().verbose { peaks.len() } else { PEAKS };
    for [name, words] in peaks.iter().take(shown) {
        entry(name, words);
    }
    if peaks.len() > shown {
        entry!("", "and {} probes more: run with --verbose", peaks.len() - shown);
    }
    for [name, words] in &others {
        entry(name, words);
    }
}

/// Says which scene ended, how, and how far it came.
fn headline(s: &Summary, planned: usize) -> String {
    let name = s.title.as_deref().unwrap_or(&s.scene);
    let status = s.status;
    if s.load_steps.is_empty() {
        return format!(
            "{name}: {status}, {} of {planned} steps to t = {}",
            s.steps,
            si(s.time, "s")
        );
    }
    let residual = s.load_steps.iter().map(|l| l.residual).fold(0.0, f64::max);
    let iterations: usize = s.load_steps.iter().map(|l| l.iterations).sum();
    let how = match iterations {
        0 => "solved directly".to_owned(),
        n => format!("relaxed in {n} steps"),
    };
    format!(
        "{name}: {status}, {} of {planned} load steps to t = {}, {how}, residual at most {residual:.1e}",
        s.load_steps.len(),
        si(s.time, "s")
    )
}

fn energy(s: &Summary) -> String {
    let end = si(s.energy.last, "J");
    if !s.load_steps.is_empty() {
        return format!("{end} at the end");
    }
    format!(
        "{} at the start, {end} at the end; unexplained drift of H at most {:.1e} of the energy in play",
        si(s.energy.initial, "J"),
        s.energy.h_drift_max
    )
}

/// Prints the works, the largest first.
fn works(s: &Summary) {
    let mut works: Vec<(&String, f64)> = s.energy.ledger.iter().map(|(name, work)| (name, *work)).collect();
    works.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let Some(largest) = works.first().map(|w| w.1.abs()) else {
        return;
    };
    // Smaller works are round-off.
    works.retain(|w| w.1.abs() > 1e-9 * largest);
    let words: Vec<String> = works
        .iter()
        .map(|(name, work)| format!("{name} {}", si(*work, "J")))
        .collect();
    if !words.is_empty() {
        entry("work", &words.join(", "));
    }
}

fn model(m: &ModelLine) {
    let nodes = if m.packing.is_some() { "particles" } else { "nodes" };
    let steps = match (m.scheme, m.own_steps) {
        ("implicit", _) => ", implicit".to_owned(),
        (_, 1) => String::new(),
        (_, n) => format!(", {n} own steps per step"),
    };
    entry!("model", "{}: {}, {} {nodes}{steps}", m.name, m.kind, m.nodes);
}

fn overlap(i: &InterfaceLine) {
    // Below a hundredth of a per cent there is nothing to say.
    let share = i.displacement_jump_share.filter(|s| *s > 1e-4);
    let jump = share.map_or_else(String::new, |share| {
        format!(
            ", displacements differ by up to {:.2} % of its deformation",
            100.0 * share
        )
    });
    entry!("overlap", "{}: {} multipliers{jump}", i.name, i.multipliers);
}

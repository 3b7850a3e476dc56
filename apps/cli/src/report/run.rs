//! Prints plans and details of runs, comparisons of effects and proposals.

use super::entry;
use arlequin_scene::effects::Comparison;
use arlequin_scene::output::packing::PackingLine;
use arlequin_scene::output::summary::{EffectReport, InterfaceLine, ModelLine, MomentumLine, Summary};
use arlequin_scene::setup::PhaseTime;
use arlequin_scene::suggest::Proposal;
use arlequin_scene::{LinkLine, Preview, RankLine};
use std::path::Path;

/// Total of a set-up \[s\] below which its phases are not printed.
const SHORT: f64 = 0.5;

/// Prints the plan of a run.
pub(crate) fn plan(p: &Preview) {
    entry("scene", &p.scene);
    if let Some(title) = &p.title {
        entry("title", title);
    }
    models(&p.models);
    interfaces(&p.interface);
    for z in &p.zones {
        entry!(
            "zone",
            "{} overlap {:.4e} m wide in the mean, {:.4e} m at least: {:.1} elements of the body, {:.1} of the zone's",
            z.name,
            z.width.mean,
            z.width.least,
            z.elements,
            z.fine
        );
    }
    ranks(&p.ranks);
    links(&p.links);
    if p.effects.is_empty() {
        entry("effects", "none");
    }
    for e in &p.effects {
        entry("effect", e);
    }
    match &p.resting {
        Some(how) => entry!(
            "load steps",
            "{} up to t = {:.4e} s, solved {how}",
            p.steps,
            p.end
        ),
        None => entry!(
            "steps",
            "{} of {:.4e} s up to {:.4e} s; critical step {:.4e} s",
            p.steps,
            p.dt,
            p.end,
            p.critical_dt
        ),
    }
    entry!("output", "{} frames, about {}", p.frames, bytes(p.output_bytes));
    entry!("memory", "about {}", bytes(p.memory_bytes));
    match p.stepping_seconds {
        None if p.resting.is_some() => entry!(
            "time",
            "set-up {:.2} s, load steps unknown until the first is there",
            p.setup_seconds
        ),
        Some(s) => entry!("time", "set-up {:.2} s, steps about {s:.1} s", p.setup_seconds),
        None => entry!(
            "time",
            "set-up {:.2} s, steps unknown: the first ones fail",
            p.setup_seconds
        ),
    }
    phases(&p.setup_phases);
    warnings(&p.warnings);
}

/// Prints everything about a run that its short report leaves out.
pub(super) fn details(s: &Summary) {
    models(&s.models);
    interfaces(&s.interface);
    if s.load_steps.is_empty() {
        entry!(
            "step",
            "{:.4e} s, critical {:.4e} s; up to t = {:.4e} s",
            s.dt,
            s.critical_dt,
            s.time
        );
    }
    for name in &s.energy.unknown {
        entry!(
            "energy",
            "energy of '{name}' is not known: the drift has what impulses brought to it, no more"
        );
    }
    for (name, work) in &s.energy.ledger {
        entry!("work", "{name} {work:.6e} J");
    }
    momentum(&s.momentum);
    effects(&s.effect_ledger);
    for (name, p) in &s.probes {
        // The lowest four fit on a line; the summary has all of them.
        let shown: Vec<String> = p.frequencies.iter().take(4).map(|f| format!("{f:.1}")).collect();
        let frequencies = if shown.is_empty() {
            String::new()
        } else {
            format!(", frequencies {} Hz", shown.join(", "))
        };
        entry!(
            "probe",
            "{name} {} mean {:.4e}, last {:.4e}{frequencies}",
            p.quantity,
            p.mean,
            p.last
        );
    }
    phases(&s.wall_seconds.setup_phases);
}

/// A solver is proposed if its time is below this share of the chosen solver's time; the model of times is
/// no more accurate than this.
const WORTH: f64 = 0.7;

/// Prints before the first step which models are partitioned on several ranks.
pub(crate) fn holdings(lines: &[RankLine], json: bool) {
    if !json && !super::loudness().quiet {
        ranks(lines);
    }
}

fn ranks(lines: &[RankLine]) {
    for r in lines {
        let how = if r.parts {
            "in parts"
        } else {
            "whole on every rank"
        };
        entry!("ranks", "{} {how}: {}", r.model, r.words);
    }
}

fn links(lines: &[LinkLine]) {
    for l in lines {
        match l.mass {
            Some(mass) => entry!("link", "{} {}, mass {mass:.6e} kg", l.model, l.does),
            None => entry!("link", "{} {}", l.model, l.does),
        }
    }
}

/// Prints what a scene would start, and states that nothing was started.
pub(crate) fn not_started(lines: &[LinkLine]) {
    links(lines);
    print_line!(
        "The tables of the scene are in order. Nothing was started: check with --start meets the other side."
    );
}

/// Prints the time of each phase of a set-up, unless the set-up was short.
fn phases(lines: &[PhaseTime]) {
    let total: f64 = lines.iter().map(|p| p.seconds).sum();
    let verbose = super::loudness().verbose;
    if total < SHORT && !verbose {
        return;
    }
    // Phases below a per cent would hide those that cost.
    for p in lines.iter().filter(|p| verbose || p.seconds > 0.01 * total) {
        entry!("set-up", "{} {:.2} s", p.phase, p.seconds);
    }
}

/// Prints the change in results and the cost of each effect.
pub(crate) fn comparison(c: &Comparison) {
    entry("scene", &c.scene);
    entry!(
        "as given",
        "steps {:.2} s (least of {} runs, as below)",
        c.seconds,
        c.repeat
    );
    if c.effects.is_empty() {
        entry("effects", "none");
    }
    for e in &c.effects {
        entry!(
            "without",
            "{} steps {:.2} s ({:.1} % of the time goes into it)",
            e.effect,
            e.seconds,
            100.0 * e.share
        );
        for (probe, change) in &e.probes {
            entry!("", "probe {probe} changes by up to {:.3} %", 100.0 * change);
        }
        if let Some(why) = &e.failed {
            entry!("", "ended early: {why}");
        }
        for m in &e.missing {
            entry!("", "its state calls for it: {m}");
        }
    }
    for m in &c.missing {
        entry("missing", m);
    }
}

fn effects(lines: &[EffectReport]) {
    let joules = |x: Option<f64>| x.map_or_else(|| format!("{:>14}", "-"), |x| format!("{x:>14.6e}"));
    for e in lines {
        let share = e.share.map_or_else(
            || "in the forces".to_owned(),
            |s| format!("{:.1} % of the steps", 100.0 * s),
        );
        entry!(
            "effect",
            "{} stored {:.6e} J, dissipated {} J, {share}",
            e.name,
            e.stored,
            joules(e.dissipated)
        );
        if let (Some(n), Some(total)) = (e.facts.get("broken bonds"), e.facts.get("bonds")) {
            entry!("", "{n} of {total} bonds broke");
        }
    }
}

fn momentum(lines: &[MomentumLine]) {
    let size = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    for m in lines {
        let name = m.models.join(" + ");
        let (p, l) = (size(&m.linear), size(&m.angular));
        let change = |d: Option<f64>| d.map_or_else(String::new, |d| format!(", changed by {d:.1e}"));
        entry!(
            "momentum",
            "{name} {p:.6e} kg m/s{}; angular {l:.6e} kg m²/s{}",
            change(m.linear_drift),
            change(m.angular_drift)
        );
        if let Some(why) = &m.because {
            let not = if m.keeps == "linear" {
                "the angular one"
            } else {
                "either"
            };
            entry!("", "no claim about {not}: {why}");
        }
    }
}

/// Returns a description of a model's own steps within a step of the run.
fn own_steps(m: &ModelLine) -> String {
    let share = 100.0 * m.own_dt / m.critical_dt;
    match (m.scheme, m.own_steps) {
        ("implicit", _) => format!("one implicit step of {share:.0} % of it"),
        (_, 1) => format!("one own step of {share:.0} % of it"),
        (_, n) => format!("{n} own steps of {share:.0} % of it"),
    }
}

fn models(lines: &[ModelLine]) {
    for m in lines {
        entry!(
            "model",
            "{} {} {} nodes {} unknowns, critical step {}{:.4e} s, {}",
            m.name,
            m.kind,
            m.nodes,
            m.unknowns,
            if m.critical_is_bound { "at least " } else { "" },
            m.critical_dt,
            own_steps(m)
        );
        for text in m.packing.iter().flat_map(PackingLine::text) {
            entry("", &text);
        }
    }
}

/// Returns the expected time of a solution with each solver on many ranks, and a proposal if another solver
/// is faster.
fn solutions(i: &InterfaceLine) -> Option<String> {
    let times = &i.solution_times;
    let entry = |(solver, s): &(&str, f64)| format!("{:.3} ms by {solver}", 1e3 * s);
    let words: Vec<String> = times.iter().map(entry).collect();
    let (best, least) = times.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let taken = times.iter().find(|t| t.0 == i.solver);
    // Without a time the chosen solver uses dense eigenvectors, which are slower than all others.
    let gains = taken.is_none_or(|t| *least < WORTH * t.1);
    let key = if gains {
        format!("; take solver = \"{}\"", best.replace(' ', "-"))
    } else {
        String::new()
    };
    Some(format!(
        "a solution on these ranks, expected: {}{key}",
        words.join(", ")
    ))
}

fn interfaces(lines: &[InterfaceLine]) {
    for i in lines {
        if i.multipliers == 0 {
            entry!(
                "interface",
                "{}: nothing is tied yet, its zone begins empty",
                i.name
            );
            continue;
        }
        let at_least = if i.condition_at_least { "at least " } else { "" };
        let together = match i.together.as_slice() {
            [] => String::new(),
            lines => format!(" together with '{}'", lines.join("', '")),
        };
        entry!(
            "interface",
            "{} {}, overlap {:.4e} m³ with {} coarse and {} fine nodes, {} multipliers of rank {}, condition \
                 {at_least}{:.2e}, solved by {}{together}",
            i.name,
            i.junction,
            i.measure,
            i.coupled_nodes[0],
            i.coupled_nodes[1],
            i.multipliers,
            i.rank,
            i.condition,
            i.solver
        );
        if let Some(words) = solutions(i) {
            entry("", &words);
        }
        let [coarse, fine] = i.tied.map(|t| 100.0 * t);
        entry!(
            "",
            "tied {coarse:.1} % of the coarse and {fine:.1} % of the fine nodes in the overlap, {:.2} % of it outside \
                 the mediator",
            100.0 * i.outside_mediator
        );
        if i.partition_checked {
            entry!(
                "",
                "weights sum to one; {:.2} % of the overlap is missing at surfaces, mass {:+.2} % of the overlap's",
                100.0 * i.missing_weight,
                100.0 * i.excess_mass
            );
        } else {
            entry("", "weights need not sum to one: partition = \"unchecked\"");
        }
        if let (Some(jump), Some(share)) = (i.max_displacement_jump, i.displacement_jump_share) {
            entry!(
                "",
                "displacements differed by up to {jump:.2e} m, {:.3} % of the overlap's deformation",
                100.0 * share
            );
        }
        if i.initial_jump > 0.0 {
            entry!(
                "",
                "initial displacements differed by {:.3e} m and were made to agree, by {:.3e} m at the most",
                i.initial_jump,
                i.initial_change
            );
        }
    }
}

fn warnings(lines: &[String]) {
    for w in lines {
        entry("warning", w);
    }
}

fn bytes(n: usize) -> String {
    let n = n as f64;
    match n {
        n if n >= 1e9 => format!("{:.1} GB", n / 1e9),
        n if n >= 1e6 => format!("{:.1} MB", n / 1e6),
        n => format!("{:.0} kB", n / 1e3),
    }
}

/// Prints a proposal of settings.
pub(crate) fn proposal(r: &Proposal, written: Option<&Path>) {
    entry("scene", &r.scene);
    entry("goal", &r.goal);
    entry("signal", &r.signal);
    for (name, f) in [("as given", &r.given), ("proposed", &r.proposed)] {
        let settings: Vec<String> = f.settings.iter().map(|(n, v)| format!("{n} {v}")).collect();
        entry(name, &settings.join(", "));
        entry!(
            "",
            "predicted error {:.2e} in displacement, {:.2e} in velocity, reflection up to {:.2e}, time {:.3} s",
            f.errors.displacement,
            f.errors.velocity,
            f.top_reflection,
            f.seconds
        );
    }
    for s in &r.set {
        print_line!("set        {s}");
    }
    for n in &r.notes {
        entry("note", n);
    }
    if let Some(path) = written {
        print_line!("written    {}", path.display());
    }
}

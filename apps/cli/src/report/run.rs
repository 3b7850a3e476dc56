//! Prints runs, plans of runs, comparisons of effects and proposals.

use arlequin_scene::effects::Comparison;
use arlequin_scene::output::packing::PackingLine;
use arlequin_scene::output::summary::{
    EffectReport, InterfaceLine, ModelLine, MomentumLine, Summary, WakeReport,
};
use arlequin_scene::setup::PhaseTime;
use arlequin_scene::suggest::Proposal;
use arlequin_scene::{LinkLine, Preview, RankLine};
use std::path::Path;

/// Total of a set-up \[s\] below which its phases are not printed.
const SHORT: f64 = 0.5;

/// Reports a finished or interrupted run.
pub(crate) fn finished(s: &Summary, place: &Path, planned: usize) {
    if super::loudness().quiet {
        return;
    }
    models(&s.models);
    interfaces(&s.interface);
    if s.load_steps.is_empty() {
        motion(s, planned);
    } else {
        at_rest(s, planned);
    }
    for (name, p) in &s.probes {
        let shown: Vec<String> = p.frequencies.iter().take(4).map(|f| format!("{f:.1}")).collect();
        let frequencies = if shown.is_empty() {
            String::new()
        } else {
            format!(", frequencies {} Hz", shown.join(", "))
        };
        println!(
            "probe      {name:<16} {:<18} mean {:>12.4e}, last {:>12.4e}{frequencies}",
            p.quantity, p.mean, p.last
        );
    }
    if let Some(w) = &s.wake {
        wake(w);
    }
    warnings(&s.warnings);
    let w = &s.wall_seconds;
    println!(
        "time       set-up {:.2} s, steps {:.2} s, output {:.2} s, {} threads",
        w.setup, w.stepping, w.output, s.threads
    );
    phases(&w.setup_phases);
    if s.status == "interrupted" {
        println!(
            "interrupted by Ctrl-C after step {}: results up to t = {:.4e} s are in {}",
            s.steps,
            s.time,
            place.display()
        );
    } else {
        println!("results    {}", place.display());
    }
}

/// Prints the lines of a run in time.
fn motion(s: &Summary, planned: usize) {
    println!(
        "steps      {} of {planned} with {:.4e} s (critical {:.4e} s), up to t = {:.4e} s",
        s.steps, s.dt, s.critical_dt, s.time
    );
    println!(
        "energy     {:.6e} J at the start, {:.6e} J at the end, unexplained drift of H at most {:.2e} of the energy in play",
        s.energy.initial, s.energy.last, s.energy.h_drift_max
    );
    for name in &s.energy.unknown {
        println!(
            "           energy of '{name}' is not known: the drift has what impulses brought to it, no more"
        );
    }
    for (name, work) in &s.energy.ledger {
        println!("work       {name:<24} {work:>14.6e} J");
    }
    momentum(&s.momentum);
    effects(&s.effect_ledger);
}

/// Prints the lines of a scene at rest.
fn at_rest(s: &Summary, planned: usize) {
    let residual = s.load_steps.iter().map(|l| l.residual).fold(0.0, f64::max);
    let iterations: usize = s.load_steps.iter().map(|l| l.iterations).sum();
    let how = match iterations {
        0 => "solved directly".to_owned(),
        n => format!("relaxed in {n} steps"),
    };
    println!(
        "load steps {} of {planned} up to t = {:.4e} s, {how}, residual at most {residual:.1e}",
        s.load_steps.len(),
        s.time
    );
    println!("energy     {:.6e} J at the end", s.energy.last);
}

/// Prints whether, when and how a sleeping model woke.
fn wake(w: &WakeReport) {
    let place = w.place.unwrap_or_default().map(|x| format!("{x:.4e}")).join(", ");
    let value = w.value.unwrap_or_default();
    let (Some(time), Some(before), Some(jump)) = (w.time, w.energy_before, w.jump) else {
        println!(
            "wake       '{}' was asleep to the end: the largest {} of '{}' was {value:.4e} at [{place}] m, the limit {:.4e}",
            w.model, w.criterion, w.by, w.limit
        );
        return;
    };
    println!(
        "wake       '{}' woke at t = {time:.4e} s, step {}: {} of '{}' {value:.4e} at [{place}] m, limit {:.4e}",
        w.model,
        w.step.unwrap_or_default(),
        w.criterion,
        w.by,
        w.limit
    );
    println!(
        "           energy {before:.6e} J before, {:.6e} J after: a jump of {:.3} %",
        before + jump,
        100.0 * jump / before.abs().max(f64::MIN_POSITIVE)
    );
    if let (Some(b), Some(a)) = (w.momentum_before, w.momentum_after) {
        let change = |b: [f64; 3], a: [f64; 3]| {
            let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let gap = square([a[0] - b[0], a[1] - b[1], a[2] - b[2]]);
            (square(b), gap)
        };
        let ((size, gap), (spin, slip)) = (change(b.linear, a.linear), change(b.angular, a.angular));
        println!(
            "           momentum {size:.4e} kg m/s changed by {gap:.1e}, angular {spin:.4e} kg m²/s by {slip:.1e}"
        );
    }
}

/// Prints the plan of a run.
pub(crate) fn plan(p: &Preview) {
    println!("scene      {}", p.scene);
    if let Some(title) = &p.title {
        println!("title      {title}");
    }
    if let Some(a) = &p.asleep {
        println!("asleep     until a model wakes:");
        sizes(a);
        println!("awake");
    }
    sizes(p);
}

fn sizes(p: &Preview) {
    models(&p.models);
    interfaces(&p.interface);
    for z in &p.zones {
        println!(
            "zone       {:<12} overlap {:.4e} m wide in the mean, {:.4e} m at least: {:.1} elements of the body, {:.1} of the zone's",
            z.name, z.width.mean, z.width.least, z.elements, z.fine
        );
    }
    ranks(&p.ranks);
    links(&p.links);
    if p.effects.is_empty() {
        println!("effects    none");
    }
    for e in &p.effects {
        println!("effect     {e}");
    }
    match &p.resting {
        Some(how) => println!("load steps {} up to t = {:.4e} s, solved {how}", p.steps, p.end),
        None => println!(
            "steps      {} of {:.4e} s up to {:.4e} s; critical step {:.4e} s",
            p.steps, p.dt, p.end, p.critical_dt
        ),
    }
    println!("output     {} frames, about {}", p.frames, bytes(p.output_bytes));
    println!("memory     about {}", bytes(p.memory_bytes));
    match p.stepping_seconds {
        None if p.resting.is_some() => println!(
            "time       set-up {:.2} s, load steps unknown until the first is there",
            p.setup_seconds
        ),
        Some(s) => println!("time       set-up {:.2} s, steps about {s:.1} s", p.setup_seconds),
        None => println!(
            "time       set-up {:.2} s, steps unknown: the first ones fail",
            p.setup_seconds
        ),
    }
    phases(&p.setup_phases);
    warnings(&p.warnings);
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
        println!("ranks      {:<16} {how}: {}", r.model, r.words);
    }
}

fn links(lines: &[LinkLine]) {
    for l in lines {
        match l.mass {
            Some(mass) => println!("link       {:<16} {}, mass {mass:.6e} kg", l.model, l.does),
            None => println!("link       {:<16} {}", l.model, l.does),
        }
    }
}

/// Prints what a scene would start, and states that nothing was started.
pub(crate) fn not_started(lines: &[LinkLine]) {
    links(lines);
    println!(
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
    for p in lines.iter().filter(|p| verbose || p.seconds > 0.01 * total) {
        println!("set-up     {:<42} {:>9.2} s", p.phase, p.seconds);
    }
}

/// Prints the change in results and the cost of each effect.
pub(crate) fn comparison(c: &Comparison) {
    println!("scene      {}", c.scene);
    println!(
        "as given   steps {:.2} s (least of {} runs, as below)",
        c.seconds, c.repeat
    );
    if c.effects.is_empty() {
        println!("effects    none");
    }
    for e in &c.effects {
        println!(
            "without    {:<32} steps {:.2} s ({:.1} % of the time goes into it)",
            e.effect,
            e.seconds,
            100.0 * e.share
        );
        for (probe, change) in &e.probes {
            println!(
                "           probe {probe:<16} changes by up to {:.3} %",
                100.0 * change
            );
        }
        if let Some(why) = &e.failed {
            println!("           ended early: {why}");
        }
        for m in &e.missing {
            println!("           its state calls for it: {m}");
        }
    }
    for m in &c.missing {
        println!("missing    {m}");
    }
}

fn effects(lines: &[EffectReport]) {
    let joules = |x: Option<f64>| x.map_or_else(|| format!("{:>14}", "-"), |x| format!("{x:>14.6e}"));
    for e in lines {
        let share = e.share.map_or_else(
            || "in the forces".to_owned(),
            |s| format!("{:.1} % of the steps", 100.0 * s),
        );
        println!(
            "effect     {:<24} stored {:>14.6e} J, dissipated {} J, {share}",
            e.name,
            e.stored,
            joules(e.dissipated)
        );
        if let (Some(n), Some(total)) = (e.facts.get("broken bonds"), e.facts.get("bonds")) {
            println!("           {n} of {total} bonds broke");
        }
    }
}

fn momentum(lines: &[MomentumLine]) {
    let size = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    for m in lines {
        let name = m.models.join(" + ");
        let (p, l) = (size(&m.linear), size(&m.angular));
        let change = |d: Option<f64>| d.map_or_else(String::new, |d| format!(", changed by {d:.1e}"));
        println!(
            "momentum   {name:<24} {p:>14.6e} kg m/s{}; angular {l:.6e} kg m²/s{}",
            change(m.linear_drift),
            change(m.angular_drift)
        );
        if let Some(why) = &m.because {
            let not = if m.keeps == "linear" {
                "the angular one"
            } else {
                "either"
            };
            println!("           no claim about {not}: {why}");
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
        println!(
            "model      {:<16} {:<6} {:>8} nodes {:>8} unknowns, critical step {:.4e} s, {}",
            m.name,
            m.kind,
            m.nodes,
            m.unknowns,
            m.critical_dt,
            own_steps(m)
        );
        for text in m.packing.iter().flat_map(PackingLine::text) {
            println!("           {text}");
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
        println!(
            "interface  {:<16} {}, overlap {:.4e} m³ with {} coarse and {} fine nodes, {} multipliers of rank {}, \
             condition {}{:.2e}, solved by {}{}",
            i.name,
            i.junction,
            i.measure,
            i.coupled_nodes[0],
            i.coupled_nodes[1],
            i.multipliers,
            i.rank,
            if i.condition_at_least { "at least " } else { "" },
            i.condition,
            i.solver,
            match i.together.as_slice() {
                [] => String::new(),
                lines => format!(" together with '{}'", lines.join("', '")),
            }
        );
        if let Some(words) = solutions(i) {
            println!("           {words}");
        }
        let [coarse, fine] = i.tied.map(|t| 100.0 * t);
        println!(
            "           tied {coarse:.1} % of the coarse and {fine:.1} % of the fine nodes in the overlap, {:.2} % of it outside \
             the mediator",
            100.0 * i.outside_mediator
        );
        if i.partition_checked {
            println!(
                "           weights sum to one; {:.2} % of the overlap is missing at surfaces, mass {:+.2} % of the overlap's",
                100.0 * i.missing_weight,
                100.0 * i.excess_mass
            );
        } else {
            println!("           weights need not sum to one: partition = \"unchecked\"");
        }
        if let (Some(jump), Some(share)) = (i.max_displacement_jump, i.displacement_jump_share) {
            println!(
                "           displacements differed by up to {jump:.2e} m, {:.3} % of the overlap's deformation",
                100.0 * share
            );
        }
        if i.initial_jump > 0.0 {
            println!(
                "           initial displacements differed by {:.3e} m and were made to agree, by {:.3e} m at the most",
                i.initial_jump, i.initial_change
            );
        }
    }
}

fn warnings(lines: &[String]) {
    for w in lines {
        println!("warning    {w}");
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
    println!("scene      {}", r.scene);
    println!("goal       {}", r.goal);
    println!("signal     {}", r.signal);
    for (name, f) in [("as given", &r.given), ("proposed", &r.proposed)] {
        let settings: Vec<String> = f.settings.iter().map(|(n, v)| format!("{n} {v}")).collect();
        println!("{name}   {}", settings.join(", "));
        println!(
            "           predicted error {:.2e} in displacement, {:.2e} in velocity, reflection up to {:.2e}, time {:.3} s",
            f.errors.displacement, f.errors.velocity, f.top_reflection, f.seconds
        );
    }
    for s in &r.set {
        println!("set        {s}");
    }
    for n in &r.notes {
        println!("note       {n}");
    }
    if let Some(path) = written {
        println!("written    {}", path.display());
    }
}

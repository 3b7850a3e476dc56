//! The summary of a run.

use super::crossing;
use super::recorder::{PhaseClock, Recorder};
use super::results::End;
use super::session::Session;
use crate::output::summary::{
    EffectReport, Energy, InterfaceLine, ModelLine, MomentumLine, ProbeLine, Summary, WallSeconds,
};
use crate::setup::packing::PackingLine;
use crate::setup::{ParticlesWithoutContact, ProbeReader};
use crate::spectrum;
use arlequin::core::contact::{LARGEST_TURN, PART_LOST};
use arlequin::core::effect::EffectLine;
use arlequin::core::{Arms, BodyMomentum, Claim, Coupled, OwnStep, Subdomain};
use std::collections::BTreeMap;

/// How a run ended.
pub(super) enum Status {
    /// By plan, by its user, or by a crack in an overlap.
    Ended(End),
    /// By an error with this message.
    Failed(String),
}

impl Status {
    fn name(&self) -> &'static str {
        match self {
            Self::Ended(End::Complete) => "complete",
            Self::Ended(End::Interrupted) => "interrupted",
            Self::Ended(End::IntoOverlap) => "stopped-at-overlap",
            Self::Failed(_) => "failed",
        }
    }
}

impl Session<'_> {
    /// Builds the summary; `writing` is the time spent on the result files \[s\].
    pub(super) fn summary(&self, status: Status, writing: f64) -> Summary {
        let (run, r) = (&self.run, &self.recorder);
        let [stepping, observing] = self.clock.split();
        let plan = run.plan();
        let last = match status {
            // A change of weights that failed leaves models that nothing ties.
            Status::Failed(_) => run.last_energy().map_or(r.initial_energy, |e| e.total()),
            Status::Ended(_) => run.energy(),
        };
        Summary {
            scene: self.scene.source().path.display().to_string(),
            title: self.scene.spec().title.clone(),
            load_steps: r.load_steps.clone(),
            status: status.name(),
            error: match status {
                Status::Failed(words) => Some(words),
                Status::Ended(_) => None,
            },
            version: env!("CARGO_PKG_VERSION"),
            resumed_at_step: self.resumed_at,
            into_overlap: crossing::first_cracks(run, &self.breaks),
            conversions: self
                .follow
                .as_ref()
                .map_or_else(Vec::new, |f| f.state.conversions.clone()),
            set: self.scene.changes().to_vec(),
            ranks: self.holdings.clone(),
            threads: rayon::current_num_threads(),
            models: models(run, &self.packings),
            dt: plan.dt,
            critical_dt: plan.critical_dt,
            steps: run.steps(),
            time: run.time(),
            frames: r.frames.as_ref().map_or(0, |f| f.count()),
            wall_seconds: WallSeconds {
                total: self.setup + self.begin.elapsed().as_secs_f64(),
                setup: self.setup,
                setup_phases: self.phases.clone(),
                stepping,
                output: observing + writing,
                phases: self.clock.phases(run),
            },
            peak_bytes: process_bytes("VmHWM:"),
            energy: Energy {
                initial: r.initial_energy,
                last,
                h_drift_max: run.drift(),
                h_drift_explained: run.explained_drift(),
                unknown: run.unknown_energies(),
                created_max: run.top_created(),
                start_loss: run.start_loss(),
                ledger: run.works().into_iter().map(|w| (w.name, w.work)).collect(),
            },
            momentum: momentum(run),
            interface: interfaces(run, &r.residuals),
            effects: plan.effects,
            effect_ledger: effects(run, &self.clock),
            probes: probes(r),
            warnings: r.warnings.clone(),
        }
    }
}

/// Returns the ledger lines of the effects, with their wall time.
fn effects(run: &Coupled<f64>, clock: &PhaseClock) -> Vec<EffectReport> {
    let [stepping, _] = clock.split();
    let line = |e: EffectLine<f64>| {
        let seconds = e.phase.map(|p| clock.seconds(p));
        EffectReport {
            dissipated: e.dissipated(),
            name: e.name,
            work: e.work,
            stored: e.stored,
            seconds,
            // A run without steps has no stepping time.
            share: seconds.map(|s| s / stepping.max(f64::MIN_POSITIVE)),
            facts: e.facts.into_iter().collect(),
        }
    };
    run.effects().into_iter().map(line).collect()
}

/// Returns warnings about effects that the last state would need but the scene does not list, and the
/// warnings of the run.
pub(super) fn findings(run: &Coupled<f64>, without_contact: &ParticlesWithoutContact) -> Vec<String> {
    let text = |(model, f): (String, arlequin::core::effect::Finding)| {
        // What to write into the scene.
        let keys = match f.effect {
            "finite-rotations" => " (dem.finite_rotations = true)",
            "contact" if f.message.ends_with("on") => " ([[effect]] contact = {})",
            _ => "",
        };
        format!("model '{model}': {}{keys}", f.message)
    };
    let model_findings = run.watch().into_iter().chain(without_contact.watch(run));
    let warnings = run.warnings().iter().map(ToString::to_string);
    let contacts = run
        .effects()
        .into_iter()
        .flat_map(|e| [turned(&e), lost(&e)])
        .flatten();
    let texts = model_findings.map(text).chain(contacts).chain(warnings);
    let rezoning: f64 = run.rezoning_works().into_iter().sum();
    let works = run.works();
    let start = run.energy() - works.iter().map(|line| line.work).sum::<f64>();
    let others = works.iter().filter(|line| line.name != "rezoning");
    let put_in: f64 = others.map(|line| line.work.max(0.0)).sum();
    // What changes put in does not count, nor what damping took out of it, or a run that they blow up would
    // look harmless.
    let in_play = (start + put_in).max(run.energy() - rezoning);
    texts.chain(large_work(rezoning, in_play)).collect()
}

/// Work of changes of weights, over the energy in play, above which a run says so.
const LARGE_WORK: f64 = 0.05;

/// Returns a warning if the `work` of changes of weights has put in or taken out much of the energy in play:
/// that of the start with all other works that put in energy, or the present one without this work if that is
/// more.
fn large_work(work: f64, in_play: f64) -> Option<String> {
    (work.abs() > LARGE_WORK * in_play).then(|| {
        format!(
            "changes of weights did {work:.2e} J of work, {:.0} % of the energy in play: spheres do not take over all of the body's \
             field, least where something strikes it; let the zone begin where it will be needed, take three spheres or more along each \
             element, and a lower follow.release if elements leave and join again",
            100.0 * work.abs() / in_play
        )
    })
}

/// Turn of a surface in contact \[rad\] above which a run says so; a linear model strains by half of its
/// square.
const LARGE_TURN: f64 = 0.1;

/// Returns a warning if a surface has turned further where it touches than a linear model bears.
fn turned(line: &EffectLine<f64>) -> Option<String> {
    let (name, angle) = line.facts.iter().find(|f| f.0 == LARGEST_TURN)?;
    (*angle > LARGE_TURN).then(|| {
        format!(
            "effect '{}': {name} {angle:.2}, above {LARGE_TURN}; elements are linear, and strain by {:.1} % when they turn so \
             far: compare with particles, which turn freely with dem.finite_rotations = true",
            line.name,
            50.0 * angle * angle
        )
    })
}

/// Part of the energy of elastic contacts whose loss a run reports.
const LARGE_LOSS: f64 = 0.05;

/// Returns a warning if elastic contacts have not given back what they took in.
fn lost(line: &EffectLine<f64>) -> Option<String> {
    let (name, part) = line.facts.iter().find(|f| f.0 == PART_LOST)?;
    (*part > LARGE_LOSS).then(|| {
        format!(
            "effect '{}': {name} {part:.2}, above {LARGE_LOSS}; points slipped off a rim, or contacts are too soft: enlarge \
             contact.modulus, or refine the surface",
            line.name
        )
    })
}

/// Returns the momentum of each body of a run.
fn momentum(run: &Coupled<f64>) -> Vec<MomentumLine> {
    let line = |b: BodyMomentum<f64>| {
        let (keeps, because) = match b.claim {
            Claim::Both => ("both", None),
            Claim::Linear(why) => ("linear", Some(why)),
            Claim::Neither(why) => ("neither", Some(why)),
        };
        let [linear_drift, angular_drift] = b.drift.map(|d| (keeps != "neither").then_some(d));
        MomentumLine {
            models: b.models,
            linear: b.linear.into(),
            angular: b.angular.into(),
            about: b.centre.into(),
            arms: match b.arms {
                Arms::Reference => "rest",
                Arms::Current => "present",
            },
            keeps,
            because,
            linear_drift,
            angular_drift,
        }
    };
    run.bodies().into_iter().map(line).collect()
}

/// Returns a figure of this process's memory, such as `VmRSS:` or `VmHWM:` \[bytes\], if the system reports
/// it.
pub(crate) fn process_bytes(name: &str) -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(name))?;
    let kilobytes: usize = line.split_whitespace().nth(1)?.parse().ok()?;
    // The system writes "kB" for 1024 bytes.
    Some(kilobytes * 1024)
}

/// Returns a line for each model of a run.
pub(crate) fn models(run: &Coupled<f64>, packings: &[Option<PackingLine>]) -> Vec<ModelLine> {
    let plan = run.plan();
    let sides = run.subdomains();
    let line = |(k, (name, kind, nodes, unknowns, critical_dt))| ModelLine {
        name,
        kind,
        nodes,
        unknowns,
        critical_dt,
        critical_is_bound: plan.bounded.get(k).is_some_and(|b| *b),
        own_steps: sides.get(k).map_or(1, Subdomain::own_steps),
        own_dt: sides.get(k).map_or(plan.dt, Subdomain::own_dt),
        scheme: match sides.get(k).map(Subdomain::step_choice).unwrap_or_default() {
            OwnStep::Implicit => "implicit",
            _ => "explicit",
        },
        packing: packings.get(k).cloned().flatten(),
    };
    plan.models.into_iter().enumerate().map(line).collect()
}

/// Returns a line for each interface of a run, with its largest residual if there is one.
pub(crate) fn interfaces(run: &Coupled<f64>, residuals: &[f64]) -> Vec<InterfaceLine> {
    // A plan, which makes no steps, has no residuals and no jumps.
    let jump = |k: usize| run.displacement_jumps().get(k).filter(|_| k < residuals.len());
    let line = |(k, i): (usize, &arlequin::core::Interface<f64>)| {
        let r = i.report();
        let model = run.subdomains()[i.sides()[0]].model().name();
        let group = run
            .partition()
            .iter()
            .find(|g| g.models.iter().any(|m| m == model));
        InterfaceLine {
            name: r.name.clone(),
            junction: r.junction,
            multipliers: r.multipliers,
            rank: r.rank,
            solver: r.solver,
            together: r.together.clone(),
            iterations: i.iterations(),
            solution_times: Vec::new(),
            condition: r.condition,
            condition_at_least: r.condition_at_least,
            measure: r.measure,
            coupled_nodes: r.coupled_nodes,
            tied: r.tied,
            outside_mediator: r.outside,
            missing_weight: group.map_or(0.0, |g| g.missing),
            excess_mass: group.map_or(0.0, |g| g.excess_mass),
            partition_checked: group.is_none_or(|g| g.checked),
            initial_jump: r.start_jump,
            initial_change: r.start_moved,
            max_constraint_residual: residuals.get(k).copied(),
            max_displacement_jump: jump(k).map(|j| j.largest),
            displacement_jump_share: jump(k).map(|j| j.share()),
        }
    };
    run.interfaces().iter().enumerate().map(line).collect()
}

/// Returns the mean, extremes and frequencies of all probes.
fn probes(r: &Recorder) -> BTreeMap<String, ProbeLine> {
    let times = &r.probes.times;
    let step = match times.as_slice() {
        [first, .., last] => (last - first) / (times.len() - 1) as f64,
        _ => 0.0,
    };
    let line = |(p, values): (&ProbeReader, &Vec<f64>)| {
        let line = ProbeLine {
            quantity: p.quantity.label(),
            last: values.last().copied().unwrap_or_default(),
            mean: values.iter().sum::<f64>() / values.len().max(1) as f64,
            min: values.iter().copied().fold(f64::INFINITY, f64::min),
            max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            frequencies: spectrum::frequencies(values, step),
        };
        (p.name.clone(), line)
    };
    r.readers.iter().zip(&r.probes.columns).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_that_take_or_give_more_than_a_twentieth_of_the_energy_in_play_are_told() {
        assert_eq!(
            [0.049, -0.049, 0.0].map(|w| large_work(w, 1.0)),
            [const { None }; 3]
        );
        for work in [0.051, -0.051] {
            let text = large_work(work, 1.0).expect("a warning");
            assert!(
                text.starts_with("changes of weights did") && text.contains("5 %"),
                "{text}"
            );
        }
        assert_eq!(large_work(0.0, 0.0), None);
    }
}

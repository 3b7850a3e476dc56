//! `summary.json`, and the plan of `check` in the same words.

use super::packing::PackingLine;
use crate::ranks::RankLine;
use crate::recorder::{PhaseClock, Recorder};
use crate::run::LoadStep;
use crate::setup::{ParticlesWithoutContact, PhaseTime, ProbeReader};
use crate::spectrum;
use arlequin::core::effect::EffectLine;
use arlequin::core::{Arms, BodyMomentum, Claim, Coupled, OwnStep, Subdomain};
use serde::Serialize;
use std::collections::BTreeMap;

/// `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Path of the scene as given.
    pub scene: String,
    /// Its title.
    pub title: Option<String>,
    /// Load steps of a scene at rest.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub load_steps: Vec<LoadStep>,
    /// "complete", "interrupted" or "failed"; "woken" for the part of a run in which a model slept.
    pub status: &'static str,
    /// What ended a failed run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Version of this program.
    pub version: &'static str,
    /// Step from which a killed or interrupted run went on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resumed_at_step: Option<usize>,
    /// The sleeping model and what woke it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wake: Option<WakeReport>,
    /// First cracks that ran into an overlap, one per model.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub into_overlap: Vec<crate::crossing::OverlapBreak>,
    /// Assignments of `--set`.
    pub set: Vec<String>,
    /// How the models are held on several ranks.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ranks: Vec<RankLine>,
    /// Worker threads.
    pub threads: usize,
    /// Models.
    pub models: Vec<ModelLine>,
    /// Step \[s\].
    pub dt: f64,
    /// Largest stable step \[s\].
    pub critical_dt: f64,
    /// Steps made.
    pub steps: usize,
    /// Time reached \[s\].
    pub time: f64,
    /// Frames written.
    pub frames: usize,
    /// Wall time \[s\].
    pub wall_seconds: WallSeconds,
    /// Peak of the process's memory \[bytes\]; none where the system does not tell.
    pub peak_bytes: Option<usize>,
    /// Energy \[J\].
    pub energy: Energy,
    /// Momentum of every body.
    pub momentum: Vec<MomentumLine>,
    /// Interfaces.
    pub interface: Vec<InterfaceLine>,
    /// Effects that were on.
    pub effects: Vec<String>,
    /// What each of them did.
    pub effect_ledger: Vec<EffectReport>,
    /// Probes.
    pub probes: BTreeMap<String, ProbeLine>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// A model that slept, and what its waking did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, serde::Deserialize)]
pub struct WakeReport {
    /// Whether it woke.
    pub woken: bool,
    /// The model.
    pub model: String,
    /// Its carrier.
    pub by: String,
    /// What is compared, with its unit.
    pub criterion: String,
    /// Its limit.
    pub limit: f64,
    /// Value that woke the model, or the largest one seen; none before the first look.
    pub value: Option<f64>,
    /// Where \[m\].
    pub place: Option<[f64; 3]>,
    /// When it woke \[s\].
    pub time: Option<f64>,
    /// After how many steps.
    pub step: Option<usize>,
    /// Kinetic plus internal energy before \[J\].
    pub energy_before: Option<f64>,
    /// The same after.
    pub energy_after: Option<f64>,
    /// Their difference.
    pub jump: Option<f64>,
    /// Momentum before.
    pub momentum_before: Option<Momentum>,
    /// Momentum after.
    pub momentum_after: Option<Momentum>,
}

/// Momentum of all models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, serde::Deserialize)]
pub struct Momentum {
    /// Linear \[kg m/s\].
    pub linear: [f64; 3],
    /// Angular about the origin \[kg m²/s\].
    pub angular: [f64; 3],
}

impl Momentum {
    /// Of a run.
    pub fn of(run: &Coupled<f64>) -> Self {
        let [linear, angular] = run.momentum();
        Self {
            linear: linear.into(),
            angular: angular.into(),
        }
    }
}

/// A model.
#[derive(Debug, Clone, Serialize)]
pub struct ModelLine {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: String,
    /// Nodes or particles.
    pub nodes: usize,
    /// Unknowns.
    pub unknowns: usize,
    /// Its own critical step \[s\].
    pub critical_dt: f64,
    /// Its own steps in a step of the run.
    pub own_steps: usize,
    /// Length of these \[s\].
    pub own_dt: f64,
    /// How it steps: `"explicit"` or `"implicit"`.
    pub scheme: &'static str,
    /// How the spheres were packed, where there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packing: Option<PackingLine>,
}

/// Where wall time went \[s\].
#[derive(Debug, Clone, Default, Serialize)]
pub struct WallSeconds {
    /// Reading, meshing, factoring.
    pub setup: f64,
    /// Parts of `setup`, in order.
    pub setup_phases: Vec<PhaseTime>,
    /// Steps without output.
    pub stepping: f64,
    /// Probes, frames, plots.
    pub output: f64,
    /// Parts of `stepping` and `output` by phase.
    pub phases: BTreeMap<String, f64>,
}

/// The energy balance \[J\].
#[derive(Debug, Clone, Serialize)]
pub struct Energy {
    /// Kinetic plus internal at the start.
    pub initial: f64,
    /// Kinetic plus internal at the end.
    #[serde(rename = "final")]
    pub last: f64,
    /// Largest drift of the discrete invariant, relative to the energy in play \[–\].
    pub h_drift_max: f64,
    /// Drift that the laws of the models and round-off explain \[–\].
    pub h_drift_explained: f64,
    /// Models whose energy is not known: the drift has what impulses brought to them, and not what became
    /// of that.
    pub unknown: Vec<String>,
    /// Largest share of the energy in play that effects created which must not \[–\].
    pub created_max: f64,
    /// Kinetic energy removed from initial velocities that broke the constraint.
    pub start_loss: f64,
    /// Works since the start.
    pub ledger: BTreeMap<String, f64>,
}

/// Momentum of a body: of the models that interfaces and contact hold together.
#[derive(Debug, Clone, Serialize)]
pub struct MomentumLine {
    /// Its models.
    pub models: Vec<String>,
    /// Linear momentum at the end \[kg m/s\].
    pub linear: [f64; 3],
    /// Angular momentum at the end \[kg m²/s\].
    pub angular: [f64; 3],
    /// Fixed point it is about: the centre of mass at the start \[m\].
    pub about: [f64; 3],
    /// Positions it is drawn up with: at "rest" or "present" ones.
    pub arms: &'static str,
    /// What must stay: "both", "linear" or "neither".
    pub keeps: &'static str,
    /// Why not both.
    pub because: Option<String>,
    /// Largest change relative to `Σ |m v|` \[–\]; none where something acts from outside.
    pub linear_drift: Option<f64>,
    /// The same of the angular one, relative to `Σ |y × m v| + |I ω|` \[–\].
    pub angular_drift: Option<f64>,
}

/// An interface.
#[derive(Debug, Clone, Serialize)]
pub struct InterfaceLine {
    /// Name.
    pub name: String,
    /// Junction.
    pub junction: &'static str,
    /// Multiplier unknowns.
    pub multipliers: usize,
    /// Independent ones.
    pub rank: usize,
    /// How they are solved for.
    pub solver: &'static str,
    /// Interfaces that act on the same nodes and are solved for together with it.
    pub together: Vec<String>,
    /// Iterations of the last solve; zero with a factor.
    pub iterations: usize,
    /// Lowest and highest eigenvalue that a Chebyshev iteration damps, of the operator scaled to a diagonal
    /// of ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eigenvalues: Option<[f64; 2]>,
    /// Iterations of each solve that the set-up found to be needed for them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planned_iterations: Option<usize>,
    /// What a solution is expected to take \[s\] on as many ranks as a plan is for, by solvers; nothing
    /// without such a plan.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub solution_times: Vec<(&'static str, f64)>,
    /// Condition number of the operator.
    pub condition: f64,
    /// Whether it is at least that: its smallest eigenvalue is known from above only.
    pub condition_at_least: bool,
    /// Volume of the overlap \[m³\].
    pub measure: f64,
    /// Nodes of the coarse and the fine model under the constraint.
    pub coupled_nodes: [usize; 2],
    /// Shares of the coarse and the fine model's nodes in the overlap on which multipliers act (by volume
    /// for particles).
    pub tied: [f64; 2],
    /// Share of the overlap outside the mediator.
    pub outside_mediator: f64,
    /// Weight that is missing at surfaces where the models' shapes differ, relative to the overlap.
    pub missing_weight: f64,
    /// Weighted inertia of the tied models less that of the space they fill, relative to the overlap.
    pub excess_mass: f64,
    /// Whether the weights were checked to sum to one.
    pub partition_checked: bool,
    /// Jump of the initial displacements that was projected away \[m\].
    pub initial_jump: f64,
    /// Largest change of an initial displacement by that \[m\].
    pub initial_change: f64,
    /// Largest velocity jump relative to the largest velocity \[–\]; none before a step was made.
    pub max_constraint_residual: Option<f64>,
    /// Largest jump of displacements \[m\], which own steps leave.
    pub max_displacement_jump: Option<f64>,
    /// The same over the deformation of the overlap: the largest displacement there from a rigid motion.
    pub displacement_jump_share: Option<f64>,
}

/// A probe.
#[derive(Debug, Clone, Serialize)]
pub struct ProbeLine {
    /// Quantity and unit.
    pub quantity: &'static str,
    /// Last value.
    pub last: f64,
    /// Mean over time.
    pub mean: f64,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Frequencies of the peaks of its spectrum \[Hz\], ascending.
    pub frequencies: Vec<f64>,
}

/// What one effect did.
#[derive(Debug, Clone, Serialize)]
pub struct EffectReport {
    /// Model and effect.
    pub name: String,
    /// Work on the models \[J\]; none for what does none of its own.
    pub work: Option<f64>,
    /// Energy it holds \[J\].
    pub stored: f64,
    /// Energy that is gone \[J\]; none for loads.
    pub dissipated: Option<f64>,
    /// Wall time \[s\]; none for what is part of the forces.
    pub seconds: Option<f64>,
    /// Share of the wall time of all steps \[–\].
    pub share: Option<f64>,
    /// Figures of its own.
    pub facts: BTreeMap<String, f64>,
}

/// What the effects of a run did, and how long it took.
pub fn effects(run: &Coupled<f64>, clock: &PhaseClock) -> Vec<EffectReport> {
    let [stepping, _] = clock.split();
    let line = |e: EffectLine<f64>| {
        let seconds = e.phase.map(|p| clock.seconds(p));
        EffectReport {
            dissipated: e.dissipated(),
            name: e.name,
            work: e.work,
            stored: e.stored,
            seconds,
            share: seconds.map(|s| s / stepping.max(f64::MIN_POSITIVE)),
            facts: e.facts.into_iter().collect(),
        }
    };
    run.effects().into_iter().map(line).collect()
}

/// What the last state would need effects for that are not on, and what the run warns of.
pub fn findings(run: &Coupled<f64>, without_contact: &ParticlesWithoutContact) -> Vec<String> {
    let text =
        |(model, f): (String, arlequin::core::effect::Finding)| format!("model '{model}': {}", f.message);
    let all = run.watch().into_iter().chain(without_contact.watch(run));
    let warnings = run.warnings().iter().map(ToString::to_string);
    all.map(text).chain(warnings).collect()
}

/// Momentum of the bodies of a run.
pub fn momentum(run: &Coupled<f64>) -> Vec<MomentumLine> {
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

/// A figure of this process's memory \[bytes\], such as `VmRSS:` or `VmHWM:`, where the system tells.
pub fn process_bytes(name: &str) -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(name))?;
    let kilobytes: usize = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes * 1024)
}

/// Models of a run.
pub fn models(run: &Coupled<f64>, packings: &[Option<PackingLine>]) -> Vec<ModelLine> {
    let plan = run.plan();
    let sides = run.subdomains();
    let line = |(k, (name, kind, nodes, unknowns, critical_dt))| ModelLine {
        name,
        kind,
        nodes,
        unknowns,
        critical_dt,
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

/// Interfaces of a run with their largest residuals, as far as there are any.
pub fn interfaces(run: &Coupled<f64>, residuals: &[f64]) -> Vec<InterfaceLine> {
    // A plan has none yet.
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
            eigenvalues: r.damped.map(|d| d.eigenvalues),
            planned_iterations: r.damped.map(|d| d.iterations),
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

/// Means, extremes and frequencies of all probes.
pub fn probes(r: &Recorder) -> BTreeMap<String, ProbeLine> {
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

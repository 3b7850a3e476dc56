//! `summary.json`, and the plan of `check` with the same fields.

use crate::ranks::RankLine;
use crate::setup::PhaseTime;
use crate::setup::packing::PackingLine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Path of the scene, as given.
    pub scene: String,
    /// Title of the scene.
    pub title: Option<String>,
    /// Load steps of a scene at rest.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub load_steps: Vec<LoadStep>,
    /// "complete", "interrupted", "stopped-at-overlap" or "failed".
    pub status: &'static str,
    /// Error that ended a failed run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Version of this program.
    pub version: &'static str,
    /// Step from which a resumed run continued.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resumed_at_step: Option<usize>,
    /// First crack of each model that ran into an overlap.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub into_overlap: Vec<OverlapBreak>,
    /// Changes of the zone that follows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub conversions: Vec<Conversion>,
    /// Assignments of `--set`.
    pub set: Vec<String>,
    /// How the models are distributed over several ranks.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ranks: Vec<RankLine>,
    /// Number of worker threads.
    pub threads: usize,
    /// One line per model.
    pub models: Vec<ModelLine>,
    /// Step of the run \[s\].
    pub dt: f64,
    /// Largest stable step \[s\].
    pub critical_dt: f64,
    /// Number of steps made.
    pub steps: usize,
    /// Time reached \[s\].
    pub time: f64,
    /// Number of frames written.
    pub frames: usize,
    /// Wall time \[s\].
    pub wall_seconds: WallSeconds,
    /// Peak memory of the process \[bytes\]; `None` if the system does not report it.
    pub peak_bytes: Option<usize>,
    /// Energy \[J\].
    pub energy: Energy,
    /// Momentum of each body.
    pub momentum: Vec<MomentumLine>,
    /// One line per interface.
    pub interface: Vec<InterfaceLine>,
    /// Effects that were enabled.
    pub effects: Vec<String>,
    /// Ledger of the effects.
    pub effect_ledger: Vec<EffectReport>,
    /// Statistics of the probes.
    pub probes: BTreeMap<String, ProbeLine>,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// A change of the elements that a zone has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Conversion {
    /// Time \[s\].
    pub time: f64,
    /// Number of steps made before.
    pub step: usize,
    /// Number of elements of the body that the zone had alone, and that it has.
    pub cells: [usize; 2],
    /// Number of spheres that were awake, and that are.
    pub spheres: [usize; 2],
    /// Change of the energy \[J\]: the sum of the parts.
    pub work: f64,
    /// Parts of the work \[J\]: potential, kinetic, rigid motion, consistent start.
    pub parts: [f64; 4],
    /// Share of the consistent start by which jumps between displacements are closed \[J\].
    pub closing: f64,
    /// Wall time of the look and the change \[s\].
    pub seconds: f64,
}

/// A load step in equilibrium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoadStep {
    /// Time at which loads and motions are taken \[s\].
    pub time: f64,
    /// Name of the method: `direct` or `relaxed`.
    pub method: String,
    /// Relative residual: of the linear system, or largest unbalanced force over the largest internal force
    /// since the load step before, or a tenth of the sum of these forces over loads and reactions.
    pub residual: f64,
    /// Number of relaxation steps.
    pub iterations: usize,
    /// Internal energy \[J\].
    pub energy: f64,
}

/// A crack that ran into an overlap.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OverlapBreak {
    /// Name of the model.
    pub model: String,
    /// Time of the broken bond with which the breaks in overlaps became a crack \[s\], see
    /// [`CRACK`](arlequin::dem_beam::fracture::CRACK).
    pub time: f64,
    /// Position of that bond \[m\].
    pub place: [f64; 3],
    /// Number of broken bonds in overlaps so far.
    pub bonds: usize,
}

/// Size and time steps of a model.
#[derive(Debug, Clone, Serialize)]
pub struct ModelLine {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: String,
    /// Number of nodes or particles.
    pub nodes: usize,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Critical step of the model \[s\].
    pub critical_dt: f64,
    /// True if `critical_dt` is a lower bound, which was enough for a step given in seconds.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub critical_is_bound: bool,
    /// Number of the model's own steps per step of the run.
    pub own_steps: usize,
    /// Length of an own step \[s\].
    pub own_dt: f64,
    /// Time stepping scheme: `"explicit"` or `"implicit"`.
    pub scheme: &'static str,
    /// Result of the packing of spheres, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packing: Option<PackingLine>,
}

/// Wall time by activity \[s\].
#[derive(Debug, Clone, Default, Serialize)]
pub struct WallSeconds {
    /// Time from the begin of the set-up until this summary.
    pub total: f64,
    /// Time of reading, meshing, factoring.
    pub setup: f64,
    /// Phases of `setup`, in order.
    pub setup_phases: Vec<PhaseTime>,
    /// Time of the steps without output.
    pub stepping: f64,
    /// Time of probes, frames, plots.
    pub output: f64,
    /// Parts of `stepping` and `output` by phase.
    pub phases: BTreeMap<String, f64>,
}

/// The energy balance \[J\].
#[derive(Debug, Clone, Serialize)]
pub struct Energy {
    /// Kinetic plus internal energy at the start.
    pub initial: f64,
    /// Kinetic plus internal energy at the end; of a run that failed, at the last sample before.
    #[serde(rename = "final")]
    pub last: f64,
    /// Largest drift of the discrete invariant, relative to the energy in play \[–\].
    pub h_drift_max: f64,
    /// Drift that the laws of the models and round-off explain, relative to the energy in play \[–\].
    pub h_drift_explained: f64,
    /// Models whose energy is unknown. The drift counts the energy that impulses bring to them, but not what
    /// becomes of it.
    pub unknown: Vec<String>,
    /// Largest energy created by an effect that must not create any, relative to the energy in play \[–\].
    pub created_max: f64,
    /// Kinetic energy removed from initial velocities that violated the constraint.
    pub start_loss: f64,
    /// Work by ledger line, since the start.
    pub ledger: BTreeMap<String, f64>,
}

/// Momentum of a body, that is of all models joined by interfaces and contact.
#[derive(Debug, Clone, Serialize)]
pub struct MomentumLine {
    /// Names of the models.
    pub models: Vec<String>,
    /// Linear momentum at the end \[kg m/s\].
    pub linear: [f64; 3],
    /// Angular momentum at the end \[kg m²/s\].
    pub angular: [f64; 3],
    /// Fixed point of the angular momentum: the centre of mass at the start \[m\].
    pub about: [f64; 3],
    /// Positions used for the angular momentum: "rest" or "present".
    pub arms: &'static str,
    /// Conserved momenta: "both", "linear" or "neither".
    pub keeps: &'static str,
    /// Reason if not both are conserved.
    pub because: Option<String>,
    /// Largest change of the linear momentum relative to `Σ |m v|` \[–\]; `None` if `keeps` is "neither".
    pub linear_drift: Option<f64>,
    /// Largest change of the angular momentum relative to `Σ |y × m v| + |I ω|` \[–\]; `None` if `keeps` is
    /// "neither".
    pub angular_drift: Option<f64>,
}

/// Sizes, solver and errors of an interface.
#[derive(Debug, Clone, Serialize)]
pub struct InterfaceLine {
    /// Name.
    pub name: String,
    /// Junction.
    pub junction: &'static str,
    /// Number of multiplier unknowns.
    pub multipliers: usize,
    /// Number of independent multiplier unknowns.
    pub rank: usize,
    /// Solver of the multipliers.
    pub solver: &'static str,
    /// Interfaces that share nodes with this one and are solved jointly with it.
    pub together: Vec<String>,
    /// Iterations of the last solve; zero with a factor.
    pub iterations: usize,
    /// Expected time of a solve by each solver \[s\], on the planned number of ranks; empty without a plan
    /// for ranks.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub solution_times: Vec<(&'static str, f64)>,
    /// Condition number of the operator.
    pub condition: f64,
    /// True if `condition` is a lower bound, because the smallest eigenvalue is known from above only.
    pub condition_at_least: bool,
    /// Volume of the overlap \[m³\].
    pub measure: f64,
    /// Number of constrained nodes of the coarse and of the fine model.
    pub coupled_nodes: [usize; 2],
    /// Shares of the coarse and of the fine model's nodes in the overlap on which multipliers act (by volume
    /// for particles).
    pub tied: [f64; 2],
    /// Share of the overlap outside the mediator.
    pub outside_mediator: f64,
    /// Weight that is missing at surfaces where the models' shapes differ, relative to the overlap.
    pub missing_weight: f64,
    /// Weighted inertia of the tied models minus that of the space they fill, relative to the overlap.
    pub excess_mass: f64,
    /// True if the weights were checked to sum to one.
    pub partition_checked: bool,
    /// Jump of the initial displacements that was projected out \[m\].
    pub initial_jump: f64,
    /// Largest change of an initial displacement by this projection \[m\].
    pub initial_change: f64,
    /// Largest velocity jump relative to the largest velocity \[–\]; `None` before the first step.
    pub max_constraint_residual: Option<f64>,
    /// Largest displacement jump \[m\], which own steps leave behind.
    pub max_displacement_jump: Option<f64>,
    /// Largest displacement jump over the deformation of the overlap, which is its largest displacement
    /// relative to a rigid motion \[–\].
    pub displacement_jump_share: Option<f64>,
}

/// Statistics of a probe.
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
    /// Frequencies at the peaks of the spectrum \[Hz\], ascending.
    pub frequencies: Vec<f64>,
}

/// Ledger line of one effect.
#[derive(Debug, Clone, Serialize)]
pub struct EffectReport {
    /// Name of model and effect.
    pub name: String,
    /// Work on the models \[J\]; `None` for an effect that does no work of its own.
    pub work: Option<f64>,
    /// Energy stored in the effect \[J\].
    pub stored: f64,
    /// Energy dissipated \[J\]; `None` for loads.
    pub dissipated: Option<f64>,
    /// Wall time \[s\]; `None` if the effect is part of the internal forces.
    pub seconds: Option<f64>,
    /// Share of the wall time of all steps \[–\].
    pub share: Option<f64>,
    /// Further figures of the effect.
    pub facts: BTreeMap<String, f64>,
}

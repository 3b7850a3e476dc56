//! The scene: what the TOML file says, before any of it is built. `docs/scene.md` is its reference.

mod choice;
mod drive;
mod effect;
mod interface;
mod model;
mod probe;
mod statics;
mod wake;

pub use drive::{Axis, Field, Initial, Load, Motion, OutputField, Selection, Spin, Support, TimeShape, Wave};
pub use effect::{Bearer, Contact, CriterionKind, Effect, EffectKind, Fracture, Obstacle, ObstacleShape};
pub use interface::{
    Absorber, Interface, JunctionKind, OverlapShape, ProfileKind, ProfileTable, RegionShape, SolverKind,
    WeightTable,
};
pub use model::{
    CnemTable, DemTable, Element, Functions, Hole, LooseKind, Masses, Material, ModelKind, ModelTable,
    NotchBox, OwnStepTable, ParticleFieldKind, Protocol, RoleKind, Scheme, Shape,
};
pub use probe::{Component, Curve, Probe, Quantity};
pub use statics::Static;
pub use wake::{Near, Wake};

use choice::choice;
use serde::Deserialize;
use std::collections::BTreeMap;

/// A scene.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// One line for reports.
    pub title: Option<String>,
    /// Models by name.
    pub model: BTreeMap<String, ModelTable>,
    /// Interfaces by name.
    #[serde(default)]
    pub interface: BTreeMap<String, Interface>,
    /// Length of the run and of its steps.
    #[serde(default)]
    pub time: Time,
    /// A scene at rest, in place of `[time]`.
    #[serde(rename = "static")]
    pub statics: Option<Static>,
    /// Supports and prescribed motions.
    #[serde(default)]
    pub support: Vec<Support>,
    /// Loads.
    #[serde(default)]
    pub load: Vec<Load>,
    /// Body forces and damping.
    #[serde(default, deserialize_with = "effect::effects")]
    pub effect: Vec<Effect>,
    /// Initial displacements and velocities.
    #[serde(default)]
    pub initial: Vec<Initial>,
    /// Probes by name.
    #[serde(default)]
    pub probe: BTreeMap<String, Probe>,
    /// One probe over another: a table and a picture.
    #[serde(default)]
    pub curve: BTreeMap<String, Curve>,
    /// What is written, and how often.
    #[serde(default)]
    pub output: Output,
    /// A model that sleeps at first.
    pub wake: Option<Wake>,
}

/// Length of the run and of its steps.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// End \[s\].
    pub end: Option<f64>,
    /// Number of steps, in place of `end`.
    pub steps: Option<usize>,
    /// The step.
    #[serde(default)]
    pub step: StepChoice,
}

/// How the time step is chosen.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum StepChoice {
    /// Share of the critical step.
    Fraction(f64),
    /// Seconds.
    Seconds(f64),
}

choice!(
    StepChoice,
    "{ fraction = share of the critical step }, { seconds = step }"
);

impl Default for StepChoice {
    /// Nine tenths of the critical step: the estimate of the highest frequency is good to one per cent.
    fn default() -> Self {
        Self::Fraction(0.9)
    }
}

/// What is written, and how often.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Steps between two frames.
    pub every: Option<usize>,
    /// Seconds between two frames.
    pub interval: Option<f64>,
    /// Fields in the frames.
    pub fields: Vec<OutputField>,
    /// Steps between two rows of `probes.csv`.
    pub probe_every: usize,
    /// Steps between two rows of `energy.csv`.
    pub energy_every: usize,
    /// Steps between two checkpoints; none are written otherwise.
    pub checkpoint_every: Option<usize>,
    /// Whether plots are drawn.
    pub plots: bool,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            every: None,
            interval: None,
            fields: vec![
                OutputField::Displacement,
                OutputField::Velocity,
                OutputField::Weights,
                OutputField::EnergyDensity,
                OutputField::Multipliers,
                OutputField::Stress,
                OutputField::Strain,
                OutputField::VonMises,
                OutputField::PrincipalStress,
                OutputField::BondForces,
                OutputField::ContactForces,
            ],
            probe_every: 1,
            // A row costs two energy evaluations, a fifth of a step each.
            energy_every: 10,
            checkpoint_every: None,
            plots: true,
        }
    }
}

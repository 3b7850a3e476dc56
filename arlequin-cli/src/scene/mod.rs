//! The scene: what the TOML file says, before any of it is built. `docs/scene.md` is its reference.

mod drive;
mod effect;
#[cfg(test)]
mod fuzz;
mod interface;
mod model;
mod source;
mod wake;

pub(crate) use drive::{
    Axis, Field, Initial, Load, Motion, OutputField, Probe, Quantity, Selection, Spin, Support, TimeShape,
    Wave,
};
pub(crate) use effect::{Contact, CriterionKind, Effect, Fracture, Obstacle, ObstacleShape};
pub(crate) use interface::{
    Absorber, Interface, JunctionKind, OverlapShape, PartitionKind, ProfileKind, ProfileTable, RegionShape,
    SamplingKind, WeightTable, WeightingKind,
};
pub(crate) use model::{
    CnemTable, DemTable, Element, Functions, LooseKind, Masses, Material, ModelTable, NotchBox,
    ParticleFieldKind, Protocol, RoleKind, Shape,
};
pub(crate) use source::Source;
pub(crate) use wake::{Near, Wake};

use serde::Deserialize;
use std::collections::BTreeMap;

/// A scene.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scene {
    /// One line for reports.
    pub(crate) title: Option<String>,
    /// Models by name.
    pub(crate) model: BTreeMap<String, ModelTable>,
    /// Interfaces by name.
    #[serde(default)]
    pub(crate) interface: BTreeMap<String, Interface>,
    /// Length of the run and of its steps.
    pub(crate) time: Time,
    /// Supports and prescribed motions.
    #[serde(default)]
    pub(crate) support: Vec<Support>,
    /// Loads.
    #[serde(default)]
    pub(crate) load: Vec<Load>,
    /// Body forces and damping.
    #[serde(default)]
    pub(crate) effect: Vec<Effect>,
    /// Initial displacements and velocities.
    #[serde(default)]
    pub(crate) initial: Vec<Initial>,
    /// Probes by name.
    #[serde(default)]
    pub(crate) probe: BTreeMap<String, Probe>,
    /// What is written, and how often.
    #[serde(default)]
    pub(crate) output: Output,
    /// A model that sleeps at first.
    pub(crate) wake: Option<Wake>,
}

/// Length of the run and of its steps.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Time {
    /// End \[s\].
    pub(crate) end: Option<f64>,
    /// Number of steps, in place of `end`.
    pub(crate) steps: Option<usize>,
    /// The step.
    #[serde(default)]
    pub(crate) step: StepChoice,
}

/// How the time step is chosen.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum StepChoice {
    /// Share of the critical step.
    Fraction(f64),
    /// Seconds.
    Seconds(f64),
}

impl Default for StepChoice {
    /// Nine tenths of the critical step: the estimate of the highest frequency is good to one per cent.
    fn default() -> Self {
        Self::Fraction(0.9)
    }
}

/// What is written, and how often.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Output {
    /// Steps between two frames.
    pub(crate) every: Option<usize>,
    /// Seconds between two frames.
    pub(crate) interval: Option<f64>,
    /// Fields in the frames.
    pub(crate) fields: Vec<OutputField>,
    /// Steps between two rows of `probes.csv`.
    pub(crate) probe_every: usize,
    /// Steps between two rows of `energy.csv`.
    pub(crate) energy_every: usize,
    /// Steps between two checkpoints; none are written otherwise.
    pub(crate) checkpoint_every: Option<usize>,
    /// Whether plots are drawn.
    pub(crate) plots: bool,
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
            ],
            probe_every: 1,
            // A row costs two energy evaluations, a fifth of a step each.
            energy_every: 10,
            checkpoint_every: None,
            plots: true,
        }
    }
}

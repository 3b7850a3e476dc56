//! Tables of a scene as read from the TOML file, before anything is built. `docs/scene.md` is the reference.

mod body;
mod choice;
mod drive;
mod effect;
mod follow;
mod interface;
mod model;
mod probe;
pub mod schema;
mod statics;
pub(crate) mod sweep;

pub use body::{ZoneMediator, ZoneOverlap, ZoneShape, ZoneTable};
pub use drive::{
    Axis, Field, Initial, Load, Motion, OutputField, ProfileSamples, Selection, Spin, Support, TimeShape,
    Wave,
};
pub use effect::{Bearer, Contact, CriterionKind, Effect, EffectKind, Fracture, Obstacle, ObstacleShape};
pub use follow::{Follow, FollowTable};
pub use interface::{
    Absorber, Interface, JunctionKind, JunctionTable, MediatorTable, Method, OverlapShape, ProfileKind,
    ProfileTable, RegionShape, SolverKind, WeightTable,
};
pub use model::{
    CnemTable, DemTable, Element, FemTable, Functions, Hole, LooseKind, Masses, Material, ModelKind,
    ModelTable, Notch, NotchBox, NotchDisc, NotchPlane, OwnStepTable, ParticleFieldKind, Protocol, RoleKind,
    Scheme, Shape,
};
pub(crate) use probe::Reading;
pub use probe::{Component, Crack, Curve, Probe, Quantity};
pub use statics::Static;

use choice::choice;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;

/// A scene file.
// `M` and `I` are its models and interfaces, as the file gives them or as set-up derives them.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[serde(bound(deserialize = "M: Deserialize<'de>, I: Deserialize<'de>"))]
#[schemars(transform = schema::exactly_one("time static"))]
#[schemars(extend(
    "anyOf" = [{ "required": ["model"] }, { "required": ["body"] }],
    "dependencies" = {
        "zone": ["body"],
    },
))]
#[non_exhaustive]
pub struct SceneSpec<M = ModelTable, I = Interface> {
    /// One line for reports and plots.
    pub title: Option<String>,
    /// The body, whose coarse model is called `body`; it has the keys of a model except `role`.
    #[schemars(extend("not" = { "required": ["role"] }))]
    pub body: Option<M>,
    /// Fine models that replace parts of the body's model, by name.
    #[serde(default)]
    #[schemars(extend("propertyNames" = { "pattern": schema::NAME }))]
    pub zone: BTreeMap<String, ZoneTable>,
    /// Models by name; at least one unless there is a body.
    #[serde(default)]
    #[schemars(extend("propertyNames" = { "pattern": schema::NAME }))]
    pub model: BTreeMap<String, M>,
    /// Interfaces by name.
    #[serde(default)]
    #[schemars(extend("propertyNames" = { "pattern": schema::NAME }))]
    pub interface: BTreeMap<String, I>,
    /// Length of the run and of the time steps.
    #[serde(default)]
    pub time: Time,
    /// Settings of a scene at rest, instead of `[time]`.
    #[serde(rename = "static")]
    pub statics: Option<Static>,
    /// Supports and prescribed motions.
    #[serde(default)]
    pub support: Vec<Support>,
    /// Loads.
    #[serde(default)]
    pub load: Vec<Load>,
    /// Effects besides supports and loads; a run has only the effects that are listed.
    #[serde(default, deserialize_with = "effect::effects")]
    #[schemars(with = "Vec<effect::Table>")]
    pub effect: Vec<Effect>,
    /// Initial displacements and velocities.
    #[serde(default)]
    pub initial: Vec<Initial>,
    /// Probes by name.
    #[serde(default)]
    #[schemars(extend("propertyNames" = { "pattern": schema::NAME }))]
    pub probe: BTreeMap<String, Probe>,
    /// One probe over another: a table and a plot.
    #[serde(default)]
    #[schemars(extend("propertyNames" = { "pattern": schema::NAME }))]
    pub curve: BTreeMap<String, Curve>,
    /// Files that are written, and how often.
    #[serde(default)]
    pub output: Output,
}

impl<M, I> SceneSpec<M, I> {
    /// Returns the scene with another body, other models and other interfaces.
    pub(crate) fn with_tables<N, J>(
        self,
        body: Option<N>,
        model: BTreeMap<String, N>,
        interface: BTreeMap<String, J>,
    ) -> SceneSpec<N, J> {
        SceneSpec {
            body,
            model,
            interface,
            title: self.title,
            zone: self.zone,
            time: self.time,
            statics: self.statics,
            support: self.support,
            load: self.load,
            effect: self.effect,
            initial: self.initial,
            probe: self.probe,
            curve: self.curve,
            output: self.output,
        }
    }
}

/// Length of the run and of the time steps.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("end steps"))]
#[non_exhaustive]
pub struct Time {
    /// End of the run \[s\], rounded up to whole steps; give `end` or `steps`.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub end: Option<f64>,
    /// Number of steps of the run, each as long as an own step of the finest model.
    #[schemars(range(min = 1))]
    pub steps: Option<usize>,
    /// Choice of the time step; models take several own steps within it if they need to. Default: `{ fraction
    /// = 0.9 }`.
    #[serde(default)]
    pub step: StepChoice,
}

/// Choices of the time step.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum StepChoice {
    /// Own step of the finest model over its critical step, above 0 and below 1 \[–\].
    Fraction(#[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))] f64),
    /// Step of the run \[s\]; refused if an own step exceeds the critical step of its model.
    Seconds(#[schemars(extend("exclusiveMinimum" = 0))] f64),
}

choice!(
    StepChoice,
    "{ fraction = share of the critical step }, { seconds = step }"
);

impl Default for StepChoice {
    /// Nine tenths of the critical step, because the estimate of the highest frequency is good to one per
    /// cent.
    fn default() -> Self {
        Self::Fraction(0.9)
    }
}

/// Files that are written, and how often.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(transform = schema::excludes("every", "interval"))]
#[non_exhaustive]
pub struct Output {
    /// Steps between two frames. Default: about 20 frames in all.
    #[schemars(range(min = 1))]
    pub every: Option<usize>,
    /// Time between two frames, instead of `every` \[s\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub interval: Option<f64>,
    /// Fields in the frames.
    pub fields: Vec<OutputField>,
    /// Steps between two rows of `probes.csv`.
    #[schemars(range(min = 1))]
    pub probe_every: usize,
    /// Steps between two rows of `energy.csv`, and between two checks for divergence.
    #[schemars(range(min = 1))]
    pub energy_every: usize,
    /// Steps between two checkpoints, from which `arlequin resume` continues. Default: only one on Ctrl-C.
    #[schemars(range(min = 1))]
    pub checkpoint_every: Option<usize>,
    /// True to write `plots/`.
    pub plots: bool,
    /// File format of the frames: `"vtu"`.
    pub format: String,
    /// True to let each of several ranks write its part of the frames of partitioned models, with a `.pvtu`
    /// that lists the parts. If false, rank 0 holds these models whole in memory to write them.
    pub pieces: bool,
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
            format: "vtu".to_owned(),
            pieces: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::drive::{Initial, Motion};
    use super::effect::{BulkViscosity, Contact, Fracture};
    use super::interface::{Absorber, JunctionTable, MediatorTable};
    use super::model::{CnemTable, FemTable, Notch, OwnStepTable};
    use super::probe::Probe;
    use super::sweep::{Axis, Measure, NamedRun, Window};
    use super::{Output, Static, Time};

    /// `Default` must give what a scene gives that leaves all keys of a table out.
    #[test]
    fn default_equals_an_empty_table() {
        macro_rules! check {
            ($($kind:ty),*) => {$(
                let empty: $kind = toml::from_str("").unwrap();
                assert_eq!(format!("{empty:?}"), format!("{:?}", <$kind>::default()), stringify!($kind));
            )*};
        }
        check!(
            Absorber,
            Axis,
            BulkViscosity,
            CnemTable,
            Contact,
            FemTable,
            Fracture,
            Initial,
            JunctionTable
        );
        check!(
            Measure,
            MediatorTable,
            Motion,
            NamedRun,
            Notch,
            Output,
            OwnStepTable,
            Probe,
            Static,
            Time,
            Window
        );
    }
}

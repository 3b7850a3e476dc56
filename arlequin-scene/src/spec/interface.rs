//! Interface tables.

use super::choice::choice;
use super::model::{Element, Shape};
use crate::setup::zone::Piece;
use serde::Deserialize;

pub use arlequin::core::JunctionKind;
pub use arlequin::core::ProfileKind;
use arlequin::core::{Partition, Sampling, Weighting};

/// `[interface.NAME]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// Name of the coarse model.
    pub coarse: String,
    /// Name of the fine model.
    pub fine: String,
    /// Where both models are.
    pub overlap: OverlapShape,
    /// How they share energy, mass and load there.
    #[serde(default)]
    pub weight: WeightTable,
    /// Where the multipliers live.
    #[serde(default)]
    pub mediator: MediatorTable,
    /// The scalar product of the constraint.
    #[serde(default)]
    pub junction: JunctionTable,
    /// How its integrals are sampled; at the particles for a particle field, on the intersection otherwise.
    pub sampling: Option<Sampling>,
    /// How the multipliers are solved for.
    #[serde(default)]
    pub solver: SolverKind,
    /// Lumped multiplier operator.
    #[serde(default)]
    pub lumped: bool,
    /// Whether the weights must sum to one.
    #[serde(default)]
    pub partition: Partition,
    /// Point at which a seminorm pins the models together \[m\].
    pub pin: Option<[f64; 3]>,
    /// Damping of what the coarse model cannot carry.
    pub absorber: Option<Absorber>,
}

/// How multipliers are solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SolverKind {
    /// What is expected to take the least time.
    #[default]
    Auto,
    /// By a factor.
    Factor,
    /// By conjugate gradients to 1e-12.
    ConjugateGradients,
}

/// An overlap.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum OverlapShape {
    /// A layer between two planes normal to the line between two points.
    Slab {
        /// A point of the border to the fine model's own region \[m\].
        fine: [f64; 3],
        /// A point of the border to the coarse model's own region \[m\].
        coarse: [f64; 3],
    },
    /// What an outer region has beyond an inner one.
    Shell {
        /// Region of the fine model alone.
        core: RegionShape,
        /// Whole region of the fine model.
        domain: RegionShape,
    },
    /// The layer of the body's elements around a zone.
    #[serde(skip)]
    Zone(Piece),
}

choice!(
    OverlapShape,
    "{ slab = { fine, coarse } }, { shell = { core, domain } }"
);

/// A simple region.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum RegionShape {
    /// A ball.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
    /// A box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
    /// An infinite circular cylinder.
    Cylinder {
        /// A point of its axis \[m\].
        point: [f64; 3],
        /// Direction of its axis (any length).
        axis: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
}

choice!(
    RegionShape,
    "{ ball = { centre, radius } }, { box = { low, high } }, { cylinder = { point, axis, radius } }"
);

/// Weight functions.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WeightTable {
    /// Profile of all three weights.
    pub profile: ProfileKind,
    /// Value of the constant profile \[–\].
    pub value: Option<f64>,
    /// Smallest weight in the overlap \[–\].
    pub epsilon: Option<f64>,
    /// Smallest weight of the fine model there, if it differs \[–\].
    pub fine_epsilon: Option<f64>,
    /// How the weights enter the models.
    pub weighting: Weighting,
    /// Internal energy, if it differs.
    pub alpha: Option<ProfileTable>,
    /// Kinetic energy, if it differs.
    pub beta: Option<ProfileTable>,
    /// External work, if it differs.
    pub gamma: Option<ProfileTable>,
}

/// One weight of its own.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileTable {
    /// Profile.
    pub profile: ProfileKind,
    /// Value of the constant profile \[–\].
    pub value: Option<f64>,
    /// Smallest weight in the overlap \[–\].
    pub epsilon: Option<f64>,
}

/// The multiplier space.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MediatorTable {
    /// Its body; derived from overlap and models where that is possible.
    pub shape: Option<Shape>,
    /// Length of a unit of the file of its shape \[m\], 1 by default.
    pub scale: Option<f64>,
    /// Target length `h_B` \[m\]; the coarse model's by default.
    pub spacing: Option<f64>,
    /// Number of elements along x, y, z, in place of `spacing`.
    pub divisions: Option<Vec<usize>>,
    /// Element of solids.
    pub element: Element,
}

/// The junction.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JunctionTable {
    /// Which scalar product.
    #[serde(default)]
    pub kind: JunctionKind,
    /// Length `l` \[m\]; a quarter of the mediator's spacing by default.
    pub length: Option<f64>,
}

/// The overlap absorber.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Absorber {
    /// Largest damping rate \[1/s\].
    pub rate: Option<f64>,
    /// Largest damping rate in units of `c/h` of the fine model \[–\], in place of `rate`.
    pub rate_factor: Option<f64>,
    /// Spacing of the space that is left undamped \[m\]; the mediator itself by default.
    pub spacing: Option<f64>,
}

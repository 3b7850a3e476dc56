//! Interface tables.

use super::choice::choice;
use super::model::{Element, Shape};
use super::schema;
use crate::setup::zone::Piece;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use arlequin::core::JunctionKind;
pub use arlequin::core::ProfileKind;
use arlequin::core::{Partition, Sampling, Weighting};

/// `[interface.NAME]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// Name of the coarse model; its `role` must say the same.
    pub coarse: String,
    /// Name of the fine model; its `role` must say the same.
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
    /// How its integrals are sampled: `intersection` (common refinement of all cells, exact), `projection`
    /// (at mediator nodes), `particles`. Default: `particles` if either model has a particle field (the
    /// fine one's points come first), else `intersection`.
    #[schemars(with = "Option<schema::Sampling>")]
    pub sampling: Option<Sampling>,
    /// How the multipliers are solved for.
    #[serde(default)]
    pub solver: SolverKind,
    /// Lumps the multiplier operator; `l2` only, holds the constraint only in the mean.
    #[serde(default)]
    pub lumped: bool,
    /// `checked`: refused unless the weights of the models that are there sum to one at every place, both
    /// fill the overlap alike and the mediator fills it (decision 0024). `unchecked`: a deliberate study.
    /// Default: `checked`.
    #[serde(default)]
    #[schemars(with = "schema::Partition")]
    pub partition: Partition,
    /// Point at which the seminorm pins the models together \[m\]. Default: first mediator node.
    pub pin: Option<[f64; 3]>,
    /// Damping of what the coarse model cannot carry. Default: none.
    pub absorber: Option<Absorber>,
}

/// How multipliers are solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SolverKind {
    /// The factor, unless it is expected to take longer.
    #[default]
    Auto,
    /// By a factor.
    Factor,
    /// By conjugate gradients to 1e-12 of the jump; their result costs no energy wherever they end.
    ConjugateGradients,
    /// By a Chebyshev iteration to 1e-12 of the jump: more iterations, none of which needs a sum over all
    /// ranks.
    Chebyshev,
}

/// An overlap.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum OverlapShape {
    /// A layer between two planes normal to the line between two points.
    Slab {
        /// A point of the border to the fine model's own region \[m\].
        fine: [f64; 3],
        /// A point of the border to the coarse model's own region \[m\].
        coarse: [f64; 3],
    },
    /// What `domain` has beyond `core`; the coarse mesh leaves `core` out.
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
#[derive(Debug, Clone, Deserialize, JsonSchema)]
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
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WeightTable {
    /// Profile of all three weights: `constant`, `linear`, `cubic` (C1), `quintic` (C2),
    /// `mediator-compatible` (C1, exact patch test with `epsilon = 0`). Default: `cubic`; `linear` around a
    /// zone, whose borders may have any form (decision 0041).
    #[schemars(with = "Option<schema::ProfileKind>")]
    pub profile: Option<ProfileKind>,
    /// Coarse weight of the constant profile, 0 to 1 \[–\]; needed by it.
    pub value: Option<f64>,
    /// Smallest weight in the overlap, 0 to below 0.5 \[–\]. Default: 1e-6; 0.05 with nodal weighting, whose
    /// critical step it limits.
    pub epsilon: Option<f64>,
    /// Smallest weight of the fine model there, if it differs \[–\]. Default: `epsilon` if given; 0.1 where
    /// `fracture` is listed for the fine model (decision 0022), else as `epsilon`.
    pub fine_epsilon: Option<f64>,
    /// How the weights enter the models. `energy`: element and bond means in stiffness and mass, conserves
    /// energy. `nodal`: nodal forces and masses, does not. Default: `energy`.
    #[schemars(with = "schema::Weighting")]
    pub weighting: Weighting,
    /// A weight of its own for internal energy. Default: the common one.
    pub alpha: Option<ProfileTable>,
    /// A weight of its own for kinetic energy. Default: the common one.
    pub beta: Option<ProfileTable>,
    /// A weight of its own for external work. Default: the common one.
    pub gamma: Option<ProfileTable>,
}

impl WeightTable {
    /// The common profile.
    pub fn kind(&self) -> ProfileKind {
        self.profile.unwrap_or_default()
    }
}

/// One weight of its own.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProfileTable {
    /// Profile.
    #[schemars(with = "schema::ProfileKind")]
    pub profile: ProfileKind,
    /// Value of the constant profile \[–\].
    pub value: Option<f64>,
    /// Smallest weight in the overlap \[–\].
    pub epsilon: Option<f64>,
}

/// The multiplier space.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MediatorTable {
    /// Its body, as a model's; cylinders are inscribed, those of models have the area of the circle.
    /// Default: the slab's part of the space both models share, or a shell's between its two boxes, if both
    /// are boxes, both the same cylinder or both bars.
    pub shape: Option<Shape>,
    /// Length of a unit of the file of its shape \[m\]. Default: 1.
    pub scale: Option<f64>,
    /// Length `h_B` of the multiplier mesh \[m\]. Default: the coarse model's.
    pub spacing: Option<f64>,
    /// Number of elements along x, y, z, in place of `spacing`.
    pub divisions: Option<Vec<usize>>,
    /// Element of solids.
    pub element: Element,
}

/// The junction.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JunctionTable {
    /// Which scalar product: `l2` (no length to choose), `h1-strain`, `h1-gradient`, `h1-seminorm`.
    /// Default: `l2`.
    #[serde(default)]
    #[schemars(with = "schema::JunctionKind")]
    pub kind: JunctionKind,
    /// Length `l` of the h1 kinds \[m\]. Default: a quarter of the mediator's spacing.
    pub length: Option<f64>,
}

/// The overlap absorber.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Absorber {
    /// Largest damping rate of what the coarse model cannot carry \[1/s\]; grows as `s²` from the fine
    /// border, 0 for none. Default: no absorber; `rate_factor = 0.2` where `fracture` is listed for the
    /// fine model.
    pub rate: Option<f64>,
    /// The same in units of `√(E/ρ)/spacing` of the fine model \[–\], in place of `rate`; 0.2 is a good
    /// value.
    pub rate_factor: Option<f64>,
    /// Length of the space that stays undamped \[m\]. Default: the mediator itself.
    pub spacing: Option<f64>,
}

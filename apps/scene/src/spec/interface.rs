//! Tables of interfaces.

use super::choice::choice;
use super::model::{Element, Shape};
use super::schema;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use arlequin::core::JunctionKind;
pub use arlequin::core::ProfileKind;
use arlequin::core::{Partition, Sampling, Solver, Weighting};

/// `[interface.NAME]`: the coupling of two models.
// `O` is its overlap, as the scene gives it or as set-up derives it.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Interface")]
#[non_exhaustive]
pub struct Interface<O = OverlapShape> {
    /// Name of the coarse model, which must have `role = "coarse"`.
    pub coarse: String,
    /// Name of the fine model, which must have `role = "fine"`.
    pub fine: String,
    /// Region in which both models are present.
    pub overlap: O,
    /// Method that couples the models. A run takes `arlequin`, `nodal` (as `weight.weighting = "nodal"`) and
    /// `lumped` (as `lumped = true`). `arlequin compare` measures all of them side by side.
    #[serde(default)]
    pub method: Method,
    /// Weights by which the models share energy, mass and load in the overlap.
    #[serde(default)]
    pub weight: WeightTable,
    /// The space of the multipliers.
    #[serde(default)]
    pub mediator: MediatorTable,
    /// The scalar product of the constraint.
    #[serde(default)]
    pub junction: JunctionTable,
    /// How the integrals of the constraint are sampled: `intersection` (common refinement of all cells,
    /// exact), `projection` (at mediator nodes), `particles`. Default: `particles` if either model has a
    /// particle field (the fine model's points are preferred), else `intersection`.
    #[schemars(with = "Option<schema::Sampling>")]
    pub sampling: Option<Sampling>,
    /// Solver of the multipliers.
    #[serde(default)]
    pub solver: SolverKind,
    /// True to lump the multiplier operator; `l2` only. The constraint then holds only in the mean.
    #[serde(default)]
    pub lumped: bool,
    /// `checked`: refuses a scene unless the weights of all models sum to one everywhere, both models fill
    /// the overlap alike and the mediator fills it (decision 0024). `unchecked`: no check, for studies.
    /// Default: `checked`.
    #[serde(default)]
    #[schemars(with = "schema::Partition")]
    pub partition: Partition,
    /// Point at which the seminorm ties the models together \[m\]. Default: first mediator node.
    pub pin: Option<[f64; 3]>,
    /// Damping of waves that the coarse model cannot carry. Default: none.
    pub absorber: Option<Absorber>,
}

impl<O> Interface<O> {
    /// Returns the table with another overlap.
    pub(crate) fn with_overlap<T>(self, overlap: T) -> Interface<T> {
        Interface {
            overlap,
            coarse: self.coarse,
            fine: self.fine,
            method: self.method,
            weight: self.weight,
            mediator: self.mediator,
            junction: self.junction,
            sampling: self.sampling,
            solver: self.solver,
            lumped: self.lumped,
            partition: self.partition,
            pin: self.pin,
            absorber: self.absorber,
        }
    }
}

/// Methods that couple a coarse and a fine model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Energies weighted by elements and bonds, multipliers on a mediator.
    #[default]
    Arlequin,
    /// The default, with forces and masses weighted at the nodes.
    Nodal,
    /// The default, with the operator of the multipliers lumped to its row sums.
    Lumped,
    /// A lumped operator whose multipliers correct velocities only, not accelerations.
    LumpedVelocities,
    /// Models that meet in one layer of particles, each tied to the coarse field.
    Edge,
    /// One layer, tied in the mean by the shape functions of the coarse model.
    EdgeWeak,
    /// Springs between each particle of the overlap and the coarse field.
    Penalty,
    /// Multipliers found by two iterations with a penalty (augmented Lagrangian).
    Augmented,
    /// Weighted energies of one field: particles of the overlap follow the coarse model.
    Blend,
    /// The coarse energy of a zone is replaced by that of its particles; those beside it follow the coarse
    /// model.
    Oniom,
    /// Coarse model everywhere, particles in a zone with the force of those that are left out (on a line
    /// only).
    BridgingScale,
    /// Scheme of Gravouil and Combescure: multipliers at the own steps of the fine model.
    Gc,
    /// Scheme of Prakash and Hjelmstad: multipliers linear within a step of the run.
    Ph,
    /// Overlapping Schwarz alternation: each model takes the motion of the other at its border.
    Schwarz,
    /// Particles everywhere; those of the coarse region follow the coarse mesh, and all bonds are summed.
    Quasicontinuum,
    /// Quasicontinuum with bonds summed near the nodes of the mesh only.
    QuasicontinuumClusters,
}

impl Method {
    /// All methods, the default first.
    pub const ALL: [Self; 16] = [
        Self::Arlequin,
        Self::Nodal,
        Self::Lumped,
        Self::LumpedVelocities,
        Self::Edge,
        Self::EdgeWeak,
        Self::Penalty,
        Self::Augmented,
        Self::Blend,
        Self::Oniom,
        Self::BridgingScale,
        Self::Gc,
        Self::Ph,
        Self::Schwarz,
        Self::Quasicontinuum,
        Self::QuasicontinuumClusters,
    ];

    /// Returns the word that scenes use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Arlequin => "arlequin",
            Self::Nodal => "nodal",
            Self::Lumped => "lumped",
            Self::LumpedVelocities => "lumped-velocities",
            Self::Edge => "edge",
            Self::EdgeWeak => "edge-weak",
            Self::Penalty => "penalty",
            Self::Augmented => "augmented",
            Self::Blend => "blend",
            Self::Oniom => "oniom",
            Self::BridgingScale => "bridging-scale",
            Self::Gc => "gc",
            Self::Ph => "ph",
            Self::Schwarz => "schwarz",
            Self::Quasicontinuum => "quasicontinuum",
            Self::QuasicontinuumClusters => "quasicontinuum-clusters",
        }
    }
}

/// Solvers of the multipliers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SolverKind {
    /// By a factor, unless the iteration is expected to be faster.
    #[default]
    Auto,
    /// By a factorisation of the operator.
    Factor,
    /// By conjugate gradients to 1e-12 of the jump; the result creates no energy even if the iteration ends
    /// early.
    ConjugateGradients,
}

impl From<SolverKind> for Solver<f64> {
    fn from(kind: SolverKind) -> Self {
        match kind {
            SolverKind::Auto => Self::Auto,
            SolverKind::Factor => Self::Factor,
            SolverKind::ConjugateGradients => Self::conjugate_gradients(),
        }
    }
}

/// An overlap.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum OverlapShape {
    /// A layer between two planes normal to the line between two points.
    Slab {
        /// A point of the border to the fine model's own region \[m\].
        fine: [f64; 3],
        /// A point of the border to the coarse model's own region \[m\].
        coarse: [f64; 3],
    },
    /// The part of `domain` outside `core`; the coarse mesh leaves `core` out.
    Shell {
        /// Region of the fine model alone.
        core: RegionShape,
        /// Whole region of the fine model.
        domain: RegionShape,
    },
}

choice!(
    OverlapShape,
    "{ slab = { fine, coarse } }, { shell = { core, domain } }"
);

/// A simple region.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum RegionShape {
    /// A ball.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
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
        /// A point of the axis \[m\].
        point: [f64; 3],
        /// Direction of the axis (any length).
        #[schemars(transform = schema::not_zero)]
        axis: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
}

choice!(
    RegionShape,
    "{ ball = { centre, radius } }, { box = { low, high } }, { cylinder = { point, axis, radius } }"
);

/// Weight functions of the models in the overlap.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(transform = schema::value_if_constant)]
#[non_exhaustive]
pub struct WeightTable {
    /// Profile of all three weights: `constant`, `linear`, `cubic` (C1), `quintic` (C2),
    /// `mediator-compatible` (C1, exact patch test with `epsilon = 0`). Default: `cubic`; `linear` around a
    /// zone, whose borders may have any form (decision 0041).
    #[schemars(with = "Option<schema::ProfileKind>")]
    pub profile: Option<ProfileKind>,
    /// Coarse weight of the constant profile, 0 to 1 \[–\]; required by `constant`.
    #[schemars(range(min = 0, max = 1))]
    pub value: Option<f64>,
    /// Floor: smallest weight in the overlap, 0 to below 0.5 \[–\]. Default: 1e-6; 0.05 with nodal weighting,
    /// where it limits the critical step.
    #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 0.5))]
    pub epsilon: Option<f64>,
    /// Floor of the fine model's weight, if it differs \[–\]. Default: `epsilon` if given; 0.1 if `fracture`
    /// is listed for the fine model (decision 0022); else the default of `epsilon`.
    #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 0.5))]
    pub fine_epsilon: Option<f64>,
    /// How the weights enter the models. `energy`: weights stiffness and mass by means over elements and
    /// bonds; conserves energy. `nodal`: weights nodal forces and masses; does not conserve energy. Default:
    /// `energy`.
    #[schemars(with = "schema::Weighting")]
    pub weighting: Weighting,
    /// Separate weight of internal energy. Default: the common one.
    pub alpha: Option<ProfileTable>,
    /// Separate weight of kinetic energy. Default: the common one.
    pub beta: Option<ProfileTable>,
    /// Separate weight of external work. Default: the common one.
    pub gamma: Option<ProfileTable>,
}

impl WeightTable {
    /// Returns the common profile.
    pub fn kind(&self) -> ProfileKind {
        self.profile.unwrap_or_default()
    }

    /// Returns whether the weight at a point depends on the position across the overlap alone, and not on all
    /// nodes of the mediator.
    pub fn is_local(&self) -> bool {
        let separate = [&self.alpha, &self.beta, &self.gamma].into_iter().flatten();
        let mut kinds = separate.map(|t| t.profile).chain([self.kind()]);
        kinds.all(|kind| kind != ProfileKind::MediatorCompatible)
    }

    /// Values \[–\] of the constant profiles of energies.
    pub(crate) fn constants(&self) -> impl Iterator<Item = f64> {
        let separate = [&self.alpha, &self.beta].map(|t| t.as_ref().and_then(|t| t.value));
        separate.into_iter().chain([self.value]).flatten()
    }
}

/// A separate weight.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::value_if_constant)]
#[non_exhaustive]
pub struct ProfileTable {
    /// Profile.
    #[schemars(with = "schema::ProfileKind")]
    pub profile: ProfileKind,
    /// Value of the constant profile \[–\].
    #[schemars(range(min = 0, max = 1))]
    pub value: Option<f64>,
    /// Floor: smallest weight in the overlap \[–\].
    #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 0.5))]
    pub epsilon: Option<f64>,
}

/// Space of the multipliers.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct MediatorTable {
    /// Body of the multiplier mesh, as for a model; its cylinders are inscribed, whereas those of models have
    /// the area of the circle. Default: if both models are boxes, the same cylinder or bars, the slab's part
    /// of their common space, or the space between the two boxes of a shell.
    pub shape: Option<Shape>,
    /// Length of one unit of the file in `shape` \[m\]. Default: 1.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub scale: Option<f64>,
    /// Length `h_B` of the multiplier mesh \[m\]. Default: that of the coarse model.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing: Option<f64>,
    /// Number of elements along x, y, z, instead of `spacing`.
    #[schemars(length(min = 1, max = 3), inner(range(min = 1)))]
    pub divisions: Option<Vec<usize>>,
    /// Element type of solids.
    pub element: Element,
}

/// Scalar product of the constraint.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("dependencies" = {
    "length": { "required": ["kind"], "properties": { "kind": { "not": { "const": "l2" } } } },
}))]
#[non_exhaustive]
pub struct JunctionTable {
    /// Scalar product: `l2` (no length to choose), `h1-strain`, `h1-gradient`, `h1-seminorm`. Default: `l2`.
    #[serde(default)]
    #[schemars(with = "schema::JunctionKind")]
    pub kind: JunctionKind,
    /// Length `l` of the h1 kinds \[m\]. Default: a quarter of the mediator's spacing.
    #[schemars(range(min = 0))]
    pub length: Option<f64>,
}

/// Damping of waves in the overlap that the coarse model cannot carry.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("rate rate_factor"))]
#[non_exhaustive]
pub struct Absorber {
    /// Largest damping rate of waves that the coarse model cannot carry \[1/s\]; it grows as `s²` from 0 at
    /// the fine border. Default: no absorber; `rate_factor = 0.2` if `fracture` is listed for the fine model.
    #[schemars(range(min = 0))]
    pub rate: Option<f64>,
    /// Rate in units of `√(E/ρ)/spacing` of the fine model \[–\], instead of `rate`; 0.2 is a good value.
    #[schemars(range(min = 0))]
    pub rate_factor: Option<f64>,
    /// Node distance of the space of motions that stay undamped \[m\]. Default: the mediator itself.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing: Option<f64>,
}

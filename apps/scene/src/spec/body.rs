//! `[zone.NAME]`: where a fine model takes the place of the body's, and which.

use super::choice::choice;
use super::interface::{Absorber, JunctionTable, RegionShape, SolverKind, WeightTable};
use super::model::{CnemTable, DemTable, FemTable, Material, ModelKind, OwnStepTable};
use super::schema;
use arlequin::core::{Partition, Sampling};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

/// `[zone.NAME]`: a fine model where it is wanted, coupled to that of `[body]` in a layer around it. The
/// model and the interface bear the name of the zone.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZoneTable {
    /// Which model: `fem`, `cnem` or `dem`.
    pub kind: ModelKind,
    /// Where it is wanted: the elements of the body that lie there, wholly or in part, are replaced.
    pub shape: ZoneShape,
    /// Length of a unit of the files of that shape \[m\]. Default: that of the body's file.
    pub scale: Option<f64>,
    /// The layer around it in which both models are.
    pub overlap: ZoneOverlap,
    /// Mean diameter of spheres; longest distance of nodes, reached by halving the body's elements, once at
    /// least \[m\]. Default: none; spheres may have `dem.count` or `dem.file` in its place.
    pub spacing: Option<f64>,
    /// What it is made of. Default: what the body is made of, with its `materials`.
    pub material: Option<Material>,
    /// How it steps between two reflections, where it is not to be chosen.
    pub step: Option<OwnStepTable>,
    /// Choices of finite elements; read by `kind = "fem"` only.
    #[serde(default)]
    pub fem: FemTable,
    /// Choices of natural elements; read by `kind = "cnem"` only.
    #[serde(default)]
    pub cnem: CnemTable,
    /// Choices of particles; read by `kind = "dem"` only.
    #[serde(default)]
    pub dem: DemTable,
    /// How the models share energy, mass and load in the layer.
    #[serde(default)]
    pub weight: WeightTable,
    /// Where the multipliers live.
    #[serde(default)]
    pub mediator: ZoneMediator,
    /// The scalar product of the constraint.
    #[serde(default)]
    pub junction: JunctionTable,
    /// How its integrals are sampled, as in an interface.
    #[schemars(with = "Option<schema::Sampling>")]
    pub sampling: Option<Sampling>,
    /// How the multipliers are solved for.
    #[serde(default)]
    pub solver: SolverKind,
    /// Whether the weights must sum to one: `checked` (default) or `unchecked`.
    #[serde(default)]
    #[schemars(with = "schema::Partition")]
    pub partition: Partition,
    /// Damping of what the body's model cannot carry; without `spacing`.
    pub absorber: Option<Absorber>,
}

/// The layer around a zone.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZoneOverlap {
    /// How far it reaches from the zone \[m\], up to whole elements of the body; three elements or more.
    pub width: f64,
}

/// The multiplier space of a zone, on the body's elements in the layer.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ZoneMediator {
    /// Longest distance of its nodes \[m\], reached by halving these elements. With that of a `fem` zone
    /// uniform strain passes exactly, at the price of more multipliers and more reflection. Default: the
    /// elements as they are.
    pub spacing: Option<f64>,
}

/// Where a fine model is wanted.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum ZoneShape {
    /// In a ball.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
    /// In a box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
    /// In an infinite circular cylinder.
    Cylinder {
        /// A point of its axis \[m\].
        point: [f64; 3],
        /// Direction of its axis (any length).
        axis: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
    /// Near the facets of a named group of the body (its nodes, where it has none: a crack front, a point),
    /// or near the triangles of an STL file, which need not be closed.
    Near {
        /// The group.
        group: Option<String>,
        /// The STL file, relative to the scene file, in place of a group.
        file: Option<PathBuf>,
        /// How near \[m\].
        distance: f64,
    },
    /// Inside a closed STL surface; relative to the scene file.
    File(PathBuf),
}

impl ZoneShape {
    /// The region that it is by itself, without the body or a file.
    pub fn simple(&self) -> Option<RegionShape> {
        match *self {
            Self::Ball { centre, radius } => Some(RegionShape::Ball { centre, radius }),
            Self::Box { low, high } => Some(RegionShape::Box { low, high }),
            Self::Cylinder { point, axis, radius } => Some(RegionShape::Cylinder { point, axis, radius }),
            Self::Near { .. } | Self::File(_) => None,
        }
    }
}

choice!(
    ZoneShape,
    "{ ball = { centre, radius } }, { box = { low, high } }, { cylinder = { point, axis, radius } }, { near = { group or \
     file, distance } }, { file = path }"
);

//! `[zone.NAME]`: a fine model that replaces the body's model in a region.

use super::choice::choice;
use super::follow::Follow;
use super::interface::{Absorber, JunctionTable, RegionShape, SolverKind, WeightTable};
use super::model::{CnemTable, DemTable, FemTable, Material, ModelKind, OwnStepTable};
use super::schema;
use arlequin::core::{Partition, Sampling};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;

/// `[zone.NAME]`: a fine model in a part of `[body]`, coupled to the body's model in a layer around that
/// part. The model and the interface have the name of the zone.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("anyOf" = [{ "required": ["shape"] }, { "required": ["follow"] }]))]
#[non_exhaustive]
pub struct ZoneTable {
    /// Kind of the model: `fem`, `cnem` or `dem`.
    #[schemars(extend("enum" = ["fem", "cnem", "dem"]))]
    pub kind: ModelKind,
    /// Region of the fine model: it replaces the elements of the body that lie in the region, wholly or in
    /// part. A zone that follows may begin without one: all spheres then sleep at first.
    pub shape: Option<ZoneShape>,
    /// Length of one unit of the files in `shape` \[m\]. Default: `scale` of the body.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub scale: Option<f64>,
    /// The layer around the region in which both models are present.
    pub overlap: ZoneOverlap,
    /// Mean diameter of spheres, or longest distance between nodes \[m\]; nodes get there by halving the
    /// body's elements at least once. Spheres may give `dem.count` or `dem.file` instead. Default: none.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing: Option<f64>,
    /// Material of the zone. Default: that of the body, with its `materials`.
    pub material: Option<Material>,
    /// How the model steps between two reflections. Default: chosen by the program.
    pub step: Option<OwnStepTable>,
    /// Settings of finite elements; read by `kind = "fem"` only.
    #[serde(default)]
    pub fem: FemTable,
    /// Settings of natural elements; read by `kind = "cnem"` only.
    #[serde(default)]
    pub cnem: CnemTable,
    /// Settings of particles; read by `kind = "dem"` only.
    #[serde(default)]
    pub dem: DemTable,
    /// Weights by which the models share energy, mass and load in the layer.
    #[serde(default)]
    pub weight: WeightTable,
    /// The space of the multipliers.
    #[serde(default)]
    pub mediator: ZoneMediator,
    /// The scalar product of the constraint.
    #[serde(default)]
    pub junction: JunctionTable,
    /// How the integrals of the constraint are sampled, as in an interface.
    #[schemars(with = "Option<schema::Sampling>")]
    pub sampling: Option<Sampling>,
    /// Solver of the multipliers.
    #[serde(default)]
    pub solver: SolverKind,
    /// Check that the weights sum to one: `checked` (default) or `unchecked`.
    #[serde(default)]
    #[schemars(with = "schema::Partition")]
    pub partition: Partition,
    /// Damping of waves that the body's model cannot carry; give it without `spacing`.
    #[schemars(extend("not" = { "required": ["spacing"] }))]
    pub absorber: Option<Absorber>,
    /// Lets the zone go where it is needed: `true`, or a table with its limits. It needs `kind = "dem"` and
    /// no other zone. Spheres fill the whole body, or `follow.within`; `shape` is where the zone begins.
    #[serde(default)]
    pub follow: Follow,
}

/// The layer around a zone.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ZoneOverlap {
    /// Distance from the zone to the outer border of the layer \[m\], rounded up to whole elements of the
    /// body; at least three elements.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub width: f64,
}

/// The multiplier space of a zone, on the body's elements in the layer.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct ZoneMediator {
    /// Longest distance between mediator nodes \[m\], reached by halving the body's elements in the layer.
    /// With the spacing of a `fem` zone, uniform strain passes exactly, at the price of more multipliers and
    /// more reflection. Default: the elements are not halved.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing: Option<f64>,
}

/// Region of a fine model.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ZoneShape {
    /// The inside of a ball.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// The inside of a box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
    /// The inside of an infinite circular cylinder.
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
    /// Points near the facets of a named group of the body, or near its nodes if it has no facets (a crack
    /// front, a point); or near the triangles of an STL file, which need not be closed.
    #[schemars(extend("dependencies" = { "near": { "properties": {
        "near": { "oneOf": [{ "required": ["group"] }, { "required": ["file"] }] },
    } } }))]
    Near {
        /// Name of the group.
        group: Option<String>,
        /// The STL file, relative to the scene file, instead of a group.
        file: Option<PathBuf>,
        /// Largest distance \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        distance: f64,
    },
    /// The inside of a closed STL surface, relative to the scene file.
    File(PathBuf),
    /// All points of several of these regions, which may lie apart: a zone with several parts.
    Union(#[schemars(length(min = 1))] Vec<Self>),
}

impl ZoneShape {
    /// Returns the region if neither the body nor a file is needed to know it.
    pub fn simple(&self) -> Option<RegionShape> {
        match *self {
            Self::Ball { centre, radius } => Some(RegionShape::Ball { centre, radius }),
            Self::Box { low, high } => Some(RegionShape::Box { low, high }),
            Self::Cylinder { point, axis, radius } => Some(RegionShape::Cylinder { point, axis, radius }),
            Self::Near { .. } | Self::File(_) | Self::Union(_) => None,
        }
    }
}

choice!(
    ZoneShape,
    "{ ball = { centre, radius } }, { box = { low, high } }, { cylinder = { point, axis, radius } }, { near = { group or \
     file, distance } }, { file = path }, { union = [ … ] }"
);

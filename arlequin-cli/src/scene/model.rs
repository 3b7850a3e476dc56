//! Model tables.

use serde::Deserialize;
use std::path::PathBuf;

/// `[model.NAME]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModelTable {
    /// Which model.
    pub(crate) kind: Kind,
    /// Its part in the coupling; without one it stands alone.
    pub(crate) role: Option<RoleKind>,
    /// Its body.
    pub(crate) shape: Shape,
    /// Target distance of nodes or particles \[m\].
    pub(crate) spacing: Option<f64>,
    /// Number of elements along x (y, z), in place of `spacing`.
    pub(crate) divisions: Option<Vec<usize>>,
    /// What it is made of.
    pub(crate) material: Material,
    /// Choices of finite elements; read by `kind = "fem"` only.
    #[serde(default)]
    pub(crate) fem: FemTable,
}

/// Kinds of models. Adding one: a variant here, a branch in `build::kinds`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Kind {
    /// Linear finite elements.
    Fem,
    /// Harmonic spring chain along x.
    Chain,
}

/// The part of a model in its interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RoleKind {
    /// Receives the weight.
    Coarse,
    /// Receives its complement.
    Fine,
}

impl RoleKind {
    /// Name as in the scene.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Coarse => "coarse",
            Self::Fine => "fine",
        }
    }
}

/// A body.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum Shape {
    /// A box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
    /// A circular cylinder along x.
    Cylinder {
        /// Centre of the face with the smaller x \[m\].
        from: [f64; 3],
        /// Length along x \[m\].
        length: f64,
        /// Radius \[m\].
        radius: f64,
    },
    /// A line along x with a cross-section.
    Bar {
        /// First end \[m\].
        from: f64,
        /// Other end \[m\].
        to: f64,
        /// Cross-section \[m²\].
        section: f64,
    },
    /// A Gmsh mesh, relative to the scene file.
    File(PathBuf),
}

impl Shape {
    /// Key of the variant.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Box { .. } => "box",
            Self::Cylinder { .. } => "cylinder",
            Self::Bar { .. } => "bar",
            Self::File(_) => "file",
        }
    }
}

/// Isotropic linear elasticity.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Material {
    /// Young's modulus \[Pa\].
    pub(crate) young: f64,
    /// Poisson's ratio \[–\]; solids need it.
    pub(crate) poisson: Option<f64>,
    /// Density \[kg/m³\].
    pub(crate) density: f64,
}

/// Choices of finite elements.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FemTable {
    /// Element of boxes and cylinders.
    #[serde(default)]
    pub(crate) element: Element,
}

/// Elements of solids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Element {
    /// Eight-node hexahedra: far less stiff in bending than tetrahedra of the same size, hence the default.
    #[default]
    Hex8,
    /// Four-node tetrahedra.
    Tet4,
}

//! Model tables.

use super::choice::choice;
use crate::setup::zone::Piece;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Kinds of models, by their names in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// Linear finite elements.
    Fem,
    /// Constrained natural elements.
    Cnem,
    /// Spheres joined by cohesive beams.
    Dem,
    /// Harmonic spring chain along x.
    Chain,
}

impl ModelKind {
    /// Whether it has elements with a strain.
    pub fn is_continuum(self) -> bool {
        matches!(self, Self::Fem | Self::Cnem)
    }
}

/// `[model.NAME]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelTable {
    /// Which model.
    pub kind: ModelKind,
    /// Its part in the coupling; without one it stands alone.
    pub role: Option<RoleKind>,
    /// Its body.
    pub shape: Shape,
    /// Target distance of nodes or particles \[m\].
    pub spacing: Option<f64>,
    /// Number of elements along x (y, z), in place of `spacing`.
    pub divisions: Option<Vec<usize>>,
    /// Length of a unit of the file of its shape \[m\]: 1e-3 for one in millimetres.
    #[serde(default = "metre")]
    pub scale: f64,
    /// Physical volume of its mesh file that it fills; all of them by default.
    pub volume: Option<String>,
    /// What it is made of.
    pub material: Material,
    /// Physical volumes of its mesh file that are made of something else, by their names.
    #[serde(default)]
    pub materials: BTreeMap<String, Material>,
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
}

impl ModelTable {
    /// Whether it has elements that fill a volume.
    pub fn has_volume(&self) -> bool {
        self.kind.is_continuum() && !matches!(self.shape, Shape::Bar { .. })
    }
}

/// Files are in metres unless they say otherwise.
fn metre() -> f64 {
    1.0
}

/// How a model steps between two reflections: one of `ratio`, `fraction`, or the implicit scheme.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OwnStepTable {
    /// Number of its own steps in a step of the run.
    pub ratio: Option<usize>,
    /// Longest own step in units of its own critical step.
    pub fraction: Option<f64>,
    /// The scheme.
    pub scheme: Option<Scheme>,
}

/// Time stepping schemes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Velocity Verlet.
    Explicit,
    /// Average acceleration, one step in each of the run; for solids.
    Implicit,
}

/// The part of a model in its interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoleKind {
    /// Receives the weight.
    Coarse,
    /// Receives its complement.
    Fine,
}

impl RoleKind {
    /// Name as in the scene.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coarse => "coarse",
            Self::Fine => "fine",
        }
    }
}

/// A body.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum Shape {
    /// A box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
        /// What is left out of it.
        hole: Option<Hole>,
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
    /// A ball.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
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
    /// A mesh, or for particles and natural elements also an STL surface; relative to the scene file.
    File(PathBuf),
    /// What `[body]` and `[zone.NAME]` leave to one of their models.
    #[serde(skip)]
    Piece(Piece),
}

choice!(
    Shape,
    "{ box = { low, high } }, { cylinder = { from, length, radius } }, { ball = { centre, radius } }, { bar = { from, to, section \
     } }, { file = path }"
);

/// A box left out of a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hole {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
}

impl Shape {
    /// Key of the variant.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Box { .. } => "box",
            Self::Cylinder { .. } => "cylinder",
            Self::Ball { .. } => "ball",
            Self::Bar { .. } => "bar",
            Self::File(_) => "file",
            Self::Piece(_) => "a part of the body",
        }
    }
}

/// Isotropic linear elasticity.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Young's modulus \[Pa\].
    pub young: f64,
    /// Poisson's ratio \[–\]; solids need it.
    pub poisson: Option<f64>,
    /// Density \[kg/m³\].
    pub density: f64,
}

/// Choices of finite elements.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FemTable {
    /// Element of boxes and cylinders.
    #[serde(default)]
    pub element: Element,
}

/// Elements of solids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Element {
    /// Eight-node hexahedra: far less stiff in bending than tetrahedra of the same size, hence the default.
    #[default]
    Hex8,
    /// Four-node tetrahedra.
    Tet4,
}

/// Choices of natural elements.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CnemTable {
    /// Shape functions.
    pub functions: Option<Functions>,
    /// Share of the stabilisation, 0 for none.
    pub stabilisation: Option<f64>,
    /// Which nodes carry the mass of a cell.
    pub inertia: Option<Masses>,
}

/// Masses of natural elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Masses {
    /// The cell's own node.
    Cells,
    /// The nodes around its centroid.
    Centroids,
}

/// Natural-neighbour functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Functions {
    /// Volumes stolen from the neighbours.
    Sibson,
    /// Areas over distances.
    Laplace,
}

/// Choices of particles.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DemTable {
    /// Number of spheres, in place of `spacing`.
    pub count: Option<usize>,
    /// Seed of the random start.
    pub seed: Option<u64>,
    /// How the packing is compacted.
    pub protocol: Option<Protocol>,
    /// Spheres from a file (CSV, VTU) in place of a packing of ours, relative to the scene file.
    pub file: Option<PathBuf>,
    /// Name of the array of radii in a VTU file.
    pub radii: Option<String>,
    /// Bonds per particle times two.
    pub coordination: Option<f64>,
    /// Young's modulus of the beams \[Pa\].
    pub young: Option<f64>,
    /// Poisson's ratio of the beams \[–\].
    pub poisson: Option<f64>,
    /// Beam radius over mean particle radius \[–\].
    pub radius_ratio: Option<f64>,
    /// Field that interfaces see.
    pub field: ParticleFieldKind,
    /// Whether rotations may be large.
    pub finite_rotations: bool,
    /// What becomes of spheres that no bonds join to a part.
    pub loose: LooseKind,
    /// Boxes that no bond crosses.
    pub notch: Vec<NotchBox>,
}

/// A box that cuts all bonds that pass through it.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NotchBox {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
}

/// Spheres without bonds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LooseKind {
    /// Left out; refused if they are many.
    #[default]
    Drop,
    /// Kept as loose grains; they need contact.
    Keep,
}

/// How spheres are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// Grown to the onset of jamming: the elasticity comes out by itself.
    Onset,
    /// One quench at a fixed volume fraction: some seconds faster, a few per cent stiffer.
    Quench,
}

/// Displacement field of particles in an overlap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ParticleFieldKind {
    /// The particles themselves are the integration points.
    #[default]
    Particles,
    /// Natural neighbours between the centres.
    Natural,
}

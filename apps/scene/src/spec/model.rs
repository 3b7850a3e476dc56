//! Model tables.

use super::choice::choice;
use super::drive::Selection;
use super::schema;
use crate::setup::zone::Piece;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Kinds of models, by their names in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// Linear finite elements.
    Fem,
    /// Constrained natural elements on the nodes of the same mesh.
    Cnem,
    /// A random packing of spheres joined by cohesive beams; shapes `box`, `cylinder`, `file`.
    Dem,
    /// Masses `ρ S r` (half at the ends) and springs `E S/r` along x; shape `bar`, role `fine` only.
    Chain,
    /// A solver in another process, which brings its own nodes, masses and steps; needs `command` or
    /// `address`, and takes neither `shape` nor `material`.
    Link,
}

impl ModelKind {
    /// Whether it has elements with a strain.
    pub fn is_continuum(self) -> bool {
        matches!(self, Self::Fem | Self::Cnem)
    }
}

/// `[model.NAME]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::but_for_links())]
pub struct ModelTable {
    /// Which model; exchanging it is this one word.
    pub kind: ModelKind,
    /// Its part in the coupling; needed by a model that takes part in an interface.
    pub role: Option<RoleKind>,
    /// Its body. Default: needed by all kinds but `link`.
    #[serde(default = "unsaid_shape")]
    pub shape: Shape,
    /// Target distance of nodes, mean diameter of spheres \[m\]; needed unless `divisions` or a mesh file
    /// says it.
    pub spacing: Option<f64>,
    /// Number of elements along each direction (three for a box, one for a bar), in place of `spacing`.
    pub divisions: Option<Vec<usize>>,
    /// Length of a unit of the file of its shape \[m\]: 1e-3 for one in millimetres. Default: 1.
    #[serde(default = "metre")]
    pub scale: f64,
    /// Physical volume of its mesh file that it fills. Default: all of them.
    pub volume: Option<String>,
    /// Cracks, each a group or a box: the faces between two elements all of whose nodes lie in it are
    /// parted into two lips with nodes of their own. A box without thickness is a cut along a plane of the
    /// mesh. For `fem` and `cnem`; for `dem` see `dem.notch`. Default: none but the slits of a mesh file.
    #[serde(default)]
    pub crack: Vec<Selection>,
    /// What it is made of. Default: needed by all kinds but `link`.
    #[serde(default = "unsaid_material")]
    pub material: Material,
    /// Physical volumes of its mesh file that are made of something else, by name (the first group that a
    /// volume belongs to); `poisson` is that of `material` where it is left out. For `fem` and `dem`: beams
    /// of spheres are stiffer or softer in the ratio of the moduli, a bond between two is half of each in a
    /// row; not with `fracture`.
    #[serde(default)]
    pub materials: BTreeMap<String, Material>,
    /// How it steps between two reflections. Default: chosen, see `time`.
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
    /// Program and arguments that the run starts, in the folder of the scene; the program finds where to
    /// connect in the environment variable `ARLEQUIN_LINK`. For `kind = "link"` only: whoever runs the
    /// scene runs this.
    pub command: Option<Vec<String>>,
    /// Where the run waits for a program that somebody else starts, in place of `command`: `unix:PATH`,
    /// `tcp:127.0.0.1:PORT`, or `tcp-open:IP:PORT` on a network that is closed to strangers.
    pub address: Option<String>,
    /// How long the program may take to answer \[s\]; for `kind = "link"`. Default: 4.
    pub timeout: Option<f64>,
    /// How long the program may take to start and to connect \[s\]; for `kind = "link"`. Default: 30, or
    /// `timeout` if that is longer.
    pub start_timeout: Option<f64>,
}

/// That of a link; others are told that it is missing.
fn unsaid_shape() -> Shape {
    Shape::Linked
}

/// The same of its material: numbers that no scene can say.
fn unsaid_material() -> Material {
    Material {
        young: f64::NAN,
        poisson: None,
        density: f64::NAN,
    }
}

impl ModelTable {
    /// The key that this kind of model needs and does not have, if there is one.
    pub(crate) fn missing(&self) -> Option<&'static str> {
        match self.kind {
            ModelKind::Link => None,
            _ if matches!(self.shape, Shape::Linked) => Some("shape"),
            _ if self.material.young.is_nan() => Some("material"),
            _ => None,
        }
    }

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
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OwnStepTable {
    /// Number of the model's own steps in a step of the run, at least 1.
    pub ratio: Option<usize>,
    /// Longest own step in units of the model's own critical step, above 0 and at most 1 \[–\].
    pub fraction: Option<f64>,
    /// The scheme. Default: `explicit`.
    pub scheme: Option<Scheme>,
}

/// Time stepping schemes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Velocity Verlet; goes with `ratio` or `fraction`.
    Explicit,
    /// One step of average acceleration in each of the run, without a critical step; for `fem`, `cnem` and
    /// `chain`, with dead loads, body forces and supports only.
    Implicit,
}

/// The part of a model in its interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
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
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum Shape {
    /// A box along the axes. Groups `x-min`, `x-max`, `y-min`, … `z-max`.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
        /// What is left out of it, for meshes: elements inside that box, where a fine model is alone. Its
        /// faces lie between elements, or beyond the box, where it is open.
        hole: Option<Hole>,
    },
    /// A circular cylinder along x. Groups `x-min`, `x-max`, `side`.
    Cylinder {
        /// Centre of the face with the smaller x \[m\].
        from: [f64; 3],
        /// Length along x \[m\].
        length: f64,
        /// Radius \[m\].
        radius: f64,
    },
    /// A ball. Group `surface`; none for particles.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        radius: f64,
    },
    /// A line on the x axis with a cross-section, which moves along x only. Groups `x-min`, `x-max`.
    Bar {
        /// First end \[m\].
        from: f64,
        /// Other end \[m\].
        to: f64,
        /// Cross-section \[m²\].
        section: f64,
    },
    /// A Gmsh mesh (4.1 or 2.2, text or binary), relative to the scene file; it brings its own spacing and
    /// named groups. Elements of second order are read as linear ones, with a warning. Particles fill its
    /// outer surface (or the closed surface mesh it holds), or that of an STL file (no groups); so do nodes
    /// of `cnem`, `spacing` apart.
    File(PathBuf),
    /// What `[body]` and `[zone.NAME]` leave to one of their models.
    #[serde(skip)]
    Piece(Piece),
    /// What only the program behind a link knows.
    #[serde(skip)]
    Linked,
}

choice!(
    Shape,
    "{ box = { low, high } }, { cylinder = { from, length, radius } }, { ball = { centre, radius } }, { bar = { from, to, section \
     } }, { file = path }"
);

/// A box left out of a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
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
            Self::Linked => "that of a link",
        }
    }
}

/// Isotropic linear elasticity.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Young's modulus, positive \[Pa\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub young: f64,
    /// Poisson's ratio, from −0.9999 to 0.49995 \[–\]; solids need it. That of a packing follows from its
    /// beams: a value that differs is warned of.
    #[schemars(extend("exclusiveMinimum" = -1, "exclusiveMaximum" = 0.5))]
    pub poisson: Option<f64>,
    /// Density, positive \[kg/m³\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub density: f64,
}

/// Choices of finite elements.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FemTable {
    /// Element of boxes and cylinders.
    #[serde(default)]
    pub element: Element,
}

/// Elements of solids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Element {
    /// Eight-node hexahedra: far less stiff in bending than tetrahedra of the same size, hence the default.
    #[default]
    Hex8,
    /// Four-node tetrahedra.
    Tet4,
}

/// Choices of natural elements.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CnemTable {
    /// Shape functions. Default: `laplace`.
    pub functions: Option<Functions>,
    /// Share of the cure of spurious modes, 0 (none) to 1 \[–\]. Default: 0.1.
    pub stabilisation: Option<f64>,
    /// Which nodes carry the mass of a cell. Default: `cells`.
    pub inertia: Option<Masses>,
}

/// Masses of natural elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Masses {
    /// The cell's own node.
    Cells,
    /// The nodes around its centroid: torsion of coarse bodies is right; static fields under body forces
    /// are less accurate, the critical step is 4 to 7 % shorter for a model alone and longer where weights
    /// are small, 1.25 times in `beam-cnem.toml`.
    Centroids,
}

/// Natural-neighbour functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Functions {
    /// Volumes stolen from the neighbours.
    Sibson,
    /// Areas over distances.
    Laplace,
}

/// Choices of particles.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DemTable {
    /// Number of spheres, in place of `spacing`.
    pub count: Option<usize>,
    /// Seed of the random start; same seed, same packing, for any number of threads. Default: 1.
    pub seed: Option<u64>,
    /// How the packing is compacted. Default: `onset`.
    pub protocol: Option<Protocol>,
    /// Spheres from a file in place of a packing of ours, in m, path relative to the scene: `.csv` (lines
    /// `x,y,z,r`), `.vtu` (points and a point array of radii, such as the first frame of a run; later ones,
    /// in which spheres have moved or bonds are broken, are refused) or `.pvtu` (the same in pieces). Bonded
    /// by `coordination`; the shape gives the volume, and every sphere must lie in it. Excludes `spacing`,
    /// `count`, `seed`, `protocol`.
    pub file: Option<PathBuf>,
    /// Name of the array of radii in a `.vtu`. Default: first of `radius [m]`, `radius`, `Radius`, `radii`,
    /// `Radii`, `r`.
    pub radii: Option<String>,
    /// Bonds per particle times two, over all particles \[–\]; about 1.7e10 Pa of silica's modulus per
    /// unit. Default: 6.2.
    pub coordination: Option<f64>,
    /// Young's modulus of the beams \[Pa\]. Default: 3.56 `material.young`, which gives a packing about
    /// that modulus (2.65e11 Pa for 7.44e10 Pa); in a zone, with `radius_ratio`, what gives a packing the
    /// body's modulus and Poisson's ratio (decision 0041).
    pub young: Option<f64>,
    /// Poisson's ratio of the beams \[–\]; that of the packing follows from the beams (0.17 with the
    /// defaults), `material.poisson` does not enter but in a zone. Default: 0.3.
    pub poisson: Option<f64>,
    /// Beam radius over mean particle radius, from 0.2 to 1.5 \[–\]; needs `young`. Default: 0.71; in a zone
    /// as for `young`.
    pub radius_ratio: Option<f64>,
    /// What interfaces see.
    pub field: ParticleFieldKind,
    /// Whether the beams follow large rotations, of any angle; angular momentum about the present positions
    /// is then kept.
    pub finite_rotations: bool,
    /// What becomes of spheres that no bonds join to a part of at least four.
    pub loose: LooseKind,
    /// Boxes: bonds that pass through one are left out, and spheres that hang on nothing without them go
    /// with their mass. A box without thickness is a cut.
    pub notch: Vec<NotchBox>,
}

/// A box that cuts all bonds that pass through it.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotchBox {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
}

/// Spheres without bonds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LooseKind {
    /// Left out, the other spheres of their body carry their mass; refused above 2 % of the volume.
    #[default]
    Drop,
    /// They stay as loose grains with the mass of their own volume; needs an effect `contact` on the model.
    Keep,
}

/// How spheres are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// Grown to the onset of jamming: the elasticity comes out by itself.
    Onset,
    /// One quench at a fixed volume fraction: seconds faster, some per cent stiffer.
    Quench,
}

/// Displacement field of particles in an overlap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ParticleFieldKind {
    /// The particles are the integration points; for H1 their gradients are fitted to the bonded neighbours.
    #[default]
    Particles,
    /// Natural neighbours between the centres; a derived mediator is drawn in until it lies within their
    /// hull.
    Natural,
}

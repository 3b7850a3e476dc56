//! Tables of models.

use super::choice::choice;
use super::drive::Selection;
use super::schema;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Kind of a model: its number in the list of kinds, which reads and describes it (`setup::kinds`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelKind(pub(crate) usize);

/// `[model.NAME]`: one mechanics model.
// `S` is its shape, as the scene gives it or as set-up derives it. The schema shows the line above only.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ModelTable")]
#[schemars(transform = schema::excludes("spacing", "divisions"))]
#[schemars(extend(
    "if" = { "properties": { "kind": { "const": "link" } } },
    "then" = {
        "oneOf": [{ "required": ["command"] }, { "required": ["address"] }],
        "properties": {
            "shape": false, "material": false, "spacing": false,
            "divisions": false, "volume": false, "materials": false,
        },
    },
    "else" = {
        "required": ["shape", "material"],
        "properties": { "command": false, "address": false, "timeout": false, "start_timeout": false },
    },
))]
#[non_exhaustive]
pub struct ModelTable<S = Option<Shape>> {
    /// Kind of the model; changing this word exchanges the model.
    pub kind: ModelKind,
    /// Role in the coupling; required of a model that takes part in an interface.
    pub role: Option<RoleKind>,
    /// Body of the model. Default: needed by all kinds but `link`.
    pub shape: S,
    /// Target distance of nodes, or mean diameter of spheres \[m\]; needed unless `divisions` or a mesh file
    /// gives it.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub spacing: Option<f64>,
    /// Number of elements along each direction (three for a box, one for a bar), instead of `spacing`.
    #[schemars(length(min = 1, max = 3), inner(range(min = 1)))]
    pub divisions: Option<Vec<usize>>,
    /// Length of one unit of the file in `shape` \[m\]: 1e-3 for a file in millimetres. Default: 1.
    #[serde(default = "one_metre")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub scale: f64,
    /// Physical volume of the mesh file that the model fills. Default: all of them.
    pub volume: Option<String>,
    /// Cracks, each a group or a box. A face between two elements is split into two lips with their own nodes
    /// if all of its nodes lie in the crack. A box without thickness is a cut along a plane of the mesh. For
    /// `fem` and `cnem`; for `dem` see `dem.notch`. Default: none but the slits of a mesh file.
    #[serde(default)]
    pub crack: Vec<Selection>,
    /// Material of the model. Default: needed by all kinds but `link`.
    pub material: Option<Material>,
    /// Other materials by the name of a physical volume of the mesh file (the first group that a volume
    /// belongs to); without `poisson`, that of `material` holds. For `fem` and `dem`. The stiffness of beams
    /// scales with the modulus; a bond between two materials counts as one half of each in series. Not with
    /// `fracture`.
    #[serde(default)]
    pub materials: BTreeMap<String, Material>,
    /// How the model steps between two reflections. Default: chosen, see `time`.
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
    /// Program and arguments that the run starts in the folder of the scene. The environment variable
    /// `ARLEQUIN_LINK` tells the program where to connect. For `kind = "link"` only: whoever runs the scene
    /// runs this program.
    #[schemars(length(min = 1))]
    pub command: Option<Vec<String>>,
    /// Address at which the run waits for a program that somebody else starts, instead of `command`:
    /// `unix:PATH`, `tcp:127.0.0.1:PORT`, or `tcp-open:IP:PORT` on a network that is closed to strangers.
    #[schemars(extend("pattern" = "^(unix|tcp|tcp-open):."))]
    pub address: Option<String>,
    /// Longest time that the program may take to answer \[s\]; for `kind = "link"`. Default: 4.
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 3.2e7))]
    pub timeout: Option<f64>,
    /// Longest time that the program may take to start and to connect \[s\]; for `kind = "link"`. Default:
    /// 30, or `timeout` if that is longer.
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 3.2e7))]
    pub start_timeout: Option<f64>,
}

impl<S> ModelTable<S> {
    /// Returns the table with another shape.
    pub(crate) fn with_shape<T>(self, shape: T) -> ModelTable<T> {
        ModelTable {
            shape,
            kind: self.kind,
            role: self.role,
            spacing: self.spacing,
            divisions: self.divisions,
            scale: self.scale,
            volume: self.volume,
            crack: self.crack,
            material: self.material,
            materials: self.materials,
            step: self.step,
            fem: self.fem,
            cnem: self.cnem,
            dem: self.dem,
            command: self.command,
            address: self.address,
            timeout: self.timeout,
            start_timeout: self.start_timeout,
        }
    }
}

/// Scale of files in metres.
fn one_metre() -> f64 {
    1.0
}

/// How a model steps between two reflections: one of `ratio`, `fraction`, or the implicit scheme.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "if" = { "required": ["scheme"], "properties": { "scheme": { "const": "implicit" } } },
    "then" = { "properties": { "ratio": false, "fraction": false } },
    "else" = { "oneOf": [{ "required": ["ratio"] }, { "required": ["fraction"] }] },
))]
#[non_exhaustive]
pub struct OwnStepTable {
    /// Number of the model's own steps per step of the run, at least 1.
    #[schemars(range(min = 1))]
    pub ratio: Option<usize>,
    /// Longest own step over the model's own critical step, above 0 and at most 1 \[–\].
    #[schemars(range(max = 1), extend("exclusiveMinimum" = 0))]
    pub fraction: Option<f64>,
    /// Time stepping scheme. Default: `explicit`.
    pub scheme: Option<Scheme>,
}

/// Time stepping schemes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Scheme {
    /// Velocity Verlet; use it with `ratio` or `fraction`.
    Explicit,
    /// One step of average acceleration per step of the run, without a critical step; for `fem`, `cnem` and
    /// `chain`, with dead loads, body forces and supports only.
    Implicit,
}

/// Role of a model in its interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum RoleKind {
    /// Has the weight `f`.
    Coarse,
    /// Has the weight `1 − f`.
    Fine,
}

impl RoleKind {
    /// Returns the name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coarse => "coarse",
            Self::Fine => "fine",
        }
    }
}

/// Body of a model.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Shape {
    /// A box along the axes. Groups `x-min`, `x-max`, `y-min`, … `z-max`.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
        /// Part left out, for meshes: elements inside this box, where only a fine model is present. The faces
        /// of the hole lie between elements; beyond the box the hole is open.
        hole: Option<Hole>,
    },
    /// A circular cylinder along x. Groups `x-min`, `x-max`, `side`.
    Cylinder {
        /// Centre of the face with the smaller x \[m\].
        from: [f64; 3],
        /// Length along x \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        length: f64,
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// A ball. Group `surface`; none for particles.
    Ball {
        /// Centre \[m\].
        centre: [f64; 3],
        /// Radius \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        radius: f64,
    },
    /// A line on the x axis with a cross-section; it moves along x only. Groups `x-min`, `x-max`.
    Bar {
        /// First end \[m\].
        from: f64,
        /// Other end \[m\].
        to: f64,
        /// Cross-section \[m²\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        section: f64,
    },
    /// A Gmsh mesh (4.1 or 2.2, text or binary), relative to the scene file, with its own spacing and named
    /// groups. Elements of second order are read as linear ones, with a warning. Particles fill its outer
    /// surface (or the closed surface mesh in the file), or that of an STL file (no groups). Nodes of `cnem`
    /// do so too, `spacing` apart.
    File(PathBuf),
}

choice!(
    Shape,
    "{ box = { low, high } }, { cylinder = { from, length, radius } }, { ball = { centre, radius } }, { bar = { from, to, section \
     } }, { file = path }"
);

/// A box left out of a box.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Hole {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
}

impl Shape {
    /// Returns the key of the variant.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Box { .. } => "box",
            Self::Cylinder { .. } => "cylinder",
            Self::Ball { .. } => "ball",
            Self::Bar { .. } => "bar",
            Self::File(_) => "file",
        }
    }
}

/// Isotropic linear elasticity.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, PartialEq)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Material {
    /// Young's modulus, positive \[Pa\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub young: f64,
    /// Poisson's ratio, above −0.9999 and below 0.49995 \[–\]; required by solids. Packings of
    /// spheres reach 0.03 to 0.36; a value beyond gives a warning. Default for packings: 0.174.
    #[schemars(range(min = -0.9999, max = 0.49995))]
    pub poisson: Option<f64>,
    /// Density, positive \[kg/m³\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub density: f64,
}

/// Settings of finite elements.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct FemTable {
    /// Element type of boxes and cylinders.
    #[serde(default)]
    pub element: Element,
}

/// Element types of solids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Element {
    /// Eight-node hexahedra, much less stiff in bending than tetrahedra of equal size; therefore the default.
    #[default]
    Hex8,
    /// Four-node tetrahedra.
    Tet4,
}

/// Settings of natural elements.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct CnemTable {
    /// Shape functions. Default: `laplace`.
    pub functions: Option<Functions>,
    /// Strength of the stabilisation of spurious modes, 0 (none) to 1 \[–\]. Default: 0.1.
    #[schemars(range(min = 0, max = 1))]
    pub stabilisation: Option<f64>,
    /// Nodes that carry the mass of a cell. Default: `cells`.
    pub inertia: Option<Masses>,
}

/// Masses of natural elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Masses {
    /// The cell's own node.
    Cells,
    /// The nodes around the cell's centroid. Torsion of coarse bodies is right; static fields under body
    /// forces are less accurate. The critical step is 4 to 7 % shorter for a model alone, and longer where
    /// weights are small (1.25 times in `beam-cnem.toml`).
    Centroids,
}

/// Natural-neighbour shape functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Functions {
    /// Ratios of volumes that the point takes from its neighbours.
    Sibson,
    /// Ratios of areas of cell faces over distances.
    Laplace,
}

/// Settings of particles.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(transform = schema::excludes("file", "count seed protocol"))]
#[schemars(extend("dependencies" = { "radii": ["file"], "radius_ratio": ["young"] }))]
#[non_exhaustive]
pub struct DemTable {
    /// Number of spheres, instead of `spacing`.
    #[schemars(range(min = 1, max = 134_217_727))]
    pub count: Option<usize>,
    /// Seed of the random start; one seed gives one packing, for any number of threads. Default: 1.
    pub seed: Option<u64>,
    /// Packing procedure. Default: `onset`.
    pub protocol: Option<Protocol>,
    /// File with spheres in metres, relative to the scene, instead of a generated packing: `.csv` (lines
    /// `x,y,z,r`), `.vtu` (points and a point array of radii, such as the first frame of a run) or `.pvtu`
    /// (several `.vtu`). Later frames, in which spheres have moved or bonds are broken, are refused. Spheres
    /// are bonded by `coordination`; the shape gives the volume, and every sphere must lie in it. Excludes
    /// `spacing`, `count`, `seed`, `protocol`.
    pub file: Option<PathBuf>,
    /// Name of the array of radii in a `.vtu`. Default: first of `radius [m]`, `radius`, `Radius`, `radii`,
    /// `Radii`, `r`.
    pub radii: Option<String>,
    /// Coordination: twice the number of bonds over the number of particles \[–\]; for silica one unit adds
    /// about 1.7e10 Pa to the modulus. Default: 6.2.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub coordination: Option<f64>,
    /// Young's modulus of the beams \[Pa\]. Default: 3.56 `material.young`, which gives a packing about that
    /// modulus (2.65e11 Pa for 7.44e10 Pa) and a Poisson's ratio of 0.174. Where `material.poisson` differs
    /// from 0.174 by more than 0.02, and in a zone, it is chosen together with `radius_ratio` from measured
    /// packings, so that the packing has the modulus and the ratio of `material` (decision 0041).
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub young: Option<f64>,
    /// Poisson's ratio of the beams \[–\]; that of the packing is `material.poisson`. Default: 0.3.
    #[schemars(range(max = 0.5), extend("exclusiveMinimum" = -1))]
    pub poisson: Option<f64>,
    /// Beam radius over mean particle radius, from 0.2 to 1.5 \[–\]; needs `young`. Default: 0.71, or
    /// chosen together with `young`. Above 1.2 the stiffness of packings is not measured, with a warning.
    #[schemars(range(min = 0.2, max = 1.5))]
    pub radius_ratio: Option<f64>,
    /// Displacement field in overlaps.
    pub field: ParticleFieldKind,
    /// True if the beams follow rotations of any size; angular momentum about the present positions is then
    /// conserved.
    pub finite_rotations: bool,
    /// Treatment of spheres that bonds do not join to a part of at least four.
    pub loose: LooseKind,
    /// Notches and cracks: boxes, planes, discs and closed surfaces. Bonds that cross one are left out, and
    /// so are bonds within it. Spheres that then hang on nothing are removed with their mass. A notch without
    /// thickness is a crack.
    pub notch: Vec<Notch>,
}

/// A notch: exactly one of `low` with `high`, `plane`, `disc`, `file`.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("low plane disc file"))]
#[schemars(extend("dependencies" = { "low": ["high"], "high": ["low"], "scale": ["file"] }))]
pub struct Notch {
    /// Lowest corner of a box along the axes \[m\].
    pub low: Option<[f64; 3]>,
    /// Highest corner of the box \[m\].
    pub high: Option<[f64; 3]>,
    /// A plane with any normal.
    pub plane: Option<NotchPlane>,
    /// A disc (a penny-shaped crack).
    pub disc: Option<NotchDisc>,
    /// STL file of a closed surface, relative to the scene: spheres inside are removed.
    pub file: Option<PathBuf>,
    /// Length of one unit of the file \[m\]. Default: 1.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub scale: Option<f64>,
}

/// A plane that cuts bonds.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotchPlane {
    /// A point of the plane \[m\].
    pub point: [f64; 3],
    /// Normal of the plane (any length).
    #[schemars(transform = schema::not_zero)]
    pub normal: [f64; 3],
    /// Thickness, one half on each side \[m\]. Default: 0, a crack.
    #[schemars(range(min = 0))]
    pub thickness: Option<f64>,
    /// The box that holds the notch. Default: the plane cuts through the whole body.
    pub within: Option<NotchBox>,
}

/// A disc that cuts bonds.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotchDisc {
    /// Centre \[m\].
    pub centre: [f64; 3],
    /// Normal of the disc (any length).
    #[schemars(transform = schema::not_zero)]
    pub normal: [f64; 3],
    /// Radius \[m\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub radius: f64,
    /// Thickness, one half on each side \[m\]. Default: 0, a crack.
    #[schemars(range(min = 0))]
    pub thickness: Option<f64>,
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotchBox {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
}

/// Treatment of spheres without bonds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum LooseKind {
    /// They are left out, and the other spheres of their body carry their mass; refused above 2 % of the
    /// volume.
    #[default]
    Drop,
    /// They stay as loose grains with the mass of their own volume; needs an effect `contact` on the model.
    Keep,
}

/// Packing procedures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Protocol {
    /// Spheres grow to the onset of jamming, so that the elasticity needs no setting.
    Onset,
    /// One quench at a fixed volume fraction: seconds faster, some per cent stiffer.
    Quench,
}

/// Displacement field of particles in an overlap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ParticleFieldKind {
    /// The particles are the integration points; for H1 their gradients are fitted to the bonded neighbours.
    #[default]
    Particles,
    /// Natural neighbours between the centres; a derived mediator is shrunk until it lies within their convex
    /// hull.
    Natural,
}

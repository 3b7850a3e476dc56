//! Meshes of the shapes of a scene, and their form for output.

use super::cloud;
use super::files::{ShapeFile, check_file};
use super::materials::solid_poisson;
use crate::error::{Result, fem, unknown, value};
use crate::setup::{BodyShape, LoweredModel};
use crate::spec::{Element, Hole, Shape};
use arlequin::core::Model;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::DemModel;
use arlequin::fem_ref::generate::{self, Cylinder, Rim};
use arlequin::fem_ref::{ElementKind, Mesh, gmsh};
use std::path::Path;

/// Largest number of elements of a generated mesh, as the mesh generators have it.
const MOST: f64 = 16_777_216.0;

/// Mesh of a model for output.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    /// Nodes \[m\].
    pub points: Vec<Point3<f64>>,
    /// Corners of all cells, one cell after the other.
    pub connectivity: Vec<u32>,
    /// Number of corners per cell.
    pub corners: usize,
    /// VTK cell type.
    pub cell_type: u8,
    /// Radii of spheres at the points \[m\]; empty if the points are no spheres.
    pub radii: Vec<f64>,
}

impl Grid {
    /// Output mesh without cells.
    pub(crate) fn empty() -> Self {
        Self {
            corners: 4,
            cell_type: 10,
            ..Self::default()
        }
    }

    /// Output mesh of a finite element mesh.
    pub fn of_mesh(mesh: &Mesh<f64>) -> Self {
        Self {
            points: mesh.nodes().to_vec(),
            connectivity: mesh.connectivity().to_vec(),
            corners: mesh.kind().corners(),
            cell_type: match mesh.kind() {
                ElementKind::Bar2 => 3,
                ElementKind::Tet4 => 10,
                ElementKind::Hex8 => 12,
            },
            radii: Vec::new(),
        }
    }

    /// Output mesh of particles, each joined to the next by a line.
    pub fn of_line(points: &[Point3<f64>]) -> Self {
        Self {
            points: points.to_vec(),
            connectivity: (1..points.len() as u32).flat_map(|k| [k - 1, k]).collect(),
            corners: 2,
            cell_type: 3,
            radii: Vec::new(),
        }
    }

    /// Output mesh of particles, joined by their bonds.
    pub fn of_spheres(model: &DemModel) -> Self {
        let body = model.body();
        Self {
            points: model.nodes().to_vec(),
            connectivity: body.pairs().iter().flatten().copied().collect(),
            corners: 2,
            cell_type: 3,
            radii: body.radii().to_vec(),
        }
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.connectivity.len() / self.corners
    }

    /// Mean extent, along the line from `from` to `to`, of the cells whose middles lie between the two planes
    /// across this line \[m\]; `None` without such cells.
    pub(crate) fn extent_across(&self, [from, to]: [Point3<f64>; 2]) -> Option<f64> {
        let along = (to - from).try_normalize(0.0)?;
        let place = |c: &u32| Some((self.points.get(*c as usize)? - from).dot(&along));
        let (mut sum, mut count) = (0.0, 0.0);
        for corners in self.connectivity.chunks_exact(self.corners.max(2)) {
            let places: Option<Vec<f64>> = corners.iter().map(place).collect();
            let places = places?;
            let (low, high) = places
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
                    (a.min(*x), b.max(*x))
                });
            // Cells count by their middle: each of them wholly or not at all.
            let middle = places.iter().sum::<f64>() / places.len() as f64;
            if middle > 0.0 && middle < (to - from).norm() {
                sum += high - low;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| sum / count)
    }
}

/// Elements that a kind of model needs of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Elements {
    /// Any elements.
    Any,
    /// Tetrahedra, which also fill the surface of an STL file.
    Tetrahedra,
}

/// Description of a mesh to be generated or read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Request<'a> {
    /// Key of the table that describes the mesh.
    pub key: &'a str,
    /// Shape of the body.
    pub shape: &'a BodyShape,
    /// Target length of the elements \[m\].
    pub spacing: Option<f64>,
    /// Numbers of elements along the axes.
    pub divisions: Option<&'a [usize]>,
    /// Element type of solids.
    pub element: Element,
    /// Position of the nodes on the side of cylinders.
    pub rim: Rim,
    /// Length of a unit of the file \[m\].
    pub scale: f64,
    /// Physical volume of the file to use; all by default.
    pub volume: Option<&'a str>,
    /// True if an STL surface may be filled with nodes.
    pub cloud: bool,
    /// Folder of the scene.
    pub folder: &'a Path,
}

impl<'a> Request<'a> {
    /// Mesh of the model that a table describes.
    ///
    /// # Errors
    /// A solid without Poisson's ratio.
    pub(super) fn of_model(
        key: &'a str,
        table: &'a LoweredModel,
        elements: Elements,
        folder: &'a Path,
    ) -> Result<Self> {
        if !table.shape.is_line() {
            solid_poisson(key, table)?;
        }
        let is_cloud = elements == Elements::Tetrahedra;
        Ok(Self {
            key,
            shape: &table.shape,
            spacing: table.spacing,
            divisions: table.divisions.as_deref(),
            element: if is_cloud {
                Element::Tet4
            } else {
                table.fem.element
            },
            rim: Rim::EqualArea,
            scale: table.scale,
            volume: table.volume.as_deref(),
            cloud: is_cloud,
            folder,
        })
    }
}

impl Request<'_> {
    /// Checks what can be checked before anything is meshed.
    pub(super) fn check(&self) -> Result<()> {
        let key = self.key;
        if self.scale <= 0.0 {
            let rule = "must be positive [m]: 1e-3 for a file in millimetres";
            return Err(value(format!("{key}.scale"), self.scale, rule));
        }
        // A scale of one is the default, which cannot be told from one that is given.
        let of_file = (self.scale - 1.0).abs() > 0.0 || self.volume.is_some();
        if of_file && !self.shape.is_file() {
            let rule = "scale and volume belong to shape.file; remove them";
            return Err(crate::error::key(key, rule));
        }
        let shape = match self.shape {
            BodyShape::Given(shape) => shape,
            BodyShape::Piece(piece) | BodyShape::Reservoir(piece) => return piece.check(self),
            BodyShape::Remote => return Err(self.nobody()),
        };
        match shape {
            Shape::Box { low, high, hole } => self.check_box(*low, *high, hole.as_ref()),
            Shape::Cylinder { length, radius, .. } => {
                for (name, x) in [("length", *length), ("radius", *radius)] {
                    if x <= 0.0 {
                        let path = format!("{key}.shape.cylinder.{name}");
                        return Err(value(path, x, "must be positive [m]"));
                    }
                }
                self.by_spacing("a cylinder is meshed by spacing")
            }
            Shape::Ball { radius, .. } => {
                if *radius <= 0.0 {
                    let path = format!("{key}.shape.ball.radius");
                    return Err(value(path, *radius, "must be positive [m]"));
                }
                self.by_spacing("a ball is meshed by spacing")
            }
            Shape::Bar { from, to, section } => {
                check_bar(key, *from, *to, *section)?;
                divisions_of(key, &[to - from], self.spacing, self.divisions).map(|_| ())
            }
            Shape::File(path) if ShapeFile::from_path(path) == ShapeFile::Surface => {
                let key_path = format!("{key}.shape.file");
                if !self.cloud {
                    let rule = "STL holds a surface, and finite elements need a mesh of the volume; give a Gmsh mesh of the \
                                body, or take kind = \"cnem\", whose nodes are placed within the surface";
                    return Err(value(key_path, path.display(), rule));
                }
                self.by_spacing("an STL body is filled with nodes by spacing")?;
                check_file(&key_path, &self.folder.join(path))
            }
            Shape::File(path) => {
                if self.spacing.is_some() || self.divisions.is_some() {
                    let rule = "a mesh file brings its own spacing; remove spacing and divisions";
                    return Err(crate::error::key(key, rule));
                }
                check_file(&format!("{key}.shape.file"), &self.folder.join(path))
            }
        }
    }

    fn check_box(&self, low: [f64; 3], high: [f64; 3], hole: Option<&Hole>) -> Result<()> {
        let key = self.key;
        let above = |corner: &str, low: [f64; 3], high: [f64; 3]| match (0..3).find(|&c| high[c] <= low[c]) {
            None => Ok(()),
            Some(c) => {
                let rule = format!("must be above low[{c}] = {} m", low[c]);
                Err(value(format!("{key}.shape.box.{corner}[{c}]"), high[c], &rule))
            }
        };
        above("high", low, high)?;
        let extents = [0, 1, 2].map(|c| high[c] - low[c]);
        divisions_of(key, &extents, self.spacing, self.divisions)?;
        hole.map_or(Ok(()), |h| above("hole.high", h.low, h.high))
    }

    /// Refuses divisions, for the reason `why`, and a missing spacing.
    fn by_spacing(&self, why: &str) -> Result<()> {
        if self.divisions.is_some() {
            let rule = format!("{why}; give spacing in place of divisions");
            return Err(crate::error::key(format!("{}.divisions", self.key), rule));
        }
        positive_spacing(self.key, self.spacing).map(|_| ())
    }

    /// Checks the mesh of a body, whose element size is known: the hole of a box must consist of whole
    /// elements.
    pub(super) fn check_body(&self) -> Result<()> {
        self.check()?;
        let Some(Shape::Box { low, high, hole }) = self.shape.in_scene() else {
            return Ok(());
        };
        let Some(hole) = hole else { return Ok(()) };
        let extents = [0, 1, 2].map(|c| high[c] - low[c]);
        let n = divisions_of(self.key, &extents, self.spacing, self.divisions)?;
        let [low, high, first, last] = [low, high, &hole.low, &hole.high].map(|x| Point3::from(*x));
        generate::gap(low, high, [n[0], n[1], n[2]], [first, last])
            .map(|_| ())
            .map_err(fem(&format!("{}.shape.box.hole", self.key)))
    }

    /// Generates or reads the mesh.
    pub(super) fn mesh(&self) -> Result<Mesh<f64>> {
        self.check()?;
        let key = self.key;
        let kind = match self.element {
            Element::Hex8 => ElementKind::Hex8,
            Element::Tet4 => ElementKind::Tet4,
        };
        let shape = match self.shape {
            BodyShape::Given(shape) => shape,
            BodyShape::Piece(piece) | BodyShape::Reservoir(piece) => return piece.mesh(self),
            BodyShape::Remote => return Err(self.nobody()),
        };
        match shape {
            Shape::Box { low, high, hole } => {
                let extents = [0, 1, 2].map(|c| high[c] - low[c]);
                let n = divisions_of(key, &extents, self.spacing, self.divisions)?;
                let (n, [low, high]) = ([n[0], n[1], n[2]], [low, high].map(|x| Point3::from(*x)));
                match hole {
                    None => generate::block(kind, low, high, n).map_err(fem(key)),
                    Some(h) => generate::hollow_block(kind, low, high, n, [h.low, h.high].map(Point3::from))
                        .map_err(fem(&format!("{key}.shape.box.hole"))),
                }
            }
            Shape::Cylinder { from, length, radius } => self.cylinder(kind, *from, *length, *radius),
            Shape::Bar { from, to, section } => {
                let n = divisions_of(key, &[to - from], self.spacing, self.divisions)?;
                generate::bar(*from, *to, n[0], *section).map_err(fem(key))
            }
            Shape::Ball { centre, radius } => {
                let size = positive_spacing(key, self.spacing)?;
                generate::ball(kind, Point3::from(*centre), *radius, size).map_err(fem(key))
            }
            Shape::File(path) => self.file(&self.folder.join(path)),
        }
    }

    /// Error of a model without a shape.
    fn nobody(&self) -> crate::Error {
        crate::error::key(self.key, "missing field `shape`")
    }

    fn cylinder(&self, kind: ElementKind, from: [f64; 3], length: f64, radius: f64) -> Result<Mesh<f64>> {
        let key = self.key;
        let spacing = positive_spacing(key, self.spacing)?;
        let size = Cylinder::with_size([from[0], from[0] + length], radius, spacing).map_err(fem(key))?;
        let shape = Cylinder {
            rim: self.rim,
            ..size
        };
        let mesh = generate::cylinder(kind, &shape).map_err(fem(key))?;
        let shift = Vector3::new(0.0, from[1], from[2]);
        mesh.mapped(|x| x + shift).map_err(fem(key))
    }

    fn file(&self, path: &Path) -> Result<Mesh<f64>> {
        match ShapeFile::from_path(path) {
            ShapeFile::Surface => {
                let size = positive_spacing(self.key, self.spacing)?;
                cloud::fill(self.key, path, self.scale, size)
            }
            ShapeFile::Mesh => volume(self.key, path, self.scale, self.volume),
        }
    }
}

/// Reads the mesh in a file, or one of its volumes.
fn volume(key: &str, path: &Path, scale: f64, name: Option<&str>) -> Result<Mesh<f64>> {
    let key_path = format!("{key}.shape.file");
    let mesh = gmsh::load(path).map_err(fem(&key_path))?;
    let mesh = scaled(mesh, scale).map_err(fem(&key_path))?;
    let Some(name) = name else {
        return Ok(mesh);
    };
    let volumes = mesh.volumes();
    let number = volumes.iter().position(|v| v == name);
    let number = number.ok_or_else(|| unknown(format!("{key}.volume"), name, "volume", volumes.iter()))?;
    mesh.part(|e| mesh.regions()[e] as usize == number)
        .map_err(fem(&key_path))
}

/// Reads the mesh in the file of a table of any kind.
pub(super) fn volume_of(key: &str, table: &LoweredModel, path: &Path) -> Result<Mesh<f64>> {
    volume(key, path, table.scale, table.volume.as_deref())
}

/// Scales a mesh by `scale`; leaves it unchanged for a scale of 1.
pub(super) fn scaled(mesh: Mesh<f64>, scale: f64) -> arlequin::fem_ref::Result<Mesh<f64>> {
    // For exactly one nothing is computed, so that coordinates keep their bits.
    if (scale - 1.0).abs() <= 0.0 {
        return Ok(mesh);
    }
    mesh.mapped(|x| x * scale)
}

/// Refuses a bar without positive length and section.
pub(super) fn check_bar(key: &str, from: f64, to: f64, section: f64) -> Result<()> {
    if to <= from {
        let rule = format!("must be above from = {from} m");
        return Err(value(format!("{key}.shape.bar.to"), to, &rule));
    }
    if section <= 0.0 {
        let rule = "must be positive [m²]";
        return Err(value(format!("{key}.shape.bar.section"), section, rule));
    }
    Ok(())
}

pub(super) fn positive_spacing(key: &str, spacing: Option<f64>) -> Result<f64> {
    match spacing {
        Some(h) if h > 0.0 => Ok(h),
        Some(h) => Err(value(format!("{key}.spacing"), h, "must be positive [m]")),
        None => Err(crate::error::key(
            key,
            "spacing is missing: the distance of nodes or particles [m]",
        )),
    }
}

/// Numbers of elements along the extents \[m\].
pub(super) fn divisions_of(
    key: &str,
    extents: &[f64],
    spacing: Option<f64>,
    divisions: Option<&[usize]>,
) -> Result<Vec<usize>> {
    match (spacing, divisions) {
        (Some(_), Some(_)) => Err(crate::error::key(
            key,
            "spacing and divisions exclude each other; remove one",
        )),
        (_, Some(n)) if n.len() != extents.len() => Err(value(
            format!("{key}.divisions"),
            format_args!("{n:?}"),
            &format!("needs {} numbers, one per direction", extents.len()),
        )),
        (_, Some(n)) => match n.iter().position(|&n| n == 0) {
            Some(k) => Err(value(format!("{key}.divisions[{k}]"), 0, "must be at least 1")),
            None => Ok(n.to_vec()),
        },
        (spacing, None) => {
            let h = positive_spacing(key, spacing)?;
            // As floating-point numbers: the product of integers could overflow before it is compared.
            let total: f64 = extents.iter().map(|l| (l / h).round().max(1.0)).product();
            if total > MOST {
                let lengths: Vec<String> = extents.iter().map(|l| format!("{l:.3e}")).collect();
                let count = if total.is_finite() {
                    format!("{total:.1e}")
                } else {
                    format!("more than {:.0e}", f64::MAX)
                };
                let rule = format!(
                    "{count} elements of that length fill {} m, {MOST:.1e} at most are made; choose a longer one [m]",
                    lengths.join(" by ")
                );
                return Err(value(format!("{key}.spacing"), h, &rule));
            }
            Ok(extents
                .iter()
                .map(|l| ((l / h).round() as usize).max(1))
                .collect())
        }
    }
}

/// Groups of the mesh of a shape; `None` if only the mesh, the body of a zone or a link knows them.
pub(super) fn groups(shape: &BodyShape) -> Option<&'static [&'static str]> {
    Some(match shape.in_scene()? {
        Shape::Box { .. } => &["x-min", "x-max", "y-min", "y-max", "z-min", "z-max"],
        Shape::Cylinder { .. } => &["x-min", "x-max", "side"],
        Shape::Ball { .. } => &["surface"],
        Shape::Bar { .. } => &["x-min", "x-max"],
        Shape::File(_) => return None,
    })
}

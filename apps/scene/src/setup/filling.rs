//! Containers for spheres, and packings made by the protocol or read from files.

pub use crate::error::dem;

use super::files::{self, ShapeFile, bytes, is};
use super::mesh::volume_of;
use super::packing::Likeness;
use super::shapes::corners;
use crate::error::{Error, Result, fem, key, value};
use crate::setup::{BodyShape, LoweredModel};
use crate::spec::{DemTable, LooseKind, Material, Protocol, Shape};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::calibrate::RATIOS;
use arlequin::dem_beam::packing::size::{mean_diameter, sphere_count};
use arlequin::dem_beam::packing::{
    Around, Container, Loose, Packing, PackingSpec, pieces_of_pvtu, read_csv, read_pieces, read_vtu,
};
use arlequin::dem_beam::{BeamMaterial, Surface};
use arlequin::fem_ref::gmsh::{self, Triangles};
use arlequin::fem_ref::{ElementKind, Mesh, generate};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Young's modulus of the beams over that of the packing, for beams of 0.71 mean radii and 6.2 bonds per
/// particle: beams of 265e9 Pa gave 74.4e9 ± 0.3e9 Pa with 20 000 spheres.
const YOUNG_RATIO: f64 = 265.0 / 74.4;
/// Tolerances within which a packing is as stiff as the body: relative difference of Young's moduli,
/// difference of Poisson's ratios. A few times the scatter between packings.
const ALIKE: [f64; 2] = [0.03, 0.02];
/// Relative deviation from isotropic stiffness below which no warning is given.
const UNEVEN: f64 = 0.15;
/// Number of spheres across an open border from which on a zone moves as elements would, to 2 %; with eight
/// the error reaches 6.5 % (decision 0041).
const ACROSS: f64 = 10.0;
/// Width of the packed margin beyond the border of a zone, in mean diameters: the order that a wall causes
/// has faded there.
const MARGIN: f64 = 2.5;
/// Number of facet lengths in the radius of a ball.
const SIDES: f64 = 12.0;
/// Largest number of spheres in a packing.
const MOST: f64 = 1.3e8;

/// A body to be filled with spheres.
#[derive(Debug, Clone)]
pub struct Filling {
    /// Container, in its own frame.
    pub container: Container,
    /// Position of this frame in the scene \[m\].
    pub shift: Vector3<f64>,
    /// Triangles of the named faces of a mesh file \[m\].
    pub faces: BTreeMap<String, Vec<[Vector3<f64>; 3]>>,
    /// Mesh whose surface the container is, if there is one.
    pub mesh: Option<Mesh<f64>>,
}

impl Filling {
    /// Mean diameter of the spheres that a table asks for by its spacing or their number \[m\].
    pub fn mean_diameter(&self, table: &LoweredModel) -> Option<f64> {
        let volume = match &self.container {
            Container::Around(around) => around.part().volume(),
            container => container.volume(),
        };
        let of_count = |count: usize| mean_diameter(volume, count as f64);
        let spacing = table.spacing.filter(|s| *s > 0.0);
        spacing.or_else(|| table.dem.count.filter(|n| *n > 0).map(of_count))
    }

    /// Builds the container for the shape of a table; file names are relative to `folder`.
    pub fn from_table(key: &str, table: &LoweredModel, folder: &Path) -> Result<Self> {
        let plain = |container, shift| Self {
            container,
            shift,
            faces: BTreeMap::new(),
            mesh: None,
        };
        let shape = match &table.shape {
            BodyShape::Given(shape) => shape,
            BodyShape::Piece(piece) | BodyShape::Reservoir(piece) => {
                let (triangles, mesh) = piece.surface(folder)?;
                let filling = Self::inside_triangles(key, triangles, Some(mesh))?;
                return match table.dem.file {
                    // Spheres read from a file belong to the zone already.
                    Some(_) => Ok(filling),
                    None => {
                        filling.with_surroundings(key, table, |margin| piece.extended_surface(folder, margin))
                    }
                };
            }
            BodyShape::Remote => return Err(unfilled(key, table)),
        };
        match shape {
            Shape::Box { hole: Some(_), .. } => {
                let rule = "spheres fill a whole box; remove the hole, or give the outer surface in a file";
                Err(crate::error::key(format!("{key}.shape.box.hole"), rule))
            }
            Shape::Box { low, high, .. } => {
                let container = Container::cuboid(Vector3::from(*low), Vector3::from(*high));
                let container = container.map_err(dem(&format!("{key}.shape.box")))?;
                Ok(plain(container, Vector3::zeros()))
            }
            Shape::Cylinder { from, length, radius } => {
                let container = Container::cylinder(*length, *radius);
                let container = container.map_err(dem(&format!("{key}.shape.cylinder")))?;
                Ok(plain(container, Vector3::from(*from)))
            }
            Shape::Bar { .. } => Err(unfilled(key, table)),
            Shape::Ball { centre, radius } => {
                let ball = generate::ball(ElementKind::Hex8, Point3::from(*centre), *radius, radius / SIDES);
                let mesh = ball.map_err(fem(format!("{key}.shape.ball")))?;
                Self::inside_triangles(key, gmsh::triangles_of(&mesh), None)
            }
            Shape::File(path) => file(key, table, &folder.join(path)),
        }
    }
}

/// Error of a shape that spheres cannot fill.
fn unfilled(key: &str, table: &LoweredModel) -> Error {
    let rule = "spheres fill a box, a cylinder, a ball or the surface in a file; choose one, or another kind of model";
    value(format!("{key}.shape"), table.shape.name(), rule)
}

impl Filling {
    /// Lowest and highest corner of the body in the scene \[m\], without the margin around a zone.
    pub(super) fn ends(&self) -> [Vector3<f64>; 2] {
        match &self.mesh {
            Some(mesh) => corners(mesh.nodes()),
            None => {
                let (low, high) = self.container.bounds();
                [low + self.shift, high + self.shift]
            }
        }
    }
}

/// Builds the container inside a closed surface in a file.
fn file(key: &str, table: &LoweredModel, path: &Path) -> Result<Filling> {
    let key_path = format!("{key}.shape.file");
    if table.scale <= 0.0 {
        let rule = "must be positive [m]: 1e-3 for a file in millimetres";
        return Err(value(format!("{key}.scale"), table.scale, rule));
    }
    if ShapeFile::from_path(path) == ShapeFile::Surface {
        return Ok(Filling {
            container: Container::Surface(files::surface(&key_path, path, table.scale)?),
            shift: Vector3::zeros(),
            faces: BTreeMap::new(),
            mesh: None,
        });
    }
    if !is(path, "msh") {
        let rule = "spheres fill the surface of a Gmsh mesh (.msh) or of STL (.stl)";
        return Err(value(key_path, path.display(), rule));
    }
    if table.volume.is_some() || !table.materials.is_empty() {
        let mesh = volume_of(key, table, path)?;
        return Filling::inside_triangles(&key_path, gmsh::triangles_of(&mesh), Some(mesh));
    }
    let mut triangles = gmsh::load_surface(path).map_err(fem(&key_path))?;
    triangles.points.iter_mut().for_each(|x| *x *= table.scale);
    Filling::inside_triangles(&key_path, triangles, None)
}

impl Filling {
    /// Extends the container by a margin of the surrounding body: spheres are packed there too and then cut
    /// off.
    fn with_surroundings(
        self,
        key: &str,
        table: &LoweredModel,
        surroundings: impl FnOnce(f64) -> Result<(Triangles, Vec<[Point3<f64>; 3]>)>,
    ) -> Result<Self> {
        let Container::Surface(part) = &self.container else {
            return Ok(self);
        };
        let diameter = match (table.spacing, table.dem.count) {
            (Some(h), _) => h,
            (None, Some(n)) => mean_diameter(part.volume(), n as f64),
            (None, None) => return Ok(self),
        };
        // Invalid values are left to `count`, which refuses them by their key.
        if !(diameter > 0.0 && sphere_count(part.volume(), diameter) < MOST) {
            return Ok(self);
        }
        let margin = MARGIN * diameter;
        let (body, border) = surroundings(margin)?;
        let body = Self::inside_triangles(key, body, None)?;
        let border: Vec<_> = border.iter().map(|t| t.map(|x| x.coords)).collect();
        let Container::Surface(body) = body.container else {
            return Ok(self);
        };
        let surroundings = Around::new(part.clone(), body, &border, margin).map_err(dem(key))?;
        Ok(Self {
            container: Container::Around(Box::new(surroundings)),
            ..self
        })
    }

    /// Builds the container inside triangles, which may be the surface of `mesh`.
    fn inside_triangles(key: &str, triangles: Triangles, mesh: Option<Mesh<f64>>) -> Result<Self> {
        let points: Vec<Vector3<f64>> = triangles.points.iter().map(|p| p.coords).collect();
        let corners = |t: &[u32; 3]| t.map(|i| points[i as usize]);
        let faces = triangles.groups.iter();
        let faces = faces.map(|(n, t)| (n.clone(), t.iter().map(corners).collect()));
        let faces = faces.collect();
        let surface = Surface::oriented(points, triangles.triangles).map_err(dem(key))?;
        Ok(Self {
            container: Container::Surface(surface),
            shift: Vector3::zeros(),
            faces,
            mesh,
        })
    }
}

/// Source of the spheres of a table.
#[derive(Debug, Clone)]
pub enum Recipe {
    /// Made by the packing protocol.
    Made(Box<PackingSpec>),
    /// Read from a file.
    Read(Box<Packing>),
}

impl Recipe {
    /// Returns the source that a table asks for, in the frame of the container.
    pub fn from_table(path: &str, table: &LoweredModel, folder: &Path, filling: &Filling) -> Result<Self> {
        match &table.dem.file {
            Some(file) => read(path, table, &folder.join(file), filling).map(|p| Self::Read(Box::new(p))),
            None => {
                let count = count(path, table, &filling.container)?;
                Ok(Self::Made(Box::new(spec(
                    table,
                    filling.container.clone(),
                    count,
                ))))
            }
        }
    }

    /// Checks what can be checked before a file is read or anything is packed.
    pub(super) fn check(path: &str, table: &LoweredModel, folder: &Path, filling: &Filling) -> Result<()> {
        let Some(file) = &table.dem.file else {
            return count(path, table, &filling.container).map(|_| ());
        };
        alone(path, table)?;
        let file = folder.join(file);
        std::fs::File::open(&file)
            .map(|_| ())
            .map_err(|source| Error::Read { path: file, source })
    }

    /// Returns the packing, from the cache if it is there; calls `progress` with the share that is done.
    pub fn packing(self, path: &str, progress: &mut dyn FnMut(f64)) -> Result<Packing> {
        let spec = match self {
            Self::Made(spec) => spec,
            Self::Read(packing) => return Ok(*packing),
        };
        let built = match cache() {
            Some(folder) => spec.build_cached_with(&folder, progress),
            None => spec.build_with(progress),
        };
        built.map_err(dem(path))
    }
}

/// Returns the packing protocol with the choices of the table.
pub fn spec(table: &LoweredModel, container: Container, count: usize) -> PackingSpec {
    let DemTable {
        seed,
        protocol,
        coordination,
        loose,
        ..
    } = table.dem;
    let seed = seed.unwrap_or(1);
    let mut spec = match protocol.unwrap_or(Protocol::Onset) {
        Protocol::Onset => PackingSpec::new(container, count, seed),
        Protocol::Quench => PackingSpec::quench(container, count, seed),
    };
    if let Some(z) = coordination {
        spec.coordination = z;
    }
    spec.loose = fate(loose);
    spec
}

/// Translates the choice of the scene into that of the packing.
fn fate(kind: LooseKind) -> Loose {
    match kind {
        LooseKind::Drop => Loose::default(),
        LooseKind::Keep => Loose::Keep,
    }
}

fn count(path: &str, table: &LoweredModel, container: &Container) -> Result<usize> {
    let volume = container.volume();
    match (table.dem.count, table.spacing) {
        // The count of a table is for the zone; the margin around it needs spheres in proportion to its
        // volume.
        (Some(n), None) => Ok(match container {
            Container::Around(a) => (n as f64 * volume / a.part().volume()).round() as usize,
            _ => n,
        }),
        (None, Some(h)) if h > 0.0 => {
            let n = sphere_count(volume, h).round();
            if n > MOST {
                let (low, high) = container.bounds();
                let e = high - low;
                let rule = format!(
                    "{n:.1e} spheres of that diameter fill the shape of {:.3e} by {:.3e} by {:.3e} m, {MOST:e} at most are \
                     packed; lengths are in m: a file in millimetres (STL and Gmsh files say no unit) needs scale = 1e-3",
                    e.x, e.y, e.z
                );
                return Err(value(format!("{path}.spacing"), h, &rule));
            }
            if n < 1.0 {
                let rule = "no spheres of that diameter fit into the shape; choose a smaller one [m]";
                return Err(value(format!("{path}.spacing"), h, rule));
            }
            Ok(n as usize)
        }
        (None, Some(h)) => Err(value(format!("{path}.spacing"), h, "must be positive [m]")),
        (Some(_), Some(_)) => Err(key(path, "spacing and dem.count exclude each other; remove one")),
        (None, None) => Err(key(
            path,
            "spacing is missing: the mean diameter of the spheres [m]; or give dem.count or dem.file",
        )),
    }
}

/// Refuses choices for a packing in addition to a file of spheres.
fn alone(path: &str, table: &LoweredModel) -> Result<()> {
    let t = &table.dem;
    let choices = [
        ("spacing", table.spacing.is_some()),
        ("dem.count", t.count.is_some()),
        ("dem.seed", t.seed.is_some()),
        ("dem.protocol", t.protocol.is_some()),
    ];
    if let Some((name, _)) = choices.iter().find(|(_, present)| *present) {
        let rule = "dem.file brings its own spheres; remove one of the two";
        return Err(key(format!("{path}.{name}"), rule));
    }
    Ok(())
}

/// Reads spheres from a file and bonds them as the protocol does.
fn read(path: &str, table: &LoweredModel, file: &Path, filling: &Filling) -> Result<Packing> {
    let t = &table.dem;
    alone(path, table)?;
    let key_path = format!("{path}.dem.file");
    let (mut positions, radii) = if is(file, "csv") {
        read_csv(&mut files::text(file)?.as_bytes()).map_err(dem(&key_path))?
    } else if is(file, "vtu") {
        read_vtu(&bytes(file)?, t.radii.as_deref()).map_err(dem(&key_path))?
    } else if is(file, "pvtu") {
        let pieces = pieces_of_pvtu(&bytes(file)?).map_err(dem(&key_path))?;
        let pieces = pieces.iter().map(|p| bytes(&file.with_file_name(p)));
        let pieces = pieces.collect::<Result<Vec<_>>>()?;
        read_pieces(&pieces, t.radii.as_deref()).map_err(dem(&key_path))?
    } else {
        let rule = "spheres are read from CSV (.csv, lines x,y,z,r), VTU (.vtu) or its pieces (.pvtu)";
        return Err(value(key_path, file.display(), rule));
    };
    // Files hold places in the scene, containers have a frame of their own.
    positions.iter_mut().for_each(|x| *x -= filling.shift);
    let z = t.coordination.unwrap_or(6.2);
    Packing::from_spheres_with(&filling.container, &positions, &radii, z, fate(t.loose))
        .map_err(dem(&key_path))
}

/// Folder of the packing cache: `ARLEQUIN_CACHE`, or `arlequin` in the user's cache folder.
fn cache() -> Option<PathBuf> {
    // The XDG specification takes an empty variable as one that is not set.
    let folder = |name: &str| {
        std::env::var_os(name)
            .filter(|v| !v.is_empty())
            .map(PathBuf::from)
    };
    folder("ARLEQUIN_CACHE")
        .or_else(|| folder("XDG_CACHE_HOME").map(|p| p.join("arlequin")))
        .or_else(|| folder("HOME").map(|p| p.join(".cache/arlequin")))
}

/// Returns the beam material of a table.
pub fn beam(path: &str, table: &LoweredModel) -> Result<BeamMaterial> {
    let DemTable {
        young,
        poisson,
        radius_ratio,
        ..
    } = table.dem;
    // Both together decide the stiffness: a radius without a modulus would change that of the body unseen.
    if radius_ratio.is_some() && young.is_none() {
        let rule = "decides the stiffness together with dem.young; give both";
        return Err(key(format!("{path}.dem.radius_ratio"), rule));
    }
    let main = table.known_material(path)?;
    if let (Some(ratio), None, None) = (ratio_from_table(table, main), young, poisson) {
        let [low, high] = BeamMaterial::BULK_POISSON;
        let nearest = ratio.clamp(low, high);
        return BeamMaterial::from_bulk(main.young, nearest).map_err(dem(format!("{path}.dem")));
    }
    let beam = BeamMaterial {
        young: young.unwrap_or(YOUNG_RATIO * main.young),
        poisson: poisson.unwrap_or(BeamMaterial::SILICA.poisson),
        radius_ratio: radius_ratio.unwrap_or(BeamMaterial::SILICA.radius_ratio),
    };
    let [low, high] = RATIOS;
    if !(low..=high).contains(&beam.radius_ratio) {
        let rule = format!(
            "must lie between {low} and {high}, where packings were measured: what wider or thinner beams make of a body is not known; \
             take 0.71, or let arlequin calibrate find it"
        );
        return Err(value(
            format!("{path}.dem.radius_ratio"),
            beam.radius_ratio,
            &rule,
        ));
    }
    // Any length will do: the check is that of the constants.
    beam.rigidity(1.0).map_err(dem(format!("{path}.dem")))?;
    Ok(beam)
}

/// Poisson's ratio for which beams are chosen by the table of measured packings; `None` where the beams of
/// 0.71 mean radii fit (0.174) within the scatter between packings: strengths are calibrated with them.
fn ratio_from_table(table: &LoweredModel, material: &Material) -> Option<f64> {
    let wanted = material.poisson;
    match table.shape {
        BodyShape::Piece(_) => Some(wanted.unwrap_or(0.0)),
        BodyShape::Given(_) | BodyShape::Reservoir(_) | BodyShape::Remote => {
            wanted.filter(|nu| (nu - BeamMaterial::SILICA.bulk()[1]).abs() > ALIKE[1])
        }
    }
}

/// Warning about beams that are wider than those of the table of measured packings.
pub(super) fn beyond_the_table(table: &LoweredModel, beam: &BeamMaterial) -> Option<String> {
    let [low, high] = BeamMaterial::BULK_RATIOS;
    let ratio = table.dem.radius_ratio.filter(|r| !(low..=high).contains(r))?;
    let [young, poisson] = beam.bulk();
    Some(format!(
        "dem.radius_ratio = {ratio} lies outside of {low} to {high}, where the stiffness of packings was measured: E = \
         {young:.3e} Pa and nu = {poisson:.3} are extrapolated; arlequin calibrate measures them"
    ))
}

/// Warning if the packing of a model that is no zone differs from the `material` of its table.
pub(super) fn unlike_its_material(table: &LoweredModel, beam: &BeamMaterial) -> Option<String> {
    if let BodyShape::Piece(_) = table.shape {
        return None;
    }
    let [young, poisson] = beam.bulk();
    let (m, t) = (table.material?, &table.dem);
    let mut unlike = Vec::new();
    if (young / m.young - 1.0).abs() > ALIKE[0] {
        unlike.push(format!(
            "material.young = {:e} Pa is that of contact and of estimates only",
            m.young
        ));
    }
    if let Some(nu) = m.poisson.filter(|nu| (poisson - nu).abs() > ALIKE[1]) {
        unlike.push(format!("material.poisson = {nu} is that of estimates only"));
    }
    let [low, high] = BeamMaterial::BULK_POISSON;
    let remedy = match (t.young, t.poisson, t.radius_ratio) {
        (None, None, _) => format!("packings of spheres reach nu = {low:.2} to {high:.2}"),
        (_, _, None) => "leave dem.young and dem.poisson out: material then chooses the beams".to_owned(),
        (_, _, Some(_)) => "give material what arlequin calibrate finds for these beams".to_owned(),
    };
    (!unlike.is_empty()).then(|| {
        format!(
            "its beams make a packing of about E = {young:.3e} Pa and nu = {poisson:.3}, and {}: {remedy}",
            unlike.join(", ")
        )
    })
}

/// Warning if the packing of a zone is stiffer or softer than the body around it, by the measured stiffness
/// or by the known one of its beams.
pub(super) fn unlike_the_body(
    table: &LoweredModel,
    beam: &BeamMaterial,
    likeness: Option<&Likeness>,
) -> Option<String> {
    let BodyShape::Piece(_) = table.shape else {
        return None;
    };
    let main = table.material?;
    let [body_young, ratio] = [main.young, main.poisson.unwrap_or(0.0)];
    // The measured stiffness holds for this packing in its place; that of the beams is a mean over packings.
    let [young, poisson] = match likeness {
        Some(measured) => [body_young * measured.stiffness, beam.bulk()[1]],
        None => beam.bulk(),
    };
    if (young / body_young - 1.0).abs() > ALIKE[0] || (poisson - ratio).abs() > ALIKE[1] {
        let chosen = table.dem.young.is_some() || table.dem.poisson.is_some();
        let [low, high] = BeamMaterial::BULK_POISSON;
        let remedy = match chosen {
            true => {
                "leave dem.young, dem.poisson and dem.radius_ratio out: beams are then fitted to the body"
                    .to_owned()
            }
            false => format!("packings of spheres reach nu = {low:.2} to {high:.2}"),
        };
        return Some(format!(
            "its packing acts in its place like a material of E = {young:.3e} Pa and nu = {poisson:.3}, and the body has E = \
             {body_young:.3e} Pa and nu = {ratio:.3}: stresses go around the zone or into it; {remedy}"
        ));
    }
    let likeness = likeness?;
    if likeness.uneven > UNEVEN {
        return Some(format!(
            "its packing is as stiff as the body on the average, but not in every direction: {:.0} % apart; take \
             smaller spheres, another dem.seed or a wider zone",
            100.0 * likeness.uneven
        ));
    }
    let spheres_across = likeness.across.filter(|n| *n < ACROSS)?;
    Some(format!(
        "it hangs on the rest by a border that is {spheres_across:.1} spheres across: its free end may move some 5 % more or less than \
         the body's would, as such packings did with 8; with 12 they were within 2 %: take smaller spheres, or compare with \
         kind = \"fem\""
    ))
}

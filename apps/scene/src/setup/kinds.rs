//! The kinds of models: builds a body from a table of the scene.
//!
//! A new kind needs a variant of [`ModelKind`], a branch in [`body`] and a function that returns a [`Body`];
//! its own keys go into a table of that name in [`ModelTable`].

use super::clock::SetupClock;
use super::grains::Grains;
use super::link;
use super::materials;
use super::mesh::{self, Grid};
use super::slit;
use super::zone::Supports;
use crate::error::{Result, core, fem, value};
use crate::spec::{Effect, Material, ModelKind, ModelTable, RoleKind, Shape};
use arlequin::core::effect::SurfaceFacet;
use arlequin::core::{CoarseModel, FineModel, Interpolation, Materials, Model, Participant};
use arlequin::fem_ref::generate::Rim;
use arlequin::fem_ref::{Elastic, FemModel};
use spring_chain::Chain;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A model with the data that supports, loads and output need.
pub struct Body {
    /// The model.
    pub model: Box<dyn Model<f64>>,
    /// The external solver behind the model, for a link.
    pub solver: Option<Box<dyn Participant<f64>>>,
    /// Displacement field of the model.
    pub field: Arc<dyn Interpolation<f64>>,
    /// Mesh for output.
    pub grid: Arc<Grid>,
    /// Nodes of the named groups.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// Facets of the named surfaces.
    pub surfaces: BTreeMap<String, Vec<SurfaceFacet<f64>>>,
    /// All facets of the surface, for models that have one.
    pub boundary: Vec<SurfaceFacet<f64>>,
    /// Mean distance between nodes or particles \[m\].
    pub spacing: f64,
    /// Main material; volumes of a mesh file can have others. `None` for a link, which does not report it.
    pub material: Option<Elastic<f64>>,
    /// Materials of the elements; `None` for a link.
    pub materials: Option<Materials<f64>>,
    /// Shape of the body.
    pub shape: Shape,
    /// Data that only particles have.
    pub grains: Option<Grains>,
    /// Warnings for the user, without the name of the model.
    pub warnings: Vec<String>,
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Body of {}", self.model.name())
    }
}

/// Main material of a body.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn material<'a>(path: &str, body: &'a Body) -> Result<&'a Elastic<f64>> {
    body.material.as_ref().ok_or_else(|| {
        let name = body.model.name();
        let rule =
            format!("needs the material of model '{name}', which is a link and does not tell it; remove it");
        crate::error::key(path, rule)
    })
}

/// Largest wave speed over all materials of a body \[m/s\]; the function maps a material to its speed.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn fastest(path: &str, body: &Body, speed: impl Fn(&Elastic<f64>) -> f64) -> Result<f64> {
    let main = speed(material(path, body)?);
    let materials = body.materials.iter().flat_map(Materials::all);
    Ok(materials.map(speed).fold(main, f64::max))
}

/// Speed of bar waves at each node \[m/s\]: the highest of the elements around the node.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn bar_speeds(path: &str, body: &Body) -> Result<Vec<f64>> {
    let main = material(path, body)?.bar_speed();
    let Some(materials) = body.materials.as_ref().filter(|m| m.elements().is_some()) else {
        return Ok(vec![main; body.model.nodes().len()]);
    };
    let mut out = vec![0.0_f64; body.model.nodes().len()];
    for (e, corners) in body.grid.connectivity.chunks_exact(body.grid.corners).enumerate() {
        let speed = materials.at(e).bar_speed();
        for k in corners {
            out[*k as usize] = out[*k as usize].max(speed);
        }
    }
    Ok(out)
}

/// Builds the body of `[model.NAME]`; paths are relative to `folder`. `effects` are the effects on this model
/// with their numbers in the scene, `supports` the supports of the model; models of particles read both.
pub(super) fn body(
    name: &str,
    table: &ModelTable,
    folder: &Path,
    (effects, supports): (&[(usize, &Effect)], Supports<'_>),
    clock: &mut SetupClock<'_>,
) -> Result<Body> {
    let key = format!("model.{name}");
    clock.begin(format!("model '{name}'"));
    if table.kind != ModelKind::Link {
        elastic(&key, &table.material)?;
    }
    match table.kind {
        ModelKind::Link => link::body(name, &key, table, folder),
        ModelKind::Fem => finite_elements(name, &key, table, folder),
        ModelKind::Cnem => super::natural::body(name, &key, table, folder, clock),
        ModelKind::Dem => super::particles::body(name, &key, table, (folder, effects, supports), clock),
        ModelKind::Chain => chain(name, &key, table),
    }
}

/// Material of a table; Poisson's ratio is zero if the table has none.
pub(super) fn elastic(key: &str, m: &Material) -> Result<Elastic<f64>> {
    elastic_at(&format!("{key}.material"), m)
}

/// Material with the key path `key`; Poisson's ratio is zero if it has none.
pub(super) fn elastic_at(key: &str, m: &Material) -> Result<Elastic<f64>> {
    for (name, x, unit) in [("young", m.young, "Pa"), ("density", m.density, "kg/m³")] {
        if x <= 0.0 {
            let rule = format!("must be positive [{unit}]");
            return Err(value(format!("{key}.{name}"), x, &rule));
        }
    }
    match m.poisson {
        Some(nu) if !(nu > -1.0 && nu < 0.5) => Err(value(
            format!("{key}.poisson"),
            nu,
            "must lie above -1 and below 0.5; nearly incompressible materials lock elements of first order, and a warning says how \
             far: take 0.45 or less, or a finer mesh",
        )),
        nu => Elastic::new(m.young, nu.unwrap_or(0.0), m.density).map_err(core(key)),
    }
}

/// Request for the mesh that a table of finite elements describes.
pub(super) fn request<'a>(
    key: &'a str,
    table: &'a ModelTable,
    folder: &'a Path,
) -> Result<mesh::Request<'a>> {
    if !matches!(table.shape, Shape::Bar { .. }) {
        solid_poisson(key, table)?;
    }
    Ok(mesh::Request {
        key,
        shape: &table.shape,
        spacing: table.spacing,
        divisions: table.divisions.as_deref(),
        element: table.fem.element,
        rim: Rim::EqualArea,
        scale: table.scale,
        volume: table.volume.as_deref(),
        cloud: false,
        folder,
    })
}

/// Checks what can be checked before anything is meshed or packed.
pub(super) fn check(name: &str, table: &ModelTable, folder: &Path) -> Result<()> {
    let key = format!("model.{name}");
    link::check(&key, table)?;
    slit::check(&key, table)?;
    if table.kind != ModelKind::Link {
        elastic(&key, &table.material)?;
    }
    match table.kind {
        ModelKind::Link => Ok(()),
        ModelKind::Fem => request(&key, table, folder)?.check_body(),
        ModelKind::Cnem => super::natural::request(&key, table, folder)?.check_body(),
        ModelKind::Dem => super::particles::check(&key, table, folder),
        ModelKind::Chain => line(&key, table).map(|_| ()),
    }?;
    volumes(&key, table)
}

/// Refuses materials for volumes if the shape has no volumes.
fn volumes(key: &str, table: &ModelTable) -> Result<()> {
    let filed = match &table.shape {
        Shape::File(_) => true,
        Shape::Piece(piece) => piece.is_of_file(),
        _ => false,
    };
    let rule = match (table.materials.is_empty(), table.kind, filed) {
        (true, ..) | (_, ModelKind::Fem | ModelKind::Dem, true) => return Ok(()),
        (_, ModelKind::Cnem, _) => {
            "the cell of a natural element lies on both sides of a border between two materials; take kind = \"fem\", or a \
             model of each part with volume"
        }
        _ => "only a mesh file tells volumes apart; give one material",
    };
    Err(crate::error::key(format!("{key}.materials"), rule))
}

fn finite_elements(name: &str, key: &str, table: &ModelTable, folder: &Path) -> Result<Body> {
    let mesh = slit::cut(key, table, request(key, table, folder)?.mesh()?)?;
    let material = elastic(key, &table.material)?;
    let mut groups = BTreeMap::new();
    let mut surfaces = BTreeMap::new();
    for (n, g) in mesh.groups() {
        groups.insert(n.clone(), g.nodes.iter().map(|&k| k as usize).collect());
        if !g.facets.is_empty() {
            surfaces.insert(n.clone(), mesh.surface(n).map_err(fem(key))?);
        }
    }
    let boundary = mesh.surface_where(|_| true);
    let mut warnings = materials::warnings(table, &mesh);
    let materials = materials::element_materials(key, table, &mesh)?;
    let grid = Grid::of_mesh(&mesh);
    let spacing = mesh.spacing();
    let model = FemModel::new(name, mesh, materials.clone()).map_err(fem(key))?;
    warnings.extend(model.warnings());
    Ok(Body {
        field: model.coarse_field(),
        model: Box::new(model),
        solver: None,
        grid: Arc::new(grid),
        groups,
        surfaces,
        boundary,
        spacing,
        material: Some(material),
        materials: Some(materials),
        shape: table.shape.clone(),
        grains: None,
        warnings,
    })
}

/// Refuses a solid without Poisson's ratio.
pub(super) fn solid_poisson(key: &str, table: &ModelTable) -> Result<()> {
    table.material.poisson.map(|_| ()).ok_or_else(|| {
        crate::error::key(
            format!("{key}.material"),
            "a solid needs poisson, Poisson's ratio [-]; add poisson = 0.3 or what the material has",
        )
    })
}

/// Ends \[m\], section \[m²\] and number of bonds of a chain.
fn line(key: &str, table: &ModelTable) -> Result<(f64, f64, f64, usize)> {
    let Shape::Bar { from, to, section } = table.shape else {
        return Err(value(
            format!("{key}.shape"),
            table.shape.name(),
            "a chain is a line; use the shape bar, or another kind of model",
        ));
    };
    if table.role == Some(RoleKind::Coarse) {
        return Err(value(
            format!("{key}.role"),
            "coarse",
            "a chain is discrete and can only be fine; give the coarse role to a fem model",
        ));
    }
    mesh::check_bar(key, from, to, section)?;
    let bonds = mesh::divisions_of(key, &[to - from], table.spacing, table.divisions.as_deref())?[0];
    Ok((from, to, section, bonds))
}

fn chain(name: &str, key: &str, table: &ModelTable) -> Result<Body> {
    let (from, to, section, bonds) = line(key, table)?;
    let spacing = (to - from) / bonds as f64;
    let mass = table.material.density * section * spacing;
    let stiffness = table.material.young * section / spacing;
    let material = elastic(key, &table.material)?;
    let model = Chain::new(name, from, spacing, bonds, mass, stiffness);
    let model = model.and_then(|c| c.with_section(section)).map_err(core(key))?;
    let ends = [("x-min", vec![0]), ("x-max", vec![bonds])];
    Ok(Body {
        field: model.fine_field(),
        grid: Arc::new(Grid::of_line(model.nodes())),
        model: Box::new(model),
        solver: None,
        groups: ends.map(|(n, k)| (n.to_owned(), k)).into_iter().collect(),
        surfaces: BTreeMap::new(),
        boundary: Vec::new(),
        spacing,
        material: Some(material),
        materials: Some(material.into()),
        shape: table.shape.clone(),
        grains: None,
        warnings: Vec::new(),
    })
}

//! `kind = "cnem"`: the nodes of a mesh carry natural-neighbour functions instead of elements.

use super::clock::SetupClock;
use super::kinds::{Body, solid_poisson};
use super::materials;
use super::mesh::{Grid, Request};
use crate::error::{Result, cnem as natural, fem, value};
use crate::spec::{CnemTable, Element, Functions, Masses, ModelTable, Shape};
use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::natural::Interpolant;
use arlequin::cnem::{CnemModel, Inertia, Options, Stabilisation};
use arlequin::core::CoarseModel;
use arlequin::fem_ref::Mesh;
use arlequin::fem_ref::generate::Rim;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// The mesh whose nodes a table asks for.
pub(super) fn request<'a>(key: &'a str, table: &'a ModelTable, folder: &'a Path) -> Result<Request<'a>> {
    if let Shape::Bar { .. } = table.shape {
        let rule =
            "natural elements fill solids; use a box, a cylinder or a file, or kind = \"fem\" for a bar";
        return Err(value(format!("{key}.shape"), table.shape.name(), rule));
    }
    solid_poisson(key, table)?;
    Ok(Request {
        key,
        shape: &table.shape,
        spacing: table.spacing,
        divisions: table.divisions.as_deref(),
        element: Element::Tet4,
        rim: Rim::EqualArea,
        scale: table.scale,
        volume: table.volume.as_deref(),
        cloud: true,
        folder,
    })
}

/// Builds a natural-element body on the nodes of the mesh that the same table would give finite elements.
pub(super) fn body(
    name: &str,
    key: &str,
    table: &ModelTable,
    folder: &Path,
    clock: &mut SetupClock<'_>,
) -> Result<Body> {
    let request = request(key, table, folder)?;
    let mesh = request.mesh()?.into_tetrahedra().map_err(fem(key))?;
    let material = super::kinds::elastic(key, &table.material)?;
    let corners: Vec<[usize; 4]> = (0..mesh.element_count())
        .map(|e| [0, 1, 2, 3].map(|k: usize| mesh.element(e)[k] as usize))
        .collect();
    clock.begin(format!("tetrahedra of '{name}'"));
    let domain = Domain::new(mesh.nodes(), &Surface::of_elements(&corners)).map_err(natural(key))?;
    clock.begin(format!("cells and natural neighbours of '{name}'"));
    let model = CnemModel::new(name, domain, material, options(&table.cnem)).map_err(natural(key))?;
    let mut warnings = model.warnings();
    warnings.extend(materials::warnings(table, &mesh));
    let groups = groups(&mesh, &model);
    let surfaces = surfaces(&mesh, &model, &groups);
    let boundary = model.surface(|_| true).map_err(natural(key))?;
    let grid = Grid {
        points: model.domain().nodes().to_vec(),
        connectivity: model.domain().elements().flatten().map(|v| v as u32).collect(),
        corners: 4,
        cell_type: 10,
        radii: Vec::new(),
    };
    Ok(Body {
        field: model.coarse_field(),
        model: Box::new(model),
        solver: None,
        grid: Arc::new(grid),
        groups,
        surfaces,
        boundary,
        spacing: mesh.spacing(),
        material: Some(material),
        materials: Some(material.into()),
        shape: table.shape.clone(),
        grains: None,
        warnings,
    })
}

fn options(table: &CnemTable) -> Options {
    let default = Options::default();
    Options {
        kind: match table.functions {
            None => default.kind,
            Some(Functions::Sibson) => Interpolant::Sibson,
            Some(Functions::Laplace) => Interpolant::Laplace,
        },
        stabilisation: match table.stabilisation {
            None => default.stabilisation,
            Some(0.0) => Stabilisation::None,
            Some(a) => Stabilisation::SubCells(a),
        },
        inertia: match table.inertia {
            None => default.inertia,
            Some(Masses::Cells) => Inertia::Cells,
            Some(Masses::Centroids) => Inertia::Centroids,
        },
    }
}

/// Corners of every boundary triangle.
fn faces(model: &CnemModel) -> Vec<[usize; 3]> {
    model.domain().constrained_faces().map(|f| f.0).collect()
}

/// Named sets of nodes: those of the mesh, and the points inserted on faces within a set.
fn groups(mesh: &Mesh<f64>, model: &CnemModel) -> BTreeMap<String, Vec<usize>> {
    let faces = faces(model);
    let named = mesh.groups().iter().map(|(name, group)| {
        let mut nodes: BTreeSet<usize> = group.nodes.iter().map(|&k| k as usize).collect();
        let own: Vec<usize> = (mesh.nodes().len()..model.domain().nodes().len())
            .filter(|n| {
                let around = faces.iter().filter(|f| f.contains(n)).flatten();
                around.clone().any(|k| nodes.contains(k))
                    && faces.iter().any(|f| {
                        f.contains(n) && f.iter().all(|k| k >= &mesh.nodes().len() || nodes.contains(k))
                    })
            })
            .collect();
        nodes.extend(own);
        (name.clone(), nodes.into_iter().collect())
    });
    named.collect()
}

/// Named surfaces: the boundary facets on triangles whose corners all belong to the group.
fn surfaces(
    mesh: &Mesh<f64>,
    model: &CnemModel,
    groups: &BTreeMap<String, Vec<usize>>,
) -> BTreeMap<String, Vec<arlequin::core::effect::SurfaceFacet<f64>>> {
    let faces = faces(model);
    let named = mesh.groups().iter().filter(|(_, g)| !g.facets.is_empty());
    named
        .filter_map(|(name, _)| {
            let nodes: BTreeSet<usize> = groups[name].iter().copied().collect();
            let whole = model.surface(|f| faces[f.face].iter().all(|k| nodes.contains(k)));
            whole.ok().map(|s| (name.clone(), s))
        })
        .collect()
}

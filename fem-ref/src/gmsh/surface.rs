//! The surface of what a Gmsh file holds, as triangles: for bodies that are filled rather than meshed.

use super::assemble::{self, collect_groups};
use super::contents::Contents;
use super::{contents, fault};
use crate::check::node_set;
use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use mshio::mshfile::ElementType;
use nalgebra::Point3;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Triangles of a surface. Those of solids face outwards, those of surface meshes as they do in the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Triangles {
    /// Corners \[m\]; some may belong to no triangle.
    pub points: Vec<Point3<f64>>,
    /// Triangles; quadrilaterals are cut in two.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the physical surfaces, by name.
    pub groups: BTreeMap<String, Vec<[u32; 3]>>,
}

/// Reads a `.msh` file: the outer faces of its solids or, if it has none, its triangles and quadrilaterals.
///
/// # Errors
/// [`Error::File`] if it cannot be read; [`Error::Gmsh`] as [`super::parse`], and for a file with neither.
pub fn load_surface(path: impl AsRef<Path>) -> Result<Triangles> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|e| Error::File {
        path: path.display().to_string(),
        message: e.to_string(),
    })?;
    let file = contents(&bytes)?;
    let solid = [ElementType::Tet4, ElementType::Hex8];
    if file.blocks.iter().any(|b| solid.contains(&b.element_type)) {
        return Ok(triangles_of(&assemble::mesh::<f64>(&file)?));
    }
    of_faces(file)
}

fn cut(corners: &[u32]) -> Vec<[u32; 3]> {
    (2..corners.len())
        .map(|k| [corners[0], corners[k - 1], corners[k]])
        .collect()
}

/// Facets of a solid mesh as triangles, outwards; quadrilaterals are cut in two.
pub fn facets_of(mesh: &Mesh<f64>, facets: &[Facet]) -> Vec<[u32; 3]> {
    facets.iter().flat_map(|f| cut(&mesh.facet_nodes(*f))).collect()
}

/// Outer faces of a solid mesh, and those of its groups.
pub fn triangles_of(mesh: &Mesh<f64>) -> Triangles {
    let triangles = |facets: &[Facet]| facets_of(mesh, facets);
    let groups = mesh.groups().iter().filter(|(_, g)| !g.facets.is_empty());
    Triangles {
        points: mesh.nodes().to_vec(),
        triangles: triangles(&mesh.boundary()),
        groups: groups.map(|(n, g)| (n.clone(), triangles(&g.facets))).collect(),
    }
}

/// Faces of a surface mesh.
fn of_faces(file: Contents) -> Result<Triangles> {
    let mut triangles = Vec::new();
    let faces = [ElementType::Tri3, ElementType::Qua4];
    let mut known = HashSet::new();
    for block in file.blocks.iter().filter(|b| faces.contains(&b.element_type)) {
        for element in &block.elements {
            let corners = file.corners(element)?;
            // Listed twice, a face would bound nothing.
            if known.insert((block.entity, node_set(&corners))) {
                triangles.extend(cut(&corners));
            }
        }
    }
    if triangles.is_empty() {
        return Err(fault(
            "there is no Tri3, Qua4, Tet4 or Hex8 element; mesh surfaces or volumes, of first order",
        ));
    }
    let mut groups = BTreeMap::new();
    for (name, group) in collect_groups(&file)? {
        let faces = group.iter().filter(|(dimension, _)| *dimension == 2);
        let faces: Vec<[u32; 3]> = faces.flat_map(|(_, corners)| cut(corners)).collect();
        if !faces.is_empty() {
            groups.insert(name, faces);
        }
    }
    Ok(Triangles {
        points: file.nodes,
        triangles,
        groups,
    })
}

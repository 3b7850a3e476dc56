//! Surface of a Gmsh file as triangles, for bodies that are filled with particles rather than meshed.

use super::assemble::{self, collect_groups};
use super::contents::Contents;
use super::{contents, fault};
use crate::check::node_set;
use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use arlequin_core::Real;
use mshio::mshfile::ElementType;
use nalgebra::Point3;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Triangles of a surface. Triangles of solids face outwards; triangles of surface meshes face as in the
/// file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Triangles {
    /// Corners \[m\]; some may belong to no triangle.
    pub points: Vec<Point3<f64>>,
    /// Triangles; quadrilaterals are cut into two.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the physical surfaces, by group name.
    pub groups: BTreeMap<String, Vec<[u32; 3]>>,
}

/// Reads a `.msh` file: the outer faces of its solids or, without solids, its triangles and quadrilaterals.
///
/// # Errors
/// [`Error::File`] if the file cannot be read; [`Error::Gmsh`] as in [`super::parse`], and for a file without
/// solids and faces.
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
    face_triangles(file)
}

fn cut(corners: &[u32]) -> Vec<[u32; 3]> {
    (2..corners.len())
        .map(|k| [corners[0], corners[k - 1], corners[k]])
        .collect()
}

/// Facets of a solid mesh as outward triangles; quadrilaterals are cut into two.
pub fn facets_of<T: Real>(mesh: &Mesh<T>, facets: &[Facet]) -> Vec<[u32; 3]> {
    facets.iter().flat_map(|f| cut(&mesh.facet_nodes(*f))).collect()
}

/// Outer faces of a solid mesh as triangles, and the faces of its groups.
pub fn triangles_of(mesh: &Mesh<f64>) -> Triangles {
    let triangles = |facets: &[Facet]| facets_of(mesh, facets);
    let groups = mesh.groups().iter().filter(|(_, g)| !g.facets.is_empty());
    Triangles {
        points: mesh.nodes().to_vec(),
        triangles: triangles(&mesh.boundary()),
        groups: groups.map(|(n, g)| (n.clone(), triangles(&g.facets))).collect(),
    }
}

/// Triangles of a surface mesh.
fn face_triangles(file: Contents) -> Result<Triangles> {
    let mut triangles = Vec::new();
    let faces = [ElementType::Tri3, ElementType::Qua4];
    let mut known = HashSet::new();
    for block in file.blocks.iter().filter(|b| faces.contains(&b.element_type)) {
        for element in &block.elements {
            let corners = file.corners(element)?;
            // A face that is listed twice would enclose no volume.
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

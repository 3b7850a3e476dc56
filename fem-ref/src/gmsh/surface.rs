//! The surface of what a Gmsh file holds, as triangles: for bodies that are filled rather than meshed.

use super::{Block, File, collect_groups, fault, load, lookup, node_index, physical_names, prepared};
use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use mshio::mshfile::ElementType;
use nalgebra::Point3;
use std::collections::BTreeMap;
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
    let bytes = prepared(&bytes)?;
    let file = mshio::parse_msh_bytes(&bytes)
        .map_err(|_| fault("a section is broken; save the mesh again in format 4.1"))?;
    let blocks = blocks(&file);
    let solid = [ElementType::Tet4, ElementType::Hex8];
    if blocks.iter().any(|b| solid.contains(&b.element_type)) {
        return Ok(of_mesh(&load::<f64>(path)?));
    }
    of_faces(&file, &physical_names(&bytes)?)
}

fn blocks(file: &File) -> &[Block] {
    file.data.elements.as_ref().map_or(&[], |e| &e.element_blocks)
}

fn cut(corners: &[u32]) -> Vec<[u32; 3]> {
    (2..corners.len())
        .map(|k| [corners[0], corners[k - 1], corners[k]])
        .collect()
}

/// Outer faces of a solid mesh.
fn of_mesh(mesh: &Mesh<f64>) -> Triangles {
    let triangles = |facets: &[Facet]| facets.iter().flat_map(|f| cut(&mesh.facet_nodes(*f))).collect();
    let groups = mesh.groups().iter().filter(|(_, g)| !g.facets.is_empty());
    Triangles {
        points: mesh.nodes().to_vec(),
        triangles: triangles(&mesh.boundary()),
        groups: groups.map(|(n, g)| (n.clone(), triangles(&g.facets))).collect(),
    }
}

/// Faces of a surface mesh.
fn of_faces(file: &File, names: &BTreeMap<(i32, i32), String>) -> Result<Triangles> {
    let (points, index) = node_index::<f64>(file)?;
    let mut triangles = Vec::new();
    let faces = [ElementType::Tri3, ElementType::Qua4];
    for block in blocks(file).iter().filter(|b| faces.contains(&b.element_type)) {
        for element in &block.elements {
            let nodes = element
                .nodes
                .iter()
                .map(|n| lookup(&index, *n, element.element_tag));
            triangles.extend(cut(&nodes.collect::<Result<Vec<u32>>>()?));
        }
    }
    if triangles.is_empty() {
        return Err(fault(
            "there is no Tri3, Qua4, Tet4 or Hex8 element; mesh surfaces or volumes, of first order",
        ));
    }
    let mut groups = BTreeMap::new();
    if let Some(entities) = &file.data.entities {
        for (name, group) in collect_groups(blocks(file), entities, names, &index)? {
            let faces = group.iter().filter(|(dimension, _)| *dimension == 2);
            let faces: Vec<[u32; 3]> = faces.flat_map(|(_, corners)| cut(corners)).collect();
            if !faces.is_empty() {
                groups.insert(name, faces);
            }
        }
    }
    Ok(Triangles {
        points,
        triangles,
        groups,
    })
}

//! Triangles of facets, for distances from them.

pub(super) use arlequin::core::geometry::Faces;
use arlequin::core::nalgebra::Point3;
use arlequin::fem_ref::gmsh::facets_of;
use arlequin::fem_ref::{Facet, Mesh};

/// Corners of the triangles of facets \[m\]; the triangles face out of their elements.
pub(super) fn corners_of(mesh: &Mesh<f64>, facets: &[Facet]) -> Vec<[Point3<f64>; 3]> {
    let node = |k: &u32| mesh.nodes()[*k as usize];
    let triangles = facets_of(mesh, facets);
    triangles.iter().map(|t| t.each_ref().map(node)).collect()
}

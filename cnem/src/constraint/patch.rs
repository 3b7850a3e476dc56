//! Flat patches adopt the triangles that the Delaunay complex has on them.
//!
//! Nodes that are coplanar and cocircular up to round-off have many equally good triangulations. The
//! triangles of the surface, of the tetrahedra above it and of the tetrahedra below it may all differ; flat
//! tetrahedra fill the space between them. If the complex covers one side of a patch, the patch is recovered
//! by adopting the triangles of this side, whatever their diagonals: nodes, border and position are the same.

use super::FaceMesh;
use super::mesh::{ON_FACE, key};
use crate::bins::{Bins, around};
use crate::delaunay::Delaunay;
use crate::domain::{ON_BOUNDARY, is_flat, largest_coordinate};
use crate::tet::INF;
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Faces in one plane, connected over edges, with their nodes and their border.
struct Patch {
    faces: Vec<u32>,
    nodes: BTreeSet<u32>,
    border: BTreeSet<(u32, u32)>,
    normal: Vector3<f64>,
    area: f64,
}

/// Replaces the faces of the patches around `missing` where the complex covers one side of the patch. Returns
/// the number of faces replaced.
pub(super) fn adopt(delaunay: &Delaunay, mesh: &mut FaceMesh, missing: &[u32]) -> usize {
    // Below this height a tetrahedron is flat by round-off of its coordinates and proves nothing about its
    // side.
    let limit = ON_BOUNDARY * largest_coordinate(&delaunay.points);
    let (mut seen, mut replaced) = (BTreeSet::<u32>::new(), 0);
    for &face in missing {
        if seen.contains(&face) {
            continue;
        }
        let patch = Patch::around(mesh, &delaunay.points, face);
        // Each patch is tried once, however many of its faces are missing.
        seen.extend(&patch.faces);
        // Either side will do; both cover the same plane patch.
        let covering = [1.0, -1.0]
            .into_iter()
            .map(|side| patch.one_side(delaunay, patch.normal * side, limit))
            .find(|triangles| patch.is_covered_by(triangles, &delaunay.points));
        if let Some(triangles) = covering {
            replaced += patch.take_over(mesh, &delaunay.points, &triangles);
        }
    }
    replaced
}

impl Patch {
    fn around(mesh: &FaceMesh, points: &[Point3<f64>], face: u32) -> Self {
        let mut out = Self {
            faces: vec![face],
            nodes: BTreeSet::new(),
            border: BTreeSet::new(),
            normal: Vector3::zeros(),
            area: 0.0,
        };
        let mut known = BTreeSet::from([face]);
        let mut next = 0;
        while next < out.faces.len() {
            let v = mesh.faces[out.faces[next] as usize].v;
            next += 1;
            let area = twice_area(points, v) * 0.5;
            // The input need not be oriented: the first face gives the direction to the others.
            let sign = if area.dot(&out.normal) < 0.0 { -1.0 } else { 1.0 };
            out.normal += area * sign;
            out.area += area.norm();
            out.nodes.extend(v);
            for k in 0..3 {
                let edge = key(v[k], v[(k + 1) % 3]);
                toggle(&mut out.border, edge);
                let Some([f, g, ..]) = mesh.flat_pair(points, edge) else {
                    continue;
                };
                for neighbour in [f, g] {
                    if known.insert(neighbour) {
                        out.faces.push(neighbour);
                    }
                }
            }
        }
        out.normal.normalize_mut();
        out
    }

    /// Returns the faces of the complex on nodes of the patch that lie below tetrahedra with a thickness, on
    /// the side that `up` points to. The faces are ordered as seen from that side.
    fn one_side(&self, delaunay: &Delaunay, up: Vector3<f64>, limit: f64) -> Vec<[u32; 3]> {
        let mut out = Vec::new();
        let mut star = Vec::new();
        for &node in &self.nodes {
            delaunay.star(node, &mut star);
            for t in star.iter().map(|&t| &delaunay.tets[t as usize]) {
                for slot in 0..4 {
                    let [a, b, c] = t.face(slot);
                    let on_patch = [a, b, c].iter().all(|v| self.nodes.contains(v));
                    // Each face is found from the star of each of its nodes: it is taken at the smallest one
                    // alone.
                    if t.v[slot] == INF || node != a.min(b).min(c) || !on_patch {
                        continue;
                    }
                    let apex = delaunay.points[t.v[slot] as usize] - delaunay.points[a as usize];
                    // Flat tetrahedra on the patch are what the two sides differ by: only one with a
                    // thickness shows the side.
                    let high = up.dot(&apex) > limit.max(ON_FACE * apex.norm());
                    if high && !t.is_ghost() && !is_flat(delaunay.corners(t), limit) {
                        out.push([a, c, b]);
                    }
                }
            }
        }
        out
    }

    /// Returns whether triangles on the nodes of the patch have its border and its area.
    fn is_covered_by(&self, triangles: &[[u32; 3]], points: &[Point3<f64>]) -> bool {
        let mut border = BTreeSet::new();
        let mut area = 0.0;
        for v in triangles {
            area += twice_area(points, *v).norm() * 0.5;
            (0..3).for_each(|k| toggle(&mut border, key(v[k], v[(k + 1) % 3])));
        }
        // The same border alone could be that of a folded set of triangles. The limit is above the 1e-10 to
        // which patches are flat.
        triangles.len() == self.faces.len()
            && border == self.border
            && (area - self.area).abs() <= 1e-9 * self.area
    }

    /// Gives the faces new corners. The input face of a new triangle is the one that holds its centroid.
    /// Returns the number of new faces.
    fn take_over(&self, mesh: &mut FaceMesh, points: &[Point3<f64>], triangles: &[[u32; 3]]) -> usize {
        let sorted = |mut v: [u32; 3]| {
            v.sort_unstable();
            v
        };
        let corners_of = |id: &u32| sorted(mesh.faces[*id as usize].v);
        let mut old: BTreeMap<[u32; 3], u32> = self.faces.iter().map(|id| (corners_of(id), *id)).collect();
        let mut new: Vec<[u32; 3]> = Vec::new();
        // Triangles that the patch already has keep their face and their origin.
        for v in triangles {
            if old.remove(&sorted(*v)).is_none() {
                new.push(*v);
            }
        }
        let boxes = old.values().map(|id| mesh.faces[*id as usize].v);
        let boxes = boxes
            .map(|v| around(v.iter().map(|&v| &points[v as usize]), 0.0))
            .collect();
        let (bins, ids) = (Bins::new(boxes), old.values().copied().collect::<Vec<_>>());
        let corners: Vec<[u32; 3]> = ids.iter().map(|&id| mesh.faces[id as usize].v).collect();
        let origins: Vec<u32> = ids.iter().map(|&id| mesh.faces[id as usize].origin).collect();
        let mut near = Vec::new();
        // Old and new have the same number of faces: `is_covered_by` has compared them.
        for (&id, v) in ids.iter().zip(&new) {
            let middle =
                Point3::from(v.iter().map(|&v| points[v as usize].coords).sum::<Vector3<f64>>() / 3.0);
            bins.overlapping(&around([&middle], ON_FACE * self.area.sqrt()), &mut near);
            let depth = |k: &u32| depth(corners[*k as usize].map(|v| &points[v as usize]), &middle);
            // The deepest inside: round-off may put a centroid on the border of two input faces.
            let holds = near.iter().max_by(|a, b| depth(a).total_cmp(&depth(b)));
            // The new corners keep the orientation of the face that they replace.
            let turn = if twice_area(points, *v).dot(&twice_area(points, mesh.faces[id as usize].v)) < 0.0 {
                [v[0], v[2], v[1]]
            } else {
                *v
            };
            mesh.replace(id, turn);
            if let Some(&k) = holds {
                mesh.faces[id as usize].origin = origins[k as usize];
            }
        }
        new.len()
    }
}

fn twice_area(points: &[Point3<f64>], v: [u32; 3]) -> Vector3<f64> {
    let [a, b, c] = v.map(|v| &points[v as usize]);
    (b - a).cross(&(c - a))
}

/// Returns the smallest barycentric coordinate \[–\] of a point in the plane of a triangle.
pub(crate) fn depth(corners: [&Point3<f64>; 3], x: &Point3<f64>) -> f64 {
    let n = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    // Signed by the normal: negative where the point is outside of that edge.
    let part = |k: usize| {
        (corners[(k + 1) % 3] - x)
            .cross(&(corners[(k + 2) % 3] - x))
            .dot(&n)
    };
    part(0).min(part(1)).min(part(2)) / n.norm_squared()
}

/// Adds an edge, or removes it if it is already there: after all triangles the border remains.
fn toggle(edges: &mut BTreeSet<(u32, u32)>, edge: (u32, u32)) {
    if !edges.remove(&edge) {
        edges.insert(edge);
    }
}

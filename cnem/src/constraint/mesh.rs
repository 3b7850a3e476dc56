//! The constrained faces as a mesh that can be swapped and split.

use crate::predicates::{insphere, insphere_perturbed, orient3d};
use nalgebra::{Point3, Vector3};
use std::cmp::Ordering;
use std::collections::HashMap;

/// Distance from a face, relative to its size, up to which a point counts as lying on it.
pub(crate) const ON_FACE: f64 = 1e-10;

/// One constrained face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Face {
    pub(crate) v: [u32; 3],
    pub(crate) crack: bool,
    /// Input face that this face is part of.
    pub(crate) origin: u32,
}

/// Constrained faces, and the faces at every edge.
#[derive(Debug, Clone, Default)]
pub(crate) struct FaceMesh {
    pub(crate) faces: Vec<Face>,
    pub(crate) edges: HashMap<(u32, u32), Vec<u32>>,
}

/// Returns the key of an undirected edge.
pub(crate) fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

impl FaceMesh {
    pub(crate) fn new(surface: &super::Surface) -> Self {
        let mut mesh = Self::default();
        let boundary = surface.boundary.len();
        for (i, f) in surface.faces().enumerate() {
            mesh.push(Face {
                v: f.map(|v| v as u32),
                crack: i >= boundary,
                origin: i as u32,
            });
        }
        mesh
    }

    pub(crate) fn push(&mut self, face: Face) {
        let id = self.faces.len() as u32;
        self.faces.push(face);
        self.link(id);
    }

    fn link(&mut self, id: u32) {
        let v = self.faces[id as usize].v;
        for k in 0..3 {
            self.edges.entry(key(v[k], v[(k + 1) % 3])).or_default().push(id);
        }
    }

    fn unlink(&mut self, id: u32) {
        let v = self.faces[id as usize].v;
        for k in 0..3 {
            let edge = key(v[k], v[(k + 1) % 3]);
            if let Some(list) = self.edges.get_mut(&edge) {
                list.retain(|&f| f != id);
                if list.is_empty() {
                    self.edges.remove(&edge);
                }
            }
        }
    }

    /// Replaces the corners of a face.
    pub(crate) fn replace(&mut self, id: u32, v: [u32; 3]) {
        self.unlink(id);
        self.faces[id as usize].v = v;
        self.link(id);
    }

    /// Returns the two faces at an edge and their apexes `(f, g, c, d)`, if the edge is inside a flat patch
    /// of boundary or of crack faces.
    pub(crate) fn flat_pair(&self, points: &[Point3<f64>], edge: (u32, u32)) -> Option<[u32; 4]> {
        let list = self.edges.get(&edge)?;
        // More than two faces meet at the edge: the patch branches there, and no diagonal can be swapped.
        let &[f, g] = list.as_slice() else { return None };
        // A swap must not make a boundary face of a crack face.
        if self.faces[f as usize].crack != self.faces[g as usize].crack {
            return None;
        }
        let apex = |id: u32| {
            self.faces[id as usize]
                .v
                .into_iter()
                .find(|&v| v != edge.0 && v != edge.1)
        };
        let (c, d) = (apex(f)?, apex(g)?);
        let [pa, pb, pc, pd] = [edge.0, edge.1, c, d].map(|v| &points[v as usize]);
        let n = (pb - pa).cross(&(pc - pa));
        // Taken the other way round, so that both normals agree where the patch is flat and not folded.
        let m = (pd - pa).cross(&(pb - pa));
        let height = n.dot(&(pd - pa)).abs();
        // Relative to the longer edge at `d`: its height above the other plane is judged by its own size.
        let flat = height <= ON_FACE * n.norm() * (pd - pa).norm().max((pd - pb).norm());
        (c != d && flat && n.dot(&m) > 0.0).then_some([f, g, c, d])
    }

    /// Returns whether the diagonal of a flat pair can be swapped: the quadrilateral is strictly convex.
    pub(crate) fn swappable(&self, points: &[Point3<f64>], edge: (u32, u32), c: u32, d: u32) -> bool {
        let [a, b, c, d] = [edge.0, edge.1, c, d].map(|v| &points[v as usize]);
        let n = (b - a).cross(&(c - a));
        let area = |p: &Point3<f64>, q: &Point3<f64>, r: &Point3<f64>| (q - p).cross(&(r - p)).dot(&n);
        // Above round-off: a swap must not make triangles without area.
        let small = 1e-12 * n.norm_squared();
        // Strictly convex: both triangles of the other diagonal have an area, on the same side.
        area(c, a, d) > small && area(d, b, c) > small
    }

    /// Swaps the diagonal of the two faces `[f, g, c, d]` from [`Self::flat_pair`].
    pub(crate) fn swap(&mut self, edge: (u32, u32), [f, g, c, d]: [u32; 4]) {
        let old = self.faces[f as usize].v;
        let with_edge = (0..3).any(|k| old[k] == edge.0 && old[(k + 1) % 3] == edge.1);
        // The new faces run counter-clockwise as seen from where `old` does.
        let (c, d) = if with_edge { (c, d) } else { (d, c) };
        self.unlink(f);
        self.unlink(g);
        self.faces[f as usize].v = [c, edge.0, d];
        self.faces[g as usize].v = [d, edge.1, c];
        self.link(f);
        self.link(g);
    }

    /// Splits an edge at the node `m`, and with it every face at the edge.
    pub(crate) fn split_edge(&mut self, edge: (u32, u32), m: u32) {
        let Some(list) = self.edges.get(&edge).cloned() else {
            return;
        };
        // The list is a copy: replacing a face changes the lists of its edges.
        for id in list {
            let face = self.faces[id as usize];
            // Each face keeps its orientation, crack flag and origin; only a corner changes.
            let replace_by_m = |end: u32| face.v.map(|v| if v == end { m } else { v });
            self.replace(id, replace_by_m(edge.0));
            self.push(Face {
                v: replace_by_m(edge.1),
                ..face
            });
        }
    }

    /// Splits a face into three at the node `m`.
    pub(crate) fn split_face(&mut self, id: u32, m: u32) {
        let face = self.faces[id as usize];
        let [a, b, c] = face.v;
        self.replace(id, [a, b, m]);
        self.push(Face { v: [b, c, m], ..face });
        self.push(Face { v: [c, a, m], ..face });
    }
}

/// Returns whether `d` is inside the circle through `a`, `b`, `c` in their common plane. Ties are broken by
/// index as in the Delaunay complex.
pub(crate) fn in_circle(points: &[Point3<f64>], [a, b, c, d]: [u32; 4]) -> bool {
    let [pa, pb, pc, pd] = [a, b, c, d].map(|v| &points[v as usize]);
    let n: Vector3<f64> = (pb - pa).cross(&(pc - pa));
    let size = (pb - pa).norm();
    // An auxiliary point off the plane turns the circle into a sphere. Any such point gives the same answer;
    // the size of the triangle keeps all numbers of one order.
    let aux = pa + n * (size / n.norm());
    // Rank 0 goes to the auxiliary point, so that it never decides a tie before a node.
    let rank = |v: u32| u64::from(v) + 1;
    let (corners, ranks) = match orient3d(pa, pb, pc, &aux) {
        // The sphere test wants a positive orientation; exchanging two corners must exchange their ranks too.
        Ordering::Greater => ([pa, pb, pc, &aux], [rank(a), rank(b), rank(c), 0, rank(d)]),
        Ordering::Less => ([pb, pa, pc, &aux], [rank(b), rank(a), rank(c), 0, rank(d)]),
        Ordering::Equal => return false,
    };
    match insphere(corners, pd) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal => insphere_perturbed(corners, pd, ranks),
    }
}

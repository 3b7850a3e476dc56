//! Limits of the shape functions on a flat patch of constrained faces: 2D natural neighbours of the patch.

use super::Interpolant;
use crate::constraint::key;
use crate::domain::Domain;
use nalgebra::{Point3, Vector2, Vector3};

/// Largest number of faces of a cavity in a patch.
const MAX_FACES: usize = 256;

/// Working buffers of the evaluation on a patch, and its result.
#[derive(Debug, Clone, Default)]
pub(super) struct Planar {
    pub(super) nodes: Vec<u32>,
    pub(super) weights: Vec<f64>,
    faces: Vec<Triangle>,
    rel: Vec<Vector2<f64>>,
    rel3: Vec<Vector3<f64>>,
    area: Vec<f64>,
    moment: Vec<Vector2<f64>>,
    /// For each node the circumcentres of the border edge that leaves it and of the one that reaches it.
    gates: Vec<[Vector2<f64>; 2]>,
}

/// Face of the cavity, counter-clockwise in the plane of the patch.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    face: u32,
    v: [u32; 3],
    centre: Vector2<f64>,
}

fn cross(a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

/// Returns the circumcentre of three points in a plane.
fn circumcentre(o: &Vector2<f64>, p: &Vector2<f64>, q: &Vector2<f64>) -> Vector2<f64> {
    let (b, c) = (p - o, q - o);
    let (b2, c2) = (b.norm_squared(), c.norm_squared());
    o + Vector2::new(c.y * b2 - b.y * c2, b.x * c2 - c.x * b2) * (0.5 / cross(&b, &c))
}

impl Domain {
    /// Computes the weights of the nodes of the patch around `face`, which holds `x`, as seen from the side
    /// of the tetrahedron `tet`. Returns false if the linear functions of the face had to be used.
    pub(super) fn on_patch(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        face: u32,
        tet: u32,
        s: &mut Planar,
    ) -> bool {
        let corners = self.corners_of(tet).map(|v| self.delaunay.points[v] - x);
        // The sum of the corners points to the inside of the tetrahedron, from whose side the patch is seen.
        let side = self.side_towards(face, &corners.into_iter().sum());
        let v = self.face_on_side(face, side);
        let [a, b, c] = v.map(|v| self.delaunay.points[v as usize]);
        let normal = (b - a).cross(&(c - a));
        // On axis-parallel planes two coordinates are kept unchanged, so that circle tests on grids are
        // exact.
        let u = (b - a).normalize();
        let w = normal.normalize().cross(&u);
        let axis_parallel = normal.iter().filter(|n| **n != 0.0).count() == 1;
        let k = normal.iamax();
        // The projection must not mirror: circle tests depend on the orientation.
        let flip = if normal[k] > 0.0 { 1.0 } else { -1.0 };
        let project = |p: &Point3<f64>| {
            let d = p - x;
            if axis_parallel {
                Vector2::new(d[(k + 1) % 3] * flip, d[(k + 2) % 3])
            } else {
                Vector2::new(d.dot(&u), d.dot(&w))
            }
        };
        s.nodes.clear();
        s.rel.clear();
        s.faces.clear();
        let first = s.triangle(self, face, v, &project);
        s.faces.push(first);
        let towards = if side == 1 { normal } else { -normal };
        self.flood_patch(s, &towards, &project);
        // A cavity that is no star has no weights: the face's own functions are linear and always there.
        s.weigh(kind) && s.finish(self, x) || {
            s.linear(v, &project, self);
            false
        }
    }

    /// Collects the faces whose circumcircle holds the origin, starting from the first and crossing the edges
    /// inside the patch.
    fn flood_patch(
        &self,
        s: &mut Planar,
        towards: &Vector3<f64>,
        project: &dyn Fn(&Point3<f64>) -> Vector2<f64>,
    ) {
        let mut next = 0;
        // Bounded: on a patch with all nodes on one circle the cavity would be the whole patch.
        while next < s.faces.len() && next < MAX_FACES {
            let Triangle { face, v, .. } = s.faces[next];
            next += 1;
            for i in 0..3 {
                let (p, q) = (v[i], v[(i + 1) % 3]);
                let edge = key(self.copies.original(p), self.copies.original(q));
                let Some([f, g, ..]) = self.mesh.flat_pair(self.nodes(), edge) else {
                    continue;
                };
                let neighbour = if f == face { g } else { f };
                let ends = self.face_on_side(neighbour, self.side_towards(neighbour, towards));
                let Some(apex) = ends.into_iter().find(|&v| v != p && v != q) else {
                    continue;
                };
                if s.faces.iter().any(|t| t.face == neighbour) {
                    continue;
                }
                let corners = [q, p, apex].map(|v| project(&self.delaunay.points[v as usize]));
                // The point is the origin of the projection, so its coordinates are exact zeros.
                let o = robust::Coord { x: 0.0, y: 0.0 };
                let [a, b, e] = corners.map(|c| robust::Coord { x: c.x, y: c.y });
                if robust::incircle(a, b, e, o) > 0.0 {
                    let t = s.triangle(self, neighbour, [q, p, apex], project);
                    s.faces.push(t);
                }
            }
        }
    }
}

impl Planar {
    fn vertex(&mut self, domain: &Domain, v: u32, project: &dyn Fn(&Point3<f64>) -> Vector2<f64>) -> usize {
        match self.nodes.iter().position(|&n| n == v) {
            Some(k) => k,
            None => {
                self.nodes.push(v);
                self.rel.push(project(&domain.delaunay.points[v as usize]));
                self.nodes.len() - 1
            }
        }
    }

    fn triangle(
        &mut self,
        domain: &Domain,
        face: u32,
        v: [u32; 3],
        project: &dyn Fn(&Point3<f64>) -> Vector2<f64>,
    ) -> Triangle {
        let [a, b, c] = v.map(|v| self.vertex(domain, v, project));
        Triangle {
            face,
            v,
            centre: circumcentre(&self.rel[a], &self.rel[b], &self.rel[c]),
        }
    }

    fn local(&self, v: u32) -> usize {
        self.nodes.iter().position(|&n| n == v).unwrap_or(0)
    }

    /// Computes the stolen areas and their moments. Returns false if the cavity is not star-shaped.
    fn weigh(&mut self, kind: Interpolant) -> bool {
        let count = self.nodes.len();
        self.area.clear();
        self.area.resize(count, 0.0);
        self.moment.clear();
        self.moment.resize(count, Vector2::zeros());
        self.gates.clear();
        self.gates.resize(count, [Vector2::zeros(); 2]);
        for i in 0..self.faces.len() {
            let Triangle { face, v, centre } = self.faces[i];
            for k in 0..3 {
                let (a, b) = (v[k], v[(k + 1) % 3]);
                let right = self
                    .faces
                    .iter()
                    .find(|t| t.face != face && t.v.contains(&a) && t.v.contains(&b));
                let right = right.map(|t| (t.face, t.centre));
                let (a, b) = (self.local(a), self.local(b));
                match right {
                    // Two faces share the edge: the segment is added by the one with the smaller number
                    // alone.
                    Some((neighbour, _)) if neighbour < face => {}
                    Some((_, right_centre)) => self.segment(a, b, &right_centre, &centre),
                    None => {
                        let (p, q) = (self.rel[a], self.rel[b]);
                        // The edge is seen from behind: the cavity is not star-shaped about the point.
                        if cross(&p, &q) <= 0.0 {
                            return false;
                        }
                        let gate = circumcentre(&Vector2::zeros(), &p, &q);
                        self.segment(a, b, &gate, &centre);
                        self.gates[a][0] = gate;
                        self.gates[b][1] = gate;
                    }
                }
            }
        }
        // The segment along the cell of the point closes each polygon, from the circle of one border edge to
        // the next.
        for i in 0..count {
            let [start, end] = self.gates[i];
            self.add(i, &end, &start);
        }
        self.weights.clear();
        for i in 0..count {
            let n = &self.rel[i];
            self.weights.push(match kind {
                Interpolant::Laplace => self.area[i],
                // The integral of `|y − n|² − |y|²` over the stolen area, which is linear in `y`.
                Interpolant::Sibson => n.norm_squared() * self.area[i] - 2.0 * n.dot(&self.moment[i]),
            });
        }
        true
    }

    /// Adds the dual segment of edge `a -> b`, from its right side to its left.
    fn segment(&mut self, a: usize, b: usize, right: &Vector2<f64>, left: &Vector2<f64>) {
        self.add(a, right, left);
        self.add(b, left, right);
    }

    fn add(&mut self, i: usize, p: &Vector2<f64>, q: &Vector2<f64>) {
        // Relative to the node, so that far centres on a common line do not cancel.
        let n = self.rel[i];
        let (p, q) = (p - n, q - n);
        let area = 0.5 * cross(&p, &q);
        self.area[i] += area;
        self.moment[i] += ((p + q) / 3.0 + n) * area;
    }

    /// Normalises the weights and removes round-off. Returns false if they are not usable.
    fn finish(&mut self, domain: &Domain, x: &Point3<f64>) -> bool {
        let total: f64 = self.weights.iter().sum();
        for w in &mut self.weights {
            *w /= total;
            // The same limit as `NEGATIVE` for points inside.
            if w.is_nan() || *w < -1e-9 {
                return false;
            }
            // Within the limit a negative weight is round-off; linear precision is restored below.
            *w = w.max(0.0);
        }
        self.rel3.clear();
        self.rel3
            .extend(self.nodes.iter().map(|&v| domain.delaunay.points[v as usize] - x));
        let size = self.rel3.iter().map(Vector3::norm).fold(0.0, f64::max);
        super::polish::planar(&mut self.weights, &self.rel, size)
    }

    /// Uses the linear functions of the face around the origin.
    fn linear(&mut self, v: [u32; 3], project: &dyn Fn(&Point3<f64>) -> Vector2<f64>, domain: &Domain) {
        let r = v.map(|v| project(&domain.delaunay.points[v as usize]));
        self.nodes.clear();
        self.weights.clear();
        let part = [0, 1, 2].map(|k: usize| cross(&r[(k + 1) % 3], &r[(k + 2) % 3]).max(0.0));
        let total: f64 = part.iter().sum();
        self.nodes.extend(v);
        self.weights.extend(part.map(|p| p / total));
    }
}

//! Natural-neighbour shape functions on the constrained domain: Sibson and Laplace, values and gradients.
//!
//! The natural neighbours of `x` are the nodes of the tetrahedra whose circumsphere holds `x` and that are
//! reached from the tetrahedron around `x` without crossing a constrained face. With the dual facet `f_i`
//! (area `a_i`, centroid `c_i`) between `x` and neighbour `n_i`:
//!
//! - Laplace: `alpha_i = a_i / |n_i - x|`, `phi_i = alpha_i / sum alpha`;
//! - Sibson: `phi_i = V_i / sum V`, where `V_i` is the volume that the cell of `x` takes from the cell of
//!   `n_i`; `grad V_i = alpha_i (c_i - x)`.
//!
//! **Limits.** At a node: Kronecker delta. On an edge between two different constrained planes: linear
//! functions. On a flat patch of constrained faces, with the nodes of the patch alone: for Laplace the 2D
//! Sibson functions, for Sibson the moments `integral of |y - n_i|^2 - |y - x|^2` over the 2D stolen areas
//! (the C2 coordinate of Hiyoshi and Sugihara). Gradients there are evaluated 1e-6 of an element inside; at
//! nodes they are one of the one-sided limits.
//!
//! **Re-entrant edges.** In 3D the reach of `x` can go round a re-entrant edge or a crack front. One rule
//! holds everywhere: the functions are those of the nodes in reach that `x` sees in a straight line, with the
//! cell of `x` clipped by the bisectors of these nodes alone (`visible.rs`; such evaluations are counted and
//! allocate). Weights are positive and linearly precise for any such set. When a node comes into sight, it
//! enters with a non-zero weight: next to a re-entrant edge the functions jump where the line to a node
//! grazes the edge. The jump is smaller the denser the nodes on the edge.
//!
//! **Round-off.** If the residual of `sum phi_i (n_i - x)` exceeds 5e-14 of the neighbourhood's size, it is
//! removed by the smallest change relative to the weights. Closer to a constrained plane than about 1e-9 of
//! the spacing single weights lose digits (error about `1e-16 * spacing / distance`); partition of unity and
//! linear precision do not.

mod cavity;
#[cfg(test)]
mod edge_tests;
mod planar;
mod polish;
#[cfg(test)]
pub(crate) mod tests;
mod visible;
mod weights;

use crate::constraint::{depth, key};
use crate::domain::Domain;
use crate::error::Result;
use crate::tet::FACES;
use arlequin_core::ShapeRow;
use nalgebra::{Point3, Vector3};

/// Distance outside an edge or face, in its own barycentric coordinates \[–\], up to which a point on the
/// edge's line or the face's plane counts as on it.
const BESIDE: f64 = 1e-9;

/// Kind of natural-neighbour function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Interpolant {
    /// Stolen volumes; C1 except at the nodes.
    Sibson,
    /// Facet area over distance (non-Sibsonian); C0, cheaper.
    Laplace,
}

/// Number of evaluations that took each branch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Cavities evaluated.
    pub cavities: usize,
    /// Evaluations on nodes, constrained edges and patches.
    pub limits: usize,
    /// Evaluations near re-entrant edges and crack fronts, from the nodes that the point sees.
    pub reentrant: usize,
    /// Evaluations that used the linear functions of one tetrahedron (or one triangle of a patch) instead.
    pub linear: usize,
    /// Rows whose linear residual exceeded 1e-12 of the neighbourhood's size before its removal.
    pub polished: usize,
}

/// Working buffers of the evaluations, owned by the caller; one per thread. Once they have grown, nothing is
/// allocated, except beside re-entrant edges and crack fronts.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    row: ShapeRow<f64>,
    counters: Counters,
    near: Vec<u32>,
    cavity: cavity::Cavity,
    weights: weights::Weights,
    planar: planar::Planar,
    /// True for the hull of visible nodes: sight was resolved when they were chosen.
    alone: bool,
}

impl Scratch {
    /// Creates empty working buffers, which fit any domain.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns how often each branch was taken since creation.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns the row of the last successful evaluation.
    pub fn row(&self) -> &ShapeRow<f64> {
        &self.row
    }
}

/// Position of a located point relative to the constraints.
enum Place {
    Node(u32),
    Edge(u32, u32),
    Patch(u32),
    Free,
}

impl Domain {
    /// Returns the values of the shape functions at a point of the closed domain.
    ///
    /// # Errors
    /// `OutsideDomain`.
    pub fn shape<'s>(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        scratch: &'s mut Scratch,
    ) -> Result<&'s ShapeRow<f64>> {
        self.evaluate(kind, x, scratch, false)
    }

    /// Returns values and gradients of the shape functions at a point of the closed domain.
    ///
    /// # Errors
    /// `OutsideDomain`.
    pub fn shape_with_gradients<'s>(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        scratch: &'s mut Scratch,
    ) -> Result<&'s ShapeRow<f64>> {
        self.evaluate(kind, x, scratch, true)
    }

    fn evaluate<'s>(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        s: &'s mut Scratch,
        slopes: bool,
    ) -> Result<&'s ShapeRow<f64>> {
        let tet = self.locate(x, &mut s.near)?;
        Ok(self.shape_within(kind, x, tet, s, slopes))
    }

    /// Like `evaluate`, for a point known to lie in the tetrahedron `tet` of the domain.
    pub(crate) fn shape_within<'s>(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        tet: u32,
        s: &'s mut Scratch,
        slopes: bool,
    ) -> &'s ShapeRow<f64> {
        s.cavity.fit(self);
        let place = self.place(tet, x);
        if matches!(place, Place::Free) {
            self.in_cavity(kind, x, tet, s, slopes);
            return &s.row;
        }
        s.counters.limits += 1;
        if slopes {
            // Evaluate inside for the gradients, then overwrite the values; neighbours with value zero
            // remain.
            let t = &self.delaunay.tets[tet as usize];
            let middle = self
                .delaunay
                .corners(t)
                .iter()
                .map(|p| p.coords)
                .sum::<Vector3<f64>>()
                * 0.25;
            // 1e-6 of an element is far above the 1e-9 of the spacing below which weights lose digits.
            let moved = x + (middle - x.coords) * 1e-6;
            self.in_cavity(kind, &moved, tet, s, true);
            s.row.values.fill(0.0);
        } else {
            s.row.clear();
        }
        match place {
            Place::Node(v) => set(&mut s.row, v, 1.0, slopes),
            Place::Edge(a, b) => {
                let [p, q] = [a, b].map(|v| &self.delaunay.points[v as usize]);
                let t = ((x - p).dot(&(q - p)) / (q - p).norm_squared()).clamp(0.0, 1.0);
                set(&mut s.row, a, 1.0 - t, slopes);
                set(&mut s.row, b, t, slopes);
            }
            Place::Patch(face) => {
                s.counters.linear += usize::from(!self.on_patch(kind, x, face, tet, &mut s.planar));
                for (&v, &w) in s.planar.nodes.iter().zip(&s.planar.weights) {
                    set(&mut s.row, v, w, slopes);
                }
            }
            Place::Free => {}
        }
        &s.row
    }

    /// Finds the node, constrained edge or patch that `x`, in the closed tetrahedron `tet`, lies on.
    fn place(&self, tet: u32, x: &Point3<f64>) -> Place {
        let t = &self.delaunay.tets[tet as usize];
        let tolerance = self.tolerance;
        let distance = self.plane_distances(tet, x);
        let mut close = [false; 4];
        let mut count = 0;
        for slot in 0..4 {
            close[slot] = distance[slot].abs() <= tolerance;
            count += usize::from(close[slot]);
        }
        if count == 0 {
            return Place::Free;
        }
        // Nodes before edges before faces: a point on a node is on its edges and faces, too.
        if let Some(&v) =
            t.v.iter()
                .find(|&&v| (self.delaunay.points[v as usize] - x).norm() <= tolerance)
        {
            return Place::Node(v);
        }
        // Close to one face only cannot be an edge: its line lies on two.
        let edge = if count >= 2 { self.on_edges(t.v, x) } else { None };
        if let Some(place) = edge {
            return place;
        }
        // `x` may be close to several faces of a thin tetrahedron; it is on the face that holds it.
        let wall = |slot: &usize| close[*slot] && self.walls[tet as usize] >> *slot & 1 == 1;
        let face_of = |slot: usize| self.face_at.get(&(tet << 2 | slot as u32));
        let holding = (0..4)
            .filter(wall)
            .map(|slot| {
                (
                    depth(t.face(slot).map(|v| &self.delaunay.points[v as usize]), x),
                    slot,
                )
            })
            .filter(|(depth, _)| *depth >= -BESIDE)
            // Equal depths go to the smaller slot.
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        match holding.and_then(|(_, slot)| face_of(slot)) {
            Some(&face) => Place::Patch(face),
            None => Place::Free,
        }
    }

    /// Returns the constrained edge of a tetrahedron that `x` lies on, or the flat patch that this edge is
    /// part of.
    fn on_edges(&self, v: [u32; 4], x: &Point3<f64>) -> Option<Place> {
        for i in 0..4 {
            for j in 0..i {
                let edge = key(self.copies.original(v[i]), self.copies.original(v[j]));
                let Some(faces) = self.mesh.edges.get(&edge) else {
                    continue;
                };
                let [p, q] = [edge.0, edge.1].map(|v| &self.delaunay.points[v as usize]);
                let (along, arm) = (q - p, x - p);
                let fraction = along.dot(&arm) / along.norm_squared();
                let beside = !(-BESIDE..=1.0 + BESIDE).contains(&fraction);
                if beside || along.cross(&arm).norm() > self.tolerance * along.norm() {
                    continue;
                }
                // The edge is a diagonal of a flat patch: the functions of the patch hold across it.
                return Some(match (self.mesh.flat_pair(self.nodes(), edge), faces.first()) {
                    (Some(_), Some(&face)) => Place::Patch(face),
                    // The key is sorted: copies at the ends go with the ends of the tetrahedron, not with
                    // their order in the key.
                    _ if edge.0 == self.copies.original(v[i]) => Place::Edge(v[i], v[j]),
                    _ => Place::Edge(v[j], v[i]),
                });
            }
        }
        None
    }
}

impl Domain {
    /// Fills the row for a point strictly inside the domain, in the tetrahedron `start`.
    fn in_cavity(&self, kind: Interpolant, x: &Point3<f64>, start: u32, s: &mut Scratch, slopes: bool) {
        s.counters.cavities += 1;
        s.row.clear();
        // A convex hull has no re-entrant edge; an apparent one is round-off.
        let is_star = s.cavity.find(self, x, start) || s.alone;
        let filled = match is_star {
            true => s.weights.fill(kind, &s.cavity, &mut s.row, slopes),
            false => None,
        };
        if let Some(residual) = filled {
            s.counters.polished += usize::from(residual > 1e-12);
            return;
        }
        s.row.clear();
        s.counters.reentrant += 1;
        // The hull of visible nodes must not look for visible nodes again: that would recur without end.
        if s.alone || !self.on_visible(kind, x, s, slopes) {
            s.counters.linear += 1;
            self.linear(x, start, &mut s.row, slopes);
        }
    }

    /// Fills the row with the linear functions of one tetrahedron, or of a thick one behind it.
    fn linear(&self, x: &Point3<f64>, tet: u32, row: &mut ShapeRow<f64>, slopes: bool) {
        row.clear();
        let thick = self.thick(tet, x);
        if thick != tet {
            let nodes = self.corners_of(thick);
            let p = nodes.map(|v| self.nodes()[v]);
            let gradients = crate::delaunay::linear_gradients(&p).0;
            row.nodes.extend(nodes);
            row.values
                .extend(crate::delaunay::linear_values(&p, &gradients, x));
            row.gradients.extend(gradients.into_iter().filter(|_| slopes));
            return;
        }
        let t = &self.delaunay.tets[tet as usize];
        let p = self.delaunay.corners(t);
        let six = (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0]));
        let mut sum = 0.0;
        for (slot, face) in FACES.iter().enumerate() {
            let [a, b, c] = face.map(|k| p[k]);
            let outward = (b - a).cross(&(c - a));
            // Round-off outside of a face makes a small negative value. Cut off and normalised, all stay
            // shares.
            let value = (-outward.dot(&(x - a)) / six).max(0.0);
            sum += value;
            row.push(t.v[slot] as usize, value);
            if slopes {
                row.gradients.push(-outward / six);
            }
        }
        row.values.iter_mut().for_each(|v| *v /= sum);
    }
}

/// Sets the value of a node in a row. With `search` the row may already contain the node.
fn set(row: &mut ShapeRow<f64>, node: u32, value: f64, search: bool) {
    let position = if search {
        row.nodes.iter().position(|&v| v == node as usize)
    } else {
        None
    };
    match position {
        Some(k) => row.values[k] = value,
        None => {
            row.push(node as usize, value);
            if search {
                row.gradients.push(Vector3::zeros());
            }
        }
    }
}

//! Shape functions where the reach of a point goes round a re-entrant edge or a crack front.
//!
//! One rule holds everywhere: the functions at `x` are the natural-neighbour functions of the nodes that `x`
//! sees. These are the nodes in reach (see [`super`]) for which no wall crosses the straight line from `x`.
//! Where the star of `x` in its cavity has empty spheres, the dual of the cavity gives the functions
//! directly. Elsewhere the reach goes round an edge. The cell of `x` is then clipped by the bisectors of the
//! visible nodes; it comes from the Delaunay complex of these nodes alone. Since `x` sees all four nodes of
//! its own tetrahedron, the weights are positive, sum to one and are linearly precise for any such set.

use super::{Interpolant, Scratch};
use crate::constraint::Surface;
use crate::domain::Domain;
use crate::predicates::orient3d;
use nalgebra::Point3;
use std::cmp::Ordering;

impl Domain {
    /// Fills the row from the nodes in reach that `x` sees. Returns false if they do not span a volume.
    /// Allocates.
    pub(super) fn on_visible(
        &self,
        kind: Interpolant,
        x: &Point3<f64>,
        s: &mut Scratch,
        slopes: bool,
    ) -> bool {
        let mut visible: Vec<u32> = s.cavity.nodes.clone();
        visible.retain(|&v| self.sees(x, v, s));
        // Copies of a node have its position, and a complex needs distinct points.
        visible.sort_unstable_by_key(|&v| (self.copies.original(v), v));
        visible.dedup_by_key(|v| self.copies.original(*v));
        let points: Vec<Point3<f64>> = visible
            .iter()
            .map(|&v| self.delaunay.points[v as usize])
            .collect();
        let mut alone = Scratch {
            alone: true,
            ..Scratch::default()
        };
        let Ok(hull) = Self::new(&points, &Surface::convex_hull()) else {
            return false;
        };
        let Ok(row) = hull.evaluate(kind, x, &mut alone, slopes) else {
            return false;
        };
        s.row.nodes.extend(row.nodes.iter().map(|&k| visible[k] as usize));
        s.row.values.extend(&row.values);
        s.row.gradients.extend(&row.gradients);
        // A fallback inside the hull is not the rule that callers rely on.
        alone.counters.linear == 0
    }

    /// Returns whether `x` sees a node: no wall on the border of the cavity is between them.
    fn sees(&self, x: &Point3<f64>, node: u32, s: &Scratch) -> bool {
        let p = &self.delaunay.points[node as usize];
        let hidden = s.cavity.walls().any(|face| {
            // A wall does not hide its own corners.
            if face
                .iter()
                .any(|&v| self.copies.original(v) == self.copies.original(node))
            {
                return false;
            }
            let [a, b, c] = face.map(|v| &self.delaunay.points[v as usize]);
            let sides = [orient3d(a, b, c, x), orient3d(a, b, c, p)];
            // A wall in the plane of sight, or on one side of both ends, hides nothing.
            if sides.contains(&Ordering::Equal) || sides[0] == sides[1] {
                return false;
            }
            let turns = [orient3d(x, p, a, b), orient3d(x, p, b, c), orient3d(x, p, c, a)];
            // Not strict: a line through the edge between two walls is hidden by both.
            !(turns.contains(&Ordering::Greater) && turns.contains(&Ordering::Less))
        });
        // For a node on a crack, the line of sight must also end on the lip of this copy.
        !hidden && (self.copies.unknowns_of(self.copies.original(node)).is_empty() || self.lip_faces(x, node))
    }

    /// Returns whether the line from a node towards `x` starts in a tetrahedron of the domain that has this
    /// copy of the node.
    fn lip_faces(&self, x: &Point3<f64>, node: u32) -> bool {
        let mut star = Vec::new();
        self.delaunay.star(node, &mut star);
        star.iter().filter(|&&t| self.inside[t as usize]).any(|&t| {
            let tet = &self.delaunay.tets[t as usize];
            (0..4).filter(|&slot| tet.v[slot] != node).all(|slot| {
                let [a, b, c] = tet.face(slot).map(|v| &self.delaunay.points[v as usize]);
                // A point on the plane of a face belongs to both lips: sight along the crack is allowed.
                orient3d(a, b, c, x) != Ordering::Greater
            })
        })
    }
}

//! Point location by walking.

use super::Delaunay;
use crate::predicates::orient3d;
use crate::tet::NONE;
use nalgebra::Point3;
use std::cmp::Ordering;

/// Position of a point relative to the complex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Location {
    /// In the closed tetrahedron with these vertices; `hint` starts the next walk here.
    Inside {
        /// Vertices of the tetrahedron.
        nodes: [usize; 4],
        /// Handle for the next call.
        hint: usize,
    },
    /// Strictly outside the convex hull, beyond this hull face (normal outward).
    Outside {
        /// Vertices of the hull face.
        face: [usize; 3],
        /// Handle for the next call.
        hint: usize,
    },
}

/// Steps of a walk after which the faces are tested in changing order.
const ORDERLY: usize = 4096;

impl Delaunay {
    /// Locates a point by an exact visibility walk that starts at `hint` (any number; the last hint is best).
    ///
    /// A point on a common face, edge or vertex is reported in one of the tetrahedra that share it.
    pub fn locate(&self, p: &Point3<f64>, hint: usize) -> Location {
        let tet = self.walk(p, if hint < self.tets.len() { hint as u32 } else { 0 });
        let t = &self.tets[tet as usize];
        let v = t.v.map(|v| v as usize);
        if t.is_ghost() {
            Location::Outside {
                face: [v[0], v[1], v[2]],
                hint: tet as usize,
            }
        } else {
            Location::Inside {
                nodes: v,
                hint: tet as usize,
            }
        }
    }

    /// Returns the tetrahedron that holds `q`, or a ghost whose hull face `q` is strictly beyond.
    pub(crate) fn walk(&self, q: &Point3<f64>, hint: u32) -> u32 {
        let mut current = hint;
        let mut previous = NONE;
        let mut t = &self.tets[current as usize];
        if t.is_ghost() {
            previous = current;
            current = t.n[3] >> 2;
            t = &self.tets[current as usize];
        }
        let mut steps = 0_usize;
        'step: loop {
            let mut exit = NONE;
            steps += 1;
            // Visibility walks in a Delaunay complex never cycle. In a constrained complex they can: after a
            // while the faces are tested in changing order, so that no cycle lasts. A hash of the step count
            // is varied, and the same in every run.
            let turn = if steps > ORDERLY {
                steps.wrapping_mul(0x9e37_79b9) >> 7
            } else {
                0
            };
            for k in 0..4 {
                let slot = (k + turn) & 3;
                let n = t.n[slot];
                if n >> 2 == previous {
                    continue;
                }
                let [a, b, c] = t.face(slot).map(|v| &self.points[v as usize]);
                if orient3d(a, b, c, q) == Ordering::Greater {
                    let next = &self.tets[(n >> 2) as usize];
                    if next.is_ghost() {
                        // Leave the hull only if no other face leads on.
                        exit = n >> 2;
                        continue;
                    }
                    previous = current;
                    current = n >> 2;
                    t = next;
                    continue 'step;
                }
            }
            if exit != NONE {
                return exit;
            }
            // After a start at a ghost its hull face was not tested; it is the only way out that remains.
            if previous != NONE && self.tets[previous as usize].is_ghost() {
                let g = &self.tets[previous as usize];
                let [a, b, c] = [g.v[0], g.v[1], g.v[2]].map(|v| &self.points[v as usize]);
                if orient3d(a, b, c, q) == Ordering::Greater {
                    return previous;
                }
            }
            return current;
        }
    }
}

//! Constrained faces: the boundary of the domain and internal cracks.
//!
//! A [`Surface`] lists triangles on the nodes. The boundary must be closed (every edge in an even number of
//! faces). Its orientation does not matter: crossing parity tells several bodies and holes apart. Crack faces
//! are faces inside the domain that block the sight between nodes.
//!
//! Every constrained face must become a face of the complex. Where a face is not in the Delaunay complex,
//! these steps follow in this order:
//! 1. flat patches adopt the triangles that the Delaunay complex has on one side of them, or single diagonals
//!    are swapped (same geometry),
//! 2. faces and edges are split at nodes that lie on them (within 1e-10 of the edge length; within round-off
//!    for faces that are in the complex),
//! 3. points are inserted on missing edges until all edges are present; these points become nodes of the
//!    domain and are reported,
//! 4. the tetrahedra that missing faces cut are divided again on both sides of the faces, without points: the
//!    result is the constrained Delaunay complex, whose spheres are empty of the nodes visible from their
//!    inside,
//! 5. points are inserted on the faces for which step 4 is not possible.
//!
//! If the steps need more than the allowed number of points, the error names the faces.

mod carve;
mod mesh;
mod patch;
mod recover;

pub(crate) use mesh::{Face, FaceMesh, key};
pub(crate) use patch::depth;
pub(crate) use recover::recover;

use crate::bins::{Bins, around};
use crate::error::{Error, Result};
use crate::predicates::{collinear, orient3d};
use nalgebra::Point3;
use std::cmp::Ordering;
use std::collections::{HashMap, HashSet};

/// Constrained faces as node triples: the boundary, and internal crack faces.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Surface {
    boundary: Vec<[usize; 3]>,
    cracks: Vec<[usize; 3]>,
}

/// A point inserted on a constrained face to recover it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsertedPoint {
    /// Index of the point among the nodes of the domain.
    pub node: usize,
    /// Input face on which the point lies (boundary faces first, then crack faces).
    pub face: usize,
}

/// Steps that the recovery of the constrained faces took.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recovery {
    /// Points added to the nodes, in ascending order of their indices.
    pub inserted: Vec<InsertedPoint>,
    /// Faces changed in flat patches, by swapped diagonals or adopted triangles.
    pub swapped: usize,
    /// Faces recovered without a point, by dividing the tetrahedra that they cut.
    pub divided: usize,
    /// Splits of edges and faces at given nodes that lie on them.
    pub split_at_nodes: usize,
}

impl Surface {
    /// Creates a surface whose boundary is the convex hull of the nodes.
    pub fn convex_hull() -> Self {
        Self::default()
    }

    /// Creates a surface whose boundary is a closed triangle surface.
    pub fn boundary(faces: Vec<[usize; 3]>) -> Self {
        Self {
            boundary: faces,
            cracks: Vec::new(),
        }
    }

    /// Creates the boundary of a tetrahedral mesh: the faces that belong to one element only. An element that
    /// is listed twice, in any order of its nodes, counts once.
    pub fn of_elements(elements: &[[usize; 4]]) -> Self {
        let mut count: HashMap<[usize; 3], ([usize; 3], usize)> = HashMap::new();
        let mut counted = HashSet::with_capacity(elements.len());
        let sorted = |e: &[usize; 4]| {
            let mut nodes = *e;
            nodes.sort_unstable();
            nodes
        };
        for e in elements.iter().filter(|e| counted.insert(sorted(e))) {
            for f in crate::tet::FACES {
                let face = f.map(|k| e[k]);
                let mut sorted = face;
                sorted.sort_unstable();
                count.entry(sorted).or_insert((face, 0)).1 += 1;
            }
        }
        let mut boundary: Vec<_> = count.into_values().filter(|c| c.1 == 1).map(|c| c.0).collect();
        // Sorted: the order of a hash map differs from run to run.
        boundary.sort_unstable();
        Self {
            boundary,
            cracks: Vec::new(),
        }
    }

    /// Adds crack faces: inside the domain, opaque for the visibility criterion.
    #[must_use]
    pub fn with_cracks(mut self, faces: Vec<[usize; 3]>) -> Self {
        self.cracks.extend(faces);
        self
    }

    /// Returns the same faces with renumbered nodes, `order[new] = old`; see [`crate::spatial_order`].
    ///
    /// # Errors
    /// `UnknownNode` for faces on nodes that `order` does not contain.
    pub fn renumbered(&self, order: &[usize]) -> Result<Self> {
        // Entries that `order` does not name keep the marker, so that faces on them are refused below.
        let mut place = vec![usize::MAX; order.len()];
        for (new, &old) in order.iter().enumerate() {
            if let Some(p) = place.get_mut(old) {
                *p = new;
            }
        }
        let nodes = order.len();
        let mut out = self.clone();
        for (face, v) in out.boundary.iter_mut().chain(&mut out.cracks).enumerate() {
            for v in v {
                let new = place.get(*v).copied().filter(|&p| p != usize::MAX);
                *v = new.ok_or(Error::UnknownNode {
                    face,
                    node: *v,
                    nodes,
                })?;
            }
        }
        Ok(out)
    }

    /// Returns the boundary faces; empty for the convex hull.
    pub fn boundary_faces(&self) -> &[[usize; 3]] {
        &self.boundary
    }

    /// Returns the crack faces.
    pub fn crack_faces(&self) -> &[[usize; 3]] {
        &self.cracks
    }

    fn faces(&self) -> impl Iterator<Item = &[usize; 3]> {
        self.boundary.iter().chain(&self.cracks)
    }

    /// Checks indices, areas, repetitions and closure.
    ///
    /// # Errors
    /// `UnknownNode`, `FlatFace`, `RepeatedFace`, `OpenSurface`.
    pub fn check(&self, points: &[Point3<f64>]) -> Result<()> {
        let mut seen: HashMap<[usize; 3], usize> = HashMap::new();
        for (face, &nodes) in self.faces().enumerate() {
            if let Some(&node) = nodes.iter().find(|&&v| v >= points.len()) {
                return Err(Error::UnknownNode {
                    face,
                    node,
                    nodes: points.len(),
                });
            }
            let [a, b, c] = nodes.map(|v| &points[v]);
            // Exact: a face with any area at all has a plane for the predicates.
            if collinear(a, b, c) {
                return Err(Error::FlatFace { face, nodes });
            }
            let mut sorted = nodes;
            sorted.sort_unstable();
            if let Some(first) = seen.insert(sorted, face) {
                return Err(Error::RepeatedFace {
                    first,
                    second: face,
                    nodes,
                });
            }
        }
        self.check_closed()
    }

    fn check_closed(&self) -> Result<()> {
        let mut edges: HashMap<(usize, usize), usize> = HashMap::new();
        for f in &self.boundary {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                // Even, not two: at an edge where two bodies touch, four faces meet.
                *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
            }
        }
        let mut open: Vec<_> = edges.into_iter().filter(|e| e.1 % 2 == 1).collect();
        // Sorted, so that the edge in the error does not depend on hashing.
        open.sort_unstable();
        match open.first() {
            None => Ok(()),
            Some(&((a, b), faces)) => Err(Error::OpenSurface {
                edge: [a, b],
                faces,
                open_edges: open.len(),
            }),
        }
    }

    /// Checks that no edge of one face pierces another face.
    ///
    /// # Errors
    /// `SelfIntersection`.
    pub fn check_intersections(&self, points: &[Point3<f64>]) -> Result<()> {
        let faces: Vec<[usize; 3]> = self.faces().copied().collect();
        let boxes: Vec<_> = faces
            .iter()
            .map(|f| around(f.iter().map(|&v| &points[v]), 0.0))
            .collect();
        let bins = Bins::new(boxes.clone());
        let mut near = Vec::new();
        // Boxes first: the exact predicates see only pairs that can meet.
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        for (i, f) in faces.iter().enumerate() {
            bins.overlapping(&boxes[i], &mut near);
            for &j in &near {
                let g = &faces[j as usize];
                let pierced = (0..3).any(|k| pierces(points, [f[k], f[(k + 1) % 3]], g));
                if j as usize != i && pierced {
                    pairs.push((i.min(j as usize), i.max(j as usize)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        match pairs.first() {
            None => Ok(()),
            Some(&(first, second)) => Err(Error::SelfIntersection {
                first,
                second,
                count: pairs.len(),
            }),
        }
    }
}

/// Returns whether a segment passes through a face: the ends are strictly on opposite sides, the piercing
/// point is in the closed face, and no node is common.
fn pierces(points: &[Point3<f64>], segment: [usize; 2], face: &[usize; 3]) -> bool {
    // Faces with a common node always touch there.
    if segment.iter().any(|v| face.contains(v)) {
        return false;
    }
    let [p, q] = segment.map(|v| &points[v]);
    let [a, b, c] = face.map(|v| &points[v]);
    let (sp, sq) = (orient3d(a, b, c, p), orient3d(a, b, c, q));
    // A segment that ends in the plane touches the face at most; recovery handles this by splitting at nodes.
    if sp == Ordering::Equal || sq == Ordering::Equal || sp == sq {
        return false;
    }
    let signs = [orient3d(p, q, a, b), orient3d(p, q, b, c), orient3d(p, q, c, a)];
    !(signs.contains(&Ordering::Greater) && signs.contains(&Ordering::Less))
}

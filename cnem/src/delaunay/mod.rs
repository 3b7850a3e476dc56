//! Delaunay tetrahedralisation of a set of points, by incremental insertion with exact predicates.
//!
//! Bowyer-Watson: the tetrahedra whose circumsphere holds the new point form a star-shaped cavity, which is
//! replaced by the star of the point. Ghost tetrahedra fill the outside of the convex hull, so the complex
//! has no border. Ties are broken by node index (see [`crate::predicates`]): the result does not depend on
//! the order of insertion, and no flat tetrahedra arise on grids, cylinders or spheres.
//!
//! The complex fills the convex hull; [`crate::constraint`] adds constrained faces.

mod build;
mod insert;
mod locate;
mod replace;
#[cfg(test)]
mod tests;

use crate::error::Result;
use crate::tet::{EdgeTable, INF, Tet};
use arlequin_core::adjacency::Adjacency;
use nalgebra::{Point3, Vector3};

pub use locate::Location;
pub(crate) use replace::{face_key, joined};

/// Delaunay tetrahedralisation: fills the convex hull of the nodes.
///
/// ```
/// use nalgebra::Point3;
/// let corner = |i: u32| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
/// let cube: Vec<_> = (0..8).map(corner).collect();
/// let delaunay = cnem::delaunay::Delaunay::new(&cube)?;
/// let volume: f64 = delaunay.tetrahedra().map(|t| cnem::delaunay::volume(t.map(|v| &cube[v]))).sum();
/// assert!((volume - 1.0).abs() < 1e-15);
/// # Ok::<(), cnem::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Delaunay {
    /// Points, numbered as in `tets`.
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) tets: Vec<Tet>,
    /// A tetrahedron at every vertex; `NONE` for duplicates.
    pub(crate) at_vertex: Vec<u32>,
    duplicates: Vec<(usize, usize)>,
    /// Rank of the vertices in the tie-break; empty if the rank is the index.
    pub(crate) rank: Vec<u32>,
    work: insert::Work,
    /// Neighbours of each node in the Delaunay complex, if tetrahedra were later divided along constrained
    /// faces. Spheres are then empty of visible nodes only.
    pub(crate) before: Option<Adjacency>,
}

impl Delaunay {
    /// Tetrahedralises distinct points.
    ///
    /// # Errors
    /// `NonFinite`, `TooManyNodes`, `TooFewNodes`, `AllCollinear`, `AllCoplanar`, and `DuplicateNodes` if
    /// two points are exactly equal (points that differ in the last bit are distinct).
    pub fn new(points: &[Point3<f64>]) -> Result<Self> {
        let built = Self::merging_duplicates(points)?;
        match built.duplicates.first() {
            None => Ok(built),
            Some(&(second, first)) => Err(crate::Error::DuplicateNodes {
                first,
                second,
                point: points[second].into(),
                count: built.duplicates.len(),
            }),
        }
    }

    /// Like [`Delaunay::new`], but leaves out points that repeat another; see [`Delaunay::duplicates`].
    ///
    /// # Errors
    /// The errors of [`Delaunay::new`] except `DuplicateNodes`.
    pub fn merging_duplicates(points: &[Point3<f64>]) -> Result<Self> {
        build::build(points)
    }

    /// Returns the pairs `(left out, kept)` of equal points, sorted.
    pub fn duplicates(&self) -> &[(usize, usize)] {
        &self.duplicates
    }

    /// Returns the points; points inserted later are at the end.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Returns the vertices of the tetrahedra, each with a positive volume.
    pub fn tetrahedra(&self) -> impl Iterator<Item = [usize; 4]> + '_ {
        self.tets
            .iter()
            .filter(|t| !t.is_ghost())
            .map(|t| t.v.map(|v| v as usize))
    }

    /// Number of tetrahedra.
    pub fn tetrahedron_count(&self) -> usize {
        self.tets.iter().filter(|t| !t.is_ghost()).count()
    }

    /// Returns the faces of the convex hull, normals outward.
    pub fn hull(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        self.tets
            .iter()
            .filter(|t| t.is_ghost())
            .map(|t| [t.v[0], t.v[1], t.v[2]].map(|v| v as usize))
    }

    /// Returns the corner points of a finite tetrahedron.
    #[inline]
    pub(crate) fn corners(&self, t: &Tet) -> [&Point3<f64>; 4] {
        t.v.map(|v| &self.points[v as usize])
    }

    /// Returns the rank of a vertex in the tie-break.
    #[inline]
    pub(crate) fn rank(&self, v: u32) -> u64 {
        u64::from(self.rank.get(v as usize).copied().unwrap_or(v))
    }

    /// Returns whether a tetrahedron is in conflict with the point `q` of the given rank: its (perturbed)
    /// circumsphere holds `q`.
    #[inline]
    pub(crate) fn conflicts(&self, tet: u32, q: &Point3<f64>, rank: u64) -> bool {
        let t = &self.tets[tet as usize];
        if t.is_ghost() {
            self.ghost_conflicts(t, q, rank)
        } else {
            self.sphere_holds(t, q, rank)
        }
    }

    #[inline]
    fn sphere_holds(&self, t: &Tet, q: &Point3<f64>, rank: u64) -> bool {
        use std::cmp::Ordering::{Equal, Greater, Less};
        let corners = self.corners(t);
        match crate::predicates::insphere(corners, q) {
            // On the sphere to the last bit: ranks perturb the points, in the same way for every tetrahedron.
            Greater => true,
            Less => false,
            Equal => {
                let [a, b, c, d] = t.v.map(|v| self.rank(v));
                crate::predicates::insphere_perturbed(corners, q, [a, b, c, d, rank])
            }
        }
    }

    /// Returns whether a ghost holds `q`.
    fn ghost_conflicts(&self, t: &Tet, q: &Point3<f64>, rank: u64) -> bool {
        use std::cmp::Ordering::{Equal, Greater, Less};
        let [a, b, c] = [t.v[0], t.v[1], t.v[2]].map(|v| &self.points[v as usize]);
        // A ghost holds the open half space beyond its hull face. In the plane of the face it holds the
        // circle that the circumsphere of the tetrahedron behind the face cuts out of the plane.
        match crate::predicates::orient3d(a, b, c, q) {
            Greater => true,
            Less => false,
            Equal => self.sphere_holds(&self.tets[(t.n[3] >> 2) as usize], q, rank),
        }
    }

    /// Writes the tetrahedra that contain a vertex to `out`, ghosts included. Tetrahedra behind a crack
    /// belong to a copy of the vertex and are not among them.
    pub(crate) fn star(&self, vertex: u32, out: &mut Vec<u32>) {
        out.clear();
        let first = self.at_vertex[vertex as usize];
        if first == crate::tet::NONE {
            return;
        }
        out.push(first);
        let mut next = 0;
        while next < out.len() {
            let t = &self.tets[out[next] as usize];
            next += 1;
            for (&v, &n) in t.v.iter().zip(&t.n) {
                let neighbour = n >> 2;
                let has_vertex = || self.tets[neighbour as usize].slot_of(vertex).is_some();
                // Over a face that contains the vertex: `v` is the corner opposite to the face.
                if v != vertex && !out.contains(&neighbour) && has_vertex() {
                    out.push(neighbour);
                }
            }
        }
    }

    /// Returns tetrahedron and slot of the face with the given vertices, if the face is in the complex.
    pub(crate) fn face(&self, v: [u32; 3], star: &mut Vec<u32>) -> Option<(u32, usize)> {
        self.star(v[0], star);
        star.iter()
            .find_map(|&t| self.tets[t as usize].slot_opposite(v).map(|slot| (t, slot)))
    }

    /// Drops the slots that insertions have left unused.
    pub(crate) fn tidy(&mut self) {
        self.compact();
        self.refresh_at_vertex(0);
    }

    /// Checks adjacency, orientation and the empty-sphere property over every face by exact predicates;
    /// returns the number of violations. A complex that is Delaunay over every face is Delaunay as a whole.
    /// Faces recovered without points (see [`crate::constraint::Recovery::divided`]) violate the property.
    pub fn violations(&self) -> usize {
        let mut bad = 0;
        for (i, t) in self.tets.iter().enumerate() {
            if !t.is_ghost() {
                let [a, b, c, d] = self.corners(t);
                bad += usize::from(crate::predicates::orient3d(a, b, c, d) != std::cmp::Ordering::Greater);
            }
            for (slot, &n) in t.n.iter().enumerate() {
                let neighbour = &self.tets[(n >> 2) as usize];
                let back = neighbour.n[(n & 3) as usize];
                bad += usize::from(back != ((i as u32) << 2 | slot as u32));
                let apex = neighbour.v[(n & 3) as usize];
                if apex != INF && !t.is_ghost() {
                    let q = &self.points[apex as usize];
                    bad += usize::from(self.sphere_holds(t, q, self.rank(apex)));
                }
                // The tetrahedron behind a hull face lies on the inner side of the face.
                if apex != INF && t.is_ghost() && slot == 3 {
                    let [a, b, c] = [t.v[0], t.v[1], t.v[2]].map(|v| &self.points[v as usize]);
                    bad += usize::from(
                        crate::predicates::orient3d(a, b, c, &self.points[apex as usize])
                            != std::cmp::Ordering::Less,
                    );
                }
            }
        }
        bad
    }
}

/// Returns the signed volume of a tetrahedron \[m³\], positive for the orientation of
/// [`crate::predicates::orient3d`].
pub fn volume(t: [&Point3<f64>; 4]) -> f64 {
    let [a, b, c, d] = t;
    (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
}

/// Returns the gradients \[1/m\] of the linear functions of a tetrahedron, and its volume \[m³\].
pub(crate) fn linear_gradients(p: &[Point3<f64>; 4]) -> ([Vector3<f64>; 4], f64) {
    let six = (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0]));
    // With respect to a corner of the face: large coordinates cancel in the differences.
    let gradients = crate::tet::FACES.map(|f| {
        let [a, b, c] = f.map(|k| p[k]);
        -(b - a).cross(&(c - a)) / six
    });
    (gradients, six / 6.0)
}

/// Returns the linear functions of a tetrahedron at any point, from their gradients.
pub(crate) fn linear_values(
    p: &[Point3<f64>; 4],
    gradients: &[Vector3<f64>; 4],
    x: &Point3<f64>,
) -> [f64; 4] {
    let value = |k: usize| gradients[k].dot(&(x - p[0]));
    let [b, c, d] = [value(1), value(2), value(3)];
    // The first value from the others: the sum is one by construction.
    [1.0 - b - c - d, b, c, d]
}

impl Delaunay {
    fn empty(points: Vec<Point3<f64>>, rank: Vec<u32>) -> Self {
        let mut table = EdgeTable::default();
        table.reserve(points.len());
        Self {
            at_vertex: Vec::new(),
            tets: Vec::with_capacity(points.len() * 7 + 64),
            points,
            duplicates: Vec::new(),
            rank,
            work: insert::Work::new(table),
            before: None,
        }
    }
}

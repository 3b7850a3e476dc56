//! The domain: the Delaunay complex, the constrained faces, and which tetrahedra are inside.

mod checks;
mod flat;
mod search;

use crate::circumcentre::{circumcentre, six_volumes};
use crate::constraint::{FaceMesh, Recovery, Surface, recover};
use crate::crack::Copies;
use crate::delaunay::Delaunay;
use crate::error::{Error, Result};
pub use checks::Neighbours;
pub(crate) use flat::is_flat;
use nalgebra::{Point3, Vector3};
use search::Starts;
use std::collections::HashMap;

/// Distance to the domain, relative to the largest coordinate, up to which a point counts as being on the
/// boundary. Centroids of boundary faces, computed in double precision, are within 1e-15 of it. Linear
/// precision to 1e-12 needs a value below 1e-12.
pub(crate) const ON_BOUNDARY: f64 = 1e-13;

/// Domain of the constrained natural element method: nodes, the constrained Delaunay complex, and its inside.
///
/// ```
/// use cnem::{constraint::Surface, domain::Domain};
/// use nalgebra::Point3;
/// let corner = |i: u32| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
/// let cube: Vec<_> = (0..8).map(corner).collect();
/// let domain = Domain::new(&cube, &Surface::convex_hull())?;
/// assert!((domain.volume() - 1.0).abs() < 1e-15);
/// # Ok::<(), cnem::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Domain {
    pub(crate) delaunay: Delaunay,
    /// True for tetrahedra of the domain that are not flat.
    pub(crate) inside: Vec<bool>,
    /// True for flat tetrahedra anywhere in the complex.
    flat: Vec<bool>,
    /// True for flat tetrahedra between tetrahedra of the domain.
    pub(crate) glued: Vec<bool>,
    /// For each tetrahedron, bit `slot`: the face opposite to `slot` is constrained and blocks the sight.
    pub(crate) walls: Vec<u8>,
    /// Vector from the first vertex to the circumcentre \[m\].
    pub(crate) centre: Vec<Vector3<f64>>,
    pub(crate) mesh: FaceMesh,
    /// Constrained face at `tetrahedron << 2 | slot`.
    pub(crate) face_at: HashMap<u32, u32>,
    pub(crate) tolerance: f64,
    pub(crate) copies: Copies,
    starts: Starts,
    recovery: Recovery,
    volume: f64,
}

/// Returns the largest magnitude of a coordinate.
pub(crate) fn largest_coordinate(points: &[Point3<f64>]) -> f64 {
    let coordinates = points.iter().flat_map(|p| p.iter());
    coordinates.fold(0.0, |m: f64, x| m.max(x.abs()))
}

impl Domain {
    /// Builds the domain of `points` bounded by `surface`. Up to `1000 + 4 * faces` points may be inserted to
    /// recover faces that are not in the Delaunay complex; see [`Domain::recovery`].
    ///
    /// # Errors
    /// The errors of [`Delaunay::new`] and [`Surface::check`]; `AllCollinear` and `AllCoplanar` also for
    /// nodes that are so up to round-off; `SelfIntersection`, `FacesNotRecovered`, `NodeOutside`,
    /// `NodesTooClose`, `EmptyDomain`; `TooManyNeighbours` for more than 1000 nodes on one sphere.
    pub fn new(points: &[Point3<f64>], surface: &Surface) -> Result<Self> {
        let faces = surface.boundary_faces().len() + surface.crack_faces().len();
        Self::with_limit(points, surface, 1000 + 4 * faces)
    }

    /// Like [`Domain::new`], with a limit for the number of inserted points (0: return an error instead of
    /// inserting any).
    ///
    /// # Errors
    /// The errors of [`Domain::new`].
    pub fn with_limit(points: &[Point3<f64>], surface: &Surface, limit: usize) -> Result<Self> {
        surface.check(points)?;
        checks::check_span(points)?;
        // The unconstrained complex first: faces that it already has need no recovery.
        let mut delaunay = Delaunay::new(points)?;
        let (mesh, recovery) = recover(&mut delaunay, surface, limit)?;
        // From here on tetrahedra keep their numbers: the lists below are indexed by them.
        delaunay.tidy();
        let tets = delaunay.tets.len();
        let mut domain = Self {
            delaunay,
            inside: vec![false; tets],
            flat: Vec::new(),
            glued: Vec::new(),
            walls: vec![0; tets],
            centre: Vec::new(),
            mesh,
            face_at: HashMap::new(),
            // Coordinates have a relative round-off of their own, so the tolerance grows with the largest
            // coordinate.
            tolerance: ON_BOUNDARY * largest_coordinate(points),
            copies: Copies::default(),
            starts: Starts::default(),
            recovery,
            volume: 0.0,
        };
        // Without a given boundary the hull is the boundary; it is known only once the complex stands.
        if surface.boundary_faces().is_empty() {
            domain.take_hull();
        }
        domain.raise_walls()?;
        // Order: walls bound the flood; flat tetrahedra leave the inside before nodes are checked and cracks
        // are opened; centres and volume come last, from the final vertices.
        domain.flood(surface.boundary_faces().len())?;
        domain.level()?;
        domain.check_nodes()?;
        domain.open_cracks();
        domain.measure();
        Ok(domain)
    }

    /// Returns all nodes: the given ones, then the points inserted on constrained faces (see
    /// [`Domain::recovery`]), then the copies for the second lips of cracks (see [`Domain::copies`]).
    pub fn nodes(&self) -> &[Point3<f64>] {
        &self.delaunay.points
    }

    /// Volume of the domain \[m³\].
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns the steps that the recovery of the constrained faces took.
    pub fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    /// The Delaunay complex of the convex hull.
    pub fn delaunay(&self) -> &Delaunay {
        &self.delaunay
    }

    /// Returns the tetrahedra of the domain, each with a positive volume.
    pub fn elements(&self) -> impl Iterator<Item = [usize; 4]> + '_ {
        let inside = self.delaunay.tets.iter().zip(&self.inside).filter(|t| *t.1);
        inside.map(|t| t.0.v.map(|v| v as usize))
    }

    /// Returns the constrained faces after recovery: nodes, whether it is a crack face, and the input face it
    /// comes from. The nodes of a crack face are those of one lip; the nodes of a boundary face are those of
    /// the inner side. See also [`Domain::lips`].
    pub fn constrained_faces(&self) -> impl Iterator<Item = ([usize; 3], bool, usize)> + '_ {
        self.mesh.faces.iter().enumerate().map(|(i, f)| {
            let inside = |side: &usize| self.inside[(self.copies.sides[i][*side] >> 2) as usize];
            let side = [0, 1].into_iter().find(inside).unwrap_or(0);
            let v = self.face_on_side(i as u32, side).map(|v| v as usize);
            (v, f.crack, f.origin as usize)
        })
    }

    /// Returns the faces of the boundary with their corners counter-clockwise from outside; faces of cracks
    /// are left out. Together they are closed.
    ///
    /// They are the faces between tetrahedra of the domain and others, flat ones within the domain included.
    /// Constrained faces keep the order in which they were given, and those of a hull of nodes that are
    /// coplanar up to round-off may belong to flat tetrahedra outside of the domain.
    pub fn boundary(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let belongs = |t: usize| self.inside[t] || self.glued[t];
        let is_crack = |side: u32| {
            let face = self.face_at.get(&side);
            face.is_some_and(|f| self.mesh.faces[*f as usize].crack)
        };
        let tets = self.delaunay.tets.iter().enumerate();
        let inner = tets.filter(move |(k, _)| belongs(*k));
        inner.flat_map(move |(k, t)| {
            let is_outer = move |slot: &usize| {
                let behind = (t.n[*slot] >> 2) as usize;
                !belongs(behind) && !is_crack((k << 2 | slot) as u32)
            };
            let outer = (0..4).filter(is_outer);
            outer.map(move |slot| t.face(slot).map(|v| v as usize))
        })
    }

    /// Distance \[m\] from the domain up to which a point counts as being on the boundary.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    fn take_hull(&mut self) {
        // Numbered after the given faces: cracks keep the indices that the user gave them.
        let first = self.mesh.faces.len() as u32;
        let hull: Vec<[usize; 3]> = self.delaunay.hull().collect();
        for (i, f) in hull.into_iter().enumerate() {
            let v = f.map(|v| v as u32);
            self.mesh.push(crate::constraint::Face {
                v,
                crack: false,
                origin: first + i as u32,
            });
        }
    }

    fn raise_walls(&mut self) -> Result<()> {
        let mut star = Vec::new();
        for (i, f) in self.mesh.faces.iter().enumerate() {
            let Some((tet, slot)) = self.delaunay.face(f.v, &mut star) else {
                let faces = vec![f.origin as usize];
                return Err(Error::FacesNotRecovered {
                    faces,
                    count: 1,
                    inserted: self.recovery.inserted.len(),
                    limit: 0,
                });
            };
            let this_side = tet << 2 | slot as u32;
            // A face has two sides, one in each tetrahedron; both must block the sight.
            let far_side = self.delaunay.tets[tet as usize].n[slot];
            for side in [this_side, far_side] {
                let wall = 1 << (side & 3);
                // Two constrained faces at one place are an error: the map has room for one.
                let repeated = self.face_at.insert(side, i as u32);
                if let Some(first) = repeated {
                    let [first, second] =
                        [first, i as u32].map(|k| self.mesh.faces[k as usize].origin as usize);
                    return Err(Error::SelfIntersection {
                        first,
                        second,
                        count: 1,
                    });
                }
                self.walls[(side >> 2) as usize] |= wall;
            }
        }
        Ok(())
    }

    /// Marks the tetrahedra inside by crossing parity, starting from the ghosts outside.
    fn flood(&mut self, faces: usize) -> Result<()> {
        let tets = &self.delaunay.tets;
        let mut seen = vec![false; tets.len()];
        let mut queue: Vec<u32> = (0..tets.len() as u32)
            .filter(|&t| tets[t as usize].is_ghost())
            .collect();
        queue.iter().for_each(|&t| seen[t as usize] = true);
        while let Some(t) = queue.pop() {
            for &n in &tets[t as usize].n {
                let neighbour = (n >> 2) as usize;
                if seen[neighbour] {
                    continue;
                }
                // Crack faces do not separate inside from outside.
                let boundary = self
                    .face_at
                    .get(&n)
                    .is_some_and(|&f| !self.mesh.faces[f as usize].crack);
                seen[neighbour] = true;
                // Parity, not orientation: bodies within cavities and cavities within bodies need no
                // consistent normals.
                self.inside[neighbour] = self.inside[t as usize] ^ boundary;
                queue.push(n >> 2);
            }
        }
        if self.inside.contains(&true) {
            Ok(())
        } else {
            Err(Error::EmptyDomain { faces })
        }
    }

    fn measure(&mut self) {
        self.volume = self
            .elements()
            .map(|t| six_volumes(t.map(|v| &self.delaunay.points[v])))
            .sum::<f64>()
            / 6.0;
        let centre_of = |t: &crate::tet::Tet| {
            // A ghost has no sphere; its entry keeps the list in step with the tetrahedra.
            if t.is_ghost() {
                Vector3::zeros()
            } else {
                circumcentre(self.delaunay.corners(t)).0
            }
        };
        self.centre = self.delaunay.tets.iter().map(centre_of).collect();
        // After all centres: a flat tetrahedron takes that of a neighbour, as its own is meaningless.
        self.share_centres();
        self.starts = Starts::new(&self.delaunay);
    }
}

//! The domain: Delaunay complex, constrained faces, what is inside.

use crate::circumcentre::circumcentre;
use crate::constraint::{FaceMesh, Recovery, Surface, recover};
use crate::crack::Copies;
use crate::delaunay::{Delaunay, linear_gradients, linear_values, volume};
use crate::error::{Error, Result};
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Distance to the domain, relative to the largest coordinate, at which a point counts as being on its boundary.
/// Centroids of boundary faces computed in double precision are within 1e-15 of it; linear precision to 1e-12 asks
/// for less than 1e-12.
const ON_BOUNDARY: f64 = 1e-13;

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
    pub(crate) inside: Vec<bool>,
    /// Per tetrahedron, bit `slot`: the face opposite to `slot` is not seen through.
    pub(crate) walls: Vec<u8>,
    /// Vector from the first vertex to the circumcentre.
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

/// Uniform grid of tetrahedra where walks may start; keeps walks short for queries in any order.
#[derive(Debug, Clone, Default)]
struct Starts {
    low: Point3<f64>,
    inverse: f64,
    counts: [usize; 3],
    tets: Vec<u32>,
}

impl Starts {
    /// About four nodes per bin.
    fn new(delaunay: &Delaunay) -> Self {
        let [low, high] = crate::bins::around(&delaunay.points, 0.0);
        let extent = high - low;
        let longest = extent.max();
        let filled: f64 = extent.iter().map(|e| (e / longest).max(1e-2)).product();
        let size = longest * (4.0 * filled / delaunay.points.len() as f64).cbrt();
        let counts = [0, 1, 2].map(|k| ((extent[k] / size).ceil() as usize).max(1));
        let mut tets = vec![0; counts.iter().product()];
        let mut hint = 0;
        for (i, start) in tets.iter_mut().enumerate() {
            let index = [
                i / (counts[1] * counts[2]),
                i / counts[2] % counts[1],
                i % counts[2],
            ];
            let middle = Point3::from([0, 1, 2].map(|k| low[k] + (index[k] as f64 + 0.5) * size));
            hint = delaunay.walk(&middle, hint);
            *start = hint;
        }
        Self {
            low,
            inverse: 1.0 / size,
            counts,
            tets,
        }
    }

    fn at(&self, x: &Point3<f64>) -> u32 {
        let index =
            |k: usize| (((x[k] - self.low[k]) * self.inverse).max(0.0) as usize).min(self.counts[k] - 1);
        self.tets[(index(0) * self.counts[1] + index(1)) * self.counts[2] + index(2)]
    }
}

impl Domain {
    /// Builds the domain of `points` bounded by `surface`. Up to `1000 + 4 * faces` points may be inserted on faces
    /// that are not in the Delaunay complex; see [`Domain::recovery`].
    ///
    /// # Errors
    /// Those of [`Delaunay::new`] and [`Surface::check`]; `SelfIntersection`, `FacesNotRecovered`, `NodeOutside`,
    /// `EmptyDomain`.
    pub fn new(points: &[Point3<f64>], surface: &Surface) -> Result<Self> {
        let faces = surface.boundary_faces().len() + surface.crack_faces().len();
        Self::with_limit(points, surface, 1000 + 4 * faces)
    }

    /// As [`Domain::new`], with the largest number of points that may be inserted (0: stop with an error instead).
    ///
    /// # Errors
    /// As [`Domain::new`].
    pub fn with_limit(points: &[Point3<f64>], surface: &Surface, limit: usize) -> Result<Self> {
        surface.check(points)?;
        let mut delaunay = Delaunay::new(points)?;
        let (mesh, recovery) = recover(&mut delaunay, surface, limit)?;
        delaunay.tidy();
        let scale = points
            .iter()
            .flat_map(|p| p.iter().copied())
            .fold(0.0, |m: f64, x| m.max(x.abs()));
        let tets = delaunay.tets.len();
        let mut domain = Self {
            delaunay,
            inside: vec![false; tets],
            walls: vec![0; tets],
            centre: Vec::new(),
            mesh,
            face_at: HashMap::new(),
            tolerance: ON_BOUNDARY * scale,
            copies: Copies::default(),
            starts: Starts::default(),
            recovery,
            volume: 0.0,
        };
        if surface.boundary_faces().is_empty() {
            domain.take_hull();
        }
        domain.raise_walls()?;
        domain.flood(surface.boundary_faces().len())?;
        domain.check_nodes()?;
        domain.open_cracks();
        domain.measure();
        Ok(domain)
    }

    /// All nodes: the given ones, those inserted on constrained faces (see [`Domain::recovery`]), and the copies for the
    /// second lips of cracks (see [`Domain::copies`]).
    pub fn nodes(&self) -> &[Point3<f64>] {
        &self.delaunay.points
    }

    /// Volume of the domain (m^3).
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// What had to be done to recover the constrained faces.
    pub fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    /// The Delaunay complex of the convex hull.
    pub fn delaunay(&self) -> &Delaunay {
        &self.delaunay
    }

    /// Tetrahedra of the domain, each with a positive volume.
    pub fn elements(&self) -> impl Iterator<Item = [usize; 4]> + '_ {
        let inside = self.delaunay.tets.iter().zip(&self.inside).filter(|t| *t.1);
        inside.map(|t| t.0.v.map(|v| v as usize))
    }

    /// Constrained faces after recovery: nodes, whether it is a crack face, and the input face it comes from. Of a crack
    /// face the nodes of one lip are given, of a boundary face those on the inside; see also [`Domain::lips`].
    pub fn constrained_faces(&self) -> impl Iterator<Item = ([usize; 3], bool, usize)> + '_ {
        self.mesh.faces.iter().enumerate().map(|(i, f)| {
            let inside = |side: &usize| self.inside[(self.copies.sides[i][*side] >> 2) as usize];
            let side = [0, 1].into_iter().find(inside).unwrap_or(0);
            let v = self.face_on_side(i as u32, side).map(|v| v as usize);
            (v, f.crack, f.origin as usize)
        })
    }

    /// Distance from the domain up to which a point counts as being on the boundary (m).
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    fn take_hull(&mut self) {
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
            let one = tet << 2 | slot as u32;
            let other = self.delaunay.tets[tet as usize].n[slot];
            for side in [one, other] {
                let wall = 1 << (side & 3);
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

    /// Inside and outside by crossing parity from the ghosts.
    fn flood(&mut self, faces: usize) -> Result<()> {
        let tets = &self.delaunay.tets;
        let mut seen = vec![false; tets.len()];
        let mut queue: Vec<u32> = (0..tets.len() as u32)
            .filter(|&t| tets[t as usize].is_ghost())
            .collect();
        queue.iter().for_each(|&t| seen[t as usize] = true);
        while let Some(t) = queue.pop() {
            for &n in &tets[t as usize].n {
                let other = (n >> 2) as usize;
                if seen[other] {
                    continue;
                }
                let boundary = self
                    .face_at
                    .get(&n)
                    .is_some_and(|&f| !self.mesh.faces[f as usize].crack);
                seen[other] = true;
                self.inside[other] = self.inside[t as usize] ^ boundary;
                queue.push(n >> 2);
            }
        }
        if self.inside.contains(&true) {
            Ok(())
        } else {
            Err(Error::EmptyDomain { faces })
        }
    }

    fn check_nodes(&self) -> Result<()> {
        let mut used = vec![false; self.nodes().len()];
        self.elements().flatten().for_each(|v| used[v] = true);
        let mut outside = (0..used.len()).filter(|&v| !used[v]);
        match outside.next() {
            None => Ok(()),
            Some(node) => Err(Error::NodeOutside {
                node,
                point: self.nodes()[node].into(),
                count: 1 + outside.count(),
            }),
        }
    }

    fn measure(&mut self) {
        self.volume = self
            .elements()
            .map(|t| volume(t.map(|v| &self.delaunay.points[v])))
            .sum();
        let centre_of = |t: &crate::tet::Tet| {
            if t.is_ghost() {
                Vector3::zeros()
            } else {
                circumcentre(self.delaunay.corners(t)).0
            }
        };
        self.centre = self.delaunay.tets.iter().map(centre_of).collect();
        self.starts = Starts::new(&self.delaunay);
    }

    /// Distance from `x` to the planes of a tetrahedron, positive outside, one per slot.
    pub(crate) fn plane_distances(&self, tet: u32, x: &Point3<f64>) -> [f64; 4] {
        let t = &self.delaunay.tets[tet as usize];
        [0, 1, 2, 3].map(|slot| {
            let [a, b, c] = t.face(slot).map(|v| &self.delaunay.points[v as usize]);
            let n = (b - a).cross(&(c - a));
            n.dot(&(x - a)) / n.norm()
        })
    }

    /// A tetrahedron of the domain that holds `x`, up to the tolerance; `near` is scratch.
    pub(crate) fn locate(&self, x: &Point3<f64>, near: &mut Vec<u32>) -> Result<u32> {
        self.search(x, self.tolerance, near)
            .ok_or_else(|| Error::OutsideDomain {
                point: (*x).into(),
                tolerance: self.tolerance,
            })
    }

    /// A tetrahedron of the domain within a distance of `x`, relative to the largest coordinate.
    pub(crate) fn locate_near(&self, x: &Point3<f64>, relative: f64) -> Option<u32> {
        self.search(x, self.tolerance * (relative / ON_BOUNDARY), &mut Vec::new())
    }

    fn search(&self, x: &Point3<f64>, tolerance: f64, near: &mut Vec<u32>) -> Option<u32> {
        if !x.iter().all(|c| c.is_finite()) {
            return None;
        }
        let found = self.delaunay.walk(x, self.starts.at(x));
        if self.inside[found as usize] {
            return Some(found);
        }
        near.clear();
        near.push(found);
        let mut next = 0;
        while next < near.len() && next < 256 {
            let t = self.delaunay.tets[near[next] as usize];
            next += 1;
            for n in t.n.map(|n| n >> 2) {
                let other = &self.delaunay.tets[n as usize];
                if near.contains(&n) || other.is_ghost() {
                    continue;
                }
                if self.plane_distances(n, x).iter().all(|d| *d <= tolerance) {
                    if self.inside[n as usize] {
                        return Some(n);
                    }
                    near.push(n);
                }
            }
        }
        None
    }

    /// Tetrahedra in the order of [`Domain::elements`].
    pub(crate) fn element_ids(&self) -> Vec<u32> {
        (0..self.inside.len() as u32)
            .filter(|&t| self.inside[t as usize])
            .collect()
    }

    /// Vertices of a tetrahedron.
    pub(crate) fn corners_of(&self, tet: u32) -> [usize; 4] {
        self.delaunay.tets[tet as usize].v.map(|v| v as usize)
    }

    /// Nodes and linear functions at `x` of the tetrahedron at `node` that is closest to holding it.
    pub(crate) fn linear_at_node(&self, node: usize, x: &Point3<f64>) -> Result<([usize; 4], [f64; 4])> {
        let mut star = Vec::new();
        self.delaunay.star(node as u32, &mut star);
        let far = |t: u32| {
            self.plane_distances(t, x)
                .into_iter()
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let inside = star.into_iter().filter(|&t| self.inside[t as usize]);
        let nearest = inside.map(|t| (far(t), t)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, tet)) = nearest else {
            return Err(Error::OutsideDomain {
                point: (*x).into(),
                tolerance: self.tolerance,
            });
        };
        let nodes = self.corners_of(tet);
        let p = nodes.map(|v| self.nodes()[v]);
        Ok((nodes, linear_values(&p, &linear_gradients(&p).0, x)))
    }

    /// True if `x` is in the closed domain (up to [`Domain::tolerance`]).
    pub fn contains(&self, x: &Point3<f64>) -> bool {
        self.locate(x, &mut Vec::new()).is_ok()
    }
}

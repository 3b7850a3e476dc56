//! Search for the tetrahedron of the domain that holds a point.

use super::{Domain, ON_BOUNDARY};
use crate::circumcentre::six_volumes;
use crate::delaunay::{Delaunay, linear_gradients, linear_values};
use crate::error::{Error, Result};
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::{Point3, Vector3};

/// Squared sine of a corner angle of a face below which the face's normal is not used.
const NEEDLE: f64 = 1e-6;

/// Largest number of tetrahedra that a search around a point visits.
const MAX_NEAR: usize = 256;

/// Uniform grid of tetrahedra at which walks start; keeps walks short for queries in any order.
#[derive(Debug, Clone, Default)]
pub(super) struct Starts {
    /// Mean position of the nodes \[m\].
    middle: Point3<f64>,
    low: Point3<f64>,
    inverse: f64,
    counts: [usize; 3],
    tets: Vec<u32>,
}

impl Starts {
    /// Creates the grid, with about four nodes per bin.
    pub(super) fn new(delaunay: &Delaunay) -> Self {
        let [low, high] = crate::bins::around(&delaunay.points, 0.0);
        let extent = high - low;
        let longest = extent.max();
        // Flat sets have no volume: at least a hundredth of the longest extent keeps the bin size positive.
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
            // Bins are visited in order, so the walk to the next middle is one bin long.
            hint = delaunay.walk(&middle, hint);
            *start = hint;
        }
        let sum = delaunay.points.iter().map(|p| p.coords).sum::<Vector3<f64>>();
        Self {
            middle: (sum / delaunay.points.len() as f64).into(),
            low,
            inverse: 1.0 / size,
            counts,
            tets,
        }
    }

    fn start_near(&self, x: &Point3<f64>) -> u32 {
        let index =
            |k: usize| (((x[k] - self.low[k]) * self.inverse).max(0.0) as usize).min(self.counts[k] - 1);
        self.tets[(index(0) * self.counts[1] + index(1)) * self.counts[2] + index(2)]
    }
}

impl Domain {
    /// Returns the distances from `x` to the planes of a tetrahedron \[m\], one per slot, positive outside.
    pub(crate) fn plane_distances(&self, tet: u32, x: &Point3<f64>) -> [f64; 4] {
        let t = &self.delaunay.tets[tet as usize];
        [0, 1, 2, 3].map(|slot| {
            let [a, b, c] = t.face(slot).map(|v| &self.delaunay.points[v as usize]);
            let (u, v, arm) = (b - a, c - a, x - a);
            let n = u.cross(&v);
            let square = n.norm_squared();
            // The direction of a needle's normal is round-off; the volume between the needle and `x` is not.
            let six = if square > NEEDLE * u.norm_squared() * v.norm_squared() {
                n.dot(&arm)
            } else {
                six_volumes([a, b, c, x])
            };
            six / square.sqrt()
        })
    }

    /// Returns a tetrahedron of the domain that holds `x` up to the tolerance. `near` is a working buffer.
    pub(crate) fn locate(&self, x: &Point3<f64>, near: &mut Vec<u32>) -> Result<u32> {
        self.search(x, self.tolerance, near)
            .ok_or_else(|| Error::OutsideDomain {
                point: (*x).into(),
                tolerance: self.tolerance,
            })
    }

    /// Returns a tetrahedron of the domain within a distance of `x`, given relative to the largest
    /// coordinate.
    pub(crate) fn locate_near(&self, x: &Point3<f64>, relative: f64) -> Option<u32> {
        self.search(x, self.tolerance * (relative / ON_BOUNDARY), &mut Vec::new())
    }

    fn search(&self, x: &Point3<f64>, tolerance: f64, near: &mut Vec<u32>) -> Option<u32> {
        if !x.iter().all(|c| c.is_finite()) {
            return None;
        }
        let start = self.starts.start_near(x);
        // The walk is exact. The rest is for points beyond the hull, beside flat tetrahedra, or outside by
        // round-off.
        let mut tet = self.delaunay.walk(x, start);
        let mut reach = tolerance;
        let outside = self.delaunay.tets[tet as usize].is_ghost();
        if outside {
            (tet, reach) = self.enter(x, tet, start, tolerance)?;
        }
        if self.inside[tet as usize] && (!outside || self.farthest_plane(tet, x) <= tolerance) {
            return Some(tet);
        }
        // Distances to planes first: they are cheap and fail only beside flat and needle-shaped tetrahedra.
        let by_planes = self.search_by_planes(x, tet, [tolerance, reach], near);
        by_planes.or_else(|| self.search_by_distance(x, tet, [tolerance, reach], near))
    }

    /// Returns a tetrahedron of the domain whose planes are all within `tolerance` of `x`. The search starts
    /// at `start` and passes through tetrahedra whose planes are within `reach`.
    fn search_by_planes(
        &self,
        x: &Point3<f64>,
        start: u32,
        [tolerance, reach]: [f64; 2],
        near: &mut Vec<u32>,
    ) -> Option<u32> {
        near.clear();
        near.push(start);
        let mut next = 0;
        while next < near.len() && next < MAX_NEAR {
            let t = self.delaunay.tets[near[next] as usize];
            next += 1;
            for n in t.n.map(|n| n >> 2) {
                let neighbour = &self.delaunay.tets[n as usize];
                if near.contains(&n) || neighbour.is_ghost() {
                    continue;
                }
                if self.flat[n as usize] {
                    // A flat tetrahedron has no reliable planes; the search only passes through it.
                    if self.box_holds(n, x, reach) {
                        near.push(n);
                    }
                    continue;
                }
                let distance = self.farthest_plane(n, x);
                if distance <= tolerance && self.inside[n as usize] {
                    return Some(n);
                }
                if distance <= reach {
                    near.push(n);
                }
            }
        }
        None
    }

    /// Like [`Self::search_by_planes`], by the distance from the tetrahedra themselves. Along straight edges
    /// there are flat and needle-shaped tetrahedra, whose planes point anywhere.
    fn search_by_distance(
        &self,
        x: &Point3<f64>,
        start: u32,
        [tolerance, reach]: [f64; 2],
        near: &mut Vec<u32>,
    ) -> Option<u32> {
        near.clear();
        near.push(start);
        let mut next = 0;
        while next < near.len() && next < MAX_NEAR {
            let tet = near[next];
            next += 1;
            if self.inside[tet as usize] && self.distance_outside(tet, x) <= tolerance {
                return Some(tet);
            }
            for n in self.delaunay.tets[tet as usize].n.map(|n| n >> 2) {
                let ghost = self.delaunay.tets[n as usize].is_ghost();
                if !ghost && !near.contains(&n) && self.distance_outside(n, x) <= reach {
                    near.push(n);
                }
            }
        }
        None
    }

    /// Returns the largest distance \[m\] of a point beyond the planes of a tetrahedron, negative inside.
    fn farthest_plane(&self, tet: u32, x: &Point3<f64>) -> f64 {
        let distances = self.plane_distances(tet, x).into_iter();
        distances.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the distance \[m\] between a tetrahedron and a point outside it or on its border.
    fn distance_outside(&self, tet: u32, x: &Point3<f64>) -> f64 {
        let t = &self.delaunay.tets[tet as usize];
        let to_face = |slot: usize| {
            let corners = t.face(slot).map(|v| self.delaunay.points[v as usize] - x);
            closest_on_triangle(&Vector3::zeros(), &corners).norm()
        };
        (0..4).map(to_face).fold(f64::INFINITY, f64::min)
    }

    /// For a point outside the hull, beyond the face of a ghost: returns a tetrahedron near it, and how far
    /// around the point the search must go on from there \[m\].
    fn enter(&self, x: &Point3<f64>, ghost: u32, start: u32, tolerance: f64) -> Option<(u32, f64)> {
        let v = self.delaunay.tets[ghost as usize].v;
        let [a, b, c] = [v[0], v[1], v[2]].map(|v| &self.delaunay.points[v as usize]);
        let (area, longest) = (
            (b - a).cross(&(c - a)).norm(),
            (b - a).norm().max((c - a).norm()).max((c - b).norm()),
        );
        // The hull lies on one side of the plane of each of its faces: a point farther beyond than this is
        // outside. A needle along a straight edge has no reliable plane.
        let excess = six_volumes([a, b, c, x]) / area;
        if area > self.tolerance * longest && excess > 2.0 * tolerance {
            return None;
        }
        // Where the hull is flat up to round-off, the ghost's face need not be next to the point. So the
        // point is moved towards the middle, further each time, until it is in a tetrahedron.
        // A point in the middle of the nodes has no direction inward, but cannot be outside the hull either.
        let inward = (self.starts.middle - x).try_normalize(0.0)?;
        // From 4 to some 8e6 tolerances: the smallest shift that leads into the hull is taken.
        let shifts = (0..8).map(|k| 4.0 * tolerance * 8.0_f64.powi(k));
        shifts
            .map(|shift| (self.delaunay.walk(&(x + inward * shift), start), 2.0 * shift))
            .find(|(tet, _)| !self.delaunay.tets[*tet as usize].is_ghost())
    }

    fn box_holds(&self, tet: u32, x: &Point3<f64>, tolerance: f64) -> bool {
        let corners = self.delaunay.corners(&self.delaunay.tets[tet as usize]);
        let [low, high] = crate::bins::around(corners, tolerance);
        (0..3).all(|k| low[k] <= x[k] && x[k] <= high[k])
    }

    /// Returns the indices of the tetrahedra in the order of [`Domain::elements`].
    pub(crate) fn element_ids(&self) -> Vec<u32> {
        (0..self.inside.len() as u32)
            .filter(|&t| self.inside[t as usize])
            .collect()
    }

    /// Returns the vertices of a tetrahedron.
    pub(crate) fn corners_of(&self, tet: u32) -> [usize; 4] {
        self.delaunay.tets[tet as usize].v.map(|v| v as usize)
    }

    /// Returns nodes and linear functions at `x` of a tetrahedron at `node`: of all tetrahedra around the
    /// node the one that comes closest to holding `x`.
    pub(crate) fn linear_at_node(&self, node: usize, x: &Point3<f64>) -> Result<([usize; 4], [f64; 4])> {
        let mut star = Vec::new();
        self.delaunay.star(node as u32, &mut star);
        let inside = star.into_iter().filter(|&t| self.inside[t as usize]);
        let nearest = inside
            .map(|t| (self.farthest_plane(t, x), t))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, tet)) = nearest else {
            return Err(Error::OutsideDomain {
                point: (*x).into(),
                tolerance: self.tolerance,
            });
        };
        let nodes = self.corners_of(self.thick(tet, x));
        let p = nodes.map(|v| self.nodes()[v]);
        Ok((nodes, linear_values(&p, &linear_gradients(&p).0, x)))
    }

    /// Returns whether `x` is in the closed domain (up to [`Domain::tolerance`]).
    pub fn contains(&self, x: &Point3<f64>) -> bool {
        self.locate(x, &mut Vec::new()).is_ok()
    }
}

//! Points of a surface at which contact acts: the nodes, and points between them where the obstacle is small
//! compared with the facets.
//!
//! A facet is divided into `n²` triangles, and each gives a third of its area to each of its corners. A point
//! has the stiffness `E A/(t h)` of a layer of the thickness `t h`, where `h` is the size of the facet. Its
//! motion is that of the linear facet, and its force goes to the facet's nodes with the same weights, so
//! forces and moments about the present places are kept.

use super::place::{Place, Triangle};
use crate::Result;
use crate::error::invalid;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Thickness of the elastic layer of a contact over the size of the facet.
const LAYER: f64 = 0.25;

/// Part of a facet's size or depth, and of the depth of a rigid body, by which points may overlap it at the
/// start and sink into it in a run. Deeper ones could pass through.
pub(super) const DEEPEST: f64 = 0.5;

/// Largest number of divisions of a facet along an edge.
const MOST: usize = 64;

/// A point of a surface, or a sphere.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePoint {
    /// Its place on a facet; a point at a node has that node alone.
    pub(super) place: Place,
    /// Position at rest \[m\].
    pub(super) rest: Point3<f64>,
    /// Area \[m²\].
    pub(super) area: f64,
    /// Stiffness over the modulus \[m\].
    pub(super) stiffness: f64,
    /// Size of the facet \[m\].
    pub(super) size: f64,
    /// Sum of the outward normals of the facets around it times its area on each \[m²\]; zero for spheres.
    pub(super) normal: Vector3<f64>,
    /// A facet on which it lies: nodes and their places at rest \[m\]; none for spheres.
    pub(super) facet: Option<(Triangle, [Vector3<f64>; 4])>,
}

impl SurfacePoint {
    /// Position in the displacements `q` \[m\].
    pub(super) fn position(&self, q: &[f64]) -> Vector3<f64> {
        self.rest.coords + self.place.value(q)
    }

    /// Cosine of the angle by which the facet of the point has turned since rest, in the displacements `q`.
    pub(super) fn turn(&self, q: &[f64]) -> f64 {
        let Some((triangle, rest)) = &self.facet else {
            return 1.0;
        };
        let place = |n: u32| rest[triangle.nodes.iter().position(|m| *m == n).unwrap_or_default()];
        let moved = |n: u32| {
            let o = 3 * n as usize;
            place(n) + Vector3::new(q[o], q[o + 1], q[o + 2])
        };
        triangle.turn(place, moved)
    }
}

/// Points that lie deeper in a body than their limits, and the deepest of them.
#[derive(Debug, Default)]
pub(super) struct Deepest {
    count: usize,
    depth: f64,
    limit: f64,
    place: Vector3<f64>,
}

impl Deepest {
    /// Adds a point at `place` if its depth exceeds the limit \[m\].
    pub(super) fn add(&mut self, depth: f64, limit: f64, place: impl FnOnce() -> Vector3<f64>) {
        if depth > limit {
            self.count += 1;
            if depth > self.depth {
                (self.depth, self.limit, self.place) = (depth, limit, place());
            }
        }
    }

    /// Returns an error about `object` if there are points; they `verb` inside, and `rule` gets the limit of
    /// the deepest as text.
    pub(super) fn refuse(&self, object: &str, verb: &str, rule: impl FnOnce(&str) -> String) -> Result<()> {
        if self.count == 0 {
            return Ok(());
        }
        let x = &self.place;
        let value = format!(
            "{} points {verb} inside, the deepest {:.3e} m at ({:.3e}, {:.3e}, {:.3e}) m",
            self.count, self.depth, x.x, x.y, x.z
        );
        Err(invalid(object, value, &rule(&format!("{:.3e} m", self.limit))))
    }

    /// Refuses points that sink in a run so deep that they may pass through.
    pub(super) fn refuse_sinking(&self, object: &str) -> Result<()> {
        self.refuse(object, "sink", |limit| {
            format!(
                "must stay above a depth of {limit}, or they may pass through: enlarge the modulus of the contact, or refine the \
                 surface"
            )
        })
    }
}

/// Corner of a division of a facet: two or three nodes with their numerators, and the denominator.
type Key = (Vec<(u32, usize)>, usize);

/// Points of triangles that lie at most `spacing` \[m\] apart, the nodes first.
///
/// # Errors
/// [`crate::Error::InvalidParameter`] for facets that would need more than [`MOST`] divisions; `object` names
/// the obstacle and the model.
pub(super) fn points(
    object: &str,
    triangles: &[Triangle],
    nodes: &[Point3<f64>],
    spacing: f64,
) -> Result<Vec<SurfacePoint>> {
    // By numbers of corners: nodes come before the centres of faces.
    let mut at_corners: BTreeMap<u32, SurfacePoint> = BTreeMap::new();
    let mut between: BTreeMap<Key, SurfacePoint> = BTreeMap::new();
    for t in triangles {
        let x = t.places(|n| nodes[n as usize].coords);
        let edges = [x[1] - x[0], x[2] - x[1], x[0] - x[2]].map(|e| e.norm());
        let longest = edges.iter().copied().fold(0.0, f64::max);
        let count = (longest / spacing).ceil().max(1.0);
        if count > MOST as f64 {
            let rule = format!(
                "must be at most {MOST} times {spacing:.3e} m, half the depth of the obstacle: refine the surface, or name only \
                 models with small facets"
            );
            return Err(invalid(
                &format!("longest facet of {object}"),
                format_args!("{longest:.3e} m"),
                &rule,
            ));
        }
        let n = count as usize;
        let doubled = (x[1] - x[0]).cross(&(x[2] - x[0]));
        let area = 0.5 * doubled.norm();
        let size = t.size(area);
        let small = area / (n * n) as f64;
        for i in 0..=n {
            for j in 0..=n - i {
                let parts = [n - i - j, i, j];
                let weights = parts.map(|p| p as f64 / n as f64);
                let zero = parts.iter().filter(|p| **p == 0).count();
                // A lattice point has six triangles around it, three at an edge, one at a corner.
                let corners = [6.0, 3.0, 1.0][zero];
                let share = small / 3.0 * corners;
                let mut ends: Vec<(u32, usize)> =
                    t.corners.iter().copied().zip(parts).filter(|e| e.1 > 0).collect();
                ends.sort_unstable();
                let fresh = SurfacePoint {
                    place: t.place(weights),
                    rest: Point3::from(x[0] * weights[0] + x[1] * weights[1] + x[2] * weights[2]),
                    area: 0.0,
                    stiffness: 0.0,
                    size,
                    normal: Vector3::zeros(),
                    facet: Some((*t, t.nodes.map(|n| nodes[n as usize].coords))),
                };
                let point = match ends[..] {
                    [(corner, _)] => {
                        at_corners
                            .entry(corner)
                            .or_insert_with(|| match nodes.get(corner as usize) {
                                Some(x) => SurfacePoint {
                                    place: Place::node(corner),
                                    rest: *x,
                                    ..fresh
                                },
                                None => fresh,
                            })
                    }
                    _ => between.entry((ends, n)).or_insert(fresh),
                };
                point.area += share;
                point.normal += doubled * (0.5 * corners / (3 * n * n) as f64);
                point.stiffness += share / (LAYER * size);
                point.size = point.size.min(size);
            }
        }
    }
    let points = at_corners.into_values().chain(between.into_values());
    // Triangles without area have no stiffness, and their points lie in those of neighbours.
    Ok(points
        .filter(|p| p.area > 0.0 && p.stiffness.is_finite())
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Areas sum to that of the surface and neighbours share the points of their edge.
    #[test]
    fn points_of_a_square_share_its_area() {
        let nodes = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        let triangles = Triangle::cut(&[[0, 1, 2, 2], [0, 2, 3, 3]], 4);
        let quarters = Triangle::cut(&[[0, 1, 2, 3]], 4);
        for (triangles, spacing, count) in [
            (&triangles, f64::INFINITY, 4),
            (&triangles, 0.75, 9),
            (&triangles, 0.36, 25),
            (&quarters, f64::INFINITY, 5),
            (&quarters, 0.51, 13),
        ] {
            let points = points("test", triangles, &nodes, spacing).unwrap();
            assert_eq!(points.len(), count);
            let area: f64 = points.iter().map(|p| p.area).sum();
            assert!((area - 1.0).abs() < 1e-14);
            let moment: Vector3<f64> = points.iter().map(|p| p.rest.coords * p.area).sum();
            assert!((moment - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-14);
            // Shares of a uniform pressure: each node of a quadrilateral gets a quarter.
            let mut shares = [0.0; 4];
            for p in &points {
                p.place.nodes().for_each(|(n, w)| shares[n] += w * p.area);
            }
            let expected = if triangles.len() == 4 {
                [0.25; 4]
            } else {
                [1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0]
            };
            let same = shares.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14);
            assert!(same, "{shares:?}");
        }
        let error = points("the block", &triangles, &nodes, 1e-3)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("longest facet of the block") && error.contains("refine"),
            "{error}"
        );
    }
}

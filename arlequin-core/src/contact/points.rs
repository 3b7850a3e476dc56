//! Points of a surface at which contact acts: the nodes, and points between them where the obstacle is small
//! compared with the facets.
//!
//! A facet is divided into `n²` triangles, and each gives a third of its area to each of its corners. A point
//! has the stiffness `E A/(t h)` of a layer of the thickness `t h`, where `h` is the size of the facet. Its
//! motion is that of the linear facet, and its force goes to the facet's nodes with the same weights, so
//! forces and moments about the present places are kept.

use super::place::Place;
use crate::Result;
use crate::error::invalid;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Thickness of the elastic layer of a contact over the size of the facet.
const LAYER: f64 = 0.25;

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
    triangles: &[[u32; 3]],
    nodes: &[Point3<f64>],
    spacing: f64,
) -> Result<Vec<SurfacePoint>> {
    let mut at_nodes: BTreeMap<u32, SurfacePoint> = BTreeMap::new();
    let mut between: BTreeMap<Key, SurfacePoint> = BTreeMap::new();
    for t in triangles {
        let x = t.map(|n| nodes[n as usize].coords);
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
        // Side of the square that has the area of two such triangles.
        let size = (2.0 * area).sqrt();
        let small = area / (n * n) as f64;
        for i in 0..=n {
            for j in 0..=n - i {
                let parts = [n - i - j, i, j];
                let weights = parts.map(|p| p as f64 / n as f64);
                let zero = parts.iter().filter(|p| **p == 0).count();
                // A lattice point has six triangles around it, three at an edge, one at a corner.
                let corners = [6.0, 3.0, 1.0][zero];
                let share = small / 3.0 * corners;
                let mut ends: Vec<(u32, usize)> = t.iter().copied().zip(parts).filter(|e| e.1 > 0).collect();
                ends.sort_unstable();
                let fresh = SurfacePoint {
                    place: Place { nodes: *t, weights },
                    rest: Point3::from(x[0] * weights[0] + x[1] * weights[1] + x[2] * weights[2]),
                    area: 0.0,
                    stiffness: 0.0,
                    size,
                    normal: Vector3::zeros(),
                };
                let point = match ends[..] {
                    [(node, _)] => at_nodes.entry(node).or_insert(SurfacePoint {
                        place: Place::node(node),
                        rest: nodes[node as usize],
                        ..fresh
                    }),
                    _ => between.entry((ends, n)).or_insert(fresh),
                };
                point.area += share;
                point.normal += doubled * (0.5 * corners / (3 * n * n) as f64);
                point.stiffness += share / (LAYER * size);
                point.size = point.size.min(size);
            }
        }
    }
    let points = at_nodes.into_values().chain(between.into_values());
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
        let triangles = [[0, 1, 2], [0, 2, 3]];
        for (spacing, count) in [(f64::INFINITY, 4), (0.75, 9), (0.36, 25)] {
            let points = points("test", &triangles, &nodes, spacing).unwrap();
            assert_eq!(points.len(), count);
            let area: f64 = points.iter().map(|p| p.area).sum();
            assert!((area - 1.0).abs() < 1e-14);
            let moment: Vector3<f64> = points.iter().map(|p| p.rest.coords * p.area).sum();
            assert!((moment - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-14);
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

//! Faces of the surface of a body: triangles, and quadrilaterals where four nodes lie on a circle.
//!
//! Natural-neighbour functions do not depend on how such nodes are divided into tetrahedra, so contact and
//! loads must not depend on the diagonal either: a uniform pressure gives each corner of a rectangle a
//! quarter.

use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Largest sine of the angle between two triangles of one plane, and largest sine of the sum of two opposite
/// angles of four nodes on a circle.
const EQUAL: f64 = 1e-6;

/// Joins pairs of triangles whose four nodes lie on a circle. A triangle repeats its last node.
pub(super) fn faces(nodes: &[Point3<f64>], triangles: impl Iterator<Item = [usize; 3]>) -> Vec<[u32; 4]> {
    let triangles: Vec<[usize; 3]> = triangles.collect();
    // Each edge of a closed surface has a triangle on either side, in opposite directions.
    let mut across = BTreeMap::new();
    for (k, [a, b, c]) in triangles.iter().copied().enumerate() {
        for (edge, last) in [([a, b], c), ([b, c], a), ([c, a], b)] {
            across.insert(edge, (k, last));
        }
    }
    let mut joined = vec![false; triangles.len()];
    let mut out = Vec::with_capacity(triangles.len());
    for (k, [a, b, c]) in triangles.iter().copied().enumerate() {
        if joined[k] {
            continue;
        }
        let fourth = |[a, b, c]: [usize; 3]| {
            let (other, d) = *across.get(&[a, c])?;
            let corners = [a, b, c, d];
            let fits = other > k && !joined[other] && is_on_circle(corners.map(|n| nodes[n]));
            fits.then_some((other, corners))
        };
        let quadrilateral = [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(fourth);
        let corners = quadrilateral.map_or([a, b, c, c], |(other, corners)| {
            joined[other] = true;
            corners
        });
        out.push(corners.map(|n| n as u32));
    }
    out
}

/// Returns whether the corners of a quadrilateral lie in a plane and on a circle: its opposite angles then
/// sum to `π`.
fn is_on_circle([a, b, c, d]: [Point3<f64>; 4]) -> bool {
    let angle = |from: Vector3<f64>, to: Vector3<f64>| (from.cross(&to), from.dot(&to));
    let [(sin_b, cos_b), (sin_d, cos_d)] = [angle(c - b, a - b), angle(a - d, c - d)];
    let scale = (c - b).norm() * (a - b).norm() * (a - d).norm() * (c - d).norm();
    let flat = sin_b.cross(&sin_d).norm() <= EQUAL * scale && sin_b.dot(&sin_d) > 0.0;
    flat && (sin_b.norm() * cos_d + sin_d.norm() * cos_b).abs() <= EQUAL * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rectangles are joined whatever their diagonal; four nodes that are not on a circle, or bent, are not.
    #[test]
    fn rectangles_are_faces_of_four_nodes() {
        let point = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let nodes = [
            point(0.0, 0.0, 0.0),
            point(2.0, 0.0, 0.0),
            point(2.0, 1.0, 0.0),
            point(0.0, 1.0, 0.0),
            point(3.0, 0.4, 0.0),
            point(1.0, -1.0, 0.3),
        ];
        let join = |triangles: &[[usize; 3]]| faces(&nodes, triangles.iter().copied());
        assert_eq!(join(&[[0, 1, 2], [0, 2, 3]]), [[0, 1, 2, 3]]);
        assert_eq!(join(&[[3, 0, 1], [1, 2, 3]]), [[3, 0, 1, 2]]);
        assert_eq!(
            join(&[[0, 1, 2], [1, 4, 2], [0, 5, 1]]),
            [[0, 1, 2, 2], [1, 4, 2, 2], [0, 5, 1, 1]]
        );
    }
}

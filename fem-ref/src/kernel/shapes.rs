//! Elements of the same shape, whose stiffness is the same to the bit.
//!
//! In a regular mesh round-off of the coordinates gives every element a slightly different shape. Where few
//! shapes repeat, stiffnesses are those of corners that are rounded alike, and rows of the matrix share their
//! values.

use crate::element::ElementKind;
use crate::mesh::Mesh;
use arlequin_core::Real;
use nalgebra::Point3;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hasher};

/// Rounding of corners, as a share of the power of two below the largest extent: `2⁻⁴⁰`. This is above the
/// round-off of coordinates in bodies of a thousand elements a side, and below any error that is asked for.
const GRID: f64 = 1.0 / (1_u64 << 40) as f64;

/// Least number of elements per shape for which shapes count as repeated.
const REPEATS: usize = 8;

/// Corners counted from the first one, rounded to a grid that depends on the element alone.
pub(crate) fn rounded<T: Real>(corners: &[Point3<T>; 8]) -> [Point3<T>; 8] {
    let edges = corners.map(|p| (p - corners[0]).map(T::as_f64));
    let extent = edges.iter().map(nalgebra::Vector3::amax).fold(0.0, f64::max);
    // Without its fraction a number is the power of two below it.
    let grid = f64::from_bits(extent.to_bits() & (0x7ff << 52)) * GRID;
    // The sum turns a negative zero into zero.
    edges.map(|d| Point3::from(d.map(|x| T::of((x / grid).round() * grid + 0.0))))
}

/// Returns whether the elements of a solid mesh have few shapes.
pub(crate) fn repeat<T: Real>(mesh: &Mesh<T>) -> bool {
    let (count, corners) = (mesh.element_count(), mesh.kind().corners());
    let mut shapes = HashSet::new();
    for e in (0..count).take_while(|_| mesh.kind() != ElementKind::Bar2) {
        let mut hasher = DefaultHasher::new();
        let numbers = rounded(&mesh.corners(e)).into_iter().take(corners);
        numbers.for_each(|p| p.iter().for_each(|x| hasher.write_u64(x.as_f64().to_bits())));
        shapes.insert(hasher.finish());
        if shapes.len() * REPEATS > count {
            return false;
        }
    }
    !shapes.is_empty()
}

#[cfg(test)]
mod tests {
    use super::{repeat, rounded};
    use crate::ElementKind;
    use crate::FemModel;
    use crate::generate;
    use arlequin_core::{Elastic, Model};
    use nalgebra::{Point3, Vector3};

    #[test]
    fn a_regular_mesh_stores_few_rows_wherever_it_lies() {
        let material = Elastic::new(70e9, 0.2, 2200.0).unwrap();
        for shift in [0.0, 0.137, -3.1] {
            let [low, high] = [shift, shift + 0.9].map(|x| Point3::new(x, x, x));
            let mesh = generate::block(ElementKind::Hex8, low, high, [9; 3]).unwrap();
            assert!(repeat(&mesh), "{shift}");
            let body = FemModel::new("body", mesh, material).unwrap();
            let [a, b] = [[4, 4, 4], [5, 3, 4]].map(|[x, y, z]| x + 10 * (y + 10 * z));
            let [a, b] = [a, b].map(|i| body.stiffness.row_values(i).as_ptr());
            assert_eq!(a, b, "{shift}");
            // Rows that are shared are those of the true mesh to a round-off of the coordinates.
            let q: Vec<f64> = body.nodes().iter().flat_map(|p| [p.x, 0.0, 0.0]).collect();
            let stress = material.young() / (1.0 + 0.2) * (1.0 + 0.2 / (1.0 - 0.4));
            let energy = 0.5 * stress * 0.9_f64.powi(3);
            assert!((body.internal_energy(&q) / energy - 1.0).abs() < 1e-11, "{shift}");
        }
    }

    #[test]
    fn a_mesh_whose_elements_differ_keeps_its_corners() {
        let [low, high] = [Point3::origin(), Point3::new(1.0, 1.0, 1.0)];
        let mesh = generate::block(ElementKind::Hex8, low, high, [6; 3]).unwrap();
        assert!(repeat(&mesh));
        let bend = |p: &Point3<f64>| p + Vector3::x() * (1e-6 * (7.0 * p.y + 3.0 * p.x * p.x).sin());
        assert!(!repeat(&mesh.mapped(bend).unwrap()));
        assert!(!repeat(&generate::bar(0.0, 1.0, 30, 1.0).unwrap()));
    }

    #[test]
    fn corners_move_by_less_than_a_share_of_the_element() {
        let corners: [Point3<f64>; 8] = std::array::from_fn(|k| {
            let k = k as f64;
            Point3::new(1e-3 * (k * 0.7).sin(), 2e-4 * (k * 1.3).cos(), 3e-5 * k)
        });
        for (p, r) in corners.iter().zip(rounded(&corners)) {
            assert!((p - corners[0] - r.coords).norm() < 2e-15);
        }
    }
}

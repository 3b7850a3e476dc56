//! Natural-neighbour values by every interface: by point and by cell, with and without gradients, in fields
//! and mediators, inside, on faces, edges and nodes, and outside by round-off.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::{block, noise};
use arlequin_core::geometry::Cell;
use arlequin_core::{Interpolation, ShapeRow};
use cnem::NaturalField;
use cnem::natural::Interpolant;
use nalgebra::{Point3, Vector3};

/// Returns the larger of `|Σ φ − 1|` and `|Σ φ (n_k − x)|` of a row.
fn defect(field: &dyn Interpolation<f64>, x: &Point3<f64>, row: &ShapeRow<f64>) -> f64 {
    let (mut unity, mut place) = (-1.0, Vector3::zeros());
    for (k, v) in row.nodes.iter().zip(&row.values) {
        unity += v;
        place += (field.nodes()[*k] - x) * *v;
    }
    f64::max(f64::abs(unity), place.norm())
}

/// Returns points with a cell each: inside the cells, on their faces, edges and corners, and 1e-12 outside of
/// the unit cube.
fn places(field: &dyn Interpolation<f64>) -> Vec<(Option<usize>, Point3<f64>)> {
    let mut out = Vec::new();
    let mut samples = Vec::new();
    for (k, cell) in field.cells().iter().enumerate() {
        samples.clear();
        cell.quadrature(2, &mut samples);
        out.extend(samples.iter().map(|s| (Some(k), s.point)));
        let Cell::Polyhedron(body) = cell else { continue };
        for face in body.faces.iter().step_by(3) {
            let sum = face.iter().fold(Vector3::zeros(), |s, p| s + p.coords);
            out.push((None, Point3::from(sum / face.len() as f64)));
            out.push((None, nalgebra::center(&face[0], &face[1])));
            out.push((None, face[0]));
        }
    }
    let mut next = noise(9);
    for _ in 0..40 {
        let (a, b) = (next().abs(), next().abs());
        out.push((None, Point3::new(1.0 + 1e-12, a, b)));
        out.push((None, Point3::new(a, -1e-12, b)));
    }
    out
}

#[test]
fn values_sum_to_one_and_place_the_point_through_every_door() {
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        let domain = block([4, 4, 4], 0.25, 0.3, 3, |_, _, _| true);
        let field = NaturalField::new(domain, kind);
        let fields: [Box<dyn Interpolation<f64>>; 2] = [
            Box::new(field.clone()),
            Box::new(field.with_voronoi_cells().unwrap()),
        ];
        let mut row = ShapeRow::default();
        for (door, field) in fields.iter().enumerate() {
            for (cell, x) in places(&**field) {
                for gradient in [false, true] {
                    field.shape_at(&x, gradient, &mut row).unwrap();
                    let d = defect(&**field, &x, &row);
                    assert!(
                        d < 2e-12,
                        "{kind:?}, door {door}, gradient {gradient}, {x}: {d:e}"
                    );
                    if let Some(k) = cell {
                        field.shape_in(k, &x, gradient, &mut row).unwrap();
                        let d = defect(&**field, &x, &row);
                        assert!(d < 2e-12, "{kind:?}, door {door}, cell {k}, {x}: {d:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_middle_of_a_cube_belongs_to_its_corners_by_an_eighth_and_that_of_a_face_by_a_quarter() {
    let corner = |i: u32| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
    let points: Vec<_> = (0..8).map(corner).collect();
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        let field = NaturalField::from_points(&points, kind).unwrap();
        let mut row = ShapeRow::default();
        for (x, share) in [
            (Point3::new(0.5, 0.5, 0.5), 0.125),
            (Point3::new(0.5, 0.5, 1.0), 0.25),
            (Point3::new(0.5, 0.0, 1.0), 0.5),
        ] {
            field.shape_at(&x, false, &mut row).unwrap();
            for v in row.values.iter().filter(|v| **v > 1e-14) {
                assert!((v - share).abs() < 1e-13, "{kind:?} {x}: {v}, not {share}");
            }
        }
    }
}

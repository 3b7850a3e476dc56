//! Natural-neighbour fields and mediators as the coupling uses them.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::{block, noise};
use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin_core::geometry::Cell;
use arlequin_core::{Error, Interpolation, Mediator, ShapeRow, conformance};
use cnem::NaturalField;
use cnem::natural::Interpolant;
use nalgebra::Point3;
use rayon::prelude::*;

fn random(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut next = noise(seed);
    (0..n).map(|_| Point3::new(next(), next(), next())).collect()
}

/// Returns quadrature points of the cells, nodes, and points of the border.
fn probes(field: &dyn Interpolation<f64>) -> Vec<Point3<f64>> {
    let mut samples = Vec::new();
    let cells = field.cells();
    cells.iter().for_each(|c| c.quadrature(2, &mut samples));
    let mut out: Vec<_> = samples.iter().map(|s| s.point).collect();
    out.extend_from_slice(field.nodes());
    for cell in &cells {
        let Cell::Polyhedron(body) = cell else { continue };
        for face in &body.faces {
            let sum = face.iter().fold(nalgebra::Vector3::zeros(), |s, p| s + p.coords);
            out.push(Point3::from(sum / face.len() as f64));
        }
    }
    out
}

#[test]
fn shapes_conform() {
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        let fields = [
            NaturalField::from_points(&random(200, 1), kind).unwrap(),
            NaturalField::new(block([4, 4, 3], 0.3, 0.3, 2, |i, j, _| i < 2 || j < 2), kind),
        ];
        for field in fields {
            let points = probes(&field);
            let defect = conformance::shapes(&field, &points, true).unwrap();
            assert!(defect.unity < 1e-12 && defect.linear < 1e-12, "{defect:?}");
            assert!(defect.gradient < 1e-9 && defect.negative >= 0.0, "{defect:?}");
            let values = conformance::shapes(&field, &points, false).unwrap();
            assert!(values.unity < 1e-12 && values.linear < 1e-12, "{values:?}");
        }
    }
}

#[test]
fn points_in_a_cell_need_no_search() {
    let field = NaturalField::from_points(&random(200, 3), Interpolant::Sibson).unwrap();
    let (mut a, mut b) = (ShapeRow::default(), ShapeRow::default());
    for (k, cell) in field.cells().iter().enumerate() {
        let mut samples = Vec::new();
        cell.quadrature(1, &mut samples);
        field.shape_at(&samples[0].point, true, &mut a).unwrap();
        field.shape_in(k, &samples[0].point, true, &mut b).unwrap();
        for (n, v) in a.nodes.iter().zip(&a.values) {
            let reverse = b
                .nodes
                .iter()
                .position(|m| m == n)
                .map_or(0.0, |index| b.values[index]);
            assert_abs_diff_eq!(*v, reverse, epsilon = 1e-10);
        }
    }
}

#[test]
fn outside_is_an_error_but_round_off_is_not() {
    let field = NaturalField::new(
        block([3, 3, 3], 1.0, 0.2, 1, |_, _, _| true),
        Interpolant::Laplace,
    );
    let mut row = ShapeRow::default();
    for (distance, good) in [(1e-14, true), (1e-11, true), (1e-6, false), (0.5, false)] {
        let x = Point3::new(3.0 + distance, 1.3, 1.7);
        let shape = field.shape_at(&x, true, &mut row);
        assert_eq!(shape.is_ok(), good, "{distance:e}");
        if good {
            let interpolated: f64 = row
                .nodes
                .iter()
                .zip(&row.values)
                .map(|(&k, v)| field.nodes()[k].x * v)
                .sum();
            assert_abs_diff_eq!(interpolated, x.x, epsilon = 1e-13);
        } else {
            assert!(matches!(shape, Err(Error::OutsideDomain { .. })));
        }
    }
    assert!(
        field
            .shape_at(&Point3::new(f64::NAN, 0.0, 0.0), false, &mut row)
            .is_err()
    );
}

#[test]
fn many_threads_share_a_field() {
    let field = NaturalField::from_points(&random(300, 5), Interpolant::Sibson).unwrap();
    let points = probes(&field);
    let value = |x: &Point3<f64>| {
        let mut row = ShapeRow::default();
        field.shape_at(x, false, &mut row).unwrap();
        row.values.iter().map(|v| v * v).sum::<f64>().to_bits()
    };
    let serial: Vec<u64> = points.iter().map(value).collect();
    let many: Vec<u64> = points.par_iter().map(value).collect();
    assert!(serial == many);
}

#[test]
fn mediator_cells_fill_the_overlap() {
    let points = random(120, 7);
    let mediator = NaturalField::from_points(&points, Interpolant::Sibson).unwrap();
    assert!(mediator.spacing() > 0.1 && mediator.spacing() < 1.5);
    let volume: f64 = mediator.cells().iter().map(Cell::measure).sum();
    assert!((volume / mediator.domain().volume() - 1.0).abs() < 1e-12);
    let voronoi = mediator.clone().with_voronoi_cells().unwrap();
    assert_eq!(voronoi.cells().len(), points.len());
    let covered: f64 = voronoi.cells().iter().map(Cell::measure).sum();
    assert_relative_eq!(covered, volume, epsilon = 0.0, max_relative = 1e-9);
    let mut row = ShapeRow::default();
    voronoi.shape_in(0, &points[0], false, &mut row).unwrap();
    assert_eq!(
        (row.nodes.as_slice(), row.values.as_slice()),
        (&[0][..], &[1.0][..])
    );
    // Cells of re-entrant bodies are not convex and come in convex parts.
    let block = block([4, 4, 3], 0.3, 0.3, 2, |i, j, _| i < 2 || j < 2);
    let volume = block.volume();
    let voronoi = NaturalField::new(block, Interpolant::Laplace)
        .with_voronoi_cells()
        .unwrap();
    let sum: f64 = voronoi.cells().iter().map(Cell::measure).sum();
    assert_relative_eq!(sum, volume, epsilon = 0.0, max_relative = 1e-9);
}

//! Point location, partition of unity, linear completeness, cells, mediator, chains.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "a test fails by panicking and may compare exact values"
)]

use crate::common::jittered;
use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin_core::geometry::{Cell, Sample};
use arlequin_core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin_core::{Error, Interpolation, Mediator, ShapeRow};
use fem_ref::generate::{self, Cylinder, Rim};
use fem_ref::{ElementKind, FemField, Mesh};
use proptest::prelude::*;

const SOLIDS: [ElementKind; 2] = [ElementKind::Tet4, ElementKind::Hex8];

/// Returns the largest defect of `Σ N = 1`, `Σ N x_i = x`, `Σ ∇N = 0` and `Σ x_i ⊗ ∇N = I`.
fn defect(field: &FemField<f64>, x: &Point3<f64>) -> f64 {
    let mut row = ShapeRow::default();
    field.shape_at(x, true, &mut row).unwrap();
    let mut worst = (row.values.iter().sum::<f64>() - 1.0).abs();
    let mut position = -x.coords;
    let mut slope = -Matrix3::identity();
    let mut flat = Vector3::zeros();
    for ((node, n), g) in row.nodes.iter().zip(&row.values).zip(&row.gradients) {
        position += field.nodes()[*node].coords * *n;
        slope += field.nodes()[*node].coords * g.transpose();
        flat += g;
    }
    for d in [position.amax(), slope.amax(), flat.amax()] {
        worst = f64::max(worst, d);
    }
    worst
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(64))]
    #[test]
    fn shapes_are_complete_on_jittered_meshes(
        seed in 1u64..100_000,
        hex in any::<bool>(),
        amount in 0.0..0.22f64,
        at in prop::array::uniform3(0.3..0.7f64),
    ) {
        let field = FemField::new(jittered(SOLIDS[usize::from(hex)], amount, seed));
        let x = Point3::new(4.0 * at[0], 3.0 * at[1], 3.0 * at[2]);
        prop_assert!(defect(&field, &x) < 1e-12, "{:e}", defect(&field, &x));
    }

    #[test]
    fn integration_points_of_cells_lie_inside_and_fill_the_mesh(seed in 1u64..100_000, hex in any::<bool>()) {
        let field = FemField::new(jittered(SOLIDS[usize::from(hex)], 0.2, seed));
        let mut samples: Vec<Sample<f64>> = Vec::new();
        field.cells().iter().for_each(|c| c.quadrature(5, &mut samples));
        for s in samples.iter().step_by(7) {
            prop_assert!(defect(&field, &s.point) < 1e-11);
        }
        // Flat cells of a warped hexahedron share its corners, not its curved faces; inside the body the
        // differences cancel.
        let volume: f64 = samples.iter().map(|s| s.measure).sum();
        let accuracy = if hex { 0.03 } else { 1e-13 };
        prop_assert!((volume / field.mesh().volume() - 1.0).abs() < accuracy);
    }
}

#[test]
fn every_node_is_found_at_itself() {
    for kind in SOLIDS {
        let field = FemField::new(jittered(kind, 0.2, 9));
        let mut row = ShapeRow::default();
        for (i, x) in field.nodes().to_vec().iter().enumerate() {
            field.shape_at(x, false, &mut row).unwrap();
            assert_eq!(row.nodes, [i], "{kind:?}");
            assert_abs_diff_eq!(row.values[0], 1.0, epsilon = 1e-12);
        }
    }
}

#[test]
fn a_point_of_a_common_face_belongs_to_the_lowest_element() {
    let low = Point3::origin();
    for kind in SOLIDS {
        let mesh = generate::block(kind, low, Point3::new(2.0, 1.0, 1.0), [2, 1, 1]).unwrap();
        let field = FemField::new(mesh);
        let mut row = ShapeRow::default();
        for shift in [-5e-10, 0.0, 5e-10] {
            field
                .shape_at(&Point3::new(1.0 + shift, 0.3, 0.2), true, &mut row)
                .unwrap();
            let nodes = row.nodes.iter().map(|n| *n as u32);
            let first = (0..field.mesh().element_count())
                .find(|e| nodes.clone().all(|n| field.mesh().element(*e).contains(&n)))
                .unwrap();
            assert!(first < field.mesh().element_count() / 2, "{kind:?} {shift}");
        }
    }
}

#[test]
fn the_hull_is_tolerant_and_the_outside_an_error() {
    for kind in SOLIDS {
        let corner = Point3::new(1e-3, 1e-3, 1e-3);
        let field = FemField::new(generate::block(kind, Point3::origin(), corner, [2, 2, 2]).unwrap());
        let mut row = ShapeRow::default();
        let point = |x: f64| Point3::new(x, 0.4e-3, 0.2e-3);
        assert!(field.shape_at(&point(1e-3 + 2e-13), false, &mut row).is_ok());
        let e = field.shape_at(&point(1e-3 + 2e-12), false, &mut row).unwrap_err();
        assert!(matches!(e, Error::OutsideDomain { .. }));
        assert_eq!(
            field
                .shape_at(&point(2e-3), false, &mut row)
                .unwrap_err()
                .to_string(),
            "point (2.000000e-3, 4.000000e-4, 2.000000e-4) m is outside the finite-element field; trim the mediator \
             to the overlap or extend the model"
        );
    }
}

#[test]
fn cells_are_segments_tetrahedra_and_planar_hexahedra() {
    let shape = Cylinder {
        ends: [0.0, 4e-3],
        radius: 1e-3,
        core: 4,
        rings: 2,
        layers: 4,
        rim: Rim::Inscribed,
    };
    for kind in SOLIDS {
        let mesh = generate::cylinder(kind, &shape).unwrap();
        let (volume, count) = (mesh.volume(), mesh.element_count());
        let field = FemField::new(mesh);
        let cells = field.cells();
        assert_eq!(cells.len(), count);
        let sum: f64 = cells.iter().map(Cell::measure).sum();
        assert_relative_eq!(sum, volume, epsilon = 0.0, max_relative = 1e-12);
        assert!(
            field
                .nodes()
                .iter()
                .all(|p| p.yz().coords.norm() < 1e-3 * (1.0 + 1e-12))
        );
    }
    let bar = FemField::new(generate::bar(0.0, 2.0, 4, 0.5).unwrap());
    let measure: f64 = bar.cells().iter().map(Cell::measure).sum();
    assert!((measure - 1.0).abs() < 1e-15 && bar.degree() == 1);
}

#[test]
fn a_chain_in_any_order_is_a_field() {
    let x: [f64; 5] = [3.0, 0.0, 1.0, 4.5, 2.0];
    let chain: Vec<_> = x.iter().map(|x| Point3::new(*x, 0.0, 0.0)).collect();
    let field: FemField<f64> = FemField::on_line(chain.clone(), 2.0).unwrap();
    assert_eq!(field.nodes(), chain);
    let mut row = ShapeRow::default();
    field
        .shape_at(&Point3::new(3.6, 0.0, 0.0), true, &mut row)
        .unwrap();
    let mut entries: Vec<(usize, f64)> = row
        .nodes
        .iter()
        .copied()
        .zip(row.values.iter().copied())
        .collect();
    entries.sort_by_key(|f| f.0);
    assert_eq!(entries[0].0, 0);
    assert_eq!(entries[1].0, 3);
    assert!((entries[0].1 - 0.6).abs() < 1e-15 && (entries[1].1 - 0.4).abs() < 1e-15);
    assert!(
        field
            .shape_at(&Point3::new(3.6, 1e-3, 0.0), true, &mut row)
            .is_err()
    );
    assert!(FemField::on_line(chain[..1].to_vec(), 2.0).is_err());
    assert!(FemField::on_line(vec![chain[0], chain[0]], 2.0).is_err());
}

#[test]
fn a_mediator_has_a_spacing() {
    let low = Point3::origin();
    let mesh = generate::block(ElementKind::Hex8, low, Point3::new(2.0f64, 2.0, 2.0), [4, 4, 4]).unwrap();
    let mediator = FemField::new(mesh);
    assert_abs_diff_eq!(mediator.spacing(), 0.5, epsilon = 1e-14);
    assert_eq!((mediator.cells().len(), mediator.degree()), (64, 3));
}

#[test]
fn single_precision_fields_work() {
    let corner = Point3::new(1e-2f32, 1e-3, 1e-3);
    for kind in SOLIDS {
        let mesh: Mesh<f32> = generate::block(kind, Point3::origin(), corner, [20, 2, 2]).unwrap();
        let field = FemField::new(mesh);
        let mut row = ShapeRow::default();
        for k in 0..=50 {
            let t = k as f32 / 50.0;
            let x = Point3::new(t * 1e-2, (1.0 - t) * 1e-3, t * t * 1e-3);
            field.shape_at(&x, false, &mut row).unwrap();
            let sum: f32 = row.values.iter().sum();
            assert_abs_diff_eq!(sum, 1.0, epsilon = 1e-5);
        }
    }
}

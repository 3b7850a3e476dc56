//! Stresses at the nodes: exact for constant strain, without weights, of second order otherwise.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use crate::common::{jittered, silica};
use arlequin_core::geometry::Cell;
use arlequin_core::nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use arlequin_core::{Model, NodallyWeighted, Recovered, SymmetricTensor, Uniform, Weight};
use fem_ref::{Elastic, ElementKind, FemModel, generate};

fn recovered(model: &dyn Model<f64>, q: &[f64], nodes: &[usize]) -> Vec<Recovered<f64>> {
    let mut out = Vec::new();
    let recovery = model.views().recovery.expect("a solid knows its stresses");
    recovery.recover(q, nodes, &mut out).unwrap();
    out
}

#[derive(Debug)]
struct Falling;
impl Weight<f64> for Falling {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.9 * x.x.clamp(0.0, 1.0)
    }
}

/// Constant stress is recovered at all nodes of distorted meshes, rotated, far from the origin, tiny and
/// huge, with weights.
#[test]
fn constant_stress_is_recovered_to_round_off_on_distorted_bodies_of_any_place_and_size() {
    let gradient = Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6) * 1e-3;
    let material = silica();
    let strain = SymmetricTensor::from_matrix(&gradient);
    let stress = material.stress(&strain);
    let turn = Rotation3::from_euler_angles(0.4, 1.1, -0.7);
    for kind in [ElementKind::Tet4, ElementKind::Hex8] {
        for (size, shift) in [(1.0, 0.0), (1e-6, 0.0), (1e4, 0.0), (1.0, 50.0)] {
            let mesh = jittered(kind, 0.2, 5);
            let mesh = mesh
                .mapped(|x| Point3::from(turn * x.coords * size + Vector3::repeat(shift * size)))
                .unwrap();
            let mut model = FemModel::new("body", mesh, material).unwrap();
            model.set_internal_weight(&Falling).unwrap();
            let nodes: Vec<usize> = (0..model.nodes().len()).collect();
            let q: Vec<f64> = model
                .nodes()
                .iter()
                .flat_map(|x| (gradient * x.coords).data.0[0])
                .collect();
            let all_stresses = recovered(&model, &q, &nodes);
            // Far from the origin the last digits of displacements appear as strains.
            let limit = 1e-10 * (1.0 + shift);
            for r in &all_stresses {
                let e = r.strain.unwrap();
                let error = (0..6).fold(0.0_f64, |m, c| m.max((e.0[c] - strain.0[c]).abs()));
                assert!(error < limit * 1e-3, "{kind:?}, {size:e}, {shift}: {error:e}");
                let error = (0..6).fold(0.0_f64, |m, c| m.max((r.stress.0[c] - stress.0[c]).abs()));
                assert!(
                    error < limit * stress.von_mises(),
                    "{kind:?}, {size:e}, {shift}: {error:e}"
                );
            }
            // A selection of nodes has the same values, and so has the model weighted at its nodes.
            let selected = recovered(&model, &q, &nodes[3..5]);
            assert_eq!(selected, all_stresses[3..5]);
            let wrapped = NodallyWeighted::new(Box::new(model));
            assert_eq!(recovered(&wrapped, &q, &nodes), all_stresses);
        }
    }
}

#[test]
fn stresses_converge_with_second_order_but_at_the_surface_of_tetrahedra() {
    let field = |x: &Point3<f64>| Vector3::new((2.0 * x.x + x.y).sin(), (x.y - x.z).cos(), (x.x * x.z).sin());
    let strain = |x: &Point3<f64>| {
        let (a, b, c) = ((2.0 * x.x + x.y).cos(), -(x.y - x.z).sin(), (x.x * x.z).cos());
        SymmetricTensor::from_matrix(&Matrix3::new(
            2.0 * a,
            a,
            0.0, //
            0.0,
            b,
            -b, //
            x.z * c,
            0.0,
            x.x * c,
        ))
    };
    // Means of tetrahedra have errors of first order that cancel around inner nodes, but not in the slopes of
    // a patch.
    for (kind, surface) in [(ElementKind::Tet4, 0.9), (ElementKind::Hex8, 1.6)] {
        let error = |n: usize| {
            let (low, high) = (Point3::origin(), Point3::new(1.0, 1.0, 1.0));
            let mesh = generate::block(kind, low, high, [n; 3]).unwrap();
            let model = FemModel::new("cube", mesh, Elastic::new(1.0, 0.3, 1.0).unwrap()).unwrap();
            let q: Vec<f64> = model.nodes().iter().flat_map(|x| field(x).data.0[0]).collect();
            let nodes: Vec<usize> = (0..model.nodes().len()).collect();
            let stresses = recovered(&model, &q, &nodes);
            let mut largest = [0.0_f64; 2];
            for (r, x) in stresses.iter().zip(model.nodes()) {
                let (e, exact) = (r.strain.unwrap(), strain(x));
                let off = (0..6).fold(0.0_f64, |m, c| m.max((e.0[c] - exact.0[c]).abs()));
                let outer = x.iter().any(|c| *c < 1e-9 || *c > 1.0 - 1e-9);
                let slot = &mut largest[usize::from(outer)];
                *slot = slot.max(off);
            }
            largest
        };
        let (coarse, fine) = (error(8), error(16));
        let order = [0, 1].map(|k: usize| (coarse[k] / fine[k]).log2());
        println!("{kind:?}: {fine:?}, orders {order:?}");
        assert!(
            order[0] > 1.8,
            "{kind:?}, inside: {coarse:?}, {fine:?}, order {order:?}"
        );
        assert!(
            order[1] > surface,
            "{kind:?}, surface: {coarse:?}, {fine:?}, order {order:?}"
        );
    }
}

#[test]
fn bars_and_plates_one_element_thick_are_recovered_too() {
    let bar = generate::bar(1.0, 3.0, 10, 1e-4).unwrap();
    let model = FemModel::new("bar", bar, Elastic::new(210e9, 0.0, 7800.0).unwrap()).unwrap();
    let q: Vec<f64> = model.nodes().iter().map(|x| 1e-3 * x.x).collect();
    for r in recovered(&model, &q, &[0, 4, 10]) {
        assert!((r.stress.0[0] / 210e6 - 1.0).abs() < 1e-10 && r.stress.0[1..].iter().all(|s| *s == 0.0));
    }
    let flat = generate::block(
        ElementKind::Hex8,
        Point3::origin(),
        Point3::new(4.0, 4.0, 0.1),
        [8, 8, 1],
    );
    let model = FemModel::new("plate", flat.unwrap(), Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap();
    let q: Vec<f64> = model
        .nodes()
        .iter()
        .flat_map(|x| [0.5 * x.x * x.x, 0.0, 0.0])
        .collect();
    let nodes: Vec<usize> = (0..model.nodes().len()).collect();
    for (r, x) in recovered(&model, &q, &nodes).iter().zip(model.nodes()) {
        assert!((r.stress.0[0] - x.x).abs() < 1e-10, "{x}: {:?}", r.stress);
    }
    assert!(
        model
            .views()
            .recovery
            .unwrap()
            .recover(&q, &[9999], &mut Vec::new())
            .is_err()
    );
    assert!(
        model
            .views()
            .recovery
            .unwrap()
            .recover(&q[1..], &[0], &mut Vec::new())
            .is_err()
    );
}

/// A surface node takes its stress from the elements around the nearest inner node, not from those around all
/// inner nodes that share an element with it.
#[test]
fn a_node_of_the_surface_takes_the_patch_of_the_nearest_inner_node() {
    let mesh = generate::block(
        ElementKind::Hex8,
        Point3::origin(),
        Point3::new(6.0, 6.0, 6.0),
        [6; 3],
    )
    .unwrap();
    let model = FemModel::new("cube", mesh, Elastic::new(1.0, 0.3, 1.0).unwrap()).unwrap();
    let node = |x: f64, y: f64, z: f64| {
        let point = Point3::new(x, y, z);
        model
            .nodes()
            .iter()
            .position(|p| (p - point).norm() < 1e-9)
            .unwrap()
    };
    let mut q: Vec<f64> = model
        .nodes()
        .iter()
        .flat_map(|x| [x.x * x.y, x.z, 0.5 * x.x])
        .collect();
    let face = [node(3.0, 3.0, 0.0)];
    let before = recovered(&model, &q, &face);
    // A change around the second nearest inner node only.
    q[3 * node(1.0, 3.0, 1.0)] += 1.0;
    assert_eq!(recovered(&model, &q, &face), before);
    q[3 * node(2.0, 3.0, 1.0)] += 1.0;
    assert_ne!(recovered(&model, &q, &face), before);
}

/// A weight of one up to `x = 2`, where a zone begins.
#[derive(Debug)]
struct Left;

impl Weight<f64> for Left {
    fn value(&self, x: &Point3<f64>) -> f64 {
        f64::from(u8::from(x.x < 2.0))
    }

    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let corners = cell.corners();
        let sum = corners.iter().fold(0.0, |s, x| s + x.x);
        f64::from(u8::from(sum / (corners.len() as f64) < 2.0))
    }
}

/// Elements without weight sleep: their displacements are old, and must not enter stresses beside them.
#[test]
fn stresses_beside_elements_that_sleep_are_those_of_the_others() {
    for kind in [ElementKind::Hex8, ElementKind::Tet4] {
        let block = generate::block(kind, Point3::origin(), Point3::new(4.0, 3.0, 3.0), [4, 3, 3]).unwrap();
        let nodes = block.nodes().to_vec();
        let material = Elastic::new(2.0, 0.25, 1.0).unwrap();
        let mut model = FemModel::new("body", block, material).unwrap();
        // In flight: where elements sleep, nodes stay behind.
        let q: Vec<f64> = nodes
            .iter()
            .flat_map(|x| {
                if x.x < 2.5 {
                    [100.0 + 0.01 * x.x, 7.0, 0.0]
                } else {
                    [0.0; 3]
                }
            })
            .collect();
        let awake: Vec<usize> = (0..nodes.len()).filter(|k| nodes[*k].x < 2.5).collect();
        let everywhere: Vec<f64> = nodes
            .iter()
            .flat_map(|x| [100.0 + 0.01 * x.x, 7.0, 0.0])
            .collect();
        let expected = recovered(&model, &everywhere, &awake);
        model.set_internal_weight(&Left).unwrap();
        for (a, b) in recovered(&model, &q, &awake).iter().zip(&expected) {
            for (x, y) in a.stress.0.iter().zip(b.stress.0) {
                assert!((x - y).abs() < 1e-12, "{kind:?}: {x} and {y} Pa");
            }
        }
        // All of the body wakes again.
        model.set_internal_weight(&Uniform(1.0)).unwrap();
        let numbers: Vec<usize> = (0..nodes.len()).collect();
        let again = recovered(&model, &everywhere, &numbers);
        assert!(
            again
                .iter()
                .all(|r| (r.stress.0[0] - expected[0].stress.0[0]).abs() < 1e-12)
        );
    }
}

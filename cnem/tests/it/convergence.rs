//! Manufactured solution, spurious modes, beams.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use crate::common::mms;
use arlequin_core::{LinearModel, Model, Real, Uniform};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::Interpolant;
use cnem::{CnemModel, Options, Stabilisation, generate};
use nalgebra::Point3;

fn cube(steps: usize, jitter: f64) -> Domain {
    let corner = Point3::new(1.0, 1.0, 1.0);
    let nodes = generate::block(Point3::origin(), corner, [steps; 3], jitter, 3).unwrap();
    Domain::new(&nodes, &Surface::convex_hull()).unwrap()
}

#[test]
fn manufactured_solution_converges() {
    for (kind, jitter) in [
        (Interpolant::Laplace, 0.0),
        (Interpolant::Laplace, 0.2),
        (Interpolant::Sibson, 0.2),
    ] {
        let options = Options {
            kind,
            ..Options::default()
        };
        let (coarse, fine) = (mms(cube(6, jitter), options), mms(cube(10, jitter), options));
        let order = [0, 1].map(|k| (coarse[k] / fine[k]).ln() / (10.0f64 / 6.0).ln());
        println!("{kind:?} jitter {jitter}: {fine:.4?} orders {order:.2?}");
        assert!(order[0] >= 1.8 && order[1] >= 0.95, "{kind:?} {jitter} {order:?}");
        assert!(fine[0] < 0.012, "{fine:?}");
    }
}

/// Returns the numbers of saw-tooth modes among the first `count` elastic modes of a free cube, by ascending
/// frequency: modes of which the tetrahedra see more than five times the energy of the cells.
fn saw_teeth(domain: &Domain, stabilisation: Stabilisation, count: usize) -> Vec<usize> {
    let make = |stabilisation| {
        let options = Options {
            stabilisation,
            ..Options::default()
        };
        CnemModel::new("cube", domain.clone(), crate::common::silica(), options).unwrap()
    };
    let (model, bare, full) = (
        make(stabilisation),
        make(Stabilisation::None),
        make(Stabilisation::SubCells(1.0)),
    );
    let n = model.layout().dofs();
    let mut mass = vec![0.0; n];
    model.lumped_inertia(&Uniform(1.0), &mut mass).unwrap();
    let mut a = vec![0.0; n * n];
    for (v, (i, j)) in model.stiffness().iter() {
        a[i + n * j] = v / (mass[i] * mass[j]).sqrt();
    }
    let eigen = f64::symmetric_eigen(n, &a).unwrap();
    let saw = |k: &usize| {
        let q: Vec<f64> = (0..n)
            .map(|i| eigen.vectors[i + n * (k + 6)] / mass[i].sqrt())
            .collect();
        let plain = bare.internal_energy(&q);
        full.internal_energy(&q) - plain > 5.0 * plain
    };
    (0..count).filter(saw).collect()
}

#[test]
fn stabilisation_clears_spurious_modes() {
    for jitter in [0.0, 0.2] {
        let domain = cube(6, jitter);
        for amount in [0.0, 0.05, 0.1, 0.2] {
            let stabilisation = if amount > 0.0 {
                Stabilisation::SubCells(amount)
            } else {
                Stabilisation::None
            };
            let modes = saw_teeth(&domain, stabilisation, 40);
            println!(
                "jitter {jitter} a {amount}: {} of the 40 lowest modes, from number {:?}",
                modes.len(),
                modes.first()
            );
            let good = match amount {
                a if a >= 0.1 => modes.first().is_none_or(|&k| k >= 15),
                a if a > 0.0 => modes.len() < 30,
                _ => modes.len() >= 35,
            };
            assert!(good, "{amount} {modes:?}");
        }
    }
}

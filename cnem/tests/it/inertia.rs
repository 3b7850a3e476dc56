//! Masses of cells, distributed to the nodes around their centroids.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use crate::common::beam::{THICK, cylinder, percent, study};
use crate::common::{block, mms, silica, steps_under_falling_weights};
use approx::assert_relative_eq;
use arlequin_core::{Model, NodallyWeighted, Uniform, Weight};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::{CnemModel, Inertia, Options, generate};
use nalgebra::{Point3, Vector3};

const CENTROIDS: Options = Options {
    kind: cnem::natural::Interpolant::Laplace,
    stabilisation: cnem::Stabilisation::SubCells(0.1),
    inertia: Inertia::Centroids,
};

fn masses(domain: &Domain, options: Options, weight: &dyn Weight<f64>) -> Vec<f64> {
    masses_of(&model(domain, options), weight)
}

fn model(domain: &Domain, options: Options) -> CnemModel {
    CnemModel::new("body", domain.clone(), silica(), options).unwrap()
}

fn masses_of(model: &dyn Model<f64>, weight: &dyn Weight<f64>) -> Vec<f64> {
    let mut out = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(weight, &mut out).unwrap();
    assert!(
        out.chunks(3)
            .all(|m| m.iter().all(|c| c.to_bits() == m[0].to_bits()))
    );
    out.into_iter().step_by(3).collect()
}

/// Returns `(∫ x ρ dV, ∫ (y² + z²) ρ dV)` of the body, exactly.
fn moments(domain: &Domain) -> (Vector3<f64>, f64) {
    let (mut first, mut polar) = (Vector3::zeros(), 0.0);
    for t in domain.elements() {
        let p = t.map(|v| domain.nodes()[v]);
        let m = 2200.0 * cnem::delaunay::volume([&p[0], &p[1], &p[2], &p[3]]);
        let sum: Vector3<f64> = p.iter().map(|p| p.coords).sum();
        first += sum * (m / 4.0);
        let squares = p.iter().map(|p| p.y * p.y + p.z * p.z).sum::<f64>();
        polar += m / 20.0 * (squares + sum.yz().norm_squared());
    }
    (first, polar)
}

/// Weight that rises from 0.25 to 0.75.
struct Ramp;
impl Weight<f64> for Ramp {
    fn value(&self, x: &Point3<f64>) -> f64 {
        0.25 + 0.5 * x.x
    }
}

/// Complement of [`Ramp`].
struct Rest;
impl Weight<f64> for Rest {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - Ramp.value(x)
    }
}

/// On convex bodies centroid masses have the body's total and first moments to round-off; masses at the
/// cells' own nodes have only the total.
#[test]
fn centroid_masses_keep_the_total_and_the_first_moments() {
    for (steps, jitter) in [(4, 0.0), (4, 0.3), (6, 0.3)] {
        let corner = Point3::new(1.0, 1.0, 1.0);
        let nodes = generate::block(Point3::origin(), corner, [steps; 3], jitter, 3).unwrap();
        let domain = Domain::new(&nodes, &Surface::convex_hull()).unwrap();
        let (first, _) = moments(&domain);
        let [at_nodes, spread] = [Options::default(), CENTROIDS].map(|options| {
            let m = masses(&domain, options, &Uniform(1.0));
            assert_relative_eq!(m.iter().sum::<f64>(), 2200.0, epsilon = 0.0, max_relative = 1e-13);
            assert!(m.iter().all(|m| *m > 0.0));
            let moment: Vector3<f64> = m.iter().zip(domain.nodes()).map(|(m, x)| x.coords * *m).sum();
            (moment - first).norm() / first.norm()
        });
        println!("{steps} steps, jitter {jitter}: first moments off by {at_nodes:.1e}, {spread:.1e}");
        assert!(spread < 1e-13);
        assert!(jitter == 0.0 || at_nodes > 1e-5);
    }
}

/// Means of weights multiply the masses before these are distributed: weights that add up to one give masses
/// that add up.
#[test]
fn weighted_centroid_masses_add_up() {
    for domain in [
        block([4, 4, 4], 0.25, 0.3, 1, |_, _, _| true),
        block([4, 4, 3], 0.25, 0.3, 2, |i, j, _| i < 2 || j < 2),
    ] {
        let energy: Box<dyn Model<f64>> = Box::new(model(&domain, CENTROIDS));
        let nodal: Box<dyn Model<f64>> = Box::new(NodallyWeighted::new(Box::new(model(&domain, CENTROIDS))));
        for (model, is_nodal) in [(energy, false), (nodal, true)] {
            let whole = masses_of(&*model, &Uniform(1.0));
            let [a, b] = [&Ramp as &dyn Weight<f64>, &Rest].map(|w| masses_of(&*model, w));
            for ((a, b), m) in a.iter().zip(&b).zip(&whole) {
                assert!(*a > 0.0 && *b > 0.0 && ((a + b) / m - 1.0).abs() < 1e-12);
            }
            // With energy weighting the mass under a linear weight is that of the body, whose first moment is
            // exact.
            if !is_nodal {
                let expected = 0.25 * 2200.0 * domain.volume() + 0.5 * moments(&domain).0.x;
                assert!((a.iter().sum::<f64>() / expected - 1.0).abs() < 1e-12);
            }
        }
    }
}

/// Centroid masses give coarse cylinders a better polar moment and torsional frequency than masses at the
/// cells' own nodes, and nearly the same axial and bending frequencies and critical step.
#[test]
fn centroid_masses_turn_coarse_cylinders_at_the_right_frequency() {
    for (rings, layers, jitter, polar_limit, torsion_limit) in [
        (2, 11, 0.0, 7.0, 1.0),
        (3, 17, 0.0, 1.0, 0.5),
        (3, 17, 0.2, 4.0, 2.5),
    ] {
        let shape = cylinder(false, rings, layers, jitter);
        let domain = shape.domain().unwrap();
        let (_, exact) = moments(&domain);
        let [at_nodes, spread] = [Options::default(), CENTROIDS].map(|options| {
            let m = masses(&domain, options, &Uniform(1.0));
            let polar: f64 = m
                .iter()
                .zip(domain.nodes())
                .map(|(m, x)| m * x.coords.yz().norm_squared())
                .sum();
            let b = study(options, &shape);
            let f = [0, 1, 2].map(|k| percent(b.frequencies[k], THICK.0[k]));
            println!(
                "{} nodes, jitter {jitter}, {:?}: polar {:+.2} %, f {f:+.2?} %, step {:.3e} s",
                b.nodes,
                options.inertia,
                percent(polar, exact),
                b.step
            );
            (percent(polar, exact), f, b.step)
        });
        assert!(spread.0.abs() < polar_limit && at_nodes.0 > 7.0);
        assert!(spread.1[2].abs() < torsion_limit && at_nodes.1[2] < -2.8);
        // Axial and bending frequencies change by less than 0.7 %.
        assert!((0..2).all(|k| (spread.1[k] - at_nodes.1[k]).abs() < 0.7));
        assert!(spread.2 > 0.93 * at_nodes.2 && spread.2 <= at_nodes.2);
    }
}

/// Centroid masses, with which loads are distributed, keep the order of static solutions. A wholly held
/// surface is the worst case: mass that moves away from it becomes load.
#[test]
fn centroid_masses_keep_the_order_of_static_solutions() {
    let cube = |steps: usize, jitter| {
        let corner = Point3::new(1.0, 1.0, 1.0);
        let nodes = generate::block(Point3::origin(), corner, [steps; 3], jitter, 3).unwrap();
        Domain::new(&nodes, &Surface::convex_hull()).unwrap()
    };
    for jitter in [0.0, 0.2] {
        let [coarse, fine] = [6, 10].map(|n| mms(cube(n, jitter), CENTROIDS));
        let order = [0, 1].map(|k| (coarse[k] / fine[k]).ln() / (10.0f64 / 6.0).ln());
        println!("jitter {jitter}: {fine:.4?} orders {order:.2?}");
        assert!(order[0] >= 1.9 && order[1] >= 1.1, "{order:?}");
        assert!(fine[0] < 0.02, "{fine:?}");
    }
}

/// Under weights that fall to 0.05 and 0.005 over four spacings, centroid masses keep 0.9 and 0.5 of the
/// critical step: a light node shares the mass of heavier neighbours.
#[test]
fn small_weights_with_centroid_masses() {
    let ratios = steps_under_falling_weights(CENTROIDS);
    println!("critical step with smallest weight 0.05, 0.005, 0.0005: {ratios:?}");
    assert!(ratios[0] > 0.9 && ratios[1] > 0.5);
}

//! Constant strain on irregular nodes and non-convex bodies, rigid motions, energy, weights, threads.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, may compare exact values and shows what it measured"
)]

use crate::common::{block, largest, noise, silica, solve, steps_under_falling_weights};
use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin_core::geometry::Cell;
use arlequin_core::{LinearModel, Model, NodallyWeighted, Uniform, Weight, conformance};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::Interpolant;
use cnem::{CnemModel, Options, Stabilisation, generate};
use nalgebra::{Matrix3, Point3, Vector3, center};

fn gradient() -> Matrix3<f64> {
    Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6)
}

fn linear(gradient: &Matrix3<f64>, nodes: &[Point3<f64>]) -> Vec<f64> {
    nodes
        .iter()
        .flat_map(|x| (gradient * x.coords + Vector3::new(0.3, -0.2, 0.1)).data.0[0])
        .collect()
}

fn random(n: usize, seed: u64) -> Domain {
    let mut next = noise(seed);
    let points: Vec<_> = (0..n).map(|_| Point3::new(next(), next(), next())).collect();
    Domain::new(&points, &Surface::convex_hull()).unwrap()
}

fn bodies() -> Vec<(&'static str, Domain)> {
    vec![
        ("jittered cube", block([4, 4, 4], 0.25, 0.3, 1, |_, _, _| true)),
        ("grid", block([4, 3, 3], 0.25, 0.0, 1, |_, _, _| true)),
        (
            "L-block",
            block([4, 4, 3], 0.25, 0.3, 2, |i, j, _| i < 2 || j < 2),
        ),
        (
            "block with a hole",
            block([5, 5, 5], 0.2, 0.3, 3, |i, j, k| i != 2 || j != 2 || k != 2),
        ),
        ("random points", random(150, 4)),
        ("coarse crack", coarse_crack()),
    ]
}

/// Returns a body whose crack is coarse compared with the nodes at it, so that parts of cells were
/// reassigned.
fn coarse_crack() -> Domain {
    let mut points: Vec<_> = (0..64)
        .map(|i| Point3::new(f64::from(i % 4), f64::from(i / 4 % 4), f64::from(i / 16)) / 3.0)
        .collect();
    let first = points.len();
    points.extend([[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8]].map(|[x, y]| Point3::new(x, y, 0.45)));
    points.push(Point3::new(0.45, 0.4, 0.46));
    points.push(Point3::new(0.55, 0.6, 0.44));
    let crack = vec![[first, first + 1, first + 2], [first, first + 2, first + 3]];
    let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).unwrap();
    assert!(domain.voronoi().unwrap().gaps().tetrahedra > 0);
    domain
}

fn all_options() -> Vec<Options> {
    let mut out = Vec::new();
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        for stabilisation in [Stabilisation::None, Stabilisation::default()] {
            out.push(Options {
                kind,
                stabilisation,
                ..Options::default()
            });
        }
    }
    out
}

#[test]
fn patch_test() {
    for (name, domain) in bodies() {
        for options in all_options() {
            let mut border = vec![false; domain.nodes().len()];
            domain
                .constrained_faces()
                .for_each(|f| f.0.iter().for_each(|&v| border[v] = true));
            // Both lips of a crack.
            domain.copies().for_each(|c| border[c.node] = true);
            domain.copies().for_each(|c| border[c.original] = true);
            let fixed: Vec<bool> = border.iter().flat_map(|b| [*b; 3]).collect();
            assert!(border.contains(&false));
            let model = CnemModel::new("patch", domain.clone(), silica(), options).unwrap();
            let exact = linear(&gradient(), model.nodes());
            let mut u = exact.clone();
            u.iter_mut()
                .zip(&fixed)
                .for_each(|(u, f)| *u *= f64::from(u8::from(*f)));
            solve(&model.stiffness(), &fixed, &vec![0.0; u.len()], &mut u);
            let error: Vec<f64> = u.iter().zip(&exact).map(|(a, b)| a - b).collect();
            assert!(
                largest(&error) <= 1e-11 * largest(&exact),
                "{name} {options:?}: {:e}",
                largest(&error)
            );
        }
    }
}

/// The tractions of a constant stress on the surface facets balance the internal forces at every node.
#[test]
fn tractions_balance_a_constant_stress() {
    let [lambda, mu] = silica().lame();
    let g = gradient();
    let stress = Matrix3::identity() * (lambda * g.trace()) + (g + g.transpose()) * mu;
    for (name, domain) in bodies() {
        for options in all_options() {
            let mut model = CnemModel::new("free", domain.clone(), silica(), options).unwrap();
            let u = linear(&g, model.nodes());
            let mut f = vec![0.0; u.len()];
            model.add_internal_forces(&u, &mut f).unwrap();
            let scale = largest(&f);
            for facet in model.surface(|_| true).unwrap() {
                let t = stress * facet.normal;
                for (node, share) in facet.nodes.iter().zip(&facet.shares) {
                    (0..3).for_each(|a| f[3 * node + a] += t[a] * share);
                }
            }
            assert!(
                largest(&f) <= 1e-11 * scale,
                "{name} {options:?}: {:e}",
                largest(&f) / scale
            );
        }
    }
}

/// Weight with an arbitrary value per cell, since the true mean is costly.
struct Wave;
impl Weight<f64> for Wave {
    fn value(&self, x: &Point3<f64>) -> f64 {
        0.5 + 0.4 * (3.0 * x.x + 2.0 * x.y).sin()
    }
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        self.value(&center(&low, &high))
    }
}

#[test]
fn conforms_to_the_core() {
    for (name, domain) in bodies() {
        for options in all_options() {
            let volume = domain.volume();
            let mut model = CnemModel::new("body", domain.clone(), silica(), options).unwrap();
            assert!(conformance::mass(&model, 2200.0 * volume).unwrap() < 1e-12);
            model.set_internal_weight(&Wave).unwrap();
            let rigid = conformance::rigid_forces(&mut model, 1e-3).unwrap();
            assert!(rigid < 1e-11, "{name} {options:?}: {rigid:e}");
            assert!(
                conformance::forces_derive_from_energy(&mut model, 1e-3).unwrap() < 1e-8,
                "{name}"
            );
            assert!(
                conformance::symmetric_forces(&mut model, 1e-3).unwrap() < 1e-13,
                "{name}"
            );
            let k = model.stiffness();
            assert!(k.iter().all(|(v, (i, j))| k.get(j, i) == Some(v)));
        }
    }
}

#[test]
fn constant_strain_has_the_exact_energy() {
    let [lambda, mu] = silica().lame();
    let g = gradient();
    let strain = (g + g.transpose()) * 0.5;
    let density = 0.5 * lambda * g.trace().powi(2) + mu * strain.norm_squared();
    for (_, domain) in bodies() {
        let expected = density * domain.volume();
        let model = CnemModel::new("body", domain, silica(), Options::default()).unwrap();
        let energy = model.internal_energy(&linear(&g, model.nodes()));
        assert_relative_eq!(energy, expected, epsilon = 0.0, max_relative = 1e-11);
    }
}

/// Weight of a quarter for `x < 0.5` and one beyond; its mean is that of the clipped cell.
struct Ramp;
impl Weight<f64> for Ramp {
    fn value(&self, x: &Point3<f64>) -> f64 {
        0.25 + 0.5 * x.x
    }
}

#[test]
fn weights_are_means_over_the_voronoi_cells() {
    for (name, domain) in bodies() {
        let model = CnemModel::new("body", domain, silica(), Options::default()).unwrap();
        let n = model.layout().dofs();
        let mut mass = vec![0.0; n];
        model.lumped_inertia(&Ramp, &mut mass).unwrap();
        // The mass under a linear weight is the volume times the weight at its centroid.
        let nodes = model.nodes();
        let (mut expected, mut total) = (0.0, 0.0);
        for t in model.domain().elements() {
            let p = t.map(|v| nodes[v]);
            let v = cnem::delaunay::volume([&p[0], &p[1], &p[2], &p[3]]);
            expected += 2200.0 * v * (0.25 + 0.125 * p.iter().map(|p| p.x).sum::<f64>());
            total += v;
        }
        let sum: f64 = mass.iter().step_by(3).sum();
        assert!(
            (sum / expected - 1.0).abs() < 1e-12,
            "{name}: {:e}",
            sum / expected - 1.0
        );
        let middle = nodes.len() / 2;
        let nodal = 2200.0 * model.cells().volumes()[middle] * (0.25 + 0.5 * nodes[middle].x);
        let model = NodallyWeighted::new(Box::new(model));
        model.lumped_inertia(&Ramp, &mut mass).unwrap();
        assert!((mass[3 * middle] / nodal - 1.0).abs() < 1e-14 && total > 0.0);
    }
}

#[test]
fn nodal_weighting_scales_forces() {
    let domain = block([3, 3, 3], 0.3, 0.2, 1, |_, _, _| true);
    let mut model = CnemModel::new("cube", domain, silica(), Options::default()).unwrap();
    let n = model.layout().dofs();
    let mut next = noise(3);
    let u: Vec<f64> = (0..n).map(|_| next()).collect();
    let (mut f, mut g) = (vec![0.0; n], vec![0.0; n]);
    model.add_internal_forces(&u, &mut f).unwrap();
    let mut model = NodallyWeighted::new(Box::new(model));
    model.set_internal_weight(&Ramp).unwrap();
    assert!(model.views().linear.is_none());
    model.add_internal_forces(&u, &mut g).unwrap();
    for i in 0..n {
        let w = Ramp.value(&model.nodes()[i / 3]);
        assert_abs_diff_eq!(g[i], w * f[i], epsilon = 1e-14 * largest(&f));
    }
    model.set_internal_weight(&Uniform(0.5)).unwrap();
    g.fill(0.0);
    model.add_internal_forces(&u, &mut g).unwrap();
    let scale = largest(&f);
    assert!(
        f.iter()
            .zip(&g)
            .all(|(f, g)| (0.5 * f - g).abs() <= 1e-14 * scale)
    );
}

fn forces_with(threads: usize) -> (Vec<u64>, u64) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| {
        let domain = block([10, 10, 8], 0.1, 0.3, 1, |_, _, _| true);
        let mut model = CnemModel::new("block", domain, silica(), Options::default()).unwrap();
        model.set_internal_weight(&Wave).unwrap();
        let mut next = noise(11);
        let u: Vec<f64> = (0..model.layout().dofs()).map(|_| next()).collect();
        let mut f = vec![0.0; u.len()];
        model.add_internal_forces(&u, &mut f).unwrap();
        (
            f.into_iter().map(f64::to_bits).collect(),
            model.internal_energy(&u).to_bits(),
        )
    })
}

#[test]
fn thread_counts_give_the_same_bits() {
    let serial = forces_with(1);
    assert!(serial == forces_with(2));
    assert!(serial == forces_with(3));
}

#[test]
fn wrong_input_is_named() {
    let domain = block([2, 2, 2], 0.5, 0.0, 1, |_, _, _| true);
    let options = Options {
        stabilisation: Stabilisation::SubCells(-0.1),
        ..Options::default()
    };
    let error = CnemModel::new("cube", domain.clone(), silica(), options).err();
    assert!(matches!(
        error,
        Some(cnem::Error::Parameter {
            name: "stabilisation",
            ..
        })
    ));
    let mut model = CnemModel::new("cube", domain, silica(), Options::default()).unwrap();
    assert!(matches!(
        model.select_nodes(|p| p.x > 9.0),
        Err(cnem::Error::EmptySelection { candidates: 27, .. })
    ));
    assert!(matches!(
        model.surface(|_| false),
        Err(cnem::Error::EmptySelection { .. })
    ));
    assert!(model.add_internal_forces(&[0.0; 3], &mut [0.0; 81]).is_err());
    assert!(cnem::Elastic::new(1.0, 0.5, 1.0).is_err());
}

/// Under a weight that falls to 0.05 over four spacings the critical step stays above half of the unweighted
/// one.
#[test]
fn small_weights_shorten_the_step() {
    let ratios = steps_under_falling_weights(Options::default());
    println!("critical step with smallest weight 0.05, 0.005, 0.0005: {ratios:?}");
    assert!(ratios[0] > 0.5);
}

/// Numbering in spatial order changes only the numbers.
#[test]
fn spatial_order_keeps_the_body() {
    let grid = generate::block(Point3::origin(), Point3::new(1.0, 1.0, 1.0), [4, 4, 4], 0.2, 1).unwrap();
    let hull: Vec<[usize; 3]> = Domain::new(&grid, &Surface::convex_hull())
        .unwrap()
        .delaunay()
        .hull()
        .collect();
    let surface = Surface::boundary(hull);
    let order = cnem::spatial_order(&grid);
    let sorted: Vec<_> = order.iter().map(|&k| grid[k]).collect();
    let make = |points: &[Point3<f64>], surface: &Surface| {
        let domain = Domain::new(points, surface).unwrap();
        CnemModel::new("cube", domain, silica(), Options::default()).unwrap()
    };
    let renumbered = surface.renumbered(&order).unwrap();
    let energy = |model: &CnemModel| {
        let u: Vec<f64> = model
            .nodes()
            .iter()
            .flat_map(|p| [p.x * p.y, p.z.sin(), p.x - p.z * p.y])
            .collect();
        model.internal_energy(&u)
    };
    let (a, b) = (
        energy(&make(&grid, &surface)),
        energy(&make(&sorted, &renumbered)),
    );
    assert_relative_eq!(a, b, epsilon = 0.0, max_relative = 1e-12);
    assert!(matches!(
        surface.renumbered(&order[1..]),
        Err(cnem::Error::UnknownNode { .. })
    ));
}

/// A constant stress is recovered at every node of every body to round-off, with any weights.
#[test]
fn constant_stress_is_recovered_to_round_off_at_all_nodes() {
    struct Falling;
    impl Weight<f64> for Falling {
        fn value(&self, x: &Point3<f64>) -> f64 {
            1.0 - 0.8 * x.x.clamp(0.0, 1.0)
        }
    }
    let gradient = gradient() * 1e-3;
    let strain = arlequin_core::SymmetricTensor::from_matrix(&gradient);
    let stress = silica().stress(&strain);
    for (name, domain) in bodies() {
        let mut model = CnemModel::new(name, domain, silica(), Options::default()).unwrap();
        model.set_internal_weight(&Falling).unwrap();
        let q = linear(&gradient, model.nodes());
        let nodes: Vec<usize> = (0..model.nodes().len()).collect();
        let mut recovered = Vec::new();
        let recovery = model.views().recovery.unwrap();
        recovery.recover(&q, &nodes, &mut recovered).unwrap();
        let errors = recovered.iter().flat_map(|r| {
            let pairs = r.stress.0.into_iter().zip(stress.0);
            pairs.map(|(a, b)| (a - b).abs())
        });
        let errors = errors.fold(0.0_f64, f64::max) / stress.von_mises();
        println!("{name}: {errors:e}");
        // Cells at the crack have reassigned parts, and their gradients hold to 1e-8.
        assert!(errors < 1e-10, "{name}: {errors:e}");
        assert!(recovery.recover(&q, &[nodes.len()], &mut recovered).is_err());
    }
}

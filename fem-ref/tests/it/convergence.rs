//! GOAL: observed orders. Manufactured static solution on hexahedra and tetrahedra; axial frequencies of a
//! beam.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and may compare exact values"
)]

use crate::common::{free_part, noise, silica, solve};
use arlequin_core::geometry::Sample;
use arlequin_core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin_core::sprs::CsMat;
use arlequin_core::{Interpolation, LinearModel, Model, Real, ShapeRow, Uniform};
use fem_ref::generate::{self, Cylinder, Rim};
use fem_ref::{Elastic, ElementKind, FemModel};

const A: [f64; 3] = [1.0, -0.6, 0.8];
const K: [f64; 3] = [1.9, 2.3, 1.4];

/// Returns `u_a = A_a sin(k·x + a)`, which is smooth and does not vanish on the border.
fn manufactured(x: &Point3<f64>) -> Vector3<f64> {
    let phase = Vector3::from(K).dot(&x.coords);
    Vector3::from_fn(|a, _| A[a] * (phase + a as f64).sin())
}

/// Returns `b = −div σ = (λ + μ) k (k·w) + μ k² w` with `w_a = A_a sin(k·x + a)`.
fn body_force(x: &Point3<f64>, lambda: f64, mu: f64) -> Vector3<f64> {
    let (k, w) = (Vector3::from(K), manufactured(x));
    k * (k.dot(&w) * (lambda + mu)) + w * (mu * k.norm_squared())
}

/// Returns the L2 error of the finite element solution on the unit cube with `n` cells per side and inner
/// nodes moved by `jitter`.
fn l2_error(kind: ElementKind, n: usize, jitter: f64) -> f64 {
    let mut next = noise(n as u64);
    let mut moves = Vec::new();
    moves.resize_with((n + 1).pow(3), || {
        Vector3::new(next(), next(), next()) * jitter / n as f64
    });
    let inner = |p: &Point3<f64>| p.iter().all(|c| *c > 1e-9 && *c < 1.0 - 1e-9);
    let index = |p: &Point3<f64>| {
        let i = p.coords.map(|c| (c * n as f64).round() as usize);
        (i.x * (n + 1) + i.y) * (n + 1) + i.z
    };
    let mesh = generate::block(kind, Point3::origin(), Point3::new(1.0, 1.0, 1.0), [n; 3])
        .unwrap()
        .mapped(|p| if inner(p) { p + moves[index(p)] } else { *p })
        .unwrap();
    let material = Elastic::new(2.5, 0.25, 1.0).unwrap();
    let [lambda, mu] = material.lame();
    let model = FemModel::new("mms", mesh, material).unwrap();
    let field = model.field();
    let mut samples: Vec<Sample<f64>> = Vec::new();
    field.cells().iter().for_each(|c| c.quadrature(5, &mut samples));
    let mut row = ShapeRow::default();
    let dofs = model.layout().dofs();
    let (mut f, mut u) = (vec![0.0; dofs], vec![0.0; dofs]);
    for s in &samples {
        let b = body_force(&s.point, lambda, mu) * s.measure;
        field.shape_at(&s.point, false, &mut row).unwrap();
        for (node, n) in row.nodes.iter().zip(&row.values) {
            (0..3).for_each(|a| f[3 * node + a] += n * b[a]);
        }
    }
    let mut fixed = vec![false; dofs];
    for (i, p) in model.nodes().iter().enumerate().filter(|(_, p)| !inner(p)) {
        fixed[3 * i..3 * i + 3].fill(true);
        u[3 * i..3 * i + 3].copy_from_slice(manufactured(p).as_slice());
    }
    solve(&model.stiffness(), &fixed, &f, &mut u);
    let mut square = 0.0;
    for s in &samples {
        field.shape_at(&s.point, false, &mut row).unwrap();
        let mut e = -manufactured(&s.point);
        for (node, n) in row.nodes.iter().zip(&row.values) {
            (0..3).for_each(|a| e[a] += n * u[3 * node + a]);
        }
        square += s.measure * e.norm_squared();
    }
    square.sqrt()
}

#[test]
fn manufactured_solution_converges_with_second_order() {
    for (kind, jitter) in [
        (ElementKind::Hex8, 0.0),
        (ElementKind::Hex8, 0.1),
        (ElementKind::Tet4, 0.0),
        (ElementKind::Tet4, 0.1),
    ] {
        let errors = [4, 8, 12].map(|n| l2_error(kind, n, jitter));
        let orders = [
            (errors[0] / errors[1]).ln() / 2f64.ln(),
            (errors[1] / errors[2]).ln() / 1.5f64.ln(),
        ];
        println!("{kind:?} jitter {jitter}: errors {errors:?}, orders {orders:.3?}");
        assert!(
            orders[1] >= 1.9,
            "{kind:?} jitter {jitter}: errors {errors:?}, orders {orders:?}"
        );
    }
}

/// Returns the number of nodes and the lowest axial frequencies \[Hz\]: inverse iteration on a block of
/// vectors with the lumped mass, Rayleigh-Ritz in every iteration.
fn axial_frequencies(shape: &Cylinder<f64>, kind: ElementKind) -> (usize, [f64; 3]) {
    let mesh = generate::cylinder(kind, shape).unwrap();
    let clamped = mesh.group_nodes("x-min").unwrap();
    let model = FemModel::new("beam", mesh, silica()).unwrap();
    let dofs = model.layout().dofs();
    let mut fixed = vec![false; dofs];
    clamped.iter().for_each(|n| fixed[3 * n..3 * n + 3].fill(true));
    // Axial modes are symmetric in y and z; bending and torsional modes, which round-off would admit, are
    // not.
    for (n, p) in model.nodes().iter().enumerate() {
        fixed[3 * n + 1] |= p.y.abs() < 1e-9;
        fixed[3 * n + 2] |= p.z.abs() < 1e-9;
    }
    let mut mass = vec![0.0; dofs];
    model.lumped_inertia(&Uniform(1.0), &mut mass).unwrap();
    let (k, free) = free_part(&model.stiffness(), &fixed);
    let m: Vec<f64> = free.iter().map(|&i| mass[i]).collect();
    let length = shape.ends[1] - shape.ends[0];
    let shape_of = |j: usize| -> Vec<f64> {
        let wave = |x: f64| (std::f64::consts::FRAC_PI_2 * (2 * j + 1) as f64 * x / length).sin();
        free.iter()
            .map(|&i| {
                if i % 3 == 0 {
                    wave(model.nodes()[i / 3].x)
                } else {
                    0.0
                }
            })
            .collect()
    };
    let mut block: [Vec<f64>; 3] = std::array::from_fn(shape_of);
    let values = inverse_iteration(&k, &m, &mut block);
    (
        model.nodes().len(),
        values.map(|l| l.sqrt() / std::f64::consts::TAU),
    )
}

fn inverse_iteration(k: &CsMat<f64>, m: &[f64], block: &mut [Vec<f64>; 3]) -> [f64; 3] {
    let mut factor = f64::cholesky(k, None).unwrap();
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).zip(m).map(|((a, b), m)| a * b * m).sum() };
    let mut values = [0.0; 3];
    for _ in 0..60 {
        let before = values;
        let old = block.clone();
        for v in block.iter_mut() {
            v.iter_mut().zip(m).for_each(|(v, m)| *v *= m);
            factor.solve(v);
        }
        // Ritz values of K on the new block: Xᵀ K X = Xᵀ M X_old.
        let kx = Matrix3::from_fn(|i, j| dot(&block[i], &old[j]));
        let mx = Matrix3::from_fn(|i, j| dot(&block[i], &block[j]));
        let l = mx.cholesky().unwrap().l().try_inverse().unwrap();
        let sym = l * ((kx + kx.transpose()) * 0.5) * l.transpose();
        let eigen = sym.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a: &usize, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let ritz = l.transpose() * eigen.eigenvectors;
        let new: [Vec<f64>; 3] = std::array::from_fn(|c| {
            let w = ritz.column(order[c]);
            (0..m.len())
                .map(|i| (0..3).map(|b| block[b][i] * w[b]).sum())
                .collect()
        });
        *block = new;
        values = order.map(|c| eigen.eigenvalues[c]);
        if (0..3).all(|c| (values[c] / before[c] - 1.0).abs() < 1e-10) {
            break;
        }
    }
    values
}

#[test]
fn axial_frequencies_of_the_silica_beam() {
    // L = 20 mm, D = 2 mm, clamped at x = 0; truth by converged 27-node hexahedra.
    const TRUTH: [f64; 3] = [71_815.0, 215_369.0, 358_690.0];
    let mut worst = Vec::new();
    for n in [1, 2, 4] {
        let shape = Cylinder {
            ends: [0.0, 20e-3],
            radius: 1e-3,
            core: 2 * n,
            rings: n,
            layers: 20 * n,
            rim: Rim::EqualArea,
        };
        let (nodes, f) = axial_frequencies(&shape, ElementKind::Hex8);
        let errors: [f64; 3] = std::array::from_fn(|k| f[k] / TRUTH[k] - 1.0);
        println!(
            "core {} rings {n} layers {}: {nodes} nodes, {f:.0?} Hz, errors {errors:.5?}",
            2 * n,
            20 * n
        );
        worst.push(errors.iter().fold(0.0, |m, e| f64::max(m, e.abs())));
    }
    assert!(worst[1] < 0.005, "{worst:?}");
    assert!(
        worst[2] < 0.6 * worst[1] && worst[1] < 0.6 * worst[0],
        "{worst:?}"
    );
}

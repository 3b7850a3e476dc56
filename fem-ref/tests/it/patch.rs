//! Constant strain on distorted meshes, rigid motions, energy, threads, single precision.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "a test fails by panicking and may compare exact values"
)]

use crate::common::{jittered, largest, noise, silica, solve};
use approx::assert_relative_eq;
use arlequin_core::geometry::Cell;
use arlequin_core::nalgebra::{Matrix3, Point3, Vector3, center};
use arlequin_core::{LinearModel, Model, NodallyWeighted, Real, Uniform, Weight};
use fem_ref::{Elastic, ElementKind, FemModel, Mesh, generate};
use proptest::prelude::*;

const SOLIDS: [ElementKind; 2] = [ElementKind::Tet4, ElementKind::Hex8];

fn linear(gradient: &Matrix3<f64>, nodes: &[Point3<f64>]) -> Vec<f64> {
    nodes
        .iter()
        .flat_map(|x| (gradient * x.coords + Vector3::new(0.3, -0.2, 0.1)).data.0[0])
        .collect()
}

#[test]
fn patch_test_on_distorted_meshes() {
    let gradient = Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6);
    for kind in SOLIDS {
        let mesh = jittered(kind, 0.2, 7);
        let mut border = vec![false; mesh.nodes().len()];
        for k in mesh.boundary().iter().flat_map(|f| mesh.facet_nodes(*f)) {
            border[k as usize] = true;
        }
        let fixed: Vec<bool> = border.iter().flat_map(|b| [*b; 3]).collect();
        assert_eq!(border.iter().filter(|b| !**b).count(), 3 * 2 * 2);
        let model = FemModel::new("patch", mesh, silica()).unwrap();
        let exact = linear(&gradient, model.nodes());
        let mut u = exact.clone();
        u.iter_mut()
            .zip(&fixed)
            .for_each(|(u, f)| *u *= f64::from(u8::from(*f)));
        solve(&model.stiffness(), &fixed, &vec![0.0; u.len()], &mut u);
        let error: Vec<f64> = u.iter().zip(&exact).map(|(a, b)| a - b).collect();
        assert!(
            largest(&error) <= 1e-12 * largest(&exact),
            "{kind:?}: {:e}",
            largest(&error)
        );
    }
}

#[test]
fn constant_strain_has_the_exact_energy() {
    // E = 5/2, ν = 1/4: λ = μ = 1, so ½ ε:A:ε = ½ tr² + ε:ε.
    let gradient: Matrix3<f64> = Matrix3::new(0.1, 0.3, 0.0, 0.1, -0.2, 0.0, 0.0, 0.4, 0.5);
    let strain = (gradient + gradient.transpose()) * 0.5;
    let density = 0.5 * strain.trace().powi(2) + strain.dot(&strain);
    for kind in SOLIDS {
        let mesh = jittered(kind, 0.2, 3);
        let expected = density * mesh.volume();
        let model = FemModel::new("cube", mesh, Elastic::new(2.5, 0.25, 1.0).unwrap()).unwrap();
        let energy = model.internal_energy(&linear(&gradient, model.nodes()));
        // The 2 × 2 × 2 rule integrates a constant times the Jacobian of a warped hexahedron exactly.
        assert!(
            (energy / expected - 1.0).abs() < 1e-13,
            "{kind:?}: {energy} {expected}"
        );
    }
}

struct Wave;
impl Weight<f64> for Wave {
    fn value(&self, x: &Point3<f64>) -> f64 {
        0.5 + 0.4 * (x.x + 2.0 * x.y).sin()
    }
    // An arbitrary value per element is enough; the true mean is costly.
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let [low, high] = cell.bounds();
        self.value(&center(&low, &high))
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(24))]
    #[test]
    fn rigid_motions_carry_no_force(seed in 1u64..10_000, hex in any::<bool>(), amount in 0.0..0.2f64) {
        let mut model = FemModel::new("free", jittered(SOLIDS[usize::from(hex)], amount, seed), silica()).unwrap();
        model.set_internal_weight(&Wave).unwrap();
        let spin = Matrix3::new(0.0, -0.3, 0.2, 0.3, 0.0, -0.5, -0.2, 0.5, 0.0);
        let u = linear(&spin, model.nodes());
        let mut f = vec![0.0; u.len()];
        model.add_internal_forces(&u, &mut f).unwrap();
        let scale = largest(model.stiffness().data()) * largest(&u);
        prop_assert!(largest(&f) <= 1e-13 * scale, "{:e}", largest(&f) / scale);
        prop_assert!(model.internal_energy(&u).abs() <= 1e-12 * scale * largest(&u));
    }

    #[test]
    fn forces_derive_from_a_symmetric_energy(seed in 1u64..10_000, hex in any::<bool>()) {
        let mut model = FemModel::new("free", jittered(SOLIDS[usize::from(hex)], 0.15, seed), silica()).unwrap();
        model.set_internal_weight(&Wave).unwrap();
        let mut next = noise(seed + 1);
        let n = model.layout().dofs();
        let (u, v): (Vec<f64>, Vec<f64>) = (0..n).map(|_| (next(), next())).unzip();
        let mut force = |u: &[f64]| {
            let mut f = vec![0.0; n];
            model.add_internal_forces(u, &mut f).unwrap();
            f
        };
        let (fu, fv) = (force(&u), force(&v));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (uv, vu) = (dot(&fu, &v), dot(&fv, &u));
        let scale = -dot(&fu, &u);
        prop_assert!(scale > 0.0 && (uv - vu).abs() <= 1e-12 * scale);
        // A quadratic energy: its central difference is exact for any step.
        let energy_at = |s: f64| model.internal_energy(&u.iter().zip(&v).map(|(u, v)| u + s * v).collect::<Vec<_>>());
        let slope = (energy_at(0.5) - energy_at(-0.5)) / 1.0;
        prop_assert!((slope + uv).abs() <= 1e-11 * scale, "{slope} {uv}");
        let k = model.stiffness();
        prop_assert!(k.iter().all(|(v, (i, j))| k.get(j, i) == Some(v)));
    }
}

#[test]
fn weights_enter_as_element_means() {
    // One weight for each half of a bar of two elements: stiffness and mass of each half follow it.
    struct Step;
    impl Weight<f64> for Step {
        fn value(&self, x: &Point3<f64>) -> f64 {
            if x.x < 1.0 { 0.25 } else { 0.5 }
        }
        fn mean(&self, cell: &Cell<f64>) -> f64 {
            let [low, high] = cell.bounds();
            self.value(&center(&low, &high))
        }
    }
    let mesh = generate::bar(0.0, 2.0, 2, 3.0).unwrap();
    let mut model = FemModel::new("bar", mesh, Elastic::new(8.0, 0.0, 2.0).unwrap()).unwrap();
    let mut mass = vec![0.0; 3];
    model.lumped_inertia(&Step, &mut mass).unwrap();
    assert_eq!(mass, [0.75, 2.25, 1.5]);
    model.set_internal_weight(&Step).unwrap();
    let mut f = vec![0.0; 3];
    model.add_internal_forces(&[0.0, 1.0, 0.0], &mut f).unwrap();
    assert_eq!(f, [6.0, -18.0, 12.0]);
    assert_eq!(model.internal_energy(&[0.0, 1.0, 0.0]), 9.0);
    let mut model = NodallyWeighted::new(Box::new(model));
    model.lumped_inertia(&Step, &mut mass).unwrap();
    assert_eq!(mass, [0.75, 3.0, 1.5]);
    model.set_internal_weight(&Step).unwrap();
    f.fill(0.0);
    model.add_internal_forces(&[0.0, 1.0, 0.0], &mut f).unwrap();
    assert_eq!(f, [6.0, -24.0, 12.0]);
    assert!(model.views().linear.is_none());
}

#[test]
fn mass_of_a_warped_mesh_is_that_of_its_volume() {
    for kind in SOLIDS {
        let mesh = jittered(kind, 0.2, 5);
        let expected = 2200.0 * mesh.volume();
        let model = FemModel::new("cube", mesh, silica()).unwrap();
        let mut mass = vec![0.0; model.layout().dofs()];
        model.lumped_inertia(&Uniform(0.5), &mut mass).unwrap();
        assert!(mass.iter().all(|m| *m > 0.0));
        let total: f64 = mass.iter().step_by(3).sum();
        assert_relative_eq!(total, 0.5 * expected, epsilon = 0.0, max_relative = 1e-13);
    }
}

fn forces_with(threads: usize, kind: ElementKind) -> (Vec<u64>, u64) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| {
        let mesh = generate::block(kind, Point3::origin(), Point3::new(1.0, 0.7, 0.6), [20, 14, 13]).unwrap();
        assert!(mesh.nodes().len() > 4000);
        let mut model = FemModel::new("block", mesh, silica()).unwrap();
        model.set_internal_weight(&Wave).unwrap();
        let mut next = noise(11);
        let u: Vec<f64> = (0..model.layout().dofs()).map(|_| next()).collect();
        let mut f = vec![0.0; u.len()];
        model.add_internal_forces(&u, &mut f).unwrap();
        let bits = f.into_iter().map(f64::to_bits).collect();
        (bits, model.internal_energy(&u).to_bits())
    })
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    for kind in SOLIDS {
        let (serial, on_two) = (forces_with(1, kind), forces_with(2, kind));
        assert!(serial == on_two, "{kind:?}");
        assert!(serial == forces_with(3, kind), "{kind:?}");
    }
}

/// Subtracts the forces of every element's stresses from `f`: `∫ σ(u) ∇N_i dV`.
fn subtract_stresses(mesh: &Mesh<f64>, material: &Elastic<f64>, u: &[f64], f: &mut [f64]) {
    let (c, [lambda, mu]) = (mesh.kind().components(), material.lame());
    for e in 0..mesh.element_count() {
        let nodes = mesh.element(e);
        mesh.for_each_gauss_point(e, |p| {
            let mut h = Matrix3::zeros();
            for (&k, g) in nodes.iter().zip(&p.gradients) {
                let mut d = Vector3::zeros();
                d.as_mut_slice()[..c].copy_from_slice(&u[k as usize * c..(k as usize + 1) * c]);
                h += d * g.transpose();
            }
            let stress = if c == 1 {
                h * material.young()
            } else {
                (h + h.transpose()) * mu + Matrix3::identity() * (h.trace() * lambda)
            };
            for (&k, g) in nodes.iter().zip(&p.gradients) {
                let force = stress * g * p.weight;
                (0..c).for_each(|a| f[k as usize * c + a] -= force[a]);
            }
        });
    }
}

#[test]
fn forces_are_those_of_the_stresses_of_every_element() {
    let bar = generate::bar_at(&[0.0, 0.4, 1.0, 1.1], 2.0).unwrap();
    for mesh in [
        jittered(ElementKind::Tet4, 0.2, 1),
        jittered(ElementKind::Hex8, 0.2, 1),
        bar,
    ] {
        let mut model = FemModel::new("both", mesh, silica()).unwrap();
        let mut next = noise(2);
        let u: Vec<f64> = (0..model.layout().dofs()).map(|_| next()).collect();
        let (mut f, mut g) = (vec![1.0; u.len()], vec![1.0; u.len()]);
        model.add_internal_forces(&u, &mut f).unwrap();
        subtract_stresses(model.mesh(), &silica(), &u, &mut g);
        let difference: Vec<f64> = f.iter().zip(&g).map(|(a, b)| a - b).collect();
        assert!(largest(&difference) <= 1e-13 * largest(&f));
    }
}

fn cube_energy_and_step<T: Real>() -> (f64, f64) {
    let corner = Point3::new(T::one(), T::one(), T::one());
    let mesh = generate::block(ElementKind::Hex8, Point3::origin(), corner, [3, 3, 3]).unwrap();
    let material = Elastic::new(T::of(2.5), T::of(0.25), T::one()).unwrap();
    let mut model = FemModel::new("cube", mesh, material).unwrap();
    let u: Vec<T> = model
        .nodes()
        .iter()
        .flat_map(|x| [x.x * T::of(0.1), T::zero(), T::zero()])
        .collect();
    let mut mass = vec![T::zero(); u.len()];
    model.lumped_inertia(&Uniform(T::one()), &mut mass).unwrap();
    let inverse: Vec<T> = mass.iter().map(|m| T::one() / *m).collect();
    let energy = model.internal_energy(&u);
    (energy.as_f64(), model.critical_step(&inverse).unwrap().as_f64())
}

#[test]
fn single_precision_works() {
    // Uniaxial strain with λ = μ = 1: ½ (λ + 2μ) ε².
    let (double, single) = (cube_energy_and_step::<f64>(), cube_energy_and_step::<f32>());
    assert!((double.0 - 0.015).abs() < 1e-13 && (single.0 - 0.015).abs() < 1e-7);
    assert!(
        (single.1 / double.1 - 1.0).abs() < 1e-3,
        "{} {}",
        single.1,
        double.1
    );
}

//! The block kernel: conservation, stability, frame indifference, numbering.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::effect::Load;
use arlequin_core::{Coupled, Model, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights};
use dem_beam::{BeamMaterial, Container, DemModel, Packing, PackingSpec, Twist, critical};
use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use std::sync::OnceLock;

fn packing() -> &'static Packing {
    static P: OnceLock<Packing> = OnceLock::new();
    P.get_or_init(|| {
        PackingSpec::quench(Container::cylinder(6e-3, 1e-3).unwrap(), 1200, 3)
            .build()
            .unwrap()
    })
}

fn model(packing: &Packing) -> DemModel {
    DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

/// Returns deterministic noise in [-1, 1].
fn noise(i: usize, c: usize) -> f64 {
    let mut z = (i as u64 * 6 + c as u64)
        .wrapping_add(0x9e37_79b9)
        .wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) as f64 / u64::MAX as f64) * 2.0 - 1.0
}

fn random(n: usize, linear: f64, angular: f64) -> Vec<Twist> {
    (0..n)
        .map(|i| Twist {
            linear: Vector3::new(noise(i, 0), noise(i, 1), noise(i, 2)) * linear,
            angular: Vector3::new(noise(i, 3), noise(i, 4), noise(i, 5)) * angular,
        })
        .collect()
}

/// Returns the unknowns of a model as one vector.
fn join(x: &[Twist]) -> Vec<f64> {
    let linear = x.iter().flat_map(|t| t.linear.iter());
    linear
        .chain(x.iter().flat_map(|t| t.angular.iter()))
        .copied()
        .collect()
}

fn split(q: &[f64]) -> Vec<Twist> {
    let (u, th) = q.split_at(q.len() / 2);
    let parts = u.chunks_exact(3).zip(th.chunks_exact(3));
    let twist = |(u, th)| Twist {
        linear: Vector3::from_column_slice(u),
        angular: Vector3::from_column_slice(th),
    };
    parts.map(twist).collect()
}

fn forces(model: &mut DemModel, x: &[Twist]) -> Vec<Twist> {
    let mut f = vec![0.0; 6 * x.len()];
    model.add_internal_forces(&join(x), &mut f).unwrap();
    split(&f)
}

/// Velocity Verlet without any check of the step.
struct Motion {
    model: DemModel,
    step: f64,
    q: Vec<f64>,
    v: Vec<f64>,
    f: Vec<f64>,
    inertia: Vec<f64>,
}

impl Motion {
    fn new(mut model: DemModel, step: f64, v: &[Twist]) -> Self {
        let body = model.body();
        let triple = |m: &[f64]| m.iter().flat_map(|m| [*m; 3]).collect::<Vec<_>>();
        let inertia = [triple(body.mass()), triple(body.inertia())].concat();
        let (q, mut f) = (vec![0.0; 6 * v.len()], vec![0.0; 6 * v.len()]);
        model.advance(&q, &mut f).unwrap();
        Self {
            model,
            step,
            q,
            v: join(v),
            f,
            inertia,
        }
    }

    fn kick(&mut self) {
        for (v, (f, m)) in self.v.iter_mut().zip(self.f.iter().zip(&self.inertia)) {
            *v += 0.5 * self.step * f / m;
        }
    }

    fn run(&mut self, steps: usize) {
        for _ in 0..steps {
            self.kick();
            let moved = self.q.iter_mut().zip(&self.v);
            moved.for_each(|(q, v)| *q += self.step * v);
            self.f.fill(0.0);
            self.model.advance(&self.q, &mut self.f).unwrap();
            self.kick();
        }
    }

    fn kinetic(&self) -> f64 {
        let pairs = self.v.iter().zip(&self.inertia);
        pairs.map(|(v, m)| 0.5 * m * v * v).sum()
    }

    fn energy(&self) -> f64 {
        self.kinetic() + self.model.internal_energy(&self.q)
    }

    /// Returns `1/2 v M v + 1/2 q K q - dt^2/8 a M a`, which velocity Verlet conserves exactly under the
    /// linear law.
    fn invariant(&self) -> f64 {
        let pulls: f64 = self.f.iter().zip(&self.inertia).map(|(f, m)| f * f / m).sum();
        self.energy() - self.step * self.step / 8.0 * pulls
    }
}

fn worst(a: &[Twist], b: &[Twist]) -> (f64, f64) {
    let max = |f: &dyn Fn(&Twist, &Twist) -> f64| a.iter().zip(b).map(|(a, b)| f(a, b)).fold(0.0, f64::max);
    let size = |f: &dyn Fn(&Twist) -> f64| b.iter().map(f).fold(0.0, f64::max);
    (
        max(&|a, b| (a.linear - b.linear).norm()) / size(&|b| b.linear.norm()),
        max(&|a, b| (a.angular - b.angular).norm()) / size(&|b| b.angular.norm()),
    )
}

/// At 0.9 of the critical step the invariant drifts by at most 1e-9, relative.
#[test]
fn linear_invariant_does_not_drift() {
    let model = model(packing());
    let dt = 0.9 * critical::lanczos(model.body()).unwrap();
    let start = random(model.nodes().len(), 1.0, 1e4);
    let mut d = Motion::new(model, dt, &start);
    let h = d.invariant();
    for _ in 0..4 {
        d.run(5_000);
        let drift = (d.invariant() / h - 1.0).abs();
        assert!(drift < 1e-9, "{drift}");
    }
}

#[test]
fn critical_step_is_critical_and_bounds_are_safe() {
    let body = model(packing()).body().clone();
    let exact = critical::lanczos(&body).unwrap();
    let bound = critical::block_bound(&body).unwrap();
    let ratio = bound / exact;
    assert!(ratio > 0.70 && ratio < 0.82, "{ratio}");
    // The rule min sqrt(m/k_n) considers translations only, and is unsafe.
    let springs = body
        .bonds()
        .zip(body.pairs())
        .map(|(b, p)| {
            let k = body.rigidity().axial * b.axis.norm();
            let m = p.map(|i| body.mass()[i as usize]);
            (m[0].min(m[1]) / k).sqrt()
        })
        .fold(f64::INFINITY, f64::min);
    assert!(springs > 1.3 * exact, "{}", springs / exact);
    let grows = |dt: f64| {
        let mut d = Motion::new(model(packing()), dt, &random(body.len(), 1e-3, 10.0));
        let start = d.kinetic();
        d.run(3000);
        let end = d.energy();
        end.is_nan() || end > 1e3 * start
    };
    assert!(!grows(0.999 * exact) && !grows(bound));
    assert!(grows(1.003 * exact) && grows(springs));
    // With energy weighting the block bound holds for any weight, since element and mass shrink together.
    let mut weighted = body.clone();
    weighted.set_weights(&vec![1e-6; body.pairs().len()]).unwrap();
    let relative = critical::lanczos(&weighted).unwrap() / exact;
    assert!((relative - 1.0).abs() < 1e-6, "{relative}");
}

#[test]
fn finite_law_is_the_gradient_of_its_energy_and_frame_indifferent() {
    let body = model(packing()).body().clone();
    let mut d = model(packing()).with_finite_rotations();
    let r = packing().report.mean_radius;
    let x = random(body.len(), 0.05 * r, 0.3);
    let f = forces(&mut d, &x);
    let scale = f.iter().map(|f| f.linear.norm()).fold(0.0, f64::max);
    // Central differences of the energy in a few components.
    for p in [0, 17, 400, 901] {
        for c in 0..6 {
            let h = if c < 3 { 1e-5 * r } else { 1e-5 };
            let energy_at = |s: f64| {
                let mut y = x.clone();
                if c < 3 {
                    y[p].linear[c] += s * h;
                } else {
                    let mut w = Vector3::zeros();
                    w[c - 3] = s * h;
                    let q =
                        UnitQuaternion::from_scaled_axis(w) * UnitQuaternion::from_scaled_axis(y[p].angular);
                    y[p].angular = q.scaled_axis();
                }
                d.internal_energy(&join(&y))
            };
            let grad = (energy_at(1.0) - energy_at(-1.0)) / (2.0 * h);
            let (force, unit) = if c < 3 {
                (f[p].linear[c], scale)
            } else {
                (f[p].angular[c - 3], scale * r)
            };
            assert!(
                (force + grad).abs() < 2e-5 * unit,
                "{p} {c}: {force:e} {grad:e} of {unit:e}"
            );
        }
    }
    // A superposed rigid motion leaves the energy and turns the forces.
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 1.1)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), -0.7);
    let shift = Vector3::new(1e-3, -2e-3, 5e-4);
    let moved: Vec<Twist> = x
        .iter()
        .zip(body.positions())
        .map(|(t, p)| Twist {
            linear: turn * (p + t.linear) + shift - p,
            angular: (UnitQuaternion::from_rotation_matrix(&turn)
                * UnitQuaternion::from_scaled_axis(t.angular))
            .scaled_axis(),
        })
        .collect();
    let before = d.internal_energy(&join(&x));
    assert!((d.internal_energy(&join(&moved)) / before - 1.0).abs() < 1e-11);
    let turned: Vec<Twist> = f
        .iter()
        .map(|f| Twist {
            linear: turn * f.linear,
            angular: turn * f.angular,
        })
        .collect();
    let (a, b) = worst(&forces(&mut d, &moved), &turned);
    assert!(a < 1e-10 && b < 1e-10, "{a} {b}");
}

/// A free body that tumbles conserves energy without drift, and momenta to round-off, over 20 000 steps.
#[test]
fn finite_law_conserves() {
    let body = model(packing()).body().clone();
    let dt = 0.5 * critical::block_bound(&body).unwrap();
    let spin = Vector3::new(2e4, 5e3, -1e4);
    let start: Vec<Twist> = random(body.len(), 2.0, 1e3)
        .iter()
        .zip(body.positions())
        .map(|(n, x)| Twist {
            linear: n.linear + spin.cross(x),
            angular: n.angular + spin,
        })
        .collect();
    let mut d = Motion::new(model(packing()).with_finite_rotations(), dt, &start);
    let momenta = |d: &Motion| {
        let (v, u) = (split(&d.v), split(&d.q));
        let mut sum = (Vector3::zeros(), Vector3::zeros());
        for i in 0..v.len() {
            let p = v[i].linear * body.mass()[i];
            sum.0 += p;
            sum.1 += (body.positions()[i] + u[i].linear).cross(&p) + v[i].angular * body.inertia()[i];
        }
        sum
    };
    let (p0, l0) = momenta(&d);
    let e0 = d.energy();
    let mut energies = Vec::new();
    for _ in 0..20 {
        d.run(1000);
        energies.push((d.energy()) / e0 - 1.0);
    }
    let (p, l) = momenta(&d);
    assert!((p - p0).norm() < 1e-10 * p0.norm() && (l - l0).norm() < 1e-10 * l0.norm());
    let half = |e: &[f64]| e.iter().sum::<f64>() / e.len() as f64;
    let drift = half(&energies[10..]) - half(&energies[..10]);
    assert!(
        drift.abs() < 1e-4 && energies.iter().all(|e| e.abs() < 1e-2),
        "{drift} {energies:?}"
    );
}

/// The order of particles and bonds changes results only by round-off, since the sums are re-associated.
#[test]
fn independent_of_numbering() {
    let p = packing();
    let n = p.radii.len();
    let flip = |i: usize| n - 1 - i;
    let mut q = p.clone();
    for i in 0..n {
        q.positions[flip(i)] = p.positions[i];
        q.radii[flip(i)] = p.radii[i];
    }
    q.pairs = p
        .pairs
        .iter()
        .rev()
        .map(|&[i, j]| [flip(i as usize) as u32, flip(j as usize) as u32])
        .collect();
    let run = |p: &Packing, reversed: bool| {
        let model = model(p).with_finite_rotations();
        let old: Vec<usize> = model.order().iter().map(|&i| i as usize).collect();
        let old: Vec<usize> = old
            .into_iter()
            .map(|i| if reversed { flip(i) } else { i })
            .collect();
        let v = random(n, 1.0, 1e3);
        let v: Vec<Twist> = old.iter().map(|&i| v[i]).collect();
        let mut d = Motion::new(model, 1e-9, &v);
        d.run(100);
        let mut x = vec![Twist::zero(); n];
        old.iter().zip(split(&d.q)).for_each(|(&i, t)| x[i] = t);
        x
    };
    let (a, b) = worst(&run(p, false), &run(&q, true));
    assert!(a < 1e-9 && b < 1e-9, "{a} {b}");
}

#[test]
fn supports_and_loads() {
    let model = model(packing());
    let body = model.body().clone();
    let layer = model.clamp_layer(&Point3::origin(), &Vector3::x());
    let load = (0..body.len()).map(|i| (3 * i, 1e-3)).collect();
    let load = Load::on_dofs("pull", load, TimeFunction::Step).unwrap();
    let support = PrescribedMotion::fixed(model.clamped(&layer));
    let bar = Subdomain::fine(model, Weights::uncoupled())
        .with_support(support)
        .with_effect(Box::new(load));
    let mut run = Coupled::new(vec![bar], Vec::new(), TimeStep::Fraction(0.6), None).unwrap();
    run.run(50, &mut Silent).unwrap();
    let q = split(&run.subdomains()[0].state().q);
    for (i, x) in q.iter().enumerate() {
        assert_eq!(layer.contains(&i), *x == Twist::zero());
        assert!(x.linear.x >= 0.0);
    }
}

/// The ledger draws its energies from the pass of the forces. They must be those of the bonds one by one,
/// under both laws and any weight, and the draw must leave the reached orientations alone.
#[test]
fn energy_of_the_force_pass_is_that_of_the_bonds() {
    for finite in [false, true] {
        let mut model = model(packing());
        if finite {
            model = model.with_finite_rotations();
        }
        model.set_internal_weight(&arlequin_core::Uniform(0.3)).unwrap();
        let q = join(&random(model.nodes().len(), 1e-6, 2e-2));
        let mut f = vec![0.0; q.len()];
        model.advance(&q, &mut f).unwrap();
        let next: Vec<f64> = q.iter().map(|x| 1.01 * x).collect();
        let (expected, drawn) = (model.internal_energy(&next), model.energy_from_forces(&next));
        assert!((drawn / expected - 1.0).abs() < 1e-12, "{drawn:e} {expected:e}");
        let mut again = vec![0.0; q.len()];
        model.add_internal_forces(&q, &mut again).unwrap();
        assert!(f.iter().zip(&again).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

//! Free bodies of spheres that tumble: angular momentum and energy over many turns.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, MassDamping, StiffnessDamping};
use arlequin_core::{
    Arms, Claim, Coupled, Guard, Model, PrescribedMotion, Silent, Subdomain, TimeStep, Weights,
};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::PI;

/// Returns 4 x 5 x 6 spheres of a cubic lattice: 120.
fn brick() -> DemModel {
    let packing = lattice(Lattice::Cubic, [4, 5, 6], 1e-3).unwrap();
    let model = DemModel::new("box", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    assert_eq!(model.nodes().len(), 120);
    model.with_finite_rotations()
}

/// Returns the velocities of a rigid body that spins about its centre of mass.
fn spinning(model: &DemModel, spin: Vector3<f64>) -> Vec<f64> {
    let mass: f64 = model.masses().iter().sum();
    let nodes = || model.nodes().iter().zip(model.masses());
    let centre = nodes().map(|(x, m)| x.coords * *m).sum::<Vector3<f64>>() / mass;
    let mut v: Vec<f64> = Vec::new();
    for x in model.nodes() {
        v.extend(spin.cross(&(x.coords - centre)).iter());
    }
    (0..model.nodes().len()).for_each(|_| v.extend(spin.iter()));
    v
}

/// Returns the momenta about the origin, with particles at their present places and their own spin.
fn momenta(run: &Coupled<f64>) -> [Vector3<f64>; 2] {
    let s = &run.subdomains()[0];
    let (state, m, n) = (s.state(), s.inertia(), s.model().nodes().len());
    let vector = |x: &[f64], o: usize| Vector3::new(x[o], x[o + 1], x[o + 2]);
    let mut sum = [Vector3::zeros(); 2];
    for (i, x) in s.model().nodes().iter().enumerate() {
        let p = vector(&state.v, 3 * i) * m[3 * i];
        let place = x.coords + vector(&state.q, 3 * i);
        sum[0] += p;
        sum[1] += place.cross(&p) + vector(&state.v, 3 * (n + i)) * m[3 * (n + i)];
    }
    sum
}

/// Returns a run of a free box with an initial rigid spin \[rad/s\].
fn free(spin: Vector3<f64>, step: f64) -> Coupled<f64> {
    let model = brick();
    let v = spinning(&model, spin);
    let zero = vec![0.0; v.len()];
    let side = Subdomain::fine(model, Weights::uncoupled())
        .with_initial(zero, v)
        .unwrap();
    let guard = Guard {
        interval: 50,
        growth: 0.05,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(step), Some(guard)).unwrap()
}

/// A free box of 120 spheres tumbles ten turns and conserves momentum and energy. The spin is about no
/// principal axis, so that the axis wanders, a quarter of a turn per 13 000 steps. The balance of a nonlinear
/// law is of second order in the angle per step, `(w dt)^2/3` for a body that begins to spin at once.
#[test]
fn a_free_box_of_120_spheres_tumbles_ten_turns_and_keeps_momentum_and_energy() {
    let spin = Vector3::new(180.0, 400.0, 300.0);
    let mut run = free(spin, 0.9);
    let ([_, start], energy) = (momenta(&run), run.energy());
    let steps = (20.0 * PI / spin.norm() / run.dt()).ceil() as usize;
    let (mut slip, mut gap, mut wander) = (0.0_f64, 0.0_f64, 0.0_f64);
    for _ in 0..40 {
        run.run(steps / 40 + 1, &mut Silent).unwrap();
        slip = slip.max((momenta(&run)[1] - start).norm() / start.norm());
        gap = gap.max((run.energy() / energy - 1.0).abs());
        let n = run.subdomains()[0].model().nodes().len();
        let now = &run.subdomains()[0].state().v[3 * n..];
        wander = wander.max(spin.angle(&Vector3::new(now[0], now[1], now[2])));
    }
    assert!(slip <= 1e-10, "dL/L {slip:e}");
    assert!(
        gap <= 1e-8 && run.drift() <= 1e-8,
        "energy {gap:e}, H {:e}",
        run.drift()
    );
    assert!(wander > 0.2, "it should tumble: {wander} rad");
    // Quaternions keep unit length: the round-off of 570 000 products does not add up.
    let memory = run.subdomains()[0].model().save().numbers;
    let norm = |x: &[f64]| (x[..4].iter().map(|q| q * q).sum::<f64>() - 1.0).abs();
    let worst = memory.chunks(7).map(norm).fold(0.0, f64::max);
    assert!(worst < 2e-15, "{worst:e}");
    // The ledger reports the same.
    let body = &run.bodies()[0];
    assert_eq!((body.arms, &body.claim), (Arms::Current, &Claim::Both));
    assert!(
        body.drift[0] <= 1e-10 && body.drift[1] <= 1e-10,
        "{:?}",
        body.drift
    );
    assert!(run.watch().is_empty());
}

/// In a box strained by 1e-3 by its own spin, angular momentum is conserved for any step, and energy to
/// second order in the step.
#[test]
fn angular_momentum_is_kept_at_any_speed_and_energy_to_second_order() {
    let spin = Vector3::new(2e4, 5e4, -3e4);
    let drift = [0.8, 0.4].map(|step| {
        let mut run = free(spin, step);
        let [_, start] = momenta(&run);
        while run.time() * spin.norm() < 4.0 * PI {
            run.run(50, &mut Silent).unwrap();
        }
        let slip = (momenta(&run)[1] - start).norm() / start.norm();
        assert!(slip < 1e-11, "dL/L {slip:e}");
        run.drift()
    });
    let order = (drift[0] / drift[1]).log2();
    assert!(drift[0] < 1e-3 && (1.7..2.6).contains(&order), "{drift:?}");
}

/// A rigid rotation by any rotation vector costs no energy, and a body with this initial rotation goes on
/// from there.
#[test]
fn initial_rotation_vectors_are_orientations() {
    let (spin, turn) = (Vector3::new(3e3, -1e3, 2e3), Vector3::new(1.5, -2.0, 0.8));
    let straight = {
        let mut run = free(spin, 0.5);
        run.run(2_000, &mut Silent).unwrap();
        run.subdomains()[0].state().clone()
    };
    let model = brick();
    let (n, rotation) = (model.nodes().len(), Rotation3::from_scaled_axis(turn));
    let turned = |x: &[f64]| -> Vec<f64> {
        x.chunks(3)
            .flat_map(|x| <[f64; 3]>::from(rotation * Vector3::from_column_slice(x)))
            .collect()
    };
    let v = turned(&spinning(&model, spin));
    let mut q: Vec<f64> = Vec::new();
    model
        .nodes()
        .iter()
        .for_each(|x| q.extend((rotation * x.coords - x.coords).iter()));
    (0..n).for_each(|_| q.extend(turn.iter()));
    let side = Subdomain::fine(model, Weights::uncoupled())
        .with_initial(q, v)
        .unwrap();
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    assert!(run.subdomains()[0].internal_energy() < 1e-20 * run.energy());
    run.run(2_000, &mut Silent).unwrap();
    let (computed, wanted) = (&run.subdomains()[0].state().v, turned(&straight.v));
    let top = wanted[..3 * n].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let gap = computed[..3 * n]
        .iter()
        .zip(&wanted)
        .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
    assert!(gap < 1e-9 * top, "{}", gap / top);
}

/// A run resumed in the middle of a tumble goes on with the same bits, and a snapshot of another body is
/// refused.
#[test]
fn a_tumble_goes_on_from_a_snapshot_with_the_same_bits() {
    let spin = Vector3::new(9e3, -4e3, 2e4);
    let bits = |run: &Coupled<f64>| -> Vec<u64> {
        let s = run.subdomains()[0].state();
        s.q.iter().chain(&s.v).chain(&s.a).map(|x| x.to_bits()).collect()
    };
    let mut whole = free(spin, 0.8);
    whole.run(6_000, &mut Silent).unwrap();
    let saved = whole.snapshot().unwrap();
    whole.run(6_000, &mut Silent).unwrap();
    assert!(
        whole.time() * spin.norm() > 2.0 * PI,
        "{}",
        whole.time() * spin.norm()
    );
    let mut resumed = free(spin, 0.8);
    resumed.restore(&saved).unwrap();
    resumed.run(6_000, &mut Silent).unwrap();
    assert!(bits(&whole) == bits(&resumed));
    assert_eq!(whole.drift().to_bits(), resumed.drift().to_bits());
    assert_eq!(whole.bodies(), resumed.bodies());
    let mut wrong = saved;
    wrong.subdomains[0].model.numbers[0] += 0.5;
    let error = free(spin, 0.8).restore(&wrong).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("model 'box'") && text.contains("orientations"),
        "{text}"
    );
    // The model's own error keeps its type on the way through the core.
    let arlequin_core::Error::Model { source, .. } = &error else {
        panic!("{error:?}")
    };
    assert!(matches!(
        source.downcast_ref(),
        Some(dem_beam::Error::ForeignRecord { .. })
    ));
}

/// The linear law conserves the angular momentum about the positions at rest.
#[test]
fn the_linear_law_keeps_the_angular_momentum_about_positions_at_rest() {
    let packing = lattice(Lattice::Cubic, [4, 5, 6], 1e-3).unwrap();
    let run = |held: bool, damped: bool| {
        let model = DemModel::new("box", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        let clamp = model.clamped(&[0]);
        let mut v = spinning(&model, Vector3::new(20.0, -50.0, 40.0));
        v.iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v *= 1.0 + 0.3 * (i as f64).sin());
        let mut side = Subdomain::fine(model, Weights::uncoupled())
            .with_initial(vec![0.0; v.len()], v)
            .unwrap();
        if held {
            side = side.with_support(PrescribedMotion::fixed(clamp));
        }
        if damped {
            side = side
                .with_effect(Box::new(StiffnessDamping::new(1e-8).unwrap()))
                .with_effect(Box::new(MassDamping::new(1.0).unwrap()));
        }
        let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
        run.run(3_000, &mut Silent).unwrap();
        run
    };
    let free = run(false, false);
    let body = &free.bodies()[0];
    assert_eq!((body.arms, &body.claim), (Arms::Reference, &Claim::Both));
    assert!(body.drift.iter().all(|d| *d < 1e-13), "{:?}", body.drift);
    let sample = free.last_energy().unwrap();
    assert!(sample.momentum_drift[1] <= body.drift[1] && sample.momentum_drift[1] > 0.0);
    // The first external action is named; damping of strains alone is not external.
    for (held, damped, wanted) in [
        (true, false, "supports of 'box'"),
        (false, true, "'mass-damping' of 'box'"),
    ] {
        let body = run(held, damped).bodies().remove(0);
        assert_eq!(body.claim, Claim::Neither(wanted.to_owned()));
    }
}

/// A load that declares itself an effect without external action is detected by the ledger.
#[test]
fn a_momentum_that_changes_though_it_should_stay_is_told() {
    struct Thief;
    impl EffectSpec<f64> for Thief {
        fn attach(self: Box<Self>, _: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
            Ok(self)
        }
    }
    impl AnyEffect<f64> for Thief {
        fn name(&self) -> &str {
            "thief"
        }
        fn arms(&self) -> Option<Arms> {
            Some(Arms::Current)
        }
    }
    impl Effect<f64> for Thief {
        fn add_forces(&mut self, _: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
            let half = f.len() / 2;
            f[half] += 1e-6;
            Ok(())
        }
        fn power(&self, v: &[f64]) -> f64 {
            1e-6 * v[v.len() / 2]
        }
    }
    let model = brick();
    let v = spinning(&model, Vector3::new(2e3, -5e3, 4e3));
    let side = Subdomain::fine(model, Weights::uncoupled())
        .with_initial(vec![0.0; v.len()], v)
        .unwrap()
        .with_effect(Box::new(Thief));
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
    assert!(run.warnings().is_empty());
    run.run(5_000, &mut Silent).unwrap();
    let reported: Vec<String> = run.warnings().iter().map(ToString::to_string).collect();
    assert!(
        reported.len() == 1 && reported[0].starts_with("body 'box': its angular momentum has changed by"),
        "{reported:?}"
    );
    // M t, as a share of the sum of moduli, which is no less than the modulus of the sum.
    let share = 1e-6 * run.time() / run.bodies()[0].angular.norm();
    let reported = run.bodies()[0].drift[1] / share;
    assert!((0.5..=1.0 + 1e-6).contains(&reported), "{reported}");
}

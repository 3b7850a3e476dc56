//! Loads, dampings and supports of a body of particles on several ranks: the bits of one rank.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{Along, Results, WAIT, bar, bits, first, same_on, shared, unknowns};
use arlequin_core::effect::{
    BodyForce, Effect, EffectSpec, ForceLaw, Host, Instant, Load, LocalDamping, MassDamping, Prestress,
    StiffnessDamping,
};
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::ranks::Communicator;
use arlequin_core::{
    Coupled, Guard, Model, Partition, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin_mpi::threads;
use dem_beam::LoadShare;
use std::sync::Arc;

/// Returns a bar with all effects that particles have, its ends held and moved. Only the outer ranks own
/// nodes of the ends.
fn loaded(finite: bool, ranks: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    let model = bar(finite);
    let start = model.select(|x| x.x < 4e-4);
    let end = model.select(|x| x.x > 5.6e-3);
    let near = model.select(|x| (4.5e-3..5e-3).contains(&x.x));
    let pulse = TimeFunction::SmoothPulse { duration: 1e-6 };
    let forces = model
        .force(&near, Vector3::new(1.0, -3.0, 2.0), LoadShare::Mass)
        .unwrap();
    let torques = model
        .torque(&near, Vector3::new(1e-4, 0.0, 2e-4), LoadShare::Area)
        .unwrap();
    let pull = PrescribedMotion {
        dofs: model.translations(&end, [true, false, true]),
        amplitude: 1e-7,
        time: TimeFunction::SmoothPulse { duration: 4e-7 },
    };
    let held = PrescribedMotion::fixed(model.clamped(&start));
    let mut q = unknowns(&model, [1e-9, 1e-5]);
    let mut v = unknowns(&model, [0.1, 2e2]);
    for d in held.dofs.iter().chain(&pull.dofs) {
        (q[*d], v[*d]) = (0.0, 0.0);
    }
    let gravity = BodyForce::new(Vector3::new(0.0, 0.0, -1e5)).unwrap();
    let shaken = BodyForce::new(Vector3::x()).unwrap().over_time(pulse.clone());
    let effects: [Box<dyn EffectSpec<f64>>; 8] = [
        Box::new(gravity),
        Box::new(shaken.unwrap()),
        Box::new(Load::on_dofs("push", forces, pulse).unwrap()),
        Box::new(Load::on_dofs("twist", torques, TimeFunction::Step).unwrap()),
        Box::new(MassDamping::new(1e4).unwrap()),
        Box::new(StiffnessDamping::new(1e-9).unwrap()),
        Box::new(Prestress),
        Box::new(LocalDamping::new(0.1).unwrap()),
    ];
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Along)))
        .with_partition(Partition::Unchecked)
        .with_support(held)
        .with_support(pull)
        .with_initial(q, v)
        .unwrap();
    let side = effects.into_iter().fold(side, Subdomain::with_effect);
    let side = shared(side, ranks);
    let guard = Guard {
        interval: 7,
        growth: 0.5,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap()
}

fn results(run: Coupled<f64>) -> Results {
    results_after(run, 40)
}

fn results_after(mut run: Coupled<f64>, steps: usize) -> Results {
    run.run(steps, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![run.dt(), e.invariant, e.work, e.drift, run.top_created()];
    sums.extend(run.works().iter().map(|w| w.work));
    let about = Point3::new(1e-3, 0.0, 0.0);
    let reactions = run.reactions(0).unwrap();
    let mut resultants = vec![
        run.support_resultant(0, 0, &reactions, &about).unwrap(),
        run.support_resultant(0, 1, &reactions, &about).unwrap(),
    ];
    for name in ["push", "twist", "body-force", "mass-damping", "local-damping"] {
        resultants.push(run.effect_resultant(0, name, &about).unwrap());
    }
    for r in resultants {
        sums.extend(r.force.iter().chain(&r.moment));
    }
    let s = &run.subdomains()[0];
    let state = s.state();
    (bits(s.model(), &[&state.q, &state.v, &state.a, &reactions]), sums)
}

#[test]
fn effects_and_moving_supports_have_the_bits_of_one_rank() {
    for finite in [false, true] {
        let whole = results(loaded(finite, None));
        // Every effect and support did something, and the balance closes to round-off if the law is linear.
        assert!(whole.1[5..14].iter().all(|w| w.abs() > 1e-15), "{:?}", whole.1);
        assert!(finite || whole.1[3].abs() < 1e-12 * whole.1[1], "{:?}", whole.1);
        same_on(&[1, 2, 3, 4, 8], &finite, &whole, |c| {
            results(loaded(finite, Some(c)))
        });
    }
}

/// Runs half of the steps on two ranks and the other half on other numbers of ranks, with the effects'
/// records.
#[test]
fn a_snapshot_of_two_ranks_goes_on_on_any_number_of_them() {
    let whole = results(loaded(true, None));
    let saved = first(2, |c| {
        let mut run = loaded(true, Some(c));
        run.run(20, &mut Silent).unwrap();
        run.snapshot().unwrap()
    });
    let mut alone = loaded(true, None);
    alone.run(20, &mut Silent).unwrap();
    assert!(alone.snapshot().unwrap() == saved);
    same_on(&[1, 3, 4], &"", &whole, |c| {
        let mut run = loaded(true, Some(c));
        run.restore(&saved).unwrap();
        results_after(run, 20)
    });
}

/// Moments on particles of either end of the bar give the requested twist but for the weights.
#[test]
fn loads_name_unknowns_of_the_whole_body() {
    let resultants = threads::run(3, 1, WAIT, |c| {
        let mut run = loaded(false, Some(c));
        run.run(1, &mut Silent).unwrap();
        run.effect_resultant(0, "twist", &Point3::origin()).unwrap()
    });
    let model = bar(false);
    let near = model.select(|x| (4.5e-3..5e-3).contains(&x.x));
    let weight = |d: usize| 1.0 - 0.8 * model.nodes()[d / 3].x / 6e-3;
    let forces = model.torque(&near, Vector3::new(1e-4, 0.0, 2e-4), LoadShare::Area);
    let moment: Vector3<f64> = forces
        .unwrap()
        .iter()
        .map(|(d, f)| {
            let force = Vector3::ith(d % 3, *f * weight(*d));
            model.nodes()[d / 3].coords.cross(&force)
        })
        .sum();
    for r in resultants {
        let r = r.unwrap();
        assert!(
            (r.moment - moment).norm() < 1e-12 * moment.norm(),
            "{r:?} {moment}"
        );
    }
}

/// Effect of springs from every particle to the next one, which needs nodes of other ranks.
struct Chain;

impl EffectSpec<f64> for Chain {
    fn attach(self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
        let law = |_: &Instant<'_, f64>, _: &mut [f64], _: &mut [f64]| {};
        Ok(Box::new(ForceLaw::new("chain", host.inertia.len(), law)))
    }
}

#[test]
fn effects_that_need_the_whole_body_are_refused_by_name_on_every_rank() {
    let refused = threads::run(3, 1, WAIT, |c| {
        let side = Subdomain::fine(bar(false), Weights::from_weight(Arc::new(Along)))
            .with_partition(Partition::Unchecked)
            .with_effect(Box::new(Chain))
            .shared(c);
        Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None)
            .unwrap_err()
            .to_string()
    });
    for e in refused {
        let e = e.unwrap();
        let wanted = "have the effect 'chain' while it is in parts on 3 ranks; run it on one";
        assert!(e.contains("'bar'") && e.contains(wanted), "{e}");
    }
}

#[test]
fn ranks_with_other_effects_or_supports_are_told_so() {
    let refused = threads::run(2, 1, WAIT, |c| {
        let side = Subdomain::fine(bar(false), Weights::from_weight(Arc::new(Along)))
            .with_partition(Partition::Unchecked);
        let side = match c.rank() {
            0 => side,
            _ => side.with_effect(Box::new(MassDamping::new(1.0).unwrap())),
        };
        Coupled::new(vec![side.shared(c)], Vec::new(), TimeStep::Fraction(0.5), None)
            .unwrap_err()
            .to_string()
    });
    for (rank, e) in refused.into_iter().enumerate() {
        let wanted = format!("rank {rank}: ranks differ in the effects on 'bar' and its supports");
        let e = e.unwrap();
        assert!(e.contains(&wanted), "{e}");
    }
}

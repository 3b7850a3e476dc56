//! Interfaces that share nodes are solved for together: chains of three models whose overlaps touch or
//! overlap.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::chain::{Chain, ratios};
use arlequin::core::{
    Coupled, Error, H1Gradient, H1Strain, InterfaceOptions, Junction, L2, OwnStep, PrescribedMotion, Profile,
    Silent, Solver, Subdomain, TimeFunction, TimeStep, conformance,
};
use arlequin::fem_ref::FemModel;
use arlequin_studies::solid::momentum_scale;

fn gradients() -> Solver<f64> {
    Solver::ConjugateGradients {
        tolerance: 1e-14,
        max_iterations: 500,
    }
}

/// Runs a chain in random motion and asserts that momenta, energy and both constraints hold; returns the run.
fn run_and_check(chain: &Chain, junction: &dyn Fn() -> Box<dyn Junction<f64>>, steps: usize) -> Coupled<f64> {
    let mut c = chain.run(junction).unwrap();
    let (before, scale) = (c.momentum(), momentum_scale(&c));
    c.run(steps, &mut Silent).unwrap();
    let after = c.momentum();
    for k in 0..2 {
        let change = (after[k] - before[k]).norm() / scale[k];
        assert!(change < 1e-12, "{chain:?}: momentum {k} changes by {change:e}");
    }
    assert!(c.drift() < 1e-12, "{chain:?}: drift {:e}", c.drift());
    let residual = c.constraint_residual();
    assert!(residual < 1e-11, "{chain:?}: velocity jump {residual:e}");
    for k in 0..c.interfaces().len() {
        let [velocity, displacement] = c.jumps(k);
        assert!(velocity < 1e-11, "{chain:?}: jump {velocity:e} of interface {k}");
        let single_rate = chain.own == ratios([1, 1, 1]);
        assert!(
            displacement < if single_rate { 1e-11 } else { 0.25 },
            "{chain:?}: {displacement:e}"
        );
    }
    let work = c
        .works()
        .into_iter()
        .find(|w| w.name == "constraint")
        .unwrap()
        .work;
    assert!(work.abs() < 1e-11 * c.energy(), "work of the constraint {work:e}");
    c
}

#[test]
fn overlaps_that_touch_keep_energy_and_momenta_for_any_own_steps() {
    let junctions: [&dyn Fn() -> Box<dyn Junction<f64>>; 3] = [
        &|| Box::new(L2),
        &|| Box::new(H1Strain::new(0.15).unwrap()),
        &|| Box::new(H1Gradient::new(0.15).unwrap()),
    ];
    for (junction, counts) in junctions.into_iter().zip([[1, 1, 1], [1, 2, 4], [3, 2, 1]]) {
        for solver in [Solver::Auto, gradients()] {
            let chain = Chain {
                own: ratios(counts),
                solver,
                ..Chain::default()
            };
            let c = run_and_check(&chain, junction, 200);
            let report = |k: usize| c.interfaces()[k].report();
            assert_eq!(
                (&report(0).together[..], &report(1).together[..]),
                (&["east".into()][..], &["west".into()][..])
            );
            assert_eq!(report(0).rank, report(0).multipliers);
            assert!(conformance::interface_momentum(&c).iter().all(|x| *x < 1e-12));
        }
    }
}

#[test]
fn three_models_at_one_place_share_it_and_are_tied() {
    for counts in [[1, 1, 1], [1, 2, 4]] {
        let chain = Chain {
            third: 2.5,
            own: ratios(counts),
            ..Chain::default()
        };
        let c = run_and_check(&chain, &|| Box::new(L2), 200);
        let mass: f64 = c
            .subdomains()
            .iter()
            .map(|s| s.inertia().iter().step_by(3).sum::<f64>())
            .sum();
        assert!(
            (mass - 6.0).abs() < 1e-3,
            "weights of three models sum to one: {mass}"
        );
    }
}

#[test]
fn interfaces_that_are_apart_are_solved_for_alone() {
    let chain = Chain {
        third: 4.0,
        ..Chain::default()
    };
    let c = run_and_check(&chain, &|| Box::new(L2), 100);
    assert!(c.interfaces().iter().all(|i| i.report().together.is_empty()));
}

/// Where all three models overlap, the tie of the first to the last is redundant: it is counted and does no
/// harm.
#[test]
fn a_tie_too_many_is_counted_and_does_no_harm() {
    for counts in [[1, 1, 1], [1, 1, 3]] {
        let chain = Chain {
            third: 2.0,
            closed: true,
            own: ratios(counts),
            ..Chain::default()
        };
        let mut c = chain.run(&|| Box::new(L2)).unwrap();
        let dropped: usize = c.interfaces().iter().map(|i| i.report().null_modes.len()).sum();
        let multipliers = c.interfaces()[2].report().multipliers;
        assert_eq!(dropped, multipliers, "those of one of three equal mediators");
        c.run(200, &mut Silent).unwrap();
        assert!(c.drift() < 1e-12, "drift {:e}", c.drift());
        // Three interfaces have three sets of samples, so that one tie is redundant up to their round-off:
        // modes below 1e-10 of the largest are dropped, and the jump that remains is of the order of the
        // square root.
        assert!(
            c.constraint_residual() < 1e-5,
            "velocity jump {:e}",
            c.constraint_residual()
        );
    }
}

/// Uniform strain u = ε (x, −ν y, −ν z) passes through overlaps that touch, with roller supports on three
/// faces of all models and a displacement at the far end.
#[test]
fn uniform_strain_passes_through_overlaps_that_touch() {
    let chain = Chain {
        profile: Profile::Linear,
        epsilon: 0.0,
        ..Chain::default()
    };
    let support = |model: &FemModel<f64>, group: &str, axis: usize, amplitude: f64| PrescribedMotion {
        dofs: model
            .mesh()
            .group_nodes(group)
            .unwrap()
            .into_iter()
            .map(|n| 3 * n + axis)
            .collect(),
        amplitude,
        time: TimeFunction::Step,
    };
    let ends = [Some(("x-min", 0.0)), None, Some(("x-max", 0.06))];
    let held = chain
        .models()
        .into_iter()
        .zip(chain.weights())
        .zip(ends)
        .map(|((model, w), end)| {
            let mut supports = vec![support(&model, "y-min", 1, 0.0), support(&model, "z-min", 2, 0.0)];
            supports.extend(end.map(|(group, motion)| support(&model, group, 0, motion)));
            supports
                .into_iter()
                .fold(Subdomain::fine(model, w), Subdomain::with_support)
        });
    let held = held.collect();
    let step = TimeStep::Fraction(0.8);
    let mut c = Coupled::new(held, chain.interfaces(&|| Box::new(L2)), step, None).unwrap();
    let solution = c.equilibrium(1.0).unwrap();
    for (s, q) in c.subdomains().iter().zip(&solution.displacements) {
        for (x, u) in s.model().nodes().iter().zip(q.chunks(3)) {
            let exact = [0.01 * x.x, -0.0025 * x.y, -0.0025 * x.z];
            let deviation = (0..3).fold(0.0, |m: f64, k| m.max((u[k] - exact[k]).abs())) / 0.06;
            assert!(deviation < 1e-11, "'{}' at {x}: {deviation:e}", s.model().name());
        }
    }
}

#[test]
fn chains_have_the_same_bits_on_any_number_of_threads_and_after_a_restart() {
    let bits = |c: &Coupled<f64>| -> Vec<u64> {
        let states = c
            .subdomains()
            .iter()
            .flat_map(|s| s.state().q.iter().chain(&s.state().v));
        states
            .chain([&c.last_energy().unwrap().drift])
            .map(|x| x.to_bits())
            .collect()
    };
    for solver in [Solver::Auto, gradients()] {
        let chain = Chain {
            fine: 3,
            own: ratios([1, 1, 3]),
            solver,
            ..Chain::default()
        };
        let build = || chain.run(&|| Box::new(H1Gradient::new(0.1).unwrap())).unwrap();
        let bits_on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut c = build();
                c.run(12, &mut Silent).unwrap();
                bits(&c)
            })
        };
        let serial = bits_on(1);
        assert_eq!(serial, bits_on(2), "two threads");
        assert_eq!(serial, bits_on(3), "three threads");
        let mut first = build();
        first.run(4, &mut Silent).unwrap();
        let mut second = build();
        second.restore(&first.snapshot().unwrap()).unwrap();
        second.run(8, &mut Silent).unwrap();
        assert_eq!(serial, bits(&second), "after a restart");
    }
}

#[test]
fn what_cannot_be_solved_for_together_is_refused_by_name() {
    let chain = Chain::default();
    let mut interfaces = chain.interfaces(&|| Box::new(L2));
    interfaces[1].options = InterfaceOptions {
        lumped: true,
        ..InterfaceOptions::default()
    };
    let result = Coupled::new(chain.bodies(), interfaces, TimeStep::Fraction(0.8), None);
    assert!(
        matches!(&result, Err(Error::InvalidOption { interface, name, rule, .. })
            if interface == "east" && *name == "lumped" && rule.contains("shares nodes with 'west'")),
        "{result:?}"
    );
    // A jump of initial displacements is refused by the name of the interface that has it, although all are
    // closed together.
    let far = chain.bodies().into_iter().enumerate().map(|(k, s)| {
        let n = s.model().layout().dofs();
        s.with_initial(vec![[0.0, 0.0, 1.0][k]; n], vec![0.0; n]).unwrap()
    });
    let interfaces = chain.interfaces(&|| Box::new(L2));
    let result = Coupled::new(far.collect(), interfaces, TimeStep::Fraction(0.8), None);
    assert!(
        matches!(&result, Err(Error::InitialJump { interface, .. }) if interface == "east"),
        "{result:?}"
    );
    let near = chain.bodies().into_iter().enumerate().map(|(k, s)| {
        let n = s.model().layout().dofs();
        s.with_initial(vec![1.0 + 0.01 * k as f64; n], vec![0.0; n])
            .unwrap()
    });
    let interfaces = chain.interfaces(&|| Box::new(L2));
    let mut c = Coupled::new(near.collect(), interfaces, TimeStep::Fraction(0.8), None).unwrap();
    for k in 0..2 {
        assert!(c.interfaces()[k].report().start_moved > 1e-3);
        assert!(c.jumps(k)[1] < 1e-12, "{:e}", c.jumps(k)[1]);
    }
}

/// A chain of models with three different critical steps gives each model the own steps that it needs.
#[test]
fn a_chain_of_three_critical_steps_steps_as_each_model_needs() {
    let chain = Chain {
        fine: 2,
        own: [OwnStep::Fraction(0.5); 3],
        ..Chain::default()
    };
    let interfaces = chain.interfaces(&|| Box::new(L2));
    let mut c = Coupled::new(chain.bodies(), interfaces, TimeStep::Chosen(0.9), None).unwrap();
    let steps: Vec<_> = c.subdomains().iter().map(Subdomain::own_steps).collect();
    // The macro step is that of the coarsest model.
    assert!(steps[0] == 1 && steps[1] > 1 && steps[2] > 1, "{steps:?}");
    c.run(50, &mut Silent).unwrap();
    assert!(c.drift() < 1e-12, "drift {:e}", c.drift());
}

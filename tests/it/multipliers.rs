//! How multipliers are solved for: iterations that end anywhere, dependent multipliers in any number.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Junction, L2, OwnStep, PrescribedMotion,
    Profile, Ramp, Silent, Slab, Solver, Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, generate};
use arlequin_studies::line::Line;
use arlequin_studies::noise;
use std::sync::Arc;

fn gradients(tolerance: f64, max_iterations: usize) -> Solver<f64> {
    Solver::ConjugateGradients {
        tolerance,
        max_iterations,
    }
}

fn options(solver: Solver<f64>) -> InterfaceOptions<f64> {
    InterfaceOptions {
        solver,
        ..InterfaceOptions::default()
    }
}

/// Bar and chain in random motion; the chain makes `ratio` steps of its own.
fn line(solver: Solver<f64>, ratio: usize) -> Coupled<f64> {
    let line = Line {
        overlap: 40.0,
        mediator: 2.0,
        coarse_elements: 20,
        fine_bonds: 150,
        step: TimeStep::Seconds(0.9 * ratio as f64),
        options: options(solver),
        ..Line::default()
    };
    let (mut a, mut b) = (noise(3), noise(4));
    let random = |next: &mut dyn FnMut() -> f64| (0..400).map(|_| next()).collect::<Vec<f64>>();
    let (left, right) = (random(&mut a), random(&mut b));
    let at = |of: &[f64], x: f64| (0.0, of[(x + 210.0) as usize]);
    let sides = line.subdomains(&|x| at(&left, x), &|x| at(&right, x)).unwrap();
    let [bar, chain] = sides;
    let sides = vec![bar, chain.with_step(OwnStep::Ratio(ratio))];
    line.build_with(sides).unwrap()
}

/// Hexahedra and tetrahedra in random motion.
fn solid_pair(junction: Box<dyn Junction<f64>>, solver: Solver<f64>) -> Coupled<f64> {
    let bodies = solid::shaken(solid::bodies(Profile::Cubic, 0.05), 12);
    let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [3, 3, 3]);
    let mut spec = solid::spec(space, junction);
    spec.options = options(solver);
    Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.8), None).unwrap()
}

fn velocities(c: &Coupled<f64>) -> Vec<f64> {
    let all = c.subdomains().iter();
    all.flat_map(|s| s.state().v.iter().copied()).collect()
}

#[test]
fn a_few_iterations_from_zero_keep_the_energy_and_the_momentum() {
    for iterations in [2, 3, 5] {
        for ratio in [1, 4] {
            let mut c = line(gradients(0.0, iterations), ratio);
            let before = c.momentum()[0];
            c.run(4000 / ratio, &mut Silent).unwrap();
            let change = (c.momentum()[0] - before).norm();
            assert!(
                c.drift() < 1e-12,
                "{iterations} iterations, ratio {ratio}: drift {:e}",
                c.drift()
            );
            assert!(change < 1e-11, "{iterations} iterations: momentum {change:e}");
            assert!(
                c.constraint_residual() > 1e-9,
                "they are too few to meet the constraint: {:e}",
                c.constraint_residual()
            );
            let work = c.works().iter().find(|w| w.name == "constraint").unwrap().work;
            assert!(work.abs() < 1e-10, "work of the constraint {work:e}");
        }
        for junction in solid::junctions::<f64>() {
            let name = junction.name();
            let mut c = solid_pair(junction, gradients(0.0, iterations));
            c.run(400, &mut Silent).unwrap();
            assert_eq!(c.interfaces()[0].iterations(), iterations);
            assert!(
                c.drift() < 1e-12,
                "{name}, {iterations} iterations: drift {:e}",
                c.drift()
            );
            // What multipliers do is booked apart from the drift.
            let work = c.works().iter().find(|w| w.name == "constraint").unwrap().work;
            let all = c.energy();
            assert!(
                work.abs() < 1e-11 * all,
                "{name}, {iterations} iterations: work of the constraint {work:e} of {all:e}"
            );
        }
    }
}

#[test]
fn iterations_that_converge_give_what_the_factor_gives() {
    for junction in [
        || Box::new(L2) as Box<dyn Junction<f64>>,
        || Box::new(H1Gradient::new(0.15).unwrap()) as Box<dyn Junction<f64>>,
        || Box::new(H1Strain::new(0.15).unwrap()) as Box<dyn Junction<f64>>,
    ] {
        let run = |solver| {
            let mut c = solid_pair(junction(), solver);
            c.run(100, &mut Silent).unwrap();
            c
        };
        let report = |c: &Coupled<f64>| c.interfaces()[0].report().clone();
        let exact = run(Solver::Factor);
        assert_eq!(report(&exact).solver, "factor");
        let near = run(gradients(1e-13, 500));
        assert_eq!(report(&near).solver, "conjugate gradients");
        assert_eq!(report(&exact).rank, report(&near).rank);
        let ratio = report(&exact).condition / report(&near).condition;
        assert!((ratio - 1.0).abs() < 0.01, "conditions differ by {ratio}");
        let [a, b] = [&exact, &near].map(velocities);
        let top = a.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let apart = a.iter().zip(&b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / top;
        assert!(apart < 1e-10, "velocities differ by {apart:e}");
        let left = near.constraint_residual();
        assert!(left < 1e-10, "residual {left:e}");
    }
}

#[test]
fn many_dependent_multipliers_are_solved_for_by_one_factor_and_counted() {
    let line = Line {
        overlap: 200.0,
        mediator: 200.0 / 4100.0,
        coarse_elements: 40,
        fine_bonds: 400,
        step: TimeStep::Seconds(0.9),
        ..Line::default()
    };
    let mut next = noise(8);
    let random: Vec<f64> = (0..900).map(|_| next()).collect();
    let wave = |x: f64| (0.0, random[(x + 450.0) as usize]);
    let mut c = line.build(&wave, &wave).unwrap();
    c.run(20, &mut Silent).unwrap();
    let report = c.interfaces()[0].report();
    assert_eq!(report.multipliers, 4101);
    assert_eq!(
        (report.solver, c.interfaces()[0].iterations()),
        ("pivoted factor", 0)
    );
    // One for every bond of the overlap and its ends.
    assert_eq!(report.rank, 201);
    assert!(
        report
            .warnings
            .iter()
            .any(|w| w.starts_with("3900 of 4101 multiplier unknowns are dependent")),
        "{:?}",
        report.warnings
    );
    assert!(c.drift() < 1e-12, "drift {:e}", c.drift());
    assert!(
        c.constraint_residual() < 1e-8,
        "residual {:e}",
        c.constraint_residual()
    );
}

/// The mediator is finer than either model: rows that depend on others are dropped, and hold all the same.
#[test]
fn dropped_multipliers_of_a_solid_cost_no_energy_and_no_momentum_and_their_rows_hold() {
    for junction in [
        || Box::new(L2) as Box<dyn Junction<f64>>,
        || Box::new(H1Gradient::new(0.1).unwrap()) as Box<dyn Junction<f64>>,
    ] {
        let run = |solver| {
            let bodies = solid::shaken(solid::bodies(Profile::Cubic, 0.05), 12);
            let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [8; 3]);
            let mut spec = solid::spec(space, junction());
            spec.options = options(solver);
            let mut c = Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.8), None).unwrap();
            let before = c.momentum();
            c.run(200, &mut Silent).unwrap();
            let after = c.momentum();
            let scale = arlequin_studies::solid::momentum_scale(&c);
            for k in 0..2 {
                let change = (after[k] - before[k]).norm() / scale[k];
                assert!(change < 1e-12, "momentum {k} changes by {change:e}");
            }
            c
        };
        let c = run(Solver::Auto);
        let (i, report) = (&c.interfaces()[0], c.interfaces()[0].report());
        println!(
            "{}: rank {} of {}, condition {:.1e}, drift {:.1e}, residual {:.1e}",
            report.junction,
            report.rank,
            report.multipliers,
            report.condition,
            c.drift(),
            c.constraint_residual()
        );
        assert_eq!((report.solver, i.iterations()), ("pivoted factor", 0));
        assert!(report.rank < report.multipliers);
        assert!(c.drift() < 1e-11, "drift {:e}", c.drift());
        assert!(
            c.constraint_residual() < 1e-8,
            "residual {:e}",
            c.constraint_residual()
        );
    }
}

/// By the model of decision 0046, whatever the run is solved by.
#[test]
fn sums_over_many_ranks_are_what_conjugate_gradients_pay_for() {
    for solver in [Solver::Auto, gradients(1e-12, 500)] {
        let c = solid_pair(Box::new(L2), solver);
        let of = |ranks: usize| {
            let all = c.interfaces()[0].solution_times(ranks);
            assert_eq!(
                all.iter().map(|t| t.solver).collect::<Vec<_>>(),
                ["factor", "conjugate gradients"]
            );
            [0, 1].map(|k| all[k].seconds)
        };
        let [alone, few, many] = [1, 10, 1000].map(of);
        assert!(alone.iter().all(|s| *s > 0.0), "{alone:?}");
        assert!(many[1] > 1.5 * few[1], "{few:?} {many:?}");
    }
}

/// Nodes on the face `z` least are held in `z` alone, overlap included: the operator of that component is
/// another one.
#[test]
fn a_component_that_is_held_in_the_overlap_is_solved_with_its_own_masses() {
    let run = |solver| {
        let bodies = solid::bodies(Profile::Cubic, 0.05).map(|body| {
            let nodes = body.model().nodes();
            let least = nodes.iter().fold(f64::INFINITY, |m, x| m.min(x.z));
            let held = (0..nodes.len()).filter(|k| nodes[*k].z < least + 1e-9);
            let dofs: Vec<usize> = held.map(|k| 3 * k + 2).collect();
            assert!(dofs.len() > 8);
            body.with_support(PrescribedMotion {
                dofs,
                amplitude: 0.0,
                time: TimeFunction::Step,
            })
        });
        let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [3, 3, 3]);
        let mut spec = solid::spec(space, Box::new(L2));
        spec.options = options(solver);
        let mut c = Coupled::new(
            solid::shaken(bodies, 12),
            vec![spec],
            TimeStep::Fraction(0.8),
            None,
        )
        .unwrap();
        c.run(200, &mut Silent).unwrap();
        c
    };
    let [exact, near] = [Solver::Factor, gradients(1e-13, 500)].map(run);
    for c in [&exact, &near] {
        let report = c.interfaces()[0].report();
        assert!(c.drift() < 1e-12, "{}: drift {:e}", report.solver, c.drift());
        let left = c.constraint_residual();
        assert!(left < 1e-10, "{}: residual {left:e}", report.solver);
        for s in c.subdomains() {
            let held = s.supports().iter().flat_map(|m| &m.dofs);
            held.for_each(|d| assert!(s.state().q[*d].abs() <= 0.0));
        }
    }
    let [a, b] = [&exact, &near].map(velocities);
    let apart = a.iter().zip(&b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(apart < 1e-9, "velocities differ by {apart:e}");
}

/// The section of a mediator's bars scales multipliers, and moves nothing.
#[test]
fn a_mediator_of_bars_of_any_section_ties_alike() {
    let elastic = Elastic::new(1.0, 0.0, 1.0).unwrap();
    let run = |section: f64| {
        let bar = |name: &str, from: f64, count| {
            let mesh = generate::bar(from, from + 3.0, count, 2.0).unwrap();
            FemModel::new(name, mesh, elastic).unwrap()
        };
        let point = |x: f64| Point3::new(x, 0.0, 0.0);
        let slab = Slab::between(point(3.0), point(2.0)).unwrap();
        let left = Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 0.05).unwrap()));
        let right = Weights::complement_of(std::slice::from_ref(&left));
        let v: Vec<f64> = (0..=75).map(|k| (0.2 * f64::from(k)).sin()).collect();
        let fine = Subdomain::fine(bar("fine", 2.0, 75), right);
        let bodies = vec![
            Subdomain::coarse(bar("coarse", 0.0, 15), left),
            fine.with_initial(vec![0.0; 76], v).unwrap(),
        ];
        let space = FemField::new(generate::bar(2.0, 3.0, 5, section).unwrap());
        let tie = InterfaceSpec::new("overlap", 0, 1, Arc::new(space), L2);
        let mut run = Coupled::new(bodies, vec![tie], TimeStep::Fraction(0.8), None).unwrap();
        run.run(300, &mut Silent).unwrap();
        assert!(
            run.drift() < 1e-12 && run.constraint_residual() < 1e-11,
            "{section}"
        );
        let states = run.subdomains().iter().map(|s| s.state().v.clone());
        states.flatten().collect::<Vec<_>>()
    };
    let own = run(2.0);
    for section in [1e-6, 1.0, 1e6] {
        let gap = run(section)
            .iter()
            .zip(&own)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(gap < 1e-12, "{section}: {gap:e}");
    }
}

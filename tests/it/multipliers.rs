//! Solution for multipliers: iterations that end early, and any number of dependent multipliers.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Junction, L2, OwnStep, Partition,
    PrescribedMotion, Profile, Ramp, Silent, Slab, Solver, Subdomain, TimeFunction, TimeStep, Weights,
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

fn chebyshev(tolerance: f64, max_iterations: usize) -> Solver<f64> {
    Solver::Chebyshev {
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

/// Bar and chain in random motion; the chain makes `ratio` own steps in a macro step.
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
    let motion = |values: &[f64], x: f64| (0.0, values[(x + 210.0) as usize]);
    let sides = line
        .subdomains(&|x| motion(&left, x), &|x| motion(&right, x))
        .unwrap();
    let [bar, chain] = sides;
    let sides = vec![bar, chain.with_step(OwnStep::Ratio(ratio))];
    line.build_with(sides).unwrap()
}

/// Couples hexahedra and tetrahedra in random motion.
fn solid_pair(junction: Box<dyn Junction<f64>>, solver: Solver<f64>) -> Coupled<f64> {
    let bodies = solid::shaken(solid::bodies(Profile::Cubic, 0.05), 12);
    let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [3, 3, 3]);
    let mut spec = solid::spec(space, junction);
    spec.options = options(solver);
    Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.8), None).unwrap()
}

fn velocities(c: &Coupled<f64>) -> Vec<f64> {
    let bodies = c.subdomains().iter();
    bodies.flat_map(|s| s.state().v.iter().copied()).collect()
}

#[test]
fn a_few_iterations_from_zero_keep_the_energy_and_the_momentum() {
    let methods = [gradients, chebyshev];
    for (iterations, method) in [2, 3, 5]
        .into_iter()
        .flat_map(|n| methods.map(|method| (n, method)))
    {
        for ratio in [1, 4] {
            let mut c = line(method(0.0, iterations), ratio);
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
            let mut c = solid_pair(junction, method(0.0, iterations));
            c.run(400, &mut Silent).unwrap();
            assert_eq!(c.interfaces()[0].iterations(), iterations);
            assert!(
                c.drift() < 1e-12,
                "{name}, {iterations} iterations: drift {:e}",
                c.drift()
            );
            // The work of the multipliers is booked apart from the drift.
            let work = c.works().iter().find(|w| w.name == "constraint").unwrap().work;
            let total = c.energy();
            assert!(
                work.abs() < 1e-11 * total,
                "{name}, {iterations} iterations: work of the constraint {work:e} of {total:e}"
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
        for (solver, name) in [
            (gradients(1e-13, 500), "conjugate gradients"),
            (chebyshev(1e-13, 20_000), "chebyshev"),
        ] {
            let near = run(solver);
            assert_eq!(report(&near).solver, name);
            assert_eq!(report(&exact).rank, report(&near).rank);
            let ratio = report(&exact).condition / report(&near).condition;
            assert!((ratio - 1.0).abs() < 0.01, "conditions differ by {ratio}");
            let [a, b] = [&exact, &near].map(velocities);
            let top = a.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            let difference = a.iter().zip(&b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / top;
            assert!(difference < 1e-10, "{name}: velocities differ by {difference:e}");
            let residual = near.constraint_residual();
            assert!(residual < 1e-10, "{name}: residual {residual:e}");
            if let Some(damped) = report(&near).damped {
                assert!(near.interfaces()[0].iterations() >= damped.iterations);
            }
        }
    }
}

/// With 41 independent of 81 multipliers, a Chebyshev iteration over many steps does not grow in the null
/// space, where nothing is damped.
#[test]
fn dependent_multipliers_stay_alone_in_a_chebyshev_iteration_over_many_steps() {
    for solver in [Solver::chebyshev(), chebyshev(0.0, 5)] {
        let deck = Line {
            overlap: 40.0,
            mediator: 0.5,
            coarse_elements: 20,
            fine_bonds: 150,
            step: TimeStep::Seconds(0.9),
            options: options(solver),
            ..Line::default()
        };
        let mut next = noise(5);
        let random: Vec<f64> = (0..400).map(|_| next()).collect();
        let motion = |x: f64| (0.0, random[(x + 210.0) as usize]);
        let mut c = deck.build(&motion, &motion).unwrap();
        let largest = |c: &Coupled<f64>| {
            let multipliers = c.interfaces()[0].multipliers().iter();
            multipliers.fold(0.0, |m: f64, l| m.max(l.abs()))
        };
        c.run(200, &mut Silent).unwrap();
        let report = c.interfaces()[0].report().clone();
        assert_eq!([report.multipliers, report.rank], [81, 41]);
        let early = largest(&c);
        c.run(20_000, &mut Silent).unwrap();
        assert!(c.drift() < 1e-12, "{solver:?}: drift {:e}", c.drift());
        assert!(largest(&c) < 10.0 * early, "{} of {early}", largest(&c));
        if matches!(solver, Solver::Chebyshev { tolerance, .. } if tolerance > 0.0) {
            let residual = c.constraint_residual();
            assert!(residual < 1e-9, "residual {residual:e}");
        }
    }
}

/// A Chebyshev iteration takes as many iterations in any units of length and mass.
#[test]
fn a_chebyshev_iteration_takes_as_many_iterations_in_any_units() {
    let count = |[length, density]: [f64; 2]| {
        let bar = |name: &str, from: f64, count, density: f64| {
            let mesh = generate::bar(from * length, (from + 3.0) * length, count, length * length).unwrap();
            FemModel::new(name, mesh, Elastic::new(1.0, 0.0, density).unwrap()).unwrap()
        };
        let point = |x: f64| Point3::new(x * length, 0.0, 0.0);
        let slab = Slab::between(point(3.0), point(2.0)).unwrap();
        let coarse_share =
            Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 1e-3).unwrap()));
        let right = Weights::complement_of(std::slice::from_ref(&coarse_share));
        let v: Vec<f64> = (0..=75).map(|k| length * (0.2 * f64::from(k)).sin()).collect();
        let fine = Subdomain::fine(bar("fine", 2.0, 75, density), right).with_partition(Partition::Unchecked);
        let bodies = vec![
            Subdomain::coarse(bar("coarse", 0.0, 15, density), coarse_share)
                .with_partition(Partition::Unchecked),
            fine.with_initial(vec![0.0; 76], v).unwrap(),
        ];
        let space = FemField::new(generate::bar(2.0 * length, 3.0 * length, 5, length * length).unwrap());
        let mut tie = InterfaceSpec::new("overlap", 0, 1, Arc::new(space), L2);
        tie.options.solver = Solver::chebyshev();
        let mut run = Coupled::new(bodies, vec![tie], TimeStep::Fraction(0.8), None).unwrap();
        run.run(300, &mut Silent).unwrap();
        assert!(run.drift() < 1e-12, "{length} {density}: {:e}", run.drift());
        let residual = run.constraint_residual();
        assert!(residual < 1e-10, "{length} {density}: {residual:e}");
        run.interfaces()[0].iterations()
    };
    let reference = count([1.0, 1.0]);
    for units in [[1e-9, 1e-12], [1e6, 1e9]] {
        assert_eq!(count(units), reference);
    }
}

#[test]
fn single_precision_keeps_the_energy_with_a_chebyshev_iteration() {
    for solver in [
        Solver::chebyshev(),
        Solver::Chebyshev {
            tolerance: 0.0,
            max_iterations: 3,
        },
    ] {
        let bodies = solid::shaken(solid::bodies::<f32>(Profile::Cubic, 0.05), 12);
        let space = solid::mediator::<f32>(ElementKind::Hex8, solid::OVERLAP, [3, 3, 3]);
        let mut spec = solid::spec(space, Box::new(L2));
        spec.options.solver = solver;
        let mut c = Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.8), None).unwrap();
        c.run(1000, &mut Silent).unwrap();
        assert!(c.drift() < 1e-4, "{solver:?}: {:e}", c.drift());
        if solver == Solver::chebyshev() {
            let residual = c.constraint_residual();
            assert!(residual < 1e-4, "residual {residual:e}");
        }
    }
}

#[test]
fn more_dependent_multipliers_than_a_dense_solver_takes_are_harmless_and_counted() {
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
    assert_eq!(report.solver, "conjugate gradients");
    // One for every bond of the overlap, and its ends.
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

/// With the cost model of decision 0046 a Chebyshev iteration saves sums over many ranks, whatever solver the
/// run uses.
#[test]
fn sums_over_many_ranks_are_what_a_chebyshev_iteration_saves() {
    for solver in [Solver::Auto, gradients(1e-12, 500), Solver::chebyshev()] {
        let c = solid_pair(Box::new(L2), solver);
        let times_on = |ranks: usize| {
            let times = c.interfaces()[0].solution_times(ranks);
            assert_eq!(
                times.iter().map(|t| t.solver).collect::<Vec<_>>(),
                ["factor", "conjugate gradients", "chebyshev"]
            );
            [0, 1, 2].map(|k| times[k].seconds)
        };
        let [alone, few, many] = [1, 10, 1000].map(times_on);
        assert!(alone.iter().all(|s| *s > 0.0), "{alone:?}");
        assert!(
            many[2] < 0.5 * many[1] && many[1] > 1.5 * few[1],
            "{few:?} {many:?}"
        );
        assert!(many[2] < 1.1 * few[2], "{few:?} {many:?}");
    }
}

/// Nodes on the face of least `z` are held in `z` alone, also in the overlap, so that this component has an
/// operator of its own and is solved with its own masses.
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
        let residual = c.constraint_residual();
        assert!(residual < 1e-10, "{}: residual {residual:e}", report.solver);
        for s in c.subdomains() {
            let held = s.supports().iter().flat_map(|m| &m.dofs);
            held.for_each(|d| assert!(s.state().q[*d].abs() <= 0.0));
        }
    }
    let [a, b] = [&exact, &near].map(velocities);
    let difference = a.iter().zip(&b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(difference < 1e-9, "velocities differ by {difference:e}");
}

/// The section of a mediator's bars scales the multipliers and changes no motion.
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
    let reference = run(2.0);
    for section in [1e-6, 1.0, 1e6] {
        let gap = run(section)
            .iter()
            .zip(&reference)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(gap < 1e-12, "{section}: {gap:e}");
    }
}

//! What a run claims of multipliers and displacements beyond its balance, measured.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[allow(dead_code, reason = "each test binary uses its part of the shared setting")]
mod support;

use arlequin::core::{Coupled, Error, InterfaceOptions, OwnStep, Silent, Solver, TimeStep, Warning};
use arlequin_studies::line::{Line, Product, rest};
use arlequin_studies::noise;
use support::line::short;

/// More dependent multipliers than a dense solver takes, under a product whose condition grows with the fourth power of `length`.
fn dependent(length: f64, solver: Solver<f64>) -> arlequin::core::Result<Coupled<f64>> {
    let line = Line {
        overlap: 200.0,
        mediator: 200.0 / 4100.0,
        coarse_elements: 40,
        fine_bonds: 400,
        step: TimeStep::Seconds(0.9),
        junction: Product::H1(length),
        options: InterfaceOptions {
            solver,
            ..InterfaceOptions::default()
        },
        ..Line::default()
    };
    let mut next = noise(8);
    let random: Vec<f64> = (0..900).map(|_| next()).collect();
    let wave = |x: f64| (0.0, random[(x + 450.0) as usize]);
    line.build(&wave, &wave)
}

/// B.3: iterations for multipliers that do not reach their tolerance are told the moment it happens, by the jump of velocities, and end
/// the run above 5 % of the largest velocity.
#[test]
fn iterations_for_multipliers_that_do_not_end_are_told_and_ended() {
    for length in [1.0, 5.0, 20.0, 100.0] {
        match dependent(length, Solver::Auto) {
            Ok(mut run) => {
                let end = run.run(20, &mut Silent);
                let report = run.interfaces()[0].report();
                println!(
                    "{length}: {end:?}, residual {:e}, {} iterations, condition {:e} {}, {:?}",
                    run.constraint_residual(),
                    run.interfaces()[0].iterations(),
                    report.condition,
                    report.condition_at_least,
                    run.warnings()
                );
                assert!(report.condition_at_least);
            }
            Err(e) => println!("{length}: {e}"),
        }
    }
    let few = Solver::ConjugateGradients {
        tolerance: 1e-12,
        max_iterations: 3,
    };
    let mut asked = dependent(1.0, few).unwrap();
    asked.run(20, &mut Silent).unwrap();
    println!("{:?}", asked.warnings());
    assert!(
        matches!(asked.warnings(), [Warning::VelocityJump { interface, .. }] if interface == "overlap"),
        "{:?}",
        asked.warnings()
    );
    let _ = |e: Error| matches!(e, Error::MultipliersUnsolved { .. });
}

/// A random state of high frequency over so many steps of the run.
fn shaken(m: usize, implicit: bool, steps: usize) -> Coupled<f64> {
    let line = Line {
        step: TimeStep::Seconds(if implicit { 20.0 } else { 0.9 * m as f64 }),
        own: if implicit {
            [OwnStep::Implicit; 2]
        } else {
            [OwnStep::Same, OwnStep::Ratio(m)]
        },
        ..short()
    };
    let shaken = line.subdomains(&rest, &rest).unwrap().into_iter().zip([2, 1]);
    let shaken = shaken.map(|(s, seed)| {
        let mut next = noise(seed);
        let noise: Vec<f64> = s.model().nodes().iter().map(|_| next()).collect();
        let n = noise.len();
        let v = (0..n).map(|k| noise[k] - noise[(k + 1) % n]).collect();
        s.with_initial(vec![0.0; n], v).unwrap()
    });
    let mut run = line.build_with(shaken.collect()).unwrap();
    run.run(steps, &mut Silent).unwrap();
    run
}

/// B.2: under noise models part by far more than the formula for pulses says; the library warns of it.
#[test]
fn noise_parts_models_with_own_steps_and_the_library_says_so() {
    for (m, implicit) in [(1, false), (2, false), (3, false)] {
        for steps in [1_000, 10_000] {
            let run = shaken(m, implicit, steps);
            let jump = run.displacement_jumps()[0];
            let warned = run
                .warnings()
                .iter()
                .any(|w| matches!(w, Warning::DisplacementJump { .. }));
            println!(
                "m {m} implicit {implicit}, {steps}: jump {:.3}, share {:.3}, drift {:e}, warned {warned}",
                jump.largest,
                jump.share(),
                run.drift()
            );
            assert!(run.drift() < 1e-11);
            assert_eq!(warned, m > 1 || implicit, "{m}: {:?}", run.warnings());
        }
    }
}

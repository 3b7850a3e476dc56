//! Equal input gives equal bits for any number of threads.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid::{busy, solved, stepping};
use arlequin::core::{Coupled, H1Gradient, OwnStep, Silent, Solver, TimeStep};
use arlequin_studies::line::Line;

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
}

fn bits(c: &Coupled<f64>) -> Vec<u64> {
    let states = c
        .subdomains()
        .iter()
        .flat_map(|s| s.state().q.iter().chain(&s.state().v));
    let energy = c.last_energy().unwrap();
    states
        .chain([&energy.invariant, &energy.kinetic, &energy.drift])
        .map(|x| x.to_bits())
        .collect()
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let bits_on = |threads: usize| {
        pool(threads).install(|| {
            let mut c = busy(Box::new(H1Gradient::new(0.1).unwrap()));
            c.run(60, &mut Silent).unwrap();
            bits(&c)
        })
    };
    let serial = bits_on(1);
    assert_eq!(serial, bits_on(1), "two runs");
    assert_eq!(serial, bits_on(2), "one and two threads");
    assert_eq!(serial, bits_on(3), "one and three threads");
}

/// Own steps of the coarse and the fine body.
const OWN: [[OwnStep<f64>; 2]; 2] = [
    [OwnStep::Same, OwnStep::Ratio(3)],
    [OwnStep::Implicit, OwnStep::Ratio(2)],
];

const GRADIENTS: Solver<f64> = Solver::ConjugateGradients {
    tolerance: 1e-6,
    max_iterations: 50,
};

#[test]
fn own_steps_give_the_same_bits_on_any_number_of_threads_and_after_a_restart() {
    for (own_steps, solver) in OWN.into_iter().zip([Solver::Auto, GRADIENTS]) {
        let build = || solved(Box::new(H1Gradient::new(0.1).unwrap()), own_steps, solver);
        let bits_on = |threads: usize| {
            pool(threads).install(|| {
                let mut c = build();
                c.run(20, &mut Silent).unwrap();
                bits(&c)
            })
        };
        let serial = bits_on(1);
        assert_eq!(serial, bits_on(2), "{own_steps:?}: one and two threads");
        assert_eq!(serial, bits_on(3), "{own_steps:?}: one and three threads");
        let resumed = pool(1).install(|| {
            let mut first = build();
            first.run(9, &mut Silent).unwrap();
            let snapshot = first.snapshot().unwrap();
            let mut second = build();
            second.run(2, &mut Silent).unwrap();
            second.restore(&snapshot).unwrap();
            second.run(11, &mut Silent).unwrap();
            bits(&second)
        });
        assert_eq!(serial, resumed, "{own_steps:?}: after a restart");
    }
}

#[test]
fn a_state_of_other_own_steps_is_refused() {
    let [mut first, mut second] =
        OWN.map(|own_steps| stepping(Box::new(H1Gradient::new(0.1).unwrap()), own_steps));
    let mut snapshot = first.snapshot().unwrap();
    snapshot.dt = second.dt();
    let text = second.restore(&snapshot).unwrap_err().to_string();
    assert!(
        text.contains("own steps") && text.contains("[1, 3]") && text.contains("[1, 2]"),
        "{text}"
    );
    snapshot.dt = first.dt();
    first.restore(&snapshot).unwrap();
}

/// An overlap of 18 000 particles gives the same bits on any number of threads: the sums of multipliers over
/// particles are divided among threads, also within a row.
#[test]
fn an_overlap_large_enough_for_several_threads_gives_the_same_bits_on_each() {
    let bits_on = |threads: usize| {
        pool(threads).install(|| {
            let line = Line {
                overlap: 18_000.0,
                coarse_elements: 1_900,
                fine_bonds: 19_000,
                own: [OwnStep::Same, OwnStep::Ratio(3)],
                step: TimeStep::Seconds(2.0),
                ..Line::default()
            };
            let wavy = |x: f64| (0.0, (0.7 * x).sin() + (0.03 * x).cos());
            let mut c = line.build(&wavy, &wavy).unwrap();
            c.run(10, &mut Silent).unwrap();
            assert!(c.drift() < 1e-13, "{threads} threads: {:e}", c.drift());
            assert!(c.constraint_residual() < 1e-13, "{:e}", c.constraint_residual());
            bits(&c)
        })
    };
    let serial = bits_on(1);
    assert_eq!(serial, bits_on(2), "one and two threads");
    assert_eq!(serial, bits_on(3), "one and three threads");
}

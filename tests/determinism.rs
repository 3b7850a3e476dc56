//! Same input, same bits, for any number of threads.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[allow(dead_code, reason = "each test binary uses its part of the shared setting")]
mod support;

use arlequin::core::{Coupled, H1Gradient, Silent, Solver};
use support::solid::busy;

const GRADIENTS: Solver<f64> = Solver::ConjugateGradients {
    tolerance: 1e-6,
    max_iterations: 50,
};

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
    for solver in [Solver::Auto, GRADIENTS] {
        same_bits(solver);
    }
}

fn same_bits(solver: Solver<f64>) {
    let with = |threads: usize| {
        pool(threads).install(|| {
            let mut c = busy(Box::new(H1Gradient::new(0.1).unwrap()), solver);
            c.run(60, &mut Silent).unwrap();
            bits(&c)
        })
    };
    let one = with(1);
    assert_eq!(one, with(1), "two runs");
    assert_eq!(one, with(2), "one and two threads");
    assert_eq!(one, with(3), "one and three threads");
}

//! A step in the steady state allocates nothing on any thread, nor does the evaluation of natural-neighbour
//! functions. There is only one test, because the counter sees the whole process.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[allow(dead_code, reason = "each test binary uses its part of the shared setting")]
#[path = "it/support/mod.rs"]
mod support;

use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::natural::{Interpolant, Scratch};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{H1Gradient, H1Strain, Junction, OwnStep, Silent, Solver};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use support::chain::{Chain, ratios};
use support::solid::solved;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn steady_state_allocates_nothing() {
    steps();
    natural_neighbours();
}

fn natural_neighbours() {
    let mut next = arlequin_studies::noise(5);
    let mut cloud = |n: usize, s: f64| -> Vec<_> {
        (0..n)
            .map(|_| Point3::new(s * next(), s * next(), s * next()))
            .collect()
    };
    let domain = Domain::new(&cloud(2000, 1.0), &Surface::convex_hull()).unwrap();
    let points = cloud(500, 0.7);
    for kind in [Interpolant::Sibson, Interpolant::Laplace] {
        let mut scratch = Scratch::new();
        let mut evaluate = || {
            points.iter().for_each(|x| {
                let row = domain.shape_with_gradients(kind, x, &mut scratch).unwrap();
                assert!((row.values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            });
        };
        evaluate();
        let region = Region::new(ALLOCATOR);
        evaluate();
        assert_eq!(
            region.change().allocations,
            0,
            "{kind:?}: allocations in 500 evaluations"
        );
    }
}

fn steps() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let junctions: [Box<dyn Junction<f64>>; 2] = [
        Box::new(H1Gradient::new(0.1).unwrap()),
        Box::new(H1Strain::new(0.1).unwrap()),
    ];
    let own_steps = [
        [OwnStep::Same, OwnStep::Ratio(3)],
        [OwnStep::Implicit, OwnStep::Ratio(2)],
    ];
    let gradients = Solver::ConjugateGradients {
        tolerance: 1e-6,
        max_iterations: 50,
    };
    let solvers = [Solver::Auto, gradients];
    for ((junction, own_steps), solver) in junctions.into_iter().zip(own_steps).zip(solvers) {
        let name = format!("{} with {own_steps:?}", junction.name());
        let count = pool.install(|| {
            let mut c = solved(junction, own_steps, solver);
            // By then the run has stored a possible warning of the jump under this random state.
            c.run(100, &mut Silent).unwrap();
            let region = Region::new(ALLOCATOR);
            c.run(50, &mut Silent).unwrap();
            region.change().allocations
        });
        assert_eq!(count, 0, "{name}: allocations in 50 steps");
    }
    for solver in solvers {
        let chain = Chain {
            fine: 2,
            own: ratios([1, 1, 3]),
            solver,
            ..Chain::default()
        };
        let count = pool.install(|| {
            let mut c = chain.run(&|| Box::new(H1Gradient::new(0.1).unwrap())).unwrap();
            c.run(20, &mut Silent).unwrap();
            let region = Region::new(ALLOCATOR);
            c.run(50, &mut Silent).unwrap();
            region.change().allocations
        });
        assert_eq!(count, 0, "interfaces that share nodes: allocations in 50 steps");
    }
}

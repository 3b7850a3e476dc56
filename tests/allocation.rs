//! A step in the steady state allocates nothing, on any thread. One test only: the counter sees the whole process.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[allow(dead_code, reason = "each test binary uses its part of the shared setting")]
mod support;

use arlequin::core::junction::{H1Gradient, H1Strain, Junction};
use arlequin::core::observer::Silent;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use support::solid::busy;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn a_step_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let junctions: [Box<dyn Junction<f64>>; 2] = [
        Box::new(H1Gradient::new(0.1).unwrap()),
        Box::new(H1Strain::new(0.1).unwrap()),
    ];
    for junction in junctions {
        let name = junction.name();
        let count = pool.install(|| {
            let mut c = busy(junction);
            c.run(20, &mut Silent).unwrap();
            let region = Region::new(ALLOCATOR);
            c.run(50, &mut Silent).unwrap();
            region.change().allocations
        });
        assert_eq!(count, 0, "{name}: allocations in 50 steps");
    }
}

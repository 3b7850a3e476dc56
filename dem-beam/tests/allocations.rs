//! The internal forces of a model allocate nothing, nor does a whole step of the core with its ledger.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::{Coupled, Model, Silent, Subdomain, TimeStep, Uniform, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::sync::Arc;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Returns the least bytes allocated in three rounds, since the thread of the test harness may allocate
/// during one of them.
fn least_allocation(mut work: impl FnMut()) -> usize {
    let mut round = || {
        let region = Region::new(ALLOCATOR);
        work();
        region.change().bytes_allocated
    };
    (0..3).map(|_| round()).min().unwrap_or_default()
}

/// Internal forces allocate nothing: on one thread for a small model, and on the caller's thread pool for a
/// large one. (From outside of the pool, handing work over allocates a few hundred bytes every 60 calls or
/// so.)
#[test]
fn forces_do_not_allocate() {
    for (cells, threads) in [(6, 1), (14, 1), (14, 2)] {
        let cube = lattice(Lattice::BodyCentred, [cells; 3], 1e-4).unwrap();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        for finite in [false, true] {
            let mut m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
            if finite {
                m = m.with_finite_rotations();
            }
            let n = m.layout().dofs();
            let (q, mut f) = (vec![1e-7; n], vec![0.0; n]);
            let bytes = pool.install(|| {
                (0..200).for_each(|_| m.add_internal_forces(&q, &mut f).unwrap());
                least_allocation(|| (0..100).for_each(|_| m.add_internal_forces(&q, &mut f).unwrap()))
            });
            assert_eq!(bytes, 0, "{cells} cells, {threads} threads, finite {finite}");
            let side = Subdomain::fine(m, Weights::from_weight(Arc::new(Uniform(1.0))))
                .with_initial(vec![0.0; n], vec![1e-3; n])
                .unwrap();
            let bytes = pool.install(|| {
                let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
                run.run(200, &mut Silent).unwrap();
                least_allocation(|| {
                    run.run(50, &mut Silent).unwrap();
                })
            });
            assert_eq!(
                bytes, 0,
                "step: {cells} cells, {threads} threads, finite {finite}"
            );
        }
    }
}

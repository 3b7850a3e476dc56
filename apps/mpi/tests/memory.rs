//! Largest memory of all ranks together while a run of particles is set up and steps.
//!
//! This is a binary of its own: bytes are counted for the whole process, whose threads are the ranks. So no
//! result depends on which rank is first: all of them together never have more than the sum of their largest
//! values.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

#[path = "it/support/mod.rs"]
mod support;

use arlequin_core::ranks::Communicator;
use arlequin_core::{Coupled, Partition, Silent, Subdomain, TimeStep, Uniform, Weights};
use arlequin_mpi::threads;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use peak_alloc::PeakAlloc;
use std::sync::Arc;
use support::WAIT;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const CELLS: [usize; 3] = [32, 16, 16];
const RADIUS: f64 = 1e-4;

fn stepped(model: DemModel, shared: Option<Arc<dyn Communicator>>) -> usize {
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Uniform(1.0))))
        .with_partition(Partition::Unchecked);
    let side = match shared {
        Some(c) => side.shared(c),
        None => side,
    };
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    run.run(2, &mut Silent).unwrap();
    run.subdomains()[0].model().nodes().len()
}

/// Makes the whole body on every rank and lets the run partition it.
fn shared(c: Arc<dyn Communicator>) -> usize {
    let packing = lattice(Lattice::BodyCentred, CELLS, RADIUS).unwrap();
    let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    drop(packing);
    stepped(model, Some(c))
}

/// Returns the largest memory of all ranks together, in bytes per particle of the body.
fn most(ranks: usize, work: impl Fn(Arc<dyn Communicator>) -> usize + Sync) -> f64 {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let held: usize = threads::run(ranks, 1, WAIT, work)
        .into_iter()
        .map(Result::unwrap)
        .sum();
    assert_eq!(held, 2 * CELLS.iter().product::<usize>());
    (MEMORY.peak_usage() - before) as f64 / held as f64
}

/// A whole body that is still to be partitioned has neither the kernel's tables nor the buffers of steps.
#[test]
fn ranks_never_hold_a_whole_kernel() {
    let whole = most(1, shared);
    let per_rank = (most(8, shared) - whole) / 8.0;
    assert!(
        per_rank < 0.6 * whole,
        "{per_rank} bytes per particle on every rank, {whole} on one"
    );
}

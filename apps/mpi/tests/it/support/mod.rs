//! Helpers for tests of partitioned models.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(dead_code, reason = "not every target uses all of it")]

pub(crate) mod continua;

use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Communicator, Division, Message, RankError, Reduction};
use arlequin_core::{Model, Subdomain, Weight};
use arlequin_mpi::threads;
use dem_beam::{BeamMaterial, Container, DemModel, Packing, PackingSpec};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

pub(crate) const WAIT: Duration = Duration::from_secs(20);

/// Weight that falls from 1 to 0.2 along the body.
#[derive(Debug)]
pub(crate) struct Along;

impl Weight<f64> for Along {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * (x.x / 6e-3).clamp(0.0, 1.0)
    }
}

/// Returns a bar of six units, the last of them not full.
pub(crate) fn bar(finite: bool) -> DemModel {
    static BAR: LazyLock<Packing> = LazyLock::new(|| {
        PackingSpec::quench(Container::cylinder(6e-3, 1e-3).unwrap(), 1450, 3)
            .build()
            .unwrap()
    });
    let m = DemModel::new("bar", &BAR, BeamMaterial::SILICA, 2200.0).unwrap();
    if finite { m.with_finite_rotations() } else { m }
}

/// Returns this rank's part of a body.
pub(crate) fn part(model: DemModel, communicator: Arc<dyn Communicator>) -> DemModel {
    let ranks = communicator.ranks();
    let division = Division::bisect(model.nodes().len(), &model.units(), ranks).unwrap();
    model.partition_among(&division, communicator).unwrap()
}

/// Returns the number of a particle in the whole body.
pub(crate) fn global(model: &dyn Model<f64>, particle: usize) -> usize {
    model.owned().global(particle)
}

/// Returns a number for every unknown, by its place in the whole body: displacements, then rotations.
pub(crate) fn unknowns(model: &dyn Model<f64>, size: [f64; 2]) -> Vec<f64> {
    let n = model.layout().nodes;
    let number = |k: usize| {
        let (sort, i, c) = (k / (3 * n), k / 3 % n, k % 3);
        let i = global(model, i);
        size[sort] * (1.7 * (6 * i + 3 * sort + c) as f64).sin()
    };
    (0..6 * n).map(number).collect()
}

/// Returns the bits of unknowns with the number of their particle in the whole body.
pub(crate) fn bits(model: &dyn Model<f64>, vectors: &[&[f64]]) -> Vec<(usize, Vec<u64>)> {
    let n = model.layout().nodes;
    let particle_bits = |i: usize| {
        let six = |x: &&[f64]| [&x[3 * i..3 * i + 3], &x[3 * (n + i)..3 * (n + i) + 3]].concat();
        let bits = vectors.iter().flat_map(six).map(f64::to_bits);
        (global(model, i), bits.collect())
    };
    (0..n).map(particle_bits).collect()
}

/// Results of ranks: bits by node, and sums, which must be the same on all ranks.
pub(crate) type Results = (Vec<(usize, Vec<u64>)>, Vec<f64>);
pub(crate) fn together(parts: Vec<Result<Results, RankError>>) -> Results {
    let mut joined: Results = Default::default();
    for (rank, results) in parts.into_iter().enumerate() {
        let (unknowns, sums) = results.unwrap();
        assert!(
            rank == 0 || same_bits(&sums, &joined.1),
            "rank {rank}: {sums:?} {:?}",
            joined.1
        );
        joined.0.extend(unknowns);
        joined.1 = sums;
    }
    joined.0.sort();
    joined
}

/// Asserts that `work` gives the results of one rank on each of these numbers of ranks, as threads of this
/// test.
pub(crate) fn same_on(
    ranks: &[usize],
    what: &dyn std::fmt::Debug,
    whole: &Results,
    work: impl Fn(Arc<dyn Communicator>) -> Results + Sync,
) {
    for &ranks in ranks {
        let joined = together(threads::run(ranks, 1, WAIT, &work));
        assert!(
            same_bits(&joined.1, &whole.1),
            "{ranks} ranks, {what:?}: {:?} {:?}",
            joined.1,
            whole.1
        );
        assert!(joined.0 == whole.0, "{ranks} ranks, {what:?}");
    }
}

/// Returns the result of the first of `ranks` ranks.
pub(crate) fn first<R: Send>(ranks: usize, work: impl Fn(Arc<dyn Communicator>) -> R + Sync) -> R {
    let results = threads::run(ranks, 1, WAIT, work);
    results.into_iter().next().unwrap().unwrap()
}

/// Partitions a subdomain, or leaves it whole without ranks.
pub(crate) fn shared(side: Subdomain<f64>, ranks: Option<Arc<dyn Communicator>>) -> Subdomain<f64> {
    match ranks {
        Some(c) => side.shared(c),
        None => side,
    }
}

pub(crate) fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// Transport that counts the bytes that this rank sends in messages and passes to reductions.
#[derive(Debug)]
pub(crate) struct Counted {
    inner: Arc<dyn Communicator>,
    bytes: [AtomicU64; 2],
}

impl Counted {
    pub(crate) fn new(inner: Arc<dyn Communicator>) -> Arc<Self> {
        let bytes = Default::default();
        Arc::new(Self { inner, bytes })
    }

    /// Returns the bytes since the last call.
    pub(crate) fn take(&self) -> [f64; 2] {
        self.bytes.each_ref().map(|b| b.swap(0, Relaxed) as f64)
    }
}

impl Communicator for Counted {
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn exchange(&self, messages: &mut [Message]) -> Result<(), RankError> {
        let numbers: usize = messages.iter().map(|m| m.out.len()).sum();
        self.bytes[0].fetch_add(8 * numbers as u64, Relaxed);
        self.inner.exchange(messages)
    }
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        self.bytes[1].fetch_add(8 * words.len() as u64, Relaxed);
        self.inner.reduce(words, how)
    }
    fn abandon(&self, why: &str) {
        self.inner.abandon(why);
    }
}

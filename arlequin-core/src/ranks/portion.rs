//! This rank's part of a partitioned model, and collective operations over all ranks.

use super::{Communicator, Division, Exact, RankError, Reduction, UNIT, Unit, WORDS, agree};
use crate::scalar::dot;
use crate::{DofLayout, Real, parallel};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Partial sums per parallel task.
const GRAIN: usize = 8;

/// This rank's part of a partitioned model: the units that it owns. Their nodes keep the order of the model
/// and have local numbers from zero.
#[derive(Debug)]
pub struct Portion {
    communicator: Arc<dyn Communicator>,
    division: Division,
    units: Vec<u32>,
    nodes: usize,
    failure: OnceLock<RankError>,
}

impl Portion {
    /// Returns the part that the rank of `communicator` owns.
    ///
    /// # Errors
    /// [`RankError::Length`] for a division among another number of ranks.
    pub fn new(division: Division, communicator: Arc<dyn Communicator>) -> Result<Self, RankError> {
        let (rank, ranks) = (communicator.rank(), communicator.ranks());
        if division.ranks() != ranks {
            return Err(RankError::Length {
                rank,
                peer: rank,
                expected: ranks,
                found: division.ranks(),
            });
        }
        let units = division.units_of(rank);
        let size = |u: &u32| UNIT.min(division.nodes() - *u as usize * UNIT);
        Ok(Self {
            nodes: units.iter().map(size).sum(),
            units,
            division,
            communicator,
            failure: OnceLock::new(),
        })
    }

    /// Partitions a model by the work of its `units` and returns this rank's part. `digest`: digest of `what`
    /// all ranks must have alike. Collective.
    ///
    /// # Errors
    /// [`RankError::Differ`] if digests differ; errors of [`Division::bisect`].
    pub fn bisected(
        communicator: &Arc<dyn Communicator>,
        (what, digest): (&str, u64),
        nodes: usize,
        units: &[Unit],
    ) -> Result<Arc<Self>, RankError> {
        agree(&**communicator, what, digest)?;
        let division = Division::bisect(nodes, units, communicator.ranks())?;
        Ok(Arc::new(Self::new(division, communicator.clone())?))
    }

    /// Returns the transport between ranks.
    #[must_use]
    pub fn communicator(&self) -> &dyn Communicator {
        &*self.communicator
    }

    /// Returns the distribution of units among ranks.
    #[must_use]
    pub fn division(&self) -> &Division {
        &self.division
    }

    /// Returns the number of nodes that this rank owns.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Returns the number in the whole model of a node of this rank.
    ///
    /// # Panics
    /// If this rank has no such node.
    #[must_use]
    pub fn global(&self, node: usize) -> usize {
        self.units[node / UNIT] as usize * UNIT + node % UNIT
    }

    /// Returns the local number of a node of the whole model; `None` if another rank owns it.
    #[must_use]
    pub fn local(&self, node: usize) -> Option<usize> {
        let unit = self.units.binary_search(&((node / UNIT) as u32)).ok()?;
        Some(unit * UNIT + node % UNIT)
    }

    /// Returns the sums over all ranks (all-reduce). NaN after a failure of the transport
    /// ([`Self::failure`]). Collective.
    pub fn total<const N: usize>(&self, sums: [Exact; N]) -> [f64; N] {
        let mut words = [[0; WORDS]; N];
        words.iter_mut().zip(sums).for_each(|(w, e)| *w = e.words());
        if !self.reduce(words.as_flattened_mut(), Reduction::Sum) {
            return [f64::NAN; N];
        }
        words.map(|w| Exact::from_words(w).value())
    }

    /// Replaces each entry by its sum over all ranks, in one all-reduce. NaN as in [`Self::total`].
    /// Collective.
    pub fn all_reduce(&self, sums: &mut [Exact]) {
        let mut words: Vec<_> = sums.iter().map(|e| e.words()).collect();
        let works = self.reduce(words.as_flattened_mut(), Reduction::Sum);
        for (sum, words) in sums.iter_mut().zip(words) {
            *sum = Exact::from_words(words);
            if !works {
                sum.add(f64::NAN);
            }
        }
    }

    /// Returns the largest of the ranks' numbers, which must not be negative. NaN if one of them is NaN or
    /// after a failure of the transport. Collective.
    pub fn largest(&self, value: f64) -> f64 {
        // Non-negative numbers have the order of their bits, with NaN above all others.
        let mut words = [value.abs().to_bits().cast_signed()];
        if self.reduce(&mut words, Reduction::Largest) {
            f64::from_bits(words[0].cast_unsigned())
        } else {
            f64::NAN
        }
    }

    /// Returns the largest of the ranks' numbers, of either sign. NaN after a failure of the transport.
    /// Collective.
    pub fn highest(&self, value: f64) -> f64 {
        // Maps bits to integers in the order of the numbers; applied twice it gives the bits back.
        let ordered = |bits: i64| bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed();
        let mut words = [ordered(value.to_bits().cast_signed())];
        if self.reduce(&mut words, Reduction::Largest) {
            f64::from_bits(ordered(words[0]).cast_unsigned())
        } else {
            f64::NAN
        }
    }

    /// Combines the words of all ranks. Returns whether communication works ([`Self::failure`]). Collective.
    pub(crate) fn reduce(&self, words: &mut [i64], how: Reduction) -> bool {
        self.failure.get().is_none() && self.keep(self.communicator.reduce(words, how)).is_ok()
    }

    /// Returns the lists of all ranks, one after another in the order of ranks (all-gather). Collective.
    ///
    /// # Errors
    /// Errors of the transport, which [`Self::failure`] remembers.
    pub fn all_gather(&self, list: &[i64]) -> Result<Vec<i64>, RankError> {
        let (rank, ranks) = (self.communicator.rank(), self.communicator.ranks());
        let mut counts = vec![0; ranks];
        counts[rank] = list.len() as i64;
        self.keep(self.communicator.reduce(&mut counts, Reduction::Sum))?;
        // An all-gather by all-reduce: each rank adds its words where all others add zeros.
        let before: i64 = counts[..rank].iter().sum();
        let total: i64 = counts.iter().sum();
        if total == 0 {
            return Ok(Vec::new());
        }
        let mut words = vec![0; total as usize];
        words[before as usize..][..list.len()].copy_from_slice(list);
        self.keep(self.communicator.reduce(&mut words, Reduction::Sum))?;
        Ok(words)
    }

    /// Returns whether `flag` is true on any rank. Collective.
    ///
    /// # Errors
    /// Errors of the transport, which [`Self::failure`] remembers.
    pub fn any(&self, flag: bool) -> Result<bool, RankError> {
        let mut words = [i64::from(flag)];
        self.keep(self.communicator.reduce(&mut words, Reduction::Largest))?;
        Ok(words[0] > 0)
    }

    /// Remembers the first failure of the transport for [`Self::failure`] and returns the result.
    pub(crate) fn keep<R>(&self, result: Result<R, RankError>) -> Result<R, RankError> {
        result.inspect_err(|e| {
            self.failure.get_or_init(|| e.clone());
        })
    }

    /// Returns the first failure of the transport, if any. All later collective operations fail.
    #[must_use]
    pub fn failure(&self) -> Option<&RankError> {
        self.failure.get()
    }
}

/// Sums over all nodes of a model; `part` sums over a range of this rank's nodes. The result has the same
/// bits for any number of threads and ranks. NaN after a failure of the transport. Collective.
pub fn sum<T: Real, const N: usize>(
    nodes: usize,
    portion: Option<&Portion>,
    part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
) -> [T; N] {
    sum_over_ranks(portion, unit_sums(nodes, part, parallel::pays(nodes * N)))
}

/// Adds `Σ x y` over displacements and rotations of this rank's nodes, one term per unit.
///
/// ```
/// use arlequin_core::DofLayout;
/// use arlequin_core::ranks::{Exact, add_products};
/// let layout = DofLayout { nodes: 2, components: 1, rotations: 0 };
/// let mut sum = Exact::zero();
/// add_products(&layout, &[1.0, 2.0], &[3.0, 4.0], &mut sum);
/// assert_eq!(sum.value(), 11.0);
/// ```
pub fn add_products<T: Real>(layout: &DofLayout, x: &[T], y: &[T], total: &mut Exact) {
    let (d, r, first) = (layout.components, layout.rotations, layout.translations());
    let part = |n: Range<usize>| {
        let moving = d * n.start..d * n.end;
        let turning = first + r * n.start..first + r * n.end;
        [dot(&x[moving.clone()], &y[moving]) + dot(&x[turning.clone()], &y[turning])]
    };
    let [sum] = unit_sums(layout.nodes, &part, parallel::pays(x.len()));
    *total += sum;
}

/// Sums over the units of `nodes` nodes.
fn unit_sums<T: Real, const N: usize>(
    nodes: usize,
    part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    parallel: bool,
) -> [Exact; N] {
    let sum_of_unit = |u: usize| part(u * UNIT..nodes.min((u + 1) * UNIT));
    exact_sums(0..nodes.div_ceil(UNIT), &sum_of_unit, parallel)
}

/// Sums over a range of partial sums, exactly, so that their order does not matter.
pub(super) fn exact_sums<T: Real, const N: usize>(
    range: Range<usize>,
    of: &(dyn Fn(usize) -> [T; N] + Sync),
    parallel: bool,
) -> [Exact; N] {
    if parallel && range.len() > GRAIN {
        let middle = range.start + range.len() / 2;
        let (mut a, b) = rayon::join(
            || exact_sums(range.start..middle, of, true),
            || exact_sums(middle..range.end, of, true),
        );
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        return a;
    }
    let mut out = [Exact::zero(); N];
    for piece in range {
        let sums = out.iter_mut().zip(of(piece));
        sums.for_each(|(sum, x)| sum.add(x.as_f64()));
    }
    out
}

/// Returns the global sums of all ranks' partial sums, or `local_sums` for a model that is not partitioned.
pub(super) fn sum_over_ranks<T: Real, const N: usize>(
    portion: Option<&Portion>,
    local_sums: [Exact; N],
) -> [T; N] {
    let total = match portion {
        Some(p) => p.total(local_sums),
        None => local_sums.map(Exact::value),
    };
    total.map(T::of)
}

/// Returns the largest of the ranks' numbers, which must not be negative.
pub(crate) fn largest<T: Real>(portion: Option<&Portion>, value: T) -> T {
    portion.map_or(value, |p| T::of(p.largest(value.as_f64())))
}

#[cfg(test)]
mod tests {
    use super::sum;

    #[test]
    fn sums_over_units_have_the_same_bits_on_any_number_of_threads() {
        let x: Vec<f64> = (0..100_003).map(|i| (f64::from(i) * 0.37).sin()).collect();
        let sums_on = |threads: usize| -> [f64; 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let part = |r: std::ops::Range<usize>| [x[r.clone()].iter().sum(), r.len() as f64];
            pool.map_or([f64::NAN; 2], |p| p.install(|| sum(x.len(), None, &part)))
        };
        let reference = sums_on(1);
        assert!((reference[0] - x.iter().sum::<f64>()).abs() < 1e-10);
        assert_eq!(reference[1].to_bits(), 100_003_f64.to_bits());
        for threads in [2, 3] {
            assert_eq!(
                reference.map(f64::to_bits),
                sums_on(threads).map(f64::to_bits),
                "{threads} threads"
            );
        }
    }
}

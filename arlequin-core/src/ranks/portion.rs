//! This rank's part of a partitioned model, and collective operations over all ranks.

use super::{Communicator, Division, RankError, Reduction, UNIT, Unit, agree};
use crate::exact::{Exact, WORDS};
use std::sync::{Arc, OnceLock};

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

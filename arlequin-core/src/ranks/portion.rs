//! This rank's part of a partitioned model.

use super::{Communicator, Division, RankError, Reduction, UNIT};
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
    pub(crate) fn new(division: Division, communicator: Arc<dyn Communicator>) -> Result<Self, RankError> {
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

    /// Combines the words of all ranks. Returns whether communication works ([`Self::failure`]). Collective.
    pub(crate) fn reduce(&self, words: &mut [i64], how: Reduction) -> bool {
        self.failure.get().is_none() && self.keep(self.communicator.reduce(words, how)).is_ok()
    }

    /// Remembers the first failure of the transport for [`Self::failure`] and returns the result.
    pub(crate) fn keep<R>(&self, result: Result<R, RankError>) -> Result<R, RankError> {
        result.inspect_err(|e| {
            self.failure.get_or_init(|| e.clone());
        })
    }

    /// Returns the first failure of the transport, if any. All later collective operations fail.
    pub(crate) fn failure(&self) -> Option<&RankError> {
        self.failure.get()
    }
}

//! Sums over some nodes of a model, split where these pass from unit to unit.

use super::sums::exact_sums;
use super::{Owned, UNIT};
use crate::{Exact, Real, parallel};
use std::ops::Range;

/// Places at which an ascending list of nodes passes from one unit to the next, for sums over the list.
#[derive(Debug, Clone)]
pub(crate) struct Cuts {
    /// The places, and the end of the list.
    places: Vec<usize>,
    owned: Owned,
}

impl Cuts {
    /// Splits a list of owned nodes at units. Local and global numbers give the same units.
    pub(crate) fn at_units(owned: Owned, nodes: impl Iterator<Item = usize>) -> Self {
        Self::at_blocks(UNIT, owned, nodes)
    }

    /// Splits a list of any numbers at blocks of `size`. Sums go over the ranks of `owned`.
    pub(crate) fn at_blocks(size: usize, owned: Owned, items: impl Iterator<Item = usize>) -> Self {
        let (mut cuts, mut last, mut count) = (Vec::new(), None, 0);
        for item in items {
            let unit = item / size;
            if last.replace(unit) != Some(unit) {
                cuts.push(count);
            }
            count += 1;
        }
        cuts.push(count);
        Self { places: cuts, owned }
    }

    /// Returns the nodes over whose ranks the sums go.
    pub(crate) fn owned(&self) -> &Owned {
        &self.owned
    }

    /// Sums over the lists of all ranks. `part` returns the sum over a range of this rank's list; `numbers`
    /// is the number of values that it reads per entry. The result has the same bits for any number of
    /// threads and ranks. NaN after a failure of the transport. Collective for a partitioned model.
    pub(crate) fn sum<T: Real, const N: usize>(
        &self,
        numbers: usize,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    ) -> [T; N] {
        self.owned.total(self.local_sums(numbers, part)).map(T::of)
    }

    /// Sums over the list of this rank, as in [`Self::sum`].
    pub(crate) fn local_sums<T: Real, const N: usize>(
        &self,
        numbers: usize,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    ) -> [Exact; N] {
        let count = self.places.last().copied().unwrap_or_default();
        let block_sum = |k: usize| part(self.places[k]..self.places[k + 1]);
        let blocks = 0..self.places.len() - 1;
        exact_sums(blocks, &block_sum, parallel::pays(count * numbers))
    }
}

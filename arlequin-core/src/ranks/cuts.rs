//! Sums over some nodes of a model, split where these pass from unit to unit.

use super::portion::{exact_sums, sum_over_ranks};
use super::{Portion, UNIT};
use crate::{Real, parallel};
use std::ops::Range;

/// Places at which an ascending list of nodes passes from one unit to the next, and its end.
#[derive(Debug, Clone)]
pub(crate) struct Cuts(Vec<usize>);

impl Cuts {
    /// Splits a list of nodes at units. Local and global numbers give the same units.
    pub(crate) fn at_units(nodes: impl Iterator<Item = usize>) -> Self {
        Self::at_blocks(UNIT, nodes)
    }

    /// Splits a list of any numbers at blocks of `size`.
    pub(crate) fn at_blocks(size: usize, items: impl Iterator<Item = usize>) -> Self {
        let (mut cuts, mut last, mut count) = (Vec::new(), None, 0);
        for item in items {
            let unit = item / size;
            if last.replace(unit) != Some(unit) {
                cuts.push(count);
            }
            count += 1;
        }
        cuts.push(count);
        Self(cuts)
    }

    /// Sums over the whole list on all ranks; `part` sums over a range of this rank's places, with `numbers`
    /// numbers each. The result has the same bits for any number of threads and ranks. NaN after a failure of
    /// the transport. Collective for a partitioned model.
    pub(crate) fn sum<T: Real, const N: usize>(
        &self,
        portion: Option<&Portion>,
        numbers: usize,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    ) -> [T; N] {
        let count = self.0.last().copied().unwrap_or_default();
        let block_sum = |k: usize| part(self.0[k]..self.0[k + 1]);
        let local_sums = exact_sums(0..self.0.len() - 1, &block_sum, parallel::pays(count * numbers));
        sum_over_ranks(portion, local_sums)
    }
}

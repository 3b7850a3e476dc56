//! Sums over some nodes of a model, cut where these pass from unit to unit.

use super::portion::{everywhere, pieces};
use super::{Portion, UNIT};
use crate::{Real, parallel};
use std::ops::Range;

/// Where an ascending list of nodes passes from one unit to the next.
#[derive(Debug, Clone)]
pub(crate) struct Cuts(Vec<usize>);

impl Cuts {
    /// Of nodes by their numbers here or in the whole model: units are the same.
    pub(crate) fn of(nodes: impl Iterator<Item = usize>) -> Self {
        Self::every(UNIT, nodes)
    }

    /// The same for other things that come in blocks of so many.
    pub(crate) fn every(size: usize, all: impl Iterator<Item = usize>) -> Self {
        let (mut cuts, mut last, mut count) = (Vec::new(), None, 0);
        for one in all {
            let unit = one / size;
            if last.replace(unit) != Some(unit) {
                cuts.push(count);
            }
            count += 1;
        }
        cuts.push(count);
        Self(cuts)
    }

    /// Sums over the list, on whatever ranks its nodes are: `part` sums over a range of the places here, of
    /// so many `numbers` each. The same bits for any number of threads and ranks, all of which must ask.
    /// Not numbers once ranks do not hear of each other any more.
    pub(crate) fn sum<T: Real, const N: usize>(
        &self,
        portion: Option<&Portion>,
        numbers: usize,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    ) -> [T; N] {
        let all = self.0.last().copied().unwrap_or_default();
        let of = |k: usize| part(self.0[k]..self.0[k + 1]);
        let own = pieces(0..self.0.len() - 1, &of, parallel::pays(all * numbers));
        everywhere(portion, own)
    }
}

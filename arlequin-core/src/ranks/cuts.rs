//! Sums over some nodes of a model, cut where these pass from unit to unit.

use super::{Exact, Portion, UNIT};
use crate::{Real, parallel};
use std::ops::Range;

/// Units per unit of parallel work.
const GRAIN: usize = 8;

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

    /// Sums over the list, on whatever ranks its nodes are: `part` sums over a range of the places here, of so many `numbers`
    /// each. The same bits for any number of threads and ranks, all of which must ask. Not numbers once ranks do not hear of
    /// each other any more.
    pub(crate) fn sum<T: Real, const N: usize>(
        &self,
        portion: Option<&Portion>,
        numbers: usize,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    ) -> [T; N] {
        let all = self.0.last().copied().unwrap_or_default();
        let own = self.within(0..self.0.len() - 1, part, parallel::pays(all * numbers));
        let total = match portion {
            Some(p) => p.total(own),
            None => own.map(Exact::value),
        };
        total.map(T::of)
    }

    fn within<T: Real, const N: usize>(
        &self,
        range: Range<usize>,
        part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
        parallel: bool,
    ) -> [Exact; N] {
        if parallel && range.len() > GRAIN {
            let middle = range.start + range.len() / 2;
            let (mut a, b) = rayon::join(
                || self.within(range.start..middle, part, true),
                || self.within(middle..range.end, part, true),
            );
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            return a;
        }
        let mut out = [Exact::zero(); N];
        for cut in self.0[range.start..=range.end].windows(2) {
            let of = part(cut[0]..cut[1]);
            out.iter_mut().zip(of).for_each(|(sum, x)| sum.add(x.as_f64()));
        }
        out
    }
}

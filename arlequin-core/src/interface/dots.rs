//! Scalar products of multiplier vectors.

use super::parts::{BLOCK, Parts};
use crate::Real;
use crate::owned::{Cuts, Owned};
use nalgebra::Vector3;
use std::ops::Range;

/// Scalar products summed by blocks of multipliers with one owner: the same bits on any number of ranks.
#[derive(Debug)]
pub(super) struct Dots(Cuts);

impl Dots {
    /// Prepares products of vectors of `rows` multipliers that this rank holds entirely.
    pub(super) fn new(rows: usize) -> Self {
        Self(Cuts::at_blocks(BLOCK, Owned::whole(rows), 0..rows))
    }

    /// Prepares products of vectors that hold only the multipliers each rank owns.
    pub(super) fn in_parts<T: Real>(parts: &Parts<T>) -> Self {
        let rows = parts.owned().iter().map(|row| *row as usize);
        Self(Cuts::at_blocks(BLOCK, parts.nodes(), rows))
    }

    /// Returns `Σ a b` of each component. Collective if multipliers are distributed.
    pub(super) fn products<T: Real, const N: usize>(&self, a: &[T], b: &[T]) -> Vector3<T> {
        let (a, b) = (a.as_chunks::<N>().0, b.as_chunks::<N>().0);
        let part = |range: Range<usize>| {
            let mut sum = [T::zero(); N];
            for (a, b) in a[range.clone()].iter().zip(&b[range]) {
                (0..N).for_each(|c| sum[c] += a[c] * b[c]);
            }
            sum
        };
        let sums = self.0.sum(N, &part);
        Vector3::from_fn(|c, _| sums.get(c).copied().unwrap_or_else(T::zero))
    }

    /// Returns `Σ a b` over all `shared` components.
    pub(super) fn total<T: Real>(&self, shared: usize, a: &[T], b: &[T]) -> T {
        match shared {
            1 => self.products::<T, 1>(a, b),
            2 => self.products::<T, 2>(a, b),
            _ => self.products::<T, 3>(a, b),
        }
        .sum()
    }
}

//! Sums over multipliers.

use super::parts::{BLOCK, Parts};
use crate::Real;
use crate::ranks::{Cuts, Portion};
use nalgebra::Vector3;
use std::ops::Range;
use std::sync::Arc;

/// Scalar products of vectors of multipliers, by blocks that one rank adds up: the same bits on any number of ranks.
#[derive(Debug)]
pub(super) struct Dots {
    cuts: Cuts,
    /// Where each rank has its own multipliers only.
    portion: Option<Arc<Portion>>,
}

impl Dots {
    /// Of vectors of so many rows, all of them here.
    pub(super) fn new(rows: usize) -> Self {
        Self {
            cuts: Cuts::every(BLOCK, 0..rows),
            portion: None,
        }
    }

    /// Of vectors of the rows that each rank adds up.
    pub(super) fn in_parts<T: Real>(parts: &Parts<T>) -> Self {
        Self {
            cuts: Cuts::every(BLOCK, parts.mine().iter().map(|row| *row as usize)),
            portion: Some(parts.portion().clone()),
        }
    }

    /// `Σ a b` of every component.
    pub(super) fn of<T: Real, const N: usize>(&self, a: &[T], b: &[T]) -> Vector3<T> {
        let (a, b) = (a.as_chunks::<N>().0, b.as_chunks::<N>().0);
        let part = |range: Range<usize>| {
            let mut sum = [T::zero(); N];
            for (a, b) in a[range.clone()].iter().zip(&b[range]) {
                (0..N).for_each(|c| sum[c] += a[c] * b[c]);
            }
            sum
        };
        let sums = self.cuts.sum(self.portion.as_deref(), N, &part);
        Vector3::from_fn(|c, _| sums.get(c).copied().unwrap_or_else(T::zero))
    }

    /// `Σ a b` over all components, of which each row has `shared`.
    pub(super) fn all<T: Real>(&self, shared: usize, a: &[T], b: &[T]) -> T {
        match shared {
            1 => self.of::<T, 1>(a, b),
            2 => self.of::<T, 2>(a, b),
            _ => self.of::<T, 3>(a, b),
        }
        .sum()
    }
}

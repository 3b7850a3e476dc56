//! Sides of multipliers that are solved for together, and products with their matrices.

use super::parts::Parts;
use super::transfer::{self, Transfer};
use crate::{Owned, Real};
use std::ops::{Deref, DerefMut};

/// Sides of one interface or of a joint system. The jump is the first side minus all others.
#[derive(Debug)]
pub(crate) struct Sides<T> {
    transfers: Vec<Transfer<T>>,
    /// `None` if every model is whole on every rank.
    parts: Option<Parts<T>>,
}

impl<T> Deref for Sides<T> {
    type Target = [Transfer<T>];
    fn deref(&self) -> &[Transfer<T>] {
        &self.transfers
    }
}

impl<T> DerefMut for Sides<T> {
    fn deref_mut(&mut self) -> &mut [Transfer<T>] {
        &mut self.transfers
    }
}

impl<T: Real> Sides<T> {
    pub(super) fn new(transfers: Vec<Transfer<T>>) -> Self {
        Self {
            transfers,
            parts: None,
        }
    }

    /// Restricts each side to the nodes that this rank owns. `owned` has an entry per side.
    pub(super) fn restrict(&mut self, owned: &[&Owned]) {
        self.parts = Parts::new(&self.transfers, owned);
        let sides = self.transfers.iter_mut().zip(owned);
        sides.for_each(|(side, owned)| side.restrict(owned));
    }

    /// Returns the sums over partitioned models, if any model is partitioned.
    pub(super) fn parts(&self) -> Option<&Parts<T>> {
        self.parts.as_ref()
    }

    /// Returns whether any model is partitioned.
    pub(crate) fn in_parts(&self) -> bool {
        self.parts.is_some()
    }

    /// Writes the jump for the multipliers that this rank owns. Does nothing if no model is partitioned.
    /// Collective.
    pub(super) fn owned_jump(&mut self, out: &mut [T]) {
        if let Some(parts) = &mut self.parts {
            parts.owned_jump(&self.transfers, out);
        }
    }

    /// Broadcasts each rank's multipliers, so that `out` holds all of them on every rank. Collective.
    pub(super) fn publish(&mut self, owned: &[T], out: &mut [T]) {
        if let Some(parts) = &mut self.parts {
            parts.publish(owned, out);
        }
    }

    /// Writes `out = B_0 x_0 − B_1 x_1 − …` on every rank, for unknowns `x` of the models or, if `None`, for
    /// what the sides hold. Collective if a model is partitioned.
    pub(super) fn jump(&mut self, x: Option<&[&[T]]>, out: &mut [T]) {
        match self.transfers.first().map(Transfer::shared) {
            Some(1) => self.jump_of::<1>(x, out),
            Some(2) => self.jump_of::<2>(x, out),
            _ => self.jump_of::<3>(x, out),
        }
    }

    fn jump_of<const N: usize>(&mut self, x: Option<&[&[T]]>, out: &mut [T]) {
        if let Some(parts) = &mut self.parts {
            return parts.jump::<N>(&self.transfers, x, out);
        }
        let side_sum = |m: usize, row: usize| self.transfers[m].row::<N>(row, x.map(|x| x[m]));
        // Rows are split among threads by the side with the most entries.
        let longest = (0..self.transfers.len()).max_by_key(|m| self.transfers[*m].nonzeros());
        let Some(longest) = longest.map(|m| &self.transfers[m]) else {
            return;
        };
        let out = out.as_chunks_mut::<N>().0;
        transfer::fill_rows(0..out.len(), out, &|row| longest.before(row), &|row| {
            subtract_others((0..self.transfers.len()).map(|m| side_sum(m, row)))
        });
    }

    /// Computes `out = S p`. Overwrites what the sides hold.
    pub(super) fn operator(&mut self, p: &[T], out: &mut [T]) {
        self.spread(p);
        // `spread` gives δ = −M⁻¹ Bᵀ p on the first side and the opposite on all others: the jump of δ is −S
        // p.
        self.jump(None, out);
        out.iter_mut().for_each(|x| *x = -*x);
    }

    /// Computes and keeps `δ = ∓M⁻¹ Bᵀ μ` on every side.
    pub(super) fn spread(&mut self, multipliers: &[T]) {
        self.transfers.iter_mut().for_each(|s| s.spread(multipliers));
    }

    /// Returns `δᵀ M δ` summed over all sides.
    pub(super) fn twice_kinetic(&self) -> T {
        self.transfers.iter().map(Transfer::twice_kinetic).sum()
    }
}

/// Returns the first item minus all others.
#[inline]
pub(super) fn subtract_others<T: Real, const N: usize>(mut sides: impl Iterator<Item = [T; N]>) -> [T; N] {
    let first = sides.next().unwrap_or([T::zero(); N]);
    sides.fold(first, |mut jump, x| {
        (0..N).for_each(|c| jump[c] -= x[c]);
        jump
    })
}

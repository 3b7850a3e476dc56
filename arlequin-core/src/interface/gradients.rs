//! Conjugate gradients from zero for `S μ = b`.
//!
//! With a fixed symmetric preconditioner `μᵀ(S μ − b) = 0` after any number of iterations. This is Galerkin's
//! condition: a kick by `μ` then changes no energy. On several ranks an iteration costs one message to each
//! neighbour and two exact global sums.

use super::iterated::{Iterated, Precondition, update};
use super::sides::Sides;
use crate::Real;
use nalgebra::Vector3;

impl<T: Real> Iterated<T> {
    /// Iterates until the residual meets the tolerance or the iterations run out. Expects `r = b`.
    pub(super) fn gradients<const N: usize>(
        &mut self,
        x: &mut [T],
        sides: &mut Sides<T>,
        preconditioner: &mut (impl Precondition<T> + ?Sized),
    ) {
        x.fill(T::zero());
        self.direction.fill(T::zero());
        self.precondition(preconditioner);
        let first = self.dots.products::<T, N>(&self.residual, &self.preconditioned);
        let mut remaining = first;
        let mut open = [0, 1, 2].map(|c| first[c] > T::zero());
        let mut share = Vector3::zeros();
        while self.iterations < self.most && open.contains(&true) {
            update::<T, N>(&mut self.direction, &self.preconditioned, &mut |p, z| {
                (0..N).for_each(|c| p[c] = z[c] + share[c] * p[c]);
            });
            self.product::<N>(sides);
            let curvature = self.dots.products::<T, N>(&self.direction, &self.image);
            let length = Vector3::from_fn(|c, _| {
                // Components iterate at once; one that is done, or whose direction lies in the null space,
                // stands still.
                open[c] &= curvature[c] > T::zero();
                if open[c] {
                    remaining[c] / curvature[c]
                } else {
                    T::zero()
                }
            });
            self.advance::<N>(x, &length);
            self.precondition(preconditioner);
            let next = self.dots.products::<T, N>(&self.residual, &self.preconditioned);
            for c in 0..3 {
                open[c] &= next[c] > first[c] * self.tolerance * self.tolerance;
                share[c] = if open[c] {
                    next[c] / remaining[c]
                } else {
                    T::zero()
                };
            }
            remaining = next;
        }
        self.unsolved = (0..3).any(|c| remaining[c] > first[c] * self.tolerance * self.tolerance);
    }
}

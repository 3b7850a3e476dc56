//! Conjugate gradients from zero for `S μ = b`.
//!
//! After any number of iterations with a fixed symmetric preconditioner `μᵀ(S μ − b) = 0`: Galerkin's condition, under which
//! a kick by `μ` changes no energy. Dependent multipliers do no harm: the system is consistent, and what acts on nothing is
//! left alone. Nothing of the step before is used: runs that are resumed make the same bits.

use super::transfer::{self, Rows, Transfer};
use crate::{Real, parallel};
use nalgebra::Vector3;
use std::ops::Range;

/// A fixed symmetric preconditioner, `z = C r`.
pub(super) trait Precondition<T> {
    /// Overwrites `z`, which holds `r`.
    fn apply(&mut self, z: &mut [T]);
}

/// How `S` is applied.
#[derive(Debug)]
pub(super) enum Apply<T> {
    /// By its own rows, the same for all components.
    Rows(Rows<T>),
    /// By `Bᵀ`, `M⁻¹` and `B` of all sides.
    Sides,
}

/// Vectors of the iteration and where it ends.
#[derive(Debug)]
pub(super) struct Gradients<T> {
    apply: Apply<T>,
    /// Components with an iteration each.
    shared: usize,
    tolerance: T,
    most: usize,
    /// Iterations of the last solve.
    pub(super) made: usize,
    /// `r`, `z`, `p`, `S p`.
    residual: Vec<T>,
    turned: Vec<T>,
    direction: Vec<T>,
    image: Vec<T>,
}

impl<T: Real> Gradients<T> {
    pub(super) fn new(apply: Apply<T>, shared: usize, size: usize, tolerance: T, most: usize) -> Self {
        let zeros = || vec![T::zero(); size];
        Self {
            apply,
            shared,
            tolerance,
            most,
            made: 0,
            residual: zeros(),
            turned: zeros(),
            direction: zeros(),
            image: zeros(),
        }
    }

    /// Stored entries.
    pub(super) fn nonzeros(&self) -> usize {
        match &self.apply {
            Apply::Rows(rows) => rows.nonzeros(),
            Apply::Sides => 0,
        }
    }

    /// `b ← μ`, components interleaved.
    pub(super) fn solve(
        &mut self,
        b: &mut [T],
        sides: &mut [Transfer<T>],
        by: &mut (impl Precondition<T> + ?Sized),
    ) {
        match self.shared {
            1 => self.solve_of::<1>(b, sides, by),
            2 => self.solve_of::<2>(b, sides, by),
            _ => self.solve_of::<3>(b, sides, by),
        }
    }

    fn solve_of<const N: usize>(
        &mut self,
        b: &mut [T],
        sides: &mut [Transfer<T>],
        by: &mut (impl Precondition<T> + ?Sized),
    ) {
        self.residual.copy_from_slice(b);
        b.fill(T::zero());
        self.direction.fill(T::zero());
        self.made = 0;
        let first = self.turn::<N>(by);
        let mut rest = first;
        let mut open = [0, 1, 2].map(|c| first[c] > T::zero());
        let mut share = Vector3::zeros();
        while self.made < self.most && open.contains(&true) {
            update::<T, N>(&mut self.direction, &self.turned, &mut |p, z| {
                (0..N).for_each(|c| p[c] = z[c] + share[c] * p[c]);
            });
            match &self.apply {
                Apply::Rows(rows) => rows.product::<N>(&self.direction, &mut self.image),
                Apply::Sides => transfer::operator(sides, &self.direction, &mut self.image),
            }
            let curvature = dots::<T, N>(&self.direction, &self.image);
            let length = Vector3::from_fn(|c, _| {
                open[c] &= curvature[c] > T::zero();
                if open[c] {
                    rest[c] / curvature[c]
                } else {
                    T::zero()
                }
            });
            update::<T, N>(b, &self.direction, &mut |x, p| {
                (0..N).for_each(|c| x[c] += length[c] * p[c]);
            });
            update::<T, N>(&mut self.residual, &self.image, &mut |r, q| {
                (0..N).for_each(|c| r[c] -= length[c] * q[c]);
            });
            self.made += 1;
            let next = self.turn::<N>(by);
            for c in 0..3 {
                open[c] &= next[c] > first[c] * self.tolerance * self.tolerance;
                share[c] = if open[c] { next[c] / rest[c] } else { T::zero() };
            }
            rest = next;
        }
    }

    /// `z = C r` and `r·z` of every component.
    fn turn<const N: usize>(&mut self, by: &mut (impl Precondition<T> + ?Sized)) -> Vector3<T> {
        self.turned.copy_from_slice(&self.residual);
        by.apply(&mut self.turned);
        dots::<T, N>(&self.residual, &self.turned)
    }
}

/// `Σ a b` of every component.
fn dots<T: Real, const N: usize>(a: &[T], b: &[T]) -> Vector3<T> {
    let (a, b) = (a.as_chunks::<N>().0, b.as_chunks::<N>().0);
    let part = |range: Range<usize>| {
        let mut sum = Vector3::zeros();
        for (a, b) in a[range.clone()].iter().zip(&b[range]) {
            (0..N).for_each(|c| sum[c] += a[c] * b[c]);
        }
        sum
    };
    parallel::sum_of(a.len(), &part)
}

/// Changes numbers of one vector by those of another, node by node.
fn update<T: Real, const N: usize>(x: &mut [T], y: &[T], one: &mut impl FnMut(&mut [T; N], &[T; N])) {
    let all = x.as_chunks_mut::<N>().0.iter_mut().zip(y.as_chunks::<N>().0);
    all.for_each(|(x, y)| one(x, y));
}

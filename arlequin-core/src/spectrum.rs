//! Highest frequency of a model by Lanczos iteration, and the critical step of velocity Verlet from it.

use crate::model::DofLayout;
use crate::scalar::dot;
use crate::{Exact, Owned, add_products};
use crate::{Real, Result};
use nalgebra::DMatrix;
use std::ops::Range;

/// Closure that adds the internal forces at a displacement.
pub type AddForces<'a, T> = dyn FnMut(&[T], &mut [T]) -> Result<()> + 'a;

/// Most Lanczos steps for the eigenvalue itself.
const STEPS: usize = 80;

/// Most numbers that all Lanczos vectors together may take (32 MB). Beyond, each vector is made orthogonal to
/// the last two only. Round-off then brings back copies of eigenvalues that are already known, none of them
/// above the largest.
const STORED: usize = 1 << 22;

/// Most steps of [`largest_ritz`]; about sixty settle the top of the spectrum.
const LEAN: usize = 300;

/// Relative residual at which the largest Ritz value is accepted.
const RESIDUAL: f64 = 1e-4;

/// Critical step `2/ω_max` \[s\] of `M q̈ = −K q`; `f32::MAX` if nothing moves. A nonlinear model computes
/// its own in [`crate::Model::critical_step`].
///
/// # Errors
/// Errors of `add_forces`.
pub fn critical_step<T: Real>(inverse_inertia: &[T], add_forces: &mut AddForces<'_, T>) -> Result<T> {
    Ok(step_of(largest_eigenvalue(inverse_inertia, add_forces)?))
}

/// `2/√λ` \[s\] for the largest `λ = ω²` \[1/s²\]; `f32::MAX` unless it is positive.
pub fn step_of<T: Real>(largest: T) -> T {
    if largest > T::zero() {
        T::of(2.0) / largest.sqrt()
    } else {
        T::of(f64::from(f32::MAX))
    }
}

/// Critical step as of [`critical_step`], for unknowns of `layout`, or of this rank's part of a partitioned
/// model. Has the same bits on any number of ranks. Collective.
///
/// # Errors
/// Errors of `add_forces`.
pub fn critical_step_of_nodes<T: Real>(
    inverse_inertia: &[T],
    layout: DofLayout,
    owned: &Owned,
    add_forces: &mut AddForces<'_, T>,
) -> Result<T> {
    let space = Space::Nodes(layout, owned);
    Ok(step_of(largest_in(inverse_inertia, &space, add_forces)?))
}

/// Largest eigenvalue `ω²` of `M⁻¹K` \[1/s²\], where `add_forces` adds `−K q`; `inverse_inertia = 0` marks
/// prescribed unknowns. Accurate to round-off for most models. Takes at most 80 steps and stores all of their
/// vectors for small models only.
///
/// # Errors
/// Errors of `add_forces`.
pub fn largest_eigenvalue<T: Real>(inverse_inertia: &[T], add_forces: &mut AddForces<'_, T>) -> Result<T> {
    largest_in(inverse_inertia, &Space::Plain(inverse_inertia.len()), add_forces)
}

fn largest_in<T: Real>(
    inverse_inertia: &[T],
    space: &Space<'_>,
    add_forces: &mut AddForces<'_, T>,
) -> Result<T> {
    // `R K R` with `R = M^{-1/2}` is symmetric and has the eigenvalues of `M⁻¹K`; prescribed unknowns get
    // zero.
    let root: Vec<T> = inverse_inertia.iter().map(|m| m.sqrt()).collect();
    let mut basis: Vec<Vec<T>> = Vec::new();
    let mut top = T::zero();
    let stored = space.size() * STEPS <= STORED;
    let orthogonal = &mut |w: &mut [T], v: Vec<T>, t: &Tridiagonal<T>| {
        if !stored {
            t.subtract_parts(w, &v, basis.last().map_or(&[], Vec::as_slice));
            basis.clear();
            return basis.push(v);
        }
        basis.push(v);
        // Two passes make the vector orthogonal to round-off.
        (0..2).for_each(|_| space.orthogonalise(w, &basis));
    };
    lanczos((&root, space), STEPS, add_forces, orthogonal, &mut |t| {
        let previous = top;
        top = t.top()?;
        let settled = t.diagonal.len() > 21 && (top - previous).abs() <= top * T::of(1e-10);
        // A rest of round-off size: the space of the iteration holds the eigenvector already.
        Ok(settled || t.residual <= top * T::epsilon() * T::of(16.0))
    })?;
    Ok(top)
}

/// Largest Ritz value of `R K R` plus its residual, `R = diag(root)`; zero if nothing moves. The result is
/// not below the largest eigenvalue by more than a relative 1e-4, and takes memory for a few vectors. The
/// unknowns are those of `layout`, or of this rank's part of a partitioned model. Has the same bits on any
/// number of ranks. Collective.
///
/// # Errors
/// Errors of `add_forces`, which adds `−K q`.
pub fn largest_ritz<T: Real>(
    root: &[T],
    layout: DofLayout,
    owned: &Owned,
    add_forces: &mut AddForces<'_, T>,
) -> Result<T> {
    let moving = (0..root.len()).filter(|&i| root[i] > T::zero());
    let count = moving.clone().count();
    // Where little moves, vectors hold that alone: their sums would cost more than the forces.
    if 2 * count < root.len() && !owned.is_part() {
        let moving: Vec<usize> = moving.collect();
        let roots: Vec<T> = moving.iter().map(|&i| root[i]).collect();
        let (mut q, mut f) = (vec![T::zero(); root.len()], vec![T::zero(); root.len()]);
        return ritz_in(&Space::Plain(count), &roots, &mut |x, out| {
            for (&i, x) in moving.iter().zip(x) {
                (q[i], f[i]) = (*x, T::zero());
            }
            add_forces(&q, &mut f)?;
            out.iter_mut().zip(&moving).for_each(|(out, &i)| *out += f[i]);
            Ok(())
        });
    }
    ritz_in(&Space::Nodes(layout, owned), root, add_forces)
}

/// Largest Ritz value plus its residual, as in [`largest_ritz`].
fn ritz_in<T: Real>(space: &Space<'_>, root: &[T], add_forces: &mut AddForces<'_, T>) -> Result<T> {
    // The space is exhausted after as many steps as it has unknowns.
    let limit = LEAN.min(space.size());
    let (mut last, mut top) = (Vec::new(), T::zero());
    let orthogonal = &mut |w: &mut [T], v: Vec<T>, t: &Tridiagonal<T>| {
        t.subtract_parts(w, &v, &last);
        last = v;
    };
    lanczos((root, space), limit, add_forces, orthogonal, &mut |t| {
        let step = t.diagonal.len();
        // The next vector is round-off: the iteration has found an invariant space.
        let invariant = t.residual <= T::of(1e-14) * t.diagonal[step - 1].abs();
        // Ritz values cost an eigenvalue problem of the size of the step: compute them every tenth step only.
        if !(invariant || step.is_multiple_of(10) || step == limit) {
            return Ok(false);
        }
        let (value, end) = t.top_ritz();
        // The residual of a Ritz vector is the norm of the next vector times its own last entry.
        let residual = if invariant {
            T::zero()
        } else {
            t.residual * end.abs()
        };
        // Some eigenvalue lies within the residual of the Ritz value: with it added, the step errs on the
        // safe side.
        top = value + residual;
        Ok(residual <= T::of(RESIDUAL) * value || invariant)
    })?;
    Ok(top.max(T::zero()))
}

/// The projected operator: a symmetric tridiagonal matrix, and the norm of the residual that the next vector
/// is made of.
struct Tridiagonal<T> {
    diagonal: Vec<T>,
    off: Vec<T>,
    residual: T,
}

impl<T: Real> Tridiagonal<T> {
    /// Subtracts from a new vector its parts along the last vector `v` and along the vector before, if there
    /// is one.
    fn subtract_parts(&self, w: &mut [T], v: &[T], before: &[T]) {
        let alpha = self.diagonal.last().copied().unwrap_or_else(T::zero);
        let beta = self.off.last().copied().unwrap_or_else(T::zero);
        if before.is_empty() {
            return w.iter_mut().zip(v).for_each(|(w, v)| *w -= alpha * *v);
        }
        for ((w, v), l) in w.iter_mut().zip(v).zip(before) {
            *w -= alpha * *v + beta * *l;
        }
    }
}

/// Makes a new vector orthogonal to the previous vectors. Takes the vector, the one before it, and the
/// tridiagonal matrix so far.
type Orthogonal<'a, T> = dyn FnMut(&mut [T], Vec<T>, &Tridiagonal<T>) + 'a;

/// Lanczos iteration on the symmetric `R K R` until `settled`.
fn lanczos<T: Real>(
    (root, space): (&[T], &Space<'_>),
    limit: usize,
    add_forces: &mut AddForces<'_, T>,
    orthogonal: &mut Orthogonal<'_, T>,
    settled: &mut dyn FnMut(&Tridiagonal<T>) -> Result<bool>,
) -> Result<()> {
    let n = root.len();
    let moves = |i: usize| {
        if root[i] > T::zero() {
            // A fixed start makes the result reproducible. By global numbers, every rank starts with its part
            // of the same vector.
            start_value(space.global_number(i))
        } else {
            T::zero()
        }
    };
    let mut v: Vec<T> = (0..n).map(moves).collect();
    if space.normalise(&mut v) <= T::zero() {
        return Ok(());
    }
    let mut t = Tridiagonal {
        diagonal: Vec::new(),
        off: Vec::new(),
        residual: T::zero(),
    };
    let (mut q, mut w) = (vec![T::zero(); n], vec![T::zero(); n]);
    for _ in 0..limit.min(space.size()) {
        (0..n).for_each(|i| q[i] = root[i] * v[i]);
        w.fill(T::zero());
        add_forces(&q, &mut w)?;
        // Forces are `−K q`: the sign makes the operator positive.
        w.iter_mut().zip(root).for_each(|(w, r)| *w *= -*r);
        t.diagonal.push(space.dot(&w, &v));
        orthogonal(&mut w, v, &t);
        t.residual = space.normalise(&mut w);
        space.check_ranks()?;
        if settled(&t)? {
            break;
        }
        t.off.push(t.residual);
        v = w.clone();
    }
    Ok(())
}

impl<T: Real> Tridiagonal<T> {
    fn dense(&self) -> DMatrix<T> {
        let n = self.diagonal.len();
        DMatrix::from_fn(n, n, |r, c| match r.abs_diff(c) {
            0 => self.diagonal[r],
            1 => self.off[r.min(c)],
            _ => T::zero(),
        })
    }

    /// The largest eigenvalue.
    fn top(&self) -> Result<T> {
        let n = self.diagonal.len();
        Ok(T::symmetric_eigen(n, self.dense().as_slice())?.values[n - 1])
    }

    /// The largest eigenvalue and the last entry of its unit vector.
    fn top_ritz(&self) -> (T, T) {
        let eigen = self.dense().symmetric_eigen();
        let k = eigen.eigenvalues.imax();
        (
            eigen.eigenvalues[k],
            eigen.eigenvectors[(self.diagonal.len() - 1, k)],
        )
    }
}

/// A fixed, well-spread sequence in (−0.9, 1.1), free of any symmetry of the model.
fn start_value<T: Real>(i: usize) -> T {
    // Multiples of the golden ratio are spread evenly and repeat nothing.
    let x = ((i as f64 + 1.0) * 0.618_033_988_749_894_9).fract();
    T::of(2.0 * (x * 7.31 + 0.137 * x * x).fract() - 0.9)
}

/// Vector space of an iteration.
enum Space<'a> {
    /// Unknowns without nodes, all on this rank; their number.
    Plain(usize),
    /// Unknowns of nodes, on one rank or spread over several.
    Nodes(DofLayout, &'a Owned),
}

impl Space<'_> {
    /// Number of unknowns on all ranks.
    fn size(&self) -> usize {
        match self {
            Self::Plain(n) => *n,
            Self::Nodes(layout, owned) => owned.whole_layout(layout).dofs(),
        }
    }

    /// Number that a local unknown has among the unknowns of all ranks.
    fn global_number(&self, i: usize) -> usize {
        match self {
            Self::Plain(_) => i,
            Self::Nodes(layout, owned) => owned.global_unknown(layout, i),
        }
    }

    fn dot<T: Real>(&self, a: &[T], b: &[T]) -> T {
        let Self::Nodes(layout, owned) = self else {
            return dot(a, b);
        };
        let (d, r, first) = (layout.components, layout.rotations, layout.translations());
        let part = |n: Range<usize>| {
            let moving = d * n.start..d * n.end;
            let turning = first + r * n.start..first + r * n.end;
            [dot(&a[moving.clone()], &b[moving]) + dot(&a[turning.clone()], &b[turning])]
        };
        let [sum] = owned.sum(&part);
        sum
    }

    /// Subtracts from `w` its parts along orthonormal vectors: one after the other, or all at once with one
    /// all-reduce.
    fn orthogonalise<T: Real>(&self, w: &mut [T], basis: &[Vec<T>]) {
        // Called twice, which is enough either way.
        let Self::Nodes(layout, owned) = self else {
            return basis.iter().for_each(|b| {
                let c = dot(w, b);
                w.iter_mut().zip(b).for_each(|(w, b)| *w -= c * *b);
            });
        };
        // Exact sums, so that the coefficients do not depend on how nodes are dealt out to ranks.
        let mut sums = vec![Exact::zero(); basis.len()];
        for (sum, b) in sums.iter_mut().zip(basis) {
            add_products(layout, w, b, sum);
        }
        owned.all_reduce(&mut sums);
        for (b, c) in basis.iter().zip(&sums) {
            let c = T::of(c.value());
            w.iter_mut().zip(b).for_each(|(w, b)| *w -= c * *b);
        }
    }

    /// Returns the failure of the communication between ranks, if there was one: on NaN an iteration would
    /// not end.
    fn check_ranks(&self) -> Result<()> {
        match self {
            Self::Plain(_) => Ok(()),
            Self::Nodes(_, owned) => owned.check_communication(),
        }
    }

    fn normalise<T: Real>(&self, v: &mut [T]) -> T {
        let norm = self.dot(v, v).sqrt();
        if norm > T::zero() {
            v.iter_mut().for_each(|x| *x /= norm);
        }
        norm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of unit masses and springs with one stiff spring, whose mode stands off the others. The
    /// largest eigenvalue does not depend on how many springs there are: it is found with stored vectors
    /// and without.
    #[test]
    fn large_models_have_the_eigenvalue_of_small_ones_without_stored_vectors() {
        let top = |n: usize| -> f64 {
            let stiffness = |k: usize| if k == n / 2 { 5.0 } else { 1.0 };
            largest_eigenvalue(&vec![1.0; n], &mut |q, f| {
                for k in 0..n - 1 {
                    let s = stiffness(k) * (q[k + 1] - q[k]);
                    f[k] += s;
                    f[k + 1] -= s;
                }
                Ok(())
            })
            .expect("forces do not fail")
        };
        let large = STORED / STEPS + 1;
        let [few, many] = [1000, large].map(top);
        assert!((few - many).abs() < 1e-9 * few, "{few} {many}");
        // `4 κ² / (2 κ − 1)` for the infinite chain.
        assert!((few - 100.0 / 9.0).abs() < 1e-9, "{few}");
    }
}

//! Highest frequency of a model by Lanczos iteration, and the critical step of velocity Verlet from it.

use crate::scalar::dot;
use crate::{Real, Result};

/// Adds the internal forces at a displacement.
pub type AddForces<'a, T> = dyn FnMut(&[T], &mut [T]) -> Result<()> + 'a;

const STEPS: usize = 80;

/// Critical step `2/ω_max` \[s\] of `M q̈ = −K q`; infinite if nothing moves. A nonlinear model gives its own in
/// [`crate::Model::critical_step`].
///
/// Lanczos on the symmetric operator `M^{-1/2} K M^{-1/2}` with a fixed start vector (so that the result is
/// reproducible) and full reorthogonalisation. `inverse_inertia = 0` marks prescribed unknowns.
///
/// # Errors
/// Those of `add_forces`.
pub fn critical_step<T: Real>(
    dofs: usize,
    inverse_inertia: &[T],
    add_forces: &mut AddForces<'_, T>,
) -> Result<T> {
    let top = largest_eigenvalue(dofs, inverse_inertia, add_forces)?;
    Ok(if top > T::zero() {
        T::of(2.0) / top.sqrt()
    } else {
        T::of(f64::from(f32::MAX))
    })
}

/// Largest eigenvalue `ω²` of `M⁻¹K` \[1/s²\], where `add_forces` adds `−K q`.
///
/// # Errors
/// Those of `add_forces`.
pub fn largest_eigenvalue<T: Real>(
    dofs: usize,
    inverse_inertia: &[T],
    add_forces: &mut AddForces<'_, T>,
) -> Result<T> {
    let root: Vec<T> = inverse_inertia.iter().map(|m| m.sqrt()).collect();
    let mut basis: Vec<Vec<T>> = Vec::new();
    let (mut diagonal, mut off) = (Vec::new(), Vec::new());
    let mut v: Vec<T> = (0..dofs)
        .map(|i| {
            if root[i] > T::zero() {
                scatter(i)
            } else {
                T::zero()
            }
        })
        .collect();
    if normalise(&mut v) <= T::zero() {
        return Ok(T::zero());
    }
    let (mut q, mut f) = (vec![T::zero(); dofs], vec![T::zero(); dofs]);
    let mut top = T::zero();
    for step in 0..STEPS.min(dofs) {
        (0..dofs).for_each(|i| q[i] = root[i] * v[i]);
        f.fill(T::zero());
        add_forces(&q, &mut f)?;
        let mut w: Vec<T> = (0..dofs).map(|i| -root[i] * f[i]).collect();
        diagonal.push(dot(&w, &v));
        basis.push(std::mem::take(&mut v));
        for _ in 0..2 {
            for b in &basis {
                let c = dot(&w, b);
                (0..dofs).for_each(|i| w[i] -= c * b[i]);
            }
        }
        let previous = top;
        top = tridiagonal_top(&diagonal, &off)?;
        let rest = normalise(&mut w);
        let settled = step > 20 && (top - previous).abs() <= top * T::of(1e-10);
        if settled || rest <= top * T::epsilon() * T::of(16.0) {
            break;
        }
        off.push(rest);
        v = w;
    }
    Ok(top)
}

/// A fixed, well-spread sequence in (−1, 1), free of any symmetry of the model.
fn scatter<T: Real>(i: usize) -> T {
    let x = ((i as f64 + 1.0) * 0.618_033_988_749_894_9).fract();
    T::of(2.0 * (x * 7.31 + 0.137 * x * x).fract() - 0.9)
}

fn normalise<T: Real>(v: &mut [T]) -> T {
    let norm = dot(v, v).sqrt();
    if norm > T::zero() {
        v.iter_mut().for_each(|x| *x /= norm);
    }
    norm
}

fn tridiagonal_top<T: Real>(diagonal: &[T], off: &[T]) -> Result<T> {
    let n = diagonal.len();
    let mut dense = vec![T::zero(); n * n];
    for i in 0..n {
        dense[i * n + i] = diagonal[i];
        if i > 0 {
            dense[i * n + i - 1] = off[i - 1];
            dense[(i - 1) * n + i] = off[i - 1];
        }
    }
    Ok(T::symmetric_eigen(n, &dense)?.values[n - 1])
}

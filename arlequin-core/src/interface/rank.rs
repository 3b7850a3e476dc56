//! What is known of the multiplier operator: its extreme eigenvalues, and multipliers that act on nothing.

use crate::scalar::dot;
use crate::{Real, Result};
use sprs::CsMat;

/// Largest system whose null modes are looked at by dense eigenvalues (a second or two); pivots tell beyond.
const DENSE_LIMIT: usize = 2000;
/// Lanczos steps for a condition number.
const STEPS: usize = 150;

/// A combination of multipliers that acts on nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct NullMode {
    /// Mediator node at which the mode is largest; beyond 2 000 multipliers per component that of the multiplier which
    /// depends on others.
    pub node: usize,
    /// Eigenvalue of the scaled operator relative to its largest; beyond 2 000 multipliers per component a bound of it.
    pub eigenvalue: f64,
}

fn multiply<T: Real>(a: &CsMat<T>, x: &[T], out: &mut [T]) {
    out.fill(T::zero());
    for (j, col) in a.outer_iterator().enumerate() {
        col.iter().for_each(|(i, v)| out[i] += *v * x[j]);
    }
}

/// Smallest and largest eigenvalue by (inverse) power iteration.
pub(super) fn extremes<T: Real>(a: &CsMat<T>, solve: &mut dyn FnMut(&mut [T])) -> [T; 2] {
    let n = a.rows();
    let mut work = vec![T::zero(); n];
    let iterate = |apply: &mut dyn FnMut(&mut Vec<T>)| {
        let mut x: Vec<T> = (0..n).map(scattered).collect();
        let mut value = T::zero();
        for step in 0..300 {
            let norm = dot(&x, &x).sqrt();
            if norm <= T::zero() || !norm.is_finite() {
                return T::zero();
            }
            x.iter_mut().for_each(|v| *v /= norm);
            let before = x.clone();
            apply(&mut x);
            let next = dot(&before, &x);
            let settled = step > 10 && (next - value).abs() <= next.abs() * T::of(1e-4);
            value = next;
            if settled {
                break;
            }
        }
        value
    };
    let high = iterate(&mut |x| {
        multiply(a, x, &mut work);
        x.copy_from_slice(&work);
    });
    let inverse_low = iterate(&mut |x| solve(x));
    let low = if inverse_low > T::zero() {
        T::one() / inverse_low
    } else {
        T::zero()
    };
    [low, high]
}

fn sign<T: Real>(i: usize) -> T {
    if (i * 2_654_435_761) & 4096 == 0 {
        T::one()
    } else {
        -T::one()
    }
}

/// Condition number of what acts on something, and the modes of a scaled operator that act on nothing; `left_out`: the rows
/// whose pivots vanished.
pub(super) fn null_modes<T: Real>(
    scaled: &CsMat<T>,
    left_out: Vec<usize>,
    tolerance: T,
    per_node: usize,
) -> Result<(T, Vec<NullMode>)> {
    let n = scaled.rows();
    if n > DENSE_LIMIT {
        let modes = left_out.into_iter().map(|row| NullMode {
            node: row / per_node,
            eigenvalue: tolerance.as_f64(),
        });
        return Ok((condition(scaled, tolerance)?, modes.collect()));
    }
    let mut dense = vec![T::zero(); n * n];
    scaled.iter().for_each(|(v, (j, i))| dense[j * n + i] = *v);
    let eigen = T::symmetric_eigen(n, &dense)?;
    let top = eigen.values.last().copied().unwrap_or_else(T::zero);
    let acts = |value: &T| *value > top * tolerance;
    let low = eigen.values.iter().copied().find(acts).unwrap_or(top);
    let modes = eigen.values.iter().zip(eigen.vectors.chunks_exact(n.max(1)));
    let modes = modes.filter(|(value, _)| !acts(value)).map(|(value, mode)| {
        let size = |k: usize| mode[k].abs().as_f64();
        let peak = (0..n).max_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap_or(0);
        let relative = if top > T::zero() { *value / top } else { T::zero() };
        NullMode {
            node: peak / per_node,
            eigenvalue: relative.as_f64(),
        }
    });
    let condition = if low > T::zero() { top / low } else { T::one() };
    Ok((condition, modes.collect()))
}

/// Condition number of a positive semidefinite matrix on its range, by Lanczos iteration from a vector of it: from below.
pub(super) fn condition<T: Real>(a: &CsMat<T>, tolerance: T) -> Result<T> {
    let n = a.rows();
    let start: Vec<T> = (0..n).map(scattered).collect();
    let (mut v, mut before, mut w) = (vec![T::zero(); n], vec![T::zero(); n], vec![T::zero(); n]);
    multiply(a, &start, &mut v);
    let (mut diagonal, mut off): (Vec<T>, Vec<T>) = (Vec::new(), Vec::new());
    let mut norm = dot(&v, &v).sqrt();
    while norm > T::zero() && diagonal.len() < STEPS.min(n) {
        v.iter_mut().for_each(|x| *x /= norm);
        multiply(a, &v, &mut w);
        let last = off.last().copied().unwrap_or_else(T::zero);
        let alpha = dot(&w, &v);
        for ((w, v), b) in w.iter_mut().zip(&v).zip(&before) {
            *w -= alpha * *v + last * *b;
        }
        diagonal.push(alpha);
        norm = dot(&w, &w).sqrt();
        off.push(norm);
        std::mem::swap(&mut before, &mut v);
        std::mem::swap(&mut v, &mut w);
    }
    let k = diagonal.len();
    let mut dense = vec![T::zero(); k * k];
    for i in 0..k {
        dense[i * k + i] = diagonal[i];
        if i + 1 < k {
            dense[i * k + i + 1] = off[i];
            dense[(i + 1) * k + i] = off[i];
        }
    }
    let values = T::symmetric_eigen(k, &dense)?.values;
    let top = values.last().copied().unwrap_or_else(T::one);
    let low = values.into_iter().find(|v| *v > top * tolerance).unwrap_or(top);
    Ok(top / low)
}

/// Whether `solve` finds a solution of `A x = b` for some `b` of the range, to three digits.
pub(super) fn inverts<T: Real>(a: &CsMat<T>, solve: &mut dyn FnMut(&mut [T])) -> bool {
    let start: Vec<T> = (0..a.rows()).map(scattered).collect();
    let (mut b, mut back) = (vec![T::zero(); a.rows()], vec![T::zero(); a.rows()]);
    multiply(a, &start, &mut b);
    let mut x = b.clone();
    solve(&mut x);
    multiply(a, &x, &mut back);
    back.iter_mut().zip(&b).for_each(|(y, b)| *y -= *b);
    dot(&back, &back) <= dot(&b, &b) * T::of(1e-6)
}

/// A fixed sequence of both signs.
fn scattered<T: Real>(i: usize) -> T {
    T::of(1.0 + ((i as f64) * 0.754_877_666).fract()) * sign(i)
}

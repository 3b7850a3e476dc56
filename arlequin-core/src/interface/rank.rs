//! Rank analysis of the multiplier operator: extreme eigenvalues and null modes.

use crate::scalar::dot;
use crate::{Real, Result};
use sprs::{CsMat, TriMat};

/// Largest number of dependent multipliers resolved by dense eigenvalues (a second or two).
pub(super) const DENSE_LIMIT: usize = 2000;
/// Lanczos steps for a condition number.
const STEPS: usize = 150;

/// Combination of multipliers that acts on nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct NullMode {
    /// Mediator node at which the mode is largest.
    pub node: usize,
    /// Eigenvalue of the scaled operator relative to its largest one. For a mode that is only counted: the
    /// limit below which it lies.
    pub eigenvalue: f64,
}

fn multiply<T: Real>(a: &CsMat<T>, x: &[T], out: &mut [T]) {
    out.fill(T::zero());
    for (j, col) in a.outer_iterator().enumerate() {
        col.iter().for_each(|(i, v)| out[i] += *v * x[j]);
    }
}

/// Returns a copy scaled to a unit diagonal, and the scaling. Rows that act on nothing get a zero scale.
pub(super) fn equilibrated<T: Real>(s: &CsMat<T>) -> (CsMat<T>, Vec<T>) {
    let n = s.rows();
    let diagonal: Vec<T> = (0..n)
        .map(|i| s.get(i, i).copied().unwrap_or_else(T::zero))
        .collect();
    let top = diagonal.iter().fold(T::zero(), |a, b| a.max(*b));
    // A diagonal of round-off would scale noise up to one.
    let floor = top * T::epsilon() * T::of(16.0);
    let scale: Vec<T> = diagonal
        .iter()
        .map(|d| {
            if *d > floor {
                T::one() / d.sqrt()
            } else {
                T::zero()
            }
        })
        .collect();
    let mut t = TriMat::with_capacity((n, n), s.nnz());
    s.iter()
        .for_each(|(v, (j, i))| t.add_triplet(i, j, *v * scale[i] * scale[j]));
    (t.to_csc(), scale)
}

/// Computes the smallest and largest eigenvalue by (inverse) power iteration.
pub(super) fn extremes<T: Real>(a: &CsMat<T>, solve: &mut dyn FnMut(&mut [T])) -> [T; 2] {
    let n = a.rows();
    let mut work = vec![T::zero(); n];
    let iterate = |apply: &mut dyn FnMut(&mut Vec<T>)| {
        // No symmetric start: a mode that it is orthogonal to would never be found.
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
            // Changes of 1e-4 leave inverse iteration at most 3 % too high.
            let settled = step > 10 && (next - value).abs() <= next.abs() * T::of(1e-4);
            value = next;
            if settled {
                break;
            }
        }
        value
    };
    // The largest eigenvalue from products, the smallest from solves, as the largest of the inverse.
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

/// Solves for a right-hand side in the range of `a` and returns the norm of the residual, relative to the
/// right-hand side.
pub(super) fn residual<T: Real>(a: &CsMat<T>, solve: &mut dyn FnMut(&mut [T])) -> T {
    let (n, norm) = (a.rows(), |v: &[T]| dot(v, v).sqrt());
    let x: Vec<T> = (0..n).map(scattered).collect();
    let (mut b, mut image) = (vec![T::zero(); n], vec![T::zero(); n]);
    multiply(a, &x, &mut b);
    let mut solution = b.clone();
    solve(&mut solution);
    multiply(a, &solution, &mut image);
    image.iter_mut().zip(&b).for_each(|(r, b)| *r -= *b);
    let left = norm(&image);
    // Not `left > 0`: a NaN must stay one.
    if left <= T::zero() { left } else { left / norm(&b) }
}

fn sign<T: Real>(i: usize) -> T {
    if (i * 2_654_435_761) & 4096 == 0 {
        T::one()
    } else {
        -T::one()
    }
}

/// Result of a dense eigenvalue analysis of a scaled operator.
pub(super) struct Analysis<T> {
    /// Eigenvectors outside of the null space, each divided by the root of its eigenvalue.
    pub(super) modes: Vec<T>,
    /// Smallest and largest eigenvalue outside of the null space.
    pub(super) range: [T; 2],
    pub(super) null_modes: Vec<NullMode>,
}

/// Separates the eigenvectors into modes and null modes, whose eigenvalues are at or below `tolerance` times
/// the largest.
pub(super) fn resolve_modes<T: Real>(
    scaled: &CsMat<T>,
    tolerance: T,
    per_node: usize,
) -> Result<Analysis<T>> {
    let n = scaled.rows();
    let mut dense = vec![T::zero(); n * n];
    scaled.iter().for_each(|(v, (j, i))| dense[j * n + i] = *v);
    let eigen = T::symmetric_eigen(n, &dense)?;
    let top = eigen.values.last().copied().unwrap_or_else(T::zero);
    let (mut modes, mut null_modes, mut low) = (Vec::new(), Vec::new(), top);
    for (value, mode) in eigen.values.iter().zip(eigen.vectors.chunks_exact(n.max(1))) {
        // Divided by the root, so that a solve is two products with the modes.
        if *value > top * tolerance {
            low = low.min(*value);
            let root = value.sqrt();
            modes.extend(mode.iter().map(|m| *m / root));
            continue;
        }
        let size = |k: usize| mode[k].abs().as_f64();
        // The node at which the mode is largest, to name a place that the user can look at.
        let peak = (0..n).max_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap_or(0);
        let relative = if top > T::zero() { *value / top } else { T::zero() };
        null_modes.push(NullMode {
            node: peak / per_node,
            eigenvalue: relative.as_f64(),
        });
    }
    Ok(Analysis {
        modes,
        range: [low, top],
        null_modes,
    })
}

/// Counts the null modes without resolving them: by the negative pivots of the operator less the tolerance
/// (Sylvester's law of inertia). `None` if the elimination breaks down. The node of a mode is the one whose
/// multiplier depends on those eliminated before.
pub(super) fn count_null_modes<T: Real>(
    scaled: &CsMat<T>,
    tolerance: T,
    per_node: usize,
) -> Option<Vec<NullMode>> {
    // The smallest eigenvalue is not needed here, so nothing is solved.
    let [_, top] = extremes(scaled, &mut |b| b.fill(T::zero()));
    let rows = T::negative_pivots(scaled, top * tolerance)?;
    let mode = |row: usize| NullMode {
        node: row / per_node,
        eigenvalue: tolerance.as_f64(),
    };
    Some(rows.into_iter().map(mode).collect())
}

/// Estimates the smallest and largest non-zero eigenvalue of a positive semidefinite matrix by Lanczos
/// iteration, from within their interval.
pub(super) fn range<T: Real>(a: &CsMat<T>, tolerance: T) -> Result<[T; 2]> {
    let n = a.rows();
    let start: Vec<T> = (0..n).map(scattered).collect();
    let (mut v, mut before, mut w) = (vec![T::zero(); n], vec![T::zero(); n], vec![T::zero(); n]);
    // A product lies in the range of `a`: the iteration then never sees the null space.
    // Three-term recurrence: no stored vectors; lost orthogonality repeats extreme values and harms no bound.
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
    // Ritz values at or below the tolerance are round-off in the null space.
    // The smallest Ritz value lies above the smallest eigenvalue: the condition is a lower bound.
    let low = values.into_iter().find(|v| *v > top * tolerance).unwrap_or(top);
    Ok([low, top])
}

/// Returns a fixed sequence of both signs that looks random.
fn scattered<T: Real>(i: usize) -> T {
    T::of(1.0 + ((i as f64) * 0.754_877_666).fract()) * sign(i)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns `B Bᵀ` of a banded `B`, scaled to a unit diagonal, with every ninth row acting on nothing.
    fn operator(rows: usize, columns: usize) -> CsMat<f64> {
        let entry = |i: usize, j: usize| {
            let apart = (i as f64 / rows as f64 - j as f64 / columns as f64) * columns as f64 / 3.0;
            if i % 9 == 4 {
                0.0
            } else {
                (1.0 - apart.abs()).max(0.0)
            }
        };
        let product = |i: usize, k: usize| (0..columns).map(|j| entry(i, j) * entry(k, j)).sum::<f64>();
        let mut t = TriMat::new((rows, rows));
        for (i, k) in (0..rows).flat_map(|i| (0..rows).map(move |k| (i, k))) {
            let value = product(i, k);
            if value != 0.0 {
                t.add_triplet(i, k, value / (product(i, i) * product(k, k)).sqrt());
            }
        }
        t.to_csc()
    }

    /// The matrix has pairs of rows, each with the eigenvalues `2 − e` and `e`.
    #[test]
    fn modes_just_below_the_tolerance_act_on_nothing_and_those_just_above_on_something() {
        let tolerance = 1e-8;
        let shares = [0.3, 0.7, 0.9, 1.1, 1.5, 4.0, 30.0, 1e3];
        let n = 2 * shares.len();
        let mut t = TriMat::new((n, n));
        for (k, share) in shares.iter().enumerate() {
            let (a, b, e) = (2 * k, 2 * k + 1, 2.0 * tolerance * share);
            for (i, j, v) in [(a, a, 1.0), (b, b, 1.0), (a, b, 1.0 - e), (b, a, 1.0 - e)] {
                t.add_triplet(i, j, v);
            }
        }
        let s: CsMat<f64> = t.to_csc();
        let resolved = resolve_modes(&s, tolerance, 2).unwrap();
        assert_eq!(resolved.modes.len(), (n - 3) * n);
        let [low, top] = resolved.range;
        assert!((top / low * 1.1 * tolerance - 1.0).abs() < 1e-6);
        for null in [resolved.null_modes, count_null_modes(&s, tolerance, 2).unwrap()] {
            let mut pairs: Vec<_> = null.iter().map(|m| m.node).collect();
            pairs.sort_unstable();
            assert_eq!(pairs, [0, 1, 2]);
        }
    }

    #[test]
    fn as_many_null_modes_are_counted_as_resolved() {
        for (rows, columns) in [(60, 90), (60, 20), (300, 50), (700, 400)] {
            let s = operator(rows, columns);
            let resolved = resolve_modes(&s, 1e-10, 1).unwrap().null_modes;
            let counted = count_null_modes(&s, 1e-10, 1).unwrap();
            assert_eq!(counted.len(), resolved.len(), "{rows} rows of {columns}");
            assert!(counted.len() >= rows / 9 && counted.iter().all(|m| m.node < rows));
        }
    }
}

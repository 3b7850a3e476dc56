//! Loops over unknowns on all threads, with the same bits for any number of threads.
//!
//! A step passes over every unknown a few times; on one thread these passes would cost a fast model as much
//! as its forces. Element-wise loops give the same result however they are cut; sums are cut at fixed places
//! and added in a fixed order. No function allocates.

use crate::Real;
use rayon::prelude::*;
use std::ops::{Add, Range};

/// Unknowns per parallel task.
const CHUNK: usize = 4_096;

/// Number of unknowns below which a second thread costs more than it saves.
const LARGE: usize = 4 * CHUNK;

/// Returns whether loops over `n` unknowns are worth more than one thread.
pub fn pays(n: usize) -> bool {
    n >= LARGE && rayon::current_num_threads() > 1
}

/// Copies `from` to `to`.
pub fn copy<T: Real>(target: &mut [T], source: &[T]) {
    if !pays(target.len()) {
        return target.copy_from_slice(source);
    }
    target
        .par_chunks_mut(CHUNK)
        .zip(source.par_chunks(CHUNK))
        .for_each(|(target, source)| target.copy_from_slice(source));
}

/// Multiplies all numbers by a factor.
pub(crate) fn scale<T: Real>(factor: T, x: &mut [T]) {
    let part = |x: &mut [T]| x.iter_mut().for_each(|x| *x *= factor);
    if !pays(x.len()) {
        return part(x);
    }
    x.par_chunks_mut(CHUNK).for_each(part);
}

/// Sum over `0..n`, where `part` returns the sum over a range.
pub fn sum<T: Real>(n: usize, part: &(dyn Fn(Range<usize>) -> T + Sync)) -> T {
    sum_of(n, part)
}

/// Number of independent sums: a single sum would be as slow as its chain of additions.
const ABREAST: usize = 8;

/// `Σ m v²` of one parallel task.
pub(crate) fn weighted_squares<T: Real>(m: &[T], v: &[T]) -> T {
    let (ms, m) = m.as_chunks::<ABREAST>();
    let (vs, v) = v.as_chunks::<ABREAST>();
    let mut sums = [T::zero(); ABREAST];
    for (m, v) in ms.iter().zip(vs) {
        // Eight sums side by side allow vector instructions without a change of the order in any sum.
        for k in 0..ABREAST {
            sums[k] += m[k] * v[k] * v[k];
        }
    }
    let tail = m.iter().zip(v).fold(T::zero(), |s, (m, v)| s + *m * *v * *v);
    sums.into_iter().fold(tail, |a, b| a + b)
}

/// Largest modulus; zero for an empty slice.
pub(crate) fn largest<T: Real>(x: &[T]) -> T {
    let larger = |a: T, b: T| if b > a { b } else { a };
    let part = |x: &[T]| {
        let (groups, tail) = x.as_chunks::<ABREAST>();
        let mut tops = [T::zero(); ABREAST];
        for x in groups {
            for k in 0..ABREAST {
                tops[k] = larger(tops[k], x[k].abs());
            }
        }
        let tops = tops.into_iter().chain(tail.iter().map(|x| x.abs()));
        tops.fold(T::zero(), larger)
    };
    if !pays(x.len()) {
        return part(x);
    }
    x.par_chunks(CHUNK).map(part).reduce(T::zero, larger)
}

/// Sum over `0..n` like [`sum`], for any type with an addition.
pub(crate) fn sum_of<S: Add<Output = S> + Send>(n: usize, part: &(dyn Fn(Range<usize>) -> S + Sync)) -> S {
    // Chunks do not depend on the number of threads, and so neither do the bits of the sum.
    let chunks = n.div_ceil(CHUNK).max(1);
    tree(0..chunks, pays(n), &|c| part(c * CHUNK..n.min((c + 1) * CHUNK)))
}

/// Pairwise sum of `term` over a range: the tree, and with it the result, depends on the range alone.
fn tree<S: Add<Output = S> + Send>(
    range: Range<usize>,
    parallel: bool,
    term: &(dyn Fn(usize) -> S + Sync),
) -> S {
    if range.len() == 1 {
        return term(range.start);
    }
    let middle = range.start + range.len() / 2;
    let (low, high) = (range.start..middle, middle..range.end);
    let (a, b) = if parallel {
        rayon::join(|| tree(low, true, term), || tree(high, true, term))
    } else {
        (tree(low, false, term), tree(high, false, term))
    };
    a + b
}

/// `v += Δt/2 a`, `q += Δt v`, `force = 0`.
pub(crate) fn kick_and_drift<T: Real>(dt: T, q: &mut [T], v: &mut [T], a: &[T], force: &mut [T]) {
    let h = dt * T::of(0.5);
    let part = |q: &mut [T], v: &mut [T], a: &[T], f: &mut [T]| {
        for ((q, v), (a, f)) in q.iter_mut().zip(v).zip(a.iter().zip(f)) {
            *v += h * *a;
            *q += dt * *v;
            // Cleared in the same pass, for the model to add its forces.
            *f = T::zero();
        }
    };
    if !pays(q.len()) {
        return part(q, v, a, force);
    }
    let moving = q.par_chunks_mut(CHUNK).zip(v.par_chunks_mut(CHUNK));
    let driving = a.par_chunks(CHUNK).zip(force.par_chunks_mut(CHUNK));
    moving.zip(driving).for_each(|((q, v), (a, f))| part(q, v, a, f));
}

/// Does the work of [`kick_and_drift`] from displacements `before` to `q`: keeps the old displacements
/// without a copy.
pub(crate) fn kick_and_drift_from<T: Real>(
    dt: T,
    before: &[T],
    q: &mut [T],
    v: &mut [T],
    a: &[T],
    force: &mut [T],
) {
    let h = dt * T::of(0.5);
    let part = |before: &[T], q: &mut [T], v: &mut [T], a: &[T], f: &mut [T]| {
        let moving = before.iter().zip(q).zip(v);
        for (((before, q), v), (a, f)) in moving.zip(a.iter().zip(f)) {
            *v += h * *a;
            *q = *before + dt * *v;
            *f = T::zero();
        }
    };
    if !pays(q.len()) {
        return part(before, q, v, a, force);
    }
    let moving = q.par_chunks_mut(CHUNK).zip(v.par_chunks_mut(CHUNK));
    let driving = a.par_chunks(CHUNK).zip(force.par_chunks_mut(CHUNK));
    before
        .par_chunks(CHUNK)
        .zip(moving.zip(driving))
        .for_each(|(before, ((q, v), (a, f)))| part(before, q, v, a, f));
}

/// `a = w force`, `v += h a`.
pub(crate) fn accelerate<T: Real>(h: T, v: &mut [T], a: &mut [T], force: &[T], w: &[T]) {
    let part = |v: &mut [T], a: &mut [T], f: &[T], w: &[T]| {
        for ((v, a), (f, w)) in v.iter_mut().zip(a).zip(f.iter().zip(w)) {
            *a = *f * *w;
            *v += h * *a;
        }
    };
    if !pays(v.len()) {
        return part(v, a, force, w);
    }
    let moving = v.par_chunks_mut(CHUNK).zip(a.par_chunks_mut(CHUNK));
    let driving = force.par_chunks(CHUNK).zip(w.par_chunks(CHUNK));
    moving.zip(driving).for_each(|((v, a), (f, w))| part(v, a, f, w));
}

#[cfg(test)]
mod tests {
    use super::{largest, sum, weighted_squares};

    #[test]
    fn sums_of_eight_abreast_are_those_of_one() {
        for n in [0_u32, 5, 8, 4_100, 40_003] {
            let v: Vec<f64> = (0..n).map(|i| (f64::from(i) * 0.37).sin() - 0.1).collect();
            let m: Vec<f64> = (0..n).map(|i| 1.0 + (f64::from(i) * 0.11).cos()).collect();
            let plain: f64 = m.iter().zip(&v).map(|(m, v)| m * v * v).sum();
            assert!((weighted_squares(&m, &v) - plain).abs() <= 1e-12 * plain);
            let top = v.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            assert_eq!(largest(&v).to_bits(), top.to_bits());
        }
    }

    #[test]
    fn a_sum_has_the_same_bits_on_any_number_of_threads() {
        let x: Vec<f64> = (0..100_003).map(|i| (f64::from(i) * 0.37).sin()).collect();
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map(|p| p.install(|| sum(x.len(), &|r| x[r].iter().sum())))
                .map_or(f64::NAN, |s: f64| s)
        };
        let one = of(1);
        assert!((one - x.iter().sum::<f64>()).abs() < 1e-10);
        for threads in [2, 3] {
            assert_eq!(one.to_bits(), of(threads).to_bits(), "{threads} threads");
        }
        assert!(sum::<f64>(0, &|r| r.len() as f64).abs() < 1e-300);
    }
}

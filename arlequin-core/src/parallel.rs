//! Loops over unknowns on all threads, with the same bits for any number of threads.
//!
//! A step passes over every unknown a few times; on one thread these passes would cost a fast model as much
//! as its forces. Element-wise loops give the same result however they are cut; sums are cut at fixed places
//! and added in a fixed order. No function allocates.

use crate::ranks::UNIT;
use crate::{DofLayout, Real};
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

/// Ranges of unknowns, in ascending order, over which the passes of a step run.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces(Vec<Range<usize>>);

impl Pieces {
    /// All of `n` unknowns.
    pub(crate) fn whole(n: usize) -> Self {
        Self((0..n).step_by(CHUNK).map(|k| k..n.min(k + CHUNK)).collect())
    }

    /// The unknowns of units of nodes that have any mass.
    pub(crate) fn with_mass<T: Real>(layout: &DofLayout, inertia: &[T]) -> Self {
        Self::select(layout, &|piece| inertia[piece].iter().any(|m| *m > T::zero()))
    }

    /// The translations or rotations of units of nodes that `keep` takes.
    pub(crate) fn select(layout: &DofLayout, keep: &dyn Fn(Range<usize>) -> bool) -> Self {
        let (first, mut out) = (layout.translations(), Vec::<Range<usize>>::new());
        for (base, per_node) in [(0, layout.components), (first, layout.rotations)] {
            for unit in (0..layout.nodes).step_by(UNIT) {
                let end = layout.nodes.min(unit + UNIT);
                let piece = base + per_node * unit..base + per_node * end;
                if !keep(piece.clone()) {
                    continue;
                }
                match out.last_mut() {
                    Some(last) if last.end == piece.start && piece.end - last.start <= CHUNK => {
                        last.end = piece.end;
                    }
                    _ => out.push(piece),
                }
            }
        }
        Self(out)
    }

    /// Returns whether one of the pieces holds an unknown.
    pub(crate) fn contains(&self, k: usize) -> bool {
        let next = self.0.partition_point(|piece| piece.end <= k);
        self.0.get(next).is_some_and(|piece| piece.start <= k)
    }

    /// Ranges of unknowns.
    pub(crate) fn ranges(&self) -> &[Range<usize>] {
        &self.0
    }

    /// Calls `part` with the same range of all arrays, for each piece.
    pub(crate) fn run<T: Real, const M: usize, const N: usize>(
        &self,
        targets: [&mut [T]; M],
        sources: [&[T]; N],
        part: &(impl Fn([&mut [T]; M], [&[T]; N]) + Sync),
    ) {
        let unknowns = self.0.iter().map(Range::len).sum();
        split(&self.0, 0, (targets, sources), pays(unknowns), part);
    }
}

/// Work of [`Pieces::run`] on some pieces; the arrays begin at the unknown `base`.
fn split<T: Real, const M: usize, const N: usize>(
    pieces: &[Range<usize>],
    base: usize,
    (targets, sources): ([&mut [T]; M], [&[T]; N]),
    parallel: bool,
    part: &(impl Fn([&mut [T]; M], [&[T]; N]) + Sync),
) {
    let piece = match pieces {
        [] => return,
        [piece] => piece.start - base..piece.end - base,
        _ => {
            let (early, late) = pieces.split_at(pieces.len() / 2);
            let cut = late[0].start;
            let mut halves = targets.map(|x| x.split_at_mut(cut - base));
            let first = halves.each_mut().map(|h| std::mem::take(&mut h.0));
            let second = halves.map(|h| h.1);
            let [a, b] = [
                sources.map(|x| &x[..cut - base]),
                sources.map(|x| &x[cut - base..]),
            ];
            let early = || split(early, base, (first, a), parallel, part);
            let late = || split(late, cut, (second, b), parallel, part);
            if parallel {
                rayon::join(early, late);
            } else {
                early();
                late();
            }
            return;
        }
    };
    let targets = targets.map(|x| &mut x[piece.clone()]);
    part(targets, sources.map(|x| &x[piece.clone()]));
}

/// `v += Δt/2 a`, `q += Δt v`, `force = 0`.
pub(crate) fn kick_and_drift<T: Real>(pieces: &Pieces, dt: T, [q, v, force]: [&mut [T]; 3], a: &[T]) {
    let h = dt * T::of(0.5);
    pieces.run([q, v, force], [a], &|[q, v, f], [a]| {
        for ((q, v), (a, f)) in q.iter_mut().zip(v).zip(a.iter().zip(f)) {
            *v += h * *a;
            *q += dt * *v;
            // Cleared in the same pass, for the model to add its forces.
            *f = T::zero();
        }
    });
}

/// Does the work of [`kick_and_drift`] from displacements `before` to `q`: keeps the old displacements
/// without a copy.
pub(crate) fn kick_and_drift_from<T: Real>(
    pieces: &Pieces,
    dt: T,
    before: &[T],
    [q, v, force]: [&mut [T]; 3],
    a: &[T],
) {
    let h = dt * T::of(0.5);
    pieces.run([q, v, force], [before, a], &|[q, v, f], [before, a]| {
        let moving = before.iter().zip(q).zip(v);
        for (((before, q), v), (a, f)) in moving.zip(a.iter().zip(f)) {
            *v += h * *a;
            *q = *before + dt * *v;
            *f = T::zero();
        }
    });
}

/// `a = w force`, `v += h a`.
pub(crate) fn accelerate<T: Real>(pieces: &Pieces, h: T, [v, a]: [&mut [T]; 2], force: &[T], w: &[T]) {
    pieces.run([v, a], [force, w], &|[v, a], [f, w]| {
        for ((v, a), (f, w)) in v.iter_mut().zip(a).zip(f.iter().zip(w)) {
            *a = *f * *w;
            *v += h * *a;
        }
    });
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

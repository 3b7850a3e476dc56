//! Chebyshev iteration from zero for `S μ = b`.
//!
//! Let all non-zero eigenvalues of `C S` lie between `a` and `c`, with half sum `θ` and half difference `δ`.
//! After `k` iterations `r = T_k((θ − C S)/δ) / T_k(θ/δ) b`, in the norm of `C` at most
//! `1/cosh(k arcosh(θ/δ))` of `b`. So the number of iterations is known beforehand, and none of them needs a
//! global sum. Eigenvalues below `a` are damped less, never enlarged, and null modes stay zero. Eigenvalues
//! above `c` would be enlarged: `c` has to be a bound, an estimate is not enough.
//!
//! A kick by `μ` changes the energy by `2 μᵀ(S μ − b)`, and the result does not fulfil Galerkin's condition,
//! which makes that zero. Scaled by `μᵀb / μᵀS μ` per component it does; that factor is as close to one as
//! `r` is to zero. The scaling takes one global sum at the end, which also gives the residual. If `a` was too
//! high, iterations go on from there.

use super::iterated::{Broken, Iterated, Precondition, update};
use super::sides::Sides;
use crate::Real;
use nalgebra::Vector3;
use sprs::CsMat;

/// Safety factor of the smallest eigenvalue, which is estimated from above: inverse power iterations that end
/// with changes of 1e-4 are at most 3 % too high.
const BELOW: f64 = 0.9;
/// Safety factor of the upper bound: more than round-off in its sums, in single precision too.
const ABOVE: f64 = 1.001;
/// Largest number of power iterations for the upper bound, and the relative change at which they end.
const POWERS: usize = 60;
const SETTLED: f64 = 1e-4;
/// Growth of the squared residual that counts as divergence. Bounds that hold allow none; round-off makes
/// less.
const GROWN: f64 = 4.0;
/// Largest share of the squared residual that another round may leave; the iteration ends if it leaves more.
const WORTH: f64 = 0.25;

/// Eigenvalues that the iteration damps, and its number of iterations per round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chebyshev {
    /// Lowest and highest eigenvalue of `C S`.
    pub(super) bounds: [f64; 2],
    /// Iterations after which the residual meets the tolerance, or the limit if that is less.
    pub(super) iterations: usize,
    /// Iterations that the tolerance would need for all eigenvalues.
    pub(super) asked: f64,
}

impl Chebyshev {
    /// Plans iterations for eigenvalues from `low`, an estimate, to `high`, a bound. If `most` is too few,
    /// raises the lower bound: the lowest modes, whose share in the jump is least, then stay above the
    /// tolerance.
    pub(super) fn new([low, high]: [f64; 2], tolerance: f64, most: usize) -> Self {
        let high = high * ABOVE;
        // The bounds keep a distance, so that their ratio is finite and above one.
        let mut low = (low * BELOW).max(high * f64::EPSILON).min(high * BELOW);
        let ratio = |low: f64| (high + low) / (high - low);
        if tolerance <= 0.0 {
            return Self {
                bounds: [low, high],
                iterations: most,
                asked: most as f64,
            };
        }
        let digits = (1.0 / tolerance).acosh();
        let asked = (digits / ratio(low).acosh()).ceil().max(1.0);
        if asked > most as f64 {
            // Inverse of the formula for `asked`: the lower bound that `most` iterations can reach.
            let ratio = (digits / most as f64).cosh();
            low = low.max(high * (ratio - 1.0) / (ratio + 1.0));
        }
        Self {
            bounds: [low, high],
            iterations: asked.min(most as f64) as usize,
            asked,
        }
    }
}

/// Returns a bound of all eigenvalues of a symmetric matrix.
///
/// `max_i (|A| x)_i / x_i` is a bound for any `x > 0` (Collatz, Wielandt). It begins as the largest row sum
/// (Gershgorin) and falls with power iterations to the largest eigenvalue of `|A|`, which is that of `A` if
/// no entry is negative.
pub(super) fn ceiling<T: Real>(a: &CsMat<T>) -> f64 {
    let (mut x, mut y) = (vec![1.0; a.rows()], vec![0.0; a.rows()]);
    let mut least = f64::INFINITY;
    for _ in 0..POWERS {
        y.fill(0.0);
        for (j, column) in a.outer_iterator().enumerate() {
            column.iter().for_each(|(i, v)| y[i] += v.as_f64().abs() * x[j]);
        }
        let ratios = x.iter().zip(&y).map(|(x, y)| y / x);
        let ratio = ratios.fold(0.0, f64::max);
        let settled = ratio > least * (1.0 - SETTLED);
        least = ratio.min(least);
        if settled || ratio <= 0.0 {
            break;
        }
        // Rows without entries get none from any other row: the matrix is symmetric.
        for (x, y) in x.iter_mut().zip(&y).filter(|(_, y)| **y > 0.0) {
            *x = *y / ratio;
        }
    }
    least
}

impl<T: Real> Iterated<T> {
    /// Iterates in rounds until the residual meets the tolerance, the iterations run out or a round gains too
    /// little. Expects `r = b`.
    pub(super) fn chebyshev<const N: usize>(
        &mut self,
        x: &mut [T],
        sides: &mut Sides<T>,
        preconditioner: &mut (impl Precondition<T> + ?Sized),
        plan: Chebyshev,
    ) {
        self.right_side.copy_from_slice(x);
        x.fill(T::zero());
        let mut before = T::one();
        loop {
            let count = plan.iterations.min(self.most - self.iterations);
            self.damp::<N>(x, sides, preconditioner, (plan, count));
            // `C b` and `C r`.
            self.image.copy_from_slice(&self.right_side);
            preconditioner.apply(&mut self.image);
            self.precondition(preconditioner);
            let [initial, residual, work, missed] = self.dots.four_products::<T, N>([
                (&self.right_side, &self.image),
                (&self.residual, &self.preconditioned),
                (x, &self.right_side),
                (x, &self.residual),
            ]);
            let shares = (0..N).filter(|c| initial[*c] > T::zero());
            let share = shares
                .map(|c| residual[c] / initial[c])
                .fold(T::zero(), |m, s| if s > m || !s.is_finite() { s } else { m });
            // A residual that overflowed has grown as well; a `b` that is no number has another cause.
            let grown = share > T::of(GROWN) || !share.is_finite();
            if grown && (0..N).all(|c| initial[c].is_finite()) {
                self.broken = Some(Broken {
                    iterations: self.iterations,
                    growth: share.as_f64().sqrt(),
                });
            }
            let met = share <= self.tolerance * self.tolerance;
            // Round-off in the null space is never damped: going on would not end.
            let goes_on = share <= before * T::of(WORTH);
            if met || !goes_on || self.iterations >= self.most {
                self.unsolved = !met;
                return scale::<T, N>(x, &work, &missed);
            }
            before = share;
        }
    }

    /// Makes the iterations of one round, which damp `r` for all eigenvalues between the bounds.
    fn damp<const N: usize>(
        &mut self,
        x: &mut [T],
        sides: &mut Sides<T>,
        preconditioner: &mut (impl Precondition<T> + ?Sized),
        (plan, count): (Chebyshev, usize),
    ) {
        let [low, high] = plan.bounds;
        let (middle, half) = (0.5 * (high + low), 0.5 * (high - low));
        let ratio = middle / half;
        // `p = momentum p + step C r`.
        let (mut rho, mut momentum, mut step) = (1.0 / ratio, 0.0, 1.0 / middle);
        let unit_length = Vector3::repeat(T::one());
        self.direction.fill(T::zero());
        for _ in 0..count {
            self.precondition(preconditioner);
            let [k, t] = [momentum, step].map(T::of);
            update::<T, N>(&mut self.direction, &self.preconditioned, &mut |p, z| {
                (0..N).for_each(|c| p[c] = k * p[c] + t * z[c]);
            });
            self.product::<N>(sides);
            self.advance::<N>(x, &unit_length);
            // Three-term recurrence of the Chebyshev polynomials: rho is T_k / T_{k+1} at θ/δ.
            let next = 1.0 / (2.0 * ratio - rho);
            (momentum, step, rho) = (next * rho, 2.0 * next / half, next);
        }
    }
}

/// Scales the result to fulfil Galerkin's condition: by `x·b / x·S x` per component, with `x·b = work` and
/// `x·r = missed`.
fn scale<T: Real, const N: usize>(x: &mut [T], work: &Vector3<T>, missed: &Vector3<T>) {
    let factor = Vector3::from_fn(|c, _| {
        let curvature = work[c] - missed[c];
        // A component that moves nothing has no scale. NaN fails both comparisons and becomes zero.
        if work[c] > T::zero() && curvature > T::zero() {
            work[c] / curvature
        } else {
            T::zero()
        }
    });
    for x in x.as_chunks_mut::<N>().0 {
        for c in 0..N {
            x[c] = if factor[c] > T::zero() {
                factor[c] * x[c]
            } else {
                T::zero()
            };
        }
    }
}

#[cfg(test)]
mod components;

#[cfg(test)]
mod tests {
    use super::super::iterated::{Apply, Method};
    use super::super::rank;
    use super::super::transfer::Rows;
    use super::*;
    use proptest::prelude::*;
    use sprs::TriMat;

    fn matrix(n: usize, entry: impl Fn(usize, usize) -> f64) -> CsMat<f64> {
        let mut t = TriMat::new((n, n));
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let value = entry(i, j);
            if value != 0.0 {
                t.add_triplet(i, j, value);
            }
        }
        t.to_csc()
    }

    /// A power iteration whose start vector lacks the top mode would end at another one.
    #[test]
    fn the_bound_is_never_below_the_largest_eigenvalue_and_close_to_it() {
        // Eigenvalues `1 + k cos(π q)` from `0.1` to `1.9`, and one end mode that decays into the rows
        // outside of that band, at `2.05` or `0.05`.
        let chains = [1.0, -1.0].map(|sign| {
            matrix(80, |i, j| match i.abs_diff(j) {
                0 => 1.0,
                1 if i + j == 1 => sign * 0.75,
                1 => sign * 0.45,
                _ => 0.0,
            })
        });
        // Two uncoupled blocks of different scale, and rows that act on nothing.
        let apart = matrix(60, |i, j| match (i % 3, i / 30 == j / 30) {
            (0, _) => 0.0,
            (_, true) if j % 3 > 0 => (if i == j { 1.0 } else { 0.02 }) * if i < 30 { 1.0 } else { 1e-3 },
            _ => 0.0,
        });
        for a in chains.iter().chain([&apart]) {
            let n = a.rows();
            let dense: Vec<f64> = (0..n * n)
                .map(|k| a.get(k / n, k % n).copied().unwrap_or(0.0))
                .collect();
            let values = f64::symmetric_eigen(n, &dense).unwrap().values;
            let (top, bound) = (values[n - 1], ceiling(a));
            assert!(
                bound >= top * (1.0 - 1e-14) && bound < 1.02 * top,
                "{bound} of {top}"
            );
        }
    }

    struct Diagonal(Vec<f64>);

    impl Precondition<f64> for Diagonal {
        fn apply(&mut self, z: &mut [f64]) {
            z.iter_mut().zip(&self.0).for_each(|(z, c)| *z *= c);
        }
    }

    /// Solves and returns: the residual over the right-hand side in the norm of the inverse diagonal,
    /// computed afresh; the energy change of a kick over the work of the multipliers; the iteration.
    fn solved(s: &CsMat<f64>, b: &[f64], plan: Chebyshev, limits: (f64, usize)) -> (f64, f64, Iterated<f64>) {
        let n = b.len();
        let inverse: Vec<f64> = (0..n).map(|i| s.get(i, i).map_or(0.0, |d| 1.0 / d)).collect();
        let rows = Rows::from_entries(n, s.iter().map(|(v, (i, j))| (j, i, *v)));
        let mut iterated = Iterated::new(Apply::Rows(rows), Method::Chebyshev(plan), [n, 1], limits);
        let mut x = b.to_vec();
        iterated.solve(
            &mut x,
            &mut Sides::new(Vec::new()),
            &mut Diagonal(inverse.clone()),
        );
        let mut r = b.to_vec();
        s.iter().for_each(|(v, (i, j))| r[i] -= v * x[j]);
        let norm = |r: &[f64]| r.iter().zip(&inverse).map(|(r, c)| r * r * c).sum::<f64>().sqrt();
        let dot = |r: &[f64]| r.iter().zip(&x).map(|(r, x)| r * x).sum::<f64>();
        (norm(&r) / norm(b), dot(&r).abs() / dot(b), iterated)
    }

    proptest! {
        #![proptest_config(reader_fuzz::property_config(64))]
        /// `B` has rows of any size and unit, some of them twice, and any number of columns.
        #[test]
        fn residuals_are_below_the_tolerance_and_no_energy_is_made(
            entries in prop::collection::vec(-1.0..1.0, 30 * 40),
            [n, m] in [4_usize..30, 4_usize..40],
            seed in 0_u32..1000,
            unit in -100.0..100.0,
            few in 1_usize..6,
        ) {
            let size = |i: usize| 10_f64.powf(3.0 * (f64::from(seed) + i as f64).sin() + unit);
            let entry = |i: usize, j: usize| {
                let i = if i % 5 == 4 { i - 1 } else { i };
                let near = (i * m).abs_diff(j * n) < 3 * m;
                if near { entries[40 * i + j] } else { 0.0 }
            };
            let s = matrix(n, |i, k| {
                size(i) * size(k) * (0..m).map(|j| entry(i, j) * entry(k, j)).sum::<f64>()
            });
            let b: Vec<f64> = (0..n).map(|i| size(i) * (0..m).map(|j| entry(i, j) * entries[j]).sum::<f64>()).collect();
            prop_assume!(b.iter().any(|b| *b != 0.0));
            let scale = |i: usize| s.get(i, i).map_or(0.0, |d| 1.0 / d.sqrt());
            let scaled = matrix(n, |i, k| s.get(i, k).map_or(0.0, |v| v * scale(i) * scale(k)));
            let low = rank::resolve_modes(&scaled, 1e-10, 1).unwrap().range[0];
            let (tolerance, most) = (1e-8, 20_000);
            let plan = Chebyshev::new([low, ceiling(&scaled)], tolerance, most);
            let (residual, change, iterated) = solved(&s, &b, plan, (tolerance, most));
            prop_assert!(iterated.broken.is_none());
            // Round-off grows with the condition of the drawn matrix.
            prop_assert!(change < 1e-11, "{change:e}");
            if plan.iterations < most {
                // The scaling adds as much again: it is as close to one as the multipliers are to the exact
                // ones.
                prop_assert!(residual < 2.01 * tolerance, "{residual:e} after {} iterations", iterated.iterations);
            }
            let (_, change, iterated) = solved(&s, &b, Chebyshev { iterations: few, ..plan }, (0.0, few));
            prop_assert!(iterated.iterations == few && change < 1e-11, "{few}: {change:e}");
        }
    }

    /// Returns a matrix with eigenvalues from 1 to 1.9 and one of 0.01.
    fn long_wave() -> (CsMat<f64>, Vec<f64>) {
        let n = 60;
        let s = matrix(n, |i, j| {
            if i == j {
                1.0 + 0.9 * (i as f64) / n as f64
            } else {
                0.0
            }
        });
        let mode: Vec<f64> = (0..n).map(|i| (1.0 + i as f64).sqrt().recip()).collect();
        let size: f64 = mode.iter().map(|x| x * x).sum();
        let along: f64 = mode
            .iter()
            .zip(0..)
            .map(|(x, i)| x * x * s.get(i, i).unwrap())
            .sum();
        let image: Vec<f64> = mode
            .iter()
            .zip(0..)
            .map(|(x, i)| x * s.get(i, i).unwrap())
            .collect();
        // `P S P + 0.01 e eᵀ` with `P = 1 − e eᵀ`.
        let projected = matrix(n, |i, j| {
            let plain = s.get(i, j).copied().unwrap_or(0.0);
            let mixed = (mode[i] * image[j] + image[i] * mode[j]) / size;
            plain - mixed + mode[i] * mode[j] / size * (along / size + 0.01)
        });
        (
            projected,
            (0..n).map(|i| (0.7 * i as f64).sin() + mode[i]).collect(),
        )
    }

    #[test]
    fn a_lower_bound_that_is_too_high_costs_iterations_and_an_upper_one_too_low_is_told() {
        let (s, b) = long_wave();
        let tolerance = 1e-9;
        let plan = |low: f64, high: f64| Chebyshev::new([low, high], tolerance, 1000);
        let (residual, _, low_enough) = solved(&s, &b, plan(0.005, 2.2), (tolerance, 1000));
        assert!(
            residual < 2.01 * tolerance && low_enough.iterations == plan(0.005, 2.2).iterations,
            "{residual:e}"
        );
        for low in [0.02, 0.1] {
            let (residual, change, resumed) = solved(&s, &b, plan(low, 2.2), (tolerance, 1000));
            assert!(
                residual < 2.01 * tolerance && change < 1e-14,
                "{low}: {residual:e} {change:e}"
            );
            assert!(
                resumed.iterations > plan(low, 2.2).iterations && resumed.broken.is_none(),
                "{low}"
            );
        }
        let (residual, change, limited) = solved(&s, &b, plan(0.1, 2.2), (tolerance, 30));
        assert!(
            limited.iterations == 30 && residual > tolerance && residual < 1.0 && change < 1e-14,
            "{residual:e}"
        );
        let (_, _, broken) = solved(&s, &b, plan(0.005, 1.0), (tolerance, 1000));
        assert!(
            broken.broken.is_some_and(|b| b.growth > 2.0),
            "{:?}",
            broken.broken
        );
    }

    /// Round-off leaves a part of the right-hand side in the null space. It cannot be damped, so the
    /// iteration ends.
    #[test]
    fn a_residual_that_multipliers_cannot_reach_ends_the_iteration() {
        let s = matrix(8, |i, j| if i / 2 == j / 2 { 1.0 } else { 0.0 });
        let b: Vec<f64> = (0..8).map(|i| 1.0 + 1e-6 * f64::from(i % 2)).collect();
        let plan = Chebyshev::new([2.0, ceiling(&s)], 1e-9, 1000);
        let (residual, _, iterated) = solved(&s, &b, plan, (1e-9, 1000));
        assert!((4e-7..6e-7).contains(&residual), "{residual:e}");
        assert_eq!(iterated.iterations, 2 * plan.iterations);
    }

    #[test]
    fn iterations_are_as_many_as_the_bounds_ask_for() {
        for (range, tolerance) in [([0.02, 2.5], 1e-12), ([1e-5, 1.0], 1e-6), ([1.0, 1.0], 1e-3)] {
            let plan = Chebyshev::new(range, tolerance, usize::MAX);
            let [low, high] = plan.bounds;
            assert!(low <= 0.9 * range[0] && high >= 1.001 * range[1]);
            let bound = |k: usize| 1.0 / (k as f64 * ((high + low) / (high - low)).acosh()).cosh();
            assert!(
                bound(plan.iterations) <= tolerance && bound(plan.iterations - 1) > tolerance,
                "{plan:?}"
            );
            // Half as many iterations damp all but the lowest eigenvalues.
            let few = Chebyshev::new(range, tolerance, plan.iterations / 2);
            assert_eq!(
                (few.iterations, few.asked as usize),
                (plan.iterations / 2, plan.iterations)
            );
            assert!(
                few.bounds[0] > low && few.bounds[1].to_bits() == high.to_bits(),
                "{few:?}"
            );
        }
        assert_eq!(Chebyshev::new([0.1, 2.0], 0.0, 7).iterations, 7);
    }
}

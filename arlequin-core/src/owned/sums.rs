//! Sums over units of nodes: plain within a unit, exact over units.

use super::UNIT;
use crate::parallel::Pieces;
use crate::scalar::dot;
use crate::{DofLayout, Exact, Real, parallel};
use std::ops::Range;

/// Partial sums per parallel task.
const GRAIN: usize = 8;

/// Adds `Σ x y` over displacements and rotations of this rank's nodes, one term per unit.
///
/// ```
/// use arlequin_core::{DofLayout, Exact, add_products};
/// let layout = DofLayout { nodes: 2, components: 1, rotations: 0 };
/// let mut sum = Exact::zero();
/// add_products(&layout, &[1.0, 2.0], &[3.0, 4.0], &mut sum);
/// assert_eq!(sum.value(), 11.0);
/// ```
pub fn add_products<T: Real>(layout: &DofLayout, x: &[T], y: &[T], total: &mut Exact) {
    let (d, r, first) = (layout.components, layout.rotations, layout.translations());
    let part = |n: Range<usize>| {
        let moving = d * n.start..d * n.end;
        let turning = first + r * n.start..first + r * n.end;
        [dot(&x[moving.clone()], &y[moving]) + dot(&x[turning.clone()], &y[turning])]
    };
    let [sum] = unit_sums(layout.nodes, &part, parallel::pays(x.len()));
    *total += sum;
}

/// Does the work of [`add_products`] for `x` that is zero outside of some pieces, which consist of units.
pub(crate) fn add_products_in<T: Real>(
    layout: &DofLayout,
    pieces: &Pieces,
    [x, y]: [&[T]; 2],
    total: &mut Exact,
) {
    let (d, r, first) = (layout.components, layout.rotations, layout.translations());
    let part = |n: Range<usize>| {
        let moving = d * n.start..d * n.end;
        let turning = first + r * n.start..first + r * n.end;
        if !pieces.contains(moving.start) && !pieces.contains(turning.start) {
            return [T::zero()];
        }
        [dot(&x[moving.clone()], &y[moving]) + dot(&x[turning.clone()], &y[turning])]
    };
    let [sum] = unit_sums(layout.nodes, &part, parallel::pays(x.len()));
    *total += sum;
}

/// Sums over the units of `nodes` nodes.
pub(super) fn unit_sums<T: Real, const N: usize>(
    nodes: usize,
    part: &(dyn Fn(Range<usize>) -> [T; N] + Sync),
    parallel: bool,
) -> [Exact; N] {
    let sum_of_unit = |u: usize| part(u * UNIT..nodes.min((u + 1) * UNIT));
    exact_sums(0..nodes.div_ceil(UNIT), &sum_of_unit, parallel)
}

/// Sums over a range of partial sums, exactly, so that their order does not matter.
pub(super) fn exact_sums<T: Real, const N: usize>(
    range: Range<usize>,
    of: &(dyn Fn(usize) -> [T; N] + Sync),
    parallel: bool,
) -> [Exact; N] {
    if parallel && range.len() > GRAIN {
        let middle = range.start + range.len() / 2;
        let (mut a, b) = rayon::join(
            || exact_sums(range.start..middle, of, true),
            || exact_sums(middle..range.end, of, true),
        );
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        return a;
    }
    let mut out = [Exact::zero(); N];
    for piece in range {
        let sums = out.iter_mut().zip(of(piece));
        sums.for_each(|(sum, x)| sum.add(x.as_f64()));
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::Owned;

    #[test]
    fn sums_over_units_have_the_same_bits_on_any_number_of_threads() {
        let x: Vec<f64> = (0..100_003).map(|i| (f64::from(i) * 0.37).sin()).collect();
        let sums_on = |threads: usize| -> [f64; 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let part = |r: std::ops::Range<usize>| [x[r.clone()].iter().sum(), r.len() as f64];
            pool.map_or([f64::NAN; 2], |p| p.install(|| Owned::whole(x.len()).sum(&part)))
        };
        let reference = sums_on(1);
        assert!((reference[0] - x.iter().sum::<f64>()).abs() < 1e-10);
        assert_eq!(reference[1].to_bits(), 100_003_f64.to_bits());
        for threads in [2, 3] {
            assert_eq!(
                reference.map(f64::to_bits),
                sums_on(threads).map(f64::to_bits),
                "{threads} threads"
            );
        }
    }
}

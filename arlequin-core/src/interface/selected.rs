//! Factor of independent multipliers, where some depend on others.
//!
//! The dropped multipliers are zero. The others span the same space of multipliers, so `B v = 0` holds for
//! all rows, and the kick is a projection as before: it costs no energy, and each row by itself exerts
//! opposite forces on both sides.

use super::operator::LARGEST_FACTOR;
use super::rank;
use super::selection::{self, Selection};
use crate::Real;
use crate::linalg::SpdFactor;
use sprs::{CsMat, TriMat};

/// Largest pivot of a dropped multiplier over the tolerance of the rank. A row is dropped whose distance from
/// the kept ones is 1e-4 of its size at most; what small pivots divide then keeps twelve digits.
const DROPPED: f64 = 100.0;
/// Largest number of right-hand sides: the components of a vector.
const SIDES: usize = 3;

/// Cholesky factor of the rows and columns of independent multipliers, scaled to a unit diagonal.
#[derive(Debug)]
pub(super) struct Selected<T: Real> {
    kept: Vec<usize>,
    /// Scaling of the kept multipliers.
    scale: Vec<T>,
    factor: Box<dyn SpdFactor<T>>,
    /// Right-hand sides of the kept multipliers, one after another (working buffer).
    columns: Vec<T>,
}

impl<T: Real> Selected<T> {
    /// Selects and factors independent multipliers of `s`; `scaled` is the operator with a unit diagonal.
    /// Returns the factor, the extreme eigenvalues of what is factored, and the dropped rows with their
    /// remaining pivots. `None` if that takes too much, or if a solution does not satisfy the dropped rows.
    #[allow(clippy::type_complexity, reason = "three results of one computation")]
    pub(super) fn new(
        s: &CsMat<T>,
        scaled: &CsMat<T>,
        scale: &[T],
        tolerance: T,
    ) -> Option<(Self, [T; 2], Vec<(usize, T)>)> {
        let limit = tolerance * T::of(DROPPED);
        let Selection { kept, dropped } = selection::select(scaled, limit)?;
        let inner = submatrix(scaled, &kept);
        if kept.is_empty() || T::cholesky_entries(&inner) > LARGEST_FACTOR {
            return None;
        }
        let mut factor = T::cholesky(&inner, None).ok()?;
        let [low, high] = rank::extremes(&inner, &mut |b| factor.solve(b));
        let mut selected = Self {
            scale: kept.iter().map(|i| scale[*i]).collect(),
            columns: vec![T::zero(); SIDES * kept.len()],
            kept,
            factor,
        };
        let left = rank::residual(s, &mut |b| selected.solve(b, s.rows()));
        // Written so that a NaN is refused.
        (low > high * tolerance && left <= limit.sqrt()).then_some((selected, [low, high], dropped))
    }

    pub(super) fn nonzeros(&self) -> usize {
        self.factor.nonzeros()
    }

    /// Solves for right-hand sides of length `n`, stored one after another.
    pub(super) fn solve(&mut self, b: &mut [T], n: usize) {
        let Self {
            kept,
            scale,
            factor,
            columns,
        } = self;
        let count = kept.len();
        let columns = &mut columns[..count * (b.len() / n)];
        for (column, b) in columns.chunks_exact_mut(count).zip(b.chunks_exact(n)) {
            let values = kept.iter().zip(&*scale).map(|(i, s)| b[*i] * *s);
            column.iter_mut().zip(values).for_each(|(x, b)| *x = b);
        }
        factor.solve(columns);
        b.fill(T::zero());
        for (column, b) in columns.chunks_exact(count).zip(b.chunks_exact_mut(n)) {
            let kept = kept.iter().zip(&*scale).zip(column);
            kept.for_each(|((i, s), x)| b[*i] = *x * *s);
        }
    }
}

/// Returns the given rows and columns of a symmetric matrix.
fn submatrix<T: Real>(matrix: &CsMat<T>, rows: &[usize]) -> CsMat<T> {
    let mut place = vec![None; matrix.rows()];
    rows.iter().enumerate().for_each(|(k, i)| place[*i] = Some(k));
    let mut t = TriMat::new((rows.len(), rows.len()));
    for (v, (j, i)) in matrix.iter() {
        if let (Some(i), Some(j)) = (place[i], place[j]) {
            t.add_triplet(i, j, *v);
        }
    }
    t.to_csc()
}

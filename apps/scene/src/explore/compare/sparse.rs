//! Products with sparse matrices stored by rows, and unknowns that follow others by shape functions.

use arlequin::core::sprs::{CsMat, TriMat};

/// Returns `Σ A_ij x_j`.
#[inline]
pub(super) fn row_product(a: &CsMat<f64>, i: usize, x: impl Fn(usize) -> f64) -> f64 {
    let start = a.indptr();
    let row = start.raw_storage()[i]..start.raw_storage()[i + 1];
    let entries = a.indices()[row.clone()].iter().zip(&a.data()[row]);
    entries.fold(0.0, |sum, (j, v)| sum + v * x(*j))
}

/// Returns `A x`.
pub(super) fn product(a: &CsMat<f64>, x: &[f64]) -> Vec<f64> {
    (0..a.rows()).map(|i| row_product(a, i, |j| x[j])).collect()
}

/// Returns `x · y`.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// Computes `x ← x + s y`.
pub(super) fn add(x: &mut [f64], s: f64, y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += s * y);
}

/// Returns the transpose, by rows.
pub(super) fn transposed(a: &CsMat<f64>) -> CsMat<f64> {
    a.transpose_view().to_csr()
}

/// Returns a diagonal matrix.
pub(super) fn diagonal(values: impl ExactSizeIterator<Item = f64>) -> CsMat<f64> {
    let mut out = TriMat::new((values.len(), values.len()));
    let entries = values.enumerate().filter(|(_, v)| *v != 0.0);
    entries.for_each(|(i, v)| out.add_triplet(i, i, v));
    out.to_csr()
}

/// Returns `Aᵀ diag(d) A`.
pub(super) fn congruence(a: &CsMat<f64>, d: &[f64]) -> CsMat<f64> {
    &transposed(a) * &(&diagonal(d.iter().copied()) * a)
}

/// Returns whether an unknown follows others: `q_i = Σ N_ij q_j`. Rows of `N` of those that follow none are
/// empty.
pub(super) fn follows(n: &CsMat<f64>, i: usize) -> bool {
    !n.indptr().outer_inds_sz(i).is_empty()
}

/// Returns the rows `Σ N_ij q_j − q_i` of the unknowns that follow; empty rows of others.
pub(super) fn constraint(n: &CsMat<f64>) -> CsMat<f64> {
    n + &diagonal((0..n.rows()).map(|i| -f64::from(u8::from(follows(n, i)))))
}

/// Returns `T` of `q = T p`, whose columns of unknowns that follow are empty.
pub(super) fn lift(n: &CsMat<f64>) -> CsMat<f64> {
    n + &diagonal((0..n.rows()).map(|i| f64::from(u8::from(!follows(n, i)))))
}

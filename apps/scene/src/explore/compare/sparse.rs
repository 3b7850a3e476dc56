//! Products with sparse matrices stored by rows, and unknowns that follow others by shape functions.

use arlequin::core::sprs::{CsMat, TriMat};
use std::ops::Range;

/// Returns `Σ A_ij x_j` of the rows of a range.
#[inline]
pub(super) fn products(a: &CsMat<f64>, x: &[f64], rows: Range<usize>) -> impl Iterator<Item = f64> {
    let (ends, columns, values) = (a.indptr().into_raw_storage(), a.indices(), a.data());
    ends[rows.start..=rows.end].windows(2).map(move |row| {
        let entries = columns[row[0]..row[1]].iter().zip(&values[row[0]..row[1]]);
        entries.fold(0.0, |sum, (j, v)| sum + v * x[*j])
    })
}

/// Returns `A x`.
pub(super) fn product(a: &CsMat<f64>, x: &[f64]) -> Vec<f64> {
    products(a, x, 0..a.rows()).collect()
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

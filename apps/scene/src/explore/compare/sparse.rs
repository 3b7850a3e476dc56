//! Products with sparse matrices stored by rows.

use arlequin::core::sprs::{CsMat, TriMat};
use std::ops::Range;

/// Adds `scale (A x)_i` to `out[i]` for the rows of a range.
pub(super) fn add_product(a: &CsMat<f64>, x: &[f64], scale: f64, rows: Range<usize>, out: &mut [f64]) {
    let indptr = a.indptr();
    let (start, columns, values) = (indptr.raw_storage(), a.indices(), a.data());
    for i in rows {
        let entries = start[i]..start[i + 1];
        let row = columns[entries.clone()].iter().zip(&values[entries]);
        out[i] += scale * row.map(|(j, v)| v * x[*j]).sum::<f64>();
    }
}

/// Returns `A x`.
pub(super) fn product(a: &CsMat<f64>, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.rows()];
    add_product(a, x, 1.0, 0..a.rows(), &mut out);
    out
}

/// Returns the transpose, by rows.
pub(super) fn transposed(a: &CsMat<f64>) -> CsMat<f64> {
    a.transpose_view().to_csr()
}

/// Returns `A` with row `i` times `factors[i]`.
pub(super) fn scaled_rows(a: &CsMat<f64>, factors: &[f64]) -> CsMat<f64> {
    let mut out = TriMat::with_capacity((a.rows(), a.cols()), a.nnz());
    for (v, (i, j)) in a {
        out.add_triplet(i, j, *v * factors[i]);
    }
    out.to_csr()
}

/// Returns `Aᵀ diag(d) A`.
pub(super) fn congruence(a: &CsMat<f64>, d: &[f64]) -> CsMat<f64> {
    &transposed(a) * &scaled_rows(a, d)
}

/// Stacks two square matrices along the diagonal.
pub(super) fn block_diagonal(a: &CsMat<f64>, b: &CsMat<f64>) -> CsMat<f64> {
    let n = a.rows();
    let size = n + b.rows();
    let mut out = TriMat::with_capacity((size, size), a.nnz() + b.nnz());
    a.iter().for_each(|(v, (i, j))| out.add_triplet(i, j, *v));
    b.iter().for_each(|(v, (i, j))| out.add_triplet(n + i, n + j, *v));
    out.to_csr()
}

/// Puts two matrices with equally many rows side by side, the second one negated and from column `split`
/// on, in `size` columns in all.
pub(super) fn difference(a: &CsMat<f64>, b: &CsMat<f64>, split: usize, size: usize) -> CsMat<f64> {
    let mut out = TriMat::with_capacity((a.rows(), size), a.nnz() + b.nnz());
    a.iter().for_each(|(v, (i, j))| out.add_triplet(i, j, *v));
    b.iter()
        .for_each(|(v, (i, j))| out.add_triplet(i, split + j, -*v));
    out.to_csr()
}

//! Products with sparse matrices stored by rows.

use arlequin::core::sprs::{CsMat, bmat, hstack};
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
    let mut out = a.clone();
    for (i, factor) in factors.iter().enumerate() {
        let mut row = out.outer_view_mut(i);
        row.iter_mut()
            .flat_map(|r| r.iter_mut())
            .for_each(|(_, v)| *v *= factor);
    }
    out
}

/// Returns `Aᵀ diag(d) A`.
pub(super) fn congruence(a: &CsMat<f64>, d: &[f64]) -> CsMat<f64> {
    &transposed(a) * &scaled_rows(a, d)
}

/// Stacks two square matrices along the diagonal.
pub(super) fn block_diagonal(a: &CsMat<f64>, b: &CsMat<f64>) -> CsMat<f64> {
    bmat(&[[Some(a.view()), None], [None, Some(b.view())]])
}

/// Puts two matrices with equally many rows side by side, the second one negated, in `size` columns in all.
pub(super) fn difference(a: &CsMat<f64>, b: &CsMat<f64>, size: usize) -> CsMat<f64> {
    let zeros = CsMat::zero((a.rows(), size - a.cols() - b.cols()));
    hstack(&[a.view(), b.map(|x| -x).view(), zeros.view()]).to_csr()
}

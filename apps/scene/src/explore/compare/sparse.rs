//! Products with sparse matrices stored by rows, and unknowns that follow others.

use arlequin::core::ShapeRow;
use arlequin::core::sprs::{CsMat, TriMat};

/// Returns `Σ A_ij x_j`.
pub(super) fn row_product(a: &CsMat<f64>, i: usize, x: impl Fn(usize) -> f64) -> f64 {
    let row = a.indptr().outer_inds_sz(i);
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

/// Unknowns that follow others: `q_i = Σ N_ij q_j`.
#[derive(Debug)]
pub(super) struct Followers {
    /// `N` over all unknowns; rows of those that follow none are empty.
    pub(super) rows: CsMat<f64>,
    /// One for unknowns that follow, zero for others.
    follow: Vec<f64>,
}

impl Followers {
    /// Makes the `d` displacements of nodes, each given by its first unknown, follow a field whose unknowns
    /// begin at a number, by shape functions.
    pub(super) fn new(
        size: usize,
        d: usize,
        field: usize,
        nodes: impl Iterator<Item = (usize, ShapeRow<f64>)>,
    ) -> Self {
        let (mut rows, mut follow) = (TriMat::new((size, size)), vec![0.0; size]);
        for (first, row) in nodes {
            for c in 0..d {
                follow[first + c] = 1.0;
                let shapes = row.nodes.iter().zip(&row.values);
                shapes.for_each(|(node, value)| rows.add_triplet(first + c, field + node * d + c, *value));
            }
        }
        let rows = rows.to_csr();
        Self { rows, follow }
    }

    /// Joins unknowns that follow others the other way.
    pub(super) fn with(self, other: &Self) -> Self {
        let follow = self.follow.iter().zip(&other.follow);
        Self {
            rows: &self.rows + &other.rows,
            follow: follow.map(|(a, b)| a + b).collect(),
        }
    }

    /// Returns whether an unknown follows others.
    pub(super) fn has(&self, i: usize) -> bool {
        self.follow[i] > 0.0
    }

    /// Number of unknowns that follow.
    pub(super) fn count(&self) -> usize {
        self.follow.iter().filter(|f| **f > 0.0).count()
    }

    /// Rows `Σ N_ij q_j − q_i` of the unknowns that follow; empty rows of others.
    pub(super) fn constraint(&self) -> CsMat<f64> {
        &self.rows + &diagonal(self.follow.iter().map(|f| -f))
    }

    /// Returns `T` of `q = T p`, whose columns of unknowns that follow are empty.
    pub(super) fn lift(&self) -> CsMat<f64> {
        &self.rows + &diagonal(self.follow.iter().map(|f| 1.0 - f))
    }
}

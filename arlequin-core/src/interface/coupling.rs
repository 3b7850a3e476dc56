//! Coupling matrix of one side as the assembly makes it.

use super::Draft;
use crate::Real;
use sprs::{CsMat, TriMat};

/// Coupling matrix of one side, multiplier rows by model columns.
#[derive(Debug, Clone)]
pub(crate) struct Coupling<T> {
    pub(crate) matrix: CsMat<T>,
    /// Vector components that share a scalar matrix; 1 if the matrix itself holds all components.
    pub(crate) shared: usize,
}

impl<T: Real> Coupling<T> {
    /// Returns the measure of a multiplier node `i`: `Σ_j ‖B_ij‖` over the model's nodes `j`. The norm of a
    /// block is the root mean square of its singular values, which does not depend on the axes.
    pub(super) fn measure(&self, node: usize, components: usize) -> T {
        let split = components / self.shared;
        let rows = (node * split..(node + 1) * split).filter_map(|k| self.matrix.outer_view(k));
        let mut entries: Vec<(usize, T)> = rows
            .flat_map(|r| r.iter().map(|(j, b)| (j / split, *b * *b)).collect::<Vec<_>>())
            .collect();
        entries.sort_by_key(|e| e.0);
        let blocks = entries.chunk_by(|a, b| a.0 == b.0);
        let square = |block: &[(usize, T)]| block.iter().map(|e| e.1).sum::<T>() / T::of(split as f64);
        blocks.map(|block| square(block).sqrt()).sum()
    }

    /// Returns the matrix for all components, interleaved.
    pub(super) fn expanded(&self) -> CsMat<T> {
        let d = self.shared;
        let size = (self.matrix.rows() * d, self.matrix.cols() * d);
        let mut triplets = TriMat::with_capacity(size, self.matrix.nnz() * d);
        for (v, (i, j)) in self.matrix.iter() {
            (0..d).for_each(|c| triplets.add_triplet(i * d + c, j * d + c, *v));
        }
        triplets.to_csr()
    }
}

impl<T: Real> Draft<T> {
    /// Returns the node of one side with the largest entry of the coupling matrix relative to the measure of
    /// its multiplier, and this ratio. Only nodes with `is_wanted` count; the ratio is zero if there are
    /// none.
    pub(crate) fn largest_share(&self, side: usize, is_wanted: &dyn Fn(usize) -> bool) -> (usize, T) {
        let Coupling { matrix, shared } = &self.coupling[side];
        let split = self.interface.components / shared;
        let wanted = matrix.iter().filter(|(_, (_, j))| is_wanted(j / split));
        wanted.fold((0, T::zero()), |most, (b, (i, j))| {
            let share = b.abs() / self.interface.measures[i / split].max(T::of(f64::MIN_POSITIVE));
            if share > most.1 { (j / split, share) } else { most }
        })
    }
}

/// Returns whether two sets of inverse inertias agree on all coupled columns.
pub(super) fn same_on_coupled<T: Real>(coupling: &[Coupling<T>], a: &[Vec<T>], b: &[Vec<T>]) -> bool {
    let mut sides = coupling.iter().zip(a.iter().zip(b));
    sides.all(|(side, (a, b))| side.matrix.iter().all(|(_, (_, j))| a[j] == b[j]))
}

/// Computes `Σ_m B_m diag(weights_m) B_mᵀ`, symmetric to the bit.
pub(super) fn operator<T: Real>(coupling: &[Coupling<T>], weights: &[Vec<T>]) -> CsMat<T> {
    let n = coupling[0].matrix.rows();
    let mut sum = TriMat::new((n, n));
    for (m, weights) in weights.iter().enumerate() {
        let b = &coupling[m].matrix;
        let mut scaled = b.clone();
        let columns: Vec<usize> = scaled.indices().to_vec();
        scaled
            .data_mut()
            .iter_mut()
            .zip(columns)
            .for_each(|(v, j)| *v *= weights[j]);
        let product: CsMat<T> = &scaled * &b.transpose_view().to_csr();
        // Half of each entry goes to either triangle: symmetric for any order of summation.
        for (v, (i, j)) in product.iter() {
            sum.add_triplet(i, j, *v * T::of(0.5));
            sum.add_triplet(j, i, *v * T::of(0.5));
        }
    }
    sum.to_csc()
}

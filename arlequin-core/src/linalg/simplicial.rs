//! Solves with a sparse triangular factor whose columns are stored one by one, for the components of a vector
//! at once.

use super::SpdFactor;
use crate::Real;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};
use std::ops::Range;

/// Right-hand sides in one pass over the factor: three components, padded to what processors add at once.
const LANES: usize = 4;

/// Factor `A = Pᵀ L Lᵀ P` by columns of `L`.
pub(super) struct Simplicial<T> {
    /// Row of `A` that is eliminated at each place.
    order: Vec<u32>,
    /// First entry of each column below the diagonal, then the number of entries.
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<T>,
    /// Inverse of the diagonal of `L`.
    inverse_diagonal: Vec<T>,
    /// Right-hand sides in the order of elimination, interleaved.
    x: Vec<T>,
}

impl<T> std::fmt::Debug for Simplicial<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simplicial")
            .field("size", &self.order.len())
            .field("nonzeros", &self.values.len())
            .finish_non_exhaustive()
    }
}

impl<T: Real> Simplicial<T> {
    /// Takes over a factor `L Lᵀ`; `None` if its columns are stored in blocks.
    pub(super) fn new(symbolic: &SymbolicCholesky<usize>, factor: &[T]) -> Option<Self> {
        let SymbolicCholeskyRaw::Simplicial(simplicial) = symbolic.raw() else {
            return None;
        };
        let (first, row) = (simplicial.col_ptr(), simplicial.row_idx());
        let size = symbolic.nrows();
        // The first entry of a column is its diagonal.
        let below = (0..size).map(|j| first[j] + 1..first[j + 1]);
        let mut starts = vec![0; size + 1];
        (0..size).for_each(|j| starts[j + 1] = first[j + 1] - j - 1);
        let order: Vec<u32> = match symbolic.perm() {
            Some(permutation) => permutation.arrays().0.iter().map(|k| *k as u32).collect(),
            None => (0..size as u32).collect(),
        };
        Some(Self {
            order,
            starts,
            rows: below.clone().flatten().map(|k| row[k] as u32).collect(),
            values: below.flatten().map(|k| factor[k]).collect(),
            inverse_diagonal: (0..size).map(|j| T::one() / factor[first[j]]).collect(),
            x: vec![T::zero(); size * LANES],
        })
    }

    fn column(&self, j: usize) -> Range<usize> {
        self.starts[j]..self.starts[j + 1]
    }

    /// Solves for up to `N` right-hand sides, stored one after another in `b`.
    fn solve_lanes<const N: usize>(&mut self, b: &mut [T]) {
        let size = self.order.len();
        let mut x = std::mem::take(&mut self.x);
        let lanes = &mut x.as_chunks_mut::<N>().0[..size];
        for (lane, row) in lanes.iter_mut().zip(&self.order) {
            let sides = b.chunks_exact(size).map(|side| side[*row as usize]);
            lane.iter_mut().zip(sides).for_each(|(x, b)| *x = b);
        }
        // `L y = b`: each unknown is subtracted from those below it.
        for j in 0..size {
            let pivot = lanes[j].map(|x| x * self.inverse_diagonal[j]);
            lanes[j] = pivot;
            let entries = self.column(j);
            for (i, value) in self.rows[entries.clone()].iter().zip(&self.values[entries]) {
                let x = &mut lanes[*i as usize];
                (0..N).for_each(|c| x[c] -= *value * pivot[c]);
            }
        }
        // `Lᵀ x = y`: each unknown gathers those below it.
        for j in (0..size).rev() {
            let entries = self.column(j);
            let (rows, values) = (&self.rows[entries.clone()], &self.values[entries]);
            let sum = gathered(lanes, rows, values);
            (0..N).for_each(|c| lanes[j][c] = (lanes[j][c] - sum[c]) * self.inverse_diagonal[j]);
        }
        for (lane, row) in lanes.iter().zip(&self.order) {
            let sides = b.chunks_exact_mut(size);
            sides.zip(lane).for_each(|(side, x)| side[*row as usize] = *x);
        }
        self.x = x;
    }
}

/// `Σ_k values_k x_rows_k`, in two interleaved sums: in a single one each addition would wait for the last.
fn gathered<T: Real, const N: usize>(x: &[[T; N]], rows: &[u32], values: &[T]) -> [T; N] {
    let (mut even, mut odd) = ([T::zero(); N], [T::zero(); N]);
    let ((rows, last_row), (values, last_value)) = (rows.as_chunks::<2>(), values.as_chunks::<2>());
    for ([i, j], [a, b]) in rows.iter().zip(values) {
        let (p, q) = (&x[*i as usize], &x[*j as usize]);
        for c in 0..N {
            even[c] += *a * p[c];
            odd[c] += *b * q[c];
        }
    }
    for (i, a) in last_row.iter().zip(last_value) {
        (0..N).for_each(|c| even[c] += *a * x[*i as usize][c]);
    }
    (0..N).for_each(|c| even[c] += odd[c]);
    even
}

impl<T: Real> SpdFactor<T> for Simplicial<T> {
    fn solve(&mut self, b: &mut [T]) {
        let size = self.order.len();
        if b.len() == size {
            return self.solve_lanes::<1>(b);
        }
        for b in b.chunks_mut((size * LANES).max(1)) {
            self.solve_lanes::<LANES>(b);
        }
    }
    fn size(&self) -> usize {
        self.order.len()
    }
    fn nonzeros(&self) -> usize {
        self.values.len() + self.order.len()
    }
}

#[cfg(test)]
mod tests {
    use crate::Real;
    use sprs::{CsMat, TriMat};

    /// Ring with chords: a factor with fill, stored by columns.
    fn ring(size: usize) -> CsMat<f64> {
        let mut t = TriMat::new((size, size));
        for i in 0..size {
            t.add_triplet(i, i, 5.0 + i as f64 * 0.1);
            for j in [(i + 1) % size, (i + 7) % size] {
                t.add_triplet(i, j, -1.0);
                t.add_triplet(j, i, -1.0);
            }
        }
        t.to_csc()
    }

    #[test]
    fn any_number_of_sides_is_solved_with_the_same_bits() {
        let (size, matrix) = (60, ring(60));
        let mut factor = f64::cholesky(&matrix, None).unwrap();
        assert!(format!("{factor:?}").starts_with("Simplicial"), "{factor:?}");
        assert!(factor.size() == size && factor.nonzeros() > 3 * size);
        let x = |k: usize| {
            (0..size)
                .map(move |i| ((i + 31 * k) as f64).sin())
                .collect::<Vec<f64>>()
        };
        let side = |k: usize| {
            let (x, mut b) = (x(k), vec![0.0; size]);
            matrix.iter().for_each(|(v, (i, j))| b[i] += v * x[j]);
            b
        };
        for count in [1, 2, 3, 4, 5, 9] {
            let mut together: Vec<f64> = (0..count).flat_map(side).collect();
            factor.solve(&mut together);
            for (k, solved) in together.chunks_exact(size).enumerate() {
                let mut alone = side(k);
                factor.solve(&mut alone);
                assert_eq!(solved, alone);
                for (a, b) in solved.iter().zip(x(k)) {
                    assert!((a - b).abs() < 1e-13, "{count}, {k}: {a} {b}");
                }
            }
        }
    }
}

//! Sparse matrices in rows of small square blocks, and the internal forces `−K q` they give.
//!
//! For models that store an assembled stiffness. Each row is gathered on its own and in a fixed order:
//! results have the same bits for any number of threads.

use crate::Owned;
use crate::Real;
use rayon::prelude::*;
use sprs::CsMat;
use std::ops::Range;

/// Block rows per parallel task.
const CHUNK: usize = 512;

/// Matrices with fewer stored values are multiplied on the calling thread: waking others costs more than it
/// saves. The limit is some 1 300 nodes of hexahedra, 2 000 of tetrahedra, 87 000 of a bar.
const SERIAL: usize = 1 << 18;

/// A square matrix, or some rows of one, in compressed rows of square blocks: 3 × 3, or single numbers.
#[derive(Debug, Clone)]
pub struct BlockMatrix<T> {
    /// Rows and columns of a block.
    size: usize,
    /// Block columns.
    width: usize,
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T: Real> BlockMatrix<T> {
    /// Zero matrix with blocks of `size` (3 or 1). Block row `i` has the ascending block columns
    /// `columns[starts[i]..starts[i + 1]]`.
    pub fn zeros(size: usize, starts: Vec<usize>, columns: Vec<u32>) -> Self {
        let values = vec![T::zero(); columns.len() * size * size];
        Self::new(size, starts, columns, values)
    }

    /// Matrix with the pattern of [`BlockMatrix::zeros`] and its `values`, block after block, each by rows.
    pub fn new(size: usize, starts: Vec<usize>, columns: Vec<u32>, values: Vec<T>) -> Self {
        debug_assert_eq!(values.len(), columns.len() * size * size);
        Self {
            size,
            width: starts.len() - 1,
            starts,
            columns,
            values,
        }
    }

    /// Restricts the matrix to some block `rows`, in the given order, for vectors of `width` blocks. `column`
    /// maps a block column to its place in these vectors and must keep the order.
    ///
    /// # Panics
    /// For a row that does not exist.
    #[must_use]
    pub fn some_rows(
        &self,
        rows: impl Iterator<Item = usize>,
        width: usize,
        column: impl Fn(u32) -> u32,
    ) -> Self {
        let square = self.size * self.size;
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in rows {
            // The pattern is cut out; blocks keep their order, so rows keep the bits of their sums.
            let range = self.starts[i]..self.starts[i + 1];
            columns.extend(self.columns[range.clone()].iter().map(|j| column(*j)));
            values.extend_from_slice(&self.values[range.start * square..range.end * square]);
            starts.push(columns.len());
        }
        Self {
            width,
            ..Self::new(self.size, starts, columns, values)
        }
    }

    /// Block columns of a row.
    pub fn columns(&self, i: usize) -> &[u32] {
        &self.columns[self.starts[i]..self.starts[i + 1]]
    }

    /// The stored values, block after block.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// Sets all values to zero.
    pub fn clear(&mut self) {
        self.values.fill(T::zero());
    }

    fn slot(&self, i: usize, j: u32) -> usize {
        let row = &self.columns[self.starts[i]..self.starts[i + 1]];
        self.starts[i] + row.partition_point(|&k| k < j)
    }

    /// Adds `weight · block` at block row `i` and block column `j`, which the pattern must hold.
    pub fn add(&mut self, i: usize, j: u32, block: &nalgebra::Matrix3<T>, weight: T) {
        let (c, slot) = (self.size, self.slot(i, j));
        let values = &mut self.values[slot * c * c..(slot + 1) * c * c];
        // Models of one component use the first entry of the block.
        for a in 0..c {
            for b in 0..c {
                values[a * c + b] += block[(a, b)] * weight;
            }
        }
    }

    /// Subtracts `K q` from `f` \[N\]. Allocates nothing.
    pub fn subtract_product(&self, q: &[T], f: &mut [T]) {
        match self.size {
            1 => self.subtract_rows::<1>(q, f),
            _ => self.subtract_rows::<3>(q, f),
        }
    }

    fn subtract_rows<const C: usize>(&self, q: &[T], f: &mut [T]) {
        let q = q.as_chunks::<C>().0;
        let f = &mut f[..C * (self.starts.len() - 1)];
        let work = |chunk: usize, f: &mut [T]| {
            for (i, out) in (chunk * CHUNK..).zip(f.as_chunks_mut::<C>().0) {
                let y = self.row_product::<C>(i, q);
                for (o, y) in out.iter_mut().zip(y) {
                    *o -= y;
                }
            }
        };
        // Both ways have the same bits, as every row is a sum of its own.
        if self.values.len() < SERIAL {
            f.chunks_mut(CHUNK * C).enumerate().for_each(|(k, f)| work(k, f));
        } else {
            f.par_chunks_mut(CHUNK * C)
                .enumerate()
                .for_each(|(k, f)| work(k, f));
        }
    }

    /// Block row `i` of `K q`.
    #[inline]
    fn row_product<const C: usize>(&self, i: usize, q: &[[T; C]]) -> [T; C] {
        let range = self.starts[i]..self.starts[i + 1];
        // Nested arrays of a generic size cannot be sliced flat, so a block is C rows of C values.
        let values = self.values[range.start * C * C..range.end * C * C]
            .as_chunks::<C>()
            .0;
        // One sum per entry of the block: additions that do not wait for each other, a tenth faster.
        let mut sums = [[T::zero(); C]; C];
        for (j, block) in self.columns[range].iter().zip(values.chunks_exact(C)) {
            let x = &q[*j as usize];
            for (sums, a) in sums.iter_mut().zip(block) {
                for ((s, a), x) in sums.iter_mut().zip(a).zip(x) {
                    *s += *a * *x;
                }
            }
        }
        let mut y = [T::zero(); C];
        for (y, sums) in y.iter_mut().zip(&sums) {
            *y = sums.iter().fold(T::zero(), |t, s| t + *s);
        }
        y
    }

    /// Energy `½ qᵀ K q` \[J\]. The sum over units of nodes is exact, and so has the same bits for any number
    /// of threads. Allocates nothing.
    pub fn energy(&self, q: &[T]) -> T {
        self.energy_over_ranks(&Owned::whole(q.len() / self.size), q, q)
    }

    /// Energy `½ qᵀ K q` \[J\] over the rows of all ranks. `local` are the unknowns of the owned rows, `q`
    /// all unknowns that these rows read. Collective.
    pub fn energy_over_ranks(&self, owned: &Owned, local: &[T], q: &[T]) -> T {
        let sum = match self.size {
            1 => self.energy_in_blocks::<1>(owned, local.as_chunks().0, q.as_chunks().0),
            _ => self.energy_in_blocks::<3>(owned, local.as_chunks().0, q.as_chunks().0),
        };
        sum * T::of(0.5)
    }

    fn energy_in_blocks<const C: usize>(&self, owned: &Owned, local: &[[T; C]], q: &[[T; C]]) -> T {
        let part = |rows: Range<usize>| {
            let sum = rows.fold(T::zero(), |sum, i| {
                let y = self.row_product::<C>(i, q);
                // The product of a row is the one that the forces use, so energy and forces round alike.
                sum + y.iter().zip(&local[i]).fold(T::zero(), |s, (a, b)| s + *a * *b)
            });
            [sum]
        };
        let [sum] = owned.sum(&part);
        sum
    }

    /// Converts the matrix to scalar compressed rows.
    pub fn to_csr(&self) -> CsMat<T> {
        let c = self.size;
        let rows = self.starts.len() - 1;
        let mut starts = Vec::with_capacity(rows * c + 1);
        let mut columns = Vec::with_capacity(self.values.len());
        let mut values = Vec::with_capacity(self.values.len());
        starts.push(0);
        for i in 0..rows {
            // Block by block: a scalar row takes one row of each block.
            for a in 0..c {
                for slot in self.starts[i]..self.starts[i + 1] {
                    for b in 0..c {
                        columns.push(self.columns[slot] as usize * c + b);
                        values.push(self.values[slot * c * c + a * c + b]);
                    }
                }
                starts.push(columns.len());
            }
        }
        CsMat::new((rows * c, self.width * c), starts, columns, values)
    }

    /// Number of stored values.
    pub fn stored(&self) -> usize {
        self.values.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use nalgebra::Matrix3;

    /// A symmetric matrix of four block rows with some blocks missing.
    fn sample() -> BlockMatrix<f64> {
        let starts = vec![0, 2, 5, 7, 8];
        let columns = vec![0, 1, 0, 1, 2, 1, 2, 3];
        let mut m = BlockMatrix::zeros(3, starts, columns);
        let block = |k: f64| Matrix3::new(1.0, k, 2.0, 0.5 * k, 3.0, -1.0, k, 0.1, 4.0);
        for (i, j) in [(0, 1), (1, 2)] {
            let b = block(1.0 + i as f64);
            m.add(i, j, &b, 2.0);
            m.add(j as usize, i as u32, &b.transpose(), 2.0);
        }
        for i in 0..4 {
            let b = block(0.3);
            m.add(i, i as u32, &((b + b.transpose()) * 4.0), 1.0);
        }
        m
    }

    #[test]
    fn products_and_energies_are_those_of_the_scalar_rows() {
        let (m, csr) = (sample(), sample().to_csr());
        let q: Vec<f64> = (0..12).map(|i| f64::from(i).cos()).collect();
        let mut expected = vec![1.0; 12];
        csr.iter().for_each(|(v, (i, j))| expected[i] -= v * q[j]);
        let mut f = vec![1.0; 12];
        m.subtract_product(&q, &mut f);
        for (a, b) in f.iter().zip(&expected) {
            assert_abs_diff_eq!(a, b, epsilon = 1e-13);
        }
        let work: f64 = q.iter().zip(&expected).map(|(q, f)| 0.5 * q * (1.0 - f)).sum();
        assert!((m.energy(&q) - work).abs() < 1e-12 * work.abs());
    }

    #[test]
    fn some_rows_have_the_bits_of_all() {
        let m = sample();
        let q: Vec<f64> = (0..12).map(|i| f64::from(i).cos()).collect();
        let mut all = vec![0.0; 12];
        m.subtract_product(&q, &mut all);
        // Rows 1 and 3 know the nodes 0 to 3 as 1 to 4 of five.
        let some = m.some_rows([1, 3].into_iter(), 5, |j| j + 1);
        let wide: Vec<f64> = [0.0; 3].into_iter().chain(q.iter().copied()).collect();
        let mut f = vec![0.0; 6];
        some.subtract_product(&wide, &mut f);
        assert_eq!(f, [&all[3..6], &all[9..12]].concat());
        assert_eq!((some.columns(0), some.columns(1)), (&[1, 2, 3][..], &[4][..]));
        assert_eq!(some.to_csr().shape(), (6, 15));
        let own = [&q[3..6], &q[9..12]].concat();
        let work: f64 = own.iter().zip(&f).map(|(q, f)| -0.5 * q * f).sum();
        assert!((some.energy_over_ranks(&Owned::whole(2), &own, &wide) - work).abs() < 1e-14 * work.abs());
    }
}

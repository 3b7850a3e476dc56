//! Sparse matrices in rows of small square blocks, and the internal forces `−K q` they give.
//!
//! For models that store an assembled stiffness. Each row is gathered on its own and in a fixed order:
//! results have the same bits for any number of threads.

use crate::Owned;
use crate::Real;
use rayon::prelude::*;
use sprs::CsMat;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hasher};
use std::ops::Range;

/// Block rows per parallel task.
const CHUNK: usize = 512;

/// Matrices with fewer values are multiplied on the calling thread: waking others costs more than it saves,
/// twice per product. The limit is some 4 000 nodes of hexahedra, 8 000 of tetrahedra, 350 000 of a bar.
const SERIAL: usize = 1 << 20;

/// A square matrix, or some rows of one, in compressed rows of square blocks: 3 × 3, or single numbers. Rows
/// with the same values may share them.
#[derive(Debug, Clone)]
pub struct BlockMatrix<T> {
    /// Rows and columns of a block.
    size: usize,
    /// Block columns.
    width: usize,
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Number of the block in `values` with which each row begins.
    first: Vec<usize>,
    /// Blocks by columns, and a zero more, as four numbers are read for the three of a column.
    values: Vec<T>,
}

impl<T: Real> BlockMatrix<T> {
    /// Zero matrix with blocks of `size` (3 or 1). Block row `i` has the ascending block columns
    /// `columns[starts[i]..starts[i + 1]]`.
    pub fn zeros(size: usize, starts: Vec<usize>, columns: Vec<u32>) -> Self {
        let values = vec![T::zero(); columns.len() * size * size];
        Self::by_columns(size, starts, columns, values)
    }

    /// Matrix whose blocks are given by columns, without rows that share values.
    fn by_columns(size: usize, starts: Vec<usize>, columns: Vec<u32>, mut values: Vec<T>) -> Self {
        values.push(T::zero());
        Self {
            size,
            width: starts.len() - 1,
            first: starts[..starts.len() - 1].to_vec(),
            starts,
            columns,
            values,
        }
    }

    /// Matrix with the pattern of [`BlockMatrix::zeros`] and its `values`, block after block, each by rows.
    pub fn new(size: usize, starts: Vec<usize>, columns: Vec<u32>, mut values: Vec<T>) -> Self {
        debug_assert_eq!(values.len(), columns.len() * size * size);
        for block in values.chunks_exact_mut(size * size) {
            for (a, b) in (0..size).flat_map(|a| (0..a).map(move |b| (a, b))) {
                block.swap(a * size + b, b * size + a);
            }
        }
        Self::by_columns(size, starts, columns, values)
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
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in rows {
            // The pattern is cut out; blocks keep their order, so rows keep the bits of their sums.
            columns.extend(self.columns(i).iter().map(|j| column(*j)));
            values.extend_from_slice(self.row_values(i));
            starts.push(columns.len());
        }
        let mut some = Self {
            width,
            ..Self::by_columns(self.size, starts, columns, values)
        };
        some.share_rows();
        some
    }

    /// Lets rows with the same values share them, if at least half of the rows can. In a regular mesh nearly
    /// all can, and products then read little beside the vectors.
    pub fn share_rows(&mut self) {
        let square = self.size * self.size;
        let mut known: HashMap<u64, Vec<usize>> = HashMap::new();
        let (mut first, mut values) = (Vec::with_capacity(self.first.len()), Vec::new());
        for i in 0..self.first.len() {
            let row = self.row_values(i);
            let mut hasher = DefaultHasher::new();
            row.iter().for_each(|x| hasher.write_u64(x.as_f64().to_bits()));
            let alike = known.entry(hasher.finish()).or_default();
            // Compared as numbers: zeros of either sign give the same products.
            let found = alike.iter().find(|k| values[**k * square..].starts_with(row));
            let place = found.copied().unwrap_or_else(|| {
                alike.push(values.len() / square);
                values.extend_from_slice(row);
                values.len() / square - row.len() / square
            });
            first.push(place);
            if 2 * values.len() > self.values.len() {
                return;
            }
        }
        values.push(T::zero());
        values.shrink_to_fit();
        (self.first, self.values) = (first, values);
    }

    /// Values of a row, block after block, each by columns.
    pub fn row_values(&self, i: usize) -> &[T] {
        let square = self.size * self.size;
        let first = self.first[i] * square;
        &self.values[first..first + (self.starts[i + 1] - self.starts[i]) * square]
    }

    /// Block columns of a row.
    pub fn columns(&self, i: usize) -> &[u32] {
        &self.columns[self.starts[i]..self.starts[i + 1]]
    }

    /// Sets all values to zero; every row then has values of its own.
    pub fn clear(&mut self) {
        let rows = self.first.len();
        self.first.copy_from_slice(&self.starts[..rows]);
        self.values.clear();
        let count = self.columns.len() * self.size * self.size;
        self.values.resize(count + 1, T::zero());
    }

    fn slot(&self, i: usize, j: u32) -> usize {
        let row = &self.columns[self.starts[i]..self.starts[i + 1]];
        self.starts[i] + row.partition_point(|&k| k < j)
    }

    /// Adds `weight · block` at block row `i` and block column `j`, which the pattern must hold. Rows must
    /// not share values.
    pub fn add(&mut self, i: usize, j: u32, block: &nalgebra::Matrix3<T>, weight: T) {
        let (c, slot) = (self.size, self.slot(i, j));
        let values = &mut self.values[slot * c * c..(slot + 1) * c * c];
        // Models of one component use the first entry of the block.
        for b in 0..c {
            for a in 0..c {
                values[b * c + a] += block[(a, b)] * weight;
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
        let (matrix, q, arch) = (self, q.as_chunks::<C>().0, pulp::Arch::new());
        let f = &mut f[..C * self.first.len()];
        let work = |chunk: usize, f: &mut [T]| {
            arch.dispatch(SubtractRows {
                matrix,
                first: chunk * CHUNK,
                q,
                f: f.as_chunks_mut::<C>().0,
            });
        };
        // Both ways have the same bits, as every row is a sum of its own.
        if C * C * self.columns.len() < SERIAL {
            f.chunks_mut(CHUNK * C).enumerate().for_each(|(k, f)| work(k, f));
        } else {
            f.par_chunks_mut(CHUNK * C)
                .enumerate()
                .for_each(|(k, f)| work(k, f));
        }
    }

    /// Block row `i` of `K q`.
    #[inline(always)]
    fn row_product<const C: usize>(&self, i: usize, q: &[[T; C]]) -> [T; C] {
        let columns = &self.columns[self.starts[i]..self.starts[i + 1]];
        let mut values = &self.values[self.first[i] * C * C..];
        // One sum per entry of the block: additions do not wait for each other. A column is read as four
        // numbers, which fill a register; the fourth sum is not used.
        let mut sums = [[T::zero(); 4]; C];
        for j in columns {
            let x = &q[*j as usize];
            for (b, sums) in sums.iter_mut().enumerate() {
                match values.get(b * C..).and_then(|v| v.first_chunk::<4>()) {
                    Some(column) if C == 3 => (0..4).for_each(|a| sums[a] += column[a] * x[b]),
                    _ => (0..C).for_each(|a| sums[a] += values[b * C + a] * x[b]),
                }
            }
            values = &values[C * C..];
        }
        std::array::from_fn(|a| sums.iter().fold(T::zero(), |t, s| t + s[a]))
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
        let (matrix, arch) = (self, pulp::Arch::new());
        let part = |rows: Range<usize>| {
            [arch.dispatch(EnergyOfRows {
                matrix,
                rows,
                local,
                q,
            })]
        };
        let [sum] = owned.sum(&part);
        sum
    }

    /// Converts the matrix to scalar compressed rows.
    pub fn to_csr(&self) -> CsMat<T> {
        let c = self.size;
        let rows = self.starts.len() - 1;
        let mut starts = Vec::with_capacity(rows * c + 1);
        let stored = self.columns.len() * c * c;
        let mut columns = Vec::with_capacity(stored);
        let mut values = Vec::with_capacity(stored);
        starts.push(0);
        for i in 0..rows {
            let blocks = || self.columns(i).iter().zip(self.row_values(i).chunks_exact(c * c));
            // Block by block: a scalar row takes one row of each block.
            for a in 0..c {
                for (j, block) in blocks() {
                    for b in 0..c {
                        columns.push(*j as usize * c + b);
                        values.push(block[b * c + a]);
                    }
                }
                starts.push(columns.len());
            }
        }
        CsMat::new((rows * c, self.width * c), starts, columns, values)
    }
}

/// Subtracts some rows of a product, compiled for the widest registers of the processor. Products and sums
/// are rounded one by one on all processors, so their bits do not differ.
struct SubtractRows<'a, T, const C: usize> {
    matrix: &'a BlockMatrix<T>,
    /// Number of the first row.
    first: usize,
    q: &'a [[T; C]],
    f: &'a mut [[T; C]],
}

impl<T: Real, const C: usize> pulp::NullaryFnOnce for SubtractRows<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (i, out) in (self.first..).zip(self.f) {
            let y = self.matrix.row_product::<C>(i, self.q);
            (0..C).for_each(|c| out[c] -= y[c]);
        }
    }
}

/// `qᵀ K q` over some rows.
struct EnergyOfRows<'a, T, const C: usize> {
    matrix: &'a BlockMatrix<T>,
    rows: Range<usize>,
    local: &'a [[T; C]],
    q: &'a [[T; C]],
}

impl<T: Real, const C: usize> pulp::NullaryFnOnce for EnergyOfRows<'_, T, C> {
    type Output = T;

    #[inline(always)]
    fn call(self) -> T {
        self.rows.fold(T::zero(), |sum, i| {
            // The product of a row is the one that the forces use, so energy and forces round alike.
            let y = self.matrix.row_product::<C>(i, self.q);
            sum + y
                .iter()
                .zip(&self.local[i])
                .fold(T::zero(), |s, (a, b)| s + *a * *b)
        })
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
        assert_eq!(some.row_values(1), m.row_values(3));
        let own = [&q[3..6], &q[9..12]].concat();
        let work: f64 = own.iter().zip(&f).map(|(q, f)| -0.5 * q * f).sum();
        assert!((some.energy_over_ranks(&Owned::whole(2), &own, &wide) - work).abs() < 1e-14 * work.abs());
    }
    #[test]
    fn shared_rows_have_the_bits_of_rows_of_their_own() {
        let count = 40_usize;
        let (mut starts, mut columns) = (vec![0], Vec::new());
        for i in 0..count as u32 {
            columns.extend(i.saturating_sub(1)..(i + 2).min(count as u32));
            starts.push(columns.len());
        }
        let mut m = BlockMatrix::zeros(3, starts, columns);
        let fill = |m: &mut BlockMatrix<f64>, last: f64| {
            m.clear();
            for i in 0..count {
                let beside = [i.wrapping_sub(1), i + 1].into_iter().filter(|j| *j < count);
                let block = Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0);
                beside.for_each(|j| m.add(i, j as u32, &block, 0.5));
                m.add(i, i as u32, &block, if i == 20 { last } else { 3.0 });
            }
        };
        fill(&mut m, 2.5);
        let q: Vec<f64> = (0..3 * count).map(|i| (i as f64).cos()).collect();
        let product = |m: &BlockMatrix<f64>| {
            let mut f = vec![0.0; q.len()];
            m.subtract_product(&q, &mut f);
            (f, m.energy(&q).to_bits(), m.to_csr())
        };
        let alone = product(&m);
        let stored = m.values.len();
        m.share_rows();
        assert_eq!(product(&m), alone);
        // The ends, row 20 and all others.
        assert_eq!(m.values.len(), 9 * (2 + 3 + 3 + 2) + 1);
        // Cleared, rows have values of their own again.
        fill(&mut m, 3.0);
        assert_eq!(m.values.len(), stored);
        assert_ne!(product(&m), alone);
    }
}

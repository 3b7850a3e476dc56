//! Triangular factors `A = Pᵀ L D Lᵀ P`, stored for solves with the components of a vector at once.
//!
//! Neighbouring columns of `L` with the same rows below them form a panel of up to eight columns. A panel has
//! its own triangle, then one line of values per row below. A solve streams through all of these: it reads
//! one row number per line, and keeps the unknowns of the panel in registers.

use super::SpdFactor;
use crate::Real;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};

/// Right-hand sides in one pass over the factor: three components, padded to what processors add at once.
const LANES: usize = 4;
/// Widths of panels \[columns\].
const WIDTHS: [usize; 4] = [8, 4, 2, 1];

/// Values that faer stores on the diagonal of a factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Diagonal {
    /// The factor is `C Cᵀ`; its diagonal has the roots of the pivots.
    Roots,
    /// The factor is `L D Lᵀ`; its diagonal has the pivots `D`.
    Pivots,
}

#[derive(Debug, Clone, Copy)]
struct Panel {
    /// First column.
    first: usize,
    width: usize,
    /// Places of its first row in `rows` and of its first value in `values` of the factor.
    rows: usize,
    values: usize,
}

/// Factor by panels of columns of `L`.
pub(super) struct Factor<T> {
    /// Row of `A` that is eliminated at each place.
    order: Vec<u32>,
    panels: Vec<Panel>,
    /// Numbers of the rows below each panel, panel after panel.
    rows: Vec<u32>,
    /// For each panel: the triangle below its diagonal, row by row, then the rows below it.
    values: Vec<T>,
    /// Inverse of `D`.
    inverse_pivots: Vec<T>,
    /// Right-hand sides in the order of elimination, interleaved.
    x: Vec<T>,
}

impl<T> std::fmt::Debug for Factor<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Factor")
            .field("size", &self.order.len())
            .field("panels", &self.panels.len().saturating_sub(1))
            .field("nonzeros", &self.values.len())
            .finish_non_exhaustive()
    }
}

/// A column of `L` as faer stores it: the places of its values, from the diagonal downwards, and its rows
/// below the diagonal.
struct Column<'a> {
    values: std::ops::Range<usize>,
    /// Rows in the same block of columns, then the others.
    block: std::ops::Range<usize>,
    pattern: &'a [usize],
}

impl Column<'_> {
    fn rows(&self) -> impl Iterator<Item = usize> {
        self.block.clone().chain(self.pattern.iter().copied())
    }

    /// Returns whether a panel that ends with this column can go on with the `next` one.
    fn continues(&self, next: &Self) -> bool {
        let mut rows = self.rows();
        rows.next() == Some(next.block.start - 1) && rows.eq(next.rows())
    }
}

/// Columns of a factor in their order.
fn columns(symbolic: &SymbolicCholesky<usize>) -> Vec<Column<'_>> {
    match symbolic.raw() {
        SymbolicCholeskyRaw::Simplicial(s) => {
            let (first, row) = (s.col_ptr(), s.row_idx());
            let column = |j: usize| Column {
                values: first[j]..first[j + 1],
                block: j + 1..j + 1,
                pattern: &row[first[j] + 1..first[j + 1]],
            };
            (0..symbolic.nrows()).map(column).collect()
        }
        SymbolicCholeskyRaw::Supernodal(s) => {
            let block = |k: usize| {
                let pattern = s.supernode(k).pattern();
                let (begin, end) = (s.supernode_begin()[k], s.supernode_end()[k]);
                let (first, length) = (s.col_ptr_for_val()[k], end - begin + pattern.len());
                (begin..end).map(move |j| Column {
                    // Above the diagonal of a block are no values of the factor.
                    values: first + (j - begin) * (length + 1)..first + (j - begin + 1) * length,
                    block: j + 1..end,
                    pattern,
                })
            };
            (0..s.n_supernodes()).flat_map(block).collect()
        }
    }
}

impl<T: Real> Factor<T> {
    /// Takes over the values of a factor.
    pub(super) fn new(symbolic: &SymbolicCholesky<usize>, values: Vec<T>, diagonal: Diagonal) -> Self {
        let size = symbolic.nrows();
        let order: Vec<u32> = match symbolic.perm() {
            Some(permutation) => permutation.arrays().0.iter().map(|k| *k as u32).collect(),
            None => (0..size as u32).collect(),
        };
        let columns = columns(symbolic);
        let on_diagonal = columns.iter().map(|c| values[c.values.start]);
        let inverse_pivots = on_diagonal.map(|d| match diagonal {
            Diagonal::Roots => T::one() / (d * d),
            Diagonal::Pivots => T::one() / d,
        });
        let mut out = Self {
            order,
            panels: Vec::new(),
            rows: Vec::new(),
            inverse_pivots: inverse_pivots.collect(),
            values,
            x: vec![T::zero(); size * LANES],
        };
        let (mut first, mut end) = (0, 0);
        while first < size {
            let most = WIDTHS[0].min(size - first);
            let width = (1..most).find(|k| !columns[first + k - 1].continues(&columns[first + k]));
            let width = width.unwrap_or(most);
            let width = WIDTHS.into_iter().find(|w| *w <= width).unwrap_or(1);
            end = out.add_panel(first, &columns[first..first + width], end, diagonal);
            first += width;
        }
        out.close(first, end);
        out
    }

    /// Adds a panel of columns whose values go from place `end` on. Returns where they end.
    ///
    /// A panel needs no more places than its columns had, so that nothing is overwritten that is still to be
    /// read.
    fn add_panel(&mut self, first: usize, columns: &[Column<'_>], end: usize, diagonal: Diagonal) -> usize {
        let last = &columns[columns.len() - 1];
        self.panels.push(Panel {
            first,
            width: columns.len(),
            rows: self.rows.len(),
            values: end,
        });
        self.rows.extend(last.rows().map(|i| i as u32));
        let mut panel = Vec::with_capacity(columns.len() * columns[0].values.len());
        // Row `a` of the first column is row `a − b` of column `b`.
        for a in 1..columns[0].values.len() {
            for (b, column) in columns.iter().enumerate().take(a) {
                let below = &self.values[column.values.clone()];
                panel.push(match diagonal {
                    Diagonal::Roots => below[a - b] / below[0],
                    Diagonal::Pivots => below[a - b],
                });
            }
        }
        self.values[end..end + panel.len()].copy_from_slice(&panel);
        end + panel.len()
    }

    /// Ends the list of panels.
    fn close(&mut self, first: usize, end: usize) {
        self.values.truncate(end);
        self.values.shrink_to_fit();
        self.panels.push(Panel {
            first,
            width: 0,
            rows: self.rows.len(),
            values: end,
        });
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
        pulp::Arch::new().dispatch(Substitution {
            factor: self,
            x: lanes,
        });
        for (lane, row) in lanes.iter().zip(&self.order) {
            let sides = b.chunks_exact_mut(size);
            sides.zip(lane).for_each(|(side, x)| side[*row as usize] = *x);
        }
        self.x = x;
    }
}

/// Forward and backward substitution, compiled for the processor at hand.
struct Substitution<'a, T, const N: usize> {
    factor: &'a Factor<T>,
    x: &'a mut [[T; N]],
}

impl<T: Real, const N: usize> pulp::NullaryFnOnce for Substitution<'_, T, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { factor, x } = self;
        for pair in factor.panels.windows(2) {
            match pair[0].width {
                8 => factor.forward::<8, N>(pair, x),
                4 => factor.forward::<4, N>(pair, x),
                2 => factor.forward::<2, N>(pair, x),
                _ => factor.forward::<1, N>(pair, x),
            }
        }
        for pair in factor.panels.windows(2).rev() {
            match pair[0].width {
                8 => factor.backward::<8, N>(pair, x),
                4 => factor.backward::<4, N>(pair, x),
                2 => factor.backward::<2, N>(pair, x),
                _ => factor.backward::<1, N>(pair, x),
            }
        }
    }
}

impl<T: Real> Factor<T> {
    /// Triangle of the first of two panels, and its rows below with their lines of values.
    #[inline(always)]
    fn panel<const W: usize>(&self, pair: &[Panel]) -> (&[T], impl Iterator<Item = (usize, &[T; W])>) {
        let values = &self.values[pair[0].values..pair[1].values];
        let (triangle, lines) = values.split_at(W * (W - 1) / 2);
        let rows = self.rows[pair[0].rows..pair[1].rows].iter();
        (triangle, rows.map(|i| *i as usize).zip(lines.as_chunks::<W>().0))
    }

    /// `L y = b`: unknowns of a panel are subtracted from those below.
    #[inline(always)]
    fn forward<const W: usize, const N: usize>(&self, pair: &[Panel], x: &mut [[T; N]]) {
        let (triangle, below) = self.panel::<W>(pair);
        let mut y: [[T; N]; W] = std::array::from_fn(|a| x[pair[0].first + a]);
        let mut entry = triangle.iter();
        for a in 1..W {
            for b in 0..a {
                let l = entry.next().copied().unwrap_or(T::zero());
                (0..N).for_each(|c| y[a][c] -= l * y[b][c]);
            }
        }
        x[pair[0].first..pair[0].first + W].copy_from_slice(&y);
        for (row, line) in below {
            let mut sum = x[row];
            for (l, y) in line.iter().zip(&y) {
                (0..N).for_each(|c| sum[c] -= *l * y[c]);
            }
            x[row] = sum;
        }
    }

    /// `D Lᵀ x = y`: unknowns of a panel gather those below.
    #[inline(always)]
    fn backward<const W: usize, const N: usize>(&self, pair: &[Panel], x: &mut [[T; N]]) {
        let (triangle, below) = self.panel::<W>(pair);
        let mut sums = [[T::zero(); N]; W];
        for (row, line) in below {
            let z = x[row];
            for (l, sum) in line.iter().zip(&mut sums) {
                *sum = std::array::from_fn(|c| sum[c] + *l * z[c]);
            }
        }
        for b in (0..W).rev() {
            let pivot = self.inverse_pivots[pair[0].first + b];
            let mut z = x[pair[0].first + b].map(|y| y * pivot);
            (0..N).for_each(|c| z[c] -= sums[b][c]);
            x[pair[0].first + b] = z;
            for a in 0..b {
                // Line `b` of the triangle has `b` entries.
                let l = triangle[b * (b - 1) / 2 + a];
                (0..N).for_each(|c| sums[a][c] += l * z[c]);
            }
        }
    }
}

impl<T: Real> SpdFactor<T> for Factor<T> {
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
    use nalgebra::Point3;
    use sprs::{CsMat, TriMat};

    /// Matrix of a ring of nodes, each of which has chords to the nodes 1, 4, …, `far²` places on.
    fn ring(size: usize, far: usize, diagonal: impl Fn(usize) -> f64) -> CsMat<f64> {
        let mut t = TriMat::new((size, size));
        for i in 0..size {
            t.add_triplet(i, i, diagonal(i));
            for j in (1..=far).map(|k| (i + k * k) % size) {
                t.add_triplet(i, j, -1.0);
                t.add_triplet(j, i, -1.0);
            }
        }
        t.to_csc()
    }

    fn product(matrix: &CsMat<f64>, x: &[f64]) -> Vec<f64> {
        let mut b = vec![0.0; x.len()];
        matrix.iter().for_each(|(v, (i, j))| b[i] += v * x[j]);
        b
    }

    /// Few chords are stored column by column, many in blocks of columns, and panels have all widths.
    #[test]
    fn any_number_of_sides_is_solved_with_the_same_bits() {
        for (size, far) in [(1, 0), (2, 1), (60, 2), (61, 3), (260, 9)] {
            let matrix = ring(size, far, |i| 4.0 * far as f64 + 1.0 + i as f64 * 0.1);
            let mut factor = f64::cholesky(&matrix, None).unwrap();
            assert!(factor.size() == size && factor.nonzeros() >= size);
            let x = |k: usize| {
                (0..size)
                    .map(move |i| ((i + 31 * k) as f64).sin())
                    .collect::<Vec<f64>>()
            };
            for count in [1, 2, 3, 4, 5, 9] {
                let mut together: Vec<f64> = (0..count).flat_map(|k| product(&matrix, &x(k))).collect();
                factor.solve(&mut together);
                for (k, solved) in together.chunks_exact(size).enumerate() {
                    let mut alone = product(&matrix, &x(k));
                    factor.solve(&mut alone);
                    assert_eq!(solved, alone);
                    for (a, b) in solved.iter().zip(x(k)) {
                        assert!((a - b).abs() < 1e-12, "{size}, {count}, {k}: {a} {b}");
                    }
                }
            }
        }
    }

    /// Of 15 columns with the same rows below them, panels take 8, 4, 2 and 1.
    #[test]
    fn columns_with_the_same_rows_share_panels() {
        let size = 15;
        let mut t = TriMat::new((size, size));
        for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
            t.add_triplet(i, j, if i == j { 20.0 } else { -1.0 });
        }
        let factor = f64::cholesky(&t.to_csc::<usize>(), None).unwrap();
        let text = format!("{factor:?}");
        assert!(text.contains("panels: 4,"), "{text}");
    }

    /// Alternating signs on the diagonal: as many pivots are negative.
    #[test]
    fn a_quasi_definite_matrix_is_solved_with_its_negative_pivots() {
        for (size, far) in [(60, 2), (260, 9)] {
            let half = size / 2;
            let sign = |i: usize| if i < half { 1.0 } else { -1.0 };
            let matrix = ring(size, far, |i| sign(i) * (4.0 * far as f64 + 1.0));
            let places: Vec<Point3<f64>> = (0..size).map(|i| Point3::new(i as f64, 0.0, 0.0)).collect();
            let mut factor = f64::quasi_definite(&matrix, &places, half, 1e-3).expect("a factor");
            let x: Vec<f64> = (0..size).map(|i| (i as f64).cos()).collect();
            let mut solved = product(&matrix, &x);
            factor.solve(&mut solved);
            for (a, b) in solved.iter().zip(&x) {
                assert!((a - b).abs() < 1e-12, "{size}: {a} {b}");
            }
        }
    }
}

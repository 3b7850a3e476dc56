//! Both directions between one model's velocities and the multipliers.
//!
//! The coupling matrix is kept twice, by multipliers and by coupled nodes, so that either direction only
//! gathers: every result is one sum in a fixed order, whatever thread computes it. Columns have 32 bits, the
//! components of a node are processed together, and a step allocates nothing.
//!
//! The sum of a multiplier is cut where its columns pass from one unit of 256 nodes to the next, and these
//! pieces are added in the order of units. The bits are therefore the same for any distribution of units
//! among ranks.

use super::Coupling;
use crate::owned::{Cuts, Owned, UNIT};
use crate::{Real, parallel};
use rayon::prelude::*;
use sprs::TriMat;
use std::ops::Range;

/// Stored entries per task.
const GRAIN: usize = 4_096;

/// Sparse matrix in compressed rows.
#[derive(Debug, Clone)]
pub(crate) struct Rows<T> {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T: Real> Rows<T> {
    /// Makes `count` rows from entries sorted by row.
    pub(crate) fn from_entries(count: usize, entries: impl Iterator<Item = (usize, usize, T)>) -> Self {
        let (mut starts, mut columns, mut values) = (vec![0; count + 1], Vec::new(), Vec::new());
        for (row, column, value) in entries {
            starts[row + 1] += 1;
            columns.push(column as u32);
            values.push(value);
        }
        // Numbers of entries become places of the first entries.
        (0..count).for_each(|k| starts[k + 1] += starts[k]);
        Self {
            starts,
            columns,
            values,
        }
    }

    /// Returns the number of stored entries.
    pub(super) fn nonzeros(&self) -> usize {
        self.values.len()
    }

    /// Computes `out = A x` with `N` interleaved components.
    pub(crate) fn product<const N: usize>(&self, x: &[T], out: &mut [T]) {
        let (x, out) = (nodes::<T, N>(x), out.as_chunks_mut::<N>().0);
        self.fill_rows(0..out.len(), out, &|k| self.times(k, |j| x[j]));
    }

    /// Returns the columns and values of a row.
    pub(super) fn row(&self, k: usize) -> (&[u32], &[T]) {
        let range = self.starts[k]..self.starts[k + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Returns `Σ_j b_kj x_j`. Two interleaved sums: in a single one each addition would wait for the last.
    #[inline]
    pub(crate) fn times<const N: usize>(&self, k: usize, x: impl Fn(usize) -> [T; N]) -> [T; N] {
        let (columns, values) = self.row(k);
        let (mut even, mut odd) = ([T::zero(); N], [T::zero(); N]);
        let (column_pairs, last_column) = columns.as_chunks::<2>();
        let (value_pairs, last_value) = values.as_chunks::<2>();
        for ([i, j], [a, b]) in column_pairs.iter().zip(value_pairs) {
            let (p, q) = (x(*i as usize), x(*j as usize));
            for c in 0..N {
                even[c] += *a * p[c];
                odd[c] += *b * q[c];
            }
        }
        for (i, a) in last_column.iter().zip(last_value) {
            let p = x(*i as usize);
            (0..N).for_each(|c| even[c] += *a * p[c]);
        }
        (0..N).for_each(|c| even[c] += odd[c]);
        even
    }

    /// Writes `out_k = row(k)` for a range of rows, on several threads if that pays.
    pub(crate) fn fill_rows<const N: usize>(
        &self,
        rows: Range<usize>,
        out: &mut [[T; N]],
        row: &(impl Fn(usize) -> [T; N] + Sync),
    ) {
        fill_rows(rows, out, &|k| self.starts[k], row);
    }
}

/// Writes `out_k = row(k)` for a range of rows, on several threads if that pays. `before`: number of entries
/// before a row.
pub(super) fn fill_rows<T: Real, const N: usize>(
    rows: Range<usize>,
    out: &mut [[T; N]],
    before: &(impl Fn(usize) -> usize + Sync),
    row: &(impl Fn(usize) -> [T; N] + Sync),
) {
    let entries = before(rows.end) - before(rows.start);
    // Each row is one sum, so cutting between rows changes no bits.
    if rows.len() < 2 || entries <= GRAIN || !parallel::pays(entries * N) {
        return rows.zip(out).for_each(|(k, out)| *out = row(k));
    }
    let half = rows.len() / 2;
    let middle = rows.start + half;
    let (low, high) = out.split_at_mut(half);
    rayon::join(
        || fill_rows(rows.start..middle, low, before, row),
        || fill_rows(middle..rows.end, high, before, row),
    );
}

/// One side of an interface, in the form that steps use. For a partitioned model it has the columns of the
/// nodes that this rank owns, and all multipliers.
#[derive(Debug)]
pub(crate) struct Transfer<T> {
    /// Number of components that share the matrix.
    shared: usize,
    /// Number of columns of the matrix.
    columns: usize,
    /// Number of columns per node.
    per_node: usize,
    /// `B` by pieces of multipliers, each in one unit of nodes; columns are places in `coupled`.
    gather: Rows<T>,
    /// First piece of each multiplier, then the number of pieces.
    pieces: Vec<u32>,
    /// `Bᵀ`: places in `coupled` by multipliers.
    scatter: Rows<T>,
    /// Coupled columns of the model, ascending.
    coupled: Vec<u32>,
    /// Where `coupled` passes from one unit of nodes to the next.
    cuts: Cuts,
    /// `∓M⁻¹` of the coupled columns, components interleaved; zero where motion is prescribed.
    mobility: Vec<T>,
    /// `M` of the coupled columns; zero where motion is prescribed.
    inertia: Vec<T>,
    /// Velocities of the coupled columns, later the changes `δ = ∓M⁻¹ Bᵀ μ` by the multipliers.
    local: Vec<T>,
}

impl<T: Real> Transfer<T> {
    /// Stores both directions of a coupling matrix. `sign`: sign of the forces that multipliers exert on this
    /// side.
    pub(super) fn new(coupling: &Coupling<T>, components: usize, sign: T, inverse_inertia: &[T]) -> Self {
        let (matrix, shared) = (&coupling.matrix, coupling.shared);
        let entries = matrix.iter().filter(|(v, _)| **v != T::zero());
        let entries: Vec<_> = entries.map(|(v, (i, j))| (i, j, *v)).collect();
        let weights = |j: usize| &inverse_inertia[j * shared..(j + 1) * shared];
        let size = [matrix.rows(), matrix.cols()];
        let mobility = |j: usize| weights(j).iter().map(|w| sign * *w).collect();
        let per_node = components / shared;
        let owned = Owned::whole(size[1] / per_node);
        Self::from_entries(size, [shared, per_node], &owned, entries, &mobility)
    }

    /// Stores entries (multiplier, column, value) of a matrix of size `[multipliers, columns]`. `mobility`:
    /// `∓M⁻¹` of a column.
    fn from_entries(
        [rows, columns]: [usize; 2],
        [shared, per_node]: [usize; 2],
        owned: &Owned,
        mut entries: Vec<(usize, usize, T)>,
        mobility: &dyn Fn(usize) -> Vec<T>,
    ) -> Self {
        // Marks first, then places: an interface couples few columns of a large model.
        let mut place = vec![0; columns];
        entries.iter().for_each(|e| place[e.1] = 1);
        let coupled: Vec<usize> = (0..columns).filter(|&j| place[j] > 0).collect();
        coupled.iter().enumerate().for_each(|(k, &j)| place[j] = k);
        let mut pieces = vec![0; rows + 1];
        let mut last = None;
        let mut count = 0;
        let cut = |(i, j, v): &(usize, usize, T)| {
            // Columns ascend within a row: a new row or unit begins a new piece.
            let unit = (*i, j / (per_node * UNIT));
            if last.replace(unit) != Some(unit) {
                count += 1;
            }
            pieces[i + 1] = count;
            (count as usize - 1, place[*j], *v)
        };
        let cut: Vec<_> = entries.iter().map(cut).collect();
        // Rows without entries have no piece.
        (0..rows).for_each(|i| pieces[i + 1] = pieces[i + 1].max(pieces[i]));
        let gather = Rows::from_entries(count as usize, cut.into_iter());
        entries.iter_mut().for_each(|e| e.1 = place[e.1]);
        // By column and then by multiplier, so that the sums of the other direction have a fixed order, too.
        entries.sort_by_key(|e| (e.1, e.0));
        let mobility: Vec<T> = coupled.iter().flat_map(|j| mobility(*j)).collect();
        // Prescribed unknowns have no mobility: multipliers do not change their velocities.
        let mass = |w: &T| {
            if *w == T::zero() {
                T::zero()
            } else {
                T::one() / w.abs()
            }
        };
        Self {
            shared,
            columns,
            per_node,
            gather,
            pieces,
            scatter: Rows::from_entries(coupled.len(), entries.into_iter().map(|(i, k, v)| (k, i, v))),
            cuts: Cuts::at_units(owned.clone(), coupled.iter().map(|j| j / per_node)),
            inertia: mobility.iter().map(mass).collect(),
            mobility,
            local: vec![T::zero(); coupled.len() * shared],
            coupled: coupled.into_iter().map(|j| j as u32).collect(),
        }
    }

    /// Restricts the side to the nodes that this rank owns.
    pub(super) fn restrict(&mut self, owned: &Owned) {
        if !owned.is_part() {
            return;
        }
        let n = self.per_node;
        let local_column = |j: usize| Some(owned.local(j / n)? * n + j % n);
        let entries = self
            .entries()
            .filter_map(|(i, j, v)| Some((i, local_column(j)?, v)));
        let size = [self.multipliers(), owned.nodes() * n];
        let mobility = |j: usize| {
            // The mobilities of the whole model are still in place here, under its own column numbers.
            let global_column = (owned.global(j / n) * n + j % n) as u32;
            let place = self.coupled.partition_point(|c| *c < global_column) * self.shared;
            self.mobility[place..place + self.shared].to_vec()
        };
        *self = Self::from_entries(size, [self.shared, n], owned, entries.collect(), &mobility);
    }

    /// Returns the number of multiplier rows.
    pub(super) fn multipliers(&self) -> usize {
        self.pieces.len() - 1
    }

    /// Returns one node of each piece of a multiplier, in the order of units.
    pub(super) fn units(&self, row: usize) -> impl Iterator<Item = usize> {
        self.pieces_of(row).map(|p| {
            let place = self.gather.row(p).0[0];
            self.coupled[place as usize] as usize / self.per_node
        })
    }

    fn pieces_of(&self, row: usize) -> Range<usize> {
        self.pieces[row] as usize..self.pieces[row + 1] as usize
    }

    /// Returns the number of entries before a multiplier.
    pub(super) fn before(&self, row: usize) -> usize {
        self.gather.starts[self.pieces[row] as usize]
    }

    /// Returns the number of components that share the matrix; 1 if the matrix holds all of them.
    pub(crate) fn shared(&self) -> usize {
        self.shared
    }

    /// Returns the number of unknowns of the model that the matrix has columns for.
    pub(crate) fn size(&self) -> usize {
        self.columns * self.shared
    }

    /// Returns the entries of `B` as row, column, value, row by row.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (usize, usize, T)> {
        let pieces = (0..self.multipliers()).flat_map(|i| self.pieces_of(i).map(move |p| (i, p)));
        pieces.flat_map(move |(i, p)| {
            let (columns, values) = self.gather.row(p);
            let entries = columns.iter().zip(values);
            entries.map(move |(j, v)| (i, self.coupled[*j as usize] as usize, *v))
        })
    }

    /// Returns the number of stored entries of one direction.
    pub(super) fn nonzeros(&self) -> usize {
        self.gather.nonzeros()
    }

    /// Returns the coupled columns, ascending.
    pub(super) fn coupled(&self) -> &[u32] {
        &self.coupled
    }

    /// Returns the coupling matrix in its assembled form.
    pub(super) fn matrix(&self) -> Coupling<T> {
        let mut triplets = TriMat::with_capacity((self.multipliers(), self.columns), self.nonzeros());
        self.entries().for_each(|(i, j, v)| triplets.add_triplet(i, j, v));
        Coupling {
            matrix: triplets.to_csr(),
            shared: self.shared,
        }
    }

    /// Loads the values of the coupled columns from the model's unknowns.
    pub(super) fn load(&mut self, x: &[T]) {
        match self.shared {
            1 => copy_at::<T, 1>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            2 => copy_at::<T, 2>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            _ => copy_at::<T, 3>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
        }
    }

    /// Returns one piece of `B x`, for unknowns `x` of the model or, if `None`, for what the coupled columns
    /// hold.
    #[inline]
    pub(super) fn piece<const N: usize>(&self, piece: usize, x: Option<&[T]>) -> [T; N] {
        match x.map(nodes::<T, N>) {
            Some(x) => self.gather.times(piece, |j| x[self.coupled[j] as usize]),
            None => {
                let x = nodes::<T, N>(&self.local);
                self.gather.times(piece, |j| x[j])
            }
        }
    }

    /// Returns the sum of a multiplier over the pieces on this rank, in their order.
    #[inline]
    pub(super) fn row<const N: usize>(&self, row: usize, x: Option<&[T]>) -> [T; N] {
        total(self.pieces_of(row).map(|p| self.piece(p, x)))
    }

    /// Writes all pieces of this rank into `out`.
    pub(super) fn pieces<const N: usize>(&self, x: Option<&[T]>, out: &mut [[T; N]]) {
        self.gather.fill_rows(0..out.len(), out, &|p| self.piece(p, x));
    }

    /// Computes and keeps `δ = ∓M⁻¹ Bᵀ μ`.
    pub(super) fn spread(&mut self, multipliers: &[T]) {
        match self.shared {
            1 => self.spread_of::<1>(multipliers),
            2 => self.spread_of::<2>(multipliers),
            _ => self.spread_of::<3>(multipliers),
        }
    }

    fn spread_of<const N: usize>(&mut self, multipliers: &[T]) {
        let ([multipliers, mobility], rows) =
            ([multipliers, &self.mobility].map(nodes::<T, N>), &self.scatter);
        let change = self.local.as_chunks_mut::<N>().0;
        rows.fill_rows(0..change.len(), change, &|k| {
            let mut sum = rows.times(k, |i| multipliers[i]);
            (0..N).for_each(|c| sum[c] *= mobility[k][c]);
            sum
        });
    }

    /// Returns `δᵀ M δ` over all ranks. Collective for a partitioned model.
    pub(super) fn twice_kinetic(&self) -> T {
        let d = self.shared;
        let part = |places: Range<usize>| {
            let range = places.start * d..places.end * d;
            [parallel::weighted_squares(
                &self.inertia[range.clone()],
                &self.local[range],
            )]
        };
        self.cuts.sum(d, &part)[0]
    }

    /// Adds `δ` to `x`.
    pub(crate) fn kick(&self, x: &mut [T]) {
        let change = &self.local;
        match self.shared {
            1 => add_at::<T, 1>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            2 => add_at::<T, 2>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            _ => add_at::<T, 3>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
        }
    }

    /// Adds `scale Bᵀ λ` to `f`; for set-up and the few steps that need the force itself.
    pub(crate) fn add_force(&self, scale: T, multipliers: &[T], f: &mut [T]) {
        let d = self.shared;
        let mut add = |k: usize, j: usize| {
            let (rows, values) = self.scatter.row(k);
            for (i, v) in rows.iter().zip(values) {
                let (source, target) = (*i as usize * d, j * d);
                (0..d).for_each(|c| f[target + c] += scale * *v * multipliers[source + c]);
            }
        };
        (self.coupled.iter().enumerate()).for_each(|(k, j)| add(k, *j as usize));
    }

    /// Computes `B x`; for checks.
    pub(crate) fn times(&self, x: &[T], out: &mut [T]) {
        let d = self.shared;
        out.fill(T::zero());
        for (i, j, v) in self.entries() {
            (0..d).for_each(|c| out[i * d + c] += v * x[j * d + c]);
        }
    }
}

/// Groups numbers by nodes.
pub(super) fn nodes<T, const N: usize>(x: &[T]) -> &[[T; N]] {
    x.as_chunks().0
}

/// Returns the sum of pieces in their order.
#[inline]
pub(super) fn total<T: Real, const N: usize>(mut pieces: impl Iterator<Item = [T; N]>) -> [T; N] {
    // Begins with the first piece: zero plus it would turn a negative zero into a positive one.
    let first = pieces.next().unwrap_or([T::zero(); N]);
    pieces.fold(first, |mut sum, p| {
        (0..N).for_each(|c| sum[c] += p[c]);
        sum
    })
}

/// Copies the values of the given nodes.
fn copy_at<T: Real, const N: usize>(nodes: &[u32], x: &[[T; N]], out: &mut [[T; N]]) {
    let part = |nodes: &[u32], out: &mut [[T; N]]| {
        nodes.iter().zip(out).for_each(|(j, out)| *out = x[*j as usize]);
    };
    if !parallel::pays(N * nodes.len()) {
        return part(nodes, out);
    }
    let chunks = nodes.par_chunks(GRAIN).zip(out.par_chunks_mut(GRAIN));
    chunks.for_each(|(nodes, out)| part(nodes, out));
}

/// Adds the changes of the given nodes to `x`, which begins at node `first`.
pub(crate) fn add_at<T: Real, const N: usize>(
    nodes: &[u32],
    change: &[[T; N]],
    first: usize,
    x: &mut [[T; N]],
) {
    if nodes.len() <= GRAIN || !parallel::pays(N * nodes.len()) {
        for (k, d) in nodes.iter().zip(change) {
            let x = &mut x[*k as usize - first];
            (0..N).for_each(|c| x[c] += d[c]);
        }
        return;
    }
    // Nodes ascend: halves of the list write to separate halves of `x`.
    let half = nodes.len() / 2;
    let middle = nodes[half] as usize;
    let (low, high) = x.split_at_mut(middle - first);
    rayon::join(
        || add_at(&nodes[..half], &change[..half], first, low),
        || add_at(&nodes[half..], &change[half..], middle, high),
    );
}

/// Returns the nodes that a coupling matrix acts on, ascending.
pub(crate) fn coupled_nodes<T: Real>(coupling: &Transfer<T>, components: usize) -> Vec<usize> {
    let per_column = components / coupling.shared();
    let mut nodes: Vec<usize> = (coupling.coupled().iter().map(|j| *j as usize / per_column)).collect();
    nodes.dedup();
    nodes
}

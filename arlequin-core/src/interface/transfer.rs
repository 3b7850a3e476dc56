//! Both directions between one model's velocities and the multipliers.
//!
//! The coupling matrix is kept twice, by multipliers and by the nodes they act on, so that either direction
//! only gathers: every result is one sum in a fixed order, whatever thread makes it. Columns have 32 bits,
//! the components of a node are added together, nothing is allocated.
//!
//! The sum of a multiplier is cut where the columns pass from one unit of 256 nodes to the next, and its
//! pieces are added in that order: whoever holds which units, the bits are the same.

use super::Coupling;
use crate::ranks::{Cuts, Portion, UNIT};
use crate::{Real, parallel};
use rayon::prelude::*;
use sprs::TriMat;
use std::ops::Range;
use std::sync::Arc;

/// Stored entries per unit of work.
const GRAIN: usize = 4_096;

/// Sparse rows that are only read along.
#[derive(Debug, Clone)]
pub(crate) struct Rows<T> {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T: Real> Rows<T> {
    /// `count` rows of entries that come row by row.
    pub(crate) fn of(count: usize, entries: impl Iterator<Item = (usize, usize, T)>) -> Self {
        let (mut starts, mut columns, mut values) = (vec![0; count + 1], Vec::new(), Vec::new());
        for (row, column, value) in entries {
            starts[row + 1] += 1;
            columns.push(column as u32);
            values.push(value);
        }
        (0..count).for_each(|k| starts[k + 1] += starts[k]);
        Self {
            starts,
            columns,
            values,
        }
    }

    /// Stored entries.
    pub(super) fn nonzeros(&self) -> usize {
        self.values.len()
    }

    /// `out = A x`, with `N` components each.
    pub(crate) fn product<const N: usize>(&self, x: &[T], out: &mut [T]) {
        let (x, out) = (nodes::<T, N>(x), out.as_chunks_mut::<N>().0);
        self.each(0..out.len(), out, &|k| self.times(k, |j| x[j]));
    }

    /// Columns and values of a row.
    pub(super) fn row(&self, k: usize) -> (&[u32], &[T]) {
        let range = self.starts[k]..self.starts[k + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// `Σ_j b_kj x_j`, in two interleaved sums: one would wait for each addition.
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

    /// `out_k = one(k)` for a range of rows, on several threads where that pays.
    pub(crate) fn each<const N: usize>(
        &self,
        rows: Range<usize>,
        out: &mut [[T; N]],
        one: &(impl Fn(usize) -> [T; N] + Sync),
    ) {
        each(rows, out, &|k| self.starts[k], one);
    }
}

/// `out_k = one(k)` for a range of rows, on several threads where that pays; `before`: entries of the rows
/// before one.
pub(super) fn each<T: Real, const N: usize>(
    rows: Range<usize>,
    out: &mut [[T; N]],
    before: &(impl Fn(usize) -> usize + Sync),
    one: &(impl Fn(usize) -> [T; N] + Sync),
) {
    let entries = before(rows.end) - before(rows.start);
    if rows.len() < 2 || entries <= GRAIN || !parallel::pays(entries * N) {
        return rows.zip(out).for_each(|(k, out)| *out = one(k));
    }
    let half = rows.len() / 2;
    let middle = rows.start + half;
    let (low, high) = out.split_at_mut(half);
    rayon::join(
        || each(rows.start..middle, low, before, one),
        || each(middle..rows.end, high, before, one),
    );
}

/// One side of an interface as its steps use it. Of a model in parts it has the columns of the nodes here,
/// and all multipliers.
#[derive(Debug)]
pub(crate) struct Transfer<T> {
    /// Components that share the matrix.
    shared: usize,
    /// Columns of the matrix, and of one node.
    columns: usize,
    per_node: usize,
    /// `B`: pieces of multipliers, each in one unit of nodes, by places in `coupled`.
    gather: Rows<T>,
    /// First piece of every multiplier, and the number of all.
    pieces: Vec<u32>,
    /// `Bᵀ`: places in `coupled` by multipliers.
    scatter: Rows<T>,
    /// Coupled columns of the model, ascending.
    coupled: Vec<u32>,
    /// Where these pass from unit to unit.
    cuts: Cuts,
    /// `∓M⁻¹` of the coupled columns, components interleaved; zero where motion is prescribed.
    mobility: Vec<T>,
    /// `M` of the coupled columns; zero where motion is prescribed.
    inertia: Vec<T>,
    /// Velocities of the coupled columns, then what multipliers change, `δ = ∓M⁻¹ Bᵀ μ`.
    local: Vec<T>,
    /// Of a model in parts: what this rank holds.
    portion: Option<Arc<Portion>>,
}

impl<T: Real> Transfer<T> {
    /// Both directions of a coupling matrix of a model with so many components; `sign`: that of the forces
    /// which multipliers exert on this side.
    pub(super) fn new(of: &Coupling<T>, components: usize, sign: T, inverse_inertia: &[T]) -> Self {
        let (matrix, shared) = (&of.matrix, of.shared);
        let entries = matrix.iter().filter(|(v, _)| **v != T::zero());
        let entries: Vec<_> = entries.map(|(v, (i, j))| (i, j, *v)).collect();
        let weights = |j: usize| &inverse_inertia[j * shared..(j + 1) * shared];
        let size = [matrix.rows(), matrix.cols()];
        let mobility = |j: usize| weights(j).iter().map(|w| sign * *w).collect();
        Self::of(size, [shared, components / shared], entries, &mobility)
    }

    /// From entries by multipliers and columns, of `[multipliers, columns]`; `mobility`: of a column.
    fn of(
        [rows, columns]: [usize; 2],
        [shared, per_node]: [usize; 2],
        mut entries: Vec<(usize, usize, T)>,
        mobility: &dyn Fn(usize) -> Vec<T>,
    ) -> Self {
        let mut place = vec![0; columns];
        entries.iter().for_each(|e| place[e.1] = 1);
        let coupled: Vec<usize> = (0..columns).filter(|&j| place[j] > 0).collect();
        coupled.iter().enumerate().for_each(|(k, &j)| place[j] = k);
        let mut pieces = vec![0; rows + 1];
        let mut last = None;
        let mut count = 0;
        let cut = |(i, j, v): &(usize, usize, T)| {
            let unit = (*i, j / (per_node * UNIT));
            if last.replace(unit) != Some(unit) {
                count += 1;
            }
            pieces[i + 1] = count;
            (count as usize - 1, place[*j], *v)
        };
        let cut: Vec<_> = entries.iter().map(cut).collect();
        (0..rows).for_each(|i| pieces[i + 1] = pieces[i + 1].max(pieces[i]));
        let gather = Rows::of(count as usize, cut.into_iter());
        entries.iter_mut().for_each(|e| e.1 = place[e.1]);
        entries.sort_by_key(|e| (e.1, e.0));
        let mobility: Vec<T> = coupled.iter().flat_map(|j| mobility(*j)).collect();
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
            scatter: Rows::of(coupled.len(), entries.into_iter().map(|(i, k, v)| (k, i, v))),
            cuts: Cuts::of(coupled.iter().map(|j| j / per_node)),
            inertia: mobility.iter().map(mass).collect(),
            mobility,
            local: vec![T::zero(); coupled.len() * shared],
            coupled: coupled.into_iter().map(|j| j as u32).collect(),
            portion: None,
        }
    }

    /// From now on the model is in parts: keeps what acts on the nodes here.
    pub(super) fn share_out(&mut self, portion: &Arc<Portion>) {
        let n = self.per_node;
        let here = |j: usize| Some(portion.local(j / n)? * n + j % n);
        let entries = self.entries().filter_map(|(i, j, v)| Some((i, here(j)?, v)));
        let size = [self.multipliers(), portion.nodes() * n];
        let mobility = |j: usize| {
            let all = (portion.global(j / n) * n + j % n) as u32;
            let place = self.coupled.partition_point(|c| *c < all) * self.shared;
            self.mobility[place..place + self.shared].to_vec()
        };
        let own = Self::of(size, [self.shared, n], entries.collect(), &mobility);
        *self = own;
        self.portion = Some(portion.clone());
    }

    /// Multiplier rows.
    pub(super) fn multipliers(&self) -> usize {
        self.pieces.len() - 1
    }

    /// A node of every piece of a multiplier, by units.
    pub(super) fn units(&self, row: usize) -> impl Iterator<Item = usize> {
        self.pieces_of(row).map(|p| {
            let place = self.gather.row(p).0[0];
            self.coupled[place as usize] as usize / self.per_node
        })
    }

    fn pieces_of(&self, row: usize) -> Range<usize> {
        self.pieces[row] as usize..self.pieces[row + 1] as usize
    }

    /// Entries of the multipliers before one.
    pub(super) fn before(&self, row: usize) -> usize {
        self.gather.starts[self.pieces[row] as usize]
    }

    /// Components that share the matrix; 1 if it holds all of them.
    pub(crate) fn shared(&self) -> usize {
        self.shared
    }

    /// Unknowns of the model that it has columns for.
    pub(crate) fn size(&self) -> usize {
        self.columns * self.shared
    }

    /// Entries of `B` as row, column, value, row by row.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (usize, usize, T)> {
        let pieces = (0..self.multipliers()).flat_map(|i| self.pieces_of(i).map(move |p| (i, p)));
        pieces.flat_map(move |(i, p)| {
            let (columns, values) = self.gather.row(p);
            let all = columns.iter().zip(values);
            all.map(move |(j, v)| (i, self.coupled[*j as usize] as usize, *v))
        })
    }

    /// Stored entries of one direction.
    pub(super) fn nonzeros(&self) -> usize {
        self.gather.nonzeros()
    }

    /// Coupled columns, ascending.
    pub(super) fn coupled(&self) -> &[u32] {
        &self.coupled
    }

    /// The matrix.
    pub(super) fn matrix(&self) -> Coupling<T> {
        let mut all = TriMat::with_capacity((self.multipliers(), self.columns), self.nonzeros());
        self.entries().for_each(|(i, j, v)| all.add_triplet(i, j, v));
        Coupling {
            matrix: all.to_csr(),
            shared: self.shared,
        }
    }

    /// Takes the values of the coupled columns.
    pub(super) fn load(&mut self, x: &[T]) {
        match self.shared {
            1 => copy_at::<T, 1>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            2 => copy_at::<T, 2>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            _ => copy_at::<T, 3>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
        }
    }

    /// `B x` in one piece, of numbers of the model, or without them of what the coupled columns hold.
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

    /// All pieces of a multiplier here, in their order.
    #[inline]
    pub(super) fn row<const N: usize>(&self, row: usize, x: Option<&[T]>) -> [T; N] {
        total(self.pieces_of(row).map(|p| self.piece(p, x)))
    }

    /// All pieces into `out`.
    pub(super) fn pieces<const N: usize>(&self, x: Option<&[T]>, out: &mut [[T; N]]) {
        self.gather.each(0..out.len(), out, &|p| self.piece(p, x));
    }

    /// Keeps `δ = ∓M⁻¹ Bᵀ μ`.
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
        rows.each(0..change.len(), change, &|k| {
            let mut sum = rows.times(k, |i| multipliers[i]);
            (0..N).for_each(|c| sum[c] *= mobility[k][c]);
            sum
        });
    }

    /// `δᵀ M δ`, on all ranks.
    pub(super) fn twice_kinetic(&self) -> T {
        let d = self.shared;
        let part = |places: Range<usize>| {
            let range = places.start * d..places.end * d;
            [parallel::weighted_squares(
                &self.inertia[range.clone()],
                &self.local[range],
            )]
        };
        self.cuts.sum(self.portion.as_deref(), d, &part)[0]
    }

    /// `x += δ`.
    pub(crate) fn kick(&self, x: &mut [T]) {
        let change = &self.local;
        match self.shared {
            1 => add_at::<T, 1>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            2 => add_at::<T, 2>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            _ => add_at::<T, 3>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
        }
    }

    /// `f += scale Bᵀ λ`; for set-up and the few steps that need the force itself.
    pub(crate) fn add_force(&self, scale: T, multipliers: &[T], f: &mut [T]) {
        let d = self.shared;
        let mut add = |k: usize, j: usize| {
            let (rows, values) = self.scatter.row(k);
            for (i, v) in rows.iter().zip(values) {
                let (from, to) = (*i as usize * d, j * d);
                (0..d).for_each(|c| f[to + c] += scale * *v * multipliers[from + c]);
            }
        };
        (self.coupled.iter().enumerate()).for_each(|(k, j)| add(k, *j as usize));
    }

    /// `B x`; for checks.
    pub(crate) fn times(&self, x: &[T], out: &mut [T]) {
        let d = self.shared;
        out.fill(T::zero());
        for (i, j, v) in self.entries() {
            (0..d).for_each(|c| out[i * d + c] += v * x[j * d + c]);
        }
    }
}

/// Numbers by nodes.
pub(super) fn nodes<T, const N: usize>(x: &[T]) -> &[[T; N]] {
    x.as_chunks().0
}

/// The sum of pieces in their order.
#[inline]
pub(super) fn total<T: Real, const N: usize>(mut pieces: impl Iterator<Item = [T; N]>) -> [T; N] {
    let first = pieces.next().unwrap_or([T::zero(); N]);
    pieces.fold(first, |mut sum, p| {
        (0..N).for_each(|c| sum[c] += p[c]);
        sum
    })
}

/// Values of the given nodes.
fn copy_at<T: Real, const N: usize>(at: &[u32], x: &[[T; N]], out: &mut [[T; N]]) {
    let part = |at: &[u32], out: &mut [[T; N]]| {
        at.iter().zip(out).for_each(|(j, out)| *out = x[*j as usize]);
    };
    if !parallel::pays(N * at.len()) {
        return part(at, out);
    }
    let chunks = at.par_chunks(GRAIN).zip(out.par_chunks_mut(GRAIN));
    chunks.for_each(|(at, out)| part(at, out));
}

/// Adds what belongs to the given nodes to `x`, which begins at node `first`.
pub(crate) fn add_at<T: Real, const N: usize>(at: &[u32], change: &[[T; N]], first: usize, x: &mut [[T; N]]) {
    if at.len() <= GRAIN || !parallel::pays(N * at.len()) {
        for (k, d) in at.iter().zip(change) {
            let x = &mut x[*k as usize - first];
            (0..N).for_each(|c| x[c] += d[c]);
        }
        return;
    }
    let half = at.len() / 2;
    let middle = at[half] as usize;
    let (low, high) = x.split_at_mut(middle - first);
    rayon::join(
        || add_at(&at[..half], &change[..half], first, low),
        || add_at(&at[half..], &change[half..], middle, high),
    );
}

/// Nodes a coupling matrix touches, ascending.
pub(crate) fn coupled_nodes<T: Real>(coupling: &Transfer<T>, components: usize) -> Vec<usize> {
    let per_column = components / coupling.shared();
    let mut nodes: Vec<usize> = (coupling.coupled().iter().map(|j| *j as usize / per_column)).collect();
    nodes.dedup();
    nodes
}

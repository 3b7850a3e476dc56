//! Both directions between one model's velocities and the multipliers.
//!
//! The coupling matrix is kept twice, by multipliers and by the nodes they act on, so that either direction only gathers:
//! every result is one sum in a fixed order, whatever thread makes it. Columns have 32 bits, the components of a node are
//! added together, nothing is allocated.

use super::Coupling;
use crate::ranks::{Gather, Message, Portion};
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

    fn count(&self) -> usize {
        self.starts.len() - 1
    }

    fn row(&self, k: usize) -> (&[u32], &[T]) {
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
        let entries = self.starts[rows.end] - self.starts[rows.start];
        if rows.len() < 2 || entries <= GRAIN || !parallel::pays(entries * N) {
            return rows.zip(out).for_each(|(k, out)| *out = one(k));
        }
        let half = rows.len() / 2;
        let middle = rows.start + half;
        let (low, high) = out.split_at_mut(half);
        rayon::join(
            || self.each(rows.start..middle, low, one),
            || self.each(middle..rows.end, high, one),
        );
    }
}

/// One side of an interface as its steps use it.
#[derive(Debug)]
pub(crate) struct Transfer<T> {
    /// Components that share the matrix.
    shared: usize,
    /// Columns of the matrix.
    columns: usize,
    /// `B`: multipliers by places in `coupled`.
    gather: Rows<T>,
    /// `Bᵀ`: places in `coupled` by multipliers.
    scatter: Rows<T>,
    /// Coupled columns of the model, ascending.
    coupled: Vec<u32>,
    /// `∓M⁻¹` of the coupled columns, components interleaved; zero where motion is prescribed.
    mobility: Vec<T>,
    /// `M` of the coupled columns; zero where motion is prescribed.
    inertia: Vec<T>,
    /// Velocities of the coupled columns, then what multipliers change, `δ = ∓M⁻¹ Bᵀ μ`.
    local: Vec<T>,
    /// Of a model in parts: who holds which coupled column.
    parts: Option<Parts>,
}

/// Coupled columns of a model in parts: all ranks know the values of all of them, each changes its own.
#[derive(Debug)]
struct Parts {
    gather: Gather,
    messages: Vec<Message>,
}

impl<T: Real> Transfer<T> {
    /// Both directions of a coupling matrix; `sign`: that of the forces which multipliers exert on this side.
    pub(super) fn new(of: &Coupling<T>, sign: T, inverse_inertia: &[T]) -> Self {
        let (matrix, shared) = (&of.matrix, of.shared);
        let entries = || {
            let kept = matrix.iter().filter(|(v, _)| **v != T::zero());
            kept.map(|(v, (i, j))| (i, j, *v))
        };
        let mut place = vec![0; matrix.cols()];
        entries().for_each(|(_, j, _)| place[j] = 1);
        let coupled: Vec<usize> = (0..place.len()).filter(|&j| place[j] > 0).collect();
        coupled.iter().enumerate().for_each(|(k, &j)| place[j] = k);
        let mut turned: Vec<_> = entries().map(|(i, j, v)| (place[j], i, v)).collect();
        turned.sort_by_key(|e| (e.0, e.1));
        let mobility = coupled
            .iter()
            .flat_map(|j| &inverse_inertia[j * shared..(j + 1) * shared]);
        Self {
            shared,
            columns: matrix.cols(),
            gather: Rows::of(matrix.rows(), entries().map(|(i, j, v)| (i, place[j], v))),
            scatter: Rows::of(coupled.len(), turned.into_iter()),
            mobility: mobility.clone().map(|w| sign * *w).collect(),
            inertia: mobility
                .map(|w| if *w > T::zero() { T::one() / *w } else { T::zero() })
                .collect(),
            local: vec![T::zero(); coupled.len() * shared],
            coupled: coupled.into_iter().map(|j| j as u32).collect(),
            parts: None,
        }
    }

    /// From now on the model is in parts: `components` displacements per node.
    pub(crate) fn share_out(&mut self, portion: &Arc<Portion>, components: usize) {
        let columns = self.coupled.iter().map(|j| *j as usize);
        let gather = Gather::new(portion.clone(), components / self.shared, columns);
        let messages = gather.messages(self.shared);
        self.parts = Some(Parts { gather, messages });
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
        (0..self.gather.count()).flat_map(move |i| {
            let (columns, values) = self.gather.row(i);
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
        let mut all = TriMat::with_capacity((self.gather.count(), self.columns), self.nonzeros());
        self.entries().for_each(|(i, j, v)| all.add_triplet(i, j, v));
        Coupling {
            matrix: all.to_csr(),
            shared: self.shared,
        }
    }

    /// Takes the values of the coupled columns.
    pub(super) fn load(&mut self, x: &[T]) {
        if let Some(Parts { gather, messages }) = &mut self.parts {
            return gather.gather(self.shared, messages, x, &mut self.local);
        }
        match self.shared {
            1 => copy_at::<T, 1>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            2 => copy_at::<T, 2>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
            _ => copy_at::<T, 3>(&self.coupled, x.as_chunks().0, self.local.as_chunks_mut().0),
        }
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

    /// `δᵀ M δ`.
    pub(super) fn twice_kinetic(&self) -> T {
        let terms = |k: usize| self.inertia[k] * self.local[k] * self.local[k];
        parallel::sum(self.local.len(), &|range| range.map(terms).sum())
    }

    /// `x += δ`.
    pub(crate) fn kick(&self, x: &mut [T]) {
        self.add(&self.local, x);
    }

    /// Adds a vector on the coupled columns.
    fn add(&self, change: &[T], x: &mut [T]) {
        if let Some(parts) = &self.parts {
            return self.own(parts, |from, to| x[to] += change[from]);
        }
        match self.shared {
            1 => add_at::<T, 1>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            2 => add_at::<T, 2>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
            _ => add_at::<T, 3>(&self.coupled, nodes(change), 0, x.as_chunks_mut().0),
        }
    }

    /// Own coupled unknowns: place among all coupled ones, and number on this rank.
    fn own(&self, parts: &Parts, mut one: impl FnMut(usize, usize)) {
        let d = self.shared;
        for [place, here] in parts.gather.own().iter().map(|own| own.map(|k| k as usize)) {
            (0..d).for_each(|c| one(place * d + c, here * d + c));
        }
    }

    /// Values of all coupled columns, of a model in parts.
    fn gathered(&self, x: &[T]) -> Option<Vec<T>> {
        Some(self.parts.as_ref()?.gather.gathered(self.shared, x))
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
        match &self.parts {
            Some(parts) => (parts.gather.own().iter()).for_each(|[k, j]| add(*k as usize, *j as usize)),
            None => (self.coupled.iter().enumerate()).for_each(|(k, j)| add(k, *j as usize)),
        }
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
fn nodes<T, const N: usize>(x: &[T]) -> &[[T; N]] {
    x.as_chunks().0
}

/// `out = B_C x_C − B_D x_D`.
pub(super) fn jump<T: Real>(sides: &[Transfer<T>; 2], x: [&[T]; 2], out: &mut [T]) {
    match sides[0].shared {
        1 => jump_of::<T, 1>(sides, x, out),
        2 => jump_of::<T, 2>(sides, x, out),
        _ => jump_of::<T, 3>(sides, x, out),
    }
}

fn jump_of<T: Real, const N: usize>(sides: &[Transfer<T>; 2], x: [&[T]; 2], out: &mut [T]) {
    let [b, c] = sides;
    // All ranks in the same order.
    let seen = [b.gathered(x[0]), c.gathered(x[1])];
    let [x, y] = [0, 1].map(|m| nodes::<T, N>(seen[m].as_deref().unwrap_or(x[m])));
    let of = |s: &Transfer<T>, x: &[[T; N]], k: usize| match s.parts {
        Some(_) => s.gather.times(k, |j| x[j]),
        None => s.gather.times(k, |j| x[s.coupled[j] as usize]),
    };
    rows_of(sides, out, &|k| minus(of(b, x, k), of(c, y, k)));
}

/// [`jump`] of what the sides hold: the first less all others.
pub(super) fn local_jump<T: Real>(sides: &[Transfer<T>], out: &mut [T]) {
    match sides.first().map(Transfer::shared) {
        Some(1) => local_jump_of::<T, 1>(sides, out),
        Some(2) => local_jump_of::<T, 2>(sides, out),
        _ => local_jump_of::<T, 3>(sides, out),
    }
}

fn local_jump_of<T: Real, const N: usize>(sides: &[Transfer<T>], out: &mut [T]) {
    let of = |s: &Transfer<T>, k: usize| {
        let x = nodes::<T, N>(&s.local);
        s.gather.times(k, |j| x[j])
    };
    let Some((first, others)) = sides.split_first() else {
        return;
    };
    rows_of(sides, out, &|k| {
        others.iter().fold(of(first, k), |sum, s| minus(sum, of(s, k)))
    });
}

/// `out = S p`; overwrites what the sides hold.
pub(super) fn operator<T: Real>(sides: &mut [Transfer<T>], p: &[T], out: &mut [T]) {
    sides.iter_mut().for_each(|s| s.spread(p));
    // Kicks are opposed to the jump.
    local_jump(sides, out);
    out.iter_mut().for_each(|x| *x = -*x);
}

/// One number of components per multiplier, on several threads where that pays.
fn rows_of<T: Real, const N: usize>(
    sides: &[Transfer<T>],
    out: &mut [T],
    row: &(impl Fn(usize) -> [T; N] + Sync),
) {
    let out = out.as_chunks_mut::<N>().0;
    // Cut by the side with most entries.
    let longest = sides.iter().map(|s| &s.gather);
    let longest = longest.reduce(|a, b| if b.values.len() > a.values.len() { b } else { a });
    if let Some(rows) = longest {
        rows.each(0..out.len(), out, row);
    }
}

fn minus<T: Real, const N: usize>(mut a: [T; N], b: [T; N]) -> [T; N] {
    (0..N).for_each(|c| a[c] -= b[c]);
    a
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

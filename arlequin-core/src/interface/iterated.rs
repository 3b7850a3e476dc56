//! Vectors, products with `S` and limits of conjugate gradients for `S μ = b`.
//!
//! Dependent multipliers do no harm: the system is consistent, and null modes stay zero. On several ranks
//! each rank iterates on the multipliers that it owns with its rows of `S`, so that a product needs one
//! message to each neighbour. Nothing is kept from the previous step: a resumed run gives the same bits.

use super::dots::Dots;
use super::parts::Parts;
use super::sides::Sides;
use super::transfer::Rows;
use crate::Real;
use crate::ranks::{Places, Post};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// Fixed symmetric preconditioner, `z = C r`.
pub(super) trait Precondition<T> {
    /// Overwrites `z`, which holds `r`, with `C r`.
    fn apply(&mut self, z: &mut [T]);
}

/// Way in which `S` is applied.
#[derive(Debug)]
pub(super) enum Apply<T> {
    /// By the stored rows of `S`, the same for all components.
    Rows(Rows<T>),
    /// By `Bᵀ`, `M⁻¹` and `B` of all sides, one after another.
    Sides,
}

/// Vectors and limits of the iteration.
#[derive(Debug)]
pub(super) struct Iterated<T> {
    apply: Apply<T>,
    /// Number of components, each with an iteration of its own.
    shared: usize,
    pub(super) tolerance: T,
    pub(super) most: usize,
    pub(super) dots: Dots,
    /// Exchange of the entries of `p` that this rank's rows of `S` need from other ranks; `None` if every
    /// rank has all multipliers.
    neighbours: Option<Post>,
    /// Number of iterations of the last solve.
    pub(super) iterations: usize,
    /// True if the last solve ended above its tolerance.
    pub(super) unsolved: bool,
    /// `r`, then `z`, `p` and `S p`.
    pub(super) residual: Vec<T>,
    pub(super) preconditioned: Vec<T>,
    pub(super) direction: Vec<T>,
    pub(super) image: Vec<T>,
}

impl<T: Real> Iterated<T> {
    pub(super) fn new(apply: Apply<T>, [rows, shared]: [usize; 2], (tolerance, most): (T, usize)) -> Self {
        let zeros = || vec![T::zero(); rows * shared];
        Self {
            apply,
            shared,
            tolerance,
            most,
            dots: Dots::new(rows),
            neighbours: None,
            iterations: 0,
            unsolved: false,
            residual: zeros(),
            preconditioned: zeros(),
            direction: zeros(),
            image: zeros(),
        }
    }

    /// Restricts the iteration to the multipliers that this rank owns and returns true. Returns false, and
    /// changes nothing, if `S` is applied by the sides: all ranks then iterate on all multipliers together.
    pub(super) fn partition_among(&mut self, parts: &Parts<T>) -> bool {
        let Apply::Rows(rows) = &self.apply else {
            return false;
        };
        let me = parts.portion().communicator().rank();
        // `S` is symmetric: a rank whose rows need one of our multipliers owns one that our rows need.
        let (mut send, mut receive) = (BTreeSet::new(), BTreeSet::new());
        for i in parts.owned() {
            for j in rows.row(*i as usize).0 {
                let owner = parts.owner(*j as usize);
                if owner != me {
                    send.insert((owner, *i));
                    receive.insert((owner, *j));
                }
            }
        }
        // Local columns: first the owned multipliers, then the received ones in the order of ranks.
        let local_columns = parts.owned().iter().copied().chain(receive.iter().map(|r| r.1));
        let place: BTreeMap<u32, u32> = local_columns.zip(0..).collect();
        let mut peers: BTreeMap<usize, Places> = BTreeMap::new();
        for (rank, row) in send {
            peers.entry(rank).or_default().send.push(place[&row]);
        }
        let mut end = parts.owned().len() as u32;
        for (rank, places) in &mut peers {
            let count = receive.range((*rank, 0)..=(*rank, u32::MAX)).count() as u32;
            places.receive = end..end + count;
            end += count;
        }
        let entries = (0..).zip(parts.owned()).flat_map(|(k, i)| {
            let (columns, values) = rows.row(*i as usize);
            let places = columns.iter().map(|j| place[j] as usize);
            places.zip(values).map(move |(j, v)| (k, j, *v))
        });
        let size = self.shared * parts.owned().len();
        self.apply = Apply::Rows(Rows::from_entries(parts.owned().len(), entries));
        for x in [&mut self.residual, &mut self.preconditioned, &mut self.image] {
            *x = vec![T::zero(); size];
        }
        self.direction = vec![T::zero(); self.shared * end as usize];
        self.dots = Dots::in_parts(parts);
        self.neighbours = Some(Post::new(parts.portion().clone(), self.shared, peers.into_iter()));
        true
    }

    /// Returns the number of stored entries of `S`.
    pub(super) fn nonzeros(&self) -> usize {
        match &self.apply {
            Apply::Rows(rows) => rows.nonzeros(),
            Apply::Sides => 0,
        }
    }

    /// Overwrites `b` with the solution `μ`, components interleaved.
    pub(super) fn solve(
        &mut self,
        b: &mut [T],
        sides: &mut Sides<T>,
        preconditioner: &mut (impl Precondition<T> + ?Sized),
    ) {
        match self.shared {
            1 => self.solve_of::<1>(b, sides, preconditioner),
            2 => self.solve_of::<2>(b, sides, preconditioner),
            _ => self.solve_of::<3>(b, sides, preconditioner),
        }
    }

    fn solve_of<const N: usize>(
        &mut self,
        b: &mut [T],
        sides: &mut Sides<T>,
        preconditioner: &mut (impl Precondition<T> + ?Sized),
    ) {
        self.iterations = 0;
        self.unsolved = false;
        self.residual.copy_from_slice(b);
        self.gradients::<N>(b, sides, preconditioner);
    }

    /// Computes `S p`, after a halo exchange of `p`.
    pub(super) fn product<const N: usize>(&mut self, sides: &mut Sides<T>) {
        if let Some(neighbours) = &mut self.neighbours {
            // A failed exchange turns the next sums into NaN, which ends the iteration.
            neighbours.exchange(self.direction.as_chunks_mut::<N>().0);
        }
        match &self.apply {
            Apply::Rows(rows) => rows.product::<N>(&self.direction, &mut self.image),
            Apply::Sides => sides.operator(&self.direction, &mut self.image),
        }
    }

    /// Computes `z = C r`.
    pub(super) fn precondition(&mut self, preconditioner: &mut (impl Precondition<T> + ?Sized)) {
        self.preconditioned.copy_from_slice(&self.residual);
        preconditioner.apply(&mut self.preconditioned);
    }

    /// Adds `length p` to `x` and subtracts `length S p` from `r`.
    pub(super) fn advance<const N: usize>(&mut self, x: &mut [T], length: &Vector3<T>) {
        update::<T, N>(x, &self.direction, &mut |x, p| {
            (0..N).for_each(|c| x[c] += length[c] * p[c]);
        });
        update::<T, N>(&mut self.residual, &self.image, &mut |r, q| {
            (0..N).for_each(|c| r[c] -= length[c] * q[c]);
        });
        self.iterations += 1;
    }
}

/// Calls `change` with the entries of two vectors, node by node.
pub(super) fn update<T: Real, const N: usize>(
    x: &mut [T],
    y: &[T],
    change: &mut impl FnMut(&mut [T; N], &[T; N]),
) {
    let nodes = x.as_chunks_mut::<N>().0.iter_mut().zip(y.as_chunks::<N>().0);
    nodes.for_each(|(x, y)| change(x, y));
}

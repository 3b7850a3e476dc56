//! Conjugate gradients from zero for `S μ = b`.
//!
//! After any number of iterations with a fixed symmetric preconditioner `μᵀ(S μ − b) = 0`: Galerkin's condition, under which
//! a kick by `μ` changes no energy. Dependent multipliers do no harm: the system is consistent, and what acts on nothing is
//! left alone. On several ranks each has the multipliers that it adds up, and its rows of `S`: an iteration is a message to each
//! neighbour and two exact sums over all. Nothing of the step before is used: runs that are resumed make the same bits.

use super::dots::Dots;
use super::parts::Parts;
use super::sides::Sides;
use super::transfer::Rows;
use crate::Real;
use crate::ranks::{Places, Post};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// A fixed symmetric preconditioner, `z = C r`.
pub(super) trait Precondition<T> {
    /// Overwrites `z`, which holds `r`.
    fn apply(&mut self, z: &mut [T]);
}

/// How `S` is applied.
#[derive(Debug)]
pub(super) enum Apply<T> {
    /// By its own rows, the same for all components.
    Rows(Rows<T>),
    /// By `Bᵀ`, `M⁻¹` and `B` of all sides.
    Sides,
}

/// Vectors of the iteration and where it ends.
#[derive(Debug)]
pub(super) struct Gradients<T> {
    apply: Apply<T>,
    /// Components with an iteration each.
    shared: usize,
    tolerance: T,
    most: usize,
    dots: Dots,
    /// Where each rank has the multipliers that it adds up: `p` of others that its rows of `S` need.
    others: Option<Post>,
    /// Iterations of the last solve.
    pub(super) made: usize,
    /// `r`, `z`, `p`, `S p`.
    residual: Vec<T>,
    turned: Vec<T>,
    direction: Vec<T>,
    image: Vec<T>,
}

impl<T: Real> Gradients<T> {
    pub(super) fn new(apply: Apply<T>, shared: usize, size: usize, tolerance: T, most: usize) -> Self {
        let zeros = || vec![T::zero(); size];
        Self {
            apply,
            shared,
            tolerance,
            most,
            dots: Dots::new(size / shared),
            others: None,
            made: 0,
            residual: zeros(),
            turned: zeros(),
            direction: zeros(),
            image: zeros(),
        }
    }

    /// From now on each rank has the multipliers that it adds up; false where `S` is applied by the sides, which all ranks do
    /// together with all multipliers.
    pub(super) fn share_out(&mut self, parts: &Parts<T>) -> bool {
        let Apply::Rows(rows) = &self.apply else {
            return false;
        };
        let me = parts.portion().communicator().rank();
        // Rows and columns of `S` are of the same multipliers: who needs one of ours has one that we need.
        let (mut send, mut receive) = (BTreeSet::new(), BTreeSet::new());
        for i in parts.mine() {
            for j in rows.row(*i as usize).0 {
                let author = parts.author(*j as usize);
                if author != me {
                    send.insert((author, *i));
                    receive.insert((author, *j));
                }
            }
        }
        let here = parts.mine().iter().copied().chain(receive.iter().map(|r| r.1));
        let place: BTreeMap<u32, u32> = here.zip(0..).collect();
        let mut peers: BTreeMap<usize, Places> = BTreeMap::new();
        for (rank, row) in send {
            peers.entry(rank).or_default().send.push(place[&row]);
        }
        let mut end = parts.mine().len() as u32;
        for (rank, places) in &mut peers {
            let count = receive.range((*rank, 0)..=(*rank, u32::MAX)).count() as u32;
            places.receive = end..end + count;
            end += count;
        }
        let entries = (0..).zip(parts.mine()).flat_map(|(k, i)| {
            let (columns, values) = rows.row(*i as usize);
            let places = columns.iter().map(|j| place[j] as usize);
            places.zip(values).map(move |(j, v)| (k, j, *v))
        });
        let size = self.shared * parts.mine().len();
        self.apply = Apply::Rows(Rows::of(parts.mine().len(), entries));
        for x in [&mut self.residual, &mut self.turned, &mut self.image] {
            *x = vec![T::zero(); size];
        }
        self.direction = vec![T::zero(); self.shared * end as usize];
        self.dots = Dots::in_parts(parts);
        self.others = Some(Post::new(parts.portion().clone(), self.shared, peers.into_iter()));
        true
    }

    /// Stored entries.
    pub(super) fn nonzeros(&self) -> usize {
        match &self.apply {
            Apply::Rows(rows) => rows.nonzeros(),
            Apply::Sides => 0,
        }
    }

    /// `b ← μ`, components interleaved.
    pub(super) fn solve(
        &mut self,
        b: &mut [T],
        sides: &mut Sides<T>,
        by: &mut (impl Precondition<T> + ?Sized),
    ) {
        match self.shared {
            1 => self.solve_of::<1>(b, sides, by),
            2 => self.solve_of::<2>(b, sides, by),
            _ => self.solve_of::<3>(b, sides, by),
        }
    }

    fn solve_of<const N: usize>(
        &mut self,
        b: &mut [T],
        sides: &mut Sides<T>,
        by: &mut (impl Precondition<T> + ?Sized),
    ) {
        self.residual.copy_from_slice(b);
        b.fill(T::zero());
        self.direction.fill(T::zero());
        self.made = 0;
        let first = self.turn::<N>(by);
        let mut rest = first;
        let mut open = [0, 1, 2].map(|c| first[c] > T::zero());
        let mut share = Vector3::zeros();
        while self.made < self.most && open.contains(&true) {
            update::<T, N>(&mut self.direction, &self.turned, &mut |p, z| {
                (0..N).for_each(|c| p[c] = z[c] + share[c] * p[c]);
            });
            if let Some(others) = &mut self.others {
                // A failure makes the sums no numbers, which ends it.
                others.exchange(self.direction.as_chunks_mut::<N>().0);
            }
            match &self.apply {
                Apply::Rows(rows) => rows.product::<N>(&self.direction, &mut self.image),
                Apply::Sides => sides.operator(&self.direction, &mut self.image),
            }
            let curvature = self.dots.of::<T, N>(&self.direction, &self.image);
            let length = Vector3::from_fn(|c, _| {
                open[c] &= curvature[c] > T::zero();
                if open[c] {
                    rest[c] / curvature[c]
                } else {
                    T::zero()
                }
            });
            update::<T, N>(b, &self.direction, &mut |x, p| {
                (0..N).for_each(|c| x[c] += length[c] * p[c]);
            });
            update::<T, N>(&mut self.residual, &self.image, &mut |r, q| {
                (0..N).for_each(|c| r[c] -= length[c] * q[c]);
            });
            self.made += 1;
            let next = self.turn::<N>(by);
            for c in 0..3 {
                open[c] &= next[c] > first[c] * self.tolerance * self.tolerance;
                share[c] = if open[c] { next[c] / rest[c] } else { T::zero() };
            }
            rest = next;
        }
    }

    /// `z = C r` and `r·z` of every component.
    fn turn<const N: usize>(&mut self, by: &mut (impl Precondition<T> + ?Sized)) -> Vector3<T> {
        self.turned.copy_from_slice(&self.residual);
        by.apply(&mut self.turned);
        self.dots.of::<T, N>(&self.residual, &self.turned)
    }
}

/// Changes numbers of one vector by those of another, node by node.
fn update<T: Real, const N: usize>(x: &mut [T], y: &[T], one: &mut impl FnMut(&mut [T; N], &[T; N])) {
    let all = x.as_chunks_mut::<N>().0.iter_mut().zip(y.as_chunks::<N>().0);
    all.for_each(|(x, y)| one(x, y));
}

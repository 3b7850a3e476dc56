//! Iterations from zero for `S μ = b`: what conjugate gradients and the Chebyshev iteration share.
//!
//! Dependent multipliers do no harm: the system is consistent, and what acts on nothing is left alone. On
//! several ranks each has the multipliers that it adds up, and its rows of `S`: a product is a message to
//! each neighbour. Nothing of the step before is used: runs that are resumed make the same bits.

use super::chebyshev::Chebyshev;
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

/// Which iteration it is.
#[derive(Debug, Clone, Copy)]
pub(super) enum Method {
    Gradients,
    Chebyshev(Chebyshev),
}

/// A residual that grew: eigenvalues lie outside the bounds that the set-up found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Broken {
    pub(super) iterations: usize,
    /// Residual over that at the start.
    pub(super) growth: f64,
}

/// Vectors of the iteration and where it ends.
#[derive(Debug)]
pub(super) struct Iterated<T> {
    apply: Apply<T>,
    pub(super) method: Method,
    /// Components with an iteration each.
    shared: usize,
    pub(super) tolerance: T,
    pub(super) most: usize,
    pub(super) dots: Dots,
    /// Where each rank has the multipliers that it adds up: `p` of others that its rows of `S` need.
    others: Option<Post>,
    /// Iterations of the last solve.
    pub(super) made: usize,
    /// The last solve that went wrong.
    pub(super) broken: Option<Broken>,
    /// Whether the last solve ended before its tolerance.
    pub(super) unsolved: bool,
    /// `b`, for the Chebyshev iteration alone.
    pub(super) given: Vec<T>,
    /// `r`, `z`, `p`, `S p`.
    pub(super) residual: Vec<T>,
    pub(super) turned: Vec<T>,
    pub(super) direction: Vec<T>,
    pub(super) image: Vec<T>,
}

impl<T: Real> Iterated<T> {
    pub(super) fn new(
        apply: Apply<T>,
        method: Method,
        [rows, shared]: [usize; 2],
        (tolerance, most): (T, usize),
    ) -> Self {
        let zeros = || vec![T::zero(); rows * shared];
        Self {
            apply,
            shared,
            tolerance,
            most,
            dots: Dots::new(rows),
            others: None,
            made: 0,
            broken: None,
            unsolved: false,
            given: match method {
                Method::Gradients => Vec::new(),
                Method::Chebyshev(_) => zeros(),
            },
            method,
            residual: zeros(),
            turned: zeros(),
            direction: zeros(),
            image: zeros(),
        }
    }

    /// From now on each rank has the multipliers that it adds up; false where `S` is applied by the sides,
    /// which all ranks do together with all multipliers.
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
        self.given.truncate(size);
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
        self.made = 0;
        self.broken = None;
        self.unsolved = false;
        self.residual.copy_from_slice(b);
        match self.method {
            Method::Gradients => self.gradients::<N>(b, sides, by),
            Method::Chebyshev(bounds) => self.chebyshev::<N>(b, sides, by, bounds),
        }
    }

    /// `S p`, after ranks have told each other what they need of `p`.
    pub(super) fn product<const N: usize>(&mut self, sides: &mut Sides<T>) {
        if let Some(others) = &mut self.others {
            // A failure makes the sums no numbers, which ends it.
            others.exchange(self.direction.as_chunks_mut::<N>().0);
        }
        match &self.apply {
            Apply::Rows(rows) => rows.product::<N>(&self.direction, &mut self.image),
            Apply::Sides => sides.operator(&self.direction, &mut self.image),
        }
    }

    /// `z = C r`.
    pub(super) fn turn(&mut self, by: &mut (impl Precondition<T> + ?Sized)) {
        self.turned.copy_from_slice(&self.residual);
        by.apply(&mut self.turned);
    }

    /// `x += length p` and `r −= length S p`.
    pub(super) fn advance<const N: usize>(&mut self, x: &mut [T], length: &Vector3<T>) {
        update::<T, N>(x, &self.direction, &mut |x, p| {
            (0..N).for_each(|c| x[c] += length[c] * p[c]);
        });
        update::<T, N>(&mut self.residual, &self.image, &mut |r, q| {
            (0..N).for_each(|c| r[c] -= length[c] * q[c]);
        });
        self.made += 1;
    }
}

/// Changes numbers of one vector by those of another, node by node.
pub(super) fn update<T: Real, const N: usize>(
    x: &mut [T],
    y: &[T],
    one: &mut impl FnMut(&mut [T; N], &[T; N]),
) {
    let all = x.as_chunks_mut::<N>().0.iter_mut().zip(y.as_chunks::<N>().0);
    all.for_each(|(x, y)| one(x, y));
}

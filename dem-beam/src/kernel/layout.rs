//! Bonds in blocks: eight particles side by side, slot after slot of half-bonds.
//!
//! Every bond is stored twice, once with each of its ends, so that a particle gathers all its
//! forces itself: nothing is scattered, no two threads write the same place, and sums have one
//! order whatever the number of threads.

use super::lanes::{LANES, Row, Scalar};
use super::law::Law;
use super::order::block_order;
use crate::particles::BondedParticles;

/// The arrays of one body, in block order.
#[derive(Debug)]
pub(crate) struct Layout<T: Scalar, W: Law<T>> {
    /// Particle at each place.
    pub(crate) order: Vec<u32>,
    /// First slot of each block, and one past the last.
    pub(crate) start: Vec<u32>,
    /// Half-bonds.
    pub(crate) slots: Vec<W::Slot>,
    /// Place of the other particle of each half-bond; the particle itself in empty lanes.
    pub(crate) neighbours: Vec<[u32; LANES]>,
    /// Inverse mass and inverse inertia per block; zero in places without a particle.
    pub(crate) inverse_mass: Vec<[Row<T>; 2]>,
}

impl<T: Scalar, W: Law<T>> Layout<T, W> {
    pub(crate) fn new(body: &BondedParticles) -> Self {
        Self::ordered(body, block_order(body.positions(), body.pairs()))
    }

    /// With the particle of each place given.
    pub(crate) fn ordered(body: &BondedParticles, order: Vec<u32>) -> Self {
        let n = order.len();
        let mut place = vec![0_u32; n];
        for (k, &i) in order.iter().enumerate() {
            place[i as usize] = k as u32;
        }
        // Half-bonds of each place, in the order of the other end's place: the sum over a
        // particle's bonds does not depend on how the caller numbered bonds.
        let mut count = vec![0_u32; n + 1];
        for e in body.pairs().iter().flatten() {
            count[place[*e as usize] as usize + 1] += 1;
        }
        for k in 0..n {
            count[k + 1] += count[k];
        }
        let mut half = vec![(0_u32, 0_u32); 2 * body.pairs().len()];
        let mut next = count.clone();
        for (b, &[i, j]) in body.pairs().iter().enumerate() {
            for (a, o) in [(i, j), (j, i)] {
                let p = place[a as usize] as usize;
                half[next[p] as usize] = (place[o as usize], b as u32);
                next[p] += 1;
            }
        }
        let blocks = n.div_ceil(LANES);
        let mut out = Self {
            start: vec![0],
            slots: Vec::with_capacity(half.len() / LANES + blocks),
            neighbours: Vec::with_capacity(half.len() / LANES + blocks),
            inverse_mass: vec![[Row::default(); 2]; blocks],
            order,
        };
        for b in 0..blocks {
            out.push_block(b, body, &count, &mut half);
        }
        out
    }

    fn push_block(&mut self, block: usize, body: &BondedParticles, row: &[u32], half: &mut [(u32, u32)]) {
        let first = block * LANES;
        let first_slot = self.slots.len();
        for lane in 0..LANES.min(self.order.len() - first) {
            let p = first + lane;
            let i = self.order[p];
            let bonds = &mut half[row[p] as usize..row[p + 1] as usize];
            bonds.sort_unstable();
            for (s, &(other, b)) in bonds.iter().enumerate() {
                if first_slot + s == self.slots.len() {
                    self.slots.push(W::Slot::default());
                    self.neighbours.push(std::array::from_fn(|k| (first + k) as u32));
                }
                let bond = body.bonds()[b as usize];
                let own = body.pairs()[b as usize][0] == i;
                let bond = if own { bond } else { bond.reversed() };
                let slot = &mut self.slots[first_slot + s];
                W::fill(slot, lane, &bond);
                self.neighbours[first_slot + s][lane] = other;
            }
            let inverse = |m: f64| T::of(if m > 0.0 { 1.0 / m } else { 0.0 });
            self.inverse_mass[block][0].0[lane] = inverse(body.mass()[i as usize]);
            self.inverse_mass[block][1].0[lane] = inverse(body.inertia()[i as usize]);
        }
        self.start.push(self.slots.len() as u32);
    }

    /// Writes the bonds of one block again, only those that are `whole`. `bonds` gives other end and bond of each bond of
    /// a particle, sorted; places must be particle numbers.
    pub(crate) fn refresh<'a>(
        &mut self,
        block: usize,
        body: &BondedParticles,
        bonds: impl Fn(usize) -> &'a [[u32; 2]],
        whole: &dyn Fn(usize) -> bool,
    ) {
        let first = block * LANES;
        let (from, to) = (self.start[block] as usize, self.start[block + 1] as usize);
        for s in from..to {
            self.slots[s] = W::Slot::default();
            self.neighbours[s] = std::array::from_fn(|k| (first + k) as u32);
        }
        for lane in 0..LANES.min(self.order.len() - first) {
            let i = first + lane;
            let left = bonds(i).iter().filter(|[_, b]| whole(*b as usize));
            for (s, &[other, b]) in left.enumerate() {
                let bond = body.bonds()[b as usize];
                let own = body.pairs()[b as usize][0] as usize == i;
                let bond = if own { bond } else { bond.reversed() };
                let slot = &mut self.slots[from + s];
                W::fill(slot, lane, &bond);
                self.neighbours[from + s][lane] = other;
            }
        }
    }

    /// Bytes of bond data.
    pub(crate) fn bond_bytes(&self) -> usize {
        self.slots.len() * (size_of::<W::Slot>() + size_of::<[u32; LANES]>())
    }

    /// Bytes of particle data a step reads and writes: eight rows in and out, six velocities in and
    /// out and two inverse masses per block.
    pub(crate) fn particle_bytes(&self) -> usize {
        self.inverse_mass.len() * (2 * LANES + 2 * 6 + 2) * size_of::<Row<T>>()
    }
}

//! Bonds in blocks: eight particles side by side, slot after slot of half-bonds.
//!
//! Every bond is stored twice, once with each of its ends, so that a particle gathers all its
//! forces itself: nothing is scattered, no two threads write the same place, and sums have one
//! order whatever the number of threads.

use super::lanes::{CacheLine, LANES};
use super::span::{Grid, Slot};
use crate::particles::BondedParticles;
use arlequin_core::adjacency::Adjacency;

/// The bonds of one body, whose numbers are places in the blocks.
#[derive(Debug)]
pub(crate) struct Layout {
    /// Particles in the blocks. Numbers from here on are those of particles of other ranks, whose rows come
    /// behind the last block.
    particles: usize,
    pub(crate) grid: Grid,
    /// First slot of each block, and one past the last.
    pub(crate) start: Vec<u32>,
    /// Half-bonds.
    pub(crate) slots: Vec<Slot>,
    /// The other particle of each half-bond; the particle itself in empty lanes.
    pub(crate) neighbours: Vec<[u32; LANES]>,
    /// Lengths of half-bonds at rest \[m\], where the law needs them; a step of the grid in empty lanes.
    pub(crate) rests: Vec<CacheLine>,
    lengths: bool,
}

/// Half-bonds that take as long as moving a particle.
const MOVING: usize = 3;

/// Slots of particles with so many bonds each: a block has those of its particle with most.
fn slots(bonds: &[usize]) -> usize {
    let most = |block: &[usize]| block.iter().max().copied().unwrap_or(0);
    bonds.chunks(LANES).map(most).sum()
}

/// Half-bonds that the kernel passes over for particles with so many bonds each, empty lanes and the motion
/// of particles included.
pub(crate) fn work(bonds: &[usize]) -> usize {
    (slots(bonds) + MOVING * bonds.len().div_ceil(LANES)) * LANES
}

impl Layout {
    /// `adjacency` gives other end and bond of each bond of a particle, sorted by the other end: the sum
    /// over a particle's bonds does not depend on how the caller numbered bonds. The first `particles` get
    /// blocks.
    pub(crate) fn new(body: &BondedParticles, particles: usize, lengths: bool) -> Self {
        let adjacency = body.adjacency();
        let blocks = particles.div_ceil(LANES);
        let mut out = Self {
            particles,
            grid: body.grid(),
            start: vec![0],
            slots: Vec::new(),
            neighbours: Vec::new(),
            rests: Vec::new(),
            lengths,
        };
        let mut slots = 0;
        for b in 0..blocks {
            let most = out.lanes(b).map(|i| adjacency.row(i).len()).max();
            slots += most.unwrap_or(0);
            out.start.push(slots as u32);
        }
        // As much room as it takes: the largest arrays of a body.
        out.slots = vec![Slot::default(); slots];
        out.neighbours = vec![[0; LANES]; slots];
        out.rests = vec![CacheLine::default(); if lengths { slots } else { 0 }];
        (0..blocks).for_each(|b| out.refresh(b, body, &adjacency, &|_| true));
        out
    }

    /// Particles in the blocks.
    pub(crate) fn particles(&self) -> usize {
        self.particles
    }

    /// Row of a particle.
    fn row(&self, particle: u32) -> u32 {
        let n = self.particles;
        let behind = if particle as usize >= n {
            n.next_multiple_of(LANES) - n
        } else {
            0
        };
        particle + behind as u32
    }

    fn lanes(&self, block: usize) -> std::ops::Range<usize> {
        block * LANES..self.particles.min((block + 1) * LANES)
    }

    /// Writes the bonds of one block again, only those that are `whole`.
    pub(crate) fn refresh(
        &mut self,
        block: usize,
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        whole: &dyn Fn(usize) -> bool,
    ) {
        let first = block * LANES;
        let (from, to) = (self.start[block] as usize, self.start[block + 1] as usize);
        self.slots[from..to].fill(Slot::default());
        self.neighbours[from..to].fill(std::array::from_fn(|k| (first + k) as u32));
        if self.lengths {
            self.rests[from..to].fill(CacheLine([self.grid.step(); LANES]));
        }
        for i in self.lanes(block) {
            let left = adjacency.row(i).iter().filter(|[_, b]| whole(*b as usize));
            for (s, &[other, b]) in left.enumerate() {
                let bond = body.bond(b as usize);
                let own = body.pairs()[b as usize][0] as usize == i;
                let bond = if own { bond } else { bond.reversed() };
                self.slots[from + s].set(i - first, &bond, &self.grid);
                self.neighbours[from + s][i - first] = self.row(other);
                if self.lengths {
                    self.rests[from + s].0[i - first] = bond.span().norm();
                }
            }
        }
    }

    /// Bytes of bond data of particles with so many bonds each.
    pub(crate) fn bytes(bonds: &[usize], lengths: bool) -> usize {
        let slots = slots(bonds);
        let lengths = if lengths { size_of::<CacheLine>() } else { 0 };
        slots * (size_of::<Slot>() + size_of::<[u32; LANES]>() + lengths)
    }
}

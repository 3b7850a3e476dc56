//! Bonds in blocks: eight particles side by side, with one slot of eight half-bonds after the other.
//!
//! Every bond is stored twice, once with each of its ends.

use super::engine::CHUNK;
use super::lanes::{CacheLine, LANES};
use super::span::{Grid, Slot};
use crate::particles::BondedParticles;
use arlequin_core::adjacency::Adjacency;

/// The bonds of one body; particles are numbered by their places in the blocks.
#[derive(Debug)]
pub(crate) struct Layout {
    /// Number of particles in the blocks. Larger particle numbers are ghosts (particles of other ranks),
    /// whose rows follow the last block.
    particles: usize,
    pub(crate) grid: Grid,
    /// First slot of each block, and one past the last.
    pub(crate) start: Vec<u32>,
    /// For each unit of parallel work: true if all of its particles sleep, that is, none of their bonds is
    /// awake.
    asleep: Vec<bool>,
    /// Units of parallel work that are left out of forces until the next call of [`Self::leave_out`].
    left_out: Vec<bool>,
    /// Half-bonds.
    pub(crate) slots: Vec<Slot>,
    /// The other particle of each half-bond; the particle itself in empty lanes.
    pub(crate) neighbours: Vec<[u32; LANES]>,
    /// Lengths at rest of the half-bonds \[m\] if the law needs them; one grid step in empty lanes.
    pub(crate) rests: Vec<CacheLine>,
    lengths: bool,
}

/// Half-bonds that take as long as moving one particle.
const MOVING: usize = 3;

/// Number of slots for particles with the given numbers of bonds: each block has as many slots as its
/// particle with most bonds.
fn slots(bonds: &[usize]) -> usize {
    let most = |block: &[usize]| block.iter().max().copied().unwrap_or(0);
    bonds.chunks(LANES).map(most).sum()
}

/// Number of half-bonds the kernel processes for particles with the given numbers of bonds. Counts empty
/// lanes and the equivalent of moving the particles.
pub(crate) fn work(bonds: &[usize]) -> usize {
    (slots(bonds) + MOVING * bonds.len().div_ceil(LANES)) * LANES
}

impl Layout {
    /// Lays out the bonds of the first `particles` particles of a body, with lengths at rest if `lengths`.
    pub(crate) fn new(body: &BondedParticles, particles: usize, lengths: bool) -> Self {
        // Each row is sorted by the other end, so that the sum over a particle's bonds does not depend on how
        // the caller numbered the bonds.
        let adjacency = body.awake();
        let blocks = particles.div_ceil(LANES);
        let mut out = Self {
            particles,
            grid: body.grid(),
            start: vec![0],
            asleep: Vec::new(),
            left_out: Vec::new(),
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
        if body.has_sleep() {
            let bonds = body.adjacency();
            let sleeps = |i: usize| adjacency.row(i).is_empty() && !bonds.row(i).is_empty();
            out.asleep = out.units_of(&sleeps);
        }
        // Twice the bonds, so that a particle gathers all its forces itself: nothing is scattered, no two
        // threads write to the same place, and sums have the same order for any number of threads. Allocates
        // the exact size, as these are the largest arrays of a body.
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

    /// Returns for each unit of parallel work whether `holds` is true for all of its particles.
    fn units_of(&self, holds: &dyn Fn(usize) -> bool) -> Vec<bool> {
        let units = (0..self.particles).step_by(CHUNK * LANES);
        let unit = |first: usize| (first..self.particles.min(first + CHUNK * LANES)).all(holds);
        units.map(unit).collect()
    }

    /// Leaves units out of the forces in which `still` holds for all particles, until the next call.
    pub(crate) fn leave_out(&mut self, still: &dyn Fn(usize) -> bool) {
        self.left_out = self.units_of(still);
    }

    /// Returns whether the unit of parallel work that begins with `block` is left out of the forces.
    pub(crate) fn is_left_out(&self, block: usize) -> bool {
        self.is_asleep(block) || self.left_out.get(block / CHUNK).is_some_and(|out| *out)
    }

    /// Returns whether all particles of the unit of parallel work that begins with `block` sleep.
    pub(crate) fn is_asleep(&self, block: usize) -> bool {
        self.asleep.get(block / CHUNK).is_some_and(|asleep| *asleep)
    }

    /// Row of a particle: ghosts stand behind the padding of the last block.
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

    /// Rewrites the bonds of one block, keeping only bonds for which `whole` is true.
    pub(crate) fn refresh(
        &mut self,
        block: usize,
        body: &BondedParticles,
        adjacency: &Adjacency<[u32; 2]>,
        whole: &dyn Fn(usize) -> bool,
    ) {
        let first = block * LANES;
        let (first_slot, end_slot) = (self.start[block] as usize, self.start[block + 1] as usize);
        // Empty lanes first: bonds that broke leave lanes behind.
        self.slots[first_slot..end_slot].fill(Slot::default());
        // The particle itself is always a valid row to load.
        self.neighbours[first_slot..end_slot].fill(std::array::from_fn(|k| (first + k) as u32));
        if self.lengths {
            // Not zero: a length at rest divides.
            self.rests[first_slot..end_slot].fill(CacheLine([self.grid.step(); LANES]));
        }
        for i in self.lanes(block) {
            // Whole bonds move up into the first slots; `FractureState::follow` orders their limits alike.
            let whole_bonds = adjacency.row(i).iter().filter(|[_, b]| whole(*b as usize));
            for (s, &[neighbour, b]) in whole_bonds.enumerate() {
                let bond = body.bond(b as usize);
                // Each end sees the span from itself, and both get the same digits with opposite signs.
                let is_first_end = body.pairs()[b as usize][0] as usize == i;
                let bond = if is_first_end { bond } else { bond.reversed() };
                self.slots[first_slot + s].set(i - first, &bond, &self.grid);
                self.neighbours[first_slot + s][i - first] = self.row(neighbour);
                if self.lengths {
                    self.rests[first_slot + s].0[i - first] = bond.span().norm();
                }
            }
        }
    }

    /// Bytes of bond data for particles with the given numbers of bonds.
    pub(crate) fn bytes(bonds: &[usize], lengths: bool) -> usize {
        let slots = slots(bonds);
        let lengths = if lengths { size_of::<CacheLine>() } else { 0 };
        slots * (size_of::<Slot>() + size_of::<[u32; LANES]>() + lengths)
    }
}

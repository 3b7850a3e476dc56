//! Sums over multipliers when models are partitioned: each multiplier is owned by one rank, which adds it up.
//!
//! A rank sums over its own nodes and has one partial sum ("piece") per multiplier and unit of nodes. It
//! sends the pieces of a block of multipliers to their owner: the rank that holds the first piece of the
//! block. The owner adds pieces in the order of units, as one rank alone would, and computes the contribution
//! of models that are whole on every rank. Then an all-reduce of integers gives all sums to all ranks: every
//! rank but the owner adds zero. Iterative solvers skip that step and keep working with the owned sums
//! ([`super::gradients`]).

use super::sides::subtract_others;
use super::transfer::{self, Transfer};
use crate::ranks::{Places, Portion, Post, Reduction};
use crate::{Owned, Real};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Number of consecutive multipliers with one owner, mostly neighbours. Global sums are plain within a block
/// and exact only over blocks.
pub(super) const BLOCK: usize = 16;

/// Sums of multipliers over sides of which at least one is partitioned.
#[derive(Debug)]
pub(super) struct Parts<T> {
    lists: Lists,
    /// Owner of each block of multipliers.
    owners: Vec<u32>,
    /// Range in `pool` of the pieces that this rank computes itself, per side; `None` for sides that are not
    /// partitioned.
    own_pieces: Vec<Option<Range<usize>>>,
    /// Pieces that this rank computed, then those that it received.
    pool: Vec<T>,
    sums: Vec<T>,
    shared: usize,
    post: Post,
    words: Vec<i64>,
}

/// Multipliers that this rank owns, and where their pieces are.
#[derive(Debug)]
struct Lists {
    /// Owned multipliers, ascending.
    owned: Vec<u32>,
    /// Work (entries and pieces) before each owned multiplier, to split the loop among threads.
    before: Vec<usize>,
    /// Places in `pool` of all pieces of the owned multipliers: one list for each multiplier and side, one
    /// after another.
    places: Vec<u32>,
    /// Start of each such list in `places`.
    starts: Vec<u32>,
}

/// Partial sum of a multiplier over one unit of nodes: its side and the rank that computes it.
struct Piece {
    side: usize,
    rank: usize,
}

/// Returns the pieces of a multiplier on the partitioned sides, in the order of sides and units.
fn pieces_of<'a, T: Real>(
    sides: &'a [Transfer<T>],
    owned: &'a [&Owned],
    row: usize,
) -> impl Iterator<Item = Piece> + 'a {
    let parted = sides.iter().zip(owned).enumerate();
    let parted = parted.filter_map(|(m, (s, p))| Some((m, s, p.portion()?)));
    parted.flat_map(move |(side, s, p)| {
        s.units(row).map(move |node| Piece {
            side,
            rank: p.division().owner(node),
        })
    })
}

/// Advances `end` by a number and returns its old value.
fn advance(end: &mut u32, count: u32) -> u32 {
    *end += count;
    *end - count
}

/// Returns the owner of each block of multipliers: the rank of its first piece, 0 for a block without pieces.
fn block_owners<T: Real>(sides: &[Transfer<T>], owned: &[&Owned]) -> Vec<u32> {
    let rows = sides[0].multipliers();
    let first = |block: usize| {
        let rows_of_block = block * BLOCK..rows.min((block + 1) * BLOCK);
        rows_of_block
            .into_iter()
            .find_map(|row| pieces_of(sides, owned, row).next())
    };
    let blocks = 0..rows.div_ceil(BLOCK);
    blocks.map(|b| first(b).map_or(0, |p| p.rank as u32)).collect()
}

impl Lists {
    /// Finds the place of every piece. `next` holds the first place of this rank's pieces of each side.
    /// `peers` holds the places of received pieces; the places of the pieces to send are added to it.
    fn new<T: Real>(
        sides: &[Transfer<T>],
        owned: &[&Owned],
        (me, owners): (usize, &[u32]),
        mut next: Vec<u32>,
        peers: &mut BTreeMap<usize, Places>,
    ) -> Self {
        let mut arrive: BTreeMap<usize, u32> = peers.iter().map(|(r, p)| (*r, p.receive.start)).collect();
        let mut out = Self {
            owned: Vec::new(),
            before: vec![0],
            places: Vec::new(),
            starts: vec![0],
        };
        let mut work = 0;
        for row in 0..sides[0].multipliers() {
            let owner = owners[row / BLOCK] as usize;
            let mut lists: Vec<Vec<u32>> = vec![Vec::new(); sides.len()];
            for Piece { side, rank } in pieces_of(sides, owned, row) {
                let place = match (rank == me, owner == me) {
                    (true, _) => &mut next[side],
                    (false, true) => arrive.entry(rank).or_default(),
                    (false, false) => continue,
                };
                let place = advance(place, 1);
                if owner == me {
                    lists[side].push(place);
                } else {
                    peers.entry(owner).or_default().send.push(place);
                }
            }
            if owner != me {
                continue;
            }
            let whole_sides = sides.iter().zip(owned).filter(|(_, p)| !p.is_part());
            // A whole side costs its entries here; of a partitioned side only finished pieces are added.
            let entries = whole_sides.map(|(s, _)| s.before(row + 1) - s.before(row));
            work += entries.sum::<usize>();
            out.owned.push(row as u32);
            for list in lists {
                out.places.extend(list);
                out.starts.push(out.places.len() as u32);
            }
            out.before.push(work + out.places.len());
        }
        out
    }
}

impl<T: Real> Parts<T> {
    /// Sets up the sums for sides that are still whole. `None` if no model is partitioned.
    pub(super) fn new(sides: &[Transfer<T>], owned: &[&Owned]) -> Option<Self> {
        let portion: Arc<Portion> = owned.iter().find_map(|o| o.portion())?.clone();
        let me = portion.communicator().rank();
        let (rows, shared) = (sides[0].multipliers(), sides[0].shared());
        let owners = block_owners(sides, owned);
        // Pieces of this rank on every side, and how many arrive from each other rank.
        let (mut counts, mut arriving) = (vec![0; sides.len()], BTreeMap::new());
        for row in 0..rows {
            for Piece { side, rank } in pieces_of(sides, owned, row) {
                if rank == me {
                    counts[side] += 1;
                } else if owners[row / BLOCK] as usize == me {
                    *arriving.entry(rank).or_default() += 1;
                }
            }
        }
        let mut end = 0;
        let firsts: Vec<u32> = counts.iter().map(|n| advance(&mut end, *n)).collect();
        let own_range = |m: usize| {
            let range = firsts[m] as usize..(firsts[m] + counts[m]) as usize;
            owned[m].is_part().then_some(range)
        };
        let own_pieces = (0..sides.len()).map(own_range).collect();
        let receive = |(rank, n): (usize, u32)| {
            let receive = advance(&mut end, n)..end;
            let send = Vec::new();
            (rank, Places { send, receive })
        };
        let mut peers: BTreeMap<usize, Places> = arriving.into_iter().map(receive).collect();
        let lists = Lists::new(sides, owned, (me, &owners), firsts, &mut peers);
        Some(Self {
            sums: vec![T::zero(); shared * lists.owned.len()],
            lists,
            owners,
            own_pieces,
            pool: vec![T::zero(); shared * end as usize],
            shared,
            post: Post::new(portion, shared, peers.into_iter()),
            words: vec![0; shared * rows],
        })
    }

    /// Returns the multipliers that this rank owns, ascending.
    pub(super) fn owned(&self) -> &[u32] {
        &self.lists.owned
    }

    /// Returns the rank that owns a multiplier.
    pub(super) fn owner(&self, row: usize) -> usize {
        self.owners[row / BLOCK] as usize
    }

    /// Returns the part of one partitioned model; its communicator is that of all.
    pub(super) fn portion(&self) -> &Arc<Portion> {
        self.post.portion()
    }

    /// Returns the owned nodes of one partitioned model, for sums over all ranks.
    pub(super) fn nodes(&self) -> Owned {
        self.portion().into()
    }

    /// Writes the jump of what the sides hold, for the multipliers that this rank owns. Collective.
    pub(super) fn owned_jump(&mut self, sides: &[Transfer<T>], out: &mut [T]) {
        match self.shared {
            1 => self.add_up::<1>(sides, None),
            2 => self.add_up::<2>(sides, None),
            _ => self.add_up::<3>(sides, None),
        }
        out.copy_from_slice(&self.sums);
    }

    /// Writes `out = B_0 x_0 − B_1 x_1 − …` on every rank, for unknowns `x` of the models or, if `None`, for
    /// what the sides hold. All entries are NaN after a failure of the transport. Collective.
    pub(super) fn jump<const N: usize>(&mut self, sides: &[Transfer<T>], x: Option<&[&[T]]>, out: &mut [T]) {
        self.add_up::<N>(sides, x);
        let sums = std::mem::take(&mut self.sums);
        self.publish(&sums, out);
        self.sums = sums;
    }

    /// Computes the sums that this rank owns.
    fn add_up<const N: usize>(&mut self, sides: &[Transfer<T>], x: Option<&[&[T]]>) {
        let pool = self.pool.as_chunks_mut::<N>().0;
        for (m, (side, range)) in sides.iter().zip(&self.own_pieces).enumerate() {
            if let Some(range) = range {
                side.pieces::<N>(x.map(|x| x[m]), &mut pool[range.clone()]);
            }
        }
        if !self.post.exchange(pool) {
            // A sum without some of its pieces would look like a result.
            return self.sums.fill(T::of(f64::NAN));
        }
        let Lists {
            owned,
            before,
            places,
            starts,
        } = &self.lists;
        let side_sum = |k: usize, m: usize| {
            let list = k * sides.len() + m;
            let places = &places[starts[list] as usize..starts[list + 1] as usize];
            match self.own_pieces[m] {
                Some(_) => transfer::total(places.iter().map(|p| pool[*p as usize])),
                None => sides[m].row(owned[k] as usize, x.map(|x| x[m])),
            }
        };
        let sums = self.sums.as_chunks_mut::<N>().0;
        transfer::fill_rows(0..sums.len(), sums, &|k| before[k], &|k| {
            subtract_others((0..sides.len()).map(|m| side_sum(k, m)))
        });
    }

    /// Broadcasts each rank's multipliers, so that `out` holds all of them on every rank. Collective.
    pub(super) fn publish(&mut self, owned: &[T], out: &mut [T]) {
        let d = self.shared;
        self.words.fill(0);
        for (row, values) in self.lists.owned.iter().zip(owned.chunks_exact(d)) {
            // Bits as integers: the sum with the zeros of all other ranks gives the bits back unchanged.
            let words = &mut self.words[*row as usize * d..][..d];
            for (word, x) in words.iter_mut().zip(values) {
                *word = x.as_f64().to_bits().cast_signed();
            }
        }
        if !self.post.portion().reduce(&mut self.words, Reduction::Sum) {
            return out.fill(T::of(f64::NAN));
        }
        for (x, word) in out.iter_mut().zip(&self.words) {
            *x = T::of(f64::from_bits(word.cast_unsigned()));
        }
    }
}

//! Multipliers on models in parts: every one has a rank that adds up what all others know of it.
//!
//! A rank sums over its own nodes, a piece per multiplier and unit of nodes. Pieces go to the rank that
//! adds them up, which is the one holds the first of them in its block of multipliers, and are added in the
//! order of units, as on one rank; it forms what whole models contribute as well. Then all ranks are told
//! all sums, of which each has one author: a reduction of integers, to which the others add zero. Conjugate
//! gradients go on with the sums where they are ([`super::gradients`]).

use super::sides::less;
use super::transfer::{self, Transfer};
use crate::Real;
use crate::ranks::{Places, Portion, Post, Reduction};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Rows of multipliers that have one author: neighbours mostly, so that sums over multipliers need not be
/// exact in each.
pub(super) const BLOCK: usize = 16;

/// Sums of multipliers over sides of which some are in parts.
#[derive(Debug)]
pub(super) struct Parts<T> {
    lists: Lists,
    /// Ranks that add up the blocks of multipliers.
    authors: Vec<u32>,
    /// Own pieces of each side in parts, among the places.
    own: Vec<Option<Range<usize>>>,
    /// Own pieces, then those of others.
    pool: Vec<T>,
    sums: Vec<T>,
    shared: usize,
    post: Post,
    words: Vec<i64>,
}

/// What is added up here.
#[derive(Debug)]
struct Lists {
    /// Multipliers.
    mine: Vec<u32>,
    /// Work of those before, for threads.
    before: Vec<usize>,
    /// Places of the pieces of each of them and each side, one after another, and where these lists begin.
    places: Vec<u32>,
    starts: Vec<u32>,
}

/// A piece of a multiplier: of which side, and held by which rank.
struct Piece {
    side: usize,
    rank: usize,
}

/// All pieces of a multiplier on sides in parts, in order.
fn pieces_of<'a, T: Real>(
    sides: &'a [Transfer<T>],
    portions: &'a [Option<&Arc<Portion>>],
    row: usize,
) -> impl Iterator<Item = Piece> + 'a {
    let parted = sides.iter().zip(portions).enumerate();
    let parted = parted.filter_map(|(m, (s, p))| Some((m, s, p.as_ref()?)));
    parted.flat_map(move |(side, s, p)| {
        s.units(row).map(move |node| Piece {
            side,
            rank: p.division().owner(node),
        })
    })
}

/// Goes on by so many, and tells from where.
fn passed(end: &mut u32, by: u32) -> u32 {
    *end += by;
    *end - by
}

/// The ranks that add up blocks of multipliers.
fn authors<T: Real>(sides: &[Transfer<T>], portions: &[Option<&Arc<Portion>>]) -> Vec<u32> {
    let rows = sides[0].multipliers();
    let first = |block: usize| {
        let all = block * BLOCK..rows.min((block + 1) * BLOCK);
        all.into_iter()
            .find_map(|row| pieces_of(sides, portions, row).next())
    };
    let blocks = 0..rows.div_ceil(BLOCK);
    blocks.map(|b| first(b).map_or(0, |p| p.rank as u32)).collect()
}

impl Lists {
    /// Finds where every piece goes; `next`: places of own pieces of each side, `arrive`: of those that
    /// other ranks send, whose own ones are told to `send`.
    fn new<T: Real>(
        sides: &[Transfer<T>],
        portions: &[Option<&Arc<Portion>>],
        (me, authors): (usize, &[u32]),
        mut next: Vec<u32>,
        peers: &mut BTreeMap<usize, Places>,
    ) -> Self {
        let mut arrive: BTreeMap<usize, u32> = peers.iter().map(|(r, p)| (*r, p.receive.start)).collect();
        let mut out = Self {
            mine: Vec::new(),
            before: vec![0],
            places: Vec::new(),
            starts: vec![0],
        };
        let mut work = 0;
        for row in 0..sides[0].multipliers() {
            let author = authors[row / BLOCK] as usize;
            let mut lists: Vec<Vec<u32>> = vec![Vec::new(); sides.len()];
            for Piece { side, rank } in pieces_of(sides, portions, row) {
                let place = match (rank == me, author == me) {
                    (true, _) => &mut next[side],
                    (false, true) => arrive.entry(rank).or_default(),
                    (false, false) => continue,
                };
                let place = passed(place, 1);
                if author == me {
                    lists[side].push(place);
                } else {
                    peers.entry(author).or_default().send.push(place);
                }
            }
            if author != me {
                continue;
            }
            let whole = sides.iter().zip(portions).filter(|(_, p)| p.is_none());
            let entries = whole.map(|(s, _)| s.before(row + 1) - s.before(row));
            work += entries.sum::<usize>();
            out.mine.push(row as u32);
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
    /// Of sides that are whole still; none if all of them stay so.
    pub(super) fn new(sides: &[Transfer<T>], portions: &[Option<&Arc<Portion>>]) -> Option<Self> {
        let portion: Arc<Portion> = (*portions.iter().flatten().next()?).clone();
        let me = portion.communicator().rank();
        let (rows, shared) = (sides[0].multipliers(), sides[0].shared());
        let authors = authors(sides, portions);
        // Own pieces of every side, and how many come from which rank.
        let (mut counts, mut come) = (vec![0; sides.len()], BTreeMap::new());
        for row in 0..rows {
            for Piece { side, rank } in pieces_of(sides, portions, row) {
                if rank == me {
                    counts[side] += 1;
                } else if authors[row / BLOCK] as usize == me {
                    *come.entry(rank).or_default() += 1;
                }
            }
        }
        let mut end = 0;
        let firsts: Vec<u32> = counts.iter().map(|n| passed(&mut end, *n)).collect();
        let of = |m: usize| portions[m].map(|_| firsts[m] as usize..(firsts[m] + counts[m]) as usize);
        let own = (0..sides.len()).map(of).collect();
        let receive = |(rank, n): (usize, u32)| {
            let receive = passed(&mut end, n)..end;
            let send = Vec::new();
            (rank, Places { send, receive })
        };
        let mut peers: BTreeMap<usize, Places> = come.into_iter().map(receive).collect();
        let lists = Lists::new(sides, portions, (me, &authors), firsts, &mut peers);
        Some(Self {
            sums: vec![T::zero(); shared * lists.mine.len()],
            lists,
            authors,
            own,
            pool: vec![T::zero(); shared * end as usize],
            shared,
            post: Post::new(portion, shared, peers.into_iter()),
            words: vec![0; shared * rows],
        })
    }

    /// Rows that are added up here, ascending.
    pub(super) fn mine(&self) -> &[u32] {
        &self.lists.mine
    }

    /// The rank that adds a row up.
    pub(super) fn author(&self, row: usize) -> usize {
        self.authors[row / BLOCK] as usize
    }

    /// One of the portions: all are of the same ranks.
    pub(super) fn portion(&self) -> &Arc<Portion> {
        self.post.portion()
    }

    /// [`Self::jump`] of what the sides hold, of the rows that are added up here.
    pub(super) fn jump_here(&mut self, sides: &[Transfer<T>], out: &mut [T]) {
        match self.shared {
            1 => self.add_up::<1>(sides, None),
            2 => self.add_up::<2>(sides, None),
            _ => self.add_up::<3>(sides, None),
        }
        out.copy_from_slice(&self.sums);
    }

    /// `out = B_0 x_0 − B_1 x_1 − …` on all ranks, of numbers of the models, or without them of what the
    /// sides hold. Not numbers once ranks do not hear of each other any more.
    pub(super) fn jump<const N: usize>(&mut self, sides: &[Transfer<T>], x: Option<&[&[T]]>, out: &mut [T]) {
        self.add_up::<N>(sides, x);
        let sums = std::mem::take(&mut self.sums);
        self.publish(&sums, out);
        self.sums = sums;
    }

    /// Finds the sums.
    fn add_up<const N: usize>(&mut self, sides: &[Transfer<T>], x: Option<&[&[T]]>) {
        let pool = self.pool.as_chunks_mut::<N>().0;
        for (m, (side, own)) in sides.iter().zip(&self.own).enumerate() {
            if let Some(own) = own {
                side.pieces::<N>(x.map(|x| x[m]), &mut pool[own.clone()]);
            }
        }
        if !self.post.exchange(pool) {
            return self.sums.fill(T::of(f64::NAN));
        }
        let Lists {
            mine,
            before,
            places,
            starts,
        } = &self.lists;
        let of = |k: usize, m: usize| {
            let list = k * sides.len() + m;
            let places = &places[starts[list] as usize..starts[list + 1] as usize];
            match self.own[m] {
                Some(_) => transfer::total(places.iter().map(|p| pool[*p as usize])),
                None => sides[m].row(mine[k] as usize, x.map(|x| x[m])),
            }
        };
        let sums = self.sums.as_chunks_mut::<N>().0;
        transfer::each(0..sums.len(), sums, &|k| before[k], &|k| {
            less((0..sides.len()).map(|m| of(k, m)))
        });
    }

    /// Tells all ranks what each has of its own rows.
    pub(super) fn publish(&mut self, own: &[T], out: &mut [T]) {
        let d = self.shared;
        self.words.fill(0);
        for (row, own) in self.lists.mine.iter().zip(own.chunks_exact(d)) {
            let words = &mut self.words[*row as usize * d..][..d];
            for (word, x) in words.iter_mut().zip(own) {
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

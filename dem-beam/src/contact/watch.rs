//! Which listed pairs may have closed since their gaps were last measured.
//!
//! A gap shrinks by no more than its two particles move relative to each other. The displacements of 64
//! particles lie in a box; two particles of several such blocks move relative to each other by at most the
//! diagonal of the box around all of them. Pairs with a larger gap are open and are not looked at. All pairs
//! are measured again once as many have been looked at in vain, so the bounds never cost more than they save.
//!
//! The same pairs push as if all were measured in every step, to the bit.

use super::Spring;
use super::grains::Grains;
use super::neighbours::{Candidate, distance};
use super::sparse::Sparse;
use crate::packing::cells::Sphere;
use rayon::prelude::*;
use std::ops::Range;

/// Particles whose displacements are bounded together; they are numbered for locality.
const BLOCK: usize = 64;

/// Pairs that are skipped together.
const GROUP: usize = 64;

/// Pairs, or blocks of particles, per unit of parallel work.
const CHUNK: [usize; 2] = [2_048, 32];

/// Relative margins for round-off: of a bound, and of the coordinates.
const ROUND_OFF: [f64; 2] = [1e-9, 1e-14];

/// Lowest and highest components of some displacements \[m\].
type Span = [[f64; 3]; 2];

const NOWHERE: Span = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// Growth of the diagonal of a box over that of its sides at one end: `2 √3`, rounded up.
const DIAGONAL: f64 = 3.5;

/// Consecutive pairs of the list.
#[derive(Debug, Clone)]
struct Group {
    /// Places of its blocks in [`Watch::blocks_of`].
    blocks: Range<usize>,
    /// A lower bound of the gaps at the last measurement \[m\].
    least: f64,
    /// Value of [`Watch::crept`] up to which no pair can have closed \[m\].
    due: f64,
}

impl Group {
    /// Has at least one pair looked at in every step.
    fn wake(&mut self) {
        (self.least, self.due) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    }
}

/// Lower bounds of the gaps of a list.
///
/// Particles come in slices of one or two bodies; the blocks of the second body follow those of the first.
#[derive(Debug, Default)]
pub(super) struct Watch {
    /// Number of the search that made the watched list.
    search: usize,
    /// Number of pairs in `groups`.
    grouped: usize,
    /// Gaps at the last measurement \[m\]; minus infinity for pairs that have closed since.
    gaps: Vec<f64>,
    /// Displacements at the last measurement \[m\].
    measured_at: [Vec<f64>; 2],
    /// Largest distance of the particles of each block from their positions in the last search \[m\], at the
    /// last measurement.
    strayed: Vec<f64>,
    /// Bound of the round-off of a distance \[m\].
    round_off: f64,
    groups: Vec<Group>,
    /// Blocks of the pairs of each group.
    blocks_of: Vec<u32>,
    /// Motion of each block since the last measurement.
    moved: Vec<Span>,
    /// Upper bound of the growth of any diagonal since the last measurement \[m\], summed step by step.
    crept: f64,
    /// Number of pairs looked at in vain since the last measurement.
    in_vain: usize,
    /// Pairs that push, with their overlaps \[m\], and pairs that pushed before, in the order of the list.
    touching: Vec<(usize, f64)>,
}

/// Number of blocks of each body.
fn blocks(grains: &[Grains]) -> [usize; 2] {
    [0, 1].map(|m| grains.get(m).map_or(0, |g| g.len().div_ceil(BLOCK)))
}

impl Watch {
    /// Pairs that push, with their overlaps \[m\], and pairs that have just opened, in the order of the list.
    pub(super) fn touching(&self) -> &[(usize, f64)] {
        &self.touching
    }

    /// Forgets everything, for a list from elsewhere.
    pub(super) fn reset(&mut self) {
        self.gaps.clear();
        self.moved.clear();
    }

    /// Takes the displacements `q` and returns whether the bounds are valid for a list of `pairs` pairs. If
    /// they are not, all pairs must be measured. Search number `search` made the list; pairs of bonds that
    /// have broken since are appended to it.
    ///
    /// A list is stale once a particle is more than half the `skin` away from `built`, its position in the
    /// search.
    pub(super) fn follow(
        &mut self,
        grains: &mut [Grains],
        q: &[&[f64]],
        ([search, pairs], skin, built): ([usize; 2], f64, &[Sphere]),
    ) -> bool {
        let count: usize = blocks(grains).iter().sum();
        let is_known = search == self.search && self.moved.len() == count && self.gaps.len() <= pairs;
        if !is_known || count == 0 || self.in_vain > pairs {
            return false;
        }
        let (first, second) = self.moved.split_at_mut(blocks(grains)[0]);
        let mut grown = 0.0_f64;
        for ((moved, q), (from, g)) in [first, second]
            .into_iter()
            .zip(q)
            .zip(self.measured_at.iter().zip(&*grains))
        {
            grown = grown.max(motions(moved, &q[..3 * g.len()], from));
        }
        self.crept += DIAGONAL * grown;
        !self.is_stale(grains, q, skin, built)
    }

    fn is_stale(&self, grains: &mut [Grains], q: &[&[f64]], skin: f64, built: &[Sphere]) -> bool {
        let limit = 0.5 * skin * (1.0 - ROUND_OFF[0]) - self.round_off;
        let split = blocks(grains)[0];
        let mut first = 0;
        for (m, g) in grains.iter_mut().enumerate() {
            for b in 0..g.len().div_ceil(BLOCK) {
                let place = m * split + b;
                let [low, high] = self.moved[place];
                let far = norm([0, 1, 2].map(|c| low[c].abs().max(high[c].abs())));
                if self.strayed[place] + far < limit {
                    continue;
                }
                // The bound cannot tell: look at every particle.
                let range = b * BLOCK..g.len().min((b + 1) * BLOCK);
                range.clone().for_each(|i| g.place_one(i, q[m]));
                let at = &built[first + range.start..first + range.end];
                if at
                    .iter()
                    .zip(&g.now[range])
                    .any(|(a, b)| super::neighbours::has_strayed(a, b, skin))
                {
                    return true;
                }
            }
            first += g.len();
        }
        false
    }

    /// Measures all pairs, for particles that have been placed at the displacements `q`.
    pub(super) fn measure_all(
        &mut self,
        grains: &[Grains],
        q: &[&[f64]],
        (pairs, springs): (&[Candidate], &Sparse<Spring>),
        (search, skin, built): (usize, f64, &[Sphere]),
    ) {
        self.gaps.resize(pairs.len(), 0.0);
        let (first, second) = (&grains[0].now, &grains[grains.len() - 1].now);
        let measure = |(g, p): (&mut f64, &Candidate)| *g = -overlap(p, first, second);
        if pairs.len() > 2 * CHUNK[0] && rayon::current_num_threads() > 1 {
            let gaps = self.gaps.par_iter_mut().zip(pairs);
            gaps.with_min_len(CHUNK[0]).for_each(measure);
        } else {
            self.gaps.iter_mut().zip(pairs).for_each(measure);
        }
        self.touching.clear();
        for (k, gap) in self.gaps.iter_mut().enumerate() {
            if *gap < 0.0 || springs.get(k).closed {
                self.touching.push((k, -*gap));
                *gap = f64::NEG_INFINITY;
            }
        }
        if skin > 0.0 {
            self.begin(grains, q, pairs, (search, skin, built));
        }
    }

    /// Begins to watch the pairs that have just been measured.
    fn begin(
        &mut self,
        grains: &[Grains],
        q: &[&[f64]],
        pairs: &[Candidate],
        (search, skin, built): (usize, f64, &[Sphere]),
    ) {
        let [split, others] = blocks(grains);
        if search != self.search || self.grouped != pairs.len() || self.moved.len() != split + others {
            self.group(pairs, if grains.len() > 1 { split as u32 } else { 0 });
        }
        for (g, gaps) in self.groups.iter_mut().zip(self.gaps.chunks(GROUP)) {
            g.least = gaps.iter().fold(f64::INFINITY, |m, x| m.min(*x));
            g.due = g.least;
        }
        self.strayed.clear();
        let (mut extent, mut built) = (0.0_f64, built);
        for (m, g) in grains.iter().enumerate() {
            self.measured_at[m].clear();
            self.measured_at[m].extend_from_slice(&q[m][..3 * g.len()]);
            let (at, rest) = built.split_at(g.len());
            built = rest;
            for (now, at) in g.now.chunks(BLOCK).zip(at.chunks(BLOCK)) {
                let far = now.iter().zip(at).map(|(a, b)| distance(a, b));
                self.strayed.push(far.fold(0.0, f64::max));
                let places = now.iter().flat_map(|s| &s[..3]);
                extent = places.fold(extent, |m, x| m.max(x.abs()));
            }
        }
        self.moved.clear();
        self.moved.resize(split + others, [[0.0; 3]; 2]);
        self.round_off = ROUND_OFF[1] * (extent + skin);
        (self.search, self.in_vain, self.crept) = (search, 0, 0.0);
    }

    /// Groups the pairs of a list; the blocks of second ends begin at number `second`.
    fn group(&mut self, pairs: &[Candidate], second: u32) {
        self.groups.clear();
        self.blocks_of.clear();
        self.grouped = pairs.len();
        // Steps between two searches do not allocate.
        let room = pairs.len().saturating_sub(self.touching.len());
        self.touching.reserve(room);
        for pairs in pairs.chunks(GROUP) {
            let start = self.blocks_of.len();
            for p in pairs {
                let [i, j] = p.ends.map(|e| e / BLOCK as u32);
                for b in [i, j + second] {
                    if !self.blocks_of[start..].contains(&b) {
                        self.blocks_of.push(b);
                    }
                }
            }
            let blocks = start..self.blocks_of.len();
            let (least, due) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
            self.groups.push(Group { blocks, least, due });
        }
    }

    /// Measures the pairs that may have closed since all were measured; [`Self::follow`] must have returned
    /// true.
    pub(super) fn measure_due(&mut self, grains: &mut [Grains], q: &[&[f64]], pairs: &[Candidate]) {
        // Pairs of bonds that have broken since are always looked at; the last group may hold some of them.
        if let (true, Some(g)) = (pairs.len() > self.grouped, self.groups.last_mut()) {
            g.wake();
        }
        self.gaps.resize(pairs.len(), f64::NEG_INFINITY);
        self.touching.clear();
        for n in 0..pairs.len().div_ceil(GROUP) {
            let Some(closest) = self.approach(n) else { continue };
            let range = n * GROUP..pairs.len().min((n + 1) * GROUP);
            for (k, pair) in range.clone().zip(&pairs[range]) {
                if self.gaps[k] > closest {
                    continue;
                }
                self.look_at(k, n, grains, q, pair);
            }
        }
    }

    /// Largest distance by which the gap of a pair in group `n` can have shrunk since all were measured
    /// \[m\]; `None` if no pair of the group can have closed.
    fn approach(&mut self, n: usize) -> Option<f64> {
        let Some(g) = self.groups.get_mut(n) else {
            return Some(f64::INFINITY);
        };
        let crept = self.crept * (1.0 + ROUND_OFF[0]) + self.round_off;
        if g.due > crept {
            return None;
        }
        let near = self.blocks_of[g.blocks.clone()].iter();
        let around = near.fold(NOWHERE, |a, b| joined(a, &self.moved[*b as usize]));
        let shift = norm([0, 1, 2].map(|c| around[1][c] - around[0][c]));
        let closest = shift * (1.0 + ROUND_OFF[0]) + self.round_off;
        if g.least > closest {
            // The fastest particles must creep that far before the gap that is left can close.
            g.due = crept + (g.least - closest);
            return None;
        }
        Some(closest)
    }

    fn look_at(&mut self, k: usize, group: usize, grains: &mut [Grains], q: &[&[f64]], pair: &Candidate) {
        let last = grains.len() - 1;
        for (m, e) in [0, last].into_iter().zip(pair.ends) {
            grains[m].place_one(e as usize, q[m]);
        }
        let overlap = overlap(pair, &grains[0].now, &grains[last].now);
        let touches = overlap > 0.0;
        self.in_vain += usize::from(!touches);
        // A pair that touched before is passed on as well: it forgets its spring.
        if touches || self.gaps[k] == f64::NEG_INFINITY {
            self.touching.push((k, overlap));
            self.gaps[k] = f64::NEG_INFINITY;
            if let Some(g) = self.groups.get_mut(group) {
                g.wake();
            }
        }
    }
}

/// Overlap of a pair \[m\]; negative for open pairs.
fn overlap(pair: &Candidate, first: &[Sphere], second: &[Sphere]) -> f64 {
    let (a, b) = (&first[pair.ends[0] as usize], &second[pair.ends[1] as usize]);
    pair.rest_distance - distance(a, b)
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn joined([low, high]: Span, other: &Span) -> Span {
    let (l, h) = (other[0], other[1]);
    [
        [0, 1, 2].map(|c| if l[c] < low[c] { l[c] } else { low[c] }),
        [0, 1, 2].map(|c| if h[c] > high[c] { h[c] } else { high[c] }),
    ]
}

/// Writes the motion of every block from the displacements `from` to `q`. Returns the largest distance by
/// which a side of a box has moved outwards \[m\].
fn motions(moved: &mut [Span], q: &[f64], from: &[f64]) -> f64 {
    let motion = |(moved, (q, from)): (&mut Span, (&[f64], &[f64]))| {
        let [low, high] = std::mem::replace(moved, motion(q, from));
        (0..3).fold(0.0_f64, |m, c| {
            m.max(low[c] - moved[0][c]).max(moved[1][c] - high[c])
        })
    };
    let size = 3 * BLOCK;
    if moved.len() > 2 * CHUNK[1] && rayon::current_num_threads() > 1 {
        let places = q.par_chunks(size).zip(from.par_chunks(size));
        let blocks = moved.par_iter_mut().zip(places);
        let grown = blocks.with_min_len(CHUNK[1]).map(motion);
        grown.reduce(|| 0.0, f64::max)
    } else {
        let places = q.chunks(size).zip(from.chunks(size));
        moved.iter_mut().zip(places).map(motion).fold(0.0, f64::max)
    }
}

/// Motion of the particles of a block.
fn motion(q: &[f64], from: &[f64]) -> Span {
    // Four particles at a time, so that the compiler makes vectors of the twelve components.
    let (mut low, mut high) = ([f64::INFINITY; 12], [f64::NEG_INFINITY; 12]);
    let (q, last) = q.as_chunks::<12>();
    let (from, last_from) = from.as_chunks::<12>();
    for (q, from) in q.iter().zip(from) {
        for c in 0..12 {
            let d = q[c] - from[c];
            low[c] = if d < low[c] { d } else { low[c] };
            high[c] = if d > high[c] { d } else { high[c] };
        }
    }
    let mut out = NOWHERE;
    for (low, high) in low.as_chunks::<3>().0.iter().zip(high.as_chunks::<3>().0) {
        out = joined(out, &[*low, *high]);
    }
    let (last, last_from) = (last.as_chunks::<3>().0, last_from.as_chunks::<3>().0);
    for (q, from) in last.iter().zip(last_from) {
        let d = [0, 1, 2].map(|c| q[c] - from[c]);
        out = joined(out, &[d, d]);
    }
    out
}

#[cfg(test)]
mod tests;

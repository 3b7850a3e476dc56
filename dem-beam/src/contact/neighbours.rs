//! Lists of near pairs that no bond joins.

use super::Spring;
use super::grains::Grains;
use super::sparse::Sparse;
use super::watch::Watch;
use crate::fracture::{Break, BreakLog};
use crate::packing::cells::{CellList, Sphere, spheres};
use crate::particles::BondedParticles;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::snapshot::Record;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of values of a pair in a record: its rest distance and its spring.
const PAIR: usize = 1 + Spring::NUMBERS;

/// Particles per unit of parallel work.
const CHUNK: usize = 512;

/// A pair that may touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) ends: [u32; 2],
    /// Distance below which the pair pushes \[m\].
    pub(crate) rest_distance: f64,
}

pub(super) fn distance(a: &Sphere, b: &Sphere) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Distance \[m\] below which two particles that were never bonded push: the sum of radii, or the distance at
/// rest if that is smaller.
pub(super) fn rest_distance_of(a: &Sphere, b: &Sphere) -> f64 {
    (a[3] + b[3]).min(distance(a, b))
}

/// Number of the bond between two particles, whole or broken, if there is one.
pub(super) fn bond_between(adjacency: &Adjacency<[u32; 2]>, i: u32, j: u32) -> Option<usize> {
    let bonds = adjacency.row(i as usize);
    // Rows of the adjacency ascend by neighbour, so bisection finds the bond.
    let k = bonds.partition_point(|e| e[0] < j);
    bonds.get(k).filter(|e| e[0] == j).map(|e| e[1] as usize)
}

/// Returns whether a sphere has moved by more than half the skin since the list was `built`, or the number of
/// spheres has changed.
pub(super) fn is_stale<'a>(
    built: &[Sphere],
    skin: f64,
    count: usize,
    now: impl Iterator<Item = &'a Sphere>,
) -> bool {
    built.len() != count || built.iter().zip(now).any(|(a, b)| has_strayed(a, b, skin))
}

/// Returns whether a sphere that was at `a` and is now at `b` has moved by more than half the skin.
pub(super) fn has_strayed(a: &Sphere, b: &Sphere, skin: f64) -> bool {
    // Two particles that each move by half the skin close a gap of one skin.
    let half = 0.5 * skin;
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > half * half
}

/// Finds pairs of a sphere of `first` and one of `partners` that are closer than their radii and the skin.
///
/// `rest_distance` returns the distance at which a pair begins to push, or `None` if it never does. With
/// `within`, both slices are the same spheres, and each pair is listed once with the lower number first. The
/// result comes in parts; the pairs in them are sorted by their ends.
pub(super) fn search(
    cells: &mut CellList,
    [first, partners]: [&[Sphere]; 2],
    within: bool,
    [reach, skin]: [f64; 2],
    rest_distance: &(impl Fn(usize, usize) -> Option<f64> + Sync),
) -> Vec<Vec<Candidate>> {
    // A sphere outside of this box has no partner: beside a small projectile, most spheres of a large body
    // are skipped.
    let (low, high) = bounds(partners, reach);
    cells.build(partners, reach);
    let cells = &*cells;
    let list_pairs = |i: usize, part: &mut Vec<Candidate>| {
        let a = &first[i];
        if (0..3).any(|c| a[c] < low[c] || a[c] > high[c]) {
            return;
        }
        cells.around(a, |j| {
            let k = j as usize;
            let b = &partners[k];
            // The lower number lists the pair, so that it is listed once.
            if within && k <= i || distance(a, b) > a[3] + b[3] + skin {
                return;
            }
            let ends = [i as u32, j];
            part.extend(rest_distance(i, k).map(|rest_distance| Candidate { ends, rest_distance }));
        });
    };
    let part = |c: usize| {
        let mut part = Vec::new();
        for i in c * CHUNK..((c + 1) * CHUNK).min(first.len()) {
            let start = part.len();
            list_pairs(i, &mut part);
            // Sorted, so that the list does not depend on the order of the cells.
            part[start..].sort_unstable_by_key(|c| c.ends);
        }
        part
    };
    (0..first.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(part)
        .collect()
}

/// Near pairs and the springs of their contacts.
#[derive(Debug)]
pub(crate) struct Listed {
    pub(crate) pairs: Vec<Candidate>,
    /// Springs of closed contacts; an open one holds nothing.
    pub(crate) springs: Sparse<Spring>,
    pub(crate) searches: usize,
    pub(super) skin: f64,
    /// Spheres of all bodies at the last search.
    pub(super) built: Vec<Sphere>,
    watch: Watch,
}

impl Listed {
    pub(super) fn new(skin: f64) -> Self {
        Self {
            pairs: Vec::new(),
            springs: Sparse::default(),
            searches: 0,
            skin,
            built: Vec::new(),
            watch: Watch::default(),
        }
    }

    /// Measures the pairs that may have closed at the displacements `q`, and returns true. Returns false if
    /// the list may be stale or a look at all pairs pays: [`Self::measure`] must then follow.
    pub(super) fn follow(&mut self, grains: &mut [Grains], q: &[&[f64]]) -> bool {
        let known = (self.counts(), self.skin, &self.built[..]);
        let holds = self.watch.follow(grains, q, known);
        if holds {
            self.watch.measure_due(grains, q, &self.pairs);
        }
        holds
    }

    /// Measures all pairs, for particles that have been placed at the displacements `q`.
    pub(super) fn measure(&mut self, grains: &[Grains], q: &[&[f64]]) {
        let known = (self.searches, self.skin, &self.built[..]);
        self.watch
            .measure_all(grains, q, (&self.pairs, &self.springs), known);
    }

    /// Pairs that push, with their overlaps \[m\], and pairs that have just opened, in the order of the list.
    pub(super) fn touching(&self) -> &[(usize, f64)] {
        self.watch.touching()
    }

    /// Number of searches, and of pairs.
    pub(crate) fn counts(&self) -> [usize; 2] {
        [self.searches, self.pairs.len()]
    }

    /// Searches again if a sphere has moved by half the skin since the last search. Lists pairs between
    /// `first` and `second`, or within `first` if there is no second.
    ///
    /// `rest_distance(i, k)` returns the distance at which a pair begins to push, or `None` if it never does.
    /// Springs of pairs that are still listed are kept.
    pub(super) fn refresh(
        &mut self,
        first: &[Sphere],
        second: Option<&[Sphere]>,
        rest_distance: impl Fn(usize, usize) -> Option<f64> + Sync,
    ) {
        let all_spheres = || first.iter().chain(second.unwrap_or_default());
        let (within, partners) = (second.is_none(), second.unwrap_or(first));
        if !is_stale(&self.built, self.skin, all_spheres().count(), all_spheres()) {
            return;
        }
        self.searches += 1;
        self.built.clear();
        self.built.extend(all_spheres());
        // Cells of this size hold all partners of a sphere in the cells around its own.
        let reach = 2.0 * all_spheres().fold(0.0_f64, |m, s| m.max(s[3])) + self.skin;
        // Cells are made anew: searches are rare, and their memory is not used between them.
        let parts = search(
            &mut CellList::default(),
            [first, partners],
            within,
            [reach, self.skin],
            &rest_distance,
        );
        self.relist(&parts);
    }

    /// Makes space for `more` pairs, and for some beyond: doubled lists would be the largest of a contact.
    fn reserve(&mut self, more: usize) {
        let len = self.pairs.len() + more;
        if len > self.pairs.capacity() {
            self.pairs.reserve_exact(more + len / 16);
        }
    }

    /// Replaces the list; closed contacts keep their springs.
    fn relist(&mut self, parts: &[Vec<Candidate>]) {
        let closed = self.springs.iter().filter(|(_, s)| s.closed);
        let old: Vec<([u32; 2], Spring)> = closed.map(|(k, s)| (self.pairs[k].ends, s)).collect();
        self.pairs.clear();
        self.reserve(parts.iter().map(Vec::len).sum());
        parts.iter().for_each(|p| self.pairs.extend_from_slice(p));
        self.springs = Sparse::new(self.pairs.len());
        for (ends, s) in old {
            // The parts come in ascending order, so the new list is sorted.
            let k = self.pairs.partition_point(|p| p.ends < ends);
            if self.pairs.get(k).is_some_and(|p| p.ends == ends) {
                *self.springs.get_mut(k) = s;
            }
        }
    }

    /// Lets the next refresh search again, also for spheres that have not moved.
    pub(super) fn forget(&mut self) {
        self.built.clear();
    }

    /// Writes what a resumed run needs. Integers: number of searches, number of pairs, whether a search was
    /// made; ends and state of each pair. Numbers: rest distance and spring of each pair; the spheres of the
    /// last search.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        let searched = u64::from(!self.built.is_empty());
        out.integers
            .extend([self.searches as u64, self.pairs.len() as u64, searched]);
        for (k, p) in self.pairs.iter().enumerate() {
            let s = self.springs.get(k);
            out.integers
                .extend([u64::from(p.ends[0]), u64::from(p.ends[1]), u64::from(s.closed)]);
            out.numbers.push(p.rest_distance);
            out.numbers.extend(s.numbers());
        }
        out.numbers.extend(self.built.iter().flatten());
    }

    /// Restores what [`Self::save`] wrote and returns the numbers that follow; `None` for a record of other
    /// bodies.
    ///
    /// First ends must be below the first of `counts`, second ends below the second. `sphere_count` is the
    /// number of spheres that are searched.
    pub(crate) fn restore<'a>(
        &mut self,
        counts: [usize; 2],
        sphere_count: usize,
        integers: &[u64],
        numbers: &'a [f64],
    ) -> Option<&'a [f64]> {
        let (&[searches, pairs, searched], ends) = integers.split_first_chunk::<3>()?;
        let pairs = usize::try_from(pairs).ok()?;
        let built = if searched == 1 { sphere_count } else { 0 };
        // The number comes from a file: checked arithmetic, so that a damaged one is refused and does not
        // overflow.
        if ends.len() != 3usize.checked_mul(pairs)? {
            return None;
        }
        let (springs, remaining) = numbers.split_at_checked(PAIR.checked_mul(pairs)?)?;
        let (spheres, remaining) = remaining.split_at_checked(4 * built)?;
        self.searches = searches as usize;
        self.watch.reset();
        self.pairs.clear();
        self.springs = Sparse::new(pairs);
        let (ends, _) = ends.as_chunks::<3>();
        let rows = ends.iter().zip(springs.as_chunks::<PAIR>().0);
        for (k, (&[i, j, closed], &[rest_distance, ref spring @ ..])) in rows.enumerate() {
            if i >= counts[0] as u64 || j >= counts[1] as u64 {
                return None;
            }
            let ends = [i as u32, j as u32];
            self.pairs.push(Candidate { ends, rest_distance });
            if closed == 1 {
                *self.springs.get_mut(k) = Spring::from_numbers(true, *spring);
            }
        }
        self.built = spheres.as_chunks::<4>().0.to_vec();
        Some(remaining)
    }
}

/// Pairs within one body that no whole bond joins.
#[derive(Debug)]
pub(crate) struct PairList {
    pub(crate) listed: Listed,
    pub(super) adjacency: Arc<Adjacency<[u32; 2]>>,
    /// Number of bonds, whole or broken.
    pub(super) bonds: usize,
    /// Distance at which each broken bond broke \[m\], by its number.
    broken_at: BTreeMap<u32, f64>,
}

impl PairList {
    /// Makes an empty list, which the first refresh fills. Pairs are listed up to a gap of `skin` \[m\].
    pub(crate) fn new(body: &BondedParticles, skin: f64) -> Self {
        Self {
            listed: Listed::new(skin),
            adjacency: body.adjacency(),
            bonds: body.pairs().len(),
            broken_at: BTreeMap::new(),
        }
    }

    /// Writes the list, then the distances at which bonds broke.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        self.listed.save(out);
        // -1 stands for a whole bond.
        let distance = |b: u32| self.broken_at.get(&b).copied().unwrap_or(-1.0);
        out.numbers.extend((0..self.bonds as u32).map(distance));
    }

    /// Restores what [`Self::save`] wrote; `None` for a record of a body with other than `count` particles.
    pub(crate) fn restore(&mut self, count: usize, integers: &[u64], numbers: &[f64]) -> Option<()> {
        let broken = self.listed.restore([count; 2], count, integers, numbers)?;
        let gone = (0..).zip(broken).filter(|(_, d)| **d >= 0.0);
        self.broken_at = gone.map(|(b, d)| (b, *d)).collect();
        (broken.len() == self.bonds).then_some(())
    }

    /// Lists the pair of a bond that just broke.
    pub(crate) fn add_broken(&mut self, event: &Break, rest_spheres: &[Sphere]) {
        self.broken_at.insert(event.bond, event.distance);
        let [a, b] = event.pair.map(|i| &rest_spheres[i as usize]);
        self.listed.reserve(1);
        self.listed.pairs.push(Candidate {
            ends: event.pair,
            rest_distance: rest_distance_of(a, b).min(event.distance),
        });
        self.listed.springs.resize(self.listed.pairs.len());
    }

    /// Searches again if a particle has moved by half the skin since the last search.
    pub(crate) fn refresh(&mut self, now: &[Sphere], rest_spheres: &[Sphere], log: &BreakLog) {
        let (adjacency, broken_at) = (&self.adjacency, &self.broken_at);
        self.listed.refresh(now, None, |i, k| {
            let limit = rest_distance_of(&rest_spheres[i], &rest_spheres[k]);
            match bond_between(adjacency, i as u32, k as u32) {
                // Whole bonds carry their pair themselves. A broken one pushes from where it broke on, and
                // not before.
                Some(b) => log
                    .is_broken(b)
                    .then(|| limit.min(broken_at.get(&(b as u32)).copied().unwrap_or(f64::INFINITY))),
                None => Some(limit),
            }
        });
    }
}

/// Pairs between two bodies, except pairs whose two particles an interface between the bodies ties.
#[derive(Debug)]
pub(crate) struct CrossList {
    pub(crate) listed: Listed,
    /// For each particle of either body: true if an interface between the two bodies ties it.
    pub(crate) tied: [Vec<bool>; 2],
    /// Distances \[m\] at which pairs push that overlapped at a change of weights.
    renewed: BTreeMap<[u32; 2], f64>,
}

impl CrossList {
    pub(crate) fn new(skin: f64) -> Self {
        Self {
            listed: Listed::new(skin),
            tied: [Vec::new(), Vec::new()],
            renewed: BTreeMap::new(),
        }
    }

    /// Searches again if a particle of either body has moved by half the skin since the last search.
    pub(crate) fn refresh(&mut self, now: [&[Sphere]; 2], rest_spheres: [&[Sphere]; 2]) {
        let (tied, renewed) = (&self.tied, &self.renewed);
        self.listed.refresh(now[0], Some(now[1]), |i, k| {
            let limit = rest_distance_of(&rest_spheres[0][i], &rest_spheres[1][k]);
            let renewed = renewed.get(&[i as u32, k as u32]).copied();
            // Where both are tied, the multipliers already determine how they move relative to each other.
            (!(tied[0][i] && tied[1][k])).then(|| limit.min(renewed.unwrap_or(limit)))
        });
    }

    /// Searches again and lets the contacts of particles that have `gained` weight (ascending) begin anew,
    /// without a force: the place at which a particle wakes, and the stiffness that it gains, must not load a
    /// spring that took in no work.
    pub(super) fn renew(&mut self, now: [&[Sphere]; 2], rest_spheres: [&[Sphere]; 2], gained: [&[u32]; 2]) {
        self.listed.forget();
        self.refresh(now, rest_spheres);
        for (k, pair) in self.listed.pairs.iter_mut().enumerate() {
            let has_gained = |m: usize| gained[m].binary_search(&pair.ends[m]).is_ok();
            if !has_gained(0) && !has_gained(1) {
                continue;
            }
            let [a, b] = [0, 1].map(|m: usize| &now[m][pair.ends[m] as usize]);
            let present = distance(a, b);
            if present < pair.rest_distance {
                pair.rest_distance = present;
                self.renewed.insert(pair.ends, present);
            }
            self.listed.springs.take(k);
        }
    }

    /// Writes the pairs that overlapped at a change of weights, then the list.
    pub(super) fn save(&self, out: &mut Record<f64>) {
        out.integers.push(self.renewed.len() as u64);
        out.integers
            .extend(self.renewed.keys().flatten().map(|k| u64::from(*k)));
        out.numbers.extend(self.renewed.values());
        self.listed.save(out);
    }

    /// Restores what [`Self::save`] wrote; `None` for a record of bodies with other than `counts` particles.
    pub(super) fn restore(&mut self, counts: [usize; 2], integers: &[u64], numbers: &[f64]) -> Option<()> {
        let (&[renewed], integers) = integers.split_first_chunk::<1>()?;
        let renewed = usize::try_from(renewed).ok()?;
        let (ends, integers) = integers.split_at_checked(renewed.checked_mul(2)?)?;
        let (distances, numbers) = numbers.split_at_checked(renewed)?;
        let ends = ends.as_chunks::<2>().0.iter().map(|e| e.map(|k| k as u32));
        self.renewed = ends.zip(distances.iter().copied()).collect();
        let remaining = self
            .listed
            .restore(counts, counts[0] + counts[1], integers, numbers)?;
        remaining.is_empty().then_some(())
    }
}

/// Box around the centres of spheres, widened by `margin` on every side \[m\].
fn bounds(spheres: &[Sphere], margin: f64) -> ([f64; 3], [f64; 3]) {
    let low = |c: usize| spheres.iter().fold(f64::INFINITY, |m, s| m.min(s[c])) - margin;
    let high = |c: usize| spheres.iter().fold(f64::NEG_INFINITY, |m, s| m.max(s[c])) + margin;
    ([0, 1, 2].map(low), [0, 1, 2].map(high))
}

/// Returns the spheres displaced by `q` \[m\].
pub(crate) fn displaced(rest_spheres: &[Sphere], q: &[f64]) -> Vec<Sphere> {
    let moves = q.as_chunks::<3>().0;
    let put = |(s, u): (&Sphere, &[f64; 3])| [s[0] + u[0], s[1] + u[1], s[2] + u[2], s[3]];
    rest_spheres.iter().zip(moves).map(put).collect()
}

/// Counts unbonded pairs within a body that overlap beyond rest by more than `tolerance` times the sum of
/// their radii. Bonds for which `broken` is true join nothing. Particles that sleep are where they fell
/// asleep, and are left out.
///
/// Returns the number of pairs and the largest overlap over the sum of radii, or `None` if there are no
/// pairs.
pub(crate) fn overlaps(
    body: &BondedParticles,
    q: &[f64],
    tolerance: f64,
    broken: impl Fn(usize) -> bool,
) -> Option<(usize, f64)> {
    let rest_spheres = spheres(body.positions(), body.radii());
    let now = displaced(&rest_spheres, q);
    let adjacency = body.adjacency();
    let sleeps = |i: usize| {
        let bonds = adjacency.row(i);
        !bonds.is_empty() && bonds.iter().all(|[_, b]| body.is_asleep(*b as usize))
    };
    let asleep: Vec<bool> = match body.has_sleep() {
        true => (0..now.len()).map(sleeps).collect(),
        false => vec![false; now.len()],
    };
    let may_touch = |i: usize, k: usize| {
        k > i && !asleep[i] && !asleep[k] && bond_between(&adjacency, i as u32, k as u32).is_none_or(&broken)
    };
    count_overlaps([&rest_spheres; 2], [&now; 2], tolerance, may_touch)
}

/// Counts overlapping pairs between two bodies, like [`overlaps`].
pub(crate) fn overlaps_between(
    rest_spheres: [&[Sphere]; 2],
    q: [&[f64]; 2],
    tolerance: f64,
) -> Option<(usize, f64)> {
    let [first, second] = [0, 1].map(|m: usize| displaced(rest_spheres[m], q[m]));
    count_overlaps(rest_spheres, [&first, &second], tolerance, |_, _| true)
}

/// Counts pairs of a sphere of the first and one of the second slice that overlap beyond rest by more than
/// `tolerance` times the sum of their radii and for which `may_touch` is true.
///
/// Returns the number of pairs and the largest overlap over the sum of radii, or `None` if there are no
/// pairs.
pub(crate) fn count_overlaps(
    rest_spheres: [&[Sphere]; 2],
    now: [&[Sphere]; 2],
    tolerance: f64,
    may_touch: impl Fn(usize, usize) -> bool,
) -> Option<(usize, f64)> {
    // Without a skin: positions are looked at once.
    let reach = 2.0 * now.into_iter().flatten().fold(0.0_f64, |m, s| m.max(s[3]));
    let (low, high) = bounds(now[1], reach);
    let mut cells = CellList::default();
    cells.build(now[1], reach);
    let (mut count, mut largest) = (0, 0.0_f64);
    for (i, a) in now[0].iter().enumerate() {
        if (0..3).any(|c| a[c] <= low[c] || a[c] >= high[c]) {
            continue;
        }
        cells.around(a, |j| {
            let (k, b) = (j as usize, &now[1][j as usize]);
            let overlap =
                (rest_distance_of(&rest_spheres[0][i], &rest_spheres[1][k]) - distance(a, b)) / (a[3] + b[3]);
            if overlap > tolerance && may_touch(i, k) {
                count += 1;
                largest = largest.max(overlap);
            }
        });
    }
    (count > 0).then_some((count, largest))
}

//! Near pairs in a partitioned body: each rank lists the pairs whose first particle it owns.

use super::grains::Grains;
use super::neighbours::{self, Candidate, Listed, PairList, bond_between, distance, rest_distance_of};
use super::sparse::Sparse;
use super::surrounding::Surrounding;
use crate::fracture::{Break, BreakLog};
use crate::packing::cells::{CellList, Sphere};
use arlequin_core::adjacency::Adjacency;
use arlequin_core::snapshot::Record;
use arlequin_core::{Owned, Result};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Pairs per unit of parallel work.
const CHUNK: usize = 2_048;

/// Largest number of wider surroundings that are tried, each twice as wide as the one before.
const MAX_WIDENINGS: usize = 60;

/// Position of a pair in the list of the whole body: pairs of the last search ordered by their ends, then
/// pairs of broken bonds in the order of their breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    /// Number of the break since the last search, from one; zero for pairs of the search.
    broken: u32,
    /// Particle numbers in the whole body.
    pub(super) ends: [u32; 2],
}

impl Key {
    fn words(self) -> [i64; 2] {
        let [i, j] = self.ends.map(u64::from);
        [i64::from(self.broken), (i << 32 | j).cast_signed()]
    }

    fn from_words([broken, ends]: [i64; 2]) -> Self {
        let ends = ends.cast_unsigned();
        Self {
            broken: broken as u32,
            ends: [(ends >> 32) as u32, ends as u32],
        }
    }
}

/// A pair whose first particle this rank owns.
#[derive(Debug, Clone, Copy)]
struct Near {
    key: Key,
    /// Distance \[m\] below which the pair pushes; the distance at the break as long as the second particle
    /// is unknown.
    rest_distance: f64,
    /// Local numbers in [`Surrounding`]; `None` as long as the second particle is unknown.
    local: Option<[u32; 2]>,
}

/// The pairs of this rank, and counts over all ranks.
#[derive(Debug)]
pub(super) struct PartitionedPairs {
    owned: Owned,
    skin: f64,
    /// Largest radius of the whole body \[m\].
    largest: f64,
    near: Vec<Near>,
    /// Number of searches.
    searches: usize,
    /// Number of pairs on all ranks.
    total: usize,
    /// Number of breaks since the last search.
    breaks: u32,
    /// Spheres of this rank at the last search, if there was one.
    built: Option<Vec<Sphere>>,
    cells: CellList,
    around: Option<Surrounding>,
    /// True if there may be pairs whose second particle is unknown on this rank.
    has_unknown: bool,
    /// Bonds of the owned particles, with their numbers in the whole body.
    bonds: Adjacency<[u32; 2]>,
    /// Number of bonds of the whole body.
    total_bonds: usize,
    /// Distance at which each broken bond broke \[m\], by its number in the whole body.
    broken_at: BTreeMap<u32, f64>,
}

impl PartitionedPairs {
    /// This rank's part of the list of a whole body before its first step. The largest particle of the body
    /// has the radius `largest` \[m\].
    pub(super) fn new(whole: &PairList, owned: &Owned, largest: f64) -> Self {
        let bond_rows = (0..owned.nodes()).map(|i| whole.adjacency.row(owned.global(i)).to_vec());
        Self {
            owned: owned.clone(),
            skin: whole.listed.skin,
            largest,
            near: Vec::new(),
            searches: 0,
            total: 0,
            breaks: 0,
            built: None,
            cells: CellList::default(),
            around: None,
            has_unknown: true,
            bonds: Adjacency::from_rows(bond_rows),
            total_bonds: whole.bonds,
            broken_at: BTreeMap::new(),
        }
    }

    /// Number of searches, and of pairs on all ranks.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.searches, self.total]
    }

    /// Lists the pair of a bond that just broke on any rank.
    pub(super) fn add_broken(&mut self, event: &Break) {
        self.broken_at.insert(event.bond, event.distance);
        self.breaks += 1;
        self.total += 1;
        self.has_unknown = true;
        if self.owned.local(event.pair[0] as usize).is_some() {
            self.near.push(Near {
                key: Key {
                    broken: self.breaks,
                    ends: event.pair,
                },
                rest_distance: event.distance,
                local: None,
            });
        }
    }

    /// Searches again if a particle of any rank has moved by half the skin since the last search; otherwise
    /// updates the positions of the surrounding particles. Collective.
    pub(super) fn refresh(&mut self, grains: &Grains, log: &BreakLog) -> Result<()> {
        let stale = self
            .built
            .as_ref()
            .is_none_or(|built| neighbours::is_stale(built, self.skin, grains.len(), grains.now.iter()));
        if self.owned.any(stale)? {
            return self.search(grains, log);
        }
        if let Some(around) = &mut self.around {
            around.place(&grains.now)?;
        }
        self.find_second_particles(grains)
    }

    fn search(&mut self, grains: &Grains, log: &BreakLog) -> Result<()> {
        self.searches += 1;
        self.built = Some(grains.now.clone());
        let reach = 2.0 * self.largest + self.skin;
        let around = Surrounding::new(&self.owned, grains, reach)?;
        let (bonds, broken_at, owned) = (&self.bonds, &self.broken_at, &self.owned);
        let rest_distance = |i: usize, k: usize| {
            let (first, second) = (owned.global(i) as u32, around.global(k));
            if second <= first {
                // Each pair belongs to the rank of its end with the lower number.
                return None;
            }
            let limit = rest_distance_of(&around.rest_spheres[i], &around.rest_spheres[k]);
            match bond_between(bonds, i as u32, second) {
                Some(b) if !log.is_broken(b) => None,
                Some(b) => Some(limit.min(broken_at.get(&(b as u32)).copied().unwrap_or(f64::INFINITY))),
                None => Some(limit),
            }
        };
        let spheres = [&grains.now[..], &around.now[..]];
        let pairs = neighbours::search(
            &mut self.cells,
            spheres,
            false,
            [reach, self.skin],
            &rest_distance,
        );
        let near = pairs.iter().flatten().map(|c| Near {
            key: Key {
                broken: 0,
                ends: c.ends.map(|k| around.global(k as usize)),
            },
            rest_distance: c.rest_distance,
            local: Some(c.ends),
        });
        self.near = near.collect();
        self.near.sort_unstable_by_key(|n| n.key);
        let counts = self.owned.all_gather(vec![self.near.len() as i64])?;
        self.total = counts.iter().sum::<i64>() as usize;
        (self.breaks, self.has_unknown, self.around) = (0, false, Some(around));
        Ok(())
    }

    /// Finds the second particles of pairs that the search did not find. Collective.
    fn find_second_particles(&mut self, grains: &Grains) -> Result<()> {
        if !std::mem::take(&mut self.has_unknown) {
            return Ok(());
        }
        // Particles were near each other and have each moved by less than half the skin since then.
        let mut reach = 2.0 * (self.largest + self.skin);
        for _ in 0..MAX_WIDENINGS {
            let known = self.around.as_ref();
            let unknown = |n: &Near| known.and_then(|a| a.local(n.key.ends[1])).is_none();
            if !self.owned.any(known.is_none() || self.near.iter().any(unknown))? {
                break;
            }
            self.around = Some(Surrounding::new(&self.owned, grains, reach)?);
            self.near
                .iter_mut()
                .filter(|n| n.key.broken == 0)
                .for_each(|n| n.local = None);
            reach *= 2.0;
        }
        let Some(around) = &self.around else { return Ok(()) };
        for n in &mut self.near {
            let [Some(i), Some(k)] = n.key.ends.map(|id| around.local(id)) else {
                continue;
            };
            if n.local.is_none() && n.key.broken > 0 {
                let limit =
                    rest_distance_of(&around.rest_spheres[i as usize], &around.rest_spheres[k as usize]);
                n.rest_distance = n.rest_distance.min(limit);
            }
            n.local = Some([i, k]);
        }
        Ok(())
    }

    /// Gathers the pairs of all ranks that push now, in the order of the whole body, with the distance \[m\]
    /// at which each begins to push. Collective.
    pub(super) fn gather_closed(&self) -> Result<Vec<(Key, f64)>> {
        let now = self.around.as_ref().map_or(&[][..], |a| &a.now);
        let pushes = |n: &&Near| {
            n.local
                .is_some_and(|[i, k]| n.rest_distance - distance(&now[i as usize], &now[k as usize]) > 0.0)
        };
        let pushing = self.near.par_iter().with_min_len(CHUNK).filter(pushes);
        let pushing: Vec<&Near> = pushing.collect();
        let words = pushing.iter().flat_map(|n| {
            let [broken, ends] = n.key.words();
            [broken, ends, n.rest_distance.to_bits().cast_signed()]
        });
        let gathered = self.owned.all_gather(words.collect())?;
        let gathered = gathered.as_chunks::<3>().0.iter();
        let gathered = gathered.map(|[broken, ends, rest]| {
            (
                Key::from_words([*broken, *ends]),
                f64::from_bits(rest.cast_unsigned()),
            )
        });
        let mut gathered: Vec<(Key, f64)> = gathered.collect();
        gathered.sort_unstable_by_key(|p| p.0);
        Ok(gathered)
    }

    /// Gathers the list of the whole body, without its springs, on rank 0 (`None` elsewhere). Collective.
    pub(super) fn gather_list(&self) -> Result<Option<(Vec<Key>, Listed)>> {
        let numbers = |n: &Near| {
            let [i, j] = n.key.ends.map(f64::from);
            [f64::from(n.key.broken), i, j, n.rest_distance]
        };
        let sent: Vec<f64> = self.near.iter().flat_map(numbers).collect();
        let gathered = self.owned.gather_lists(sent)?;
        let built = match &self.built {
            Some(spheres) => self.owned.gather(4, spheres.as_flattened())?,
            None => Some(Cow::default()),
        };
        let (Some(gathered), Some(built)) = (gathered, built) else {
            return Ok(None);
        };
        let mut gathered = gathered.as_chunks::<4>().0.to_vec();
        gathered.sort_unstable_by(|a, b| a[..3].partial_cmp(&b[..3]).unwrap_or(std::cmp::Ordering::Equal));
        let mut list = Listed::new(self.skin);
        let ends = |x: &[f64; 4]| [x[1] as u32, x[2] as u32];
        list.pairs = gathered
            .iter()
            .map(|x| Candidate {
                ends: ends(x),
                rest_distance: x[3],
            })
            .collect();
        list.springs = Sparse::new(gathered.len());
        list.searches = self.searches;
        list.built = built.as_chunks::<4>().0.to_vec();
        let key = |x: &[f64; 4]| Key {
            broken: x[0] as u32,
            ends: ends(x),
        };
        Ok(Some((gathered.iter().map(key).collect(), list)))
    }

    /// Appends the distances at which bonds of the whole body broke, in the format of [`PairList::save`].
    pub(super) fn save_broken(&self, out: &mut Record<f64>) {
        let bonds = 0..self.total_bonds as u32;
        out.numbers
            .extend(bonds.map(|b| self.broken_at.get(&b).copied().unwrap_or(-1.0)));
    }

    /// Restores this rank's pairs from a list of the whole body and the distances at which its bonds broke.
    ///
    /// Returns the key of each listed pair, or `None` for a list of another body.
    pub(super) fn restore(&mut self, list: &Listed, broken: &[f64]) -> Option<Vec<Key>> {
        if broken.len() != self.total_bonds {
            return None;
        }
        let gone = (0..).zip(broken).filter(|(_, d)| **d >= 0.0);
        self.broken_at = gone.map(|(b, d)| (b, *d)).collect();
        self.breaks = 0;
        let mut last = [0, 0];
        let mut keys = Vec::with_capacity(list.pairs.len());
        for pair in &list.pairs {
            // Pairs of broken bonds follow those of the last search, which are sorted: the first pair out of
            // order ends the search's part.
            if self.breaks > 0 || pair.ends < last {
                self.breaks += 1;
            }
            last = pair.ends;
            keys.push(Key {
                broken: self.breaks,
                ends: pair.ends,
            });
        }
        let is_owned = |key: &Key| self.owned.local(key.ends[0] as usize).is_some();
        let near = keys.iter().zip(&list.pairs).filter(|(key, _)| is_owned(key));
        self.near = near
            .map(|(key, pair)| Near {
                key: *key,
                rest_distance: pair.rest_distance,
                local: None,
            })
            .collect();
        (self.searches, self.total) = (list.searches, keys.len());
        let owned_spheres = || (0..self.owned.nodes()).map(|i| list.built[self.owned.global(i)]);
        self.built = (!list.built.is_empty()).then(|| owned_spheres().collect());
        (self.around, self.has_unknown) = (None, true);
        Some(keys)
    }
}

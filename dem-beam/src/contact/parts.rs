//! Contact within a partitioned body.
//!
//! Each rank lists and measures the pairs whose first particle it owns, with the surrounding particles of
//! other ranks. Closed pairs are gathered on all ranks, and every rank computes all of them ([`Gathered`]).

use super::Spring;
use super::gathered::Gathered;
use super::grains::Grains;
use super::neighbours::{Candidate, Listed, PairList};
use super::pairs::{Key, PartitionedPairs};
use super::touching::Touching;
use crate::fracture::{Break, BreakLog};
use arlequin_core::effect::Instant;
use arlequin_core::snapshot::Record;
use arlequin_core::{Owned, Result};
use std::slice::{from_mut, from_ref};

/// Near pairs of a rank's part of a body, and the closed pairs of all ranks.
#[derive(Debug)]
pub(super) struct GatheredPairs {
    owned: Owned,
    list: PartitionedPairs,
    /// Closed pairs of all ranks, in the order of the whole body.
    closed: Listed,
    /// Keys of these pairs in the list of the whole body.
    keys: Vec<Key>,
    gathered: Gathered,
}

impl GatheredPairs {
    /// This rank's part of the list of a whole body before its first step. The largest particle of the body
    /// has the radius `largest` \[m\].
    pub(super) fn new(whole: &PairList, owned: &Owned, largest: f64) -> Self {
        Self {
            list: PartitionedPairs::new(whole, owned, largest),
            owned: owned.clone(),
            closed: Listed::new(0.0),
            keys: Vec::new(),
            gathered: Gathered::default(),
        }
    }

    /// Number of particles of the whole body.
    pub(super) fn particles(&self) -> usize {
        self.owned.nodes_of_whole()
    }

    /// Number on this rank of a gathered particle, if this rank owns it.
    pub(super) fn local(&self, place: usize) -> Option<usize> {
        self.gathered.local(place)
    }

    /// Number of searches, and of pairs on all ranks.
    pub(super) fn counts(&self) -> [usize; 2] {
        self.list.counts()
    }

    /// Lists the pairs of new breaks and gathers all pairs that push now on any rank, in the order of the
    /// whole body, with the distance at which each begins to push. Collective.
    pub(super) fn gather_pushing(
        &mut self,
        breaks: &[Break],
        grains: &Grains,
        log: &BreakLog,
    ) -> Result<Vec<(Key, f64)>> {
        breaks.iter().for_each(|event| self.list.add_broken(event));
        self.list.refresh(grains, log)?;
        self.list.gather_closed()
    }

    /// Returns the springs of all pairs after the last step.
    fn springs(&self, pairs: &[(Key, f64)]) -> Vec<Spring> {
        let old = self.keys.iter().enumerate();
        let mut old: Vec<([u32; 2], Spring)> = old
            .map(|(k, key)| (key.ends, self.closed.springs.get(k)))
            .collect();
        old.sort_unstable_by_key(|o| o.0);
        let spring_of = |(key, _): &(Key, f64)| {
            let k = old.binary_search_by_key(&key.ends, |o| o.0).ok()?;
            Some(old[k].1)
        };
        pairs.iter().map(|p| spring_of(p).unwrap_or_default()).collect()
    }

    /// Computes the contacts of the pushing `pairs` together with the other ranks. Collective.
    pub(super) fn respond(
        &mut self,
        pairs: &[(Key, f64)],
        touching: &mut Touching,
        grains: &Grains,
        instant: &Instant<'_, f64>,
        f: &mut [f64],
    ) -> Result<()> {
        // Particles that touched in the last step are included: their budgets are not settled yet.
        let local = |place: usize| self.gathered.local(place);
        let mut members: Vec<u32> = touching.end_forces(&local).map(|e| e.0 as u32).collect();
        let now = pairs.iter().flat_map(|p| p.0.ends);
        members.extend(
            now.filter_map(|id| self.owned.local(id as usize))
                .map(|i| i as u32),
        );
        members.sort_unstable();
        members.dedup();
        let (gathered, mut touched, mut forces) =
            Gathered::gather(&self.owned, &members, grains, instant, f)?;
        let place = |id: u32| gathered.place(id).unwrap_or_default() as u32;
        let before = &self.gathered.ids;
        touching.renumber(|p| place(before[p as usize]));
        let now = gathered.instant(instant);
        touching.settle(&mut self.closed, from_ref(&now));
        let springs = self.springs(pairs);
        let candidate = |(key, distance): &(Key, f64)| Candidate {
            ends: key.ends.map(place),
            rest_distance: *distance,
        };
        self.closed.pairs = pairs.iter().map(candidate).collect();
        self.closed.springs = springs.into_iter().collect();
        self.keys = pairs.iter().map(|p| p.0).collect();
        self.closed.measure(from_ref(&touched), &[]);
        touching.respond(
            &mut self.closed,
            from_mut(&mut touched),
            from_ref(&now),
            &mut [&mut forces],
        )?;
        gathered.deliver(&forces, f);
        self.gathered = gathered;
        Ok(())
    }

    /// Writes what the whole body would save on rank 0 and returns true; returns false elsewhere. Collective.
    pub(super) fn save(&self, touching: &Touching, out: &mut Record<f64>) -> Result<bool> {
        let Some((keys, mut list)) = self.list.gather_list()? else {
            return Ok(false);
        };
        let place = |key: &Key| keys.binary_search(key).unwrap_or_default();
        for (k, key) in self.keys.iter().enumerate() {
            *list.springs.get_mut(place(key)) = self.closed.springs.get(k);
        }
        let first = out.integers.len();
        touching.save(out);
        for pair in out.integers[first..].iter_mut().skip(Touching::COUNTS) {
            *pair = place(&self.keys[*pair as usize]) as u64;
        }
        list.save(out);
        self.list.save_broken(out);
        Ok(true)
    }

    /// Restores the list of the whole body and the particles of the contacts; `None` for a record of another
    /// body.
    pub(super) fn restore(
        &mut self,
        touching: &mut Touching,
        integers: &[u64],
        numbers: &[f64],
    ) -> Option<()> {
        let count = self.particles();
        let mut list = Listed::new(0.0);
        let broken = list.restore([count; 2], count, integers, numbers)?;
        touching.find(&list)?;
        let keys = self.list.restore(&list, broken)?;
        let closed_pairs: Vec<usize> = (0..keys.len()).filter(|k| list.springs.get(*k).closed).collect();
        let mut ids: Vec<u32> = closed_pairs.iter().flat_map(|k| keys[*k].ends).collect();
        ids.sort_unstable();
        ids.dedup();
        self.gathered = Gathered::from_ids(ids);
        self.gathered.find_owned(&self.owned);
        for pair in touching.pushing() {
            *pair = closed_pairs.binary_search(pair).ok()?;
        }
        let gathered = &self.gathered;
        touching.renumber(|id| gathered.place(id).unwrap_or_default() as u32);
        self.closed.pairs = closed_pairs.iter().map(|k| list.pairs[*k]).collect();
        self.closed.springs = closed_pairs.iter().map(|k| list.springs.get(*k)).collect();
        self.keys = closed_pairs.iter().map(|k| keys[*k]).collect();
        Some(())
    }
}

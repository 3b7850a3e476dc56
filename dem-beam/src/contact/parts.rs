//! Contact within a partitioned body.
//!
//! Each rank lists and measures the pairs whose first particle it owns, with the surrounding particles of
//! other ranks. Closed pairs are gathered on all ranks, and every rank computes all of them ([`Gathered`]).

use super::Contacts;
use super::gathered::Gathered;
use super::grains::Grains;
use super::law::Spring;
use super::neighbours::{Candidate, Listed};
use super::pairs::{Key, PartitionedPairs};
use super::touching::Touching;
use super::{add, grains};
use crate::fracture::{SharedLog, locked};
use arlequin_core::effect::{AnyEffect, Effect, Host, Instant, StepDemand};
use arlequin_core::ranks::{Exact, Portion, RankError};
use arlequin_core::snapshot::Record;
use arlequin_core::{Arms, DofLayout};
use std::slice::{from_mut, from_ref};
use std::sync::Arc;

/// Contact between the particles of all ranks, as one rank computes it.
#[derive(Debug)]
pub(super) struct PartitionedContacts {
    portion: Arc<Portion>,
    grains: Grains,
    /// Largest radius of the whole body \[m\].
    largest: f64,
    log: SharedLog,
    seen: usize,
    list: PartitionedPairs,
    touching: Touching,
    /// Closed pairs of all ranks in the order of the whole body, and their keys in its list.
    closed: Listed,
    keys: Vec<Key>,
    gathered: Gathered,
}

impl PartitionedContacts {
    /// This rank's part of the contact in a whole body; `effect` is the effect's name in errors.
    pub(super) fn new(
        whole: Contacts,
        portion: &Arc<Portion>,
        host: &Host<'_, f64>,
        effect: &str,
    ) -> arlequin_core::Result<Self> {
        let mut grains = whole.grains;
        let largest = grains.largest();
        grains.restrict(portion, effect)?;
        grains.attach(host, effect)?;
        Ok(Self {
            list: PartitionedPairs::new(whole.list, portion, largest),
            portion: portion.clone(),
            grains,
            largest,
            log: whole.log,
            seen: whole.seen,
            touching: whole.touching,
            closed: Listed::new(0.0),
            keys: Vec::new(),
            gathered: Gathered::default(),
        })
    }

    /// Gathers all pairs that push now on any rank, in the order of the whole body, with the distance at
    /// which each begins to push. Collective.
    fn gather_pushing(&mut self) -> Result<Vec<(Key, f64)>, RankError> {
        let log = locked(&self.log);
        for event in &log.events()[self.seen..] {
            self.list.add_broken(event);
        }
        self.seen = log.events().len();
        self.list.refresh(&self.grains, &log)?;
        drop(log);
        self.list.gather_closed()
    }

    /// Returns the springs of all pairs after the last step.
    fn springs(&self, pairs: &[(Key, f64)]) -> Vec<Spring> {
        let old = self.keys.iter().map(|k| k.ends).zip(&self.closed.springs);
        let mut old: Vec<([u32; 2], &Spring)> = old.collect();
        old.sort_unstable_by_key(|o| o.0);
        let spring_of = |(key, _): &(Key, f64)| {
            let k = old.binary_search_by_key(&key.ends, |o| o.0).ok()?;
            Some(*old[k].1)
        };
        pairs.iter().map(|p| spring_of(p).unwrap_or_default()).collect()
    }

    /// Computes all contacts together with the other ranks. Collective.
    fn respond(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> Result<(), RankError> {
        let pairs = self.gather_pushing()?;
        // Particles that touched in the last step are included: their budgets are not settled yet.
        let local = |place: usize| self.gathered.local(place);
        let mut members: Vec<u32> = self.touching.end_forces(&local).map(|e| e.0 as u32).collect();
        let now = pairs.iter().flat_map(|p| p.0.ends);
        members.extend(
            now.filter_map(|id| self.portion.local(id as usize))
                .map(|i| i as u32),
        );
        members.sort_unstable();
        members.dedup();
        let (gathered, mut grains, mut forces) =
            Gathered::gather(&self.portion, &members, &self.grains, instant, f)?;
        let place = |id: u32| gathered.place(id).unwrap_or_default() as u32;
        let before = &self.gathered.ids;
        self.touching.renumber(|p| place(before[p as usize]));
        let now = gathered.instant(instant);
        self.touching.settle(&mut self.closed, from_ref(&now));
        let springs = self.springs(&pairs);
        let candidate = |(key, distance): &(Key, f64)| Candidate {
            ends: key.ends.map(place),
            rest_distance: *distance,
        };
        self.closed.pairs = pairs.iter().map(candidate).collect();
        self.closed.springs = springs;
        self.keys = pairs.iter().map(|p| p.0).collect();
        self.touching.respond(
            &mut self.closed,
            from_mut(&mut grains),
            from_ref(&now),
            &mut [&mut forces],
        );
        gathered.deliver(&forces, f);
        self.gathered = gathered;
        Ok(())
    }

    /// Returns the record that the whole body would save, on rank 0; empty elsewhere. Collective.
    fn recorded(&self) -> Result<Record<f64>, RankError> {
        let Some((keys, mut list)) = self.list.gather_list()? else {
            return Ok(Record::default());
        };
        let place = |key: &Key| keys.binary_search(key).unwrap_or_default();
        for (key, spring) in self.keys.iter().zip(&self.closed.springs) {
            list.springs[place(key)] = *spring;
        }
        let mut out = Record::default();
        out.integers.push(self.seen as u64);
        let first = out.integers.len();
        self.touching.save(&mut out);
        for pair in out.integers[first..].iter_mut().skip(Touching::COUNTS) {
            *pair = place(&self.keys[*pair as usize]) as u64;
        }
        list.save(&mut out);
        self.list.save_broken(&mut out);
        Ok(out)
    }

    /// Restores the record of the whole body; `None` for a record of another body.
    fn recall(&mut self, from: &Record<f64>) -> Option<()> {
        let count = self.portion.division().nodes();
        let (seen, integers) = from.integers.split_first()?;
        self.seen = *seen as usize;
        let (integers, numbers) = self.touching.restore(integers, &from.numbers)?;
        let mut list = Listed::new(0.0);
        let broken = list.restore([count; 2], count, integers, numbers)?;
        self.touching.find(&list)?;
        let keys = self.list.restore(&list, broken)?;
        let closed_pairs: Vec<usize> = (0..keys.len()).filter(|k| list.springs[*k].closed).collect();
        let mut ids: Vec<u32> = closed_pairs.iter().flat_map(|k| keys[*k].ends).collect();
        ids.sort_unstable();
        ids.dedup();
        self.gathered = Gathered::from_ids(ids);
        self.gathered.find_owned(&self.portion);
        for pair in self.touching.pushing() {
            *pair = closed_pairs.binary_search(pair).ok()?;
        }
        let gathered = &self.gathered;
        self.touching
            .renumber(|id| gathered.place(id).unwrap_or_default() as u32);
        self.closed.pairs = closed_pairs.iter().map(|k| list.pairs[*k]).collect();
        self.closed.springs = closed_pairs.iter().map(|k| list.springs[*k]).collect();
        self.keys = closed_pairs.iter().map(|k| keys[*k]).collect();
        Some(())
    }
}

impl AnyEffect<f64> for PartitionedContacts {
    fn name(&self) -> &str {
        "contact"
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Current)
    }

    fn saves_whole(&self) -> bool {
        true
    }

    /// Errors between ranks are kept for [`Portion::failure`].
    fn save(&self) -> Record<f64> {
        self.recorded().unwrap_or_default()
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        self.recall(from)
            .ok_or_else(|| arlequin_core::Error::SizeMismatch {
                what: "particles in the record of contacts".into(),
                expected: self.portion.division().nodes(),
                found: from.numbers.len() / 4,
            })
    }

    fn stored(&self) -> f64 {
        self.touching.stored()
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.touching.supplied())
    }

    fn facts(&self) -> Vec<(String, f64)> {
        self.touching.facts(self.list.counts())
    }
}

impl Effect<f64> for PartitionedContacts {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        self.grains.place(instant.q);
        Ok(self.respond(instant, f)?)
    }

    /// Power on the owned particles \[W\].
    fn power(&self, v: &[f64]) -> f64 {
        let local = |place: usize| self.gathered.local(place);
        let ends = self.touching.end_forces(&local);
        ends.map(|(i, force, torque)| grains::power(v, i, &force, &torque))
            .sum()
    }

    fn add_power(&self, _: &DofLayout, v: &[f64], sum: &mut Exact) -> bool {
        self.touching
            .add_power(v, &|place| self.gathered.local(place), sum);
        true
    }

    fn add_contact(&self, f: &mut [f64]) -> bool {
        let local = |place: usize| self.gathered.local(place);
        for (i, force, torque) in self.touching.end_forces(&local) {
            add(f, i, &force, &torque);
        }
        true
    }

    fn step_demand(&self) -> StepDemand<f64> {
        let top = self.grains.top(|r| self.touching.stiffness([r, self.largest]));
        self.touching.demand(top)
    }
}

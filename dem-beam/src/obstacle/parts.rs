//! Obstacle on a partitioned body: every rank gathers the touching particles and moves the obstacle
//! identically.

use super::near::{Near, place};
use super::{Active, Body, allowed};
use crate::contact::gathered::Gathered;
use crate::contact::{Grains, Sparse, Spring};
use arlequin_core::Owned;
use arlequin_core::contact::RigidBody;
use arlequin_core::effect::{Host, Instant};
use std::borrow::Cow;

/// The particles that this rank owns, and the gathered touching particles of all ranks.
#[derive(Debug)]
pub(super) struct PartitionState {
    owned: Owned,
    grains: Grains,
    allowed: Vec<f64>,
    near: Near,
    pub(super) gathered: Gathered,
}

impl Body {
    /// Restricts the obstacle to the owned particles; `effect` is the effect's name in errors.
    pub(super) fn restrict(
        &mut self,
        owned: Owned,
        host: &Host<'_, f64>,
        effect: &str,
    ) -> arlequin_core::Result<()> {
        let mut grains = std::mem::replace(&mut self.grains, Grains::from_contact_data(&[]));
        grains.restrict(&owned, effect)?;
        grains.attach(host, effect)?;
        (self.allowed, self.springs) = (Vec::new(), Sparse::default());
        self.partition = Some(PartitionState {
            owned,
            allowed: allowed(self.body.lock().shape(), &grains.rest_spheres),
            near: self.near.for_particles(grains.len()),
            grains,
            gathered: Gathered::default(),
        });
        Ok(())
    }

    /// Computes the contacts with all touching particles of all ranks and adds the forces on the owned ones.
    /// Collective.
    pub(super) fn respond_partitioned(
        &mut self,
        partition: &mut PartitionState,
        rigid: &mut RigidBody,
        instant: &Instant<'_, f64>,
        f: &mut [f64],
    ) -> arlequin_core::Result<()> {
        let u = &instant.q[..3 * partition.grains.len()];
        let rest_spheres = &partition.grains.rest_spheres;
        partition
            .near
            .refresh(rigid.shape(), &rigid.moved(), u, rest_spheres, |_| ());
        let touches = |i: &u32| {
            let i = *i as usize;
            let (distance, _) = rigid
                .shape()
                .distance(&place(&rest_spheres[i], u, i), &rigid.moved());
            rest_spheres[i][3] + partition.allowed[i] - distance > 0.0
        };
        let mut members: Vec<u32> = partition.near.particles.iter().copied().filter(touches).collect();
        // Particles that touched in the last step are included: their budgets are not settled yet.
        let before = self
            .active
            .iter()
            .filter_map(|a| partition.gathered.local(a.particle as usize));
        members.extend(before.map(|i| i as u32));
        members.sort_unstable();
        members.dedup();
        let (gathered, grains, mut forces) =
            Gathered::gather(&partition.owned, &members, &partition.grains, instant, f)?;
        let known = std::mem::replace(&mut partition.gathered, gathered);
        let gathered = &partition.gathered;
        let mut springs = Sparse::new(gathered.ids.len());
        for (k, spring) in self.springs.iter() {
            if let Some(k) = gathered.place(known.ids[k]) {
                *springs.get_mut(k) = spring;
            }
        }
        for a in &mut self.active {
            let id = known.ids[a.particle as usize];
            a.particle = gathered.place(id).unwrap_or_default() as u32;
        }
        self.allowed = allowed(rigid.shape(), &grains.rest_spheres);
        (self.grains, self.springs) = (grains, springs);
        let now = gathered.instant(instant);
        self.settle_budgets(rigid, &now);
        let places: Vec<u32> = (0..gathered.ids.len() as u32).collect();
        self.act_on(&places, rigid, &now, &mut forces)?;
        gathered.deliver(&forces, f);
        Ok(())
    }

    /// Iterates over the closed contacts of the last step with owned particles, by their local numbers.
    pub(super) fn pushed(&self) -> impl Iterator<Item = (usize, &Active)> {
        let local = |i: usize| match &self.partition {
            Some(partition) => partition.gathered.local(i),
            None => Some(i),
        };
        let contacts = self.active.iter();
        contacts.filter_map(move |a| Some((local(a.particle as usize)?, a)))
    }

    /// The particles that this rank owns, all of them or a part.
    pub(super) fn owned(&self) -> (Owned, &Grains) {
        match &self.partition {
            Some(partition) => (partition.owned.clone(), &partition.grains),
            None => (Owned::whole(self.grains.len()), &self.grains),
        }
    }

    /// Springs of all particles of the whole body.
    pub(super) fn all_springs(&self) -> Cow<'_, Sparse<Spring>> {
        let Some(partition) = &self.partition else {
            return Cow::Borrowed(&self.springs);
        };
        let mut out = Sparse::new(partition.owned.nodes_of_whole());
        for (k, spring) in self.springs.iter() {
            *out.get_mut(partition.gathered.ids[k] as usize) = spring;
        }
        Cow::Owned(out)
    }

    /// Rebuilds the list of touching particles after a restore, when springs and closed contacts have numbers
    /// of the whole body. Does nothing in a body that is not partitioned.
    pub(super) fn restore_gathered(&mut self) {
        let Some(partition) = &mut self.partition else {
            return;
        };
        let closed = self.springs.iter().map(|(id, _)| id as u32);
        let mut ids: Vec<u32> = closed.chain(self.active.iter().map(|a| a.particle)).collect();
        ids.sort_unstable();
        ids.dedup();
        self.springs = ids.iter().map(|id| self.springs.get(*id as usize)).collect();
        partition.gathered = Gathered::from_ids(ids);
        partition.gathered.find_owned(&partition.owned);
        for a in &mut self.active {
            a.particle = partition.gathered.place(a.particle).unwrap_or_default() as u32;
        }
        partition.near.clear();
    }
}

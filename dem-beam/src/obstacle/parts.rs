//! Obstacle on a partitioned body: every rank gathers the touching particles and moves the obstacle
//! identically.

use super::near::{Near, place};
use super::{Active, Body, allowed};
use crate::contact::company::Company;
use crate::contact::{Grains, Spring};
use arlequin_core::effect::{Host, Instant};
use arlequin_core::ranks::{Portion, RankError};
use std::borrow::Cow;
use std::sync::Arc;

/// The particles that this rank owns, and the gathered touching particles of all ranks.
#[derive(Debug)]
pub(super) struct Crowd {
    portion: Arc<Portion>,
    pub(super) grains: Grains,
    allowed: Vec<f64>,
    near: Near,
    pub(super) company: Company,
}

impl Crowd {
    /// This rank's part of the partitioned body.
    pub(super) fn portion(&self) -> &Portion {
        &self.portion
    }
}

impl Body {
    /// Restricts the obstacle to the owned particles; `of` names the effect in errors.
    pub(super) fn share_out(
        &mut self,
        portion: &Arc<Portion>,
        to: &Host<'_, f64>,
        of: &str,
    ) -> arlequin_core::Result<()> {
        let mut grains = std::mem::replace(&mut self.grains, Grains::heard(&[]));
        grains.share_out(portion, of)?;
        grains.attach(to, of)?;
        (self.allowed, self.springs) = (Vec::new(), Vec::new());
        self.crowd = Some(Crowd {
            portion: portion.clone(),
            allowed: allowed(&self.shape, &grains.rest),
            near: self.near.of_part(grains.len()),
            grains,
            company: Company::default(),
        });
        Ok(())
    }

    /// Computes the contacts with all touching particles of all ranks and adds the forces on the owned ones.
    /// Collective.
    pub(super) fn respond_in_parts(
        &mut self,
        crowd: &mut Crowd,
        at: &Instant<'_, f64>,
        f: &mut [f64],
    ) -> Result<(), RankError> {
        let u = &at.q[..3 * crowd.grains.len()];
        let rest = &crowd.grains.rest;
        crowd.near.refresh(&self.shape, &self.moved, u, rest, |_| ());
        let touches = |i: &u32| {
            let i = *i as usize;
            let (distance, _) = self.shape.distance(&place(&rest[i], u, i), &self.moved);
            rest[i][3] + crowd.allowed[i] - distance > 0.0
        };
        let mut members: Vec<u32> = crowd.near.particles.iter().copied().filter(touches).collect();
        // Particles that touched in the last step are included: their budgets are not settled yet.
        let before = self
            .active
            .iter()
            .filter_map(|a| crowd.company.here(a.particle as usize));
        members.extend(before.map(|i| i as u32));
        members.sort_unstable();
        members.dedup();
        let (company, grains, mut forces) = Company::hear(&crowd.portion, &members, &crowd.grains, at, f)?;
        let known = std::mem::replace(&mut crowd.company, company);
        let company = &crowd.company;
        let mut springs = vec![Spring::default(); company.ids.len()];
        for (id, spring) in known.ids.iter().zip(&self.springs) {
            if let Some(to) = company.place(*id) {
                springs[to] = *spring;
            }
        }
        for a in &mut self.active {
            let id = known.ids[a.particle as usize];
            a.particle = company.place(id).unwrap_or_default() as u32;
        }
        self.allowed = allowed(&self.shape, &grains.rest);
        (self.grains, self.springs) = (grains, springs);
        let now = company.at(at);
        self.settle_budgets(&now);
        let all: Vec<u32> = (0..company.ids.len() as u32).collect();
        self.act_on(&all, &now, &mut forces);
        company.deliver(&forces, f);
        Ok(())
    }

    /// Iterates over the closed contacts of the last step with owned particles, by their local numbers.
    pub(super) fn pushed(&self) -> impl Iterator<Item = (usize, &Active)> {
        let here = |i: usize| match &self.crowd {
            Some(crowd) => crowd.company.here(i),
            None => Some(i),
        };
        let all = self.active.iter();
        all.filter_map(move |a| Some((here(a.particle as usize)?, a)))
    }

    /// Number of particles of the whole body.
    pub(super) fn all_particles(&self) -> usize {
        let crowd = self.crowd.as_ref();
        crowd.map_or(self.springs.len(), |c| c.portion.division().nodes())
    }

    /// Springs of all particles of the whole body.
    pub(super) fn all_springs(&self) -> Cow<'_, [Spring]> {
        let Some(crowd) = &self.crowd else {
            return Cow::from(&self.springs);
        };
        let mut out = vec![Spring::default(); self.all_particles()];
        for (id, spring) in crowd.company.ids.iter().zip(&self.springs) {
            out[*id as usize] = *spring;
        }
        out.into()
    }

    /// Rebuilds the list of touching particles after a restore, when springs and closed contacts have numbers
    /// of the whole body. Does nothing in a body that is not partitioned.
    pub(super) fn meet_again(&mut self) {
        let Some(crowd) = &mut self.crowd else { return };
        let on = (0..).zip(&self.springs).filter(|(_, s)| s.on).map(|(id, _)| id);
        let mut ids: Vec<u32> = on.chain(self.active.iter().map(|a| a.particle)).collect();
        ids.sort_unstable();
        ids.dedup();
        self.springs = ids.iter().map(|id| self.springs[*id as usize]).collect();
        crowd.company = Company::of(ids);
        crowd.company.find(&crowd.portion);
        for a in &mut self.active {
            a.particle = crowd.company.place(a.particle).unwrap_or_default() as u32;
        }
        crowd.near.clear();
    }
}

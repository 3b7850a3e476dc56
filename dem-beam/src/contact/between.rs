//! Contact between the particles of two models, for example a projectile and its target.
//!
//! Law, search and energy budgets are the same as in [`super::Contact`]. Three rules decide which particles
//! may touch:
//!
//! - Particles that an interface between the two models ties never touch each other: where two particle
//!   models overlap they are the same material, and the multipliers determine their motion.
//! - Other particles that overlap at rest push only when they come closer than at rest, as within one model.
//!   If the centre of one lies in the other before the first step, one body is inside the other, which is an
//!   error.
//! - What sleeps in a zone that moves touches nothing; contacts of what gains weight begin anew.
//! - In an overlap with a third model, a contact carries the smaller mass share of its two ends, as within
//!   one model.

use super::ContactLaw;
use super::body::ContactBody;
use super::grains::Grains;
use super::neighbours::{CrossList, distance};
use super::touching::Touching;
use crate::error::{Error, Result};
use arlequin_core::Arms;
use arlequin_core::effect::{AnyEffect, HostPair, Instant, PairEffect, PairEffectSpec, StepDemand};
use arlequin_core::snapshot::Record;
use std::collections::BTreeSet;

/// Specification of contact between two cohesive-beam bodies, a pair effect on their subdomains in the order
/// of the models.
#[derive(Debug)]
pub struct ContactBetween(Contacts);

/// Contact at work in a run.
#[derive(Debug)]
struct Contacts {
    name: String,
    grains: [Grains; 2],
    list: CrossList,
    touching: Touching,
    /// Particles of either model that have gained weight since the last step, ascending.
    gained: [Vec<u32>; 2],
}

impl ContactBetween {
    /// Contact between the particles of two models; its name is `contact A-B`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for parameters of the law.
    pub fn new(first: ContactBody, second: ContactBody, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let spheres = [&first, &second].map(|body| body.spheres.get());
        let radii = || spheres.iter().flat_map(|s| s.iter()).map(|s| s[3]);
        let mean = radii().sum::<f64>() / radii().count() as f64;
        Ok(Self(Contacts {
            name: format!("contact {}-{}", first.name, second.name),
            grains: [Grains::new(first), Grains::new(second)],
            list: CrossList::new(law.skin * mean),
            touching: Touching::new(law),
            gained: [Vec::new(), Vec::new()],
        }))
    }
}

impl Contacts {
    /// Returns an error if a sphere of a listed pair holds the centre of the other at the current positions.
    ///
    /// Contact begins only below the distance at rest, so one body would start inside the other. Bodies that
    /// an interface ties overlap by intention and are not checked.
    fn check_start(&self, list: &CrossList) -> Result<()> {
        if list.tied.iter().flatten().any(|tied| *tied) {
            return Ok(());
        }
        let [first, second] = &self.grains;
        // A set, since a particle may stand in several pairs.
        let mut inside = BTreeSet::new();
        let mut deepest = (0.0, [0.0; 3], 0.0);
        for pair in &list.listed.pairs {
            let (a, b) = (
                &first.now[pair.ends[0] as usize],
                &second.now[pair.ends[1] as usize],
            );
            let (depth, limit) = (a[3] + b[3] - distance(a, b), a[3].min(b[3]));
            // Deeper than the smaller radius: the centre of one sphere lies in the other.
            if depth > limit {
                inside.insert(pair.ends[1]);
                if depth > deepest.0 {
                    deepest = (depth, [b[0], b[1], b[2]], limit);
                }
            }
        }
        let (depth, place, limit) = deepest;
        match inside.len() {
            0 => Ok(()),
            count => Err(Error::StartsInside {
                object: format!("particles of the other body of '{}'", self.name),
                count,
                place,
                depth,
                limit,
            }),
        }
    }

    /// Restores what [`AnyEffect::save`] wrote; `None` for a record of other bodies.
    fn recall(&mut self, from: &Record<f64>) -> Option<()> {
        let mut integers = &from.integers[..];
        for gained in &mut self.gained {
            let (&[count], more) = integers.split_first_chunk::<1>()?;
            let (listed, more) = more.split_at_checked(usize::try_from(count).ok()?)?;
            *gained = listed.iter().map(|i| *i as u32).collect();
            integers = more;
        }
        let (integers, numbers) = self.touching.restore(integers, &from.numbers)?;
        self.list.restore(self.counts(), integers, numbers)?;
        self.touching.find(&self.list.listed)
    }

    /// Takes the places of all particles at the displacements `q`.
    fn place(&mut self, q: [&[f64]; 2]) {
        self.grains.iter_mut().zip(q).for_each(|(g, q)| g.place(q));
    }

    fn counts(&self) -> [usize; 2] {
        [self.grains[0].len(), self.grains[1].len()]
    }
}

impl PairEffectSpec<f64> for ContactBetween {
    fn name(&self) -> &str {
        &self.0.name
    }

    fn attach(
        mut self: Box<Self>,
        hosts: &HostPair<'_, f64>,
    ) -> arlequin_core::Result<Box<dyn PairEffect<f64>>> {
        let Contacts {
            name, grains, list, ..
        } = &mut self.0;
        for (m, grains) in grains.iter_mut().enumerate() {
            grains.attach(&hosts.sides[m], name)?;
            list.tied[m].clone_from(&hosts.tied[m]);
            list.tied[m].resize(grains.len(), false);
        }
        // A separate list: the run's list is filled at its first instant.
        let mut near = CrossList::new(0.0);
        near.tied.clone_from(&list.tied);
        let [a, b] = [&grains[0].rest_spheres, &grains[1].rest_spheres].map(|s| &s[..]);
        near.refresh([a, b], [a, b]);
        let named = |e| arlequin_core::Error::of_model(hosts.sides[0].model.name(), e);
        self.0.check_start(&near).map_err(named)?;
        Ok(Box::new(self.0))
    }
}

impl AnyEffect<f64> for Contacts {
    fn name(&self) -> &str {
        &self.name
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Current)
    }

    fn stored(&self) -> f64 {
        self.touching.stored()
    }

    fn supplied(&self) -> Option<f64> {
        Some(self.touching.supplied())
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        for gained in &self.gained {
            out.integers.push(gained.len() as u64);
            out.integers.extend(gained.iter().map(|i| u64::from(*i)));
        }
        self.touching.save(&mut out);
        self.list.save(&mut out);
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let fits = self.recall(from);
        fits.ok_or_else(|| arlequin_core::Error::SizeMismatch {
            what: format!("particles in the record of '{}'", self.name),
            expected: self.counts().iter().sum(),
            found: from.numbers.len() / 4,
        })
    }

    fn facts(&self) -> Vec<(String, f64)> {
        self.touching.facts(self.list.listed.counts())
    }
}

impl PairEffect<f64> for Contacts {
    fn add_forces(
        &mut self,
        instants: [&Instant<'_, f64>; 2],
        mut f: [&mut [f64]; 2],
    ) -> arlequin_core::Result<()> {
        let instants = instants.map(|a| *a);
        let first = !self.touching.has_been_called();
        self.touching.settle(&mut self.list.listed, &instants);
        let q = instants.map(|i| i.q);
        let gained = std::mem::take(&mut self.gained);
        if gained.iter().any(|g| !g.is_empty()) {
            self.place(q);
            let [a, b] = &self.grains;
            let now = [&a.now[..], &b.now];
            self.list
                .renew(now, [&a.rest_spheres, &b.rest_spheres], [&gained[0], &gained[1]]);
            self.list.listed.measure(&self.grains, &q);
        } else if !self.list.listed.follow(&mut self.grains, &q) {
            self.place(q);
            let [a, b] = &self.grains;
            self.list
                .refresh([&a.now, &b.now], [&a.rest_spheres, &b.rest_spheres]);
            self.list.listed.measure(&self.grains, &q);
        }
        if first {
            self.check_start(&self.list)?;
        }
        self.touching
            .respond(&mut self.list.listed, &mut self.grains, &instants, &mut f)
    }

    fn power(&self, v: [&[f64]; 2]) -> f64 {
        self.touching.power(v)
    }

    fn add_contact(&self, side: usize, f: &mut [f64]) -> bool {
        self.touching.add_to(side, f);
        true
    }

    fn reweigh(&mut self, hosts: &HostPair<'_, f64>) -> arlequin_core::Result<()> {
        let before = self.grains.each_ref().map(Grains::shares);
        for (m, grains) in self.grains.iter_mut().enumerate() {
            grains.attach(&hosts.sides[m], &self.name)?;
            let gained = &mut self.gained[m];
            gained.extend(grains.gained(&before[m]));
            // Of two changes at one instant.
            gained.sort_unstable();
            gained.dedup();
        }
        self.touching
            .weaken(&mut self.list.listed, &self.grains, [&before[0], &before[1]]);
        Ok(())
    }

    /// Returns one demand for both sides, from the lighter particles, because the stiffest mode of a contact
    /// involves both ends.
    fn step_demand(&self) -> [StepDemand<f64>; 2] {
        let [a, b] = &self.grains;
        let top = |particles: &Grains, other_radius: f64| {
            particles.top(|r| self.touching.stiffness([r, other_radius]))
        };
        let demand = self.touching.demand(top(a, b.largest()).max(top(b, a.largest())));
        [demand, demand]
    }
}

//! Contact between particles without a bond between them: particles that never had one, or whose bond broke.
//!
//! Particles are taken at their current positions, `x + u`. A cell search lists pairs that are closer than
//! their radii and a skin; it is repeated only when a particle has moved by half the skin. Pairs of bonds
//! that break join the list at once. A pair pushes when its distance falls below the least of `r_i + r_j`,
//! the distance at rest and the distance at which its bond broke. Contacts therefore never begin with a
//! force: packings have overlaps at rest, and bonds break while compressed.
//!
//! In an overlap of models, stiffness and dashpot are multiplied by the smaller mass share of the two
//! particles, which keeps the critical step of the unweighted contact.
//!
//! Gaps are computed in parallel. Forces are added pair after pair in a fixed order, so results do not depend
//! on the number of threads. A step allocates only where the lists grow.
//!
//! A contact never gives back more energy than it took in, whatever the step (see `budget.rs`). Contacts are
//! taken one after the other, in an order that is reversed in every step. The step must also resolve contacts
//! that do not exist yet: an allowance of [`STIFF_CONTACTS`] stiff and [`DAMPED_CONTACTS`] damped contacts
//! per particle, beside its bonds, enters the critical step.

mod between;
mod body;
pub(crate) mod budget;
pub(crate) mod gathered;
mod grains;
mod law;
pub(crate) mod neighbours;
mod pairs;
mod parts;
mod surrounding;
mod touching;

pub use between::ContactBetween;
pub use body::ContactBody;
pub(crate) use grains::{Grains, add, power};
pub use law::ContactLaw;
pub(crate) use law::{Pair, Spring};
pub use touching::{DAMPED_CONTACTS, STIFF_CONTACTS};

use crate::error::Result;
use crate::fracture::{SharedLog, locked};
use crate::model::DemModel;
use arlequin_core::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, StepDemand};
use arlequin_core::ranks::Exact;
use arlequin_core::snapshot::Record;
use arlequin_core::{Arms, DofLayout};
use neighbours::PairList;
use parts::PartitionedContacts;
use std::slice::from_ref;
use touching::Touching;

/// Specification of contact within one cohesive-beam body, an effect on its subdomain.
#[derive(Debug)]
pub struct Contact(Contacts);

/// Contact at work in a run.
#[derive(Debug)]
struct Contacts {
    grains: Grains,
    log: SharedLog,
    seen: usize,
    list: PairList,
    touching: Touching,
}

impl Contact {
    /// Contact between the particles of a model. Call this after the model's fracture has been chosen.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for parameters of the law.
    pub fn new(model: &DemModel, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let body = model.body();
        Ok(Self(Contacts {
            grains: Grains::new(ContactBody::from_model(model)),
            log: model.break_log(),
            seen: 0,
            list: PairList::new(body, law.skin * body.mean_radius()),
            touching: Touching::new(law),
        }))
    }
}

impl EffectSpec<f64> for Contact {
    fn attach(mut self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
        let effect = format!("contact on '{}'", host.model.name());
        if let Some(portion) = host.shared()? {
            return Ok(Box::new(PartitionedContacts::new(
                self.0, portion, host, &effect,
            )?));
        }
        self.0.grains.attach(host, &effect)?;
        Ok(Box::new(self.0))
    }
}

impl AnyEffect<f64> for Contacts {
    fn name(&self) -> &str {
        "contact"
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Current)
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        out.integers.push(self.seen as u64);
        self.touching.save(&mut out);
        self.list.save(&mut out);
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let count = self.grains.len();
        let fits = from.integers.split_first().and_then(|(seen, integers)| {
            self.seen = *seen as usize;
            let (integers, numbers) = self.touching.restore(integers, &from.numbers)?;
            self.list.restore(count, integers, numbers)?;
            self.touching.find(&self.list.listed)
        });
        fits.ok_or_else(|| arlequin_core::Error::SizeMismatch {
            what: "particles in the record of contacts".into(),
            expected: count,
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
        self.touching.facts(self.list.listed.counts())
    }
}

impl Effect<f64> for Contacts {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        // Budgets refer to places in the list: settle them before a search reorders it.
        self.touching.settle(&mut self.list.listed, from_ref(instant));
        self.grains.place(instant.q);
        let log = locked(&self.log);
        for event in &log.events()[self.seen..] {
            self.list.add_broken(event, &self.grains.rest_spheres);
        }
        self.seen = log.events().len();
        self.list
            .refresh(&self.grains.now, &self.grains.rest_spheres, &log);
        drop(log);
        let grains = std::slice::from_mut(&mut self.grains);
        self.touching
            .respond(&mut self.list.listed, grains, from_ref(instant), &mut [f]);
        Ok(())
    }

    fn power(&self, v: &[f64]) -> f64 {
        self.touching.power([v, v])
    }

    fn add_power(&self, _: &DofLayout, v: &[f64], sum: &mut Exact) -> bool {
        self.touching.add_power(v, &Some, sum);
        true
    }

    fn add_contact(&self, f: &mut [f64]) -> bool {
        self.touching.add_to(&[0, 1], f);
        true
    }

    fn step_demand(&self) -> StepDemand<f64> {
        let largest = self.grains.largest();
        let top = self.grains.top(|r| self.touching.stiffness([r, largest]));
        self.touching.demand(top)
    }
}

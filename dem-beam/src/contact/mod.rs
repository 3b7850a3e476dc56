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
//! Only pairs whose gap may have closed are looked at (see `watch.rs`). Forces are added pair after pair in a
//! fixed order, so results do not depend on the number of threads. A step allocates only where the lists
//! grow.
//!
//! A contact never gives back more energy than it took in, whatever the step
//! ([`arlequin_core::contact::BudgetedLaw`]). Contacts are taken one after the other, in an order that is
//! reversed in every step. The step must also resolve contacts that do not exist yet: an allowance of
//! [`STIFF_CONTACTS`] stiff and [`DAMPED_CONTACTS`] damped contacts per particle, beside its bonds, enters
//! the critical step.

mod between;
mod body;
pub(crate) mod gathered;
mod grains;
pub(crate) mod neighbours;
mod pairs;
mod parts;
mod sparse;
mod surrounding;
mod touching;
mod watch;

pub use arlequin_core::contact::ContactLaw;
pub(crate) use arlequin_core::contact::Spring;
pub use between::ContactBetween;
pub use body::ContactBody;
pub(crate) use body::RestSpheres;
pub(crate) use grains::{Grains, add, power};
pub(crate) use sparse::Sparse;
pub use touching::{DAMPED_CONTACTS, STIFF_CONTACTS};

use crate::error::Result;
use crate::fracture::{SharedLog, locked};
use crate::model::DemModel;
use arlequin_core::Exact;
use arlequin_core::effect::{AnyEffect, Effect, EffectSpec, Host, Instant, StepDemand};
use arlequin_core::snapshot::Record;
use arlequin_core::{Arms, DofLayout};
use neighbours::PairList;
use parts::GatheredPairs;
use std::slice::{from_mut, from_ref};
use touching::Touching;

/// Specification of contact within one cohesive-beam body, an effect on its subdomain.
#[derive(Debug)]
pub struct Contact(Contacts);

/// Contact at work in a run.
#[derive(Debug)]
struct Contacts {
    /// The particles that this rank owns.
    grains: Grains,
    /// Largest radius of the whole body \[m\].
    largest: f64,
    log: SharedLog,
    /// Number of breaks whose pairs are listed.
    seen: usize,
    touching: Touching,
    pairs: Pairs,
}

/// Pairs of one body that may touch.
#[derive(Debug)]
enum Pairs {
    /// All pairs of a whole body, each with a spring.
    Whole(Box<PairList>),
    /// Pairs of a rank's part; those that push are gathered from all ranks.
    Part(Box<GatheredPairs>),
}

impl Pairs {
    /// Number on this rank of a particle of a touching pair, if this rank owns it.
    fn local(&self, particle: usize) -> Option<usize> {
        match self {
            Self::Whole(_) => Some(particle),
            Self::Part(part) => part.local(particle),
        }
    }
}

impl Contact {
    /// Contact between the particles of a model. Call this after the model's fracture has been chosen.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for parameters of the law.
    pub fn new(model: &DemModel, law: ContactLaw) -> Result<Self> {
        law.check()?;
        let body = model.body();
        let grains = Grains::new(ContactBody::from_model(model));
        Ok(Self(Contacts {
            largest: grains.largest(),
            grains,
            log: model.break_log(),
            seen: 0,
            pairs: Pairs::Whole(Box::new(PairList::new(body, law.skin * body.mean_radius()))),
            touching: Touching::new(law),
        }))
    }
}

impl EffectSpec<f64> for Contact {
    fn attach(mut self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
        let effect = format!("contact on '{}'", host.model.name());
        let Contacts {
            grains,
            pairs,
            largest,
            ..
        } = &mut self.0;
        let owned = host.owned()?;
        if let (true, Pairs::Whole(list)) = (owned.is_part(), &*pairs) {
            grains.restrict(&owned, &effect)?;
            *pairs = Pairs::Part(Box::new(GatheredPairs::new(list, &owned, *largest)));
        }
        grains.attach(host, &effect)?;
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

    fn saves_whole(&self) -> bool {
        true
    }

    fn save(&self) -> Record<f64> {
        let mut out = Record::default();
        out.integers.push(self.seen as u64);
        match &self.pairs {
            Pairs::Whole(list) => {
                self.touching.save(&mut out);
                list.save(&mut out);
            }
            // The run reports an error between ranks; other ranks than the first save nothing.
            Pairs::Part(part) => match part.save(&self.touching, &mut out) {
                Ok(true) => {}
                Ok(false) | Err(_) => return Record::default(),
            },
        }
        out
    }

    fn restore(&mut self, from: &Record<f64>) -> arlequin_core::Result<()> {
        let (touching, pairs) = (&mut self.touching, &mut self.pairs);
        let count = match pairs {
            Pairs::Whole(_) => self.grains.len(),
            Pairs::Part(part) => part.particles(),
        };
        let fits = from.integers.split_first().and_then(|(seen, integers)| {
            self.seen = *seen as usize;
            let (integers, numbers) = touching.restore(integers, &from.numbers)?;
            match pairs {
                Pairs::Whole(list) => {
                    list.restore(count, integers, numbers)?;
                    touching.find(&list.listed)
                }
                Pairs::Part(part) => part.restore(touching, integers, numbers),
            }
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
        self.touching.facts(match &self.pairs {
            Pairs::Whole(list) => list.listed.counts(),
            Pairs::Part(part) => part.counts(),
        })
    }
}

impl Effect<f64> for Contacts {
    fn add_forces(&mut self, instant: &Instant<'_, f64>, f: &mut [f64]) -> arlequin_core::Result<()> {
        let (grains, touching) = (&mut self.grains, &mut self.touching);
        // Breaks of all ranks since the last step.
        let log = locked(&self.log);
        let breaks = &log.events()[self.seen..];
        self.seen = log.events().len();
        match &mut self.pairs {
            Pairs::Whole(list) => {
                // Budgets refer to places in the list: settle them before a search reorders it.
                touching.settle(&mut list.listed, from_ref(instant));
                for event in breaks {
                    list.add_broken(event, &grains.rest_spheres);
                }
                let listed = &mut list.listed;
                if !listed.follow(from_mut(grains), &[instant.q]) {
                    grains.place(instant.q);
                    list.refresh(&grains.now, &grains.rest_spheres, &log);
                    list.listed.measure(from_ref(grains), &[instant.q]);
                }
                drop(log);
                touching.respond(&mut list.listed, from_mut(grains), from_ref(instant), &mut [f])?;
            }
            Pairs::Part(part) => {
                grains.place(instant.q);
                let pushing = part.gather_pushing(breaks, grains, &log)?;
                drop(log);
                part.respond(&pushing, touching, grains, instant, f)?;
            }
        }
        Ok(())
    }

    /// Power on the owned particles \[W\].
    fn power(&self, v: &[f64]) -> f64 {
        let local = |i: usize| self.pairs.local(i);
        let ends = self.touching.end_forces(&local);
        ends.map(|(i, force, torque)| power(v, i, &force, &torque)).sum()
    }

    fn add_power(&self, _: &DofLayout, v: &[f64], sum: &mut Exact) -> bool {
        self.touching.add_power(v, &|i| self.pairs.local(i), sum);
        true
    }

    fn add_contact(&self, f: &mut [f64]) -> bool {
        let local = |i: usize| self.pairs.local(i);
        for (i, force, torque) in self.touching.end_forces(&local) {
            add(f, i, &force, &torque);
        }
        true
    }

    fn reweigh(&mut self, host: &Host<'_, f64>) -> arlequin_core::Result<()> {
        let (effect, before) = (
            format!("contact on '{}'", host.model.name()),
            self.grains.shares(),
        );
        self.grains.attach(host, &effect)?;
        if let Pairs::Whole(list) = &mut self.pairs {
            let grains = from_ref(&self.grains);
            self.touching.weaken(&mut list.listed, grains, [&before; 2]);
        }
        Ok(())
    }

    fn step_demand(&self) -> StepDemand<f64> {
        let top = self.grains.top(|r| self.touching.stiffness([r, self.largest]));
        self.touching.demand(top)
    }
}

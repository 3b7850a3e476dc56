//! The force kernel of a body, made when forces are first asked for.
//!
//! It is what takes most memory of a body, and a body that is only weighed and shared out needs none.

use super::forces::{BondForces, Gather, Reached};
use crate::kernel::law::{Finite, Linear};
use crate::particles::BondedParticles;
use arlequin_core::ranks::Halo;

/// Which law, and the kernel once it is there.
#[derive(Debug)]
pub(super) struct Kernel {
    finite: bool,
    made: Option<Box<dyn BondForces>>,
}

impl Kernel {
    /// Of small or of finite rotations; nothing has turned yet.
    pub(super) fn new(finite: bool) -> Self {
        Self { finite, made: None }
    }

    /// The same law for whatever the body has become; nothing has turned yet.
    pub(super) fn renew(&mut self) {
        self.made = None;
    }

    /// Whether rotations may be large.
    pub(super) fn is_finite(&self) -> bool {
        self.finite
    }

    /// The kernel of a body, or of the part of one whose last particles are those of other ranks.
    pub(super) fn of(&mut self, body: &BondedParticles, halo: Option<&Halo>) -> &mut dyn BondForces {
        let finite = self.finite;
        let make = || -> Box<dyn BondForces> {
            match finite {
                true => Box::new(Gather::<Finite>::of(body, halo.cloned())),
                false => Box::new(Gather::<Linear>::of(body, halo.cloned())),
            }
        };
        &mut **self.made.get_or_insert_with(make)
    }

    /// What was reached last, under a law that turns.
    pub(super) fn reached(&self) -> Option<Reached<'_>> {
        match &self.made {
            Some(kernel) => kernel.reached(),
            None => self.finite.then(Reached::upright),
        }
    }

    /// What readers know of the particles of other ranks, at the positions reached last.
    pub(super) fn ghosts(&self, out: &mut Vec<[f64; 7]>) {
        out.clear();
        self.made.iter().for_each(|kernel| kernel.ghosts(out));
    }

    /// Quaternions (scalar first) and rotation unknowns of what was reached last by so many particles,
    /// under a law that turns.
    pub(super) fn save(&self, particles: usize) -> Vec<f64> {
        match &self.made {
            Some(kernel) => kernel.save(),
            None if self.finite => [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].repeat(particles),
            None => Vec::new(),
        }
    }
}

//! The force kernel of a body, built when forces are first asked for.
//!
//! The kernel takes most of the memory of a body. A body that is only weighed and partitioned does without
//! it.

use super::forces::{BondForces, Gather, Orientations};
use crate::kernel::law::{Finite, Linear};
use crate::particles::BondedParticles;
use arlequin_core::ranks::Halo;

/// The law of a body, and its kernel once it is built.
#[derive(Debug)]
pub(super) struct Kernel {
    finite: bool,
    built: Option<Box<dyn BondForces>>,
}

impl Kernel {
    /// Returns a kernel that is not yet built, for finite or small rotations, with orientations at rest.
    pub(super) fn new(finite: bool) -> Self {
        Self { finite, built: None }
    }

    /// Discards the built kernel, because the body has changed; orientations are reset to rest.
    pub(super) fn renew(&mut self) {
        self.built = None;
    }

    /// Returns whether rotations may be large.
    pub(super) fn is_finite(&self) -> bool {
        self.finite
    }

    /// Returns the kernel, built at the first call. In a rank's part of a partitioned body, `halo` tells
    /// which of the last particles of `body` are ghosts.
    pub(super) fn get_or_build(
        &mut self,
        body: &BondedParticles,
        halo: Option<&Halo>,
    ) -> &mut dyn BondForces {
        let finite = self.finite;
        let make = || -> Box<dyn BondForces> {
            match finite {
                true => Box::new(Gather::<Finite>::with_halo(body, halo.cloned())),
                false => Box::new(Gather::<Linear>::with_halo(body, halo.cloned())),
            }
        };
        &mut **self.built.get_or_insert_with(make)
    }

    /// Returns the orientations reached last under the finite-rotation law, `None` under the small one.
    pub(super) fn orientations(&self) -> Option<Orientations<'_>> {
        match &self.built {
            Some(kernel) => kernel.orientations(),
            None => self.finite.then(Orientations::upright),
        }
    }

    /// Writes the states of the ghosts at the positions reached last, as a [`super::poses::Reader`] takes
    /// them.
    pub(super) fn ghosts(&self, out: &mut Vec<[f64; 7]>) {
        out.clear();
        self.built.iter().for_each(|kernel| kernel.ghosts(out));
    }

    /// Returns quaternions (scalar first) and rotation unknowns reached last, seven numbers per particle;
    /// nothing under the small-rotation law.
    pub(super) fn save(&self, particles: usize) -> Vec<f64> {
        match &self.built {
            Some(kernel) => kernel.save(),
            None if self.finite => [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].repeat(particles),
            None => Vec::new(),
        }
    }
}

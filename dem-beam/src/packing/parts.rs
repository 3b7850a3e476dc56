//! Bodies, connected parts, loose spheres and cuts of a packing, and the volume that each sphere stands for.
//!
//! A body is the inside of one closed outer shell. A surface may hold several bodies; every other container
//! is one. The volume of a body is shared by its own spheres in proportion to `r^3`, so that mass never moves
//! from one body to another. Within a body every connected set of at least four spheres is a part. It stays,
//! with the volume of its own spheres. Spheres in smaller sets are loose: a few spheres of a jammed packing
//! have no bond (0.1 % at 6.2 bonds per sphere). They are left out and the rest of their body takes their
//! volume ([`super::Loose::Drop`], bounded), or they stay as grains ([`super::Loose::Keep`]).

use super::around::Around;
use super::assemble::Packing;
use super::bonding::{Components, renumber};
use super::container::Container;
use super::report::Cut;
use super::surface::Surface;
use crate::error::{Error, Result};
use nalgebra::Vector3;

/// A connected part of a packing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Number of its body, from 0.
    pub body: usize,
    /// Number of its spheres.
    pub spheres: usize,
    /// Volume that its spheres stand for \[m³\]; its mass is this volume times the density.
    pub volume: f64,
}

impl Packing {
    /// Returns the volume that each sphere stands for \[m³\]: its share of the volume of its body, by `r^3`.
    #[must_use]
    pub fn volumes(&self) -> Vec<f64> {
        let mut cubes = vec![0.0; self.body_volumes.len()];
        let spheres = || self.radii.iter().zip(&self.bodies);
        for (r, &b) in spheres() {
            if let Some(c) = cubes.get_mut(b as usize) {
                *c += r * r * r;
            }
        }
        let volume = |(r, &b): (&f64, &u32)| {
            let body_volume = self.body_volumes.get(b as usize).copied().unwrap_or_default();
            let body_cubes = cubes.get(b as usize).copied().unwrap_or(1.0);
            body_volume * r * r * r / body_cubes
        };
        spheres().map(volume).collect()
    }

    /// Returns the connected parts, in the order of their smallest sphere numbers. Loose spheres belong to no
    /// part.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let volumes = self.volumes();
        let components = Components::new(self.radii.len(), &self.pairs);
        let mut place = vec![usize::MAX; self.radii.len()];
        let mut out: Vec<Part> = Vec::new();
        for i in (0..self.radii.len() as u32).filter(|&i| components.is_part(i)) {
            let index = &mut place[components.root(i) as usize];
            if *index == usize::MAX {
                *index = out.len();
                out.push(Part {
                    body: self.bodies[i as usize] as usize,
                    spheres: 0,
                    volume: 0.0,
                });
            }
            out[*index].spheres += 1;
            out[*index].volume += volumes[i as usize];
        }
        out
    }

    /// Returns the number of spheres in no connected part; zero unless [`super::Loose::Keep`] is set.
    #[must_use]
    pub fn grains(&self) -> usize {
        self.radii.len() - self.parts().iter().map(|p| p.spheres).sum::<usize>()
    }

    /// Refuses a packing of several parts or with loose spheres, for a test called `what`.
    ///
    /// # Errors
    /// [`Error::SeveralParts`].
    pub fn connected(&self, what: &'static str) -> Result<()> {
        let parts = Components::new(self.radii.len(), &self.pairs).parts();
        let loose = self.radii.len() - parts.iter().sum::<usize>();
        match (parts.len(), loose) {
            (1, 0) => Ok(()),
            _ => Err(Error::SeveralParts { what, parts, loose }),
        }
    }

    /// Removes the bonds for which `cuts` returns true; it is given the two centres \[m\]. Spheres that are
    /// then in no connected part are removed too, with the volume that they stand for. Returns what this cut
    /// removed; [`super::PackingReport`] has the sum of all cuts.
    pub fn cut(&mut self, cuts: impl Fn(&Vector3<f64>, &Vector3<f64>) -> bool) -> Cut {
        let count = self.radii.len();
        let before = Components::new(count, &self.pairs);
        let bonds = self.pairs.len();
        let x = &self.positions;
        self.pairs.retain(|p| !cuts(&x[p[0] as usize], &x[p[1] as usize]));
        let mut removed = Cut {
            bonds: bonds - self.pairs.len(),
            ..Cut::default()
        };
        let after = Components::new(count, &self.pairs);
        // The cut does not remove grains that were loose before.
        let stays = |i: &u32| after.is_part(*i) || !before.is_part(*i);
        let retained: Vec<u32> = (0..count as u32).filter(stays).collect();
        if retained.len() < count {
            let volumes = self.volumes();
            for i in (0..count as u32).filter(|i| !stays(i)).map(|i| i as usize) {
                self.body_volumes[self.bodies[i] as usize] -= volumes[i];
                removed.volume += volumes[i];
            }
            removed.spheres = count - retained.len();
            self.retain(&retained);
        }
        let cut = &mut self.report.cut;
        cut.bonds += removed.bonds;
        cut.spheres += removed.spheres;
        cut.volume += removed.volume;
        self.report.coordination_retained = 2.0 * self.pairs.len() as f64 / self.radii.len() as f64;
        removed
    }

    /// Leaves out the spheres of all connected parts but the largest if they are at most the share `limit` of
    /// the spheres; the others of their body take over their volume. Returns the number left out.
    pub fn keep_largest_part(&mut self, limit: f64) -> usize {
        let count = self.radii.len();
        let components = Components::new(count, &self.pairs);
        let retained: Vec<u32> = (0..count as u32).filter(|i| components.is_largest(*i)).collect();
        let left_out = count - retained.len();
        if left_out == 0 || left_out as f64 > limit * count as f64 {
            return 0;
        }
        self.retain(&retained);
        self.report.dropped += left_out;
        self.report.coordination_retained = 2.0 * self.pairs.len() as f64 / self.radii.len() as f64;
        left_out
    }

    /// Keeps only the spheres with the numbers `retained` (ascending).
    pub(crate) fn retain(&mut self, retained: &[u32]) {
        renumber(&mut self.pairs, retained, self.radii.len());
        self.positions = retained.iter().map(|&i| self.positions[i as usize]).collect();
        self.radii = retained.iter().map(|&i| self.radii[i as usize]).collect();
        self.bodies = retained.iter().map(|&i| self.bodies[i as usize]).collect();
        self.report.mean_radius = self.radii.iter().sum::<f64>() / self.radii.len() as f64;
    }

    /// Restricts a packing of a part and its margin to the part, whose volume it then stands for.
    ///
    /// # Errors
    /// [`Error::EmptyBody`] if a body of the part holds no sphere.
    pub(super) fn restrict(mut self, around: &Around) -> Result<Self> {
        let bodies = around.part().bodies();
        let home = |x: &Vector3<f64>| bodies.iter().position(|b| b.contains(x));
        let homes: Vec<Option<usize>> = self.positions.iter().map(home).collect();
        let mut inner_pairs = self.pairs.clone();
        inner_pairs.retain(|p| p.iter().all(|&i| homes[i as usize].is_some()));
        let components = Components::new(homes.len(), &inner_pairs);
        let stays = |i: &u32| homes[*i as usize].is_some() && (self.loose || components.is_part(*i));
        let retained: Vec<u32> = (0..homes.len() as u32).filter(stays).collect();
        let has_sphere = |k: usize| retained.iter().any(|&i| homes[i as usize] == Some(k));
        if let Some(k) = (0..bodies.len()).find(|k| !has_sphere(*k)) {
            let containers: Vec<Container> = bodies.into_iter().map(Container::Surface).collect();
            return Err(Error::EmptyBody.in_body(k, &containers));
        }
        self.retain(&retained);
        self.bodies = retained
            .iter()
            .filter_map(|&i| homes[i as usize].map(|k| k as u32))
            .collect();
        self.body_volumes = bodies.iter().map(Surface::volume).collect();
        self.volume = around.part().volume();
        let report = &mut self.report;
        report.beyond = homes.len() - retained.len();
        report.bodies = bodies.len();
        report.coordination_retained = 2.0 * self.pairs.len() as f64 / retained.len() as f64;
        Ok(self)
    }
}

impl Error {
    /// Returns the error with the number of its body, `k` from 0, if there are several bodies.
    pub(crate) fn in_body(self, k: usize, bodies: &[Container]) -> Self {
        match bodies.len() {
            1 => self,
            count => Self::InBody {
                body: k + 1,
                bodies: count,
                volume: bodies[k].volume(),
                source: Box::new(self),
            },
        }
    }
}

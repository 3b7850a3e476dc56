//! What a packing consists of: bodies, connected parts, loose spheres, cuts; and the volume each sphere
//! stands for.
//!
//! A body is what one closed outer shell holds (a surface may have several; every other container is one).
//! Its volume is spread over its own spheres in proportion to `r^3`, so that mass never moves from one body
//! to another. Within a body every connected set of at least four spheres is a part and stays, with the
//! volume of its own spheres. Spheres in smaller sets are loose: a few of a jammed packing have no bond
//! (0.1 % at 6.2 bonds per sphere). They are left out and their volume is spread over the rest of their
//! body ([`Loose::Drop`], bounded), or they stay as grains ([`Loose::Keep`]).

use super::assemble::Packing;
use super::bonding::{Components, renumber};
use super::container::Container;
use crate::error::{Error, Result};
use nalgebra::Vector3;

/// Largest share of the volume that loose spheres may have to be left out: ten times what jammed packings
/// leave without a bond at 6.2 bonds per sphere.
pub const LOOSE_LIMIT: f64 = 0.02;

/// What becomes of spheres that hang on no part of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loose {
    /// They are left out, the others of their body take over their mass; an error above a share of the
    /// volume.
    Drop {
        /// Largest accepted share, [`LOOSE_LIMIT`] by default.
        limit: f64,
    },
    /// They stay as loose grains with the mass of their own volume. Without contact they pass through
    /// everything.
    Keep,
}

impl Default for Loose {
    fn default() -> Self {
        Self::Drop { limit: LOOSE_LIMIT }
    }
}

/// A connected part of a packing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Body it belongs to, from 0.
    pub body: usize,
    /// Its spheres.
    pub spheres: usize,
    /// Volume they stand for \[m³\]: its mass is this times the density.
    pub volume: f64,
}

/// What cuts took away, all together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cut {
    /// Bonds.
    pub bonds: usize,
    /// Spheres that the cuts left without a bond to a part; they are gone, with their mass.
    pub spheres: usize,
    /// Volume these stood for \[m³\].
    pub volume: f64,
}

impl Packing {
    /// Volume each sphere stands for \[m³\]: that of its body by `r^3`.
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
            let whole = self.body_volumes.get(b as usize).copied().unwrap_or_default();
            let all = cubes.get(b as usize).copied().unwrap_or(1.0);
            whole * r * r * r / all
        };
        spheres().map(volume).collect()
    }

    /// Connected parts, by the smallest number of their spheres; loose spheres belong to none.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let volumes = self.volumes();
        let components = Components::new(self.radii.len(), &self.pairs);
        let mut place = vec![usize::MAX; self.radii.len()];
        let mut out: Vec<Part> = Vec::new();
        for i in (0..self.radii.len() as u32).filter(|&i| components.is_part(i)) {
            let at = &mut place[components.root(i) as usize];
            if *at == usize::MAX {
                *at = out.len();
                out.push(Part {
                    body: self.bodies[i as usize] as usize,
                    spheres: 0,
                    volume: 0.0,
                });
            }
            out[*at].spheres += 1;
            out[*at].volume += volumes[i as usize];
        }
        out
    }

    /// Number of spheres that hang on no part; none unless [`Loose::Keep`] was asked for.
    #[must_use]
    pub fn grains(&self) -> usize {
        self.radii.len() - self.parts().iter().map(|p| p.spheres).sum::<usize>()
    }

    /// Refuses a packing of several parts or with loose spheres, for a test of `what`.
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

    /// Takes away the bonds for which `cuts` holds, between the centres it is given \[m\], and the spheres
    /// that hang on no part without them, with the volume they stand for. Returns what this cut took;
    /// [`super::PackingReport`] adds up all.
    pub fn cut(&mut self, cuts: impl Fn(&Vector3<f64>, &Vector3<f64>) -> bool) -> Cut {
        let count = self.radii.len();
        let before = Components::new(count, &self.pairs);
        let bonds = self.pairs.len();
        let x = &self.positions;
        self.pairs.retain(|p| !cuts(&x[p[0] as usize], &x[p[1] as usize]));
        let mut done = Cut {
            bonds: bonds - self.pairs.len(),
            ..Cut::default()
        };
        let after = Components::new(count, &self.pairs);
        // Grains that were loose before are none of the cut's.
        let stays = |i: &u32| after.is_part(*i) || !before.is_part(*i);
        let kept: Vec<u32> = (0..count as u32).filter(stays).collect();
        if kept.len() < count {
            let volumes = self.volumes();
            for i in (0..count as u32).filter(|i| !stays(i)).map(|i| i as usize) {
                self.body_volumes[self.bodies[i] as usize] -= volumes[i];
                done.volume += volumes[i];
            }
            done.spheres = count - kept.len();
            self.retain(&kept);
        }
        let cut = &mut self.report.cut;
        cut.bonds += done.bonds;
        cut.spheres += done.spheres;
        cut.volume += done.volume;
        self.report.coordination_retained = 2.0 * self.pairs.len() as f64 / self.radii.len() as f64;
        done
    }

    /// Keeps the spheres of these numbers (ascending).
    pub(crate) fn retain(&mut self, kept: &[u32]) {
        renumber(&mut self.pairs, kept, self.radii.len());
        self.positions = kept.iter().map(|&i| self.positions[i as usize]).collect();
        self.radii = kept.iter().map(|&i| self.radii[i as usize]).collect();
        self.bodies = kept.iter().map(|&i| self.bodies[i as usize]).collect();
        self.report.mean_radius = self.radii.iter().sum::<f64>() / self.radii.len() as f64;
    }
}

/// Sizes of parts in words, the first few by number.
pub(crate) fn sizes(parts: &[usize]) -> String {
    const NAMED: usize = 6;
    let named: Vec<String> = parts.iter().take(NAMED).map(ToString::to_string).collect();
    let more = if parts.len() > NAMED { ", ..." } else { "" };
    let word = if parts.len() == 1 { "part" } else { "parts" };
    format!("{} {word} of {}{more} spheres", parts.len(), named.join(", "))
}

impl Error {
    /// The error of the `k`-th of several bodies, from 0; of the only one as it is.
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

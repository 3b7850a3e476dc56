//! A packing, assembled from the spheres of its bodies.

use super::bonding::{Bonding, renumber};
use super::cells::{Sphere, centre};
use super::container::Container;
use super::report::{Making, PackingReport};
use crate::bond::BeamMaterial;
use crate::error::{Error, Result};
use crate::particles::BondedParticles;
use nalgebra::Vector3;

/// Spheres and bonds of a packing. [`super::parts`] explains which spheres stay and the mass of each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Packing {
    /// Centres \[m\].
    pub positions: Vec<Vector3<f64>>,
    /// Radii \[m\].
    pub radii: Vec<f64>,
    /// Bonded pairs, smaller number first, in ascending order.
    pub pairs: Vec<[u32; 2]>,
    /// Number of the body that each sphere lies in, from 0.
    pub bodies: Vec<u32>,
    /// Volume of each body \[m³\], without the volume that cuts removed; its spheres stand for it.
    pub body_volumes: Vec<f64>,
    /// True if loose spheres stayed ([`super::Loose::Keep`]).
    pub loose: bool,
    /// Volume of the container \[m³\], which its spheres stand for before cuts.
    pub volume: f64,
    /// Edges of the periodic box \[m\] that the centres lie in; `None` for a packing with walls.
    pub period: Option<[f64; 3]>,
    /// Facts about the packing.
    pub report: PackingReport,
}

/// Spheres and bonds of one body.
#[derive(Debug)]
pub(crate) struct Filled {
    /// Number of each sphere in a file; empty for spheres numbered after those of the body before.
    pub(crate) numbers: Vec<u32>,
    pub(crate) spheres: Vec<Sphere>,
    pub(crate) bonding: Bonding,
    /// Mean overlap over the mean diameter.
    pub(crate) overlap: f64,
    /// Number of relaxation steps.
    pub(crate) steps: usize,
}

impl Packing {
    /// Assembles the bodies of a container with their spheres; `asked` is the number of spheres wanted in
    /// all.
    ///
    /// # Errors
    /// [`Error::CrossingBodies`].
    pub(crate) fn assemble(
        container: &Container,
        bodies: &[Container],
        filled: &[Filled],
        asked: usize,
        loose: bool,
    ) -> Result<Self> {
        refuse_crossing(bodies, filled)?;
        let count = filled.iter().map(|f| f.spheres.len()).sum::<usize>();
        let mut spheres = vec![[0.0; 4]; count];
        let mut body = vec![0_u32; count];
        let mut bonding = Bonding {
            retained: Vec::with_capacity(count),
            pairs: Vec::new(),
            tolerance: f64::NEG_INFINITY,
            coordination_all: 0.0,
        };
        let (mut overlap, mut steps, mut first) = (0.0, 0, 0);
        for (k, f) in filled.iter().enumerate() {
            let number = |i: u32| f.numbers.get(i as usize).copied().unwrap_or(first + i);
            let share = f.spheres.len() as f64 / count as f64;
            let retained = f.bonding.retained.iter().copied();
            for i in 0..f.spheres.len() as u32 {
                let place = number(i) as usize;
                spheres[place] = f.spheres[i as usize];
                body[place] = k as u32;
            }
            bonding.retained.extend(retained.map(number));
            let renumbered = |p: &[u32; 2]| p.map(|i| number(f.bonding.retained[i as usize]));
            bonding.pairs.extend(f.bonding.pairs.iter().map(renumbered));
            // The report has the largest gap of all bodies, and means over their spheres.
            bonding.tolerance = bonding.tolerance.max(f.bonding.tolerance);
            bonding.coordination_all += share * f.bonding.coordination_all;
            overlap += share * f.overlap;
            steps += f.steps;
            first += f.spheres.len() as u32;
        }
        bonding.retained.sort_unstable();
        renumber(&mut bonding.pairs, &bonding.retained, count);
        bonding.pairs.sort_unstable();
        let making = Making {
            asked,
            steps,
            overlap,
        };
        let report = PackingReport::new(container, bodies, &spheres, &body, &bonding, making);
        let retained = || bonding.retained.iter().map(|&i| i as usize);
        Ok(Self {
            positions: retained().map(|i| centre(&spheres[i])).collect(),
            radii: retained().map(|i| spheres[i][3]).collect(),
            bodies: retained().map(|i| body[i]).collect(),
            body_volumes: bodies.iter().map(Container::volume).collect(),
            pairs: bonding.pairs,
            loose,
            volume: container.volume(),
            period: container.period(),
            report,
        })
    }

    /// Joins the spheres by beams. The mass of a sphere is `density` \[kg/m³\] times the volume that it
    /// stands for.
    ///
    /// # Errors
    /// Errors of [`BondedParticles::new`], except for loose spheres that were kept; [`Error::Periodic`].
    pub fn bonded(&self, beam: BeamMaterial, density: f64) -> Result<BondedParticles> {
        if self.period.is_some() {
            return Err(Error::Periodic {
                what: "a body of particles",
            });
        }
        BondedParticles::from_packing(self, beam, density)
    }
}

/// Refuses bodies that overlap, if a sphere of one has its centre inside another. Overlaps thinner than a
/// radius are not detected.
fn refuse_crossing(bodies: &[Container], filled: &[Filled]) -> Result<()> {
    for (k, f) in filled.iter().enumerate() {
        for (o, other) in bodies.iter().enumerate().filter(|(o, _)| *o != k) {
            let (low, high) = other.bounds();
            let is_inside = |s: &&Sphere| {
                let x = centre(s);
                (0..3).all(|a| x[a] > low[a] && x[a] < high[a]) && other.contains(&x)
            };
            if let Some(s) = f.spheres.iter().find(is_inside) {
                return Err(Error::CrossingBodies {
                    first: k.min(o) + 1,
                    second: k.max(o) + 1,
                    point: [s[0], s[1], s[2]],
                });
            }
        }
    }
    Ok(())
}

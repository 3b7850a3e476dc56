//! Particles joined by beams: the flat arrays every solver of this crate reads.
//!
//! Masses: `m_i = rho V r_i^3 / sum r^3` for a body of volume `V` (the spheres fill only part of it, so
//! sphere volume times density would be far too light), for each body of a packing with several on its own
//! ([`crate::packing::parts`]), and `I_i = 2/5 m_i r_i^2`. Weights follow the energy-consistent rule: bond
//! b carries the factor `w_b`, and the mass and inertia of a particle are multiplied by the mean of `w`
//! over its bonds. Then the weighted critical step is never below the smallest one of the single weighted
//! bonds.

mod check;

pub(crate) use check::{check_spheres, expect_len, longest};

use crate::bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
use crate::error::{Error, Result, finite, positive};
use crate::kernel::span::Grid;
use crate::packing::Packing;
use crate::packing::cells::image;
use arlequin_core::adjacency::Adjacency;
use check::make_bond;
use nalgebra::Vector3;
use std::sync::{Arc, OnceLock};

/// Largest ratio of radii accepted (the neighbour search and the beam law lose their meaning).
pub const MAX_RADIUS_RATIO: f64 = 20.0;

/// Closest two centres may be, as a fraction of the sum of their radii.
pub(crate) const COINCIDENT: f64 = 1e-9;

/// Spheres, their bonds, stiffness and masses. Reference configuration; SI units.
#[derive(Debug, Clone)]
pub struct BondedParticles {
    positions: Vec<Vector3<f64>>,
    radii: Vec<f64>,
    pairs: Vec<[u32; 2]>,
    /// [`LinearBond::scale`] of every bond; its axis follows from the centres, at a fraction of the memory.
    scales: Vec<f64>,
    weights: Vec<f64>,
    /// Stiffness of every bond over that of a beam of the packing's material; empty where all are alike.
    grades: Vec<f64>,
    full_mass: Vec<f64>,
    mass: Vec<f64>,
    inertia: Vec<f64>,
    rigidity: BeamRigidity,
    mean_radius: f64,
    grid: Grid,
    /// Whether centres and stiffnesses are those that the kernel sees.
    rounded: bool,
    /// Edges of the periodic box \[m\].
    period: Option<[f64; 3]>,
    adjacency: OnceLock<Arc<Adjacency<[u32; 2]>>>,
}

/// What has to be known besides geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// Beams.
    pub beam: BeamMaterial,
    /// Mass density of the body \[kg/m³\].
    pub density: f64,
    /// Volume of the body the particles stand for \[m³\]; their masses sum to `density * volume`.
    pub volume: f64,
}

/// What spheres have besides centres, radii and bonds.
#[derive(Debug)]
pub(crate) struct Contents<'a> {
    /// Volume each stands for \[m³\].
    pub(crate) volumes: &'a [f64],
    /// Whether some may have no bond.
    pub(crate) loose: bool,
    /// Edges of the periodic box \[m\].
    pub(crate) period: Option<[f64; 3]>,
    /// Whether centres move to the kernel's grid and stiffnesses to its 24 bits, so that all of a model is
    /// one law.
    pub(crate) rounded: bool,
    /// Of a part: what only the whole body knows.
    pub(crate) whole: Option<Extents>,
}

/// What all particles of a body have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extents {
    /// Mean radius \[m\].
    pub(crate) mean_radius: f64,
    /// Longest component of a bond \[m\].
    pub(crate) longest: f64,
}

impl BondedParticles {
    /// Joins spheres at `positions` \[m\] with radii `radii` \[m\] by beams between `pairs`.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::NotFinite`], [`Error::BadRadius`],
    /// [`Error::RadiusRatio`], [`Error::NoSuchParticle`], [`Error::ZeroLengthBond`],
    /// [`Error::CoincidentParticles`], [`Error::IsolatedParticle`] and
    /// [`Error::OutOfRange`] for the matter.
    pub fn new(
        positions: Vec<Vector3<f64>>,
        radii: Vec<f64>,
        pairs: Vec<[u32; 2]>,
        matter: &Matter,
    ) -> Result<Self> {
        Self::with_period(positions, radii, pairs, matter, None)
    }

    /// As [`Self::new`]; with a period, each beam joins the first particle to the nearest image of the
    /// second.
    pub(crate) fn with_period(
        positions: Vec<Vector3<f64>>,
        radii: Vec<f64>,
        pairs: Vec<[u32; 2]>,
        matter: &Matter,
        period: Option<[f64; 3]>,
    ) -> Result<Self> {
        positive("body volume", matter.volume)?;
        check_spheres(&positions, &radii)?;
        let cubes: f64 = radii.iter().map(|r| r * r * r).sum();
        let volumes: Vec<f64> = radii.iter().map(|r| matter.volume * r * r * r / cubes).collect();
        let contents = Contents {
            volumes: &volumes,
            loose: false,
            period,
            rounded: false,
            whole: None,
        };
        Self::with_volumes(positions, radii, pairs, matter.density, matter.beam, &contents)
    }

    /// A packing with the volumes and loose spheres it has.
    pub(crate) fn of_packing(packing: &Packing, beam: BeamMaterial, density: f64) -> Result<Self> {
        let (x, r, pairs) = (&packing.positions, &packing.radii, &packing.pairs);
        check_spheres(x, r)?;
        let volumes = packing.volumes();
        let contents = Contents {
            volumes: &volumes,
            loose: packing.loose,
            period: packing.period,
            // Images of a periodic box lie off any grid; no model is made of one.
            rounded: packing.period.is_none(),
            whole: None,
        };
        Self::with_volumes(x.clone(), r.clone(), pairs.clone(), density, beam, &contents)
    }

    /// Spheres that were checked, with the volume each stands for.
    pub(crate) fn with_volumes(
        mut positions: Vec<Vector3<f64>>,
        radii: Vec<f64>,
        pairs: Vec<[u32; 2]>,
        density: f64,
        beam: BeamMaterial,
        contents: &Contents<'_>,
    ) -> Result<Self> {
        positive("density", density)?;
        expect_len("volumes", contents.volumes.len(), positions.len())?;
        for v in contents.volumes {
            positive("volume of a particle", *v)?;
        }
        let here = || radii.iter().sum::<f64>() / radii.len() as f64;
        let mean = contents.whole.map_or_else(here, |w| w.mean_radius);
        let rigidity = beam.rigidity(mean)?;
        let mut degree = vec![0_u32; positions.len()];
        let mut scales = Vec::with_capacity(pairs.len());
        let mut longest = 0.0_f64;
        for (b, &[i, j]) in pairs.iter().enumerate() {
            let bond = make_bond(b, [i, j], &positions, &radii, contents.period)?;
            longest = longest.max(bond.span().amax());
            scales.push(bond.scale);
            degree[i as usize] += 1;
            degree[j as usize] += 1;
        }
        let grid = Grid::for_bonds(contents.whole.map_or(longest, |w| w.longest));
        if contents.rounded {
            positions.iter_mut().for_each(|x| *x = grid.snap(x));
            for (b, (scale, pair)) in scales.iter_mut().zip(&pairs).enumerate() {
                let bond = make_bond(b, *pair, &positions, &radii, contents.period)?;
                *scale = grid.rounded(&bond).scale;
            }
        }
        if let Some(particle) = degree.iter().position(|&d| d == 0 && !contents.loose) {
            let isolated = degree.iter().filter(|&&d| d == 0).count();
            return Err(Error::IsolatedParticle { particle, isolated });
        }
        let full_mass: Vec<f64> = contents.volumes.iter().map(|v| density * v).collect();
        let inertia = sphere_inertia(&full_mass, &radii);
        Ok(Self {
            weights: vec![1.0; pairs.len()],
            grades: Vec::new(),
            mass: full_mass.clone(),
            positions,
            radii,
            pairs,
            scales,
            full_mass,
            inertia,
            rigidity,
            mean_radius: mean,
            grid,
            rounded: contents.rounded,
            period: contents.period,
            adjacency: OnceLock::new(),
        })
    }

    /// Replaces all bond weights (1 everywhere at the start); masses and inertias follow.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] and [`Error::NotFinite`]; [`Error::OutOfRange`] for a
    /// negative weight.
    pub fn set_weights(&mut self, weights: &[f64]) -> Result<()> {
        expect_len("bond weights", weights.len(), self.pairs.len())?;
        for (b, &w) in weights.iter().enumerate() {
            finite("weight", "bond", b, w)?;
            if w < 0.0 {
                return Err(Error::out_of_range("bond weight", w, "values >= 0"));
            }
        }
        for (b, &w) in weights.iter().enumerate() {
            let grade = self.grades.get(b).copied().unwrap_or(1.0);
            let mut bond = self.bond(b);
            bond.scale = w * grade / bond.axis.norm();
            if self.rounded {
                bond = self.grid.rounded(&bond);
            }
            self.scales[b] = bond.scale;
        }
        self.weights.copy_from_slice(weights);
        for (i, w) in self.mean_over_bonds(weights, |_| 1.0).into_iter().enumerate() {
            self.mass[i] = self.full_mass[i] * w;
        }
        self.inertia = sphere_inertia(&self.mass, &self.radii);
        Ok(())
    }

    /// Gives every particle its own stiffness and density, over those of the packing's material. A bond
    /// between two stiffnesses `a` and `b` is half of each in a row, `2 a b/(a + b)`.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`]; [`Error::OutOfRange`] unless all are positive.
    pub(crate) fn grade(&mut self, stiffness: &[f64], density: &[f64]) -> Result<()> {
        for (what, values) in [
            ("stiffnesses of particles", stiffness),
            ("densities of particles", density),
        ] {
            expect_len(what, values.len(), self.len())?;
            for v in values {
                positive(what, *v)?;
            }
        }
        let series = |&[i, j]: &[u32; 2]| {
            let [a, b] = [i, j].map(|k| stiffness[k as usize]);
            2.0 * a * b / (a + b)
        };
        self.grades = self.pairs.iter().map(series).collect();
        self.full_mass.iter_mut().zip(density).for_each(|(m, d)| *m *= d);
        let weights = std::mem::take(&mut self.weights);
        self.weights = vec![1.0; weights.len()];
        self.set_weights(&weights)
    }

    /// Whether bonds are of several materials.
    pub(crate) fn is_graded(&self) -> bool {
        !self.grades.is_empty()
    }

    /// Mean of bond values over the bonds of each particle; `alone` for a loose one without any.
    pub(crate) fn mean_over_bonds(&self, values: &[f64], alone: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut sum = vec![0.0; self.positions.len()];
        let mut degree = vec![0_u32; self.positions.len()];
        for (pair, w) in self.pairs.iter().zip(values) {
            for e in pair {
                sum[*e as usize] += w;
                degree[*e as usize] += 1;
            }
        }
        let mean = |(i, s): (usize, &f64)| match degree[i] {
            0 => alone(i),
            d => s / f64::from(d),
        };
        sum.iter().enumerate().map(mean).collect()
    }

    /// The particles `own` and then `ghosts`, with all bonds of the own ones in the order that they have
    /// here; and the numbers of these bonds here.
    pub(crate) fn part(&self, own: &[u32], ghosts: &[u32]) -> (Self, Vec<u32>) {
        let mut places = vec![u32::MAX; self.len()];
        for (k, i) in (0..).zip(own.iter().chain(ghosts)) {
            places[*i as usize] = k;
        }
        let held = |b: &usize| {
            let here = |i: u32| (places[i as usize] as usize) < own.len();
            self.pairs[*b].into_iter().any(here)
        };
        let bonds: Vec<usize> = (0..self.pairs.len()).filter(held).collect();
        let pairs: Vec<_> = bonds
            .iter()
            .map(|b| self.pairs[*b].map(|i| places[i as usize]))
            .collect();
        let particles = || own.iter().chain(ghosts).map(|i| *i as usize);
        // Bonds of a particle in the order they have in the whole: sums over them have its bits.
        let adjacency = OnceLock::from(Arc::new(Adjacency::of_pairs(own.len() + ghosts.len(), &pairs)));
        let grades = if self.is_graded() { &bonds[..] } else { &[] };
        let numbers = bonds.iter().map(|b| *b as u32).collect();
        let part = Self {
            positions: particles().map(|i| self.positions[i]).collect(),
            radii: particles().map(|i| self.radii[i]).collect(),
            pairs,
            weights: bonds.iter().map(|b| self.weights[*b]).collect(),
            grades: grades.iter().map(|b| self.grades[*b]).collect(),
            full_mass: particles().map(|i| self.full_mass[i]).collect(),
            mass: particles().map(|i| self.mass[i]).collect(),
            inertia: particles().map(|i| self.inertia[i]).collect(),
            rigidity: self.rigidity,
            mean_radius: self.mean_radius,
            grid: self.grid,
            rounded: self.rounded,
            period: self.period,
            adjacency,
            scales: bonds.iter().map(|b| self.scales[*b]).collect(),
        };
        (part, numbers)
    }

    /// Centres, radii and pairs; all else is given back.
    pub(crate) fn into_spheres(self) -> (Vec<Vector3<f64>>, Vec<f64>, Vec<[u32; 2]>) {
        (self.positions, self.radii, self.pairs)
    }

    /// The same, whose sums over the bonds of a particle go in the order of the pairs, as in [`Self::part`].
    pub(crate) fn in_order_of_pairs(mut self) -> Self {
        self.adjacency = OnceLock::from(Arc::new(Adjacency::of_pairs(self.len(), &self.pairs)));
        self
    }

    /// Takes the stiffness of a bond away; masses stay.
    pub(crate) fn sever(&mut self, bond: usize) {
        self.scales[bond] = 0.0;
    }

    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no particle (never, after [`Self::new`]).
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Centres \[m\].
    #[must_use]
    pub fn positions(&self) -> &[Vector3<f64>] {
        &self.positions
    }

    /// Radii \[m\].
    #[must_use]
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }

    /// Mean radius \[m\], in a part of a body that of all of it.
    #[must_use]
    pub fn mean_radius(&self) -> f64 {
        self.mean_radius
    }

    /// Ends of each bond.
    #[must_use]
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Bond `b`, weight included.
    ///
    /// # Panics
    /// For a bond that is not there.
    #[must_use]
    pub fn bond(&self, b: usize) -> LinearBond {
        let [i, j] = self.pairs[b].map(|i| self.positions[i as usize]);
        let d: [f64; 3] = (j - i).into();
        let d = Vector3::from(self.period.map_or(d, |p| image(d, &p)));
        let length = d.norm();
        LinearBond {
            axis: d / (length * length),
            scale: self.scales[b],
        }
    }

    /// Bonds, weights included.
    pub fn bonds(&self) -> impl ExactSizeIterator<Item = LinearBond> + Clone {
        (0..self.pairs.len()).map(|b| self.bond(b))
    }

    /// Bond weights.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Masses, weights included \[kg\].
    #[must_use]
    pub fn mass(&self) -> &[f64] {
        &self.mass
    }

    /// Rotational inertias, weights included \[kg m²\].
    #[must_use]
    pub fn inertia(&self) -> &[f64] {
        &self.inertia
    }

    /// Where the kernel sees centres.
    pub(crate) fn grid(&self) -> Grid {
        self.grid
    }

    /// Other end and bond of each bond of a particle, sorted.
    pub(crate) fn adjacency(&self) -> Arc<Adjacency<[u32; 2]>> {
        let new = || Arc::new(Adjacency::of_pairs(self.len(), &self.pairs).sorted());
        self.adjacency.get_or_init(new).clone()
    }

    /// Section rigidities, the same for all bonds.
    #[must_use]
    pub fn rigidity(&self) -> &BeamRigidity {
        &self.rigidity
    }

    /// Internal forces and torques *on* the particles, `-K x`, added up bond after bond: the
    /// plain reference the fast kernel is tested against.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`].
    pub fn add_forces(&self, state: &[Twist], out: &mut [Twist]) -> Result<()> {
        expect_len("particle states", state.len(), self.len())?;
        expect_len("particle forces", out.len(), self.len())?;
        for (bond, &[i, j]) in self.bonds().zip(&self.pairs) {
            let (i, j) = (i as usize, j as usize);
            let (a, b) = bond.wrenches(&self.rigidity, &state[i], &state[j]);
            out[i].linear += a.linear;
            out[i].angular += a.angular;
            out[j].linear += b.linear;
            out[j].angular += b.angular;
        }
        Ok(())
    }

    /// Elastic energy of all bonds \[J\].
    ///
    /// # Errors
    /// [`Error::LengthMismatch`].
    pub fn energy(&self, state: &[Twist]) -> Result<f64> {
        expect_len("particle states", state.len(), self.len())?;
        Ok(self
            .bonds()
            .zip(&self.pairs)
            .map(|(b, &[i, j])| b.energy(&self.rigidity, &state[i as usize], &state[j as usize]))
            .sum())
    }
}

fn sphere_inertia(mass: &[f64], radii: &[f64]) -> Vec<f64> {
    mass.iter().zip(radii).map(|(m, r)| 0.4 * m * r * r).collect()
}

//! Particles joined by beams, stored in the flat arrays that every solver of this crate reads.
//!
//! The mass of a particle in a body of volume `V` is `m_i = rho V r_i^3 / sum r^3`, its rotational inertia
//! `I_i = 2/5 m_i r_i^2`. In a packing of several bodies the sum runs over the spheres of one body
//! ([`crate::packing::parts`]).
//!
//! Weights follow the energy-consistent rule: the stiffness of bond b is multiplied by its weight `w_b`, mass
//! and inertia of a particle by the mean of `w` over its bonds. The critical step of the weighted body is
//! then at least the smallest critical step of a single weighted bond.

mod check;

pub(crate) use check::{check_spheres, expect_len};

use crate::bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
use crate::error::{Error, Result, finite, positive};
use crate::kernel::span::Grid;
use crate::packing::Packing;
use crate::packing::cells::image;
use arlequin_core::adjacency::Adjacency;
use check::make_bond;
use nalgebra::Vector3;
use std::sync::{Arc, OnceLock};

/// Largest accepted ratio of radii. Beyond it the neighbour search and the beam law lose their meaning.
pub const MAX_RADIUS_RATIO: f64 = 20.0;

/// Smallest accepted distance of two centres, as a fraction of the sum of their radii.
pub(crate) const COINCIDENT: f64 = 1e-9;

/// Spheres, their bonds, stiffness and masses in the reference configuration, in SI units.
#[derive(Debug, Clone)]
pub struct BondedParticles {
    positions: Vec<Vector3<f64>>,
    radii: Arc<Vec<f64>>,
    pairs: Vec<[u32; 2]>,
    /// [`LinearBond::scale`] of each bond \[m\]. Its axis is computed from the centres, which saves memory.
    scales: Vec<f64>,
    /// Weight of each bond; empty if all are one.
    weights: Vec<f64>,
    /// Stiffness of each bond over that of a beam of the packing's material; empty for a single material.
    grades: Vec<f64>,
    full_mass: Arc<Vec<f64>>,
    mass: Vec<f64>,
    inertia: Vec<f64>,
    rigidity: BeamRigidity,
    mean_radius: f64,
    grid: Grid,
    /// True if centres and stiffnesses are rounded as the kernel stores them.
    rounded: bool,
    /// Edges of the periodic box \[m\].
    period: Option<[f64; 3]>,
    adjacency: OnceLock<Arc<Adjacency<[u32; 2]>>>,
    /// True if bonds without weight sleep.
    sleeps: bool,
    /// Bonds of every particle that are awake, if bonds sleep; those of the present weights.
    awake: OnceLock<Arc<Adjacency<[u32; 2]>>>,
}

/// Material and volume of a body of particles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// Material of the beams.
    pub beam: BeamMaterial,
    /// Mass density of the body \[kg/m³\].
    pub density: f64,
    /// Volume of the body that the particles stand for \[m³\]; their masses sum to `density * volume`.
    pub volume: f64,
}

/// Volumes and options for spheres with known centres, radii and bonds.
#[derive(Debug)]
pub(crate) struct Contents<'a> {
    /// Volume that each particle stands for \[m³\].
    pub(crate) volumes: &'a [f64],
    /// True if particles without a bond are accepted.
    pub(crate) loose: bool,
    /// Edges of the periodic box \[m\].
    pub(crate) period: Option<[f64; 3]>,
    /// True if centres move to the kernel's grid and stiffnesses to its 24 bits, so that forces, energies and
    /// matrices of a model follow one law.
    pub(crate) rounded: bool,
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

    /// Works like [`Self::new`]; with a period, each beam joins the first particle to the nearest image of
    /// the second.
    pub(crate) fn with_period(
        positions: Vec<Vector3<f64>>,
        radii: Vec<f64>,
        pairs: Vec<[u32; 2]>,
        matter: &Matter,
        period: Option<[f64; 3]>,
    ) -> Result<Self> {
        positive("body volume", matter.volume)?;
        check_spheres(&positions, &radii)?;
        // Volumes in proportion to the cubes of the radii. The spheres fill only part of the body, so that
        // sphere volume times density would be far too light.
        let cubes: f64 = radii.iter().map(|r| r * r * r).sum();
        let volumes: Vec<f64> = radii.iter().map(|r| matter.volume * r * r * r / cubes).collect();
        let contents = Contents {
            volumes: &volumes,
            loose: false,
            period,
            rounded: false,
        };
        Self::with_volumes(positions, radii, pairs, matter.density, matter.beam, &contents)
    }

    /// Joins the spheres of a packing by beams, with its volumes and its loose spheres.
    pub(crate) fn from_packing(packing: &Packing, beam: BeamMaterial, density: f64) -> Result<Self> {
        let (x, r, pairs) = (&packing.positions, &packing.radii, &packing.pairs);
        check_spheres(x, r)?;
        let volumes = packing.volumes();
        let contents = Contents {
            volumes: &volumes,
            loose: packing.loose,
            period: packing.period,
            // Images of a periodic box lie off the grid, and a periodic packing never becomes a model.
            rounded: packing.period.is_none(),
        };
        Self::with_volumes(x.clone(), r.clone(), pairs.clone(), density, beam, &contents)
    }

    /// Joins spheres that [`check_spheres`] has accepted; `contents` has the volume of each.
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
        // All bonds share one beam radius.
        let mean = radii.iter().sum::<f64>() / radii.len() as f64;
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
        let grid = Grid::for_bonds(longest);
        // The grid follows from the longest bond, so bonds are computed once before and once after rounding.
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
            weights: Vec::new(),
            grades: Vec::new(),
            mass: full_mass.clone(),
            positions,
            radii: radii.into(),
            pairs,
            scales,
            full_mass: full_mass.into(),
            inertia,
            rigidity,
            mean_radius: mean,
            grid,
            rounded: contents.rounded,
            period: contents.period,
            adjacency: OnceLock::new(),
            sleeps: false,
            awake: OnceLock::new(),
        })
    }

    /// Replaces all bond weights (1 at the start) and updates masses and inertias.
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
        let is_one = |w: &f64| w.to_bits() == 1.0_f64.to_bits();
        self.weights.clear();
        if !weights.iter().all(is_one) {
            self.weights.extend(weights);
        }
        (0..weights.len()).for_each(|b| self.soften(b, 1.0));
        self.awake = OnceLock::new();
        // A particle without bonds keeps its whole mass.
        for (i, w) in self
            .mean_over_bonds(|b| weights[b], |_| 1.0)
            .into_iter()
            .enumerate()
        {
            self.mass[i] = self.full_mass[i] * w;
        }
        self.inertia = sphere_inertia(&self.mass, &self.radii);
        Ok(())
    }

    /// Sets stiffness and density of each particle, relative to the packing's material.
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
            // Two half-beams in series.
            2.0 * a * b / (a + b)
        };
        // Grades multiply the stored scales through `set_weights`, which knows the rounding too.
        self.grades = self.pairs.iter().map(series).collect();
        Arc::make_mut(&mut self.full_mass)
            .iter_mut()
            .zip(density)
            .for_each(|(m, d)| *m *= d);
        let weights: Vec<f64> = (0..self.pairs.len()).map(|b| self.weight(b)).collect();
        self.set_weights(&weights)
    }

    /// Returns whether the bonds are of several materials.
    pub(crate) fn is_graded(&self) -> bool {
        !self.grades.is_empty()
    }

    /// Returns the mean of bond values over the bonds of each particle; `alone` gives the value of a particle
    /// without bonds.
    pub(crate) fn mean_over_bonds(
        &self,
        value: impl Fn(usize) -> f64,
        alone: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let mut sum = vec![0.0; self.positions.len()];
        let mut degree = vec![0_u32; self.positions.len()];
        for (b, pair) in self.pairs.iter().enumerate() {
            for e in pair {
                sum[*e as usize] += value(b);
                degree[*e as usize] += 1;
            }
        }
        let mean = |(i, s): (usize, &f64)| match degree[i] {
            0 => alone(i),
            d => s / f64::from(d),
        };
        sum.iter().enumerate().map(mean).collect()
    }

    /// Returns the body of the particles `owned`, then `ghosts`, with all bonds of owned particles in the
    /// order of this body, and the number of each of these bonds in this body.
    pub(crate) fn part(&self, owned: &[u32], ghosts: &[u32]) -> (Self, Vec<u32>) {
        let mut places = vec![u32::MAX; self.len()];
        for (k, i) in (0..).zip(owned.iter().chain(ghosts)) {
            places[*i as usize] = k;
        }
        // A bond between two ghosts belongs to other ranks.
        let has_owned_end = |b: &usize| {
            let is_owned = |i: u32| (places[i as usize] as usize) < owned.len();
            self.pairs[*b].into_iter().any(is_owned)
        };
        let bonds: Vec<usize> = (0..self.pairs.len()).filter(has_owned_end).collect();
        let pairs: Vec<_> = bonds
            .iter()
            .map(|b| self.pairs[*b].map(|i| places[i as usize]))
            .collect();
        let particles = || owned.iter().chain(ghosts).map(|i| *i as usize);
        // The bonds of a particle keep the order of the whole body, so that sums over them have the same
        // bits.
        let adjacency = OnceLock::from(Arc::new(Adjacency::of_pairs(owned.len() + ghosts.len(), &pairs)));
        let grades = if self.is_graded() { &bonds[..] } else { &[] };
        let weighted = if self.weights.is_empty() { &[] } else { &bonds[..] };
        let numbers = bonds.iter().map(|b| *b as u32).collect();
        let part = Self {
            positions: particles().map(|i| self.positions[i]).collect(),
            radii: Arc::new(particles().map(|i| self.radii[i]).collect()),
            pairs,
            weights: weighted.iter().map(|b| self.weights[*b]).collect(),
            grades: grades.iter().map(|b| self.grades[*b]).collect(),
            full_mass: Arc::new(particles().map(|i| self.full_mass[i]).collect()),
            mass: particles().map(|i| self.mass[i]).collect(),
            inertia: particles().map(|i| self.inertia[i]).collect(),
            rigidity: self.rigidity,
            mean_radius: self.mean_radius,
            grid: self.grid,
            rounded: self.rounded,
            period: self.period,
            adjacency,
            sleeps: self.sleeps,
            awake: OnceLock::new(),
            scales: bonds.iter().map(|b| self.scales[*b]).collect(),
        };
        (part, numbers)
    }

    /// Returns centres, radii and pairs; frees all other arrays.
    pub(crate) fn into_spheres(self) -> (Vec<Vector3<f64>>, Vec<f64>, Vec<[u32; 2]>) {
        (self.positions, Arc::unwrap_or_clone(self.radii), self.pairs)
    }

    /// Sets the stiffness of a bond to zero; masses stay.
    pub(crate) fn sever(&mut self, bond: usize) {
        self.scales[bond] = 0.0;
    }

    /// [`LinearBond::scale`] of bond `b` \[m\].
    pub(crate) fn scale(&self, bond: usize) -> f64 {
        self.scales[bond]
    }

    /// Returns the scale of bond `b` with the share `left` of its stiffness \[m\].
    pub(crate) fn softened(&self, bond: usize, left: f64) -> f64 {
        let grade = self.grades.get(bond).copied().unwrap_or(1.0);
        let whole = self.bond(bond);
        let softened = LinearBond {
            scale: left * self.weight(bond) * grade / whole.axis.norm(),
            ..whole
        };
        match self.rounded {
            true => self.grid.rounded(&softened).scale,
            false => softened.scale,
        }
    }

    /// Share of its stiffness that bond `b` has left; one for a bond without weight.
    pub(crate) fn stiffness_share(&self, bond: usize) -> f64 {
        match self.softened(bond, 1.0) {
            whole if whole > 0.0 => self.scales[bond] / whole,
            _ => 1.0,
        }
    }

    /// Leaves the share `left` of the stiffness of a bond; masses stay.
    pub(crate) fn soften(&mut self, bond: usize, left: f64) {
        self.scales[bond] = self.softened(bond, left);
    }

    /// Returns whether bond `b` has any stiffness.
    pub(crate) fn carries(&self, bond: usize) -> bool {
        self.scales[bond] > 0.0
    }

    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns whether there is no particle (never true after [`Self::new`]).
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

    pub(crate) fn unweighted_mass(&self) -> Arc<Vec<f64>> {
        self.full_mass.clone()
    }

    pub(crate) fn shared_radii(&self) -> Arc<Vec<f64>> {
        self.radii.clone()
    }

    /// Mean radius \[m\]; in a rank's part of a partitioned body, the mean over the whole body.
    #[must_use]
    pub fn mean_radius(&self) -> f64 {
        self.mean_radius
    }

    /// Particle numbers of the two ends of each bond.
    #[must_use]
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Returns bond `b`, weight included.
    ///
    /// # Panics
    /// If there is no bond `b`.
    #[must_use]
    pub fn bond(&self, b: usize) -> LinearBond {
        let d = self.span(b);
        let length = d.norm();
        LinearBond {
            axis: d / (length * length),
            scale: self.scales[b],
        }
    }

    /// Returns the vector at rest from the first centre of bond `b` to the second \[m\].
    #[inline]
    pub(crate) fn span(&self, b: usize) -> Vector3<f64> {
        let [i, j] = self.pairs[b].map(|i| self.positions[i as usize]);
        let d: [f64; 3] = (j - i).into();
        // The nearest image, in a periodic box.
        Vector3::from(self.period.map_or(d, |p| image(d, &p)))
    }

    /// Returns whether a bond has no stiffness: it broke, or its weight is zero.
    pub(crate) fn has_no_stiffness(&self, b: usize) -> bool {
        self.scales[b] <= 0.0
    }

    /// Iterates over all bonds, weights included.
    pub fn bonds(&self) -> impl ExactSizeIterator<Item = LinearBond> + Clone {
        (0..self.pairs.len()).map(|b| self.bond(b))
    }

    /// Weight of a bond.
    #[must_use]
    pub fn weight(&self, bond: usize) -> f64 {
        self.weights.get(bond).copied().unwrap_or(1.0)
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

    /// Grid of the centres in the kernel.
    pub(crate) fn grid(&self) -> Grid {
        self.grid
    }

    /// For each particle, the other end and the number of each of its bonds: sorted, except in a part of a
    /// body, where they follow the order of the pairs.
    pub(crate) fn adjacency(&self) -> Arc<Adjacency<[u32; 2]>> {
        // Sorted, so that sums over the bonds of a particle do not depend on the order of the pairs.
        let build = || Arc::new(Adjacency::of_pairs(self.len(), &self.pairs).sorted());
        self.adjacency.get_or_init(build).clone()
    }

    /// From now on, lets bonds without weight sleep: they take no time and do not break.
    pub(crate) fn sleep(&mut self) {
        self.sleeps = true;
        self.awake = OnceLock::new();
    }

    /// Returns whether bonds without weight sleep.
    pub(crate) fn has_sleep(&self) -> bool {
        self.sleeps
    }

    /// Returns whether a bond sleeps.
    pub(crate) fn is_asleep(&self, bond: usize) -> bool {
        self.sleeps && self.weight(bond) <= 0.0
    }

    /// The rows of [`Self::adjacency`] without bonds that sleep.
    pub(crate) fn awake(&self) -> Arc<Adjacency<[u32; 2]>> {
        let all = self.adjacency();
        if !self.sleeps {
            return all;
        }
        let row = |i: usize| {
            let bonds = all.row(i).iter().copied();
            bonds.filter(|[_, b]| !self.is_asleep(*b as usize))
        };
        let build = || Arc::new(Adjacency::from_rows((0..all.len()).map(row)));
        self.awake.get_or_init(build).clone()
    }

    /// Section rigidities, the same for all bonds.
    #[must_use]
    pub fn rigidity(&self) -> &BeamRigidity {
        &self.rigidity
    }

    /// Adds the internal forces and torques *on* the particles, `-K x`, bond by bond. This is the plain
    /// reference that the fast kernel is tested against.
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
    // Solid sphere: 2/5 m r^2.
    mass.iter().zip(radii).map(|(m, r)| 0.4 * m * r * r).collect()
}

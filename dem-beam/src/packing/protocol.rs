//! Jammed random packings: random start, growth to the onset of jamming, bonds up to a coordination number.
//!
//! 1. Radii are uniform in `[1-s, 1+s]`. Centres are stratified along the longest axis and random in the
//!    section, at volume fraction 0.5, and numbered along a Morton curve. (A start that is not stratified
//!    leaves axial density waves; E then differs by 16 % along the bar.)
//! 2. Soft spheres relax by FIRE. Radii grow by steps of the volume fraction until contacts carry load, then
//!    they are corrected until the mean overlap is the wanted one.
//! 3. The `N z / 2` pairs nearest to touching, by `d/(r_i+r_j) - 1`, become bonds: z is prescribed, the
//!    largest gap follows.
//! 4. Connected parts are kept; the few spheres without a bond are left out and reported ([`super::parts`]).
//!
//! Bodies of a surface are packed one by one, each with its share of the spheres.

use super::assemble::{Filled, Packing};
use super::bonding::Loose;
use super::bonding::bond_and_trim;
use super::cells::{Sphere, centre};
use super::container::Container;
use super::narrow;
use super::profile::Profile;
use super::relax::{Relaxed, SoftSpheres};
use super::size::{JAMMED, SPREAD};
use crate::error::{Error, Result, positive};
use crate::kernel::order::morton_key;
use crate::particles::MAX_RADIUS_RATIO;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Method that brings the spheres together.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Compaction {
    /// Grows the spheres to the onset of jamming and adjusts them to `overlap`.
    Onset {
        /// Wanted mean overlap of touching pairs over the mean diameter, default 5e-4.
        overlap: f64,
    },
    /// Relaxes once at a given volume fraction. This is faster; at 0.62, E is about 3 % higher.
    Quench {
        /// Sphere volume over container volume.
        fraction: f64,
    },
}

/// Specification of a packing. Start from [`PackingSpec::new`] and change what you need.
#[derive(Debug, Clone)]
pub struct PackingSpec {
    /// Volume to fill.
    pub container: Container,
    /// Number of spheres, including those without bonds; several bodies share them by volume.
    pub count: usize,
    /// Half width of the uniform radius distribution over the mean radius; 0.25 by default, the usual value
    /// for this method.
    pub spread: f64,
    /// Coordination number: twice the number of bonds over the number of all spheres; 6.2 by default, the
    /// usual value for this method. E rises with it by about 17e9 Pa per unit for silica beams.
    pub coordination: f64,
    /// Treatment of spheres in no connected part.
    pub loose: Loose,
    /// Method of compaction.
    pub compaction: Compaction,
    /// Seed of the random start.
    pub seed: u64,
    /// Largest number of relaxation steps per growth step; 4000 is enough for 200 000 spheres.
    pub max_steps: usize,
}

impl PackingSpec {
    /// Returns the specification of the full protocol for `count` spheres.
    #[must_use]
    pub fn new(container: Container, count: usize, seed: u64) -> Self {
        Self {
            container,
            count,
            spread: SPREAD,
            coordination: 6.2,
            loose: Loose::default(),
            compaction: Compaction::Onset { overlap: 5e-4 },
            seed,
            max_steps: 4000,
        }
    }

    /// Returns the specification of a single quench, for tests. The volume fraction is 0.62, or 0.65 in a
    /// periodic box, where no walls keep spheres from jamming as densely as in the bulk.
    #[must_use]
    pub fn quench(container: Container, count: usize, seed: u64) -> Self {
        let fraction = if container.period().is_some() { 0.65 } else { 0.62 };
        Self {
            compaction: Compaction::Quench { fraction },
            ..Self::new(container, count, seed)
        }
    }

    /// Makes the packing. The same spec gives the same bits for any number of threads.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for parameters, [`Error::RadiusRatio`], [`Error::TooFewAcross`],
    /// [`Error::ContainerTooSmall`], [`Error::NotJammed`], [`Error::TooFewPairs`], [`Error::LooseSpheres`];
    /// for one of several bodies within [`Error::InBody`]; [`Error::CrossingBodies`];
    /// [`arlequin_core::Error::Interrupted`].
    ///
    /// ```
    /// use dem_beam::{Container, PackingSpec};
    /// let packing = PackingSpec::quench(Container::cylinder(4e-3, 1e-3)?, 500, 1).build()?;
    /// assert!((packing.report.coordination_all - 6.2).abs() < 0.01);
    /// # Ok::<(), dem_beam::Error>(())
    /// ```
    pub fn build(&self) -> Result<Packing> {
        self.build_with(&mut |_| ())
    }

    /// Makes the packing like [`Self::build`]; calls `progress` with the share of the work that is done, from
    /// 0 to 1. The share is an estimate: packings need between half and twice the usual number of steps.
    ///
    /// # Errors
    /// Errors of [`Self::build`].
    pub fn build_with(&self, progress: &mut dyn FnMut(f64)) -> Result<Packing> {
        self.check()?;
        let bodies = self.container.bodies();
        let counts = spheres_per_body(self.count, &bodies);
        let mut filled = Vec::with_capacity(bodies.len());
        // Share of the spheres in the bodies that are packed already.
        let mut before = 0.0;
        for (k, (body, count)) in bodies.iter().zip(counts).enumerate() {
            // The first body keeps the seed, so that it is packed as if it were alone.
            let seed = self.seed.wrapping_add((k as u64).wrapping_mul(BODY_SEED));
            let share = count as f64 / self.count as f64;
            let packed = self.fill(body, count, seed, &mut |steps| {
                progress(before + share * self.share_of_steps(steps));
            });
            before += share;
            filled.push(packed.map_err(|e| e.in_body(k, &bodies))?);
        }
        let packing = Packing::assemble(
            &self.container,
            &bodies,
            &filled,
            self.count,
            self.loose == Loose::Keep,
        )?;
        match &self.container {
            Container::Around(around) => packing.restrict(around),
            _ => Ok(packing),
        }
    }

    /// Returns the estimated share of the work that is done after a number of relaxation steps. It slowly
    /// approaches one if more steps are needed than usual.
    fn share_of_steps(&self, steps: usize) -> f64 {
        let usual = match self.compaction {
            Compaction::Onset { .. } => USUAL_STEPS,
            Compaction::Quench { .. } => USUAL_QUENCH_STEPS,
        };
        let remaining = (usual - steps as f64).max(0.1 * usual);
        steps as f64 / (steps as f64 + remaining)
    }

    /// Packs one body; calls `watch` with the number of relaxation steps now and then.
    fn fill(
        &self,
        body: &Container,
        count: usize,
        seed: u64,
        watch: &mut dyn FnMut(usize),
    ) -> Result<Filled> {
        if count == 0 {
            return Err(Error::EmptyBody);
        }
        let mut container = body.clone();
        let spheres = self.start(&mut container, count, seed)?;
        let mut soft = SoftSpheres::new(&container, spheres, watch);
        let (overlap, steps) = match self.compaction {
            Compaction::Onset { overlap } => grow(&mut soft, &container, overlap, self.max_steps)?,
            Compaction::Quench { fraction } => {
                set_fraction(&mut soft, container.volume(), fraction);
                // Forces balanced to 3 % of the mean contact force: finer balance moves E by less than its
                // spread over seeds.
                let relaxed = soft.relax(self.max_steps, 1e-5, 3e-2);
                soft.check_interrupt()?;
                (relaxed.overlap, relaxed.steps)
            }
        };
        let spheres = soft.spheres;
        let bonding = bond_and_trim(&spheres, self.coordination, container.period(), self.loose);
        let bonding = bonding.map_err(|e| narrow::name_width(e, body, &spheres))?;
        Ok(Filled {
            numbers: Vec::new(),
            spheres,
            bonding,
            overlap,
            steps,
        })
    }

    /// Returns random centres and radii at volume fraction [`START_FRACTION`], ordered along a Morton curve.
    fn start(&self, container: &mut Container, count: usize, seed: u64) -> Result<Vec<Sphere>> {
        let volume = container.volume();
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut radii: Vec<f64> = (0..count)
            .map(|_| 1.0 + self.spread * (2.0 * rng.random::<f64>() - 1.0))
            .collect();
        let cubes: f64 = radii.iter().map(|r| r * r * r).sum();
        // Factor from relative radii to metres.
        let unit = (START_FRACTION * volume / cubes * 0.75 / std::f64::consts::PI).cbrt();
        radii.iter_mut().for_each(|r| *r *= unit);
        let (low, high) = container.bounds();
        let largest = radii.iter().fold(0.0_f64, |m, r| m.max(*r));
        // No place of the centre exists for a sphere wider than the body.
        if 2.0 * largest > (high - low).min() {
            return Err(Error::ContainerTooSmall {
                count,
                diameter: 2.0 * largest,
                width: (high - low).min(),
            });
        }
        refuse_few_across(container, count, unit)?;
        if let Some(period) = container.period() {
            // The neighbour search needs three cells of its widest list along each edge.
            let (shortest, limit) = (period.into_iter().fold(f64::INFINITY, f64::min), 12.0 * largest);
            if shortest < limit {
                return Err(Error::PeriodTooShort { shortest, limit });
            }
        }
        container.prepare(1.5 * largest);
        let axis = (high - low).imax();
        let profile = Profile::new(container, axis, unit);
        let mut spheres: Vec<Sphere> = Vec::with_capacity(count);
        for (i, r) in radii.into_iter().enumerate() {
            // Stratified: one sphere in each of `count` slabs of equal volume.
            let along = profile.quantile((i as f64 + rng.random::<f64>()) / count as f64);
            let x = loop {
                let mut x = Vector3::zeros();
                for a in 0..3 {
                    x[a] = low[a] + (high[a] - low[a]) * rng.random::<f64>();
                }
                x[axis] = along + profile.blur * (rng.random::<f64>() - 0.5);
                if container.contains(&x) {
                    break x;
                }
            };
            spheres.push([x.x, x.y, x.z, r]);
        }
        let key = |s: &Sphere| morton_key(&centre(s), &low, &high);
        spheres.sort_by_key(key);
        Ok(spheres)
    }

    fn check(&self) -> Result<()> {
        if self.count == 0 || self.count > u32::MAX as usize / 32 {
            return Err(Error::out_of_range(
                "number of spheres",
                self.count as f64,
                "1 to 134 217 727",
            ));
        }
        positive("coordination number", self.coordination)?;
        if !(self.spread >= 0.0 && self.spread < 1.0) {
            return Err(Error::out_of_range("radius spread", self.spread, "[0, 1)"));
        }
        let ratio = (1.0 + self.spread) / (1.0 - self.spread);
        // A spread that gives the limit exactly must pass its round-off.
        if ratio > MAX_RADIUS_RATIO * (1.0 + 1e-9) {
            return Err(Error::RadiusRatio {
                smallest: 1.0 - self.spread,
                largest: 1.0 + self.spread,
                ratio,
                limit: MAX_RADIUS_RATIO,
            });
        }
        let (name, value) = match self.compaction {
            Compaction::Onset { overlap } => ("mean overlap", overlap),
            Compaction::Quench { fraction } => ("volume fraction", fraction),
        };
        if !(value > 0.0 && value < 0.75) {
            return Err(Error::out_of_range(name, value, "(0, 0.75)"));
        }
        Ok(())
    }
}

/// Difference of the seeds of successive bodies of a surface.
const BODY_SEED: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the number of spheres of each body: in proportion to volume, `count` in all, by largest
/// remainders.
fn spheres_per_body(count: usize, bodies: &[Container]) -> Vec<usize> {
    let total_volume: f64 = bodies.iter().map(Container::volume).sum();
    let shares: Vec<f64> = bodies
        .iter()
        .map(|b| count as f64 * b.volume() / total_volume)
        .collect();
    let mut out: Vec<usize> = shares.iter().map(|w| w.floor() as usize).collect();
    let mut order: Vec<usize> = (0..bodies.len()).collect();
    order.sort_by(|&a, &b| (shares[b] - shares[b].floor()).total_cmp(&(shares[a] - shares[a].floor())));
    let remainder = count.saturating_sub(out.iter().sum());
    order
        .into_iter()
        .cycle()
        .take(remainder)
        .for_each(|k| out[k] += 1);
    out
}

/// Refuses spheres that, once jammed, would be nearly as wide as their body; `start` is their mean radius
/// \[m\] at the start. The bounding box of a surface may be wider than the body, so that [`narrow`] measures
/// it later.
fn refuse_few_across(container: &Container, count: usize, start: f64) -> Result<()> {
    let (low, high) = container.bounds();
    let width = (high - low).min();
    // Spheres grow until they jam: volumes in proportion to the volume fraction.
    let diameter = 2.0 * start * (JAMMED / START_FRACTION).cbrt();
    let across = width / diameter;
    if across >= LEAST_ACROSS || container.period().is_some() {
        return Ok(());
    }
    Err(Error::TooFewAcross {
        count,
        diameter,
        width,
        across,
    })
}

/// Smallest width of a body, in mean diameters, for which spheres are grown at all.
const LEAST_ACROSS: f64 = 1.5;
/// Usual numbers of relaxation steps, to estimate progress: 2 000 to 20 000 spheres need 2 200 to 5 100
/// steps, a quench 970 to 1 600.
const USUAL_STEPS: f64 = 3500.0;
const USUAL_QUENCH_STEPS: f64 = 1400.0;
/// Volume fraction of the random start.
const START_FRACTION: f64 = 0.5;
/// Growth of the volume fraction per relaxation before jamming.
const GROWTH: f64 = 0.01;
/// Below this volume fraction none of our packings jams, and growth steps are twice as large.
const NEAR_ONSET: f64 = 0.57;
/// Relaxation steps of a growth step before its mean overlap is first compared with earlier values.
const GLANCE: usize = 300;
/// Factor of the mean overlap over another `GLANCE / 2` steps: below it, the overlap is about to vanish.
const FALLING: f64 = 0.8;
/// Mean overlaps below this fraction of the wanted one carry no load.
const LOOSE: f64 = 0.25;
/// Forces, over the mean contact force, below which a jammed state counts as relaxed.
const BALANCE: f64 = 3e-2;
/// Accepted factor between the mean overlap and the wanted one.
const NEAR: f64 = 1.25;

/// Returns the volume of the spheres over `volume`.
fn fraction(soft: &SoftSpheres<'_>, volume: f64) -> f64 {
    let cubes: f64 = soft.spheres.iter().map(|s| s[3] * s[3] * s[3]).sum();
    4.0 / 3.0 * std::f64::consts::PI * cubes / volume
}

/// Scales the radii to the volume fraction `wanted`.
fn set_fraction(soft: &mut SoftSpheres<'_>, volume: f64, wanted: f64) {
    let now = fraction(soft, volume);
    soft.scale_radii((wanted / now).cbrt());
}

/// Relaxes; while `growing`, stops early if the overlap shows that spheres are moving to a state without
/// load. Just below the onset it would take thousands of steps to reach that state, which is then grown
/// further anyway. The second value returned is true after such a stop.
fn glance(soft: &mut SoftSpheres<'_>, max_steps: usize, wanted: f64, growing: bool) -> (Relaxed, bool) {
    let loose = LOOSE * wanted;
    if !growing || max_steps <= 2 * GLANCE {
        return (soft.relax(max_steps, loose, BALANCE), false);
    }
    let first = soft.relax(GLANCE, loose, BALANCE);
    if first.steps < GLANCE {
        return (first, false);
    }
    let second = soft.relax(GLANCE / 2, loose, BALANCE);
    let steps = first.steps + second.steps;
    let flowing = second.overlap < FALLING * first.overlap;
    if second.steps < GLANCE / 2 || flowing {
        return (Relaxed { steps, ..second }, second.steps == GLANCE / 2);
    }
    let last = soft.relax(max_steps - steps, loose, BALANCE);
    let steps = steps + last.steps;
    (Relaxed { steps, ..last }, false)
}

/// Grows the spheres to the onset of jamming, then corrects the radii to the wanted mean overlap. Returns
/// this overlap and the number of steps.
fn grow(
    soft: &mut SoftSpheres<'_>,
    container: &Container,
    wanted: f64,
    max_steps: usize,
) -> Result<(f64, usize)> {
    let volume = container.volume();
    let mut phi = START_FRACTION;
    let mut steps = 0;
    let mut last: Option<(f64, f64)> = None;
    let mut overlap = 0.0;
    // 25 growth steps of 0.01 reach 0.75, above any random packing; the others are for corrections.
    for _ in 0..60 {
        let (done, flowing) = glance(soft, max_steps, wanted, last.is_none());
        soft.check_interrupt()?;
        steps += done.steps;
        let m = done.overlap;
        overlap = m;
        if !flowing && m <= wanted * NEAR && m >= wanted / NEAR {
            return Ok((m, steps));
        }
        let jammed = m > wanted && !flowing;
        // Above the onset the overlap grows with the volume fraction, with a slope near 1/2; two states give
        // a better secant.
        let slope = match last {
            Some((p, o)) if (phi - p).abs() > 1e-9 && m > LOOSE * wanted && o > LOOSE * wanted => {
                ((m - o) / (phi - p)).clamp(0.2, 1.5)
            }
            _ => 0.5,
        };
        let next = if jammed {
            phi - (m - wanted) / slope
        } else if last.is_some() {
            phi + (wanted - m) / slope
        } else {
            phi + if phi < NEAR_ONSET { 2.0 * GROWTH } else { GROWTH }
        };
        if jammed || last.is_some() {
            last = Some((phi, m));
        }
        set_fraction(soft, volume, next);
        phi = next;
    }
    Err(Error::NotJammed {
        steps,
        overlap,
        wanted,
    })
}

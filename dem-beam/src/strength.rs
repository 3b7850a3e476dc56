//! Strength of a packing in direct tension: a bar is pulled until it breaks.
//!
//! The bar lies along x. The spheres that touch its two end faces are held along x, moved apart, and free to
//! the sides. The law is linear up to the first broken bond, so that the static solution gives the elongation
//! `u_1` at which that bond breaks. The run starts at `0.9 u_1` with displacements and velocities in the
//! shape of this solution, so that no wave runs through the bar. The ends move apart at a constant rate that
//! would take an unloaded bar to `u_1` in [`LOADING`] wave transits along the bar. A stiffness damping of
//! [`DAMPING`] wave transits across a mean diameter acts. The run ends when the force has fallen to half of
//! its peak.
//!
//! A force is the work of the ends over their elongation, averaged over a fifth of a transit; the strength is
//! the largest of these forces over the section.

use crate::bond::{BeamMaterial, Twist};
use crate::calibrate::{Bar, end_layers};
use crate::error::{Error, Result};
use crate::fracture::{Fracture, locked};
use crate::model::DemModel;
use crate::packing::Packing;
use crate::specimen::{DENSITY, GIVEN_UP, SOLVE, START, support_work};
use crate::statics::StaticProblem;
use arlequin_core::effect::StiffnessDamping;
use arlequin_core::{Coupled, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights};

/// Wave transits along the bar in which an unloaded bar would reach the first broken bond.
pub const LOADING: f64 = 10.0;
/// Time of the stiffness damping, in wave transits across a mean diameter.
pub const DAMPING: f64 = 0.04;
/// Wave transits along the bar over which a force is averaged.
const WINDOW: f64 = 0.2;
/// The bar counts as broken when its force has fallen to this fraction of its peak.
const FALLEN: f64 = 0.5;

/// Result of a strength test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strength {
    /// Highest mean stress over the section \[Pa\].
    pub peak: f64,
    /// Stress at which the first bond breaks \[Pa\].
    pub first: f64,
    /// Mean strain at the peak.
    pub strain: f64,
    /// Young's modulus before anything breaks \[Pa\].
    pub young: f64,
    /// Number of bonds broken up to the peak.
    pub broken: usize,
    /// Number of all bonds.
    pub bonds: usize,
    /// Nominal strength of the beams \[Pa\]. For energies, the axial stress `√(2 E_b G/d)` at which a beam of
    /// a mean diameter `d` holds the energy per section `G`.
    pub beam: f64,
}

impl Strength {
    /// Returns the beam strength over the body strength.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.beam / self.peak
    }
}

/// Pulls a bar until it breaks.
///
/// # Errors
/// [`Error::SeveralParts`]; [`Error::OutOfRange`] for the bar, the strength or no sphere at an end; errors of
/// [`DemModel::new`], of the static solution and of the run; [`Error::NotBroken`] if the bar stretches
/// without breaking.
pub fn strength_test(
    packing: &Packing,
    beam: BeamMaterial,
    bar: &Bar,
    fracture: Fracture,
) -> Result<Strength> {
    packing.connected("a strength test")?;
    // Times scale with the root of the density and loads with the strength of the beams. The ratio of beam
    // strength to body strength therefore depends on the packing, the criterion and the scatter alone, and
    // any density will do.
    let model = DemModel::new("bar", packing, beam, DENSITY)?.with_fracture(fracture)?;
    let stretched = Stretched::new(&model, bar)?;
    // At this load the bar has the elongation of the static solution; the first bond breaks at a load of one.
    let load = stretched.load(&model);
    if !(load.is_finite() && load > 0.0) {
        return Err(Error::out_of_range(
            "load of the bonds under tension",
            load,
            "finite values > 0: the bar must carry tension",
        ));
    }
    // Stresses are linear in the elongation, the energy per section grows with its square. This is the
    // elongation at the first break over that of the static solution.
    let diameter = 2.0 * model.body().mean_radius();
    let (first, nominal) = if fracture.criterion.is_energy() {
        let stress = (2.0 * beam.young * fracture.strength / diameter).sqrt();
        (load.sqrt().recip(), stress)
    } else {
        (load.recip(), fracture.strength)
    };
    let pull = Pull {
        first: first * stretched.elongation,
        transit: bar.length / (stretched.young / DENSITY).sqrt(),
        damping: DAMPING * diameter / (stretched.young / DENSITY).sqrt(),
    };
    let bonds = model.body().pairs().len();
    let outcome = pull.run(model, &stretched, bar)?;
    Ok(Strength {
        peak: outcome.peak / bar.area,
        first: first * stretched.force / bar.area,
        strain: outcome.elongation / bar.length,
        young: stretched.young,
        broken: outcome.broken,
        bonds,
        beam: nominal,
    })
}

/// Static equilibrium of the bar under a small elongation.
struct Stretched {
    /// Unknowns of the model: displacements \[m\], then rotations \[rad\].
    q: Vec<f64>,
    /// Particles at the two ends.
    ends: [Vec<usize>; 2],
    elongation: f64,
    force: f64,
    young: f64,
}

impl Stretched {
    fn new(model: &DemModel, bar: &Bar) -> Result<Self> {
        let body = model.body();
        let ends = end_layers(body, bar)?;
        // Small: the linear law has no scale, and the solution is scaled later.
        let elongation = 1e-4 * bar.length;
        let mut problem = StaticProblem::free(body.len());
        for (start, x) in problem.start.iter_mut().zip(body.positions()) {
            // The uniform strain as a start: it is close, and has the held values at the ends.
            start.linear.x = elongation * ((x.x - bar.start) / bar.length - 0.5);
        }
        for (end, side) in ends.iter().zip([-0.5, 0.5]) {
            for &i in end {
                problem.held[i].linear[0] = true;
                problem.start[i].linear.x = side * elongation;
            }
        }
        let solution = problem.solve(body, SOLVE.0, SOLVE.1)?;
        let pull = |end: &[usize]| end.iter().map(|&i| solution.reactions[i].linear.x).sum::<f64>();
        // The mean of both ends: they are equal up to the residual.
        let force = 0.5 * (pull(&ends[1]) - pull(&ends[0]));
        let linear = |t: &Twist| [t.linear.x, t.linear.y, t.linear.z];
        let angular = |t: &Twist| [t.angular.x, t.angular.y, t.angular.z];
        let u = &solution.displacements;
        Ok(Self {
            q: u.iter()
                .flat_map(linear)
                .chain(u.iter().flat_map(angular))
                .collect(),
            ends,
            elongation,
            force,
            young: force * bar.length / (bar.area * elongation),
        })
    }

    /// Returns the largest ratio of criterion to strength among the bonds.
    fn load(&self, model: &DemModel) -> f64 {
        model.load(&self.q)
    }
}

struct Pull {
    /// Elongation at which the first bond breaks \[m\].
    first: f64,
    /// Transit time of a wave along the bar \[s\].
    transit: f64,
    /// Time of the stiffness damping \[s\].
    damping: f64,
}

struct Peak {
    peak: f64,
    elongation: f64,
    broken: usize,
}

impl Pull {
    fn run(&self, model: DemModel, stretched: &Stretched, bar: &Bar) -> Result<Peak> {
        // Slow against the waves of the bar, so that the load is nearly static.
        let rate = self.first / (LOADING * self.transit);
        let (begin, end) = (START * self.first, GIVEN_UP * self.first);
        let duration = (end - begin) / rate;
        let scaled = |x: f64| {
            stretched
                .q
                .iter()
                .map(|q| q * x / stretched.elongation)
                .collect::<Vec<f64>>()
        };
        let log = model.break_log();
        let supports: Vec<PrescribedMotion<f64>> = stretched
            .ends
            .iter()
            .zip([-0.5, 0.5])
            .map(|(end, side)| PrescribedMotion {
                dofs: model.translations(end, [true, false, false]),
                amplitude: side,
                // The table begins before the start of the run, so that the ends already move at the constant
                // rate.
                time: TimeFunction::Table(vec![
                    (-duration, begin - rate * duration),
                    (2.0 * duration, begin + 2.0 * rate * duration),
                ]),
            })
            .collect();
        let mut subdomain = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(StiffnessDamping::new(self.damping)?))
            .with_initial(scaled(begin), scaled(rate))?;
        for s in supports {
            subdomain = subdomain.with_support(s);
        }
        let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.8), None)?;
        let every = ((WINDOW * self.transit / run.dt()) as usize).max(1);
        let mut best = Peak {
            peak: 0.0,
            elongation: begin,
            broken: 0,
        };
        let mut work = support_work(&run);
        while run.time() < duration {
            run.run(every, &mut Silent)?;
            let new_work = support_work(&run);
            // Mean force over the window: the work of the ends over their elongation.
            let force = (new_work - work) / (every as f64 * run.dt() * rate);
            work = new_work;
            let broken = locked(&log).events().len();
            if force > best.peak {
                best = Peak {
                    peak: force,
                    elongation: begin + rate * run.time(),
                    broken,
                };
            } else if broken > 0 && force < FALLEN * best.peak {
                return Ok(best);
            }
        }
        Err(Error::NotBroken {
            strain: end / bar.length,
            stress: best.peak / bar.area,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fracture::Criterion;
    use crate::packing::{Lattice, lattice};

    /// Every beam of a chain bears the whole force in tension: the nominal strength of its beams is the
    /// stress at which the chain breaks.
    #[test]
    fn a_chain_breaks_at_the_nominal_strength_of_its_beams() -> Result<()> {
        let radius = 0.5e-3;
        let packing = lattice(Lattice::Cubic, [12, 1, 1], radius)?;
        let beam = BeamMaterial::SILICA;
        let bar = Bar {
            start: packing.positions[0].x - radius,
            length: 24.0 * radius,
            area: std::f64::consts::PI * (beam.radius_ratio * radius).powi(2),
        };
        for fracture in [
            Fracture::new(Criterion::Axial, 200e6),
            Fracture::new(Criterion::Energy, 23.0),
            Fracture::new(Criterion::TensileEnergy, 23.0),
        ] {
            let chain = strength_test(&packing, beam, &bar, fracture)?;
            assert!((chain.first / chain.beam - 1.0).abs() < 1e-6, "{chain:?}");
            assert!((chain.ratio() - 1.0).abs() < 0.05, "{chain:?}");
        }
        Ok(())
    }
}

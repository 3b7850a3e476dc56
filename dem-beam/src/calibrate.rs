//! Elasticity of a packing by a tension test, and beams for a wanted elasticity.
//!
//! The bar lies along x. The particles that touch the two end faces are moved by `u_x = strain x` and are
//! free otherwise; `E = F/(S strain)`, with F the mean of the two reactions. The gauge section is the middle
//! half of the bar. A least-squares fit of strains there gives Poisson's ratio and a second modulus, free of
//! end effects. The two moduli of a good packing agree within 3 %.

use crate::bond::BeamMaterial;
use crate::error::{Error, Result, finite, positive};
use crate::model::TOUCH;
use crate::packing::Packing;
use crate::particles::BondedParticles;
use crate::statics::StaticProblem;
use nalgebra::{Matrix3, Vector3};

/// A bar along x from `start` to `start + length` \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bar {
    /// Coordinate x of the first end face \[m\].
    pub start: f64,
    /// Length \[m\].
    pub length: f64,
    /// Area of the section \[m²\].
    pub area: f64,
}

/// Result of a tension test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elasticity {
    /// Young's modulus over the whole bar \[Pa\].
    pub young: f64,
    /// Young's modulus from the strain of the gauge section \[Pa\].
    pub young_gauge: f64,
    /// Poisson's ratio from the gauge section.
    pub poisson: f64,
    /// Iterations of the static solve.
    pub iterations: usize,
}

/// Largest accepted relative difference between the two moduli. Beyond it the packing has an axial density
/// wave, as starts that are not stratified along the bar produce it.
pub const UNIFORM: f64 = 0.03;

impl Elasticity {
    /// Refuses a bar whose gauge section differs too much from the whole bar.
    ///
    /// # Errors
    /// [`Error::AxialWave`] if the moduli differ by more than [`UNIFORM`].
    pub fn check_uniform(&self) -> Result<()> {
        check_uniform(self.young, self.young_gauge)
    }
}

fn check_uniform(whole: f64, gauge: f64) -> Result<()> {
    let difference = gauge / whole - 1.0;
    if difference.abs() <= UNIFORM {
        Ok(())
    } else {
        Err(Error::AxialWave {
            whole,
            gauge,
            difference,
            limit: UNIFORM,
        })
    }
}

/// Strain of the test; the law is linear, so any value does.
const STRAIN: f64 = 1e-3;

/// Relative residual of the solve: three digits beyond the spread over seeds.
const TOLERANCE: f64 = 1e-6;

/// Largest number of iterations: twenty times the iterations of a bar of 200 000 particles.
const ITERATIONS: usize = 50_000;

/// Returns the particles that touch the first and the second end face of a bar.
///
/// # Errors
/// [`Error::OutOfRange`] for the bar, or if no particle touches an end.
pub(crate) fn end_layers(body: &BondedParticles, bar: &Bar) -> Result<[Vec<usize>; 2]> {
    positive("bar length", bar.length)?;
    positive("bar section", bar.area)?;
    let gap = TOUCH * body.mean_radius();
    let mut ends = [Vec::new(), Vec::new()];
    for (i, (x, r)) in body.positions().iter().zip(body.radii()).enumerate() {
        // By touch, not by the centre: a sphere belongs to the layer that a plate would press on.
        let (along, reach) = (x.x - bar.start, r + gap);
        // A sphere that touches both ends of a short bar belongs to the first.
        if along < reach {
            ends[0].push(i);
        } else if bar.length - along < reach {
            ends[1].push(i);
        }
    }
    let names = ["particles at the first end", "particles at the second end"];
    match names.into_iter().zip(&ends).find(|(_, end)| end.is_empty()) {
        None => Ok(ends),
        Some((name, _)) => Err(Error::out_of_range(name, 0.0, "values >= 1")),
    }
}

/// Measures E and nu of a bar in a static tension test.
///
/// # Errors
/// [`Error::OutOfRange`] for the bar, or if no particle touches an end; [`Error::NoConvergence`] of the
/// solve.
pub fn tension_test(body: &BondedParticles, bar: &Bar) -> Result<Elasticity> {
    let ends = end_layers(body, bar)?;
    let mut problem = StaticProblem::free(body.len());
    // The affine displacement is nearly the solution, which saves iterations.
    for (start, x) in problem.start.iter_mut().zip(body.positions()) {
        start.linear.x = STRAIN * (x.x - bar.start);
    }
    let mut side = vec![0.0; body.len()];
    for (end, s) in ends.iter().zip([-1.0, 1.0]) {
        for &i in end {
            side[i] = s;
            problem.held[i].linear[0] = true;
        }
    }
    let solution = problem.solve(body, TOLERANCE, ITERATIONS)?;
    // Reactions of both ends, one half each: their mean has less of the residual.
    let pull: f64 = solution
        .reactions
        .iter()
        .zip(&side)
        .map(|(r, s)| 0.5 * s * r.linear.x)
        .sum();
    let gauge = |i: &usize| {
        // The middle half: strains near the ends are those of the held layer.
        let t = (body.positions()[*i].x - bar.start) / bar.length;
        (0.25..0.75).contains(&t)
    };
    let chosen: Vec<usize> = (0..body.len()).filter(gauge).collect();
    let slope = |axis: usize| {
        let points = chosen
            .iter()
            .map(|&i| (body.positions()[i], solution.displacements[i].linear[axis]));
        gradient(points).map(|g| g[axis])
    };
    let (ex, ey, ez) = (slope(0)?, slope(1)?, slope(2)?);
    Ok(Elasticity {
        young: pull / (bar.area * STRAIN),
        young_gauge: pull / (bar.area * ex),
        poisson: -0.5 * (ey + ez) / ex,
        iterations: solution.iterations,
    })
}

/// Returns the least-squares gradient of a scalar given at points.
fn gradient(points: impl Iterator<Item = (Vector3<f64>, f64)> + Clone) -> Result<Vector3<f64>> {
    let count = points.clone().count() as f64;
    // About the mean, so that the fit has no constant to find.
    let centre = points.clone().map(|p| p.0).sum::<Vector3<f64>>() / count;
    let mean = points.clone().map(|p| p.1).sum::<f64>() / count;
    let (mut a, mut b) = (Matrix3::zeros(), Vector3::zeros());
    for (x, u) in points {
        let d = x - centre;
        a += d * d.transpose();
        b += d * (u - mean);
    }
    a.try_inverse().map(|a| a * b).ok_or(Error::out_of_range(
        "particles in the gauge section",
        count,
        "at least four that are not coplanar",
    ))
}

/// Mean and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Sample standard deviation; 0 for one sample.
    pub deviation: f64,
}

impl Spread {
    /// Computes mean and deviation of several numbers.
    #[must_use]
    pub fn from_samples(x: &[f64]) -> Self {
        let n = x.len().max(1) as f64;
        let mean = x.iter().sum::<f64>() / n;
        let square: f64 = x.iter().map(|x| (x - mean) * (x - mean)).sum();
        Self {
            // One sample has no deviation, and nothing to divide by.
            mean,
            deviation: (square / (n - 1.0).max(1.0)).sqrt(),
        }
    }
}

/// Elasticity over several packings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// Young's modulus over the whole bar \[Pa\].
    pub young: Spread,
    /// Young's modulus of the gauge section \[Pa\].
    pub young_gauge: Spread,
    /// Poisson's ratio.
    pub poisson: Spread,
}

impl Statistics {
    /// Computes means and deviations of several tests.
    #[must_use]
    pub fn from_samples(tests: &[Elasticity]) -> Self {
        let spread =
            |f: fn(&Elasticity) -> f64| Spread::from_samples(&tests.iter().map(f).collect::<Vec<_>>());
        Self {
            young: spread(|e| e.young),
            young_gauge: spread(|e| e.young_gauge),
            poisson: spread(|e| e.poisson),
        }
    }

    /// Works like [`Elasticity::check_uniform`] on the means over the tests, because the gauge section of one
    /// small sample may differ by chance.
    ///
    /// # Errors
    /// [`Error::AxialWave`].
    pub fn check_uniform(&self) -> Result<()> {
        check_uniform(self.young.mean, self.young_gauge.mean)
    }
}

/// Runs tension tests on packings that differ by their seed.
///
/// # Errors
/// [`Error::SeveralParts`]; errors of [`Packing::bonded`] and [`tension_test`].
pub fn measure(packings: &[Packing], beam: BeamMaterial, bar: &Bar) -> Result<Statistics> {
    let mut tests = Vec::with_capacity(packings.len());
    for p in packings {
        p.connected("a tension test")?;
        // Statics needs no mass, so any density does.
        tests.push(tension_test(&p.bonded(beam, 1.0)?, bar)?);
    }
    Ok(Statistics::from_samples(&tests))
}

/// Beams that give packings the wanted elasticity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Beams that were found.
    pub beam: BeamMaterial,
    /// Elasticity of the packings with these beams.
    pub reached: Statistics,
    /// Number of tension tests done, all seeds together.
    pub tests: usize,
}

/// Finds `E_mu` and the beam radius ratio for a wanted E \[Pa\] and nu of bars, by [`beam_for`].
///
/// # Errors
/// Errors of [`beam_for`] and [`measure`].
pub fn inverse(
    packings: &[Packing],
    bar: &Bar,
    young: f64,
    poisson: f64,
    beam_poisson: f64,
) -> Result<Calibration> {
    // Each evaluation tests all packings; the last one measures the beams that were found.
    let mut tests = 0;
    let beam = beam_for(young, poisson, beam_poisson, |beam| {
        tests += packings.len();
        let measured = measure(packings, beam, bar)?;
        Ok([measured.young.mean, measured.poisson.mean])
    })?;
    let reached = measure(packings, beam, bar)?;
    Ok(Calibration {
        beam,
        reached,
        tests: tests + packings.len(),
    })
}

/// Beam radius ratios between which [`beam_for`] searches.
pub const RATIOS: [f64; 2] = [0.2, 1.5];
/// Tolerance of the wanted Poisson's ratio: below any spread over seeds.
const NEAR: f64 = 1e-4;

/// Finds the beams for a wanted E \[Pa\] and nu. `test` returns E \[Pa\] and nu of a sample with given beams,
/// by any method. The search relies on nu depending on the radius ratio alone and falling with it, and on E
/// being proportional to the modulus of the beams.
///
/// # Errors
/// [`Error::OutOfRange`] if E is not positive; [`Error::PoissonOutOfReach`] if nu is not between the values
/// at the ends of [`RATIOS`]; [`Error::NoConvergence`]; errors of `test`.
pub fn beam_for(
    young: f64,
    poisson: f64,
    beam_poisson: f64,
    mut test: impl FnMut(BeamMaterial) -> Result<[f64; 2]>,
) -> Result<BeamMaterial> {
    positive("wanted Young's modulus", young)?;
    finite("wanted Poisson's ratio", "target", 0, poisson)?;
    let beam = |radius_ratio: f64, young: f64| BeamMaterial {
        young,
        poisson: beam_poisson,
        radius_ratio,
    };
    // The modulus of the beams scales out: only their radius is searched for.
    let mut test = |ratio: f64| test(beam(ratio, UNIT)).map(|[e, nu]| (e, nu - poisson));
    let [mut low, mut high] = RATIOS;
    let (mut f_low, mut f_high) = (test(low)?.1, test(high)?.1);
    let bracketed = f_low * f_high <= 0.0;
    if !bracketed {
        return Err(Error::PoissonOutOfReach {
            wanted: poisson,
            thick: f_high + poisson,
            thin: f_low + poisson,
            ratios: RATIOS,
        });
    }
    // Regula falsi, Illinois variant: halving the value of an end that stays twice avoids slow convergence.
    let mut last_side = 0;
    for _ in 0..40 {
        let ratio = (low * f_high - high * f_low) / (f_high - f_low);
        let (modulus, f) = test(ratio)?;
        if f.abs() < NEAR {
            // The law is linear in the modulus, so the wanted one follows without another test.
            return Ok(beam(ratio, UNIT * young / modulus));
        }
        if f * f_high > 0.0 {
            (high, f_high) = (ratio, f);
            if last_side == 1 {
                f_low *= 0.5;
            }
            last_side = 1;
        } else {
            (low, f_low) = (ratio, f);
            if last_side == -1 {
                f_high *= 0.5;
            }
            last_side = -1;
        }
    }
    Err(Error::NoConvergence {
        what: "inverse calibration",
        iterations: 42,
        residual: f_low.abs().min(f_high.abs()),
        tolerance: NEAR,
    })
}

/// Young's modulus of the beams during the search for their radius \[Pa\]; the law is linear, so any value
/// does.
const UNIT: f64 = 1e9;

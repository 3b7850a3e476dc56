//! Strength of bars relative to that of their beams.

use super::sample::{Sample, Test};
use super::{Estimate, KEY, with_progress};
use crate::Progress;
use crate::error::{Result, key};
use crate::setup::filling::dem;
use crate::spec::CriterionKind;
use arlequin::dem_beam::calibrate::Spread;
use arlequin::dem_beam::packing::Packing;
use arlequin::dem_beam::strength::{Strength, strength_test};
use arlequin::dem_beam::{Criterion, Fracture, Scatter};
use serde::Serialize;

/// Default strength of the beams \[Pa\]; ratios do not depend on it.
const BEAMS: f64 = 200e6;

/// All criteria with their names.
const ALL: [(CriterionKind, &str); 6] = [
    (CriterionKind::Axial, "axial"),
    (CriterionKind::Rankine, "rankine"),
    (CriterionKind::Mises, "mises"),
    (CriterionKind::Energy, "energy"),
    (CriterionKind::TensileEnergy, "tensile-energy"),
    (CriterionKind::Hydrostatic, "hydrostatic"),
];

/// Settings of a strength test.
#[derive(Debug, Clone, Default)]
pub struct StrengthTest {
    /// Failure criteria of the beams; all if empty.
    pub criteria: Vec<CriterionKind>,
    /// Strength of the beams \[Pa\]; ratios do not depend on it.
    pub beam_strength: Option<f64>,
    /// Weibull modulus of the scatter of strengths between beams.
    pub weibull: Option<f64>,
    /// Mean diameters of the spheres \[m\] at which bars are pulled. `None`: that of the elastic test.
    pub sizes: Option<Vec<f64>>,
}

/// Results of a strength test.
#[derive(Debug, Clone, Serialize)]
pub struct Strengths {
    /// Strength of the beams \[Pa\].
    pub beam_strength: f64,
    /// Energy per section of the beams \[J/m²\], used by the criterion `energy`.
    pub beam_energy: f64,
    /// Weibull modulus of the scatter between bonds, if there is one.
    pub weibull: Option<f64>,
    /// Results, one row per criterion and size.
    pub rows: Vec<SizeStrength>,
    /// Exponent of the strength over the mean diameter, by criterion; only with several sizes.
    pub exponents: Vec<Exponent>,
}

/// Strength for one criterion at one size.
#[derive(Debug, Clone, Serialize)]
pub struct SizeStrength {
    /// Criterion.
    pub criterion: &'static str,
    /// Mean diameter \[m\].
    pub diameter: f64,
    /// Number of spheres of the first packing.
    pub spheres: usize,
    /// Strength of the bar \[Pa\].
    pub body: Estimate,
    /// Strength of the beams over that of the bar.
    pub ratio: Estimate,
    /// Stress at the first broken bond over the strength of the bar.
    pub first: Estimate,
    /// Mean strain at the largest stress.
    pub strain: Estimate,
    /// Share of bonds that are broken at the largest stress.
    pub broken: Estimate,
}

/// Size effect: the strength of a bar is proportional to a power of the mean diameter.
#[derive(Debug, Clone, Serialize)]
pub struct Exponent {
    /// Criterion.
    pub criterion: &'static str,
    /// Power of the mean diameter.
    pub power: f64,
}

/// Pulls the bars of every size with every criterion.
pub(super) fn test_strength(
    asked: &StrengthTest,
    mut sizes: Vec<(Sample, Vec<Packing>)>,
    progress: Progress<'_>,
) -> Result<Strengths> {
    // The elastic tests, which come first, need whole bars.
    for (sample, packings) in &mut sizes {
        for p in packings {
            sample.cut(p)?;
        }
    }
    let strength = asked.beam_strength.unwrap_or(BEAMS);
    let mean = |p: &Packing| 2.0 * p.report.mean_radius;
    // Elastic energy per section of a beam one mean diameter long at the axial stress `strength`. It is the
    // same for all sizes, as a material constant would be.
    let energy = strength * strength * mean(&sizes[0].1[0]) / (2.0 * sizes[0].0.beam.young);
    let mut rows = Vec::new();
    let chosen = ALL
        .iter()
        .filter(|(kind, _)| asked.criteria.is_empty() || asked.criteria.contains(kind));
    for (kind, name) in chosen {
        for (sample, packings) in &sizes {
            let (criterion, strength) = match kind {
                CriterionKind::Axial => (Criterion::Axial, strength),
                CriterionKind::Rankine => (Criterion::Rankine, strength),
                CriterionKind::Mises => (Criterion::Mises, strength),
                CriterionKind::Energy => (Criterion::Energy, energy),
                CriterionKind::TensileEnergy => (Criterion::TensileEnergy, energy),
                CriterionKind::Hydrostatic => (Criterion::Hydrostatic, strength),
            };
            let fracture = Fracture {
                scatter: asked
                    .weibull
                    .map_or(Scatter::None, |modulus| Scatter::Weibull { modulus }),
                ..Fracture::new(criterion, strength)
            };
            let tests = pull(sample, packings, fracture, name, progress)?;
            let spread = |f: &dyn Fn(&Strength) -> f64| {
                Estimate::from(Spread::from_samples(&tests.iter().map(f).collect::<Vec<_>>()))
            };
            let diameters: Vec<f64> = packings.iter().map(mean).collect();
            rows.push(SizeStrength {
                criterion: name,
                diameter: Spread::from_samples(&diameters).mean,
                spheres: packings[0].report.placed,
                body: spread(&|s| s.peak),
                ratio: spread(&Strength::ratio),
                first: spread(&|s| s.first / s.peak),
                strain: spread(&|s| s.strain),
                broken: spread(&|s| s.broken as f64 / s.bonds as f64),
            });
        }
    }
    Ok(Strengths {
        beam_strength: strength,
        beam_energy: energy,
        weibull: asked.weibull,
        exponents: exponents(&rows),
        rows,
    })
}

fn pull(
    sample: &Sample,
    packings: &[Packing],
    fracture: Fracture,
    name: &str,
    progress: Progress<'_>,
) -> Result<Vec<Strength>> {
    let Test::Tension(bar) = &sample.test else {
        return Err(key(KEY, "strength is that of a bar; remove --periodic"));
    };
    with_progress(packings.iter(), &format!("bars by {name}"), progress, |p| {
        strength_test(p, sample.beam, bar, fracture).map_err(dem(&sample.key))
    })
}

/// Slope of log strength over log diameter, by least squares.
fn exponents(rows: &[SizeStrength]) -> Vec<Exponent> {
    let slope = |name: &'static str| {
        let points: Vec<[f64; 2]> = rows
            .iter()
            .filter(|r| r.criterion == name)
            .map(|r| [r.diameter.ln(), r.body.mean.ln()])
            .collect();
        // Least squares in logarithms: the slope is the exponent of a power law.
        let n = points.len() as f64;
        let mean = |c: usize| points.iter().map(|p| p[c]).sum::<f64>() / n;
        let (x, y) = (mean(0), mean(1));
        let across: f64 = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
        let along: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
        // A single size has no slope.
        (along > 0.0).then(|| Exponent {
            criterion: name,
            power: across / along,
        })
    };
    ALL.iter().filter_map(|(_, name)| slope(name)).collect()
}

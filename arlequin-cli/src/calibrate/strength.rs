//! `arlequin calibrate --strength`: the strength of bars over that of their beams.

use super::sample::{Sample, Test};
use super::{Bar, Calibrate, KEY};
use crate::error::{Result, key, value};
use crate::report;
use arlequin::dem_beam::calibrate::Spread;
use arlequin::dem_beam::packing::Packing;
use arlequin::dem_beam::strength::{Strength, strength_test};
use arlequin::dem_beam::{Criterion, Fracture, Scatter};
use arlequin_scene::Source;
use arlequin_scene::setup::filling::dem;
use arlequin_scene::spec::CriterionKind;
use serde::Serialize;

/// Strength of the beams \[Pa\] unless one is given; ratios do not depend on it.
const BEAMS: f64 = 200e6;

/// All criteria with their names.
const ALL: [(CriterionKind, &str); 4] = [
    (CriterionKind::Axial, "axial"),
    (CriterionKind::Rankine, "rankine"),
    (CriterionKind::Mises, "mises"),
    (CriterionKind::Energy, "energy"),
];

/// What the bars showed.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Strengths {
    /// Strength of the beams \[Pa\].
    beam_strength: f64,
    /// Energy per section of the beams for the criterion of that name \[J/m²\].
    beam_energy: f64,
    /// Weibull modulus of the scatter between bonds, if there is one.
    weibull: Option<f64>,
    /// One per criterion and size.
    rows: Vec<Row>,
    /// Power of the mean diameter with which the strength of the body goes, by criterion; with several sizes.
    exponents: Vec<Exponent>,
}

/// One criterion at one size.
#[derive(Debug, Clone, Serialize)]
struct Row {
    criterion: &'static str,
    /// Mean diameter \[m\].
    diameter: f64,
    /// Spheres of the first packing.
    spheres: usize,
    /// Strength of the body \[Pa\].
    body: Bar,
    /// Strength of the beams over that of the body.
    ratio: Bar,
    /// Stress at the first broken bond over the strength.
    first: Bar,
    /// Mean strain at the peak.
    strain: Bar,
    /// Share of the bonds that are broken at the peak.
    broken: Bar,
}

#[derive(Debug, Clone, Serialize)]
struct Exponent {
    criterion: &'static str,
    power: f64,
}

/// Pulls bars of every size by every criterion; `sample` and `packings` are those of the elasticity.
pub(super) fn of(
    wanted: &Calibrate,
    source: Option<&Source>,
    sample: &Sample,
    packings: &[Packing],
) -> Result<Option<Strengths>> {
    if !wanted.strength {
        return Ok(None);
    }
    let mut sizes: Vec<(Sample, Vec<Packing>)> = Vec::new();
    match &wanted.sizes {
        None => sizes.push((sample.clone(), packings.to_vec())),
        Some(all) => {
            for &d in all {
                let one = Calibrate {
                    spacing: Some(d),
                    count: None,
                    ..wanted.clone()
                };
                let sample = Sample::of(&one, source)?;
                let packings = super::pack(&sample)?;
                sizes.push((sample, packings));
            }
        }
    }
    for (sample, packings) in &mut sizes {
        for p in packings {
            sample.cut(p)?;
        }
    }
    let strength = wanted.beam_strength.unwrap_or(BEAMS);
    let mean = |p: &Packing| 2.0 * p.report.mean_radius;
    let energy = strength * strength * mean(&sizes[0].1[0]) / (2.0 * sample.beam.young);
    let mut rows = Vec::new();
    let chosen = ALL
        .iter()
        .filter(|(kind, _)| wanted.criterion.is_empty() || wanted.criterion.contains(kind));
    for (kind, name) in chosen {
        for (sample, packings) in &sizes {
            let (criterion, strength) = match kind {
                CriterionKind::Axial => (Criterion::Axial, strength),
                CriterionKind::Rankine => (Criterion::Rankine, strength),
                CriterionKind::Mises => (Criterion::Mises, strength),
                CriterionKind::Energy => (Criterion::Energy, energy),
            };
            let fracture = Fracture {
                scatter: wanted
                    .weibull
                    .map_or(Scatter::None, |modulus| Scatter::Weibull { modulus }),
                ..Fracture::new(criterion, strength)
            };
            let found = pull(sample, packings, fracture, name)?;
            let spread = |f: &dyn Fn(&Strength) -> f64| {
                Bar::from(Spread::of(&found.iter().map(f).collect::<Vec<_>>()))
            };
            let diameters: Vec<f64> = packings.iter().map(mean).collect();
            rows.push(Row {
                criterion: name,
                diameter: Spread::of(&diameters).mean,
                spheres: packings[0].report.placed,
                body: spread(&|s| s.peak),
                ratio: spread(&Strength::ratio),
                first: spread(&|s| s.first / s.peak),
                strain: spread(&|s| s.strain),
                broken: spread(&|s| s.broken as f64 / s.bonds as f64),
            });
        }
    }
    Ok(Some(Strengths {
        beam_strength: strength,
        beam_energy: energy,
        weibull: wanted.weibull,
        exponents: exponents(&rows),
        rows,
    }))
}

fn pull(sample: &Sample, packings: &[Packing], fracture: Fracture, name: &str) -> Result<Vec<Strength>> {
    let Test::Tension(bar) = &sample.test else {
        return Err(key(KEY, "strength is that of a bar; remove --periodic"));
    };
    let progress = report::Progress::over(packings.len(), &format!("bars by {name}"));
    let mut out = Vec::with_capacity(packings.len());
    for (k, p) in packings.iter().enumerate() {
        out.push(strength_test(p, sample.beam, bar, fracture).map_err(dem(&sample.key))?);
        progress.set(k + 1);
    }
    Ok(out)
}

/// Slopes of the logarithms by least squares.
fn exponents(rows: &[Row]) -> Vec<Exponent> {
    let slope = |name: &'static str| {
        let points: Vec<[f64; 2]> = rows
            .iter()
            .filter(|r| r.criterion == name)
            .map(|r| [r.diameter.ln(), r.body.mean.ln()])
            .collect();
        let n = points.len() as f64;
        let mean = |c: usize| points.iter().map(|p| p[c]).sum::<f64>() / n;
        let (x, y) = (mean(0), mean(1));
        let across: f64 = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
        let along: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
        (along > 0.0).then(|| Exponent {
            criterion: name,
            power: across / along,
        })
    };
    ALL.iter().filter_map(|(_, name)| slope(name)).collect()
}

impl Strengths {
    /// Lines of the table.
    pub(super) fn text(&self) -> Vec<String> {
        let scatter = self
            .weibull
            .map_or("no scatter".to_owned(), |m| format!("Weibull modulus {m}"));
        let mut out = vec![
            format!(
                "strength   of beams {:.4e} Pa ({:.4e} J/m2 by energy), {scatter}; bars pulled until they break",
                self.beam_strength, self.beam_energy
            ),
            format!(
                "{:>10} {:>9} {:>8} {:>22} {:>16} {:>16} {:>9} {:>8}",
                "criterion",
                "d [m]",
                "spheres",
                "bar [Pa]",
                "beams over bar",
                "first over peak",
                "strain",
                "broken"
            ),
        ];
        out.extend(self.rows.iter().map(|r| {
            format!(
                "{:>10} {:>9.3e} {:>8} {:>11.4e} ± {:>8.1e} {:>7.3} ± {:>6.3} {:>7.3} ± {:>6.3} {:>9.3e} {:>6.2} %",
                r.criterion,
                r.diameter,
                r.spheres,
                r.body.mean,
                r.body.deviation,
                r.ratio.mean,
                r.ratio.deviation,
                r.first.mean,
                r.first.deviation,
                r.strain.mean,
                100.0 * r.broken.mean
            )
        }));
        let power = |e: &Exponent| {
            format!(
                "{:>10} goes as the diameter to the power {:+.2}",
                e.criterion, e.power
            )
        };
        out.extend(self.exponents.iter().map(power));
        out
    }
}

impl Calibrate {
    /// Refuses flags of the strength that make no sense.
    pub(super) fn check_strength(&self) -> Result<()> {
        if !self.strength {
            return Ok(());
        }
        if self.periodic {
            return Err(key(
                KEY,
                "strength is that of a bar; remove --periodic or --strength",
            ));
        }
        let one = |x: Option<f64>| x.into_iter().collect::<Vec<f64>>();
        let positive = [
            ("--beam-strength", one(self.beam_strength)),
            ("--weibull", one(self.weibull)),
            ("--sizes", self.sizes.clone().unwrap_or_default()),
        ];
        for (name, numbers) in positive {
            if let Some(x) = numbers.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
                return Err(value(name, x, "must be a positive number"));
            }
        }
        Ok(())
    }
}

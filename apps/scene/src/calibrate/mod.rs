//! Macroscopic E and nu of a packing and its beams, with the spread over seeds, and the inverse.

mod sample;
mod strength;

use crate::Progress;
use crate::Source;
use crate::error::Result;
use crate::output::packing::PackingLine;
use crate::setup::filling::dem;
use crate::spec::Protocol;
use arlequin::dem_beam::calibrate::{Elasticity, Spread, Statistics, beam_for, tension_test};
use arlequin::dem_beam::homogenise::{Bulk, BulkStatistics, bulk};
use arlequin::dem_beam::{BeamMaterial, Packing};
use sample::{Sample, Test};
use serde::Serialize;
pub use strength::{Exponent, SizeStrength, StrengthTest, Strengths};

/// Key of errors that no scene is to blame for.
const KEY: &str = "calibrate";

/// What to measure, and on what. Without a scene a cylinder, a box or a periodic sample is needed.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Model of the scene; its only one of kind "dem" if none.
    pub model: Option<String>,
    /// Changes of the scene.
    pub set: Vec<String>,
    /// Length and radius of a cylinder along x \[m\].
    pub cylinder: Option<[f64; 2]>,
    /// Lengths of a box \[m\].
    pub cuboid: Option<[f64; 3]>,
    /// A periodic sample of the bulk: no walls, six unit strains.
    pub periodic: bool,
    /// Number of spheres.
    pub count: Option<usize>,
    /// Mean diameter of the spheres \[m\], in place of their number.
    pub spacing: Option<f64>,
    /// Bonds per particle times two.
    pub coordination: Option<f64>,
    /// How the packing is compacted.
    pub protocol: Option<Protocol>,
    /// Young's modulus of the beams \[Pa\].
    pub young: Option<f64>,
    /// Poisson's ratio of the beams.
    pub poisson: Option<f64>,
    /// Beam radius over mean particle radius.
    pub radius_ratio: Option<f64>,
    /// Young's modulus \[Pa\] and Poisson's ratio that beams are to be found for.
    pub target: Option<[f64; 2]>,
    /// Pull the bars until they break.
    pub strength: Option<StrengthTest>,
    /// Number of packings, which differ by their seed.
    pub seeds: u64,
}

/// Mean and sample standard deviation over the seeds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// Sample standard deviation.
    pub deviation: f64,
}

impl From<Spread> for Estimate {
    fn from(s: Spread) -> Self {
        Self {
            mean: s.mean,
            deviation: s.deviation,
        }
    }
}

/// Beams of a result.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Beams {
    /// Young's modulus \[Pa\].
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Radius over mean particle radius.
    pub radius_ratio: f64,
}

impl From<BeamMaterial> for Beams {
    fn from(b: BeamMaterial) -> Self {
        Self {
            young: b.young,
            poisson: b.poisson,
            radius_ratio: b.radius_ratio,
        }
    }
}

/// One packing and what its test shows.
#[derive(Debug, Clone, Serialize)]
pub struct PackingTest {
    /// None for spheres from a file.
    pub seed: Option<u64>,
    /// Spheres placed.
    pub spheres: usize,
    /// Loose ones left out.
    pub dropped: usize,
    /// Bonds per particle times two, of all.
    pub coordination_all: f64,
    /// Of those kept.
    pub coordination_retained: f64,
    /// None where no sphere is far enough from the walls.
    pub coordination_interior: Option<f64>,
    /// Volume fraction.
    pub volume_fraction: f64,
    /// Mean overlap over mean radius.
    pub mean_overlap: f64,
    /// Young's modulus \[Pa\].
    pub young: f64,
    /// That of the middle; of bars only.
    pub young_gauge: Option<f64>,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Of periodic samples only.
    pub anisotropy: Option<f64>,
}

/// Means and spreads over the packings.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Elastic {
    /// Young's modulus \[Pa\].
    pub young: Estimate,
    /// That of the middle; of bars only.
    pub young_gauge: Option<Estimate>,
    /// Poisson's ratio.
    pub poisson: Estimate,
    /// Of periodic samples only.
    pub anisotropy: Option<Estimate>,
}

/// The inverse.
#[derive(Debug, Clone, Serialize)]
pub struct Target {
    /// Young's modulus asked for \[Pa\].
    pub young: f64,
    /// Poisson's ratio asked for.
    pub poisson: f64,
    /// Beams found.
    pub beams: Beams,
    /// What they give.
    pub reached: Elastic,
}

/// What packings and their beams are as a material.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// What was tested, in words.
    pub sample: String,
    /// Its beams.
    pub beams: Beams,
    /// Its packings.
    pub packings: Vec<PackingTest>,
    /// Their means.
    #[serde(flatten)]
    pub elastic: Elastic,
    /// Beams for given constants, if asked for.
    pub target: Option<Target>,
    /// Strength of the bars, if asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strength: Option<Strengths>,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// Why the result must not be used, if so.
    pub refused: Option<String>,
}

/// A test of any kind.
enum Found {
    Bars(Vec<Elasticity>),
    Bulk(Vec<Bulk>),
}

impl Found {
    fn elastic(&self) -> Elastic {
        match self {
            Self::Bars(tests) => {
                let s = Statistics::of(tests);
                Elastic {
                    young: s.young.into(),
                    young_gauge: Some(s.young_gauge.into()),
                    poisson: s.poisson.into(),
                    anisotropy: None,
                }
            }
            Self::Bulk(tests) => {
                let s = BulkStatistics::of(tests);
                Elastic {
                    young: s.young.into(),
                    young_gauge: None,
                    poisson: s.poisson.into(),
                    anisotropy: Some(s.anisotropy.into()),
                }
            }
        }
    }

    /// E, E of the gauge section, nu and anisotropy of one packing.
    fn line(&self, k: usize) -> (f64, Option<f64>, f64, Option<f64>) {
        match self {
            Self::Bars(t) => (t[k].young, Some(t[k].young_gauge), t[k].poisson, None),
            Self::Bulk(t) => (t[k].young, None, t[k].poisson, Some(t[k].anisotropy)),
        }
    }
}

/// Packs and tests what is wanted, in the scene of `source` if there is one.
///
/// # Errors
/// Samples that cannot be made or tested, by their keys in the scene or their options.
pub fn calibrate(wanted: &Wanted, source: Option<&Source>, progress: Progress<'_>) -> Result<Calibration> {
    let sample = Sample::of(wanted, source)?;
    let beam = sample.beam;
    let packings = pack(&sample, progress)?;
    let found = test(&sample, &packings, beam, "testing", progress)?;
    let mut out = Calibration {
        sample: sample.text.clone(),
        beams: beam.into(),
        packings: lines(&sample, &packings, &found),
        elastic: found.elastic(),
        target: None,
        strength: None,
        warnings: PackingLine::of(&packings[0], 1.0, None).warnings(),
        refused: None,
    };
    uniform(&found, &mut out);
    if out.refused.is_some() {
        return Ok(out);
    }
    if let Some([young, poisson]) = wanted.target {
        let mut trial = 0;
        let beams = beam_for(young, poisson, beam.poisson, |b| {
            trial += 1;
            let tests = run(&sample.test, &packings, b, &format!("trial {trial}"), progress)?;
            let e = tests.elastic();
            Ok([e.young.mean, e.poisson.mean])
        })
        .map_err(dem(&sample.key))?;
        let reached = test(&sample, &packings, beams, "checking", progress)?.elastic();
        out.target = Some(Target {
            young,
            poisson,
            beams: beams.into(),
            reached,
        });
    }
    if let Some(asked) = &wanted.strength {
        out.strength = Some(strength::of(
            asked,
            wanted,
            source,
            (&sample, &packings),
            progress,
        )?);
    }
    Ok(out)
}

/// Says where the middle of a bar differs from the whole: for one packing a warning, for the mean a refusal.
fn uniform(found: &Found, out: &mut Calibration) {
    let Found::Bars(tests) = found else { return };
    for (line, test) in out.packings.iter().zip(tests) {
        if let Err(e) = test.check_uniform() {
            let which = line.seed.map_or("the file".to_owned(), |s| format!("seed {s}"));
            out.warnings.push(format!("{which}: {e}"));
        }
    }
    out.refused = Statistics::of(tests).check_uniform().err().map(|e| e.to_string());
}

fn pack(sample: &Sample, progress: Progress<'_>) -> Result<Vec<Packing>> {
    let all = sample.recipes.iter().map(|r| &r.1);
    let out = each(all, "packings", progress, |r| r.clone().packing(&sample.key))?;
    sample.check(&out)?;
    Ok(out)
}

fn test(
    sample: &Sample,
    packings: &[Packing],
    beam: BeamMaterial,
    what: &str,
    progress: Progress<'_>,
) -> Result<Found> {
    run(&sample.test, packings, beam, what, progress).map_err(dem(&sample.key))
}

fn run(
    test: &Test,
    packings: &[Packing],
    beam: BeamMaterial,
    what: &str,
    progress: Progress<'_>,
) -> arlequin::dem_beam::Result<Found> {
    match test {
        Test::Tension(shape) => each(packings.iter(), what, progress, |p| {
            p.connected("a tension test")?;
            // Statics does not ask for a density.
            tension_test(&p.bonded(beam, 1.0)?, shape)
        })
        .map(Found::Bars),
        Test::Bulk => each(packings.iter(), what, progress, |p| bulk(p, beam)).map(Found::Bulk),
    }
}

/// Works through a list and tells of it.
fn each<T, R, E>(
    items: impl ExactSizeIterator<Item = T>,
    what: &str,
    progress: Progress<'_>,
    mut work: impl FnMut(T) -> Result<R, E>,
) -> Result<Vec<R>, E> {
    let count = items.len();
    progress(what, 0, count);
    let done = items.enumerate().map(|(k, item)| {
        let made = work(item);
        progress(what, k + 1, count);
        made
    });
    done.collect()
}

fn lines(sample: &Sample, packings: &[Packing], found: &Found) -> Vec<PackingTest> {
    let all = sample.recipes.iter().zip(packings).enumerate();
    all.map(|(k, ((seed, _), p))| {
        let r = &p.report;
        let (young, young_gauge, poisson, anisotropy) = found.line(k);
        PackingTest {
            seed: *seed,
            spheres: r.placed,
            dropped: r.dropped,
            coordination_all: r.coordination_all,
            coordination_retained: r.coordination_retained,
            coordination_interior: (r.coordination_interior > 0.0).then_some(r.coordination_interior),
            volume_fraction: r.volume_fraction,
            mean_overlap: r.mean_overlap,
            young,
            young_gauge,
            poisson,
            anisotropy,
        }
    })
    .collect()
}

//! Measures Young's modulus and Poisson's ratio of a packing with its beams, with the spread over seeds, and
//! finds beams for given constants.

mod sample;
mod strength;
mod strip;
mod toughness;

use crate::Progress;
use crate::error::Result;
use crate::scene::Source;
use crate::setup::filling::dem;
use crate::setup::packing::PackingLine;
use crate::spec::Protocol;
use arlequin::dem_beam::calibrate::{Elasticity, Spread, Statistics, beam_for, tension_test};
use arlequin::dem_beam::homogenise::{Bulk, BulkStatistics, bulk};
use arlequin::dem_beam::packing::LOOSE_LIMIT;
use arlequin::dem_beam::{BeamMaterial, Packing};
use sample::{Sample, Test};
use serde::Serialize;
pub use strength::{Exponent, SizeStrength, StrengthTest, Strengths};
pub use toughness::{StripTest, ToughnessResult, ToughnessTest};

/// Key in errors that concern no scene.
const KEY: &str = "calibrate";

/// Settings of a calibration. Without a scene, one of `cylinder`, `cuboid` and `periodic` is needed; with a
/// scene, they replace its shape.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Name of the model in the scene. `None`: its only model of kind "dem".
    pub model: Option<String>,
    /// Changes of the scene, as assignments.
    pub set: Vec<String>,
    /// Length and radius of a cylinder along x \[m\].
    pub cylinder: Option<[f64; 2]>,
    /// Lengths of a box \[m\].
    pub cuboid: Option<[f64; 3]>,
    /// True for a periodic sample of the bulk: no walls, six unit strains.
    pub periodic: bool,
    /// Number of spheres.
    pub count: Option<usize>,
    /// Mean diameter of the spheres \[m\], instead of their number.
    pub spacing: Option<f64>,
    /// Coordination: bonds per particle times two.
    pub coordination: Option<f64>,
    /// Packing procedure.
    pub protocol: Option<Protocol>,
    /// Young's modulus of the beams \[Pa\].
    pub young: Option<f64>,
    /// Poisson's ratio of the beams.
    pub poisson: Option<f64>,
    /// Beam radius over mean particle radius.
    pub radius_ratio: Option<f64>,
    /// Target: Young's modulus \[Pa\] and Poisson's ratio for which beams are to be found.
    pub target: Option<[f64; 2]>,
    /// Settings of a strength test, if bars are to be pulled until they break.
    pub strength: Option<StrengthTest>,
    /// Settings of a toughness test, if a crack is to run through strips; excludes `strength`.
    pub toughness: Option<ToughnessTest>,
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

/// Beams of a packing.
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

/// One packing and the results of its test.
#[derive(Debug, Clone, Serialize)]
pub struct PackingTest {
    /// Seed of the packing; `None` for spheres from a file.
    pub seed: Option<u64>,
    /// Number of spheres placed.
    pub spheres: usize,
    /// Number of loose spheres left out.
    pub dropped: usize,
    /// Coordination of all spheres.
    pub coordination_all: f64,
    /// Coordination of the spheres that were kept.
    pub coordination_retained: f64,
    /// Coordination of the spheres far from the walls; `None` if there are none.
    pub coordination_interior: Option<f64>,
    /// Volume fraction.
    pub volume_fraction: f64,
    /// Mean overlap over mean radius.
    pub mean_overlap: f64,
    /// Young's modulus \[Pa\].
    pub young: f64,
    /// Young's modulus of the middle of the bar \[Pa\]; `None` for periodic samples.
    pub young_gauge: Option<f64>,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Anisotropy; for periodic samples only.
    pub anisotropy: Option<f64>,
}

/// Means and spreads over the packings.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Elastic {
    /// Young's modulus \[Pa\].
    pub young: Estimate,
    /// Young's modulus of the middle of the bars \[Pa\]; `None` for periodic samples.
    pub young_gauge: Option<Estimate>,
    /// Poisson's ratio.
    pub poisson: Estimate,
    /// Anisotropy; for periodic samples only.
    pub anisotropy: Option<Estimate>,
}

/// Beams found for given constants.
#[derive(Debug, Clone, Serialize)]
pub struct Target {
    /// Young's modulus asked for \[Pa\].
    pub young: f64,
    /// Poisson's ratio asked for.
    pub poisson: f64,
    /// Beams that were found.
    pub beams: Beams,
    /// Constants that these beams give.
    pub reached: Elastic,
}

/// Results of a calibration.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// Sample in words.
    pub sample: String,
    /// Remarks on what is tested in place of the scene's own shape and beams.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Beams of the sample.
    pub beams: Beams,
    /// Packings of the sample, with their tests.
    pub packings: Vec<PackingTest>,
    /// Means over the packings.
    #[serde(flatten)]
    pub elastic: Elastic,
    /// Beams for given constants, if asked for.
    pub target: Option<Target>,
    /// Strength of the bars, if asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strength: Option<Strengths>,
    /// Toughness of the strips, if asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub toughness: Option<ToughnessResult>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Reason why the result must not be used, if any.
    pub refused: Option<String>,
}

/// Results of the tests of all packings.
enum TestResults {
    Bars(Vec<Elasticity>),
    Bulk(Vec<Bulk>),
}

impl TestResults {
    fn elastic(&self) -> Elastic {
        match self {
            Self::Bars(tests) => {
                let s = Statistics::from_samples(tests);
                Elastic {
                    young: s.young.into(),
                    young_gauge: Some(s.young_gauge.into()),
                    poisson: s.poisson.into(),
                    anisotropy: None,
                }
            }
            Self::Bulk(tests) => {
                let s = BulkStatistics::from_samples(tests);
                Elastic {
                    young: s.young.into(),
                    young_gauge: None,
                    poisson: s.poisson.into(),
                    anisotropy: Some(s.anisotropy.into()),
                }
            }
        }
    }

    /// Returns E, E of the middle, nu and anisotropy of one packing.
    fn line(&self, k: usize) -> (f64, Option<f64>, f64, Option<f64>) {
        match self {
            Self::Bars(t) => (t[k].young, Some(t[k].young_gauge), t[k].poisson, None),
            Self::Bulk(t) => (t[k].young, None, t[k].poisson, Some(t[k].anisotropy)),
        }
    }
}

/// Packs and tests the samples, from the scene of `source` if there is one.
///
/// # Errors
/// Samples that cannot be made or tested; errors name the key in the scene or the option.
pub fn calibrate(wanted: &Wanted, source: Option<&Source>, progress: Progress<'_>) -> Result<Calibration> {
    let sample = Sample::from_options(wanted, source)?;
    let beam = sample.beam;
    // Read before anything is packed, so that a size that does not fit is refused at once.
    let sizes = wanted.strength.as_ref().and_then(|s| s.sizes.as_ref());
    let sizes = sizes.map(|all| {
        all.iter()
            .map(|d| sample.with_spacing(*d))
            .collect::<Result<Vec<_>>>()
    });
    let sizes = sizes.transpose()?;
    let packings = pack(&sample, progress)?;
    let results = test(&sample, &packings, beam, "testing", progress)?;
    let mut out = Calibration {
        sample: sample.text.clone(),
        notes: sample.notes.clone(),
        beams: beam.into(),
        packings: lines(&sample, &packings, &results),
        elastic: results.elastic(),
        target: None,
        strength: None,
        toughness: None,
        warnings: PackingLine::from_packing(&packings[0], 1.0, None).warnings(),
        refused: None,
    };
    uniform(&results, &mut out);
    if wanted.strength.is_some() && wanted.target.is_none() && wanted.toughness.is_none() {
        // The strength of the beams over that of the bar does not depend on the modulus.
        out.warnings.extend(out.refused.take());
    }
    // Beams fitted to a refused modulus would be wrong as well.
    if out.refused.is_some() {
        return Ok(out);
    }
    if let Some([young, poisson]) = wanted.target {
        let mut trial = 0;
        // The packings stay: only constants of the beams change between trials.
        let beams = beam_for(young, poisson, beam.poisson, |b| {
            trial += 1;
            let tests = run(&sample.test, &packings, b, &format!("trial {trial}"), progress)?;
            let e = tests.elastic();
            Ok([e.young.mean, e.poisson.mean])
        })
        .map_err(dem(&sample.key))?;
        // The search knows means only; this test gives the spreads.
        let reached = test(&sample, &packings, beams, "checking", progress)?.elastic();
        out.target = Some(Target {
            young,
            poisson,
            beams: beams.into(),
            reached,
        });
    }
    if let (Some(asked), TestResults::Bars(bars)) = (&wanted.toughness, &results) {
        let test = toughness::test_toughness(asked, &sample, &packings, (bars, &out.elastic), progress)?;
        out.warnings.extend(test.warnings(asked));
        out.toughness = Some(test);
    }
    // Last, since the bars get their notches there, and all other tests need whole bars.
    if let Some(asked) = &wanted.strength {
        let bars = match sizes {
            None => vec![(sample, packings)],
            Some(sized) => {
                let packed = |s: Sample| pack(&s, progress).map(|packings| (s, packings));
                sized.into_iter().map(packed).collect::<Result<_>>()?
            }
        };
        out.strength = Some(strength::test_strength(asked, bars, progress)?);
    }
    Ok(out)
}

/// Warns of bars whose middle differs from the whole, and refuses the result if their mean does.
fn uniform(results: &TestResults, out: &mut Calibration) {
    let TestResults::Bars(tests) = results else { return };
    for (line, test) in out.packings.iter().zip(tests) {
        if let Err(e) = test.check_uniform() {
            let which = line.seed.map_or("the file".to_owned(), |s| format!("seed {s}"));
            out.warnings.push(format!("{which}: {e}"));
        }
    }
    out.refused = Statistics::from_samples(tests)
        .check_uniform()
        .err()
        .map(|e| e.to_string());
}

fn pack(sample: &Sample, progress: Progress<'_>) -> Result<Vec<Packing>> {
    let recipes = sample.recipes.iter().map(|r| &r.1);
    with_progress(recipes, "packings", progress, |r| {
        let mut packing = r.clone().packing(&sample.key, &mut |_| ())?;
        // A few spheres that hang on each other alone would make the static system singular.
        packing.keep_largest_part(LOOSE_LIMIT);
        Ok(packing)
    })
}

fn test(
    sample: &Sample,
    packings: &[Packing],
    beam: BeamMaterial,
    what: &str,
    progress: Progress<'_>,
) -> Result<TestResults> {
    run(&sample.test, packings, beam, what, progress).map_err(dem(&sample.key))
}

fn run(
    test: &Test,
    packings: &[Packing],
    beam: BeamMaterial,
    what: &str,
    progress: Progress<'_>,
) -> arlequin::dem_beam::Result<TestResults> {
    match test {
        Test::Tension(shape) | Test::Strip(shape, ..) => {
            with_progress(packings.iter(), what, progress, |p| {
                // A loose piece would make the static system singular.
                p.connected("a tension test")?;
                // Statics does not use the density.
                tension_test(&p.bonded(beam, 1.0)?, shape)
            })
            .map(TestResults::Bars)
        }
        Test::Bulk => {
            with_progress(packings.iter(), what, progress, |p| bulk(p, beam)).map(TestResults::Bulk)
        }
    }
}

/// Calls `work` for each item of a list and reports the progress.
fn with_progress<T, R, E>(
    items: impl ExactSizeIterator<Item = T>,
    what: &str,
    progress: Progress<'_>,
    mut work: impl FnMut(T) -> Result<R, E>,
) -> Result<Vec<R>, E> {
    let count = items.len();
    progress(what, 0, count);
    let done = items.enumerate().map(|(k, item)| {
        let result = work(item);
        progress(what, k + 1, count);
        result
    });
    done.collect()
}

fn lines(sample: &Sample, packings: &[Packing], results: &TestResults) -> Vec<PackingTest> {
    let tested = sample.recipes.iter().zip(packings).enumerate();
    tested
        .map(|(k, ((seed, _), p))| {
            let r = &p.report;
            let (young, young_gauge, poisson, anisotropy) = results.line(k);
            PackingTest {
                seed: *seed,
                spheres: r.placed,
                dropped: r.dropped,
                coordination_all: r.coordination_all,
                coordination_retained: r.coordination_retained,
                // The report has zero if no sphere is far from the walls.
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

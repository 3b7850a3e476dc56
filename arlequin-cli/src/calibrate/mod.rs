//! `arlequin calibrate`: macroscopic E and nu of a packing and its beams, with the spread over seeds, and the inverse.

mod sample;
mod strength;
mod table;

use crate::error::{Error, Result, key, value};
use crate::report;
use arlequin::dem_beam::calibrate::{Elasticity, Spread, Statistics, beam_for, tension_test};
use arlequin::dem_beam::homogenise::{Bulk, BulkStatistics, bulk};
use arlequin::dem_beam::{BeamMaterial, Packing};
use arlequin_scene::Source;
use arlequin_scene::output::packing::PackingLine;
use arlequin_scene::setup::filling::dem;
use arlequin_scene::spec::{CriterionKind, Protocol};
use clap::Args;
use sample::{Sample, Test};
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use strength::Strengths;

/// A value that scenes know by the same names.
fn one_of<T>(names: &'static [&'static str]) -> impl clap::builder::TypedValueParser<Value = T>
where
    T: serde::de::DeserializeOwned + Clone + Send + Sync + 'static,
{
    use clap::builder::TypedValueParser;
    clap::builder::PossibleValuesParser::new(names.iter().copied()).try_map(|name| {
        T::deserialize(serde::de::value::StrDeserializer::<serde::de::value::Error>::new(
            &name,
        ))
    })
}

/// Key of errors that no scene is to blame for.
const KEY: &str = "calibrate";

/// What to measure, and on what.
#[derive(Debug, Clone, Args)]
pub(crate) struct Calibrate {
    /// Scene whose particles are taken; without one, flags say it all.
    #[arg(conflicts_with_all = ["cylinder", "cuboid"])]
    pub(crate) scene: Option<PathBuf>,
    /// Model of the scene [default: its only one of kind "dem"]
    #[arg(long, value_name = "NAME", requires = "scene")]
    model: Option<String>,
    /// Change a value of the scene, such as model.right.dem.count=5000; may be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE", requires = "scene")]
    pub(crate) set: Vec<String>,
    /// Test a cylinder along x [m].
    #[arg(long, value_name = "LENGTH,RADIUS", value_delimiter = ',', num_args = 1)]
    cylinder: Option<Vec<f64>>,
    /// Test a box along x [m].
    #[arg(
        long = "box",
        value_name = "X,Y,Z",
        value_delimiter = ',',
        num_args = 1,
        conflicts_with = "cylinder"
    )]
    cuboid: Option<Vec<f64>>,
    /// Test a periodic sample of the bulk: no walls, six unit strains.
    #[arg(long, conflicts_with_all = ["cylinder", "cuboid"])]
    periodic: bool,
    /// Number of spheres [default of --periodic: 8000]
    #[arg(long, value_name = "N", conflicts_with = "spacing")]
    count: Option<usize>,
    /// Mean diameter of the spheres [m], in place of --count.
    #[arg(long, value_name = "METRES")]
    spacing: Option<f64>,
    /// Bonds per particle times two [default: 6.2]
    #[arg(long, value_name = "Z")]
    coordination: Option<f64>,
    /// How the packing is compacted [default: onset]
    #[arg(long, value_parser = one_of::<Protocol>(&["onset", "quench"]))]
    protocol: Option<Protocol>,
    /// Young's modulus of the beams [Pa] [default: 265e9]
    #[arg(long, value_name = "PASCAL")]
    young: Option<f64>,
    /// Poisson's ratio of the beams [default: 0.3]
    #[arg(long, value_name = "NU")]
    poisson: Option<f64>,
    /// Beam radius over mean particle radius [default: 0.71]
    #[arg(long, value_name = "RATIO")]
    radius_ratio: Option<f64>,
    /// Find the beams that give this Young's modulus [Pa].
    #[arg(long, value_name = "PASCAL", requires = "target_poisson")]
    target_young: Option<f64>,
    /// Find the beams that give this Poisson's ratio.
    #[arg(long, value_name = "NU", requires = "target_young")]
    target_poisson: Option<f64>,
    /// Pull the bars until they break: strength of the beams over that of the bar.
    #[arg(long)]
    strength: bool,
    /// When beams break [default: all criteria]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "strength", value_parser = one_of::<CriterionKind>(&["axial", "rankine", "mises", "energy"]))]
    criterion: Vec<CriterionKind>,
    /// Strength of the beams [Pa]; ratios do not depend on it [default: 200e6]
    #[arg(long, value_name = "PASCAL", requires = "strength")]
    beam_strength: Option<f64>,
    /// Weibull modulus of the scatter of strengths between beams [default: no scatter]
    #[arg(long, value_name = "M", requires = "strength")]
    weibull: Option<f64>,
    /// Mean diameters of the spheres [m] at which bars are pulled [default: the one of the elasticity]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "strength")]
    sizes: Option<Vec<f64>>,
    /// Number of packings, which differ by their seed.
    #[arg(long, value_name = "N", default_value_t = 5)]
    seeds: u64,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<usize>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Mean and sample standard deviation over the seeds.
#[derive(Debug, Clone, Copy, Serialize)]
struct Bar {
    mean: f64,
    deviation: f64,
}

impl From<Spread> for Bar {
    fn from(s: Spread) -> Self {
        Self {
            mean: s.mean,
            deviation: s.deviation,
        }
    }
}

/// Beams in a report.
#[derive(Debug, Clone, Copy, Serialize)]
struct Beams {
    young: f64,
    poisson: f64,
    radius_ratio: f64,
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
struct Line {
    /// None for spheres from a file.
    seed: Option<u64>,
    spheres: usize,
    dropped: usize,
    coordination_all: f64,
    coordination_retained: f64,
    /// None where no sphere is far enough from the walls.
    coordination_interior: Option<f64>,
    volume_fraction: f64,
    mean_overlap: f64,
    young: f64,
    /// Of bars only.
    young_gauge: Option<f64>,
    poisson: f64,
    /// Of periodic samples only.
    anisotropy: Option<f64>,
}

/// Means and spreads over the packings.
#[derive(Debug, Clone, Copy, Serialize)]
struct Elastic {
    young: Bar,
    young_gauge: Option<Bar>,
    poisson: Bar,
    anisotropy: Option<Bar>,
}

/// The inverse.
#[derive(Debug, Clone, Serialize)]
struct Target {
    young: f64,
    poisson: f64,
    /// Beams found.
    beams: Beams,
    /// What they give.
    reached: Elastic,
}

/// What is printed.
#[derive(Debug, Clone, Serialize)]
struct Report {
    sample: String,
    beams: Beams,
    packings: Vec<Line>,
    #[serde(flatten)]
    elastic: Elastic,
    target: Option<Target>,
    #[serde(skip_serializing_if = "Option::is_none")]
    strength: Option<Strengths>,
    warnings: Vec<String>,
    /// Why the result must not be used, if so.
    refused: Option<String>,
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

/// Runs the command.
pub(crate) fn calibrate(wanted: &Calibrate, source: Option<&Source>) -> Result<ExitCode> {
    wanted.check()?;
    let sample = Sample::of(wanted, source)?;
    let path = sample.key.clone();
    let beam = sample.beam;
    let packings = pack(&sample)?;
    let found = test(&sample, &packings, beam, "testing")?;
    let mut report = Report {
        sample: sample.text.clone(),
        beams: beam.into(),
        packings: lines(&sample, &packings, &found),
        elastic: found.elastic(),
        target: None,
        strength: None,
        warnings: Vec::new(),
        refused: None,
    };
    report.warnings = PackingLine::of(&packings[0], 1.0).warnings();
    uniform(&found, &mut report);
    if let (Some(young), Some(poisson), None) = (wanted.target_young, wanted.target_poisson, &report.refused)
    {
        let mut trial = 0;
        let beams = beam_for(young, poisson, beam.poisson, |b| {
            trial += 1;
            let tests = run(&sample.test, &packings, b, &format!("trial {trial}"))?;
            let e = tests.elastic();
            Ok([e.young.mean, e.poisson.mean])
        })
        .map_err(dem(&path))?;
        let reached = test(&sample, &packings, beams, "checking")?.elastic();
        report.target = Some(Target {
            young,
            poisson,
            beams: beams.into(),
            reached,
        });
    }
    if report.refused.is_none() {
        report.strength = strength::of(wanted, source, &sample, &packings)?;
    }
    if wanted.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| Error::System {
            what: "writing the result",
            message: e.to_string(),
        })?;
        report::json(&text);
    } else {
        report::plain(&table::of(&report));
    }
    Ok(ExitCode::from(u8::from(report.refused.is_some())))
}

/// Says where the middle of a bar differs from the whole: for one packing a warning, for the mean a refusal.
fn uniform(found: &Found, report: &mut Report) {
    let Found::Bars(tests) = found else { return };
    for (line, test) in report.packings.iter().zip(tests) {
        if let Err(e) = test.check_uniform() {
            let which = line.seed.map_or("the file".to_owned(), |s| format!("seed {s}"));
            report.warnings.push(format!("{which}: {e}"));
        }
    }
    report.refused = Statistics::of(tests).check_uniform().err().map(|e| e.to_string());
}

fn pack(sample: &Sample) -> Result<Vec<Packing>> {
    let bar = report::Progress::over(sample.recipes.len(), "packings");
    let mut out = Vec::with_capacity(sample.recipes.len());
    for (k, (_, recipe)) in sample.recipes.iter().enumerate() {
        out.push(recipe.clone().packing(&sample.key)?);
        bar.set(k + 1);
    }
    sample.check(&out)?;
    Ok(out)
}

fn test(sample: &Sample, packings: &[Packing], beam: BeamMaterial, what: &str) -> Result<Found> {
    run(&sample.test, packings, beam, what).map_err(dem(&sample.key))
}

fn run(
    test: &Test,
    packings: &[Packing],
    beam: BeamMaterial,
    what: &str,
) -> arlequin::dem_beam::Result<Found> {
    let bar = report::Progress::over(packings.len(), what);
    let mut done = 0;
    let mut tick = || {
        done += 1;
        bar.set(done);
    };
    match test {
        Test::Tension(shape) => {
            let mut out = Vec::with_capacity(packings.len());
            for p in packings {
                p.connected("a tension test")?;
                // Statics does not ask for a density.
                out.push(tension_test(&p.bonded(beam, 1.0)?, shape)?);
                tick();
            }
            Ok(Found::Bars(out))
        }
        Test::Bulk => {
            let mut out = Vec::with_capacity(packings.len());
            for p in packings {
                out.push(bulk(p, beam)?);
                tick();
            }
            Ok(Found::Bulk(out))
        }
    }
}

fn lines(sample: &Sample, packings: &[Packing], found: &Found) -> Vec<Line> {
    let all = sample.recipes.iter().zip(packings).enumerate();
    all.map(|(k, ((seed, _), p))| {
        let r = &p.report;
        let (young, young_gauge, poisson, anisotropy) = found.line(k);
        Line {
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

impl Calibrate {
    /// Refuses numbers that make no sense, by the names of their flags.
    fn check(&self) -> Result<()> {
        if self.seeds == 0 || self.seeds > 1000 {
            return Err(value("--seeds", self.seeds, "must be 1 to 1000"));
        }
        let one = |x: Option<f64>| x.map(|x| vec![x]);
        let positive = [
            ("--cylinder", self.cylinder.clone(), 2),
            ("--box", self.cuboid.clone(), 3),
            ("--spacing", one(self.spacing), 1),
            ("--coordination", one(self.coordination), 1),
            ("--young", one(self.young), 1),
            ("--radius-ratio", one(self.radius_ratio), 1),
            ("--target-young", one(self.target_young), 1),
        ];
        for (name, numbers, count) in positive {
            let Some(numbers) = numbers else { continue };
            if numbers.len() != count {
                let rule = format!("needs {count} numbers with commas between them");
                return Err(value(name, format_args!("{} numbers", numbers.len()), &rule));
            }
            if let Some(x) = numbers.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
                return Err(value(name, x, "must be a positive number"));
            }
        }
        let nu = self.poisson.unwrap_or(0.0);
        if !(nu > -1.0 && nu <= 0.5) {
            return Err(value("--poisson", nu, "must lie above -1 and not above 0.5"));
        }
        let target = self.target_poisson.unwrap_or(0.0);
        if !(target > -1.0 && target < 0.5) {
            return Err(value(
                "--target-poisson",
                target,
                "must lie above -1 and below 0.5",
            ));
        }
        let none = self.scene.is_none() && self.cylinder.is_none() && self.cuboid.is_none();
        if none && !self.periodic {
            let rule = "nothing to test; give a scene, --cylinder, --box or --periodic";
            return Err(key(KEY, rule));
        }
        self.check_strength()
    }
}

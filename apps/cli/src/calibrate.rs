//! `arlequin calibrate`: options.

use crate::error::{Located, Result, value};
use crate::{report, threads};
use arlequin_scene::Source;
use arlequin_scene::calibrate::{StrengthTest, ToughnessTest, Wanted, calibrate as measure};
use arlequin_scene::spec::{CriterionKind, Protocol};
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

/// Returns a parser for a choice that scenes write by the same names.
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

/// Arguments of `arlequin calibrate`: the sample and the quantities to measure.
#[derive(Debug, Clone, Args)]
pub(crate) struct Calibrate {
    /// Scene whose particles are used; without a scene, flags give all values.
    scene: Option<PathBuf>,
    /// Model of the scene [default: its only one of kind "dem"]
    #[arg(long, value_name = "NAME", requires = "scene")]
    model: Option<String>,
    /// Change a value of the scene, such as model.right.dem.count=5000; may be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE", requires = "scene")]
    set: Vec<String>,
    /// Test a cylinder along x [m], instead of the scene's shape.
    #[arg(long, value_name = "LENGTH,RADIUS", value_delimiter = ',', num_args = 1)]
    cylinder: Option<Vec<f64>>,
    /// Test a box along x [m], instead of the scene's shape.
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
    /// Number of spheres [default: the scene's; 8000 with --periodic]
    #[arg(long, value_name = "N", conflicts_with = "spacing")]
    count: Option<usize>,
    /// Mean diameter of the spheres [m], in place of --count.
    #[arg(long, value_name = "METRES")]
    spacing: Option<f64>,
    /// Bonds per particle times two [default: the scene's; 6.2 without a scene]
    #[arg(long, value_name = "Z")]
    coordination: Option<f64>,
    /// How the packing is compacted [default: the scene's; onset without a scene]
    #[arg(long, value_parser = one_of::<Protocol>(&["onset", "quench"]))]
    protocol: Option<Protocol>,
    /// Young's modulus of the beams [Pa] [default: the scene's; 265e9 without a scene]
    #[arg(long, value_name = "PASCAL")]
    young: Option<f64>,
    /// Poisson's ratio of the beams [default: the scene's; 0.3 without a scene]
    #[arg(long, value_name = "NU")]
    poisson: Option<f64>,
    /// Beam radius over mean particle radius [default: the scene's; 0.71 without a scene]
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
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "strength", value_parser = one_of::<CriterionKind>(&["axial", "rankine", "mises", "energy", "tensile-energy", "hydrostatic"]))]
    criterion: Vec<CriterionKind>,
    /// Strength of the beams [Pa]; ratios do not depend on it [default: 200e6]
    #[arg(long, value_name = "PASCAL", requires = "strength")]
    beam_strength: Option<f64>,
    /// Weibull modulus of the scatter in strength between beams [default: no scatter]
    #[arg(long, value_name = "M", requires = "strength")]
    weibull: Option<f64>,
    /// Mean diameters of the spheres [m] at which bars are pulled [default: the diameter of the elastic
    /// test]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "strength")]
    sizes: Option<Vec<f64>>,
    /// Let a slow crack run through strips: energy that it takes per area, in three ways. Bonds break by the
    /// scene's fracture [default: 8 J/m2, silica].
    #[arg(long, conflicts_with_all = ["strength", "periodic", "cylinder"])]
    toughness: bool,
    /// Strength in tension [Pa] that the body should have: says for which spheres it goes with the toughness.
    #[arg(long, value_name = "PASCAL", requires = "toughness")]
    body_strength: Option<f64>,
    /// Number of packings, each with another seed.
    #[arg(long, value_name = "N", default_value_t = 5)]
    seeds: u64,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs `arlequin calibrate`, with or without a scene.
pub(crate) fn calibrate(arguments: &Calibrate) -> Result<ExitCode, Located> {
    let source = arguments.scene.as_deref().map(Source::read).transpose()?;
    let progress = report::Progress::default();
    let measured = threads::start(arguments.threads)
        .and_then(|_| arguments.check())
        .and_then(|()| measure(&arguments.wanted(), source.as_ref(), &progress.reporter()));
    // Before anything is printed, so that the line of progress is gone.
    drop(progress);
    // With the scene at hand, the error shows its place in the file.
    let calibration = match (measured, &source) {
        (Err(e), Some(source)) => return Err(Located::within(source)(e)),
        (calibration, _) => calibration?,
    };
    report::result(&calibration, arguments.json, |c| {
        report::text(&report::calibration(c));
    })?;
    // A refused target is reported with the measurements, and shows in the exit code.
    Ok(ExitCode::from(u8::from(calibration.refused.is_some())))
}

impl Calibrate {
    /// Refuses numbers out of range, and names their flags.
    fn check(&self) -> Result<()> {
        if self.seeds == 0 || self.seeds > 1000 {
            return Err(value("--seeds", self.seeds, "must be 1 to 1000"));
        }
        let as_list = |x: Option<f64>| x.map(|x| vec![x]);
        let positive = [
            ("--cylinder", self.cylinder.clone(), 2),
            ("--box", self.cuboid.clone(), 3),
            ("--spacing", as_list(self.spacing), 1),
            ("--coordination", as_list(self.coordination), 1),
            ("--young", as_list(self.young), 1),
            ("--radius-ratio", as_list(self.radius_ratio), 1),
            ("--target-young", as_list(self.target_young), 1),
            ("--body-strength", as_list(self.body_strength), 1),
        ];
        for (name, numbers, count) in positive {
            let Some(numbers) = numbers else { continue };
            if numbers.len() != count {
                let rule = format!("needs {count} numbers with commas between them");
                return Err(value(name, format_args!("{} numbers", numbers.len()), &rule));
            }
            // Not `<= 0`: a NaN must be refused, too.
            if let Some(x) = numbers.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
                return Err(value(name, x, "must be a positive number"));
            }
        }
        let nu = self.poisson.unwrap_or(0.0);
        if !(nu > -1.0 && nu <= 0.5) {
            return Err(value("--poisson", nu, "must lie above -1 and not above 0.5"));
        }
        // At 0.5 the bulk modulus is infinite.
        let target = self.target_poisson.unwrap_or(0.0);
        if !(target > -1.0 && target < 0.5) {
            return Err(value(
                "--target-poisson",
                target,
                "must lie above -1 and below 0.5",
            ));
        }
        self.check_strength()
    }

    /// Refuses values of the strength test that are out of range.
    fn check_strength(&self) -> Result<()> {
        if !self.strength {
            return Ok(());
        }
        let as_list = |x: Option<f64>| x.into_iter().collect::<Vec<f64>>();
        let positive = [
            ("--beam-strength", as_list(self.beam_strength)),
            ("--weibull", as_list(self.weibull)),
            ("--sizes", self.sizes.clone().unwrap_or_default()),
        ];
        for (name, numbers) in positive {
            if let Some(x) = numbers.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
                return Err(value(name, x, "must be a positive number"));
            }
        }
        Ok(())
    }

    /// Returns the request for the library.
    fn wanted(&self) -> Wanted {
        fn exact<const N: usize>(numbers: Option<&Vec<f64>>) -> Option<[f64; N]> {
            numbers.and_then(|n| n.as_slice().try_into().ok())
        }
        Wanted {
            model: self.model.clone(),
            set: self.set.clone(),
            cylinder: exact(self.cylinder.as_ref()),
            cuboid: exact(self.cuboid.as_ref()),
            periodic: self.periodic,
            count: self.count,
            spacing: self.spacing,
            coordination: self.coordination,
            protocol: self.protocol,
            young: self.young,
            poisson: self.poisson,
            radius_ratio: self.radius_ratio,
            target: self.target_young.zip(self.target_poisson).map(<[f64; 2]>::from),
            strength: self.strength.then(|| StrengthTest {
                criteria: self.criterion.clone(),
                beam_strength: self.beam_strength,
                weibull: self.weibull,
                sizes: self.sizes.clone(),
            }),
            toughness: self.toughness.then_some(ToughnessTest {
                body_strength: self.body_strength,
            }),
            seeds: self.seeds,
        }
    }
}

//! Dynamic crack branching in a plate of soda-lime glass (Bobaru and Zhang 2015): we expect a fork at 4e6 Pa
//! and a straight crack at 2e6 Pa.

use super::check::{Accept, Check};
use super::{Figure, Report, Runs};
use crate::crack::{Broken, CrackPath, Fork, Plate, broken};
use arlequin_scene::{Result, Scene, Silent, Source};

const TEXT: &str = include_str!("../../scenes/branching.toml");
/// Fracture energy, Young's modulus, Poisson's ratio and density of the scene \[J/m², Pa, –, kg/m³\].
const GLASS: [f64; 4] = [3.8, 72e9, 0.22, 2440.0];
/// Fracture energy with which a slow crack, which takes twice of it, needs that of the scene \[J/m²\].
const HALF: f64 = 1.87;
/// Tip of the notch, and end of the plate \[m\].
const ENDS: [f64; 2] = [50e-3, 100e-3];
const THICKNESS: f64 = 2e-3;
/// Place of the notch across the plate \[m\].
const MIDDLE: f64 = 20e-3;
const SEEDS: [u64; 3] = [1, 2, 3];

/// Returns the broken bonds of the plate under a traction \[Pa\] with a fracture energy \[J/m²\], for spheres
/// of this mean diameter \[m\].
///
/// # Errors
/// Values that the scene cannot take.
pub fn breaks(diameter: f64, seed: u64, [traction, gc]: [f64; 2]) -> Result<Vec<Broken>> {
    let scene = Scene::from_source(Source::new("branching.toml", TEXT))?
        .set("model.plate.spacing", format!("{diameter:e}"))?
        .set("model.plate.dem.seed", seed)?
        .set("effect.0.fracture.gc", format!("{gc:e}"))?
        .set("load.0.traction", format!("[0.0, {traction:e}, 0.0]"))?
        .set("load.1.traction", format!("[0.0, {:e}, 0.0]", -traction))?;
    let results = scene.prepare()?.run(&mut Silent)?;
    Ok(broken(&results))
}

/// Returns the measured crack of [`breaks`].
#[must_use]
pub fn path(diameter: f64, breaks: &[Broken]) -> CrackPath {
    let plate = Plate {
        ends: ENDS,
        thickness: THICKNESS,
        diameter,
    };
    CrackPath::new(plate, breaks)
}

/// Speed of Rayleigh waves, within half a per cent \[m/s\].
fn rayleigh() -> f64 {
    let [_, young, nu, density] = GLASS;
    let shear = (young / (2.0 * (1.0 + nu) * density)).sqrt();
    // The usual fit of the root of Rayleigh's equation.
    shear * (0.862 + 1.14 * nu) / (1.0 + nu)
}

/// Cracks of all seeds under one traction.
struct Series {
    /// Traction \[Pa\] and fracture energy \[J/m²\].
    given: [f64; 2],
    paths: Vec<CrackPath>,
    breaks: Vec<Broken>,
}

impl Series {
    fn run(diameter: f64, seeds: &[u64], given: [f64; 2]) -> Result<Self> {
        let broken = seeds.iter().map(|seed| breaks(diameter, *seed, given));
        let broken = broken.collect::<Result<Vec<_>>>()?;
        Ok(Self {
            given,
            paths: broken.iter().map(|b| path(diameter, b)).collect(),
            // The picture shows one packing; the others would cover it.
            breaks: broken.into_iter().next().unwrap_or_default(),
        })
    }

    fn name(&self, what: &str) -> String {
        format!("{:.0} MPa: {what}", 1e-6 * self.given[0])
    }

    fn forks(&self) -> Vec<Fork> {
        self.paths.iter().filter_map(CrackPath::fork).collect()
    }

    fn row(&self, what: &str, values: &[f64], accept: Accept) -> Check {
        Check::over_seeds(&self.name(what), values, accept)
    }

    /// Rows that both tractions have.
    fn checks(&self, forked: bool) -> Vec<Check> {
        let (count, forks) = (self.paths.len() as f64, self.forks());
        let wanted = if forked { count } else { 0.0 };
        // Speeds are those of the single crack, up to the fork.
        let end = |p: &CrackPath| p.fork().map_or(f64::INFINITY, |f| f.place);
        let speeds: Vec<[f64; 2]> = self.paths.iter().map(|p| p.speeds(end(p))).collect();
        let over = |k: usize| speeds.iter().map(|s| s[k] / rayleigh()).collect::<Vec<f64>>();
        let starts: Vec<f64> = self.paths.iter().map(|p| 1e6 * p.start()).collect();
        let released: Vec<f64> = self
            .paths
            .iter()
            .map(|p| p.released_per_area() / self.given[1])
            .collect();
        let mut out = vec![
            Check::against(
                self.name("seeds with a fork"),
                forks.len() as f64,
                wanted,
                "our expectation",
                Accept::Absolute(0.0),
            ),
            self.row("crack leaves the notch [us]", &starts, Accept::Between(0.0, 43.0)),
            self.row("mean speed over Rayleigh's", &over(1), Accept::Between(0.2, 1.0)),
            self.row(
                "largest speed over Rayleigh's",
                &over(0),
                Accept::Between(0.2, 1.0),
            ),
            self.row(
                "released energy per area over gc",
                &released,
                Accept::Between(0.88, 1.12),
            ),
        ];
        if forked {
            let places: Vec<f64> = forks.iter().map(|f| 1e3 * f.place).collect();
            let times: Vec<f64> = forks.iter().map(|f| 1e6 * f.time).collect();
            out.push(self.row("place of the fork [mm]", &places, Accept::Between(50.0, 90.0)));
            out.push(self.row("time of the fork [us]", &times, Accept::Between(0.0, 43.0)));
        } else {
            let wander: Vec<f64> = self.paths.iter().map(|p| 1e3 * p.wander(MIDDLE)).collect();
            out.push(self.row(
                "largest distance from the line [mm]",
                &wander,
                Accept::AtMost(4.0),
            ));
        }
        out
    }
}

/// Compares the cracks of the plate under 4e6 Pa and 2e6 Pa.
pub(super) fn branching(done: &Runs) -> Result<Report> {
    let (diameter, seeds) = if done.quick {
        (1e-3, &SEEDS[..1])
    } else {
        (0.5e-3, &SEEDS[..])
    };
    let given = [[4e6, GLASS[0]], [2e6, GLASS[0]], [2e6, HALF]];
    let [high, low, half] = given.map(|g| Series::run(diameter, seeds, g));
    let (high, low, half) = (high?, low?, half?);
    let line = |s: &Series| {
        let of = |k: usize| s.breaks.iter().map(|b| 1e3 * b.place[k]).collect();
        (s.name("broken bonds"), of(0), of(1))
    };
    let figure = Figure {
        file: "branching",
        title: "Broken bonds of the plate, one packing",
        axes: [["x", "mm"], ["y", "mm"]],
        log: [false; 2],
        curves: vec![line(&high), line(&low)],
        says: String::new(),
    };
    let mut checks = high.checks(true);
    checks.extend(low.checks(false));
    checks.push(Check::against(
        "2 MPa and gc = 1.87 J/m2: seeds with a fork",
        half.forks().len() as f64,
        half.paths.len() as f64,
        "a slow crack takes twice gc",
        Accept::Absolute(0.0),
    ));
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

//! A plate struck between two notches (Kalthoff and Winkler): a crack leaves the notch at about 70° and the
//! struck edge stays whole.

use super::check::{Accept, Check, spread};
use super::{Figure, Report, Runs};
use crate::crack::{Broken, Plate, Rising, broken};
use arlequin_scene::{Result, Scene, Silent, Source};

const TEXT: &str = include_str!("../../scenes/kalthoff.toml");
/// Fracture energy \[J/m²\] and thickness \[m\] of the scene.
const GC: f64 = 22e3;
const THICKNESS: f64 = 9e-3;
/// Tip of the notch, and end of the plate above it \[m\].
const TIP: [f64; 2] = [50e-3, 25e-3];
const TOP: f64 = 100e-3;
/// Mean diameter of the spheres \[m\]: 4.5 across the thickness.
const DIAMETER: f64 = 2e-3;
const SEEDS: [u64; 5] = [1, 2, 3, 4, 5];

/// Returns the broken bonds of the plate, with spheres of this mean diameter \[m\].
///
/// # Errors
/// A diameter that the scene cannot take.
pub fn breaks(diameter: f64, seed: u64) -> Result<Vec<Broken>> {
    let scene = Scene::from_source(Source::new("kalthoff.toml", TEXT))?
        .set("model.plate.spacing", format!("{diameter:e}"))?
        .set("model.plate.dem.seed", seed)?;
    let results = scene.prepare()?.run(&mut Silent)?;
    Ok(broken(&results))
}

/// Returns the crack that rises from the notch.
#[must_use]
pub fn crack(diameter: f64, breaks: &[Broken]) -> Rising {
    let plate = Plate {
        ends: [TIP[1], TOP],
        thickness: THICKNESS,
        diameter,
    };
    Rising::new(plate, TIP[0], breaks)
}

/// Share of the breaks that lie within three diameters of the struck edge.
fn at_edge(diameter: f64, breaks: &[Broken]) -> f64 {
    let near = breaks
        .iter()
        .filter(|b| b.place[0] < 3.0 * diameter && b.place[1] < TIP[1]);
    near.count() as f64 / breaks.len().max(1) as f64
}

/// Compares the crack with the direction of the largest hoop stress at a notch loaded in sliding.
pub(super) fn kalthoff(done: &Runs) -> Result<Report> {
    let (diameter, seeds) = (DIAMETER, if done.quick { &SEEDS[..1] } else { &SEEDS[..] });
    let series = seeds.iter().map(|seed| breaks(diameter, *seed));
    let series = series.collect::<Result<Vec<_>>>()?;
    let cracks: Vec<Rising> = series.iter().map(|b| crack(diameter, b)).collect();
    let of = |f: &dyn Fn(&Rising) -> f64| cracks.iter().map(f).collect::<Vec<f64>>();
    let row = Check::over_seeds;
    let [angle, half] = spread(&of(&|c| c.angle().to_degrees()));
    let hoop = Check::against(
        "angle of the crack to the notch [deg]",
        angle,
        (1.0_f64 / 3.0).acos().to_degrees(),
        "largest hoop stress at a crack in sliding, arccos(1/3)",
        Accept::Absolute(7.0),
    );
    let edges: Vec<f64> = series.iter().map(|b| at_edge(diameter, b)).collect();
    let checks = vec![
        hoop.note(format!("± {half:.1} over {} seeds", seeds.len())),
        row(
            "crack leaves the notch [us]",
            &of(&|c| 1e6 * c.start()),
            Accept::Between(0.0, 90.0),
        ),
        row(
            "rise of the crack in 90 us [mm]",
            &of(&|c| 1e3 * c.rise()),
            Accept::AtLeast(25.0),
        ),
        row(
            "share of the broken bonds that lie at the struck edge",
            &edges,
            Accept::AtMost(0.02),
        ),
        row(
            "released energy per area over gc",
            &of(&|c| c.released_per_area() / GC),
            Accept::Between(0.88, 1.12),
        ),
    ];
    let curve = |(seed, b): (&u64, &Vec<Broken>)| {
        let of = |k: usize| b.iter().map(|b| 1e3 * b.place[k]).collect();
        (format!("seed {seed}"), of(0), of(1))
    };
    let figure = Figure {
        file: "kalthoff",
        title: "Broken bonds of the struck plate",
        axes: [["x", "mm"], ["y", "mm"]],
        log: [false; 2],
        curves: seeds.iter().zip(&series).map(curve).collect(),
        says: String::new(),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

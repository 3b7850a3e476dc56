//! Strength of a packing by three tests: direct tension, Brazilian disc, bending. Each uses the load curve
//! of its reaction forces.

use super::check::{Accept, Check};
use super::{Figure, Report, Runs};
use arlequin_scene::{Result, Scene, Silent, Source};
use std::f64::consts::PI;

/// A scene that ships with this crate.
struct Deck {
    name: &'static str,
    text: &'static str,
}

const TENSION: Deck = Deck {
    name: "direct-tension.toml",
    text: include_str!("../../scenes/direct-tension.toml"),
};
const DISC: Deck = Deck {
    name: "brazilian-disc.toml",
    text: include_str!("../../scenes/brazilian-disc.toml"),
};
const BEND: Deck = Deck {
    name: "three-point-bend.toml",
    text: include_str!("../../scenes/three-point-bend.toml"),
};

/// Share of the run over which a force is averaged. The force is sampled every few steps and oscillates
/// with the waves in the body.
const WINDOW: f64 = 0.02;

/// A load curve: displacement \[m\] and force \[N\], positive as a load.
struct LoadCurve {
    way: Vec<f64>,
    force: Vec<f64>,
}

impl LoadCurve {
    fn from_deck(deck: &Deck) -> Result<Self> {
        let scene = Scene::from_source(Source::new(deck.name, deck.text))?;
        let results = scene.prepare()?.run(&mut Silent)?;
        let curve = &results.recorded.curves[0];
        Ok(Self {
            way: curve.x.values.clone(),
            force: averaged(&curve.y.values),
        })
    }

    fn peak(&self) -> f64 {
        self.force.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns the slope \[N/m\] between 20 % and 50 % of the largest force, by least squares.
    fn slope(&self) -> f64 {
        let top = self.peak();
        // Only the loading branch counts, up to the peak.
        let end = self.force.iter().position(|f| *f >= top).unwrap_or_default();
        let rows = self.way[..end].iter().zip(&self.force);
        let rows: Vec<(f64, f64)> = rows
            .map(|(x, f)| (*x, *f))
            .filter(|(_, f)| (0.2 * top..0.5 * top).contains(f))
            .collect();
        let n = rows.len().max(1) as f64;
        let mean = rows
            .iter()
            .fold([0.0; 2], |m, r| [m[0] + r.0 / n, m[1] + r.1 / n]);
        let [mut both, mut square] = [0.0; 2];
        for (x, f) in rows {
            both += (x - mean[0]) * (f - mean[1]);
            square += (x - mean[0]).powi(2);
        }
        both / square
    }
}

/// Returns moving averages over [`WINDOW`].
fn averaged(values: &[f64]) -> Vec<f64> {
    let half = (WINDOW * values.len() as f64 * 0.5).ceil() as usize;
    let mean = |k: usize| {
        let part = &values[k.saturating_sub(half)..(k + half + 1).min(values.len())];
        part.iter().sum::<f64>() / part.len() as f64
    };
    (0..values.len()).map(mean).collect()
}

/// Compares the peak loads of a disc and of a beam with predictions from the strength in tension.
pub(super) fn strength(done: &Runs) -> Result<Report> {
    if done.quick {
        return Ok(Report::default());
    }
    let [tension, disc, bend] = [TENSION, DISC, BEND].map(|d| LoadCurve::from_deck(&d));
    let (tension, disc, bend) = (tension?, disc?, bend?);
    // Dimensions in the scenes [m, m²]: section of the bar; diameter and thickness of the disc; span, width
    // and height of the beam.
    let (section, [wide, thick], [span, width, height]) = (9e-6, [8e-3, 2e-3], [14e-3, 3e-3, 4e-3]);
    // Strength by direct tension, by splitting a disc, and by bending with linear stress over the height.
    let tensile_strength = tension.peak() / section;
    let split = 2.0 * disc.peak() / (PI * wide * thick);
    let bent = 1.5 * bend.peak() * span / (width * height * height);
    let checks = vec![
        Check::new(
            "strength in direct tension [MPa]",
            1e-6 * tensile_strength,
            Accept::Between(10.0, 100.0),
        ),
        Check::against(
            "peak load of the Brazilian disc [N]",
            disc.peak(),
            0.5 * PI * wide * thick * tensile_strength,
            "elastic disc, Hertz",
            Accept::Relative(0.25),
        )
        .note(format!("indirect strength {:.1} MPa", 1e-6 * split)),
        Check::against(
            "modulus of rupture in bending over the strength in tension",
            bent / tensile_strength,
            1.0,
            "beam theory; 1 to 2 in grainy materials",
            Accept::Between(0.8, 2.2),
        )
        .note("few grains lie in the stretched layer, and a crack there does not end the test"),
    ];
    let line = |name: &str, c: &LoadCurve| {
        let shown = |values: &[f64], factor: f64| values.iter().map(|v| v * factor).collect();
        (name.to_owned(), shown(&c.way, 1e6), shown(&c.force, 1.0))
    };
    let figure = Figure {
        file: "strength",
        title: "Load curves from reactions: direct tension, Brazilian disc, three-point bending",
        axes: [["way", "µm"], ["load", "N"]],
        log: [false; 2],
        curves: vec![
            line("direct tension", &tension),
            line("disc", &disc),
            line("bending", &bend),
        ],
        says: format!(
            "One packing each, as the scenes ship. Slopes: {:.3e}, {:.3e}, {:.3e} N/m.",
            tension.slope(),
            disc.slope(),
            bend.slope()
        ),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

//! Edge-cracked bars in tension at rest: strength over the length of the crack.

use super::check::{Accept, Check};
use super::{Figure, Report, Runs, UntilTorn, at_rest, last, measured, rests};
use crate::crack::{Broken, broken, released_beside, slope};
use arlequin_scene::{Result, Scene, Silent, Source};

const TEXT: &str = include_str!("../../scenes/edge-crack.toml");
/// Lengths of the bar \[m\].
const BAR: [f64; 3] = [60e-3, 24e-3, 5e-3];
/// Lengths of the crack \[m\], on lines of a mesh of 1 mm.
const CRACKS: [f64; 4] = [4e-3, 5e-3, 7e-3, 10e-3];
/// Length of the crack \[m\] and largest elongation \[m\] of the scene.
const SCENE: [f64; 2] = [6e-3, 9e-6];
/// Young's modulus \[Pa\], Poisson's ratio and fracture energy \[J/m²\] of the scene.
const SILICA: [f64; 3] = [72.5e9, 0.17, 8.0];
/// Mean diameter of the spheres \[m\].
const DIAMETER: f64 = 1e-3;
const SEEDS: [u64; 3] = [1, 2, 3];

/// Strength of a bar \[Pa\], and the energy that its bonds released per area of the ligament \[J/m²\], two
/// spheres at its two ends left out: a layer of spheres at a face has fewer bonds.
///
/// # Errors
/// A crack that the scene cannot take.
pub fn strength(seed: u64, crack: f64) -> Result<[f64; 2]> {
    let [length, width, thickness] = BAR;
    let notch = format!(
        "[{{ plane = {{ point = [{:e}, 0.0, 0.0], normal = [1.0, 0.0, 0.0], within = {{ low = [0.0, 0.0, 0.0], \
         high = [{length:e}, {crack:e}, {thickness:e}] }} }} }}]",
        0.5 * length
    );
    // The load steps then resolve the strengths of all cracks alike.
    let elongation = SCENE[1] * (SCENE[0] / crack).sqrt();
    let scene = Scene::from_source(Source::new("edge-crack.toml", TEXT))?
        .set("model.bar.dem.seed", seed)?
        .set("model.bar.dem.notch", notch)?
        .set("support.1.motion.amplitude", format!("{elongation:e}"))?;
    let results = scene.prepare()?.run(&mut UntilTorn::default())?;
    let peak = measured(&results, "load")?.iter().fold(0.0_f64, |p, f| p.max(*f));
    // The crack runs along y.
    let turned: Vec<Broken> = broken(&results)
        .into_iter()
        .map(|b| Broken {
            place: [b.place[1], b.place[0]],
            ..b
        })
        .collect();
    let ends = [crack + 2.0 * DIAMETER, width - 2.0 * DIAMETER];
    let area = (ends[1] - ends[0]) * thickness;
    Ok([
        peak / (width * thickness),
        released_beside(&turned, ends, DIAMETER) / area,
    ])
}

/// Returns `J E/σ²` \[m\] of a bar of finite elements with an edge crack, at the mean stress `σ`.
fn effective_length(crack: f64) -> Result<f64> {
    let ([length, width, thickness], [young, nu, _]) = (BAR, SILICA);
    let (middle, e) = (0.5 * length, 1e-5);
    let text = format!(
        "[model.bar]\nkind = \"fem\"\ndivisions = [60, 24, 2]\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [{length:e}, {width:e}, {thickness:e}] }}\n\
         material = {{ young = {young:e}, poisson = {nu}, density = 1000.0 }}\n\
         crack = [{{ box = {{ low = [{:e}, {:e}, {:e}], high = [{:e}, {:e}, {:e}] }} }}]\n\
         [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\ncomponents = [\"x\"]\n\
         [[support]]\nname = \"grip\"\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponents = [\"x\"]\n\
         motion = {{ amplitude = 1e-5, time = \"step\" }}\n\
         [[support]]\nmodel = \"bar\"\nwhere.box = {{ low = [0.0, 0.0, 0.0], high = [0.0, {width:e}, {thickness:e}] }}\n\
         components = [\"y\", \"z\"]\n\
         [static]\nsteps = 1\n\
         [probe.force]\nof = \"grip\"\nquantity = \"force\"\ncomponent = \"x\"\n\
         [probe.j]\nmodel = \"bar\"\nquantity = \"energy-release\"\n\
         crack = {{ front = [[{middle:e}, {crack:e}, 0.0], [{middle:e}, {crack:e}, {thickness:e}]], \
         direction = [0.0, 1.0, 0.0], radii = [1.2e-3, 3.5e-3] }}\n",
        middle - e,
        -e,
        -e,
        middle + e,
        crack + e,
        thickness + e,
    );
    let results = Scene::from_text(text)?.prepare()?.run(&mut Silent)?;
    let stress = last(&results, "force")?.abs() / (width * thickness);
    Ok(last(&results, "j")? * young / (stress * stress))
}

/// Power of the second numbers over the first, by least squares of their logarithms.
pub(super) fn power(x: &[f64], y: &[f64]) -> f64 {
    let rows: Vec<[f64; 2]> = x.iter().zip(y).map(|(x, y)| [x.ln(), y.ln()]).collect();
    slope(&rows)
}

/// Compares the strength of cracked bars with the power −1/2 of the length of the crack.
pub(super) fn edge(done: &Runs) -> Result<Report> {
    let (seeds, cracks) = if done.quick {
        (&SEEDS[..1], &[4e-3, 10e-3][..])
    } else {
        (&SEEDS[..], &CRACKS[..])
    };
    let lengths = cracks.iter().map(|a| effective_length(*a));
    let lengths = lengths.collect::<Result<Vec<f64>>>()?;
    let (mut powers, mut taken, mut released, mut curves) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut tests = Vec::new();
    for seed in seeds {
        let series = cracks.iter().map(|a| at_rest(strength(*seed, *a)));
        let series = series.collect::<Result<Vec<_>>>()?;
        let found = series
            .iter()
            .zip(&lengths)
            .filter_map(|(s, l)| s.map(|s| (s, *l)));
        let (rows, lengths): (Vec<[f64; 2]>, Vec<f64>) = found.unzip();
        tests.extend(series);
        let peaks: Vec<f64> = rows.iter().map(|s| s[0]).collect();
        // A slope needs two lengths.
        if peaks.len() > 1 {
            powers.push(power(&lengths, &peaks));
        }
        let energies = peaks
            .iter()
            .zip(&lengths)
            .map(|(s, l)| s * s * l / SILICA[0] / SILICA[2]);
        taken.extend(energies);
        released.extend(rows.iter().map(|s| s[1] / SILICA[2]));
        let megapascals = peaks.iter().map(|s| 1e-6 * s).collect();
        curves.push((
            format!("seed {seed}"),
            lengths.iter().map(|l| 1e3 * l).collect(),
            megapascals,
        ));
    }
    let checks = vec![
        rests(&tests),
        Check::over_seeds(
            "power of the strength over J E/sigma^2",
            &powers,
            Accept::Absolute(0.1),
        )
        .beside(-0.5, "linear elastic fracture"),
        Check::over_seeds("J at the peak over gc", &taken, Accept::Relative(0.12)).beside(1.0, "input"),
        Check::over_seeds(
            "released energy per area over gc",
            &released,
            Accept::Relative(0.12),
        )
        .beside(1.0, "input"),
    ];
    let figure = Figure {
        file: "edge",
        title: "Strength of edge-cracked bars",
        axes: [["J E/sigma^2", "mm"], ["strength", "MPa"]],
        log: [true; 2],
        curves,
        says: String::new(),
    };
    Ok(Report {
        checks,
        figures: vec![figure],
    })
}

//! Edge-cracked bars in tension: strength over crack length, and the energy released per area at the peak of
//! the load, against the toughness of strips.

use super::branching::spread;
use super::check::{Accept, Check};
use super::{Figure, Report, Runs};
use arlequin::core::nalgebra::Vector3;
use arlequin::dem_beam::calibrate::{Bar, tension_test};
use arlequin::dem_beam::strength::strength_test;
use arlequin::dem_beam::toughness::{Strip, toughness_test};
use arlequin::dem_beam::{BeamMaterial, Container, Criterion, Fracture, Packing, PackingSpec};
use arlequin_scene::error::{Error, dem};
use arlequin_scene::{Result, Scene, Silent};

/// Lengths of the bar \[m\]: 80, 30 and 6 spheres of about 1 mm.
const BAR: [f64; 3] = [80e-3, 30e-3, 6e-3];
/// Lengths of the strip \[m\].
const STRIP: [f64; 3] = [64e-3, 20e-3, 6e-3];
/// Volume of the body per sphere \[m³\], for spheres of about 1 mm.
const VOLUME: f64 = 0.905e-9;
/// Lengths of the crack \[m\], on lines of a mesh of 1 mm.
const CRACKS: [f64; 4] = [4e-3, 5e-3, 7e-3, 10e-3];
/// Poisson's ratio of packings with these beams, and fracture energy \[J/m²\].
const NU: f64 = 0.174;
const GC: f64 = 8.0;
const SEEDS: [u64; 3] = [1, 2, 3];

fn packing([x, y, z]: [f64; 3], seed: u64) -> Result<Packing> {
    let container = Container::cuboid(Vector3::zeros(), Vector3::new(x, y, z));
    let count = (x * y * z / VOLUME) as usize;
    let built = container.and_then(|c| PackingSpec::new(c, count, seed).build());
    built.map_err(dem("edge"))
}

fn fracture() -> Result<Fracture> {
    let ratio = BeamMaterial::SILICA.radius_ratio;
    Fracture::from_fracture_energy(Criterion::TensileEnergy, GC, ratio).map_err(dem("edge"))
}

const fn bar() -> Bar {
    Bar {
        start: 0.0,
        length: BAR[0],
        area: BAR[1] * BAR[2],
    }
}

/// Returns Young's modulus of a bar \[Pa\] and its strength \[Pa\] with an edge crack of each length.
///
/// # Errors
/// Errors of the packing and of the tests.
pub fn strengths(seed: u64, cracks: &[f64]) -> Result<(f64, Vec<f64>)> {
    let (beam, whole) = (BeamMaterial::SILICA, packing(BAR, seed)?);
    let body = whole.bonded(beam, 1.0).map_err(dem("edge"))?;
    let young = tension_test(&body, &bar()).map_err(dem("edge"))?.young;
    let middle = 0.5 * BAR[0];
    let peaks = cracks.iter().map(|a| {
        let mut cut = whole.clone();
        cut.cut(|p, q| {
            let (from, to) = (p.x - middle, q.x - middle);
            from * to < 0.0 && p.y + (q.y - p.y) * from / (from - to) < *a
        });
        let test = strength_test(&cut, beam, &bar(), fracture()?);
        test.map(|s| s.peak).map_err(dem("edge"))
    });
    Ok((young, peaks.collect::<Result<_>>()?))
}

/// Returns the energy that a slow crack takes per area of a strip of such spheres \[J/m²\].
///
/// # Errors
/// Errors of the packing and of the test.
pub fn toughness(seed: u64, young: f64) -> Result<f64> {
    let strip = Strip {
        low: [0.0; 3],
        size: STRIP,
        young,
    };
    let test = toughness_test(&packing(STRIP, seed)?, BeamMaterial::SILICA, &strip, fracture()?);
    test.map(|t| t.lost).map_err(dem("edge"))
}

/// Returns `J E/σ²` \[m\] of a bar of finite elements with an edge crack, at the mean stress `σ`.
fn effective_length(crack: f64) -> Result<f64> {
    let [length, width, thickness] = BAR;
    let (middle, elongation, young, e) = (0.5 * length, 1e-5, 70e9, 1e-5);
    let text = format!(
        "[model.bar]\nkind = \"fem\"\ndivisions = [80, 30, 2]\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [{length:e}, {width:e}, {thickness:e}] }}\n\
         material = {{ young = {young:e}, poisson = {NU}, density = 1000.0 }}\n\
         crack = [{{ box = {{ low = [{:e}, {:e}, {:e}], high = [{:e}, {:e}, {:e}] }} }}]\n\
         [[support]]\nname = \"grip\"\nmodel = \"bar\"\nwhere = \"x-min\"\ncomponents = [\"x\"]\n\
         [[support]]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponents = [\"x\"]\n\
         motion = {{ amplitude = {elongation:e}, time = \"step\" }}\n\
         [[support]]\nmodel = \"bar\"\nwhere.box = {{ low = [0.0, 0.0, 0.0], high = [0.0, 0.0, {thickness:e}] }}\ncomponents = [\"y\"]\n\
         [[support]]\nmodel = \"bar\"\nwhere.box = {{ low = [0.0, 0.0, 0.0], high = [0.0, {width:e}, 0.0] }}\ncomponents = [\"z\"]\n\
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
    let last = |name: &str| {
        let value = results.probe(name).and_then(|p| p.1.last().copied());
        value.ok_or_else(|| Error::System {
            what: "the bar of finite elements",
            message: format!("has no probe '{name}'"),
        })
    };
    let stress = last("force")?.abs() / (width * thickness);
    Ok(last("j")? * young / (stress * stress))
}

/// Slope of the logarithm of the second numbers over that of the first, by least squares.
fn power(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = |v: &[f64]| v.iter().map(|x| x.ln()).sum::<f64>() / n;
    let (mx, my) = (mean(x), mean(y));
    let (mut both, mut square) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        both += (x.ln() - mx) * (y.ln() - my);
        square += (x.ln() - mx).powi(2);
    }
    both / square
}

/// Compares the strength of cracked bars with the power −1/2 of the length of the crack, and the energy
/// released at the peak with the toughness of strips.
pub(super) fn edge(done: &Runs) -> Result<Report> {
    let (seeds, cracks) = if done.quick {
        (&SEEDS[..1], &[4e-3, 10e-3][..])
    } else {
        (&SEEDS[..], &CRACKS[..])
    };
    let lengths = cracks.iter().map(|a| effective_length(*a));
    let lengths = lengths.collect::<Result<Vec<f64>>>()?;
    let (mut powers, mut released, mut taken, mut curves) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for seed in seeds {
        let (young, peaks) = strengths(*seed, cracks)?;
        powers.push(power(&lengths, &peaks));
        let energies = peaks.iter().zip(&lengths).map(|(s, l)| s * s * l / young);
        released.push(energies.sum::<f64>() / peaks.len() as f64);
        taken.push(toughness(*seed, young)?);
        let megapascals = peaks.iter().map(|s| 1e-6 * s).collect();
        let places = lengths.iter().map(|l| 1e3 * l).collect();
        curves.push((format!("seed {seed}"), places, megapascals));
    }
    let note = |values: &[f64]| format!("± {:.3} over {} seeds", spread(values)[1], values.len());
    let slow = spread(&taken)[0];
    let checks = vec![
        Check::against(
            "power of the strength over J E/sigma^2",
            spread(&powers)[0],
            -0.5,
            "linear elastic fracture",
            Accept::Absolute(0.05),
        )
        .note(note(&powers)),
        Check::against(
            "energy released per area at the peak [J/m2]",
            spread(&released)[0],
            slow,
            "strips of such spheres",
            Accept::Relative(0.15),
        )
        .note(note(&released)),
        Check::new(
            "energy that a slow crack takes per area over gc",
            slow / GC,
            Accept::Between(0.88, 1.12),
        )
        .note(note(&taken)),
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

//! Beam A by discrete elements alone: a silica bar (20 mm long, 2 mm thick) fixed at x = 0, pulled
//! at the other end by a force of 1 kN that acts at once. Prints the mean elongation and the first
//! three axial frequencies beside beam theory and the published discrete-element values.
//!
//! `cargo run --release -p dem-beam --example beam_a -- [spheres] [periods] [seed] [quench]`
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use arlequin_core::effect::Load;
use arlequin_core::{
    Coupled, Guard, Model, PrescribedMotion, Silent, Subdomain, TimeFunction, TimeStep, Weights,
};
use dem_beam::{BeamMaterial, Container, DemModel, LoadShare, PackingSpec};
use nalgebra::{Point3, Vector3};
use std::error::Error;
use std::f64::consts::PI;

const LENGTH: f64 = 20e-3;
const RADIUS: f64 = 1e-3;
const FORCE: f64 = 1000.0;
const DENSITY: f64 = 2200.0;
/// Axial frequencies (Hz) `(2k+1) c/4L`, c = 5740.6 m/s, and those published for discrete elements.
const THEORY: [f64; 3] = [71_757.0, 215_272.0, 358_787.0];
const PUBLISHED: [f64; 3] = [72_408.0, 217_246.0, 362_072.0];

/// Size of the Hann-windowed Fourier transform of evenly spaced samples (over their mean).
fn amplitude(samples: &[f64], step: f64, frequency: f64) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let (mut re, mut im) = (0.0, 0.0);
    for (k, s) in samples.iter().enumerate() {
        let t = k as f64;
        let window = 0.5 - 0.5 * (2.0 * PI * t / n).cos();
        let (sin, cos) = (2.0 * PI * frequency * t * step).sin_cos();
        re += (s - mean) * window * cos;
        im += (s - mean) * window * sin;
    }
    re.hypot(im)
}

/// Frequency of the highest peak within 12 % of a guess (Hz): a scan, then golden sections.
fn peak(samples: &[f64], step: f64, guess: f64) -> f64 {
    let at = |f: f64| amplitude(samples, step, f);
    let width = 0.25 / (samples.len() as f64 * step);
    let scan = (0..).map(|k| 0.88 * guess + width * f64::from(k));
    let scan: Vec<f64> = scan.take_while(|f| *f < 1.12 * guess).collect();
    let best = scan.iter().fold(guess, |b, &f| if at(f) > at(b) { f } else { b });
    let (mut low, mut high) = (best - width, best + width);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..30 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if at(a) > at(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

/// Mean of evenly spaced samples under a Hann window: the oscillations drop out.
fn windowed_mean(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let window = |k: usize| 1.0 - (2.0 * PI * k as f64 / n).cos();
    samples
        .iter()
        .enumerate()
        .map(|(k, s)| window(k) * s)
        .sum::<f64>()
        / n
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let count = arguments.next().map_or(Ok(5_000), |a| a.parse())?;
    let periods: f64 = arguments.next().map_or(Ok(12.0), |a| a.parse())?;
    let bar = Container::cylinder(LENGTH, RADIUS)?;
    let seed = arguments.next().map_or(Ok(1), |a| a.parse())?;
    let spec = match arguments.next().as_deref() {
        Some("quench") => PackingSpec::quench(bar, count, seed),
        _ => PackingSpec::new(bar, count, seed),
    };
    let clock = std::time::Instant::now();
    let model = DemModel::new("beam A", &spec.build()?, BeamMaterial::SILICA, DENSITY)?;
    println!(
        "{}\npacked in {:.1} s",
        model.report(),
        clock.elapsed().as_secs_f64()
    );
    // The wall is at x = 0, but what is held are centres about one mean radius inside.
    let layer = model.clamp_layer(&Point3::origin(), &Vector3::x());
    let fixed = model.clamped(&layer);
    let plane = layer.iter().map(|&i| model.nodes()[i].x).sum::<f64>() / layer.len() as f64;
    let end = model.clamp_layer(&Point3::new(LENGTH, 0.0, 0.0), &Vector3::x());
    println!("{} unknowns fixed, {} particles loaded", fixed.len(), end.len());
    let load = model.force(&end, Vector3::new(FORCE, 0.0, 0.0), LoadShare::Area)?;
    let total: f64 = end.iter().map(|&i| model.masses()[i]).sum();
    let watch: Vec<(usize, f64)> = end.iter().map(|&i| (3 * i, model.masses()[i] / total)).collect();
    let body = Subdomain::fine(model, Weights::uncoupled())
        .with_support(PrescribedMotion::fixed(fixed))
        .with_effect(Box::new(Load::on_dofs("pull", load, TimeFunction::Step)?));
    let guard = Guard {
        interval: 500,
        growth: 0.05,
    };
    let mut run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.9), Some(guard))?;
    println!("time step {:.4} ns", run.dt() * 1e9);
    // Thirty samples in the third period.
    let every = ((1.0 / THEORY[2] / 30.0 / run.dt()) as usize).max(1);
    let step = every as f64 * run.dt();
    let wanted = (periods / THEORY[0] / step) as usize;
    let mut samples = Vec::with_capacity(wanted);
    let clock = std::time::Instant::now();
    for _ in 0..wanted {
        run.run(every, &mut Silent)?;
        let q = &run.subdomains()[0].state().q;
        samples.push(watch.iter().map(|(d, w)| w * q[*d]).sum::<f64>());
    }
    println!(
        "{} steps in {:.1} s, energy drift {:.1e}",
        run.steps(),
        clock.elapsed().as_secs_f64(),
        run.drift()
    );
    println!(
        "U_mean {:.4} mm (theory 0.0878, published 0.083)",
        windowed_mean(&samples) * 1e3
    );
    let first = peak(&samples, step, THEORY[0]);
    let young = |length: f64| DENSITY * (4.0 * length * first).powi(2) / 1e9;
    println!(
        "E from f0: {:.2} GPa with the length of the body, {:.2} GPa from the centres held at x = {:.4} mm",
        young(LENGTH),
        young(LENGTH - plane),
        plane * 1e3
    );
    for k in 0..3 {
        let f = peak(&samples, step, THEORY[k]);
        println!(
            "f{k} {f:9.0} Hz   theory {:7.0} ({:+.2} %)   published {:7.0} ({:+.2} %)",
            THEORY[k],
            100.0 * (f / THEORY[k] - 1.0),
            PUBLISHED[k],
            100.0 * (f / PUBLISHED[k] - 1.0)
        );
    }
    Ok(())
}

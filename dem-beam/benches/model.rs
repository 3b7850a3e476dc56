//! The forces of the model alone, the core's whole step, the step with its ledger, and what watching
//! strengths and contact add to it, measured in turns; the critical step and its bound.
//!
//! `cargo bench -p dem-beam --bench model [particles ...]`; default 20 000 (packed) and 1 000 000 (a cubic
//! lattice: 6 neighbours against the packing's 6.2). Strengths are looked at up to 200 000 particles.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin_core::{
    Coupled, Guard, Model, Partition, Silent, StepBound, Subdomain, TimeStep, Uniform, Weight, Weights,
};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{
    BeamMaterial, Contact, ContactLaw, Container, Criterion, DemModel, Fracture, Packing, PackingSpec,
    Scatter,
};
use nalgebra::Point3;
use std::sync::Arc;
use std::time::Instant;

/// Linear from 1 to 0.05 along the body.
#[derive(Debug)]
struct Along;

impl Weight<f64> for Along {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.95 * (x.x / 20e-3).clamp(0.0, 1.0)
    }
}

/// A name and what it does a number of times.
type NamedJob<'a> = (&'static str, Box<dyn FnMut(usize) + Send + 'a>);

/// Best time per call (ns per bond) of several jobs, taken in turns so that all see the same machine.
fn best(jobs: &mut [NamedJob<'_>], rounds: usize, calls: usize, bonds: usize) -> Vec<f64> {
    let mut out = vec![f64::INFINITY; jobs.len()];
    for _ in 0..rounds {
        for ((_, job), best) in jobs.iter_mut().zip(&mut out) {
            let start = Instant::now();
            job(calls);
            let ns = start.elapsed().as_secs_f64() * 1e9 / (calls * bonds) as f64;
            *best = best.min(ns);
        }
    }
    out
}

/// Forces alone, a step, a step with its ledger; the first is one.
fn measure(packing: &Packing, finite: bool, threads: usize) -> Result<(), Box<dyn std::error::Error>> {
    let make = || -> Result<DemModel, dem_beam::Error> {
        let m = DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0)?;
        Ok(if finite { m.with_finite_rotations() } else { m })
    };
    let mut model = make()?;
    model.set_internal_weight(&Along)?;
    let n = model.layout().dofs();
    let wave = |linear: f64, angular: f64| -> Vec<f64> {
        let size = |i: usize| if i < n / 2 { linear } else { angular };
        (0..n).map(|i| (i as f64).sin() * size(i)).collect()
    };
    let (q, mut f) = (wave(1e-9, 1e-4), vec![0.0; n]);
    let run = |interval: usize| -> Result<Coupled<f64>, Box<dyn std::error::Error>> {
        let side = Subdomain::fine(make()?, Weights::from_weight(Arc::new(Along)))
            .with_partition(Partition::Unchecked)
            .with_initial(vec![0.0; n], wave(1e-3, 0.0))?;
        let guard = Guard {
            interval,
            growth: 0.05,
        };
        Ok(Coupled::new(
            vec![side],
            Vec::new(),
            TimeStep::Fraction(0.5),
            Some(guard),
        )?)
    };
    let (mut step, mut ledger) = (run(1_000_000)?, run(1)?);
    let count = packing.radii.len();
    let (rounds, calls) = if count > PACKED {
        (6, 3)
    } else {
        (60, (400_000 / count).clamp(2, 100))
    };
    let mut jobs: Vec<NamedJob<'_>> = vec![
        (
            "forces alone",
            Box::new(|k| {
                for _ in 0..k {
                    let _ = std::hint::black_box(model.advance(&q, &mut f));
                }
            }),
        ),
        (
            "step",
            Box::new(|k| {
                let _ = std::hint::black_box(step.run(k, &mut Silent));
            }),
        ),
        (
            "step with its ledger",
            Box::new(|k| {
                let _ = std::hint::black_box(ledger.run(k, &mut Silent));
            }),
        ),
    ];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let times = pool.install(|| best(&mut jobs, rounds, calls, packing.pairs.len()));
    let law = if finite { "finite" } else { "linear" };
    for ((name, _), t) in jobs.iter().zip(&times) {
        println!(
            "{law} threads {threads}  {name:<26} {t:6.2} ns/bond  {:4.2} of the forces  {:4.2} of the step",
            t / times[0],
            t / times[1]
        );
    }
    Ok(())
}

/// Measures what watching strengths adds to the step: without, with each criterion, with strengths that
/// scatter, and with bonds compared one by one. Every bond is loaded far below its strength.
fn strengths(packing: &Packing, finite: bool, threads: usize) -> Result<(), Box<dyn std::error::Error>> {
    let guard = Guard {
        interval: 1_000_000,
        growth: 0.05,
    };
    let make = |spec: Option<Fracture>, plain: bool| -> Result<Coupled<f64>, Box<dyn std::error::Error>> {
        let mut m = DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0)?;
        if finite {
            m = m.with_finite_rotations();
        }
        if let Some(spec) = spec {
            m = m.with_fracture(spec)?;
        }
        if plain {
            m = m.with_plain_checks();
        }
        let n = m.layout().dofs();
        let v = (0..n).map(|i| (i as f64).sin() * if i < n / 2 { 1e-3 } else { 0.0 });
        let v: Vec<f64> = v.collect();
        let side = Subdomain::fine(m, Weights::from_weight(Arc::new(Along)))
            .with_partition(Partition::Unchecked)
            .with_initial(vec![0.0; n], v)?;
        Ok(Coupled::new(
            vec![side],
            Vec::new(),
            TimeStep::Fraction(0.5),
            Some(guard),
        )?)
    };
    let rankine = Fracture::new(Criterion::Rankine, 500e6);
    let softening = Fracture {
        dissipated: Some(200.0),
        ..Fracture::new(Criterion::TensileEnergy, 50.0)
    };
    let cases = [
        ("step without fracture", None, false),
        ("axial", Some(Fracture::new(Criterion::Axial, 500e6)), false),
        ("rankine", Some(rankine), false),
        ("mises", Some(Fracture::new(Criterion::Mises, 500e6)), false),
        ("energy", Some(Fracture::new(Criterion::Energy, 50.0)), false),
        (
            "tensile-energy",
            Some(Fracture::new(Criterion::TensileEnergy, 50.0)),
            false,
        ),
        (
            "hydrostatic",
            Some(Fracture::new(Criterion::Hydrostatic, 500e6)),
            false,
        ),
        ("beams that soften", Some(softening), false),
        (
            "rankine, strengths scatter",
            Some(Fracture {
                scatter: Scatter::Weibull { modulus: 10.0 },
                ..rankine
            }),
            false,
        ),
        ("rankine, one by one", Some(rankine), true),
    ];
    let mut runs = Vec::new();
    for (_, spec, plain) in &cases {
        runs.push(make(*spec, *plain)?);
    }
    let mut jobs: Vec<NamedJob<'_>> = Vec::new();
    for ((name, ..), run) in cases.iter().zip(&mut runs) {
        let job = move |k: usize| {
            let _ = std::hint::black_box(run.run(k, &mut Silent));
        };
        jobs.push((name, Box::new(job)));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let times = pool.install(|| best(&mut jobs, 60, 10, packing.pairs.len()));
    let law = if finite { "finite" } else { "linear" };
    // `energy` is the measure of the criteria that came after it.
    let energy = jobs.iter().position(|j| j.0 == "energy").unwrap_or(0);
    for ((name, _), t) in jobs.iter().zip(&times) {
        println!(
            "{law} threads {threads}  {name:<26} {t:6.2} ns/bond  {:5.2} more, {:4.1} % of the step, {:4.2} of the step by energy",
            t - times[0],
            100.0 * (t - times[0]) / t,
            t / times[energy]
        );
    }
    Ok(())
}

/// Measures what contact adds to the step, as a multiple of the bare step, in waves of up to 10 m/s. Pairs
/// come near each other, and hardly any touch.
fn contact(packing: &Packing, threads: usize) -> Result<(), Box<dyn std::error::Error>> {
    let make = |fracture: bool, contact: bool| -> Result<Coupled<f64>, Box<dyn std::error::Error>> {
        let mut m = DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0)?;
        if fracture {
            m = m.with_fracture(Fracture::new(Criterion::Rankine, 50e9))?;
        }
        let n = m.layout().dofs();
        let mut v = vec![0.0; n];
        for (v, x) in v.as_chunks_mut::<3>().0.iter_mut().zip(m.nodes()) {
            v[0] = 10.0 * (300.0 * x.x).sin();
        }
        let law = ContactLaw::elastic(72.5e9);
        let effect = contact.then(|| Contact::new(&m, law)).transpose()?;
        let side = Subdomain::fine(m, Weights::uncoupled()).with_initial(vec![0.0; n], v)?;
        let side = match effect {
            Some(effect) => side.with_effect(Box::new(effect)),
            None => side,
        };
        let guard = Guard {
            interval: 1_000_000,
            growth: 0.05,
        };
        let step = TimeStep::Fraction(0.5);
        Ok(Coupled::new(vec![side], Vec::new(), step, Some(guard))?)
    };
    let names = [
        "bare step",
        "with contact",
        "with fracture",
        "with fracture and contact",
    ];
    let mut runs = Vec::new();
    for k in 0..names.len() {
        runs.push(make(k > 1, k % 2 == 1)?);
    }
    let mut jobs: Vec<NamedJob<'_>> = Vec::new();
    for (name, run) in names.into_iter().zip(&mut runs) {
        let job = move |k: usize| {
            let _ = std::hint::black_box(run.run(k, &mut Silent));
        };
        jobs.push((name, Box::new(job)));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let times = pool.install(|| best(&mut jobs, 60, 10, packing.pairs.len()));
    for (name, t) in names.into_iter().zip(&times) {
        let ratio = t / times[0];
        println!("linear threads {threads}  {name:<26} {t:6.2} ns/bond  {ratio:4.2} of the bare step");
    }
    Ok(())
}

/// Set-up with an automatic step, and with a step in seconds that the bound of the blocks admits.
fn critical(packing: &Packing) -> Result<(), Box<dyn std::error::Error>> {
    let mut m = DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0)?;
    let mut inertia = vec![0.0; m.layout().dofs()];
    m.lumped_inertia(&Uniform(1.0), &mut inertia)?;
    let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
    let start = Instant::now();
    let longest = m.critical_step(&inverse)?;
    let middle = Instant::now();
    let bound = m.step_bound(&inverse);
    let [lanczos, blocks] = [middle - start, middle.elapsed()].map(|t| t.as_secs_f64());
    println!(
        "critical step {lanczos:6.3} s, its bound {blocks:6.3} s: {:4.3} of the time, {:4.3} of the step",
        blocks / lanczos,
        bound / longest
    );
    Ok(())
}

/// Most particles that are packed.
const PACKED: usize = 200_000;

fn packing(count: usize) -> Result<Packing, dem_beam::Error> {
    if count > PACKED {
        let edge = (count as f64).cbrt().round() as usize;
        return lattice(Lattice::Cubic, [edge; 3], 1e-4);
    }
    PackingSpec::quench(Container::cylinder(20e-3, 1e-3)?, count, 1)
        .build_cached(&std::env::temp_dir().join("dem-beam-bench"))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let counts: Vec<usize> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let counts = if counts.is_empty() {
        vec![20_000, 1_000_000]
    } else {
        counts
    };
    for count in counts {
        let packing = packing(count)?;
        println!("{} particles, {} bonds", packing.radii.len(), packing.pairs.len());
        critical(&packing)?;
        for threads in [1, 2] {
            if count <= PACKED {
                contact(&packing, threads)?;
            }
        }
        for finite in [false, true] {
            for threads in [1, 2] {
                measure(&packing, finite, threads)?;
                if count <= PACKED {
                    strengths(&packing, finite, threads)?;
                }
            }
        }
    }
    Ok(())
}

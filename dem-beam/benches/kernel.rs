//! The kernel's whole velocity-Verlet step: ns per bond, bytes per bond, share of the measured memory bandwidth; peak
//! memory at a million particles.
//!
//! `cargo bench -p dem-beam --bench kernel` prints a table of minima over many short runs (the number that repeats on
//! a shared machine), then divan's statistics of the same runs at 20 000 particles.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin_core::observer::Silent;
use arlequin_core::{Coupled, Subdomain, TimeStep, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{
    BeamDynamics, BeamMaterial, BondedParticles, Container, DemModel, Packing, PackingSpec, Twist,
};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::error::Error;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Argument of the process that measures peak memory.
const MEMORY: &str = "peak-memory-of-a-million";

/// A bar of packed spheres (single quench, kept on disk between runs), or a million on a cubic lattice: 6 neighbours
/// against the packing's 6.2.
fn packing(count: usize) -> Outcome<Packing> {
    if count > 200_000 {
        let edge = (count as f64).cbrt().round() as usize;
        return Ok(lattice(Lattice::Cubic, [edge; 3], 1e-4)?);
    }
    let cache = std::env::temp_dir().join("dem-beam-bench");
    Ok(PackingSpec::quench(Container::cylinder(20e-3, 1e-3)?, count, 1).build_cached(&cache)?)
}

fn body(count: usize) -> Outcome<BondedParticles> {
    Ok(packing(count)?.bonded(BeamMaterial::SILICA, 2200.0)?)
}

fn kick(n: usize) -> Vec<Twist> {
    (0..n)
        .map(|i| Twist {
            linear: Vector3::new((i as f64).sin(), (i as f64).cos(), 0.3) * 1e-3,
            angular: Vector3::zeros(),
        })
        .collect()
}

/// Something that makes steps, with its bytes per bond (bond data; all) and the share of lanes in use.
struct Engine {
    run: Box<dyn FnMut(usize) + Send>,
    bytes: [f64; 2],
    fill: f64,
    isa: &'static str,
}

macro_rules! engine {
    ($t:ty, $law:ident, $body:expr) => {{
        let mut d = BeamDynamics::<$t>::$law($body, 1e-9)?;
        d.set_velocities(&kick($body.len()))?;
        Ok(Engine {
            bytes: [d.bytes_per_bond(), d.traffic_per_bond()],
            fill: d.lane_fill(),
            isa: d.instruction_set(),
            run: Box::new(move |n| d.run(n)),
        })
    }};
}

const CASES: [&str; 4] = ["linear f64", "linear f32", "finite f64", "finite f32"];

fn engine(case: &str, body: &BondedParticles) -> Outcome<Engine> {
    match case {
        "linear f64" => engine!(f64, linear, body),
        "linear f32" => engine!(f32, linear, body),
        "finite f64" => engine!(f64, finite, body),
        _ => engine!(f32, finite, body),
    }
}

fn pool(threads: usize) -> Outcome<rayon::ThreadPool> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(threads).build()?)
}

/// Least time of `repeats` calls (s).
fn least(repeats: usize, mut call: impl FnMut()) -> f64 {
    call();
    (0..repeats)
        .map(|_| {
            let start = Instant::now();
            call();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// Bytes per second of `a = b + 3 c` on three arrays of together `bytes`; 24 bytes per element are counted.
fn triad(pool: &rayon::ThreadPool, bytes: usize) -> f64 {
    const PART: usize = 8_192;
    let n = bytes / 24;
    let (b, c) = (vec![1.0_f64; n], vec![2.0_f64; n]);
    let mut a = vec![0.0_f64; n];
    let passes = (50_000_000 / bytes).max(1);
    let seconds = pool.install(|| {
        least(30, || {
            for _ in 0..passes {
                let parts = a
                    .par_chunks_mut(PART)
                    .zip(b.par_chunks(PART).zip(c.par_chunks(PART)));
                parts.for_each(|(a, (b, c))| {
                    for (a, (b, c)) in a.iter_mut().zip(b.iter().zip(c)) {
                        *a = *b + 3.0 * *c;
                    }
                });
                std::hint::black_box(&mut a);
            }
        })
    });
    (24 * n * passes) as f64 / seconds
}

fn table() -> Outcome<()> {
    for count in [20_000, 1_000_000] {
        let body = body(count)?;
        let bonds = body.pairs().len();
        println!("{} particles, {bonds} bonds", body.len());
        let mut first = [f64::INFINITY; CASES.len()];
        for threads in [1, 2] {
            let pool = pool(threads)?;
            // About the size of what a step touches at 20 000 particles, and far beyond any cache.
            let bandwidth = triad(
                &pool,
                if count == 20_000 {
                    12_000_000
                } else {
                    1_200_000_000
                },
            );
            println!("threads {threads}: triad {:.1} GB/s", bandwidth * 1e-9);
            for (case, first) in CASES.iter().zip(&mut first) {
                let mut e = engine(case, &body)?;
                // `run(n)` evaluates forces n + 1 times.
                let steps = if count == 20_000 { 4 } else { 2 };
                let repeats = if count == 20_000 { 300 } else { 8 };
                let t = pool.install(|| least(repeats, || (e.run)(steps - 1)));
                let ns = t * 1e9 / (steps * bonds) as f64;
                *first = first.min(ns);
                println!(
                    "  {case}  {ns:6.2} ns/bond/step  x{:4.2}  {:5.1} B/bond of bonds, {:5.1} in all  {:3.0} % of the triad  lanes {:.3}  {}",
                    *first / ns,
                    e.bytes[0],
                    e.bytes[1],
                    100.0 * e.bytes[1] / (ns * 1e-9) / bandwidth,
                    e.fill,
                    e.isa
                );
            }
        }
    }
    Ok(())
}

/// Builds the coupled model of a million particles, makes two steps, prints the largest resident size so far.
fn peak_memory() -> Outcome<()> {
    let model = DemModel::new("cube", &packing(1_000_000)?, BeamMaterial::SILICA, 2200.0)?;
    let side = Subdomain::fine(model, Weights::uncoupled());
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Seconds(1e-9), None)?;
    run.run(2, &mut Silent)?;
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status
        .lines()
        .find(|l| l.starts_with("VmHWM"))
        .unwrap_or("VmHWM: unknown");
    println!("coupled model of a million particles, built and stepped: {peak}");
    Ok(())
}

fn main() -> Outcome<()> {
    if std::env::args().any(|a| a == MEMORY) {
        return peak_memory();
    }
    table()?;
    let status = std::process::Command::new(std::env::current_exe()?)
        .arg(MEMORY)
        .status()?;
    if !status.success() {
        return Err("the process that measures memory failed".into());
    }
    divan::main();
    Ok(())
}

/// Two steps of 20 000 particles on one thread.
#[divan::bench(args = CASES, sample_count = 200, sample_size = 1)]
fn two_steps(bencher: divan::Bencher<'_, '_>, case: &str) {
    let (Ok(body), Ok(pool)) = (body(20_000), pool(1)) else {
        return;
    };
    let Ok(mut e) = engine(case, &body) else { return };
    let bonds = 2 * body.pairs().len();
    bencher
        .counter(divan::counter::ItemsCount::new(bonds))
        .counter(divan::counter::BytesCount::new(
            (e.bytes[1] * bonds as f64) as usize,
        ))
        .bench_local(|| pool.install(|| (e.run)(1)));
}

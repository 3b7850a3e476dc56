//! The forces of the model: ns per bond, bytes per bond, share of the measured memory bandwidth; peak
//! memory at a million particles.
//!
//! `cargo bench -p dem-beam --bench kernel` prints a table of minima over many short runs (the number that
//! repeats on a shared machine), then divan's statistics of the same runs at 20 000 particles.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin_core::{Coupled, Model, Silent, Subdomain, TimeStep, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Container, DemModel, Packing, PackingSpec};
use rayon::prelude::*;
use std::error::Error;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Argument of the process that measures peak memory.
const MEMORY: &str = "peak-memory-of-a-million";

/// A bar of packed spheres (single quench, kept on disk between runs), or a million on a cubic lattice: 6
/// neighbours against the packing's 6.2.
fn packing(count: usize) -> Outcome<Packing> {
    if count > 200_000 {
        let edge = (count as f64).cbrt().round() as usize;
        return Ok(lattice(Lattice::Cubic, [edge; 3], 1e-4)?);
    }
    let cache = std::env::temp_dir().join("dem-beam-bench");
    Ok(PackingSpec::quench(Container::cylinder(20e-3, 1e-3)?, count, 1).build_cached(&cache)?)
}

/// A model in a deformed state.
struct Deformed {
    model: DemModel,
    q: Vec<f64>,
    f: Vec<f64>,
}

impl Deformed {
    fn forces(&mut self, times: usize) {
        for _ in 0..times {
            let _ = std::hint::black_box(self.model.advance(&self.q, &mut self.f));
        }
    }
}

const LAWS: [&str; 2] = ["linear", "finite"];

fn deformed(law: &str, packing: &Packing) -> Outcome<Deformed> {
    let model = DemModel::new("bar", packing, BeamMaterial::SILICA, 2200.0)?;
    let model = if law == "finite" {
        model.with_finite_rotations()
    } else {
        model
    };
    let n = model.layout().dofs();
    let q = (0..n).map(|i| (i as f64).sin() * if i < n / 2 { 1e-9 } else { 1e-4 });
    Ok(Deformed {
        model,
        q: q.collect(),
        f: vec![0.0; n],
    })
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
        let packing = packing(count)?;
        let bonds = packing.pairs.len();
        println!("{} particles, {bonds} bonds", packing.radii.len());
        // About the size of what a step touches at 20 000 particles, and far beyond any cache.
        let (bytes, times, repeats) = if count == 20_000 {
            (12_000_000, 4, 300)
        } else {
            (1_200_000_000, 2, 8)
        };
        for law in LAWS {
            let mut state = deformed(law, &packing)?;
            let report = state.model.report();
            let mut first = f64::INFINITY;
            for threads in [1, 2] {
                let pool = pool(threads)?;
                let bandwidth = triad(&pool, bytes);
                let t = pool.install(|| least(repeats, || state.forces(times)));
                let ns = t * 1e9 / (times * bonds) as f64;
                first = first.min(ns);
                println!(
                    "  {law} threads {threads}  {ns:6.2} ns/bond  x{:4.2}  {:5.1} B/bond  {:3.0} % of the triad, {:.1} GB/s  {}",
                    first / ns,
                    report.bytes_per_bond,
                    100.0 * report.bytes_per_bond / (ns * 1e-9) / bandwidth,
                    bandwidth * 1e-9,
                    report.instruction_set
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

/// Forces on 20 000 particles, twice on one thread.
#[divan::bench(args = LAWS, sample_count = 200, sample_size = 1)]
fn forces_twice(bencher: divan::Bencher<'_, '_>, law: &str) {
    let (Ok(packing), Ok(pool)) = (packing(20_000), pool(1)) else {
        return;
    };
    let Ok(mut state) = deformed(law, &packing) else {
        return;
    };
    bencher
        .counter(divan::counter::ItemsCount::new(2 * packing.pairs.len()))
        .bench_local(|| pool.install(|| state.forces(2)));
}

//! ns per bond and step of the whole velocity-Verlet step, bytes per bond, bandwidth.
//!
//! `cargo bench -p dem-beam --bench kernel [particles ...]`; default 20 000. Packings are quenched
//! ones; above 200 000 particles a regular lattice with jitter stands in.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use dem_beam::{BeamDynamics, BeamMaterial, BondedParticles, Container, DemError, PackingSpec, Twist};
use nalgebra::Vector3;
use std::time::Instant;

fn body(count: usize) -> Result<BondedParticles, DemError> {
    let bar = Container::cylinder(20e-3, 1e-3)?;
    PackingSpec::quench(bar, count, 1)
        .build()?
        .bonded(BeamMaterial::SILICA, 2200.0)
}

/// Best of `repeats` runs (s per step).
fn best(run: &mut dyn FnMut(usize), steps: usize, repeats: usize) -> f64 {
    run(2);
    (0..repeats)
        .map(|_| {
            let start = Instant::now();
            run(steps - 1);
            start.elapsed().as_secs_f64() / steps as f64
        })
        .fold(f64::INFINITY, f64::min)
}

fn report(name: &str, threads: usize, bonds: usize, bytes: f64, seconds: f64) {
    let ns = seconds * 1e9 / bonds as f64;
    println!(
        "{name:<12} threads {threads}  {ns:7.2} ns/bond/step  {bytes:6.1} B/bond  {:6.1} GB/s of bond data",
        bytes / ns
    );
}

fn main() -> Result<(), DemError> {
    let counts: Vec<usize> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let counts = if counts.is_empty() { vec![20_000] } else { counts };
    for count in counts {
        let start = Instant::now();
        let body = body(count)?;
        let bonds = body.pairs().len();
        println!(
            "{} particles, {bonds} bonds, packed in {:.1} s",
            body.len(),
            start.elapsed().as_secs_f64()
        );
        let kick: Vec<Twist> = (0..body.len())
            .map(|i| Twist {
                linear: Vector3::new((i as f64).sin(), (i as f64).cos(), 0.3) * 1e-3,
                angular: Vector3::zeros(),
            })
            .collect();
        // Short runs: on a busy machine the best of many is what the kernel can do.
        let steps = (200_000 / count).clamp(4, 100);
        let repeats = if count > 100_000 { 12 } else { 120 };
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let Ok(pool) = pool else { continue };
            let mut linear = BeamDynamics::<f64>::linear(&body, 1e-9)?;
            linear.set_velocities(&kick)?;
            let t = best(&mut |n| pool.install(|| linear.run(n)), steps, repeats);
            report("linear f64", threads, bonds, linear.bytes_per_bond(), t);
            if threads == 1 {
                println!("{}", linear.instruction_set());
            }
            drop(linear);
            let mut single = BeamDynamics::<f32>::linear(&body, 1e-9)?;
            single.set_velocities(&kick)?;
            let t = best(&mut |n| pool.install(|| single.run(n)), steps, repeats);
            report("linear f32", threads, bonds, single.bytes_per_bond(), t);
            drop(single);
            let mut finite = BeamDynamics::<f64>::finite(&body, 1e-9)?;
            finite.set_velocities(&kick)?;
            let t = best(&mut |n| pool.install(|| finite.run(n)), steps, repeats);
            report("finite f64", threads, bonds, finite.bytes_per_bond(), t);
        }
    }
    Ok(())
}

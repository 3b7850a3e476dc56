//! Internal forces of one body by each continuum model: nanoseconds per node and call, and the ratio to
//! linear tetrahedra with the same number of nodes. Shown is the minimum of many calls, taken in turns,
//! since other work on the machine only adds time.
//!
//! Run with `cargo bench --bench forces`; set `RAYON_NUM_THREADS` for the number of threads.
#![allow(clippy::print_stdout, reason = "a benchmark shows its figures")]

use arlequin::core::{Elastic, Model};
use arlequin::fem_ref::{ElementKind, FemModel, generate};
use arlequin::{cnem, fem_ref};
use cnem::{CnemModel, Options, Stabilisation, constraint::Surface, domain::Domain};
use nalgebra::Point3;
use std::time::Instant;

/// Nodes along an edge of the cube: in the cache, at the size of an earlier record, beyond the cache.
const SIZES: [usize; 3] = [10, 21, 32];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Started as a test or to be listed, the program shows nothing.
    let bench = std::env::args().any(|a| a == "--bench");
    for n in SIZES.into_iter().take(if bench { SIZES.len() } else { 0 }) {
        compare(n)?;
    }
    Ok(())
}

fn compare(n: usize) -> Result<(), Box<dyn std::error::Error>> {
    let material = Elastic::new(72.5e9, 0.17, 2200.0)?;
    let mesh = |kind| {
        let high = Point3::new(1.0, 1.0, 1.0);
        generate::block(kind, Point3::origin(), high, [n - 1; 3])
    };
    let fem = |kind| -> fem_ref::Result<FemModel<f64>> { FemModel::new("cube", mesh(kind)?, material) };
    let mut models: Vec<(&str, Box<dyn Model<f64>>)> = vec![
        ("tetrahedra", Box::new(fem(ElementKind::Tet4)?)),
        ("hexahedra", Box::new(fem(ElementKind::Hex8)?)),
    ];
    let nodes = shaken(mesh(ElementKind::Hex8)?.nodes(), n);
    for (name, stabilisation) in [
        ("natural, bare", Stabilisation::None),
        ("natural", Stabilisation::default()),
    ] {
        let options = Options {
            stabilisation,
            ..Options::default()
        };
        let domain = Domain::new(&nodes, &Surface::convex_hull())?;
        models.push((name, Box::new(CnemModel::new("cube", domain, material, options)?)));
    }
    let q: Vec<f64> = (0..3 * nodes.len()).map(|i| 1e-6 * (i as f64).sin()).collect();
    let mut f = vec![0.0; q.len()];
    let mut best = vec![[f64::INFINITY; 2]; models.len()];
    for _ in 0..200_000_usize.div_ceil(nodes.len()).max(20) {
        for ((_, model), best) in models.iter_mut().zip(&mut best) {
            let begin = Instant::now();
            model.add_internal_forces(&q, &mut f)?;
            best[0] = best[0].min(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            std::hint::black_box(model.internal_energy(&q));
            best[1] = best[1].min(begin.elapsed().as_secs_f64());
        }
    }
    for ((name, _), time) in models.iter().zip(&best) {
        let ns = time.map(|t| 1e9 * t / nodes.len() as f64);
        println!(
            "{:>6} nodes  {name:<14} forces {:7.1} ns, {:5.2} × tetrahedra; energy {:7.1} ns, {:5.2} ×",
            nodes.len(),
            ns[0],
            time[0] / best[0][0],
            ns[1],
            time[1] / best[0][1]
        );
    }
    Ok(())
}

/// Moves inner nodes off the grid by up to a fifth of its spacing.
fn shaken(nodes: &[Point3<f64>], n: usize) -> Vec<Point3<f64>> {
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ((state >> 40) as f64 / (1_u64 << 24) as f64 - 0.5) * 0.4 / (n - 1) as f64
    };
    let moved = nodes
        .iter()
        .map(|p| p.map(|c| if c > 0.0 && c < 1.0 { c + noise() } else { c }));
    moved.collect()
}

//! Seconds for the Delaunay tetrahedralisation and the Voronoi cells; shape functions per second (divan's
//! item rate). Where Qhull is installed through `SciPy`, the ratio to `scipy.spatial.Delaunay` on the same
//! points is printed first. Run with `cargo bench -p cnem --bench geometry`.

use cnem::constraint::Surface;
use cnem::delaunay::Delaunay;
use cnem::domain::Domain;
use cnem::natural::{Interpolant, Scratch};
use divan::Bencher;
use divan::counter::ItemsCount;
use nalgebra::Point3;
use std::process::Command;
use std::time::Instant;

/// Reads points as raw doubles, prints the shortest of the given number of times.
const QHULL: &str = "
import sys, time
try:
    import numpy
    from scipy.spatial import Delaunay
except ImportError:
    sys.exit(3)
points = numpy.fromfile(sys.argv[1]).reshape(-1, 3)
best = float('inf')
for _ in range(int(sys.argv[2])):
    start = time.perf_counter()
    Delaunay(points)
    best = min(best, time.perf_counter() - start)
print(best)
";

fn main() {
    // Not when benchmarks are listed, or run once as tests.
    if std::env::args().any(|a| a == "--bench") {
        compare();
    }
    divan::main();
}

/// Prints the times of this crate and of Qhull, both the best of some runs, without reading and starting up.
#[allow(clippy::print_stdout, reason = "a benchmark shows its figures")]
fn compare() {
    for (n, repeats) in [(10_000, 5), (100_000, 3)] {
        let points = random(n);
        let ours = (0..repeats).map(|_| {
            let start = Instant::now();
            let complex = divan::black_box(Delaunay::new(&points));
            let seconds = start.elapsed().as_secs_f64();
            if complex.is_ok() { seconds } else { f64::NAN }
        });
        let ours = ours.fold(f64::INFINITY, f64::min);
        match qhull(&points, repeats) {
            Ok(theirs) => println!(
                "Delaunay of {n} points: {ours:.3} s, Qhull (SciPy) {theirs:.3} s, ratio {:.2}",
                theirs / ours
            ),
            Err(reason) => return println!("no comparison with Qhull: {reason}"),
        }
    }
}

/// Seconds of `scipy.spatial.Delaunay`, taken inside Python.
fn qhull(points: &[Point3<f64>], repeats: usize) -> Result<f64, String> {
    let file = std::env::temp_dir().join(format!("cnem-qhull-{}.bin", std::process::id()));
    let bytes: Vec<u8> = points
        .iter()
        .flat_map(|p| [p.x, p.y, p.z])
        .flat_map(f64::to_ne_bytes)
        .collect();
    std::fs::write(&file, bytes).map_err(|e| format!("{}: {e}", file.display()))?;
    let run = Command::new("python3")
        .args(["-c", QHULL])
        .arg(&file)
        .arg(repeats.to_string())
        .output();
    // A file left behind in the temporary directory does no harm.
    let _ = std::fs::remove_file(&file);
    let run = run.map_err(|e| format!("python3 does not start: {e}"))?;
    match run.status.code() {
        Some(0) => String::from_utf8_lossy(&run.stdout)
            .trim()
            .parse()
            .map_err(|e| format!("output of python3: {e}")),
        Some(3) => Err("SciPy is not installed".to_owned()),
        _ => Err(String::from_utf8_lossy(&run.stderr).into_owned()),
    }
}

/// Deterministic numbers in [0, 1).
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn random(n: usize) -> Vec<Point3<f64>> {
    let mut r = noise(42);
    (0..n).map(|_| Point3::new(r(), r(), r())).collect()
}

#[divan::bench(args = [10_000, 100_000, 1_000_000], sample_count = 2, sample_size = 1)]
fn delaunay_random(bencher: Bencher, n: usize) {
    let points = random(n);
    bencher.bench_local(|| Delaunay::new(&points));
}

#[divan::bench(args = [20, 40], sample_count = 2, sample_size = 1)]
fn delaunay_grid(bencher: Bencher, n: usize) {
    let grid_point = |i: usize| Point3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
    let points: Vec<_> = (0..n * n * n).map(grid_point).collect();
    bencher.bench_local(|| Delaunay::new(&points));
}

/// Rates at random points of a random domain of 10 000 nodes; the argument tells whether gradients are
/// computed.
#[divan::bench(args = [false, true], consts = [0, 1], sample_count = 5, sample_size = 1)]
fn shape<const LAPLACE: usize>(bencher: Bencher, gradients: bool) {
    let Ok(domain) = Domain::new(&random(10_000), &Surface::convex_hull()) else {
        return;
    };
    let kind = if LAPLACE == 1 {
        Interpolant::Laplace
    } else {
        Interpolant::Sibson
    };
    let mut r = noise(7);
    let queries: Vec<_> = (0..20_000)
        .map(|_| Point3::new(r(), r(), r()).map(|c| 0.05 + 0.9 * c))
        .collect();
    let mut s = Scratch::new();
    bencher.counter(ItemsCount::new(queries.len())).bench_local(|| {
        let mut sum = 0.0;
        for x in &queries {
            let row = if gradients {
                domain.shape_with_gradients(kind, x, &mut s)
            } else {
                domain.shape(kind, x, &mut s)
            };
            sum += row.map_or(f64::NAN, |r| r.values[0]);
        }
        sum
    });
}

#[divan::bench(args = [10_000], sample_count = 2, sample_size = 1)]
fn voronoi_random(bencher: Bencher, n: usize) {
    let Ok(domain) = Domain::new(&random(n), &Surface::convex_hull()) else {
        return;
    };
    bencher.bench_local(|| domain.voronoi());
}

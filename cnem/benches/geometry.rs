//! Seconds for the Delaunay tetrahedralisation and the Voronoi cells; shape functions per second (divan's item rate).
//! Run with `cargo bench -p cnem --bench geometry`.

use cnem::constraint::Surface;
use cnem::delaunay::Delaunay;
use cnem::domain::Domain;
use cnem::natural::{Kind, Scratch};
use divan::Bencher;
use divan::counter::ItemsCount;
use nalgebra::Point3;

fn main() {
    divan::main();
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
    let at = |i: usize| Point3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
    let points: Vec<_> = (0..n * n * n).map(at).collect();
    bencher.bench_local(|| Delaunay::new(&points));
}

/// Rates at random points of a random domain of 10 000 nodes; the argument tells whether gradients are computed.
#[divan::bench(args = [false, true], consts = [0, 1], sample_count = 5, sample_size = 1)]
fn shape<const LAPLACE: usize>(bencher: Bencher, gradients: bool) {
    let Ok(domain) = Domain::new(&random(10_000), &Surface::convex_hull()) else {
        return;
    };
    let kind = if LAPLACE == 1 { Kind::Laplace } else { Kind::Sibson };
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

//! Seconds for the Delaunay tetrahedralisation. Run with `cargo bench -p cnem`.

use cnem::delaunay::Delaunay;
use divan::Bencher;
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

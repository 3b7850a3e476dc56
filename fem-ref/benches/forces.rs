//! Internal forces: assembled 3 × 3 blocks against the matrix-free element loop, and set-up costs beside them.
//!
//! Median of one product on two shared cores: 1 331 nodes 87 µs (hexahedra) and 47 µs (tetrahedra) with blocks, 346 and
//! 209 µs element by element; 35 937 nodes 7.2 and 3.7 ms against 11.8 and 7.3 ms. The model uses blocks.
//!
//! Run with `cargo bench --profile release -p fem-ref`.

use arlequin_core::nalgebra::Point3;
use divan::{Bencher, black_box};
use fem_ref::kernel::{ElementLoop, stiffness};
use fem_ref::{Elastic, ElementKind, Mesh, generate};

fn main() {
    divan::main();
}

const KINDS: [ElementKind; 2] = [ElementKind::Hex8, ElementKind::Tet4];

/// Cells across: 1 331 nodes (cache), 35 937 nodes (memory).
const SIZES: [usize; 2] = [10, 32];

fn cube(kind: ElementKind, n: usize) -> (Mesh<f64>, Elastic<f64>, Vec<f64>) {
    let mesh = match generate::block(kind, Point3::origin(), Point3::new(1.0, 1.0, 1.0), [n; 3]) {
        Ok(mesh) => mesh,
        Err(e) => panic!("{e}"),
    };
    let material = Elastic::new(72.5e9, 0.17, 2200.0).unwrap_or_else(|e| panic!("{e}"));
    let ones = vec![1.0; mesh.element_count()];
    (mesh, material, ones)
}

fn displacements(mesh: &Mesh<f64>) -> Vec<f64> {
    (0..3 * mesh.nodes().len()).map(|i| (i as f64).sin()).collect()
}

#[divan::bench(args = KINDS, consts = SIZES)]
fn blocks<const N: usize>(bencher: Bencher<'_, '_>, kind: ElementKind) {
    let (mesh, material, ones) = cube(kind, N);
    let kernel = stiffness(&mesh, &material, &ones);
    let q = displacements(&mesh);
    let mut f = vec![0.0; q.len()];
    bencher.bench_local(|| kernel.subtract_product(black_box(&q), None, &mut f));
}

#[divan::bench(args = KINDS, consts = SIZES)]
fn elements<const N: usize>(bencher: Bencher<'_, '_>, kind: ElementKind) {
    let (mesh, material, ones) = cube(kind, N);
    let mut kernel = ElementLoop::new(&mesh, &material, &ones);
    let q = displacements(&mesh);
    let mut f = vec![0.0; q.len()];
    bencher.bench_local(|| kernel.subtract_product(black_box(&q), &mut f));
}

#[divan::bench(args = KINDS, sample_count = 10)]
fn assembly(bencher: Bencher<'_, '_>, kind: ElementKind) {
    let (mesh, material, ones) = cube(kind, 16);
    bencher.bench_local(|| stiffness(&mesh, &material, &ones));
}

//! Internal forces and set-up of a cube.
//!
//! Run with `cargo bench --profile release -p fem-ref`.

use arlequin_core::Model;
use arlequin_core::nalgebra::Point3;
use divan::{Bencher, black_box};
use fem_ref::{Elastic, ElementKind, FemModel, Mesh, generate};

fn main() {
    divan::main();
}

const KINDS: [ElementKind; 2] = [ElementKind::Hex8, ElementKind::Tet4];

/// Cells across: 1 331 nodes (cache), 35 937 nodes (memory).
const SIZES: [usize; 2] = [10, 32];

fn cube(kind: ElementKind, n: usize) -> Mesh<f64> {
    generate::block(kind, Point3::origin(), Point3::new(1.0, 1.0, 1.0), [n; 3])
        .unwrap_or_else(|e| panic!("{e}"))
}

fn model(mesh: Mesh<f64>) -> FemModel<f64> {
    let material = Elastic::new(72.5e9, 0.17, 2200.0).unwrap_or_else(|e| panic!("{e}"));
    FemModel::new("cube", mesh, material).unwrap_or_else(|e| panic!("{e}"))
}

#[divan::bench(args = KINDS, consts = SIZES)]
fn forces<const N: usize>(bencher: Bencher<'_, '_>, kind: ElementKind) {
    let mut model = model(cube(kind, N));
    let q: Vec<f64> = (0..model.layout().dofs()).map(|i| (i as f64).sin()).collect();
    let mut f = vec![0.0; q.len()];
    bencher.bench_local(|| model.add_internal_forces(black_box(&q), &mut f));
}

#[divan::bench(args = KINDS, sample_count = 10)]
fn assembly(bencher: Bencher<'_, '_>, kind: ElementKind) {
    let mesh = cube(kind, 16);
    bencher.bench_local(|| model(mesh.clone()));
}

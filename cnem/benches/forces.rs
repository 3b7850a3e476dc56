//! Internal forces; the argument is whether the model is stabilised.
//! Run with `cargo bench -p cnem --bench forces`; set `RAYON_NUM_THREADS` for the number of threads.

use arlequin_core::Model;
use cnem::generate::Cylinder;
use cnem::{CnemModel, Elastic, Options, Stabilisation};
use divan::Bencher;
use divan::counter::ItemsCount;

fn main() {
    divan::main();
}

/// A cylinder of 9027 nodes, moved off the regular pattern.
fn model(stabilised: bool) -> cnem::Result<CnemModel> {
    let shape = Cylinder {
        x: [0.0, 18e-3],
        radius: 1e-3,
        rings: 7,
        layers: 53,
        jitter: 0.2,
        seed: 1,
    };
    let options = Options {
        stabilisation: if stabilised {
            Stabilisation::default()
        } else {
            Stabilisation::None
        },
        ..Options::default()
    };
    CnemModel::new(
        "bench",
        shape.domain()?,
        Elastic::new(72.5e9, 0.17, 2200.0)?,
        options,
    )
}

#[divan::bench(args = [false, true], sample_count = 200, sample_size = 5)]
fn forces(bencher: Bencher, stabilised: bool) {
    let Ok(mut model) = model(stabilised) else {
        return;
    };
    let q: Vec<f64> = (0..model.layout().dofs())
        .map(|i| 1e-6 * (i as f64).sin())
        .collect();
    let mut f = vec![0.0; q.len()];
    bencher
        .counter(ItemsCount::new(q.len() / 3))
        .bench_local(|| model.add_internal_forces(&q, &mut f));
}

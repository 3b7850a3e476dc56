//! One cell of the cantilever table; `cargo bench --bench cantilever` runs all fifteen.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin_studies::cantilever;

#[test]
fn a_coarse_cell_keeps_its_energy_where_schwarz_coupling_loses_it() {
    // Mesh ratio 1:0.6, overlap 50.8 mm: published drift of the overlapping Schwarz coupling −61.1 % at 1 ms.
    let d = cantilever::drift(0.6, 50.8e-3).unwrap();
    println!("{d:?}");
    assert!(
        (d.start / 1506.5 - 1.0).abs() < 0.03,
        "initial energy {}",
        d.start
    );
    assert!(d.invariant.iter().all(|x| x.abs() <= 1e-9), "{d:?}");
    assert!(d.total.iter().all(|x| x.abs() <= 0.005), "{d:?}");
}

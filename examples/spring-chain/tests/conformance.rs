//! Checks what the coupling relies on, for the chain or any copy of it.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::core::conformance;
use arlequin::prelude::*;
use spring_chain::Chain;

#[test]
fn the_chain_keeps_what_the_coupling_relies_on_with_and_without_weights() {
    let mut chain = Chain::new("chain", -1.0, 0.25, 12, 2.0, 3.0)
        .unwrap()
        .with_stiffness(|b| 1.0 + b as f64);
    assert!(conformance::mass(&chain, 24.0).unwrap() < 1e-15);
    let points = [-1.0, -0.9, 0.3, 2.0].map(|x| Point3::new(x, 0.0, 0.0));
    let shapes = conformance::shapes(&*chain.fine_field(), &points, true).unwrap();
    assert!(
        shapes.unity < 1e-15 && shapes.linear < 1e-15 && shapes.gradient < 1e-14,
        "{shapes:?}"
    );
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramp = Ramp::new(
        Arc::new(Slab::between(point(-0.5), point(0.8)).unwrap()),
        Profile::Cubic,
        0.05,
    )
    .unwrap();
    let weights: [&dyn Weight<f64>; 2] = [&Uniform(1.0), &ramp];
    for weight in weights {
        chain.set_internal_weight(weight).unwrap();
        assert!(conformance::rigid_forces(&mut chain, 1.0).unwrap() < 1e-15);
        assert!(conformance::forces_derive_from_energy(&mut chain, 1e-2).unwrap() < 1e-9);
        assert!(conformance::symmetric_forces(&mut chain, 1.0).unwrap() < 1e-14);
        let k = chain.stiffness();
        assert!(k.iter().all(|(v, (i, j))| k.get(j, i) == Some(v)), "symmetric");
    }
    let ramp: Arc<dyn Weight<f64>> = Arc::new(ramp.clone());
    let d = conformance::weights(&mut chain, &ramp, 1e-2).unwrap();
    let follows = [d.half_inertia, d.inertia, d.half_energy, d.energy, d.forces];
    assert!(follows.iter().all(|x| *x < 1e-14), "{d:?}");
    // Weights may change in a run, and nodes without weight feel nothing.
    assert!(conformance::reweighing(&mut chain, &ramp, 1e-2).unwrap() < 1e-15);
    assert!(conformance::weight_means(&*ramp, &chain.fine_field().cells()) < 1e-3);
}

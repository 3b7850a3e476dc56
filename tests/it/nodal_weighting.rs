//! [`Weighting::Nodal`], the usual choice in the literature: its effect on any model, and its refusals.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin::core::harmonic::{HarmonicOverlap, Port};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, Error, Partition, Profile, Ramp, Slab, Subdomain, TimeStep, Weighting, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, Criterion, DemModel, Fracture};
use arlequin::fem_ref::{Elastic, FemModel, generate};
use std::sync::Arc;

/// Weights that fall from 0.9 to 0.1 over four units of length.
fn weights(scale: f64, weighting: Weighting) -> Weights<f64> {
    let slab = Slab::between(Point3::new(4.0 * scale, 0.0, 0.0), Point3::origin()).unwrap();
    let ramp = Ramp::new(Arc::new(slab), Profile::Linear, 0.1).unwrap();
    Weights::from_weight(Arc::new(ramp)).with_weighting(weighting)
}

/// Returns a bar alone with an initial displacement of sin k at node k.
fn bar(weighting: Weighting) -> Coupled<f64> {
    let mesh = generate::bar(0.0, 4.0, 16, 1.0).unwrap();
    let model = FemModel::new("bar", mesh, Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap();
    let body = Subdomain::coarse(model, weights(1.0, weighting)).with_partition(Partition::Unchecked);
    let q = (0..17).map(|k| f64::from(k).sin()).collect();
    let body = body.with_initial(q, vec![0.0; 17]).unwrap();
    Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.5), None).unwrap()
}

#[test]
fn nodal_weights_multiply_forces_and_masses_of_the_unweighted_model() {
    let (weighted, w) = (bar(Weighting::Nodal), weights(1.0, Weighting::Nodal));
    let s = &weighted.subdomains()[0];
    for (k, x) in s.model().nodes().iter().enumerate() {
        let whole = if k == 0 || k == 16 { 0.125 } else { 0.25 };
        assert_abs_diff_eq!(s.inertia()[k], whole * w.kinetic.value(x), epsilon = 1e-15);
        // Weights on forces and masses cancel.
        let q = |k: usize| s.state().q[k];
        let pull = |j: usize| 4.0 * (q(j) - q(k));
        let force = match k {
            0 => pull(1),
            16 => pull(15),
            _ => pull(k - 1) + pull(k + 1),
        };
        assert_abs_diff_eq!(s.state().a[k], force / whole, epsilon = 1e-12);
    }
    // `½ qᵀ D K q`, not `½ qᵀ K q`.
    let terms = s.model().nodes().iter().enumerate();
    let energy: f64 = terms
        .map(|(k, _)| -0.5 * s.state().q[k] * s.inertia()[k] * s.state().a[k])
        .sum();
    assert_relative_eq!(s.internal_energy(), energy, epsilon = 0.0, max_relative = 1e-12);
    // In the metric of a constraint they do not cancel: the step is shorter than h/c, the step of the model
    // alone.
    let step = weighted.critical_steps()[0];
    assert!(step > 0.7 * 0.25 && step < 0.25, "{step}");
}

fn refused<T: std::fmt::Debug>(result: Result<T, Error>) {
    let e = result.unwrap_err();
    assert!(
        matches!(&e, Error::Unsupported { what, .. } if what.contains("weighted at its nodes")),
        "{e}"
    );
}

#[test]
fn the_static_twin_and_the_harmonic_analysis_refuse_nodal_weights() {
    refused(bar(Weighting::Nodal).equilibrium(0.0));
    let port = |dof| Port {
        subdomain: 0,
        dof,
        stiffness: 4.0,
        mass: 0.25,
        spacing: 0.25,
    };
    refused(HarmonicOverlap::new(&bar(Weighting::Nodal), port(0), port(16)));
    assert!(HarmonicOverlap::new(&bar(Weighting::Energy), port(0), port(16)).is_ok());
}

#[test]
fn models_that_are_not_linear_refuse_nodal_weights() {
    let packing = lattice(Lattice::Cubic, [4, 3, 3], 1e-3).unwrap();
    let grains = || DemModel::new("grains", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let run = |model: DemModel| {
        let w = weights(2e-3, Weighting::Nodal);
        let body = Subdomain::fine(model, w).with_partition(Partition::Unchecked);
        Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.5), None)
    };
    assert!(run(grains()).is_ok());
    refused(run(grains().with_finite_rotations()));
    refused(run(grains()
        .with_fracture(Fracture::new(Criterion::Axial, 1e9))
        .unwrap()));
}

//! The cantilever of Norma.jl (Sandia): clamped at x = 0, released from `u_y = 0.393701 x²`, two non-nested
//! hexahedral meshes that overlap around the middle. Our law is linear, theirs has finite strain: compare
//! the drift of energy, not the motion.

use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, InterfaceOptions, InterfaceSpec, L2, OwnStep, PrescribedMotion, Profile, Ramp, Result, Silent,
    Slab, Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, Mesh, generate};
use std::sync::Arc;

const LENGTH: f64 = 0.254;
const SECTION: [f64; 2] = [0.0254, 0.0127];
const FINE: f64 = 6.35e-3;

/// Drift of the invariant and change of the total energy, both relative to the start, at 1 ms and 10 ms.
#[derive(Debug, Clone, Copy)]
pub struct Drift {
    /// Energy at the start \[J\].
    pub start: f64,
    /// Largest drift of the invariant.
    pub invariant: [f64; 2],
    /// Change of the total energy.
    pub total: [f64; 2],
}

fn block(x: [f64; 2], h: f64) -> Result<Mesh<f64>> {
    let count = |length: f64| ((length / h).round() as usize).max(1);
    let high = Point3::new(x[1], SECTION[0], SECTION[1]);
    let counts = [count(x[1] - x[0]), count(SECTION[0]), count(SECTION[1])];
    Ok(generate::block(
        ElementKind::Hex8,
        Point3::new(x[0], 0.0, 0.0),
        high,
        counts,
    )?)
}

/// Builds one cell of the table. `ratio` is the mesh ratio `1:ratio`, `overlap` the width of the overlap
/// \[m\], `own_steps` the number of own steps of the finer side in a step of 1 µs.
///
/// # Errors
/// Errors of the core and the meshes.
pub fn build(ratio: f64, overlap: f64, own_steps: usize) -> Result<Coupled<f64>> {
    let [left, right] = [LENGTH / 2.0 - overlap / 2.0, LENGTH / 2.0 + overlap / 2.0];
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramp = Ramp::new(
        Arc::new(Slab::between(point(right), point(left))?),
        Profile::Cubic,
        0.0,
    )?;
    let coarse = Weights::from_weight(Arc::new(ramp));
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let material = Elastic::new(6.895e9, 0.25, 2768.0)?;
    let clamped = FemModel::new("clamped", block([0.0, right], FINE / ratio)?, material)?;
    let free = FemModel::new("free", block([left, LENGTH], FINE)?, material)?;
    let root = clamped
        .mesh()
        .group_nodes("x-min")?
        .into_iter()
        .flat_map(|n| 3 * n..3 * n + 3)
        .collect();
    // Both models start from the same deflection.
    let bend = |s: Subdomain<f64>| {
        let q: Vec<f64> = s
            .model()
            .nodes()
            .iter()
            .flat_map(|x| [0.0, 0.393_701 * x.x * x.x, 0.0])
            .collect();
        let n = q.len();
        s.with_initial(q, vec![0.0; n])
    };
    let subdomains = vec![
        bend(Subdomain::coarse(clamped, coarse).with_support(PrescribedMotion::fixed(root)))?,
        bend(Subdomain::fine(free, fine).with_step(OwnStep::Ratio(own_steps)))?,
    ];
    let interface = InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator: Arc::new(FemField::new(block([left, right], FINE / ratio)?)),
        junction: Box::new(L2),
        options: InterfaceOptions::default(),
    };
    Coupled::new(subdomains, vec![interface], TimeStep::Seconds(1e-6), None)
}

/// Mesh ratios, each with the published drifts of the total energy at 1 ms \[%\] for the three overlap
/// widths of [`WIDTHS`].
pub const PUBLISHED: [(f64, [f64; 3]); 5] = [
    (1.0, [-0.1, -0.1, -0.0]),
    (0.8, [29.8, 20.4, -3.1]),
    (0.6, [-61.1, 2.1, -4.5]),
    (0.4, [-12.4, -52.7, -36.6]),
    (0.2, [-79.1, -66.5, -22.2]),
];
/// Overlap widths of the table \[m\].
pub const WIDTHS: [f64; 3] = [50.8e-3, 25.4e-3, 12.7e-3];

/// Runs one cell of the table to 10 ms.
///
/// # Errors
/// Errors of [`build`] and of the steps.
pub fn drift(ratio: f64, overlap: f64, own_steps: usize) -> Result<Drift> {
    let mut run = build(ratio, overlap, own_steps)?;
    let start = run.energy();
    let mut out = Drift {
        start,
        invariant: [0.0; 2],
        total: [0.0; 2],
    };
    for (k, steps) in [1_000, 9_000].into_iter().enumerate() {
        // Drift and energy are read at 1 ms and at 10 ms of the same run.
        run.run(steps, &mut Silent)?;
        out.invariant[k] = run.drift();
        out.total[k] = run.energy() / start - 1.0;
    }
    Ok(out)
}

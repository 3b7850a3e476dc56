//! Static deflections and frequencies of a clamped cylinder.
#![allow(dead_code, reason = "every target uses its own part")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use super::{lowest, silica, solve};
use arlequin_core::{LinearModel, Model, Real, Uniform};
use cnem::generate::Cylinder;
use cnem::{CnemModel, Options};
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Relative differences from the three-dimensional solution \[%\]; the true values are converged to 0.02 %.
pub(crate) struct Beam {
    pub(crate) nodes: usize,
    pub(crate) step: f64,
    /// First axial, bending and torsional frequency \[Hz\].
    pub(crate) frequencies: [f64; 3],
    /// Axial and transverse mean end displacement \[m\] under 1 kN, rotation \[rad\] under 10 N m.
    pub(crate) deflections: [f64; 3],
}

/// True values of beam B (100 mm by 20 mm): frequencies and deflections.
pub(crate) const THICK: ([f64; 3], [f64; 3]) =
    ([14_372.0, 1_577.0, 9_381.8], [4.384e-6, 0.5950e-3, 2.055e-3]);
/// True values of beam A (20 mm by 2 mm): axial frequencies and elongation.
pub(crate) const SLENDER: ([f64; 3], f64) = ([71_815.0, 215_369.0, 358_690.0], 0.08775e-3);

pub(crate) fn cylinder(slender: bool, rings: usize, layers: usize, jitter: f64) -> Cylinder {
    let (length, radius) = if slender { (0.02, 0.001) } else { (0.1, 0.01) };
    Cylinder {
        x: [0.0, length],
        radius,
        rings,
        layers,
        jitter,
        seed: 1,
    }
}

/// Returns the relative difference \[%\].
pub(crate) fn percent(value: f64, truth: f64) -> f64 {
    100.0 * (value / truth - 1.0)
}

fn end_facets(model: &CnemModel, length: f64) -> Vec<arlequin_core::effect::SurfaceFacet<f64>> {
    model
        .surface(|f| (f.centroid.x - length).abs() < 1e-9 * length)
        .unwrap()
}

fn clamped(model: &CnemModel, length: f64) -> Vec<bool> {
    let end = |x: f64| x.abs() < 1e-9 * length;
    model.nodes().iter().flat_map(|p| [end(p.x); 3]).collect()
}

/// Returns the displacements under a traction on the free end.
fn statics(model: &CnemModel, length: f64, load: &dyn Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<f64> {
    let n = model.layout().dofs();
    let mut f = vec![0.0; n];
    for facet in end_facets(model, length) {
        let t = load(facet.centre.coords);
        for (node, share) in facet.nodes.iter().zip(&facet.shares) {
            (0..3).for_each(|a| f[3 * node + a] += t[a] * share);
        }
    }
    let mut u = vec![0.0; n];
    solve(&model.stiffness(), &clamped(model, length), &f, &mut u);
    u
}

/// Returns area means over the end: displacement, and rotation about x.
fn end_motion(model: &CnemModel, length: f64, u: &[f64]) -> (Vector3<f64>, f64) {
    let (mut mean, mut area, mut twist, mut polar) = (Vector3::zeros(), 0.0, 0.0, 0.0);
    for facet in end_facets(model, length) {
        let mut v = Vector3::zeros();
        for (node, share) in facet.nodes.iter().zip(&facet.shares) {
            v += Vector3::new(u[3 * node], u[3 * node + 1], u[3 * node + 2]) * *share;
        }
        mean += v;
        area += facet.area();
        let c = facet.centre;
        twist += c.y * v.z - c.z * v.y;
        polar += (c.y * c.y + c.z * c.z) * facet.area();
    }
    (mean / area, twist / polar)
}

fn mass_of(model: &CnemModel) -> Vec<f64> {
    let mut mass = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut mass).unwrap();
    mass
}

/// Returns the static deflections and the first frequencies of a beam.
pub(crate) fn study(options: Options, shape: &Cylinder) -> Beam {
    let length = shape.x[1];
    let mut model = CnemModel::new("beam", shape.domain().unwrap(), silica(), options).unwrap();
    let area = PI * shape.radius * shape.radius;
    let polar = 0.5 * area * shape.radius * shape.radius;
    let mass = mass_of(&model);
    let inverse: Vec<f64> = mass.iter().map(|m| 1.0 / m).collect();
    let step = model.critical_step(&inverse).unwrap();
    let mut frequencies = [f64::NAN; 3];
    for (value, mode) in &lowest(&model.stiffness(), &mass, &clamped(&model, length), 8) {
        let (mean, twist) = end_motion(&model, length, mode);
        let axial = mean.x.abs() > mean.yz().norm();
        let slot = match (twist.abs() * shape.radius > mean.norm(), axial) {
            (true, _) => 2,
            (false, true) => 0,
            (false, false) => 1,
        };
        // A second bending mode may precede the first axial mode.
        if frequencies[slot].is_nan() {
            frequencies[slot] = value.sqrt() / (2.0 * PI);
        }
    }
    let pull = statics(&model, length, &|_| Vector3::x() * (1e3 / area));
    let bend = statics(&model, length, &|_| Vector3::y() * (1e3 / area));
    let turn = statics(&model, length, &|p| Vector3::new(0.0, -p.z, p.y) * (10.0 / polar));
    Beam {
        nodes: model.nodes().len(),
        step,
        frequencies,
        deflections: [
            end_motion(&model, length, &pull).0.x,
            end_motion(&model, length, &bend).0.y,
            end_motion(&model, length, &turn).1,
        ],
    }
}

/// Returns axial frequencies \[Hz\] by inverse iteration about guesses, starting from the axial modes of a
/// bar.
pub(crate) fn axial_frequencies(options: Options, shape: &Cylinder, guesses: &[f64]) -> Vec<f64> {
    let length = shape.x[1];
    let model = CnemModel::new("beam", shape.domain().unwrap(), silica(), options).unwrap();
    let (mass, fixed) = (mass_of(&model), clamped(&model, length));
    let (k, free) = super::free_part(&model.stiffness(), &fixed);
    guesses
        .iter()
        .enumerate()
        .map(|(order, guess)| {
            let wave = (2 * order + 1) as f64 * PI / (2.0 * length);
            let mut value = (2.0 * PI * guess).powi(2);
            let mut x: Vec<f64> = free
                .iter()
                .map(|&i| {
                    if i % 3 == 0 {
                        (wave * model.nodes()[i / 3].x).sin()
                    } else {
                        0.0
                    }
                })
                .collect();
            // The shifted matrix is indefinite, hence LU. One fixed shift is enough: the start vector selects
            // the mode.
            let shifted = {
                let mut t = arlequin_core::sprs::TriMat::new((free.len(), free.len()));
                k.iter().for_each(|(v, (i, j))| t.add_triplet(i, j, *v));
                free.iter()
                    .enumerate()
                    .for_each(|(a, &i)| t.add_triplet(a, a, -value * mass[i]));
                t.to_csr()
            };
            let factor = f64::lu(&shifted).unwrap();
            for _ in 0..4 {
                let mut y: Vec<f64> = x.iter().zip(&free).map(|(x, &i)| x * mass[i]).collect();
                factor.solve(&mut y);
                let norm = y
                    .iter()
                    .zip(&free)
                    .map(|(y, &i)| y * y * mass[i])
                    .sum::<f64>()
                    .sqrt();
                x = y.iter().map(|y| y / norm).collect();
            }
            let mut kx = vec![0.0; x.len()];
            k.iter().for_each(|(v, (i, j))| kx[i] += v * x[j]);
            value = x.iter().zip(&kx).map(|(a, b)| a * b).sum();
            value.sqrt() / (2.0 * PI)
        })
        .collect()
}

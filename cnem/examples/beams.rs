//! Static deflections and frequencies of two silica beams against the three-dimensional solution and beam theory.
//!
//! Beam A: 20 mm by 2 mm, axial; beam B: 100 mm by 20 mm, axial, bending and torsion. Clamped at x = 0.
//! `beams [rings layers [jitter]]...` prints one line per node set, kind and amount of stabilisation.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example prints its results and stops at the first error"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use arlequin_core::model::{LinearModel, Model};
use arlequin_core::weight::{Uniform, Weighting};
use cnem::generate::Cylinder;
use cnem::natural::Kind;
use cnem::{CnemModel, Options, Stabilisation};
use common::{lowest, silica, solve};
use nalgebra::Vector3;
use std::time::Instant;

fn frequency(value: f64) -> f64 {
    value.sqrt() / (2.0 * std::f64::consts::PI)
}

/// Mean of a motion at the free end under a traction.
fn statics(model: &CnemModel, length: f64, load: &dyn Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<f64> {
    let n = model.layout().dofs();
    let mut f = vec![0.0; n];
    let tolerance = 1e-9 * length;
    for facet in model
        .surface(|f| (f.centroid.x - length).abs() < tolerance)
        .unwrap()
    {
        let t = load(facet.centre.coords);
        for (node, share) in facet.nodes.iter().zip(&facet.shares) {
            (0..3).for_each(|a| f[3 * node + a] += t[a] * share);
        }
    }
    let fixed: Vec<bool> = model
        .nodes()
        .iter()
        .flat_map(|p| [p.x.abs() < tolerance; 3])
        .collect();
    let mut u = vec![0.0; n];
    solve(&model.stiffness(), &fixed, &f, &mut u);
    u
}

/// Area means over the end: displacement and rotation about x.
fn end_motion(model: &CnemModel, length: f64, u: &[f64]) -> (Vector3<f64>, f64) {
    let (mut mean, mut area, mut twist, mut polar) = (Vector3::zeros(), 0.0, 0.0, 0.0);
    for facet in model
        .surface(|f| (f.centroid.x - length).abs() < 1e-9 * length)
        .unwrap()
    {
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

fn study(kind: Kind, amount: f64, shape: &Cylinder) {
    let length = shape.x[1];
    let slender = length < 0.05;
    let start = Instant::now();
    let options = Options {
        kind,
        stabilisation: if amount > 0.0 {
            Stabilisation::SubCells(amount)
        } else {
            Stabilisation::None
        },
    };
    let mut model = CnemModel::new("beam", shape.domain().unwrap(), silica(), options).unwrap();
    let setup = start.elapsed().as_secs_f64();
    let r = shape.radius;
    let area = std::f64::consts::PI * r * r;
    let polar = 0.5 * area * r * r;
    let mut mass = vec![0.0; model.layout().dofs()];
    model
        .lumped_inertia(&Uniform(1.0), Weighting::Energy, &mut mass)
        .unwrap();
    let inverse: Vec<f64> = mass.iter().map(|m| 1.0 / m).collect();
    let step = model.critical_step(&inverse).unwrap();
    let clamped: Vec<bool> = model
        .nodes()
        .iter()
        .flat_map(|p| [p.x.abs() < 1e-9 * length; 3])
        .collect();
    let start = Instant::now();
    let k = model.stiffness();
    let modes = lowest(&k, &mass, &clamped, 14);
    let solving = start.elapsed().as_secs_f64();
    let mut f = [Vec::new(), Vec::new(), Vec::new()];
    for (value, mode) in &modes {
        let e = |a: usize| -> f64 {
            (0..mode.len() / 3)
                .map(|i| mass[3 * i] * mode[3 * i + a].powi(2))
                .sum()
        };
        let [x, y, z] = [e(0), e(1), e(2)];
        let (mean, _) = end_motion(&model, length, mode);
        let slot = if x > y + z {
            0
        } else if mean.yz().norm() > 1e-3 * mode.iter().fold(0.0, |m: f64, v| m.max(v.abs())) {
            1
        } else {
            2
        };
        f[slot].push(frequency(*value));
    }
    let ux = end_motion(
        &model,
        length,
        &statics(&model, length, &|_| Vector3::x() * (1e3 / area)),
    )
    .0
    .x * 1e3;
    let uy = end_motion(
        &model,
        length,
        &statics(&model, length, &|_| Vector3::y() * (1e3 / area)),
    )
    .0
    .y * 1e3;
    let theta = end_motion(
        &model,
        length,
        &statics(&model, length, &|p| Vector3::new(0.0, -p.z, p.y) * (10.0 / polar)),
    )
    .1;
    let percent = |value: Option<&f64>, truth: f64| value.map_or(f64::NAN, |v| 100.0 * (v / truth - 1.0));
    println!(
        "{} n {:5} {kind:?} a {amount:4.2}: step {step:.2e} s, set-up {setup:.2} s, blocks/row {:.0}, modes {solving:.1} s",
        if slender { 'A' } else { 'B' },
        model.nodes().len(),
        model.stored_blocks() as f64 / model.nodes().len() as f64
    );
    if slender {
        let truth = [71815.0, 215369.0, 358690.0];
        let d: Vec<String> = (0..3)
            .map(|i| format!("{:+.2}", percent(f[0].get(i), truth[i])))
            .collect();
        println!(
            "   U_x {ux:.5} mm ({:+.2} %), f {:?} ({} %)",
            percent(Some(&ux), 0.08775),
            &f[0],
            d.join(" ")
        );
    } else {
        println!(
            "   f axial {:+.2} bending {:+.2} torsion {:+.2} | U_x {:+.2} U_y {:+.2} theta {:+.2} %",
            percent(f[0].first(), 14372.0),
            percent(f[1].first(), 1577.0),
            percent(f[2].first(), 9381.8),
            percent(Some(&ux), 4.384e-3),
            percent(Some(&uy), 0.5950),
            percent(Some(&theta), 2.055e-3)
        );
    }
}

fn main() {
    let args: Vec<f64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let sets: Vec<[f64; 4]> = if args.is_empty() {
        vec![
            [0.0, 2.0, 33.0, 0.0],
            [1.0, 2.0, 33.0, 0.0],
            [1.0, 3.0, 43.0, 0.0],
        ]
    } else {
        args.chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect()
    };
    for [beam, rings, layers, jitter] in sets {
        let (length, radius) = if beam > 0.0 { (0.1, 0.01) } else { (0.02, 0.001) };
        let shape = Cylinder {
            x: [0.0, length],
            radius,
            rings: rings as usize,
            layers: layers as usize,
            jitter,
            seed: 1,
        };
        for kind in [Kind::Laplace, Kind::Sibson] {
            for amount in [0.0, 0.02, 0.05, 0.1, 0.2] {
                study(kind, amount, &shape);
            }
        }
    }
}

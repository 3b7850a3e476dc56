//! GOAL: a body is the same body turned, sheared, far away, tiny or huge.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use arlequin_core::model::{LinearModel, Model};
use cnem::domain::Domain;
use cnem::{CnemModel, Elastic, Options};
use common::bodies::{Body, Map, all};
use nalgebra::{Matrix3, Point3};

/// Largest relative error of the energies of the six linear fields; the message where there is no model.
fn defect(body: &Body) -> Result<f64, String> {
    let domain = Domain::new(&body.points, &body.surface).map_err(|e| e.to_string())?;
    if domain.nodes().len() != body.points.len() {
        return Err(format!(
            "{} nodes for {}",
            domain.nodes().len(),
            body.points.len()
        ));
    }
    let material = Elastic::new(1.0, 0.25, 1.0).unwrap();
    let model = CnemModel::new("body", domain, material, Options::default()).map_err(|e| e.to_string())?;
    let nodes = model.nodes();
    let centre = nodes.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / nodes.len() as f64;
    let mut worst = 0.0_f64;
    for k in 0..6 {
        let mut g = Matrix3::zeros();
        g[(k % 3, (k + k / 3) % 3)] = 1.0;
        let strain = (g + g.transpose()) * 0.5;
        let stress = Matrix3::identity() * (0.4 * strain.trace()) + strain * 0.8;
        let exact = 0.5 * strain.dot(&stress) * body.volume;
        let u: Vec<f64> = nodes
            .iter()
            .flat_map(|p: &Point3<f64>| {
                let u = g * (p.coords - centre);
                [u.x, u.y, u.z]
            })
            .collect();
        worst = worst.max((model.internal_energy(&u) / exact - 1.0).abs());
        if worst.is_nan() {
            return Ok(f64::NAN);
        }
    }
    if model.stiffness().data().iter().any(|x| !x.is_finite()) {
        return Ok(f64::INFINITY);
    }
    Ok(worst)
}

#[test]
fn survey() {
    for body in all() {
        let mut bad = Vec::new();
        let mut worst = 0.0_f64;
        for seed in 1..=40 {
            let map = if seed > 20 {
                Map::shear(seed, 0.4)
            } else {
                Map::turn(seed)
            };
            match defect(&body.mapped(&map)) {
                Ok(d) if d <= 1e-10 => worst = worst.max(d),
                Ok(d) => bad.push(format!("{d:.1e}")),
                Err(e) => bad.push(e),
            }
        }
        println!(
            "{:25} {:?} unturned, worst good {worst:.1e}, bad {} {:?}",
            body.name,
            defect(&body),
            bad.len(),
            &bad[..bad.len().min(5)]
        );
    }
}

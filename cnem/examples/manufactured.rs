//! Errors and observed orders of a manufactured solution for both kinds of shape functions and several
//! amounts of stabilisation, on regular and jittered nodes; then the times of forces and field evaluations.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example prints its results and stops at the first error"
)]

#[path = "../tests/it/common/mod.rs"]
mod common;

use arlequin_core::{Interpolation, Model, ShapeRow, Weight};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::Interpolant;
use cnem::{CnemModel, Options, Stabilisation, generate};
use common::{mms, silica};
use nalgebra::Point3;
use std::time::Instant;

fn cube(steps: usize, jitter: f64) -> Domain {
    let corner = Point3::new(1.0, 1.0, 1.0);
    let nodes = generate::block(Point3::origin(), corner, [steps; 3], jitter, 3).unwrap();
    Domain::new(&nodes, &Surface::convex_hull()).unwrap()
}

fn errors(options: Options, jitter: f64) {
    let rows = [4, 6, 8, 12].map(|n| (n, mms(cube(n, jitter), options)));
    print!("{:?} {:?} jitter {jitter}:", options.kind, options.stabilisation);
    for pair in rows.windows(2) {
        let ((n, e), (m, f)) = (pair[0], pair[1]);
        let order = |k: usize| (e[k] / f[k]).ln() / (m as f64 / n as f64).ln();
        print!(
            "  {m}: L2 {:.4} ({:.2}) H1 {:.3} ({:.2})",
            f[0],
            order(0),
            f[1],
            order(1)
        );
    }
    println!();
}

struct Fall;
impl Weight<f64> for Fall {
    fn value(&self, x: &Point3<f64>) -> f64 {
        x.x.clamp(0.2, 0.8)
    }
}

fn costs(kind: Interpolant) {
    let start = Instant::now();
    let domain = cube(20, 0.2);
    let meshed = start.elapsed();
    let options = Options {
        kind,
        ..Options::default()
    };
    let mut model = CnemModel::new("cube", domain, silica(), options).unwrap();
    let building = start.elapsed();
    model.set_internal_weight(&Fall).unwrap();
    let weighted = start.elapsed();
    let n = model.nodes().len();
    println!(
        "{kind:?} {n} nodes: domain {meshed:.2?}, model {:.2?}, weighting {:.2?}",
        building - meshed,
        weighted - building
    );
    let q: Vec<f64> = model.nodes().iter().flat_map(|p| [p.x * p.y, p.z, p.x]).collect();
    let mut f = vec![0.0; q.len()];
    let start = Instant::now();
    (0..200).for_each(|_| model.add_internal_forces(&q, &mut f).unwrap());
    println!(
        "  forces {:.0} ns a node",
        start.elapsed().as_secs_f64() * 5e-3 / n as f64 * 1e9
    );
    let (field, mut row, mut samples) = (model.field(), ShapeRow::default(), Vec::new());
    field.cells().iter().for_each(|c| c.quadrature(1, &mut samples));
    let start = Instant::now();
    for (k, s) in samples.iter().enumerate() {
        field.shape_in(k, &s.point, false, &mut row).unwrap();
    }
    println!(
        "  {:.0} evaluations a second in known cells",
        samples.len() as f64 / start.elapsed().as_secs_f64()
    );
}

fn main() {
    costs(Interpolant::Laplace);
    costs(Interpolant::Sibson);
    for kind in [Interpolant::Laplace, Interpolant::Sibson] {
        for stabilisation in [
            Stabilisation::None,
            Stabilisation::SubCells(0.05),
            Stabilisation::default(),
            Stabilisation::SubCells(0.2),
        ] {
            for jitter in [0.0, 0.2] {
                let options = Options {
                    kind,
                    stabilisation,
                    ..Options::default()
                };
                errors(options, jitter);
            }
        }
    }
}

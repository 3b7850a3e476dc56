//! Static deflections and frequencies of two silica beams against the three-dimensional solution.
//!
//! Beam A: 20 mm by 2 mm, axial; beam B: 100 mm by 20 mm, axial, bending and torsion. Both are clamped at x =
//! 0. `beams [beam rings layers jitter]...` (beam 0 is A, 1 is B) prints a table for both kinds of shape
//! functions and several amounts of stabilisation.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "an example prints its results and stops at the first error"
)]

#[path = "../tests/it/common/mod.rs"]
mod common;

use cnem::natural::Interpolant;
use cnem::{Inertia, Options, Stabilisation};
use common::beam::{SLENDER, THICK, axial_frequencies, cylinder, percent, study};

fn row(options: Options, sizes: [f64; 4]) {
    let shape = cylinder(sizes[0] == 0.0, sizes[1] as usize, sizes[2] as usize, sizes[3]);
    let b = study(options, &shape);
    print!("{:5} nodes, critical step {:.2e} s: ", b.nodes, b.step);
    if sizes[0] == 0.0 {
        let f = axial_frequencies(options, &shape, &SLENDER.0);
        println!(
            "U_x {:.5} mm ({:+.2} %), axial f {:.0} {:.0} {:.0} Hz ({:+.2} {:+.2} {:+.2} %)",
            b.deflections[0] * 1e3,
            percent(b.deflections[0], SLENDER.1),
            f[0],
            f[1],
            f[2],
            percent(f[0], SLENDER.0[0]),
            percent(f[1], SLENDER.0[1]),
            percent(f[2], SLENDER.0[2])
        );
        return;
    }
    let f = [0, 1, 2].map(|k| percent(b.frequencies[k], THICK.0[k]));
    let u = [0, 1, 2].map(|k| percent(b.deflections[k], THICK.1[k]));
    println!(
        "f axial {:+.2} bending {:+.2} torsion {:+.2}, U_x {:+.2} U_y {:+.2} theta {:+.2} %",
        f[0], f[1], f[2], u[0], u[1], u[2]
    );
}

fn main() {
    let args: Vec<f64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let sets: Vec<[f64; 4]> = if args.is_empty() {
        vec![
            [0.0, 2.0, 33.0, 0.0],
            [1.0, 3.0, 17.0, 0.0],
            [1.0, 4.0, 26.0, 0.0],
        ]
    } else {
        args.as_chunks::<4>().0.to_vec()
    };
    for sizes in sets {
        println!("beam {}", if sizes[0] == 0.0 { 'A' } else { 'B' });
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            for amount in [0.0, 0.05, 0.1, 0.2] {
                print!("{kind:8?} a {amount:.2} ");
                let stabilisation = if amount > 0.0 {
                    Stabilisation::SubCells(amount)
                } else {
                    Stabilisation::None
                };
                let options = Options {
                    kind,
                    stabilisation,
                    inertia: Inertia::default(),
                };
                row(options, sizes);
            }
        }
    }
}

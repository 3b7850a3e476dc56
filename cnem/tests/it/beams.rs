//! Beams against the three-dimensional solution: 627 nodes, about 1600 nodes, and three meshes.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use crate::common::beam::{SLENDER, THICK, axial_frequencies, cylinder, percent, study};
use cnem::{Options, Stabilisation};

/// A slender beam of 627 nodes, the number of the published run, has the mean elongation under 1 kN and the
/// first three axial frequencies of the three-dimensional solution.
#[test]
fn slender_beam_in_tension() {
    for jitter in [0.0, 0.2] {
        let shape = cylinder(true, 2, 33, jitter);
        assert_eq!(shape.node_count(), 627);
        let b = study(Options::default(), &shape);
        let f = axial_frequencies(Options::default(), &shape, &SLENDER.0);
        println!(
            "jitter {jitter}: U_x {:.5} mm, f {f:.0?} Hz",
            b.deflections[0] * 1e3
        );
        assert!(percent(b.deflections[0], SLENDER.1).abs() < 0.1);
        for (k, limit) in [0.1, 0.5, 1.2].into_iter().enumerate() {
            assert!(percent(f[k], SLENDER.0[k]).abs() < limit, "f{k} {}", f[k]);
        }
    }
}

/// Returns the differences from the true values \[%\]: axial, bending and torsional frequency, then the
/// static deflections.
fn thick(rings: usize, layers: usize, jitter: f64, options: Options) -> [f64; 6] {
    let b = study(options, &cylinder(false, rings, layers, jitter));
    let mut out = [0.0; 6];
    for k in 0..3 {
        out[k] = percent(b.frequencies[k], THICK.0[k]);
        out[3 + k] = percent(b.deflections[k], THICK.1[k]);
    }
    println!(
        "{} nodes, jitter {jitter}, {:?}: {out:.2?}",
        b.nodes, options.stabilisation
    );
    out
}

/// The errors at two sizes are no larger than those known of nodal integration on Voronoi cells.
#[test]
fn thick_beam_at_two_sizes() {
    let bare = Options {
        stabilisation: Stabilisation::None,
        ..Options::default()
    };
    for (rings, layers, limits) in [
        (3, 17, [0.2, 2.6, 7.1, 0.1, 5.2, 5.0]),
        (4, 26, [0.2, 1.4, 3.7, 0.1, 2.7, 2.6]),
    ] {
        for options in [bare, Options::default()] {
            for jitter in [0.0, 0.2] {
                let deviations = thick(rings, layers, jitter, options);
                assert!(
                    deviations.iter().zip(limits).all(|(f, l)| f.abs() <= l),
                    "{deviations:?} {limits:?}"
                );
            }
        }
    }
}

#[test]
fn thick_beam_converges() {
    let deviations =
        [(2, 11), (3, 17), (4, 23)].map(|(rings, layers)| thick(rings, layers, 0.0, Options::default()));
    // Torsion converges most slowly: nodes on the surface carry the mass of their cells away from the cells'
    // centroids.
    for pair in deviations.windows(2) {
        assert!(pair[1][2].abs() < pair[0][2].abs() && pair[1][1].abs() < pair[0][1].abs().max(0.5));
    }
    let last = deviations[2];
    assert!(last.iter().all(|e| e.abs() < 2.5), "{last:?}");
}

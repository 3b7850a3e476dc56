//! GOAL: a flat face with many nodes on one circle keeps its nodes for any diagonals and any direction in
//! space. MODEL: rotated prisms over regular polygons, whose caps are given as fans from two different
//! corners. EXPECTED: no point inserted; the volume is `n/2 sin(2π/n)` times the height.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use cnem::constraint::Surface;
use cnem::domain::Domain;
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::f64::consts::TAU;

fn prism(n: usize, layers: usize, turn: f64) -> (Vec<Point3<f64>>, Vec<[usize; 3]>) {
    let axis = Unit::new_normalize(Vector3::new(1.0, 0.3 * turn, 0.7));
    let rotation = Rotation3::from_axis_angle(&axis, 0.37 * turn);
    let node = |i: usize| {
        let (sin, cos) = (TAU * (i % n) as f64 / n as f64).sin_cos();
        rotation * Point3::new(cos, sin, (i / n) as f64 * 0.5)
    };
    let mut faces = Vec::new();
    for k in 1..n - 1 {
        let top = |j: usize| layers * n + (j + n / 3) % n;
        faces.extend([[0, k + 1, k], [top(0), top(k), top(k + 1)]]);
    }
    for (low, k) in (0..layers * n).map(|i| (i / n * n, i % n)) {
        let [a, b] = [low + k, low + (k + 1) % n];
        faces.extend([[a, b, b + n], [a, b + n, a + n]]);
    }
    ((0..n * (layers + 1)).map(node).collect(), faces)
}

#[test]
fn caps_over_a_circle_take_the_diagonals_of_the_complex() {
    for n in [4, 6, 8, 12, 16, 24] {
        for (layers, turn) in (0..12).map(|i| (1 + i / 6, i % 6)) {
            let (points, faces) = prism(n, layers, turn as f64);
            let domain = Domain::new(&points, &Surface::boundary(faces)).unwrap();
            let place = format!("{n} corners, {layers} layers, turn {turn}");
            assert!(
                domain.recovery().inserted.is_empty(),
                "{place}: {:?}",
                domain.recovery()
            );
            let volume = 0.25 * (n * layers) as f64 * (TAU / n as f64).sin();
            assert!(
                (domain.volume() / volume - 1.0).abs() < 1e-14,
                "{place}: {}",
                domain.volume()
            );
        }
    }
}

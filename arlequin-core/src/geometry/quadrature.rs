//! Quadrature rules on segments and tetrahedra.

use super::Sample;
use crate::Real;
use nalgebra::{Point3, Vector3};

/// Gauss-Legendre points and weights on `[0, 1]`, exact to degree 1, 3 or 5.
pub(super) fn gauss_line(degree: usize) -> Vec<(f64, f64)> {
    if degree <= 1 {
        return vec![(0.5, 1.0)];
    }
    if degree <= 3 {
        let a = 0.5 / 3f64.sqrt();
        return vec![(0.5 - a, 0.5), (0.5 + a, 0.5)];
    }
    // Three points are exact up to degree five.
    let a = 0.5 * 0.6f64.sqrt();
    vec![(0.5 - a, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.5 + a, 5.0 / 18.0)]
}

/// Appends samples of a tetrahedron: degree 1 (centroid), 2 (4 points) or 5 (14 points, Walkington 2000), all
/// with positive weights.
pub(super) fn tetrahedron_quadrature<T: Real>(t: &[Point3<T>; 4], degree: usize, out: &mut Vec<Sample<T>>) {
    let volume = tetrahedron_volume(t).abs();
    if volume <= T::zero() {
        return;
    }
    let mut push = |b: [f64; 4], w: f64| {
        let x = (0..4).fold(Vector3::zeros(), |s, k| s + t[k].coords * T::of(b[k]));
        out.push(Sample {
            point: Point3::from(x),
            measure: volume * T::of(w),
        });
    };
    let mut corners = |a: f64, w: f64| {
        for k in 0..4 {
            let mut b = [a; 4];
            b[k] = 1.0 - 3.0 * a;
            push(b, w);
        }
    };
    match degree {
        0 | 1 => push([0.25; 4], 1.0),
        2 => corners(0.138_196_601_125_010_5, 0.25),
        _ => {
            corners(0.310_885_919_263_300_6, 0.112_687_925_718_015_9);
            corners(0.092_735_250_310_891_23, 0.073_493_043_116_361_96);
            let a = 0.045_503_704_125_649_65;
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let mut b = [0.5 - a; 4];
                b[i] = a;
                b[j] = a;
                push(b, 0.042_546_020_777_081_47);
            }
        }
    }
}

/// Signed volume of a tetrahedron \[m³\].
pub fn tetrahedron_volume<T: Real>(p: &[Point3<T>; 4]) -> T {
    (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0])) / T::of(6.0)
}

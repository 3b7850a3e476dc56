//! Circumcentres that stay accurate on nearly flat tetrahedra.

use nalgebra::{Point3, Vector3};
use std::ops::{Add, Mul, Sub};

/// Squared ratio of six volumes to the product of the three edges at the first corner below which
/// double-double arithmetic is used.
const FLAT: f64 = 1e-6;

/// Unevaluated sum of two doubles.
#[derive(Debug, Clone, Copy)]
struct Dd(f64, f64);

fn two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    // Knuth's sum: `t` is the part of `b` that arrived in `s`, so both brackets are exact round-off, whatever
    // the larger of `a` and `b`.
    let t = s - a;
    Dd(s, (a - (s - t)) + (b - t))
}

fn split(a: f64) -> (f64, f64) {
    // Veltkamp's split: `2^27 + 1` leaves two halves whose products are exact.
    let c = 134_217_729.0 * a;
    let high = c - (c - a);
    (high, a - high)
}

impl Add for Dd {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        // The low parts alone may exceed half a last digit of `s`: the second sum makes the pair canonical
        // again.
        let s = two_sum(self.0, o.0);
        two_sum(s.0, s.1 + self.1 + o.1)
    }
}

impl Sub for Dd {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + Self(-o.0, -o.1)
    }
}

impl Mul for Dd {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = self.0 * o.0;
        let ((ah, al), (bh, bl)) = (split(self.0), split(o.0));
        // The exact error of `p`, from the exact products of the halves (Dekker). The order of the terms
        // matters.
        let e = ((ah * bh - p) + ah * bl + al * bh) + al * bl;
        // The product of the two low parts lies below the last digit of the pair.
        two_sum(p, e + (self.0 * o.1 + self.1 * o.0))
    }
}

fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the vector from the first corner to the centre of the sphere through four points, and `b × c · d`
/// (six times the volume). The centre is not finite if this determinant is zero.
#[inline]
pub(crate) fn circumcentre(corners: [&Point3<f64>; 4]) -> (Vector3<f64>, f64) {
    // All vectors start at one corner: large coordinates then cancel before anything is squared.
    let [o, p, q, r] = corners;
    quick(&(p - o), &(q - o), &(r - o)).unwrap_or_else(|| accurate(corners))
}

/// Like [`circumcentre`], from vectors relative to the first corner; `None` if the tetrahedron is nearly
/// flat.
#[inline]
pub(crate) fn quick(b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
    let (b2, c2, d2) = (b.norm_squared(), c.norm_squared(), d.norm_squared());
    let (cd, db, bc) = (c.cross(d), d.cross(b), b.cross(c));
    let det = b.dot(&cd);
    // In double precision the centre has a relative error of `1e-16 * size^3 / volume`. Below a relative
    // volume of 1e-3, the numerator and the determinant are computed in double-double arithmetic from exact
    // differences. The error then stays below 1e-16 down to the flattest tetrahedra that occur with exact
    // predicates.
    if det * det > FLAT * b2 * c2 * d2 {
        Some(((cd * b2 + db * c2 + bc * d2) * (0.5 / det), det))
    } else {
        None
    }
}

/// Returns six times the signed volume of a tetrahedron, accurate to the last digits also if it is nearly
/// flat.
#[inline]
pub(crate) fn six_volumes(corners: [&Point3<f64>; 4]) -> f64 {
    let [o, p, q, r] = corners;
    let (b, c, d) = (p - o, q - o, r - o);
    // The same test of flatness as `quick`: signs and volumes agree with the centres.
    let det = b.dot(&c.cross(&d));
    if det * det > FLAT * b.norm_squared() * c.norm_squared() * d.norm_squared() {
        return det;
    }
    let difference = |e: &Point3<f64>| [0, 1, 2].map(|k| two_sum(e[k], -o[k]));
    dot(difference(p), cross(difference(q), difference(r))).0
}

/// Like [`circumcentre`], in double-double arithmetic.
#[cold]
pub(crate) fn accurate([o, p, q, r]: [&Point3<f64>; 4]) -> (Vector3<f64>, f64) {
    // Exact differences: rounding them would move the corners, and a flat tetrahedron amplifies this without
    // bound.
    let difference = |e: &Point3<f64>| [0, 1, 2].map(|k| two_sum(e[k], -o[k]));
    let (b, c, d) = (difference(p), difference(q), difference(r));
    let (b2, c2, d2) = (dot(b, b), dot(c, c), dot(d, d));
    let (cd, db, bc) = (cross(c, d), cross(d, b), cross(b, c));
    let det = dot(b, cd).0;
    let numerator = [0, 1, 2].map(|k| (cd[k] * b2 + db[k] * c2 + bc[k] * d2).0);
    (Vector3::from(numerator) * (0.5 / det), det)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_tetrahedra_keep_their_centre() {
        // Four points on a circle of radius 1 about (0, 0, 0.25), one lifted by 2^-40: the centre moves up
        // the axis.
        let lift = 2.0_f64.powi(-40);
        let p = [
            [1.0, 0.0, 0.25],
            [0.0, 1.0, 0.25],
            [-1.0, 0.0, 0.25],
            [0.0, -1.0, 0.25 + lift],
        ]
        .map(Point3::from);
        let (centre, _) = circumcentre([&p[0], &p[1], &p[2], &p[3]]);
        let centre = p[0] + centre;
        assert!(
            (centre - Point3::new(0.0, 0.0, 0.25 + 0.5 * lift)).norm() < 1e-15,
            "{centre}"
        );
    }
}

//! Exact geometric predicates.
//!
//! The sign is always that of the exact determinant of the given coordinates. A semi-static floating-point
//! filter decides the clear cases. Integers and double-double numbers (`stages`) decide nearly all others,
//! and `robust` (adaptive exact arithmetic) the rest. Ties of the in-sphere test are broken by symbolic
//! perturbation: point `i` is lifted by `eps_i` on the paraboloid, with `eps_i` growing infinitely fast in
//! `i`. The result is a consistent regular triangulation, so no flat tetrahedron can arise.
//!
//! Exactness requires that products of five coordinate differences do not underflow: keep differences above
//! 1e-50.

mod stages;

use nalgebra::Point3;
use robust::Coord3D;
use stages::Differences;
use std::cmp::Ordering;

/// Relative error bound of the orientation filter, for the product of the largest differences per axis: some
/// 46 units of `2^-53`.
const ORIENT_BOUND: f64 = 5.110_712_782_997_33e-15;
/// Relative error bound of the in-sphere filter, for the product of the largest differences per axis and the
/// square of the largest of all: some 1123 units of `2^-53`.
const SPHERE_BOUND: f64 = 1.246_613_653_102_729_8e-13;
/// Differences below this could make the filters themselves underflow; the exact predicates decide then.
const TINY: f64 = 1e-58;

fn coord(p: &Point3<f64>) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

fn sign(x: f64) -> Ordering {
    if x > 0.0 {
        Ordering::Greater
    } else if x < 0.0 {
        Ordering::Less
    } else {
        Ordering::Equal
    }
}

#[inline]
fn max3(a: f64, b: f64, c: f64) -> f64 {
    let m = if a.abs() > b.abs() { a.abs() } else { b.abs() };
    if m > c.abs() { m } else { c.abs() }
}

/// Returns the exact sign of `(b-a) x (c-a) . (d-a)`: `Greater` if the tetrahedron `abcd` has a positive
/// volume.
#[inline]
pub fn orient3d(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>, d: &Point3<f64>) -> Ordering {
    let (bx, by, bz) = (b.x - a.x, b.y - a.y, b.z - a.z);
    let (cx, cy, cz) = (c.x - a.x, c.y - a.y, c.z - a.z);
    let (dx, dy, dz) = (d.x - a.x, d.y - a.y, d.z - a.z);
    let det = dx * (by * cz - bz * cy) + dy * (bz * cx - bx * cz) + dz * (bx * cy - by * cx);
    let (mx, my, mz) = (max3(bx, cx, dx), max3(by, cy, dy), max3(bz, cz, dz));
    let bound = ORIENT_BOUND * mx * my * mz;
    // Below `TINY` the bound itself could underflow to zero, and round-off would decide.
    if mx > TINY && my > TINY && mz > TINY {
        if det > bound {
            return Ordering::Greater;
        }
        if -det > bound {
            return Ordering::Less;
        }
    }
    orient3d_exact(a, b, c, d)
}

#[cold]
fn orient3d_exact(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>, d: &Point3<f64>) -> Ordering {
    let [p, q, r, s] = [a, b, c, d].map(|x| [x.x, x.y, x.z]);
    // Integers first: nodes on grids have differences of few digits.
    let small = Differences::new([q, r, s], p).orientation();
    // `robust` has the opposite sign convention, here and for the sphere.
    small.unwrap_or_else(|| sign(-robust::orient3d(coord(a), coord(b), coord(c), coord(d))))
}

/// Returns `Greater` if `q` is inside the circumsphere of the positive tetrahedron `t`, `Equal` if it is on
/// the sphere, else `Less`. Exact.
#[inline]
pub fn insphere(t: [&Point3<f64>; 4], q: &Point3<f64>) -> Ordering {
    let [a, b, c, d] = t;
    let (ax, ay, az) = (a.x - q.x, a.y - q.y, a.z - q.z);
    let (bx, by, bz) = (b.x - q.x, b.y - q.y, b.z - q.z);
    let (cx, cy, cz) = (c.x - q.x, c.y - q.y, c.z - q.z);
    let (dx, dy, dz) = (d.x - q.x, d.y - q.y, d.z - q.z);
    // Minors that several cofactors share are computed once.
    let (ab, bc) = (ax * by - bx * ay, bx * cy - cx * by);
    let (cd, da) = (cx * dy - dx * cy, dx * ay - ax * dy);
    let (ac, bd) = (ax * cy - cx * ay, bx * dy - dx * by);
    let abc = az * bc - bz * ac + cz * ab;
    let bcd = bz * cd - cz * bd + dz * bc;
    let cda = cz * da + dz * ac + az * cd;
    let dab = dz * ab + az * bd + bz * da;
    let a2 = ax * ax + ay * ay + az * az;
    let b2 = bx * bx + by * by + bz * bz;
    let c2 = cx * cx + cy * cy + cz * cz;
    let d2 = dx * dx + dy * dy + dz * dz;
    let det = (c2 * dab - d2 * abc) + (a2 * bcd - b2 * cda);
    let mx = max3(ax, bx, cx).max(dx.abs());
    let my = max3(ay, by, cy).max(dy.abs());
    let mz = max3(az, bz, cz).max(dz.abs());
    let m = max3(mx, my, mz);
    let scale = mx * my * mz * (m * m);
    let bound = SPHERE_BOUND * scale;
    if mx > TINY && my > TINY && mz > TINY {
        if det > bound {
            return Ordering::Greater;
        }
        if -det > bound {
            return Ordering::Less;
        }
        // The stages cost a tenth of expansions and decide nearly all that the filter leaves.
        if let Some(sign) = insphere_staged(t, q, scale) {
            return sign;
        }
    }
    insphere_exact(t, q)
}

#[cold]
fn insphere_staged(t: [&Point3<f64>; 4], q: &Point3<f64>, scale: f64) -> Option<Ordering> {
    Differences::new(t.map(|x| [x.x, x.y, x.z]), [q.x, q.y, q.z]).sphere(scale)
}

#[cold]
fn insphere_exact(t: [&Point3<f64>; 4], q: &Point3<f64>) -> Ordering {
    let [a, b, c, d] = t.map(coord);
    sign(-robust::insphere(a, b, c, d, coord(q)))
}

/// Returns whether `q` is inside the circumsphere of the positive tetrahedron `t`. Ties are broken by the
/// distinct `ranks` (first those of `t`, last that of `q`).
pub fn insphere_perturbed(t: [&Point3<f64>; 4], q: &Point3<f64>, ranks: [u64; 5]) -> bool {
    match insphere(t, q) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal => tie_break(t, q, ranks),
    }
}

/// Breaks a tie: the point of highest rank that has a non-zero coefficient in the perturbed determinant
/// decides.
#[cold]
fn tie_break(t: [&Point3<f64>; 4], q: &Point3<f64>, ranks: [u64; 5]) -> bool {
    let mut order = [0, 1, 2, 3, 4];
    // The perturbation grows infinitely fast with the rank: the highest rank that counts decides alone.
    order.sort_unstable_by_key(|&i: &usize| std::cmp::Reverse(ranks[i]));
    for i in order {
        if i == 4 {
            // The point `q` itself is lifted, and so leaves the sphere.
            return false;
        }
        let mut s = t;
        // The coefficient of the lift of corner `i` is the volume with `q` in the corner's place.
        s[i] = q;
        match orient3d(s[0], s[1], s[2], s[3]) {
            Ordering::Greater => return true,
            Ordering::Less => return false,
            Ordering::Equal => {}
        }
    }
    false
}

/// Returns whether the three points lie on one straight line. Exact.
pub fn collinear(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> bool {
    let flat = |f: fn(&Point3<f64>) -> robust::Coord<f64>| {
        sign(robust::orient2d(f(a), f(b), f(c))) == Ordering::Equal
    };
    // Points in space are on a line if and only if all three projections are.
    flat(|p| robust::Coord { x: p.x, y: p.y })
        && flat(|p| robust::Coord { x: p.y, y: p.z })
        && flat(|p| robust::Coord { x: p.z, y: p.x })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_follow_the_volume_convention() {
        let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
        assert_eq!(orient3d(&o, &x, &y, &z), Ordering::Greater);
        assert_eq!(orient3d(&o, &y, &x, &z), Ordering::Less);
        let t = [&o, &x, &y, &z];
        assert_eq!(insphere(t, &Point3::new(0.5, 0.5, 0.5)), Ordering::Greater);
        assert_eq!(insphere(t, &Point3::new(1.0, 1.0, 1.0)), Ordering::Equal);
        assert_eq!(
            insphere(t, &Point3::new(1.0, 1.0, 1.0 + f64::EPSILON)),
            Ordering::Less
        );
        assert_eq!(
            insphere(t, &Point3::new(1.0, 1.0, 1.0 - f64::EPSILON)),
            Ordering::Greater
        );
    }

    #[test]
    fn the_last_bit_decides_the_orientation() {
        let p = |k: f64| Point3::new(0.1 + k * 0.3, 0.7 + k * 0.1, 0.2 + k * 0.9);
        let (a, b, c) = (p(0.0), p(1.0), Point3::new(0.4, 0.4, 0.4));
        let mut d = b;
        assert_eq!(orient3d(&a, &b, &c, &d), Ordering::Equal);
        d.x += f64::EPSILON;
        assert_ne!(orient3d(&a, &b, &c, &d), Ordering::Equal);
        assert!(collinear(&a, &b, &b) && !collinear(&a, &b, &c));
    }

    #[test]
    fn highest_rank_is_lifted_out_of_the_sphere() {
        let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
        let q = Point3::new(1.0, 1.0, 1.0);
        assert!(!insphere_perturbed([&o, &x, &y, &z], &q, [0, 1, 2, 3, 4]));
        assert!(insphere_perturbed([&o, &x, &y, &z], &q, [0, 1, 2, 4, 3]));
    }
}

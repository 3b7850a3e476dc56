//! Two stages between the floating-point filter and arithmetic on expansions.
//!
//! Nodes on grids are frequent: the eight corners of every cube of a grid lie on one sphere. Two stages
//! decide nearly all of these cases at a tenth of the cost of expansions. Coordinates that are multiples of a
//! power of two (`1, 2, 3 …`, `0.25, 0.5 …`) have small integer differences, and integers hold their
//! determinant exactly. Points of other grids are on a common sphere only up to the rounding of their
//! coordinates, which double-double numbers can tell from a tie.

use std::cmp::Ordering;

/// Bits of an integer difference: a minor of three rows then fits into 64 bits, the in-sphere determinant
/// into 128.
const BITS: i32 = 20;

/// Returns the rounded difference and its rounding error.
#[inline]
fn two_diff(a: f64, b: f64) -> [f64; 2] {
    let x = a - b;
    let virtual_b = a - x;
    let virtual_a = x + virtual_b;
    [x, (a - virtual_a) + (virtual_b - b)]
}

#[inline]
fn two_sum(a: f64, b: f64) -> [f64; 2] {
    let x = a + b;
    let virtual_b = x - a;
    let virtual_a = x - virtual_b;
    [x, (a - virtual_a) + (b - virtual_b)]
}

#[inline]
fn fast_two_sum(a: f64, b: f64) -> [f64; 2] {
    let x = a + b;
    [x, b - (x - a)]
}

/// Veltkamp's split into halves of 26 bits.
#[inline]
fn split(a: f64) -> [f64; 2] {
    // No fused multiply-add: without hardware support it is a library call.
    let c = 134_217_729.0 * a;
    let high = c - (c - a);
    [high, a - high]
}

#[inline]
fn two_product(a: f64, b: f64) -> [f64; 2] {
    let x = a * b;
    let ([ah, al], [bh, bl]) = (split(a), split(b));
    [x, al * bl - (((x - ah * bh) - al * bh) - ah * bl)]
}

/// Double-double number: the sum of two numbers, the second below the last digit of the first.
#[derive(Clone, Copy)]
struct Double([f64; 2]);

impl std::ops::Add for Double {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        let [s, e] = two_sum(self.0[0], o.0[0]);
        let [t, f] = two_sum(self.0[1], o.0[1]);
        let [s, e] = fast_two_sum(s, e + t);
        Self(fast_two_sum(s, e + f))
    }
}

impl std::ops::Neg for Double {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self([-self.0[0], -self.0[1]])
    }
}

impl std::ops::Sub for Double {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl std::ops::Mul for Double {
    type Output = Self;
    #[inline]
    fn mul(self, o: Self) -> Self {
        let [p, e] = two_product(self.0[0], o.0[0]);
        Self(fast_two_sum(p, e + (self.0[0] * o.0[1] + self.0[1] * o.0[0])))
    }
}

/// Exact differences between points and a reference point, one row of three per point.
pub(super) struct Differences<const N: usize>([[[f64; 2]; 3]; N]);

impl<const N: usize> Differences<N> {
    pub(super) fn new(points: [[f64; 3]; N], origin: [f64; 3]) -> Self {
        Self(points.map(|p| [0, 1, 2].map(|k: usize| two_diff(p[k], origin[k]))))
    }

    /// Returns the differences as integers, in units of a power of two; `None` if they do not all fit.
    fn integers(&self) -> Option<[[i64; 3]; N]> {
        let (mut unit, mut top) = (i32::MAX, i32::MIN);
        for [x, rest] in self.0.iter().flatten() {
            // A difference that one number does not hold exactly has too many digits. Zero has no digits.
            if *rest != 0.0 {
                return None;
            }
            if *x != 0.0 {
                let (low, high) = digits(*x)?;
                unit = unit.min(low);
                top = top.max(high);
            }
        }
        if top == i32::MIN {
            return Some([[0; 3]; N]);
        }
        if top - unit >= BITS {
            return None;
        }
        // Exact: the scale is a power of two, and the quotient is an integer.
        let scale = f64::from_bits(((1023 - i64::from(unit)) as u64) << 52);
        Some(self.0.map(|row| row.map(|[x, _]| (x * scale) as i64)))
    }
}

/// Returns the exponents of the lowest and of the highest binary digit; `None` for very small or large
/// numbers, whose unit could not be represented.
fn digits(x: f64) -> Option<(i32, i32)> {
    let bits = x.to_bits();
    // The exponent without the bias; the mantissa gets back the leading one that is not stored.
    let exponent = (bits >> 52 & 0x7ff) as i32 - 1023;
    let mantissa = bits & ((1 << 52) - 1) | 1 << 52;
    let low = exponent - 52 + mantissa.trailing_zeros() as i32;
    (exponent.abs() < 900).then_some((low, exponent))
}

/// Returns `a × b · c`.
fn triple<V>([a, b, c]: [[V; 3]; 3]) -> V
where
    V: Copy + std::ops::Mul<Output = V> + std::ops::Sub<Output = V> + std::ops::Add<Output = V>,
{
    c[0] * (a[1] * b[2] - a[2] * b[1])
        + c[1] * (a[2] * b[0] - a[0] * b[2])
        + c[2] * (a[0] * b[1] - a[1] * b[0])
}

impl Differences<3> {
    /// Returns the sign of `(b-a) × (c-a) · (d-a)` for the differences of `b`, `c`, `d` to `a`; `None` if
    /// they are no small integers.
    pub(super) fn orientation(&self) -> Option<Ordering> {
        // A minor of differences of 20 bits fits into 64 bits, see `BITS`.
        self.integers().map(|rows| triple(rows).cmp(&0))
    }
}

impl Differences<4> {
    /// Returns the sign of the in-sphere determinant, positive inside; `None` if neither integers nor
    /// double-double numbers decide it. `scale` bounds the terms: the product of the differences' largest
    /// sizes.
    pub(super) fn sphere(&self, scale: f64) -> Option<Ordering> {
        if let Some(rows) = self.integers() {
            let [a, b, c, d] = rows;
            // Squares still fit into 64 bits; only their products with minors need 128.
            let square = |p: [i64; 3]| i128::from(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
            let minor = |p, q, r| i128::from(triple([p, q, r]));
            let det = square(c) * minor(d, a, b) - square(d) * minor(a, b, c)
                + (square(a) * minor(b, c, d) - square(b) * minor(c, d, a));
            return Some(det.cmp(&0));
        }
        let [a, b, c, d] = self.0.map(|row| row.map(Double));
        let square = |p: [Double; 3]| p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        let minor = |p, q, r| triple([p, q, r]);
        let Double([det, _]) = square(c) * minor(d, a, b) - square(d) * minor(a, b, c)
            + (square(a) * minor(b, c, d) - square(b) * minor(c, d, a));
        // Between the bounds the result could be round-off: the caller goes on to expansions.
        let bound = DOUBLE_BOUND * scale;
        (det > bound)
            .then_some(Ordering::Greater)
            .or((det < -bound).then_some(Ordering::Less))
    }
}

/// Relative error bound of the double-double stage: the bound of the filter, for operations with an error of
/// at most `2⁻¹⁰²` instead of `2⁻⁵³`, times sixteen.
const DOUBLE_BOUND: f64 = super::SPHERE_BOUND / (1_u64 << 45) as f64;

#[cfg(test)]
mod tests {
    use super::super::{coord, sign};
    use super::*;
    use nalgebra::Point3;
    use proptest::prelude::*;

    fn exact(p: [[f64; 3]; 5]) -> Ordering {
        let [a, b, c, d, q] = p.map(|x| coord(&Point3::from(x)));
        sign(-robust::insphere(a, b, c, d, q))
    }

    fn staged(p: [[f64; 3]; 5]) -> Option<Ordering> {
        let [a, b, c, d, q] = p;
        let m = |k: usize| {
            [a, b, c, d]
                .iter()
                .fold(0.0_f64, |m, x| m.max((x[k] - q[k]).abs()))
        };
        let (x, y, z) = (m(0), m(1), m(2));
        let top = x.max(y).max(z);
        Differences::new([a, b, c, d], q).sphere(x * y * z * top * top)
    }

    proptest! {
        #![proptest_config(reader_fuzz::property_config(256))]
        /// Points of grids with any origin and spacing: every answer is exact, and on grids of powers of two
        /// there is always an answer.
        #[test]
        fn stages_agree_with_expansions_on_grids(
            at in prop::array::uniform5(prop::array::uniform3(0_i32..4)),
            origin in prop::array::uniform3(-3.0..3.0_f64),
            spacing in 0.01..1.0_f64,
        ) {
            let dyadic = at.map(|p| p.map(|k| 0.25 * f64::from(k) - 7.0));
            prop_assert_eq!(staged(dyadic), Some(exact(dyadic)));
            let rounded = at.map(|p| [0, 1, 2].map(|k: usize| origin[k] + f64::from(p[k]) * spacing));
            if let Some(found) = staged(rounded) {
                prop_assert_eq!(found, exact(rounded));
            }
            let [a, b, c, d, _] = dyadic;
            let orientation = Differences::new([b, c, d], a).orientation();
            let [ra, rb, rc, rd] = [a, b, c, d].map(|x| coord(&Point3::from(x)));
            prop_assert_eq!(orientation, Some(sign(-robust::orient3d(ra, rb, rc, rd))));
        }
    }

    #[test]
    fn a_last_digit_off_the_sphere_is_seen_without_expansions() {
        let cube = [[0.1, 0.1, 0.1], [0.4, 0.1, 0.1], [0.1, 0.4, 0.1], [0.1, 0.1, 0.4]];
        for last in [0.4 - 1e-16, 0.4 + 1e-16] {
            let [a, b, c, d] = cube;
            let p = [a, b, c, d, [0.4, 0.4, last]];
            assert_eq!(staged(p), Some(exact(p)));
        }
    }
}

//! Front of a crack, and the field `q` around it.

use crate::error::invalid;
use crate::field::{Interpolation, ShapeRow};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Front of a crack within a body, and the radii of the domain of integration around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrackFront<T: Real> {
    /// Ends of the examined part of the front, which is straight \[m\]. Towards an end that lies inside of
    /// the body `q` falls to zero, within the part, over the difference of the radii or at most half of the
    /// part.
    pub ends: [Point3<T>; 2],
    /// Direction in which the crack would grow; its component along the front is ignored.
    pub direction: Vector3<T>,
    /// Radius up to which `q` is one, and radius at which it is zero \[m\].
    pub radii: [T; 2],
}

/// Distance from an end of the front, over its length, at which the body is probed: coordinates in files are
/// rounded.
const NEAR_END: f64 = 1e-3;
/// Number of places along the front that must have material ahead.
const PLACES: usize = 8;
/// Samples of `q` per length of the front.
const SAMPLES: usize = 256;
/// Largest distance beyond the ends of the front at which `q` is sampled, in lengths of the front.
const BEYOND: usize = 16;

impl<T: Real> CrackFront<T> {
    /// Refuses radii, ends and a direction that make no sense.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`].
    pub fn check(&self) -> Result<()> {
        self.axes().map(|_| ())
    }

    /// Returns the axis of the front, its length \[m\], and the unit direction across it.
    pub(super) fn axes(&self) -> Result<(Vector3<T>, T, Vector3<T>)> {
        let [inner, outer] = self.radii;
        if !(inner > T::zero() && outer > inner && outer.is_finite()) {
            let radii = format_args!("[{inner}, {outer}]");
            return Err(invalid(
                "radii of the crack front",
                radii,
                "must be positive, the inner one below the outer one [m]",
            ));
        }
        let along = self.ends[1] - self.ends[0];
        let length = along.norm();
        if !(length > T::zero() && length.is_finite()) {
            let rule = "its ends must be two different points [m]";
            return Err(invalid("length of the crack front", length, rule));
        }
        let axis = along / length;
        let d = self.direction;
        // Growth along the front is no growth: this component would only stretch `q`.
        let across = d - axis * axis.dot(&d);
        let share = across.norm() / d.norm();
        // Negated, so that the NaN of a zero direction is refused as well.
        let turned = share > T::of(1e-6);
        if !turned {
            let given_direction = format_args!("{:?}", d.as_slice());
            let rule = "must have a length and not lie along the front; give the direction in which the crack would grow";
            return Err(invalid("direction of the crack", given_direction, rule));
        }
        Ok((axis, length, across.normalize()))
    }
}

/// Field `q` over a cylinder around the front.
pub(super) struct Cylinder<T: Real> {
    pub(super) from: Point3<T>,
    pub(super) axis: Vector3<T>,
    pub(super) length: T,
    pub(super) radii: [T; 2],
    /// Length over which `q` falls to zero towards each end \[m\]; zero where the front ends at a surface.
    pub(super) tapers: [T; 2],
}

impl<T: Real> Cylinder<T> {
    /// Returns the distance from the line of the front \[m\].
    pub(super) fn distance(&self, x: &Point3<T>) -> T {
        let arm = x - self.from;
        (arm - self.axis * arm.dot(&self.axis)).norm()
    }

    /// Returns the factors of `q` across and along the front.
    pub(super) fn shares(&self, x: &Point3<T>) -> [T; 2] {
        let t = (x - self.from).dot(&self.axis);
        let r = self.distance(x);
        let [inner, outer] = self.radii;
        let share = |x: T| x.max(T::zero()).min(T::one());
        let ends = [t, self.length - t];
        let along = self.tapers.iter().zip(ends).fold(T::one(), |q, (taper, x)| {
            if *taper > T::zero() {
                q.min(share(x / *taper))
            } else {
                q
            }
        });
        [share((outer - r) / (outer - inner)), along]
    }
}

pub(super) fn place<T: Real>(x: &Point3<T>) -> String {
    let [x, y, z] = [x.x, x.y, x.z].map(T::as_f64);
    format!("({x:.6e}, {y:.6e}, {z:.6e}) m")
}

/// Returns a point at the share `t` of the front, an inner radius ahead of it: there is material for a notch
/// as well as a slit.
fn ahead<T: Real>(crack: &CrackFront<T>, direction: &Vector3<T>, t: f64) -> Point3<T> {
    crack.ends[0] + (crack.ends[1] - crack.ends[0]) * T::of(t) + direction * crack.radii[0]
}

/// Returns the nodes of the cells ahead of the front. Expects [`tapers`] to have found material there.
pub(super) fn nodes_along<T: Real>(
    field: &dyn Interpolation<T>,
    crack: &CrackFront<T>,
    direction: &Vector3<T>,
) -> Result<Vec<u32>> {
    let (mut row, mut out) = (ShapeRow::default(), Vec::new());
    for t in places() {
        field.shape_at(&ahead(crack, direction, t), false, &mut row)?;
        out.extend(row.nodes.iter().map(|n| *n as u32));
    }
    Ok(out)
}

fn places() -> impl Iterator<Item = f64> {
    (0..PLACES).map(|k| (k as f64 + 0.5) / PLACES as f64)
}

/// Integrates `∫ q dl` along the front \[m\]. Between its nodal values `q` follows the shape functions, so
/// that it reaches beyond the ends of the part by up to an element.
pub(super) fn swept<T: Real>(
    field: &dyn Interpolation<T>,
    crack: &CrackFront<T>,
    cylinder: &Cylinder<T>,
    direction: &Vector3<T>,
) -> Result<T> {
    // Without tapers `q` is one along the whole front.
    if cylinder.tapers == [T::zero(); 2] {
        return Ok(cylinder.length);
    }
    let mut row = ShapeRow::default();
    let mut value_of_q = |t: f64| {
        field.shape_at(&ahead(crack, direction, t), false, &mut row)?;
        let shapes = row.nodes.iter().zip(&row.values);
        Ok(shapes.fold(T::zero(), |q, (n, w)| {
            q + cylinder.shares(&field.nodes()[*n])[1] * *w
        }))
    };
    let mut sum = T::zero();
    for k in 0..SAMPLES {
        sum += value_of_q((k as f64 + 0.5) / SAMPLES as f64)?;
    }
    for end in [0.0, 1.0] {
        // Beyond an end `q` is followed until it is zero or the body ends.
        for k in 0..BEYOND * SAMPLES {
            let off = (k as f64 + 0.5) / SAMPLES as f64;
            match value_of_q(if end > 0.0 { end + off } else { -off }) {
                Ok(q) if q > T::zero() => sum += q,
                Ok(_) | Err(Error::OutsideDomain { .. }) => break,
                Err(e) => return Err(e),
            }
        }
    }
    let share = sum / T::of(SAMPLES as f64);
    // The integral divides by this length: a part shorter than an element has next to none.
    if share < T::of(0.1) {
        let rule = "no node lies well within the part of the front; look at a longer part, or at all of it";
        return Err(invalid("length of the crack front", cylinder.length, rule));
    }
    Ok(share * cylinder.length)
}

/// Returns the lengths over which `q` falls to zero towards the ends of the front; zero where the body ends.
///
/// # Errors
/// [`Error::InvalidParameter`] if there is no material an inner radius ahead of the front.
pub(super) fn tapers<T: Real>(
    model: &str,
    field: &dyn Interpolation<T>,
    crack: &CrackFront<T>,
    length: T,
    direction: &Vector3<T>,
) -> Result<[T; 2]> {
    let mut row = ShapeRow::default();
    let mut outside = |t: f64| {
        let x = ahead(crack, direction, t);
        match field.shape_at(&x, false, &mut row) {
            Ok(()) => Ok(None),
            Err(Error::OutsideDomain { .. }) => Ok(Some(x)),
            Err(e) => Err(e),
        }
    };
    for t in [NEAR_END, 1.0 - NEAR_END].into_iter().chain(places()) {
        if let Some(x) = outside(t)? {
            let rule = format!(
                "model '{model}' is not there, an inner radius ahead of the crack front; move the front to where the crack ends in the \
                 body, turn the direction, or take a smaller inner radius"
            );
            return Err(invalid("point", place(&x), &rule));
        }
    }
    let [inner, outer] = crack.radii;
    let taper = (outer - inner).min(length * T::of(0.5));
    let mut out = [T::zero(); 2];
    for (out, t) in out.iter_mut().zip([-NEAR_END, 1.0 + NEAR_END]) {
        // The body goes on beyond this end: `q` must be zero there. Where it ends, the front meets a surface.
        if outside(t)?.is_none() {
            *out = taper;
        }
    }
    Ok(out)
}

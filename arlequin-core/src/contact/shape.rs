//! Shapes of obstacles and their motions.

use super::{Solid, positive};
use crate::error::invalid;
use crate::geometry::closest_on_triangle;
use crate::{Result, TimeFunction};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use std::sync::Arc;

/// A rigid shape in its initial position.
#[derive(Debug, Clone)]
pub enum RigidShape {
    /// Half-space behind a plane.
    Plane {
        /// A point of the plane \[m\].
        point: Point3<f64>,
        /// Direction towards the models, of any length.
        normal: Vector3<f64>,
    },
    /// Ball.
    Sphere {
        /// Centre \[m\].
        centre: Point3<f64>,
        /// Radius \[m\].
        radius: f64,
    },
    /// Infinite cylinder, for example a roller.
    Cylinder {
        /// A point of the axis \[m\].
        point: Point3<f64>,
        /// Direction of the axis, of any length.
        axis: Vector3<f64>,
        /// Radius \[m\].
        radius: f64,
    },
    /// Circular cone with a flat base.
    Cone {
        /// Tip \[m\].
        tip: Point3<f64>,
        /// Direction from the tip to the base, of any length.
        axis: Vector3<f64>,
        /// Height \[m\].
        height: f64,
        /// Radius of the base \[m\].
        radius: f64,
    },
    /// Box.
    Box {
        /// Centre \[m\].
        centre: Point3<f64>,
        /// Half of the lengths of its sides \[m\].
        half: Vector3<f64>,
        /// Axes of the box in its columns.
        axes: Matrix3<f64>,
    },
    /// Body with a surface of triangles.
    Solid(Arc<Solid>),
}

impl RigidShape {
    /// Box of a centre and sizes \[m\], turned about its centre by the rotation vector `turn` \[rad\].
    #[must_use]
    pub fn cuboid(centre: Point3<f64>, size: Vector3<f64>, turn: Vector3<f64>) -> Self {
        Self::Box {
            centre,
            half: size * 0.5,
            axes: Rotation3::new(turn).into_inner(),
        }
    }

    /// Checks the shape and scales its direction to unit length.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a direction without length or a size that is not positive.
    pub fn checked(self) -> Result<Self> {
        let unit = |name: &str, v: Vector3<f64>| {
            let unit = v.try_normalize(0.0).filter(|v| v.iter().all(|c| c.is_finite()));
            unit.ok_or_else(|| invalid(name, v.norm(), "must be finite and other than zero"))
        };
        Ok(match self {
            Self::Plane { point, normal } => Self::Plane {
                point,
                normal: unit("normal of an obstacle", normal)?,
            },
            Self::Sphere { radius, .. } => {
                positive("radius of an obstacle", radius)?;
                self
            }
            Self::Cylinder { point, axis, radius } => {
                positive("radius of an obstacle", radius)?;
                Self::Cylinder {
                    point,
                    axis: unit("axis of an obstacle", axis)?,
                    radius,
                }
            }
            Self::Cone {
                tip,
                axis,
                height,
                radius,
            } => {
                positive("radius of an obstacle", radius)?;
                positive("height of an obstacle", height)?;
                Self::Cone {
                    tip,
                    axis: unit("axis of an obstacle", axis)?,
                    height,
                    radius,
                }
            }
            Self::Box { half, .. } => {
                half.iter()
                    .try_for_each(|h| positive("size of an obstacle", *h))?;
                self
            }
            Self::Solid(_) => self,
        })
    }

    /// Largest depth of a point inside the shape \[m\]; infinite for a plane. A body of triangles has that of
    /// its thinnest part ([`Solid::depth`]).
    #[must_use]
    pub fn depth(&self) -> f64 {
        match self {
            Self::Plane { .. } => f64::INFINITY,
            Self::Sphere { radius, .. } | Self::Cylinder { radius, .. } => *radius,
            // Radius of the largest ball inside.
            Self::Cone { height, radius, .. } => height * radius / (radius + height.hypot(*radius)),
            Self::Box { half, .. } => half.min(),
            Self::Solid(solid) => solid.depth(),
        }
    }

    /// Area of the largest section \[m²\], infinite for planes and cylinders.
    #[must_use]
    pub(crate) fn section(&self) -> f64 {
        let largest = |size: Vector3<f64>| size.product() / size.min();
        match self {
            Self::Plane { .. } | Self::Cylinder { .. } => f64::INFINITY,
            Self::Sphere { radius, .. } | Self::Cone { radius, .. } => std::f64::consts::PI * radius * radius,
            Self::Box { half, .. } => largest(half * 2.0),
            Self::Solid(solid) => {
                let [low, high] = solid.bounds();
                largest(high - low)
            }
        }
    }

    /// A point inside the shape, or on a plane \[m\]: the centre of a ball or a box.
    #[must_use]
    pub fn middle(&self) -> Point3<f64> {
        match self {
            Self::Plane { point, .. } | Self::Cylinder { point, .. } => *point,
            Self::Sphere { centre, .. } | Self::Box { centre, .. } => *centre,
            Self::Cone {
                tip, axis, height, ..
            } => tip + axis * (0.75 * height),
            Self::Solid(solid) => {
                let [low, high] = solid.bounds();
                low + (high - low) * 0.5
            }
        }
    }

    /// A point of the body; `None` for bodies without end.
    pub(super) fn inner_point(&self) -> Option<Point3<f64>> {
        match self {
            Self::Plane { .. } | Self::Cylinder { .. } => None,
            // The middle of a hollow body lies outside of it.
            Self::Solid(solid) => Some(solid.triangles()[0][0]),
            _ => Some(self.middle()),
        }
    }

    /// Radius and moment of inertia of a free ball; `None` for bodies that do not rotate.
    pub(crate) fn turning(&self, motion: &Motion) -> Result<Option<(f64, f64)>> {
        let Motion::Free { mass, inertia, .. } = motion else {
            return Ok(None);
        };
        match (self, inertia) {
            (Self::Sphere { radius, .. }, value) => {
                // A full ball: `2/5 m r²`.
                let inertia = value.unwrap_or(0.4 * mass * radius * radius);
                positive("moment of inertia of an obstacle", inertia)?;
                Ok(Some((*radius, inertia)))
            }
            (_, None) => Ok(None),
            (_, Some(value)) => Err(invalid(
                "moment of inertia of an obstacle that moves without turning",
                *value,
                "must be left out, or make the obstacle a sphere",
            )),
        }
    }

    /// Distance of a triangle from the surface of the shape displaced by `displacement` \[m\], negative if
    /// the triangle reaches inside; and the point of the triangle that is nearest to the shape, or deepest
    /// inside. For cones, boxes and solids it is the nearest of five points: the corners, the centroid, and
    /// the point next to the middle of the shape.
    #[must_use]
    pub fn distance_of_triangle(
        &self,
        corners: &[Point3<f64>; 3],
        displacement: &Vector3<f64>,
    ) -> (f64, Point3<f64>) {
        let points = corners.each_ref().map(|x| x.coords);
        let nearest = match self {
            Self::Plane { normal, .. } => {
                let height = |x: &Point3<f64>| normal.dot(&x.coords);
                let [a, b, c] = corners;
                let lower = |a, b| if height(b) < height(a) { b } else { a };
                *lower(lower(a, b), c)
            }
            Self::Sphere { centre, .. } => {
                closest_on_triangle(&(centre.coords + displacement), &points).into()
            }
            Self::Cylinder { point, axis, .. } => {
                // Distances are measured in the plane across the axis; along the axis the triangle's middle
                // serves as position.
                let [a, b, c] = corners.each_ref().map(|x| x - point - displacement);
                let flat = [a, b, c].map(|d| d - axis * axis.dot(&d));
                let along = axis * (axis.dot(&(a + b + c)) / 3.0);
                point + displacement + closest_on_triangle(&Vector3::zeros(), &flat) + along
            }
            Self::Cone { .. } | Self::Box { .. } | Self::Solid(_) => {
                let centroid = points.iter().sum::<Vector3<f64>>() / 3.0;
                let beside = closest_on_triangle(&(self.middle().coords + displacement), &points);
                let others = [centroid, beside].map(Point3::from);
                let candidates = corners.iter().chain(&others);
                let distance = |x: &&Point3<f64>| self.distance(x, displacement).0;
                let nearest = candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)));
                nearest.copied().unwrap_or(corners[0])
            }
        };
        (self.distance(&nearest, displacement).0, nearest)
    }

    /// Distance of a point from the surface of the shape displaced by `displacement` \[m\], negative inside;
    /// and the outward normal at the nearest point of the surface.
    #[inline]
    #[must_use]
    pub fn distance(&self, x: &Point3<f64>, displacement: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let round = |d: Vector3<f64>, radius: f64| {
            let size = d.norm();
            let n = if size > 0.0 { d / size } else { Vector3::x() };
            (size - radius, n)
        };
        match self {
            Self::Plane { point, normal } => (normal.dot(&(x - point - displacement)), *normal),
            Self::Sphere { centre, radius } => round(x - centre - displacement, *radius),
            Self::Cylinder { point, axis, radius } => {
                let d = x - point - displacement;
                round(d - axis * axis.dot(&d), *radius)
            }
            Self::Cone {
                tip,
                axis,
                height,
                radius,
            } => {
                let d = x - tip - displacement;
                let along = axis.dot(&d);
                let (across, direction) = round(d - axis * along, 0.0);
                // At the axis any direction across it will do.
                let direction = if across > 0.0 {
                    direction
                } else {
                    perpendicular(axis)
                };
                let (distance, [a, b]) = of_triangle([along, across], [*height, *radius]);
                (distance, axis * a + direction * b)
            }
            Self::Box { centre, half, axes } => {
                let local = axes.tr_mul(&(x - centre - displacement));
                let (distance, normal) = of_box(&local, half);
                (distance, axes * normal)
            }
            Self::Solid(solid) => solid.distance(&(x - displacement)),
        }
    }
}

/// Unit vector perpendicular to a unit vector.
fn perpendicular(v: &Vector3<f64>) -> Vector3<f64> {
    // The axis with the smallest component of `v` is far from parallel to it.
    v.cross(&Vector3::ith(v.iamin(), 1.0)).normalize()
}

/// Signed distance of a point from a box about the origin, and the outward normal.
fn of_box(x: &Vector3<f64>, half: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let beyond = x.abs() - half;
    let sign = x.map(|c| if c < 0.0 { -1.0 } else { 1.0 });
    let outside = beyond.sup(&Vector3::zeros());
    let distance = outside.norm();
    if distance > 0.0 {
        return (distance, outside.component_mul(&sign) / distance);
    }
    let face = beyond.imax();
    (beyond[face], Vector3::ith(face, sign[face]))
}

/// Signed distance of the point `(along, across)` from the half section of a cone, a triangle with the
/// corners `(0, 0)`, `(h, 0)` and `(h, r)`; and the outward normal. The axis is no boundary.
fn of_triangle([z, r]: [f64; 2], [height, radius]: [f64; 2]) -> (f64, [f64; 2]) {
    let length = height.hypot(radius);
    let (cos, sin) = (height / length, radius / length);
    let (flank, base) = (r * cos - z * sin, z - height);
    if flank <= 0.0 && base <= 0.0 {
        return if flank > base {
            (flank, [-sin, cos])
        } else {
            (base, [1.0, 0.0])
        };
    }
    let s = (z * cos + r * sin).clamp(0.0, length);
    let on_flank = [s * cos, s * sin];
    let on_base = [height, r.min(radius)];
    let distance = |p: &[f64; 2]| (z - p[0]).hypot(r - p[1]);
    let nearest = if distance(&on_flank) < distance(&on_base) {
        on_flank
    } else {
        on_base
    };
    let d = distance(&nearest);
    if d > 0.0 {
        return (d, [(z - nearest[0]) / d, (r - nearest[1]) / d]);
    }
    (0.0, [-sin, cos])
}

/// Motion of an obstacle.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// At rest.
    Fixed,
    /// Constant velocity \[m/s\] from time zero on.
    Velocity(Vector3<f64>),
    /// Displacement `amplitude f(t)` \[m\].
    Prescribed {
        /// Amplitude \[m\].
        amplitude: Vector3<f64>,
        /// Time function `f`.
        time: TimeFunction<f64>,
    },
    /// Free motion of a body with a mass.
    Free {
        /// Mass \[kg\].
        mass: f64,
        /// Velocity at time zero \[m/s\].
        velocity: Vector3<f64>,
        /// Moment of inertia of a ball \[kg m²\]; by default that of a full ball, `2/5 m R^2`. Other shapes
        /// do not rotate.
        inertia: Option<f64>,
    },
}

impl Motion {
    pub(crate) fn first_velocity(&self) -> Vector3<f64> {
        match self {
            Self::Velocity(v) | Self::Free { velocity: v, .. } => *v,
            Self::Fixed | Self::Prescribed { .. } => Vector3::zeros(),
        }
    }

    /// Displacement at time `t` \[m\]; zero for a free body, whose motion is integrated.
    pub(crate) fn displacement(&self, t: f64) -> Vector3<f64> {
        match self {
            Self::Velocity(v) => v * t,
            Self::Prescribed { amplitude, time } => amplitude * time.value(t),
            Self::Fixed | Self::Free { .. } => Vector3::zeros(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distances are those to the nearest point of the surface, found by walking along the normal, and the
    /// sign tells the side.
    #[test]
    fn distances_from_cones_and_boxes_lead_to_their_surfaces() {
        let turn = Vector3::new(0.3, -0.5, 0.8);
        let cuboid = RigidShape::cuboid(Point3::new(0.1, 0.2, 0.3), Vector3::new(1.0, 0.6, 0.4), turn);
        let cone = RigidShape::Cone {
            tip: Point3::new(0.1, -0.1, 0.2),
            axis: Vector3::new(1.0, 2.0, -0.5),
            height: 0.9,
            radius: 0.5,
        };
        for shape in [cuboid, cone].map(|s| s.checked().unwrap()) {
            let moved = Vector3::new(0.05, 0.02, -0.04);
            let middle = shape.middle() + moved;
            assert!(shape.distance(&middle, &moved).0 < 0.0);
            let mut inside = 0;
            for k in 0..400_u32 {
                let t = f64::from(k);
                let way = Vector3::new((0.37 * t).sin(), (0.91 * t).cos(), (1.7 * t).sin());
                let x = middle + way * 0.35;
                let (d, n) = shape.distance(&x, &moved);
                assert!((n.norm() - 1.0).abs() < 1e-12);
                let foot = x - n * d;
                assert!(shape.distance(&foot, &moved).0.abs() < 1e-12, "{x} {d}");
                // No point of the surface is nearer: no point within the distance lies on the other side.
                for m in 0..20_u32 {
                    let a = f64::from(20 * k + m);
                    let probe = Vector3::new((2.3 * a).sin(), (3.1 * a).cos(), (4.7 * a).sin()).normalize();
                    let near = shape.distance(&(x + probe * (0.999 * d.abs())), &moved).0;
                    assert!(near * d >= 0.0);
                }
                inside += usize::from(d < 0.0);
            }
            assert!(inside > 20);
        }
    }
}

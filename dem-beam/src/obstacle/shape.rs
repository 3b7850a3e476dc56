//! Shapes of obstacles and their motions.

use crate::error::{Error, Result, positive};
use arlequin_core::TimeFunction;
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::{Point3, Vector3};

/// A rigid shape in its initial position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RigidShape {
    /// Half-space behind a plane.
    Plane {
        /// A point of the plane \[m\].
        point: Point3<f64>,
        /// Direction towards the particles, of any length.
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
}

impl RigidShape {
    /// Checks the shape and scales its direction to unit length.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a direction without length or a radius that is not positive.
    pub fn checked(self) -> Result<Self> {
        let unit = |name, v: Vector3<f64>| {
            v.try_normalize(0.0)
                .filter(|v| v.iter().all(|c| c.is_finite()))
                .ok_or(Error::out_of_range(
                    name,
                    v.norm(),
                    "finite vectors other than zero",
                ))
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
        })
    }

    /// Returns the radius \[m\], infinite for a plane.
    pub(crate) fn radius(&self) -> f64 {
        match self {
            Self::Plane { .. } => f64::INFINITY,
            Self::Sphere { radius, .. } | Self::Cylinder { radius, .. } => *radius,
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
            (_, Some(value)) => Err(Error::out_of_range(
                "moment of inertia of a plane or cylinder, which moves without turning,",
                *value,
                "none: leave it out, or make the obstacle a sphere",
            )),
        }
    }

    /// Distance of a triangle from the surface of the shape displaced by `displacement` \[m\], negative if
    /// the triangle reaches inside; and the point of the triangle that is nearest to the shape, or deepest
    /// inside.
    #[must_use]
    pub fn distance_of_triangle(
        &self,
        corners: &[Point3<f64>; 3],
        displacement: &Vector3<f64>,
    ) -> (f64, Point3<f64>) {
        let nearest = match self {
            Self::Plane { normal, .. } => {
                let height = |x: &Point3<f64>| normal.dot(&x.coords);
                let [a, b, c] = corners;
                let lower = |a, b| if height(b) < height(a) { b } else { a };
                *lower(lower(a, b), c)
            }
            Self::Sphere { centre, .. } => {
                let points = corners.each_ref().map(|x| x.coords);
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
        }
    }
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

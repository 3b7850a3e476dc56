//! Where the overlap is: the normalised position across it, from the distances to its two borders.

use crate::error::invalid;
use crate::geometry::Cell;
use crate::{Real, Result};
use nalgebra::{Point3, Unit, Vector3};

/// Where a point lies with respect to an overlap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place<T> {
    /// Only the coarse model lives here.
    Coarse,
    /// Only the fine model lives here.
    Fine,
    /// In the overlap, at position `s`: 0 at the border to the fine model's own region, 1 at the border to
    /// the coarse model's own region.
    Overlap(T),
}

/// Where a whole cell lies with respect to an overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellPlace {
    /// Only the coarse model lives in the cell.
    Coarse,
    /// Only the fine model lives in the cell.
    Fine,
    /// In the overlap, at least partly. Means of weights are taken over the cell halved this number of times
    /// in every direction.
    Halved(usize),
}

/// An overlap of a coarse and a fine model.
pub trait Overlap<T: Real>: std::fmt::Debug + Send + Sync {
    /// Returns where a point lies.
    fn place(&self, x: &Point3<T>) -> Place<T>;

    /// Returns where a cell lies, if the overlap knows more about it than the places of its corners.
    fn place_of_cell(&self, _cell: &Cell<T>) -> Option<CellPlace> {
        None
    }

    /// `(g, c)` if the unclamped position is the linear function `s(x) = g · x + c`.
    fn linear_position(&self) -> Option<(Vector3<T>, T)> {
        None
    }
}

/// A plane layer, the overlap of beams and bars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab<T: Real> {
    gradient: Vector3<T>,
    offset: T,
}

impl<T: Real> Slab<T> {
    /// Layer between the fine border through `fine` and the coarse border through `coarse` \[m\], normal to
    /// the line between these two points.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for coincident or non-finite points.
    pub fn between(fine: Point3<T>, coarse: Point3<T>) -> Result<Self> {
        let d = coarse - fine;
        let square = d.norm_squared();
        if !square.is_finite() || square <= T::zero() {
            return Err(invalid(
                "overlap width",
                square.sqrt(),
                "must be positive and finite",
            ));
        }
        // Divided by the squared length once more: `s` grows from 0 to 1 over the distance.
        let gradient = d / square;
        Ok(Self {
            gradient,
            offset: -gradient.dot(&fine.coords),
        })
    }
}

impl<T: Real> Overlap<T> for Slab<T> {
    fn place(&self, x: &Point3<T>) -> Place<T> {
        let s = self.gradient.dot(&x.coords) + self.offset;
        // A point on a border, up to round-off, belongs to the overlap.
        let tolerance = T::epsilon() * T::of(64.0);
        if s < -tolerance {
            Place::Fine
        } else if s > T::one() + tolerance {
            Place::Coarse
        } else {
            // Within the tolerance `s` may leave [0, 1]; profiles are not defined there.
            Place::Overlap(s.clamp(T::zero(), T::one()))
        }
    }

    fn linear_position(&self) -> Option<(Vector3<T>, T)> {
        Some((self.gradient, self.offset))
    }
}

/// A region given by its signed distance, negative inside.
pub trait Region<T: Real>: Send + Sync {
    /// Signed distance to the border \[m\].
    fn distance(&self, x: &Point3<T>) -> T;
}

/// Simple regions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Primitive<T: Real> {
    /// Half-space behind a plane, on the side that the normal points away from.
    HalfSpace {
        /// A point of the plane \[m\].
        point: Point3<T>,
        /// Outward unit normal.
        normal: Unit<Vector3<T>>,
    },
    /// A ball.
    Ball {
        /// Centre \[m\].
        centre: Point3<T>,
        /// Radius \[m\].
        radius: T,
    },
    /// A box along the axes.
    Block {
        /// Lowest corner \[m\].
        low: Point3<T>,
        /// Highest corner \[m\].
        high: Point3<T>,
    },
    /// An infinite circular cylinder.
    Cylinder {
        /// A point of the axis \[m\].
        point: Point3<T>,
        /// Direction of the axis.
        axis: Unit<Vector3<T>>,
        /// Radius \[m\].
        radius: T,
    },
}

impl<T: Real> Region<T> for Primitive<T> {
    fn distance(&self, x: &Point3<T>) -> T {
        match self {
            Self::HalfSpace { point, normal } => normal.dot(&(x - point)),
            Self::Ball { centre, radius } => (x - centre).norm() - *radius,
            Self::Block { low, high } => {
                let centre = nalgebra::center(low, high);
                let half = (high - low) * T::of(0.5);
                let q = (x - centre).abs() - half;
                let outer = q.sup(&Vector3::zeros()).norm();
                // Outside the first term counts. Inside the second does: minus the distance to the nearest
                // face.
                outer + q.max().min(T::zero())
            }
            Self::Cylinder { point, axis, radius } => {
                let d = x - point;
                (d - axis.into_inner() * axis.dot(&d)).norm() - *radius
            }
        }
    }
}

/// A general overlap: the part of an outer region that is outside an inner core.
///
/// The fine model alone fills `fine_core`; the coarse model alone fills the space outside of `fine_domain`.
/// In between `s = φ_D/(φ_C + φ_D)`, with the distances `φ_D` to the fine core and `φ_C` to the outer border.
#[derive(Debug, Clone)]
pub struct Shell<R> {
    /// Region in which only the fine model lives.
    pub fine_core: R,
    /// Whole region of the fine model; beyond it only the coarse model lives.
    pub fine_domain: R,
}

impl<T: Real, R: Region<T> + std::fmt::Debug> Overlap<T> for Shell<R> {
    fn place(&self, x: &Point3<T>) -> Place<T> {
        let to_fine = self.fine_core.distance(x);
        let to_coarse = -self.fine_domain.distance(x);
        // A point on a border, up to round-off, belongs to the overlap.
        // Relative to the width at this point: the overlap may be thin in one place and wide in another.
        let tolerance = T::epsilon() * T::of(64.0) * (to_fine.abs() + to_coarse.abs());
        if to_fine < -tolerance {
            Place::Fine
        } else if to_coarse < -tolerance {
            Place::Coarse
        } else {
            let (f, c) = (to_fine.max(T::zero()), to_coarse.max(T::zero()));
            let sum = f + c;
            // Where the two borders touch, the position is undetermined: take the middle.
            Place::Overlap(if sum > T::zero() { f / sum } else { T::of(0.5) })
        }
    }
}

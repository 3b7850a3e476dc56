//! The mediator space: where the Lagrange multipliers live.

use crate::field::{Interpolation, ShapeRow, outside};
use crate::{Real, Result};
use nalgebra::Point3;

/// The discrete space of the multipliers, on nodes of its own that fill the overlap.
///
/// Its spacing may be coarse (`h_B ≈ h_C`), fine (`h_B ≈ h_D`) or anything between. Its nodes need not
/// coincide with those of a model. The union of [`Interpolation::cells`] is the overlap `Ω_O`; only
/// [`NoMediator`] has none.
pub trait Mediator<T: Real>: Interpolation<T> {
    /// Characteristic length `h_B` \[m\].
    fn spacing(&self) -> T;
}

/// Mediator of an interface that ties nothing, since no place belongs to both models: one of them sleeps
/// everywhere, such as a zone that begins empty until [`Coupled::rezone`](crate::Coupled::rezone) gives it an
/// overlap, or a body of several pieces has each piece in one model.
#[derive(Debug, Clone, Copy)]
pub struct NoMediator;

impl<T: Real> Interpolation<T> for NoMediator {
    fn nodes(&self) -> &[Point3<T>] {
        &[]
    }

    fn shape_at(&self, x: &Point3<T>, _gradient: bool, _row: &mut ShapeRow<T>) -> Result<()> {
        Err(outside(x, "mediator without nodes"))
    }
}

impl<T: Real> Mediator<T> for NoMediator {
    fn spacing(&self) -> T {
        T::zero()
    }
}

//! The mediator space: where the Lagrange multipliers live.

use crate::Real;
use crate::field::Interpolation;

/// The discrete space of the multipliers, on nodes of its own that fill the overlap.
///
/// Its spacing may be coarse (`h_B ≈ h_C`), fine (`h_B ≈ h_D`) or anything between. Its nodes need not
/// coincide with those of a model. [`Interpolation::cells`] must not be empty: the union of the cells is the
/// overlap `Ω_O`.
pub trait Mediator<T: Real>: Interpolation<T> {
    /// Characteristic length `h_B` \[m\].
    fn spacing(&self) -> T;
}

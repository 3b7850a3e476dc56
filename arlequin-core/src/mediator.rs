//! The mediator space: where the Lagrange multipliers live.

use crate::Real;
use crate::field::Interpolation;

/// The discrete multiplier space on nodes of its own that fill the overlap.
///
/// Coarse (`h_B ≈ h_C`), fine (`h_B ≈ h_D`) or anything between; its nodes coincide with nothing in general.
/// [`Interpolation::cells`] must not be empty: their union is the overlap `Ω_O`.
pub trait Mediator<T: Real>: Interpolation<T> {
    /// Characteristic length `h_B` \[m\].
    fn spacing(&self) -> T;
}

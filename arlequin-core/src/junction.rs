//! Junction models: the scalar product in which the velocity jump is made to vanish.
//!
//! `⟨λ, v⟩ = ∫ η₁ λ·v + η₂ l² ε(λ):ε(v) dΩ`, or with full gradients `∇λ:∇v` in place of strains.

use crate::error::invalid;
use crate::{Real, Result};
use nalgebra::{Matrix3, Vector3};

/// Value and gradient of one shape function at a point.
#[derive(Debug, Clone, Copy)]
pub struct Shape<T: Real> {
    /// Value \[–\].
    pub value: T,
    /// Gradient \[1/m\]; zero where the junction does not ask for it.
    pub gradient: Vector3<T>,
}

/// A scalar product between two vector fields.
pub trait Junction<T: Real>: Send + Sync {
    /// Density of `⟨N_row e_a, N_col e_b⟩` as a matrix over the components `a`, `b`.
    fn block(&self, row: &Shape<T>, col: &Shape<T>) -> Matrix3<T>;

    /// Whether gradients are used.
    fn needs_gradient(&self) -> bool;

    /// Whether every block is a multiple of the identity: the components then decouple, with a third of the unknowns.
    fn splits(&self) -> bool;

    /// Whether constant fields have zero norm: one point per component must then be pinned.
    fn is_seminorm(&self) -> bool {
        false
    }

    /// Whether the multiplier operator may be lumped to its diagonal. Lumping an H1 junction diverges.
    fn may_lump(&self) -> bool {
        false
    }

    /// Name for messages and reports.
    fn name(&self) -> &'static str;
}

/// `∫ λ·v`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct L2;

impl<T: Real> Junction<T> for L2 {
    fn block(&self, row: &Shape<T>, col: &Shape<T>) -> Matrix3<T> {
        Matrix3::from_diagonal_element(row.value * col.value)
    }
    fn needs_gradient(&self) -> bool {
        false
    }
    fn splits(&self) -> bool {
        true
    }
    fn may_lump(&self) -> bool {
        true
    }
    fn name(&self) -> &'static str {
        "L2"
    }
}

fn check_length<T: Real>(length: T) -> Result<T> {
    if length.is_finite() && length >= T::zero() {
        Ok(length)
    } else {
        Err(invalid(
            "junction length",
            length,
            "must be finite and not negative",
        ))
    }
}

/// `∫ λ·v + l² ε(λ):ε(v)`, the junction of the literature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct H1Strain<T>(T);

impl<T: Real> H1Strain<T> {
    /// Junction with length `l` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a negative or non-finite length.
    pub fn new(length: T) -> Result<Self> {
        check_length(length).map(Self)
    }
}

impl<T: Real> Junction<T> for H1Strain<T> {
    fn block(&self, row: &Shape<T>, col: &Shape<T>) -> Matrix3<T> {
        // ε(N_i e_a) : ε(N_j e_b) = ½ (δ_ab ∇N_i·∇N_j + ∂_b N_i ∂_a N_j)
        let (gi, gj) = (&row.gradient, &col.gradient);
        let strain = (Matrix3::from_diagonal_element(gi.dot(gj)) + gj * gi.transpose()) * T::of(0.5);
        Matrix3::from_diagonal_element(row.value * col.value) + strain * (self.0 * self.0)
    }
    fn needs_gradient(&self) -> bool {
        true
    }
    fn splits(&self) -> bool {
        false
    }
    fn name(&self) -> &'static str {
        "H1 (strain)"
    }
}

/// `∫ λ·v + l² ∇λ:∇v`: splits into components, angular momentum is still exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct H1Gradient<T>(T);

impl<T: Real> H1Gradient<T> {
    /// Junction with length `l` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a negative or non-finite length.
    pub fn new(length: T) -> Result<Self> {
        check_length(length).map(Self)
    }
}

impl<T: Real> Junction<T> for H1Gradient<T> {
    fn block(&self, row: &Shape<T>, col: &Shape<T>) -> Matrix3<T> {
        let gradient = row.gradient.dot(&col.gradient) * self.0 * self.0;
        Matrix3::from_diagonal_element(row.value * col.value + gradient)
    }
    fn needs_gradient(&self) -> bool {
        true
    }
    fn splits(&self) -> bool {
        true
    }
    fn name(&self) -> &'static str {
        "H1 (gradient)"
    }
}

/// `∫ l² ∇λ:∇v`: ties gradients only. Needs a pinned point per component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct H1Seminorm<T>(T);

impl<T: Real> H1Seminorm<T> {
    /// Junction with length `l > 0` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a length that is not positive and finite.
    pub fn new(length: T) -> Result<Self> {
        if length > T::zero() {
            check_length(length).map(Self)
        } else {
            Err(invalid(
                "junction length",
                length,
                "must be positive for the H1 seminorm",
            ))
        }
    }
}

impl<T: Real> Junction<T> for H1Seminorm<T> {
    fn block(&self, row: &Shape<T>, col: &Shape<T>) -> Matrix3<T> {
        Matrix3::from_diagonal_element(row.gradient.dot(&col.gradient) * self.0 * self.0)
    }
    fn needs_gradient(&self) -> bool {
        true
    }
    fn splits(&self) -> bool {
        true
    }
    fn is_seminorm(&self) -> bool {
        true
    }
    fn name(&self) -> &'static str {
        "H1 seminorm"
    }
}

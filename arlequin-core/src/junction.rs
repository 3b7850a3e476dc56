//! Junction models: the scalar product in which the velocity jump is made to vanish.
//!
//! `⟨λ, v⟩ = ∫ η₁ λ·v + η₂ l² ε(λ):ε(v) dΩ`, or with full gradients `∇λ:∇v` in place of strains.

use crate::error::{invalid, not_negative};
use crate::named::named;
use crate::{Real, Result};
use nalgebra::{Matrix3, Point3, Vector3};

/// Value and gradient of one shape function at a point.
#[derive(Debug, Clone, Copy)]
pub struct ShapeFunction<T: Real> {
    /// Value \[–\].
    pub value: T,
    /// Gradient \[1/m\]; zero where the junction does not ask for it.
    pub gradient: Vector3<T>,
}

/// Values or gradients that a junction takes from the fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Values only. The product may be lumped to its diagonal.
    Values,
    /// Values and gradients. Lumping the product diverges.
    ValuesAndGradients,
    /// Gradients only: constant fields have zero norm, so one point per component is pinned.
    Gradients,
}

impl Needs {
    /// Returns whether gradients are evaluated.
    pub fn gradients(self) -> bool {
        self != Self::Values
    }
}

/// How a junction combines the components of the two vector fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Components {
    /// Every component with itself only. Each block is a multiple of the identity, and one operator for a
    /// single component serves all of them.
    Separate,
    /// Every component with every other; right for any junction.
    Mixed,
}

/// A scalar product between two vector fields: symmetric and positive. Evaluated twice, it must return the
/// same value.
pub trait Junction<T: Real>: Send + Sync {
    /// Name for messages and reports.
    fn name(&self) -> &'static str;

    /// Values or gradients that the junction takes from the fields.
    fn needs(&self) -> Needs;

    /// How the junction combines components.
    fn components(&self) -> Components {
        Components::Mixed
    }

    /// Density of `⟨N_row e_a, N_col e_b⟩` at the point `x` \[m\], as a matrix over the components `a`, `b`.
    fn block(&self, x: &Point3<T>, row: &ShapeFunction<T>, col: &ShapeFunction<T>) -> Matrix3<T>;

    /// `[a, b]` if the density at `x` is `a N_row N_col + b ∇N_row·∇N_col` for every component; `None` for
    /// any other density. Must agree with [`Self::block`], and saves one call per pair of shape functions.
    fn coefficients(&self, _: &Point3<T>) -> Option<[T; 2]> {
        None
    }
}

/// `∫ λ·v`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct L2;

impl<T: Real> Junction<T> for L2 {
    fn name(&self) -> &'static str {
        "L2"
    }
    fn needs(&self) -> Needs {
        Needs::Values
    }
    fn components(&self) -> Components {
        Components::Separate
    }
    fn block(&self, _: &Point3<T>, row: &ShapeFunction<T>, col: &ShapeFunction<T>) -> Matrix3<T> {
        Matrix3::from_diagonal_element(row.value * col.value)
    }
    fn coefficients(&self, _: &Point3<T>) -> Option<[T; 2]> {
        Some([T::one(), T::zero()])
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
        not_negative("junction length", length).map(Self)
    }
}

impl<T: Real> Junction<T> for H1Strain<T> {
    fn name(&self) -> &'static str {
        "H1 (strain)"
    }
    fn needs(&self) -> Needs {
        Needs::ValuesAndGradients
    }
    fn block(&self, _: &Point3<T>, row: &ShapeFunction<T>, col: &ShapeFunction<T>) -> Matrix3<T> {
        // ε(N_i e_a) : ε(N_j e_b) = ½ (δ_ab ∇N_i·∇N_j + ∂_b N_i ∂_a N_j)
        let (gi, gj) = (&row.gradient, &col.gradient);
        let strain = (Matrix3::from_diagonal_element(gi.dot(gj)) + gj * gi.transpose()) * T::of(0.5);
        Matrix3::from_diagonal_element(row.value * col.value) + strain * (self.0 * self.0)
    }
}

/// `∫ λ·v + l² ∇λ:∇v`: the components decouple, and angular momentum is still exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct H1Gradient<T>(T);

impl<T: Real> H1Gradient<T> {
    /// Junction with length `l` \[m\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a negative or non-finite length.
    pub fn new(length: T) -> Result<Self> {
        not_negative("junction length", length).map(Self)
    }
}

impl<T: Real> Junction<T> for H1Gradient<T> {
    fn name(&self) -> &'static str {
        "H1 (gradient)"
    }
    fn needs(&self) -> Needs {
        Needs::ValuesAndGradients
    }
    fn components(&self) -> Components {
        Components::Separate
    }
    fn block(&self, _: &Point3<T>, row: &ShapeFunction<T>, col: &ShapeFunction<T>) -> Matrix3<T> {
        let gradient = row.gradient.dot(&col.gradient) * self.0 * self.0;
        Matrix3::from_diagonal_element(row.value * col.value + gradient)
    }
    fn coefficients(&self, _: &Point3<T>) -> Option<[T; 2]> {
        Some([T::one(), self.0 * self.0])
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
        // At zero length nothing would be tied; the other H1 junctions become L2 there.
        if length > T::zero() {
            not_negative("junction length", length).map(Self)
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
    fn name(&self) -> &'static str {
        "H1 seminorm"
    }
    fn needs(&self) -> Needs {
        Needs::Gradients
    }
    fn components(&self) -> Components {
        Components::Separate
    }
    fn block(&self, _: &Point3<T>, row: &ShapeFunction<T>, col: &ShapeFunction<T>) -> Matrix3<T> {
        Matrix3::from_diagonal_element(row.gradient.dot(&col.gradient) * self.0 * self.0)
    }
    fn coefficients(&self, _: &Point3<T>) -> Option<[T; 2]> {
        Some([T::zero(), self.0 * self.0])
    }
}

/// Junctions that have a name in scenes and reports.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum JunctionKind {
    /// [`L2`]: no length to choose, components decouple; hence the default.
    #[default]
    L2,
    /// [`H1Strain`].
    H1Strain,
    /// [`H1Gradient`].
    H1Gradient,
    /// [`H1Seminorm`].
    H1Seminorm,
}

named!(JunctionKind, "junction":
    L2 = "l2",
    H1Strain = "h1-strain",
    H1Gradient = "h1-gradient",
    H1Seminorm = "h1-seminorm",
);

impl JunctionKind {
    /// Returns whether the junction has a length to choose.
    pub fn has_length(self) -> bool {
        self != Self::L2
    }

    /// Creates the junction of this kind with the length `l` \[m\], which [`L2`] ignores.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a length that the junction refuses.
    pub fn junction<T: Real>(self, length: T) -> Result<Box<dyn Junction<T>>> {
        Ok(match self {
            Self::L2 => Box::new(L2),
            Self::H1Strain => Box::new(H1Strain::new(length)?),
            Self::H1Gradient => Box::new(H1Gradient::new(length)?),
            Self::H1Seminorm => Box::new(H1Seminorm::new(length)?),
        })
    }
}

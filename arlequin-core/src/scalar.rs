//! The one scalar bound of the workspace, and access to the direct solvers.

use crate::linalg::{self, DenseEigen, SpdFactor, SquareFactor};
use crate::{Error, Result};
use nalgebra::Point3;
use sprs::CsMat;

/// Real numbers the workspace computes with; implemented for `f32` and `f64` only.
///
/// The factorisations are methods of the scalar, so that the solver library is instantiated once per type in
/// this crate and appears in no public bound.
pub trait Real:
    nalgebra::RealField
    + sprs::MulAcc
    + num_traits::FromPrimitive
    + num_traits::ToPrimitive
    + Copy
    + Default
    + std::iter::Sum
    + Send
    + Sync
    + 'static
{
    /// Converts a literal in generic code.
    fn of(x: f64) -> Self;

    /// The value as `f64`, for messages and reports.
    fn as_f64(self) -> f64;

    /// Distance between one and the next larger number.
    fn epsilon() -> Self;

    /// Sparse Cholesky factor of a symmetric positive definite matrix (both triangles stored). With the
    /// place of each unknown \[m\], the order of elimination follows from nested dissection of the places,
    /// which makes factors of solids several times cheaper. Places of another number than unknowns are
    /// ignored.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] with the pivot at which the factorisation broke down.
    fn cholesky(matrix: &CsMat<Self>, places: Option<&[Point3<Self>]>) -> Result<Box<dyn SpdFactor<Self>>>;

    /// Factor `L D Lᵀ` without pivoting of a symmetric matrix (both triangles stored) with a positive and a
    /// negative definite diagonal block, in the order of [`Self::cholesky`]. `None` unless exactly `positive`
    /// pivots are positive, each at least `least`.
    fn quasi_definite(
        matrix: &CsMat<Self>,
        places: &[Point3<Self>],
        positive: usize,
        least: Self,
    ) -> Option<Box<dyn SpdFactor<Self>>>;

    /// Number of entries that the Cholesky factor will have.
    fn cholesky_entries(matrix: &CsMat<Self>) -> usize;

    /// Rows of a symmetric matrix (both triangles stored) whose pivots are negative once `shift` is
    /// subtracted from the diagonal. Their number is that of the eigenvalues below `shift`. `None` if the
    /// factorisation breaks down.
    fn negative_pivots(matrix: &CsMat<Self>, shift: Self) -> Option<Vec<usize>>;

    /// Factors a dense positive semidefinite matrix by Cholesky's method with complete pivoting. The matrix
    /// is `n × n`, column major; its lower triangle is overwritten with the factor. Returns the order of the
    /// rows and the rank: the method ends where pivots are round-off. `None` if the diagonal has a negative
    /// number or a NaN.
    fn pivoted_cholesky(n: usize, column_major: &mut [Self]) -> Option<(Vec<usize>, usize)>;

    /// Sparse LU factor with partial pivoting, for the indefinite systems of the static twin.
    ///
    /// # Errors
    /// [`Error::SingularSystem`] where a pivot vanishes.
    fn lu(matrix: &CsMat<Self>) -> Result<Box<dyn SquareFactor<Self>>>;

    /// Eigenvalues (ascending) and vectors of a dense symmetric matrix, column major, `n × n`.
    ///
    /// # Errors
    /// [`Error::SingularSystem`] if the iteration does not converge (non-finite input).
    fn symmetric_eigen(n: usize, column_major: &[Self]) -> Result<DenseEigen<Self>>;
}

macro_rules! real {
    ($t:ty) => {
        impl Real for $t {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::allow_attributes_without_reason,
                reason = "literals are meant to round to the working precision"
            )]
            fn of(x: f64) -> Self {
                x as Self
            }
            fn as_f64(self) -> f64 {
                f64::from(self)
            }
            fn epsilon() -> Self {
                Self::EPSILON
            }
            fn cholesky(
                matrix: &CsMat<Self>,
                places: Option<&[Point3<Self>]>,
            ) -> Result<Box<dyn SpdFactor<Self>>> {
                linalg::cholesky(matrix, places)
            }
            fn quasi_definite(
                matrix: &CsMat<Self>,
                places: &[Point3<Self>],
                positive: usize,
                least: Self,
            ) -> Option<Box<dyn SpdFactor<Self>>> {
                linalg::quasi_definite(matrix, places, positive, least)
            }
            fn cholesky_entries(matrix: &CsMat<Self>) -> usize {
                linalg::cholesky_entries(matrix)
            }
            fn negative_pivots(matrix: &CsMat<Self>, shift: Self) -> Option<Vec<usize>> {
                linalg::negative_pivots(matrix, shift)
            }
            fn pivoted_cholesky(n: usize, column_major: &mut [Self]) -> Option<(Vec<usize>, usize)> {
                linalg::pivoted_cholesky(n, column_major)
            }
            fn lu(matrix: &CsMat<Self>) -> Result<Box<dyn SquareFactor<Self>>> {
                linalg::lu(matrix)
            }
            fn symmetric_eigen(n: usize, column_major: &[Self]) -> Result<DenseEigen<Self>> {
                linalg::symmetric_eigen(n, column_major)
            }
        }
    };
}

real!(f32);
real!(f64);

/// Checks that every number is finite.
///
/// # Errors
/// [`Error::NotFinite`], naming `what` and the index of the first number that is not finite.
pub fn check_finite<T: Real>(what: &str, values: &[T]) -> Result<()> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NotFinite {
            what: what.to_owned(),
            index,
        }),
    }
}

/// Scalar product `Σ a_i b_i`, summed in the order of the unknowns.
pub(crate) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |s, (x, y)| s + *x * *y)
}

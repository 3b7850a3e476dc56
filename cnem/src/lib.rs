//! Constrained natural element method in three dimensions: geometry and shape functions.
//!
//! - [`delaunay`]: exact Delaunay tetrahedralisation.
//! - [`predicates`]: the exact signs behind it.
//!
//! Lengths in metres, coordinates in double precision.

pub mod delaunay;
pub mod error;
mod hilbert;
pub mod predicates;
pub(crate) mod tet;

pub use error::{Error, Result};

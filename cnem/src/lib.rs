//! Constrained natural element method in three dimensions: geometry and shape functions.
//!
//! - [`delaunay`]: exact Delaunay tetrahedralisation.
//! - [`predicates`]: the exact signs behind it.
//!
//! Lengths in metres, coordinates in double precision.

pub(crate) mod bins;
pub(crate) mod circumcentre;
pub(crate) mod clip;
pub mod constraint;
pub mod delaunay;
pub mod domain;
pub mod error;
mod hilbert;
pub mod natural;
pub mod predicates;
pub(crate) mod tet;
pub mod voronoi;

pub use error::{Error, Result};

//! Constrained natural element method in three dimensions: a Galerkin method on free nodes.
//!
//! From nodes and a boundary surface to shape functions, integration cells and a model:
//!
//! - [`delaunay`]: Delaunay tetrahedralisation with exact [`predicates`], for any set of distinct nodes;
//! - [`constraint`]: boundary and crack faces, and their recovery in the complex;
//! - [`domain`]: what is inside; the object everything else is asked from;
//! - [`natural`]: Sibson and Laplace shape functions with the visibility criterion;
//! - [`voronoi`]: the cells of the nodes, cut off at the constrained faces;
//! - [`scni`]: stabilised conforming nodal integration on these cells;
//! - [`CnemModel`]: linear elastodynamics, for both roles of a coupling;
//! - [`NaturalField`], [`CnemMediator`]: fields and multiplier spaces on any points, also those of particles.
//!
//! ```
//! use cnem::constraint::Surface;
//! use cnem::domain::Domain;
//! use cnem::natural::{Kind, Scratch};
//! use nalgebra::Point3;
//!
//! let grid: Vec<_> =
//!     (0..27).map(|i| Point3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9))).collect();
//! let domain = Domain::new(&grid, &Surface::convex_hull())?;
//!
//! // One scratch per thread; the row is valid until the next evaluation.
//! let mut scratch = Scratch::new();
//! let row = domain.shape_with_gradients(Kind::Sibson, &Point3::new(0.3, 0.9, 1.2), &mut scratch)?;
//! let x: f64 = row.nodes.iter().zip(&row.values).map(|(&v, w)| w * grid[v].x).sum();
//! assert!((x - 0.3).abs() < 1e-14);
//!
//! // Integration cells: volumes, and facets with area vector and centroid.
//! let cells = domain.voronoi()?;
//! assert!((cells.volumes()[13] - 1.0).abs() < 1e-14);
//! # Ok::<(), cnem::Error>(())
//! ```
//!
//! Lengths in metres, coordinates in double precision, reference configuration.

pub(crate) mod bins;
pub(crate) mod circumcentre;
pub(crate) mod clip;
pub mod constraint;
pub mod delaunay;
pub mod domain;
pub mod error;
mod field;
pub mod generate;
mod hilbert;
mod material;
mod model;
pub mod natural;
pub mod predicates;
pub mod scni;
pub(crate) mod tet;
pub mod voronoi;

pub use error::{Error, Result};
pub use field::{CnemMediator, NaturalField};
pub use material::Elastic;
pub use model::{CnemModel, Options};
pub use scni::Stabilisation;

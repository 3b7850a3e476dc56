//! Constrained natural element method in three dimensions: a Galerkin method on free nodes.
//!
//! From nodes and a boundary surface to shape functions, integration cells and a model:
//!
//! - [`delaunay`]: Delaunay tetrahedralisation with exact [`predicates`], for any set of distinct nodes;
//! - [`constraint`]: boundary and crack faces, and their recovery in the complex;
//! - [`domain`]: which tetrahedra are inside; every query starts from a [`Domain`];
//! - [`crack`]: nodes on a crack, copied so that each lip has its own unknowns;
//! - [`natural`]: Sibson and Laplace shape functions with the visibility criterion;
//! - [`voronoi`]: the cells of the nodes, cut off at the constrained faces;
//! - [`scni`]: stabilised conforming nodal integration on these cells;
//! - [`CnemModel`]: linear elastodynamics, as the coarse or the fine model of a coupling;
//! - [`NaturalField`]: interpolation and multiplier spaces on any set of points, also on the centres of
//!   particles.
//!
//! ```
//! use cnem::constraint::Surface;
//! use cnem::domain::Domain;
//! use cnem::natural::{Interpolant, Scratch};
//! use nalgebra::Point3;
//!
//! let grid: Vec<_> =
//!     (0..27).map(|i| Point3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9))).collect();
//! let domain = Domain::new(&grid, &Surface::convex_hull())?;
//!
//! // One scratch per thread; the row is valid until the next evaluation.
//! let mut scratch = Scratch::new();
//! let row = domain.shape_with_gradients(Interpolant::Sibson, &Point3::new(0.3, 0.9, 1.2), &mut scratch)?;
//! let x: f64 = row.nodes.iter().zip(&row.values).map(|(&v, w)| w * grid[v].x).sum();
//! assert!((x - 0.3).abs() < 1e-14);
//!
//! // Integration cells: volumes, and facets with area vector and centroid.
//! let cells = domain.voronoi()?;
//! assert!((cells.volumes()[13] - 1.0).abs() < 1e-14);
//! # Ok::<(), cnem::Error>(())
//! ```
//!
//! A cantilever pulled at its end:
//!
//! ```
//! use arlequin_core::{Real, LinearModel, Model};
//! use cnem::{CnemModel, Elastic, Options, generate::Cylinder};
//!
//! let domain = Cylinder::with_spacing([0.0, 20e-3], 1e-3, 0.5e-3)?.domain()?;
//! let beam = CnemModel::new("beam", domain, Elastic::new(72.5e9, 0.17, 2200.0)?, Options::default())?;
//! let clamped = beam.select_nodes(|x| x.x == 0.0)?;
//! let pulled = beam.surface(|f| f.centroid.x > 19.99e-3)?;
//!
//! let mut u = vec![0.0; beam.layout().dofs()];
//! let area: f64 = pulled.iter().map(|f| f.area()).sum();
//! for facet in &pulled {
//!     for (node, share) in facet.nodes.iter().zip(&facet.shares) {
//!         u[3 * node] += 1000.0 * share / area;
//!     }
//! }
//! // A stiff spring on every clamped unknown stands for the support.
//! let mut support = arlequin_core::sprs::TriMat::new((u.len(), u.len()));
//! for dof in clamped.iter().flat_map(|n| 3 * n..3 * n + 3) {
//!     support.add_triplet(dof, dof, 1e16);
//! }
//! f64::cholesky(&(&beam.stiffness() + &support.to_csr()), None)?.solve(&mut u);
//! assert!((u[3 * pulled[0].nodes[0]] / 0.08775e-3 - 1.0).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Lengths in metres, coordinates in double precision, reference configuration.

pub(crate) mod bins;
pub(crate) mod circumcentre;
pub(crate) mod clip;
pub mod constraint;
pub mod crack;
pub mod delaunay;
pub mod domain;
pub mod error;
mod field;
pub mod generate;
mod hilbert;
mod inertia;
mod model;
pub mod natural;
mod portion;
pub mod predicates;
pub mod scni;
mod stress;
pub(crate) mod tet;
pub mod voronoi;

pub use arlequin_core::Elastic;
pub use constraint::Surface;
pub use domain::Domain;
pub use error::{Error, Result};
pub use field::NaturalField;
pub use hilbert::spatial_order;
pub use inertia::Inertia;
pub use model::{CnemModel, Options};
pub use scni::Stabilisation;

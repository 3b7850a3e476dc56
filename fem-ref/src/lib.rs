//! Linear finite elements: the reference continuum model of the Arlequin workspace.
//!
//! Small-strain isotropic elastodynamics `M q̈ = F − K q` on bars, tetrahedra and hexahedra of first order
//! with lumped mass, small enough to trust by reading. It leaves out elements of higher order, several
//! element kinds in one mesh, and cures of shear locking: a thin beam in bending needs at least four
//! hexahedra across.
//!
//! ```
//! use arlequin_core::{LinearModel, Model};
//! use arlequin_core::Real;
//! use fem_ref::{Elastic, ElementKind, FemModel, generate::{self, Cylinder}};
//!
//! // A silica beam of 20 mm by 2 mm is clamped at x = 0 and pulled by 1 kN at its other end.
//! let shape = Cylinder::with_size([0.0, 20e-3], 1e-3, 0.5e-3)?;
//! let mesh = generate::cylinder(ElementKind::Hex8, &shape)?;
//! let (clamped, pulled) = (mesh.group_nodes("x-min")?, mesh.surface("x-max")?);
//! let model = FemModel::new("beam", mesh, Elastic::new(72.5e9, 0.17, 2200.0)?)?;
//!
//! let mut u = vec![0.0; model.layout().dofs()];
//! let area: f64 = pulled.iter().map(|f| f.area()).sum();
//! for facet in &pulled {
//!     for (node, share) in facet.nodes.iter().zip(&facet.shares) {
//!         u[3 * node] += 1000.0 * share / area;
//!     }
//! }
//! // A stiff spring on every clamped unknown acts as support.
//! let mut support = arlequin_core::sprs::TriMat::new((u.len(), u.len()));
//! for dof in clamped.iter().flat_map(|n| 3 * n..3 * n + 3) {
//!     support.add_triplet(dof, dof, 1e16);
//! }
//! f64::cholesky(&(&model.stiffness() + &support.to_csr()), None)?.solve(&mut u);
//! let tip = pulled[0].nodes[0];
//! assert!((u[3 * tip] / 0.08775e-3 - 1.0).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod check;
mod crack;
mod element;
pub mod error;
mod field;
pub mod generate;
pub mod gmsh;
mod kernel;
mod mesh;
mod model;
mod order;
mod part;
mod pieces;
mod portion;
mod recovery;
mod slit;

pub use arlequin_core::Elastic;
pub use element::{ElementKind, GaussPoint};
pub use error::{Error, Result};
pub use field::FemField;
pub use mesh::{Facet, Group, Mesh};
pub use model::FemModel;
pub use pieces::{MeshPiece, list_pieces};

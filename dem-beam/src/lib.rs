//! Cohesive-beam discrete elements: spheres with mass and rotational inertia, joined to their
//! neighbours by elastic Euler-Bernoulli beams of circular section.
//!
//! The elasticity of a packing follows from its beams, with nothing fitted: beams of 265e9 Pa, Poisson's
//! ratio 0.3 and radius 0.71 of the mean particle radius, in a jammed packing with 6.2 bonds per particle,
//! give E = 75e9 Pa and nu = 0.17.
//!
//! ```
//! use arlequin_core::{Coupled, Subdomain, TimeStep, Weights, Silent};
//! use dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
//!
//! // 1. Pack a bar (the quench variant: fast, for examples and tests).
//! let bar = Container::cylinder(4e-3, 1e-3)?;
//! let packing = PackingSpec::quench(bar, 500, 1).build()?;
//! // 2. Join the spheres by beams and give them mass.
//! let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)?;
//! // 3. Let it move, here on its own.
//! let bar = Subdomain::fine(model, Weights::uncoupled());
//! let mut run = Coupled::new(vec![bar], Vec::new(), TimeStep::Fraction(0.8), None)?;
//! run.run(10, &mut Silent)?;
//! assert!(run.energy() == 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what |
//! |---|---|
//! | [`packing`] | random jammed packings in bodies and periodic boxes, lattices, files, disk cache |
//! | [`bond`], [`finite`] | the linear and the finite-rotation law of one bond, as plain reference code |
//! | [`particles`] | flat arrays: bonds, stiffness, masses, weights |
//! | [`kernel`] | the forces of the bonds, SIMD chosen at run time, any number of threads |
//! | [`model`] | [`DemModel`], which implements the coupling traits: weights, supports, loads |
//! | [`fracture`] | bonds that break |
//! | [`contact`], [`obstacle`] | contact between unbonded particles, and with rigid bodies |
//! | [`critical`] | the critical time step |
//! | [`statics`], [`calibrate`], [`homogenise`] | equilibrium; E and nu of bars and bulk; calibration |
//! | [`strength`] | bars pulled until they break |
//!
//! Left out: the motion of periodic bodies. Gravity and dampings are effects of the core. Results are
//! bit-identical for any number of threads on one machine; between instruction sets the last bits may differ.
//!
//! Features, both on by default: `stl` reads surfaces from STL files, `vtu` reads VTU files and spheres
//! from them.

pub mod bond;
pub mod calibrate;
pub mod contact;
pub mod critical;
pub mod error;
pub mod finite;
pub mod fracture;
pub mod homogenise;
pub mod kernel;
pub mod model;
mod numbered;
pub mod obstacle;
pub mod packing;
pub mod particles;
mod specimen;
pub mod statics;
pub mod strength;
pub mod toughness;
#[cfg(feature = "vtu")]
pub mod vtu;

pub use arlequin_core::contact::{Motion, RigidShape, Twist};
pub use bond::{BeamMaterial, BeamRigidity, LinearBond};
pub use contact::{Contact, ContactBetween, ContactBody, ContactLaw};
pub use error::{Error, Result};
pub use fracture::{Criterion, Fracture, Scatter};
pub use model::{DemModel, DemReport, LoadShare, TOUCH};
pub use obstacle::Obstacle;
pub use packing::{Compaction, Container, Packing, PackingReport, PackingSpec, Surface};
pub use particles::{BondedParticles, Matter};
pub use statics::Held;

//! Cohesive-beam discrete elements: spheres with mass and rotational inertia, joined to their
//! neighbours by elastic Euler-Bernoulli beams of circular section.
//!
//! A packing made here has the elasticity of the material by itself: beams of 265e9 Pa, Poisson's
//! ratio 0.3 and radius 0.71 of the mean particle radius in a jammed packing with 6.2 bonds per
//! particle give E = 75e9 Pa and nu = 0.17, with nothing fitted.
//!
//! ```
//! use dem_beam::{BeamDynamics, BeamMaterial, Container, PackingSpec, critical};
//!
//! // 1. Pack a bar (the quench variant: fast, for examples and tests).
//! let bar = Container::cylinder(4e-3, 1e-3)?;
//! let packing = PackingSpec::quench(bar, 500, 1).build()?;
//! // 2. Join the spheres by beams and give them mass.
//! let body = packing.bonded(BeamMaterial::SILICA, 2200.0)?;
//! // 3. Let it move at a safe step.
//! let step = critical::block_bound(&body)?;
//! let mut motion = BeamDynamics::<f64>::linear(&body, step)?;
//! motion.run(10);
//! assert!(motion.kinetic_energy() == 0.0);
//! # Ok::<(), dem_beam::DemError>(())
//! ```
//!
//! | module | what |
//! |---|---|
//! | [`packing`] | random jammed packings in bodies and periodic boxes, lattices, files, disk cache |
//! | [`bond`], [`finite`] | the two laws of one bond, in plain form |
//! | [`particles`] | flat arrays: bonds, stiffness, masses, weights |
//! | [`kernel`] | the whole velocity-Verlet step, SIMD chosen at run time, any number of threads |
//! | [`model`] | the body behind the coupling traits: weights, supports, loads |
//! | [`fracture`] | bonds that break |
//! | [`contact`], [`obstacle`] | contact between unbonded particles, and with rigid bodies |
//! | [`critical`] | the critical time step |
//! | [`statics`], [`calibrate`], [`homogenise`] | equilibrium, E and nu of bars and of the bulk, the inverse |
//! | [`strength`] | bars pulled until they break |
//!
//! Left out: contact between two bodies, and the motion of periodic bodies. Gravity and dampings
//! are effects of the core. Results are bit-identical for any number of threads on one machine;
//! between instruction sets the last bits may differ.
//!
//! Features, both on by default: `stl` reads surfaces from STL, `vtu` spheres from VTU files.

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
pub mod obstacle;
pub mod packing;
pub mod particles;
pub mod statics;
pub mod strength;

pub use bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
pub use contact::{Contact, ContactBetween, ContactBody, ContactLaw};
pub use error::{DemError, Result};
pub use fracture::{Criterion, Fracture, Scatter};
pub use kernel::{BeamDynamics, Held};
pub use model::{DemModel, DemReport, LoadShare};
pub use obstacle::{Motion, Obstacle, Shape};
pub use packing::{Compaction, Container, Packing, PackingReport, PackingSpec, Surface};
pub use particles::{BondedParticles, Matter};

//! Cohesive-beam discrete elements: spheres joined by Euler-Bernoulli beams.

pub mod bond;
pub mod calibrate;
pub mod critical;
pub mod error;
pub mod finite;
pub mod kernel;
pub mod packing;
pub mod particles;
pub mod statics;

pub use bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
pub use error::{DemError, Result};
pub use kernel::{BeamDynamics, Held};
pub use packing::{Compaction, Container, Packing, PackingReport, PackingSpec, Surface};
pub use particles::{BondedParticles, Matter};

//! Cohesive-beam discrete elements: spheres joined by Euler-Bernoulli beams.

pub mod bond;
pub mod error;
pub mod particles;

pub use bond::{BeamMaterial, BeamRigidity, LinearBond, Twist};
pub use error::{DemError, Result};
pub use particles::{BondedParticles, Matter};

//! The fast kernel: a whole velocity-Verlet step, gather only, eight particles at a time.

pub mod dynamics;
pub(crate) mod engine;
pub(crate) mod lanes;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes_x86;
pub(crate) mod law;
pub(crate) mod layout;
pub mod order;
pub(crate) mod screen;
pub(crate) mod turn;

pub use dynamics::{BeamDynamics, Held};

//! The fast kernel: computes the bond forces of eight particles at a time.

pub(crate) mod engine;
pub(crate) mod lanes;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes_x86;
pub(crate) mod law;
pub(crate) mod layout;
pub mod order;
pub(crate) mod screen;
pub(crate) mod span;
pub(crate) mod stride;
pub(crate) mod turn;
pub(crate) mod visit;

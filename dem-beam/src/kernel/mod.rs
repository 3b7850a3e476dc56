//! The fast kernel.

pub mod order;

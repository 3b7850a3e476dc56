//! The method: traits of models, fields, weights, mediators and junctions, and the algorithms that couple them.
//!
//! The core does not know what a particle, an element or a Voronoi cell is; it has no input or output, no clock, no
//! random numbers and no threads of its own.

pub mod effect;
pub mod error;
pub mod field;
pub mod geometry;
pub mod junction;
pub mod linalg;
pub mod mediator;
pub mod model;
pub mod overlap;
pub mod scalar;
pub mod spectrum;
pub mod time;
pub mod weight;

pub use error::{Error, Result};
pub use scalar::Real;
pub use {nalgebra, sprs};

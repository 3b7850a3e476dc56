//! The method: traits of models, fields, weights, mediators and junctions, and the algorithms that couple them.
//!
//! The core does not know what a particle, an element or a Voronoi cell is; it has no input or output, no clock and no
//! random numbers. Its loops over unknowns run on the caller's rayon pool, see [`parallel`].

pub mod adjacency;
pub mod advice;
pub mod blocks;
pub mod conformance;
pub mod coupled;
pub mod effect;
pub mod error;
mod extent;
pub mod field;
pub mod geometry;
pub mod harmonic;
pub mod interface;
pub mod junction;
pub mod ledger;
pub mod linalg;
pub mod material;
mod measure;
pub mod mediator;
pub mod model;
pub mod momentum;
mod motion;
mod named;
mod nodal;
pub mod observer;
pub mod overlap;
pub mod parallel;
mod profile;
mod reach;
pub mod scalar;
pub mod snapshot;
pub mod spectrum;
pub mod subdomain;
pub mod time;
mod tree;
pub mod weight;

pub use coupled::{Coupled, Guard, Partition, TimeStep};
pub use error::{Error, Result};
pub use interface::{InterfaceOptions, InterfaceSpec, Sampling};
pub use model::{CoarseModel, FineModel, LinearModel, Model};
pub use nodal::NodallyWeighted;
pub use scalar::Real;
pub use subdomain::Subdomain;
pub use weight::{Weighting, Weights};
pub use {nalgebra, sprs};

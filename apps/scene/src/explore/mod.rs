//! Questions that are answered by running scenes: sweeps, suggestions, calibrations, comparisons and
//! previews.

pub mod calibrate;
pub mod compare;
pub mod effects;
mod preview;
pub mod suggest;
pub mod sweep;

pub use preview::{LinkLine, Preview};

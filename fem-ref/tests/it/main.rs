//! Tests of finite elements, linked as one program instead of 12.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod common;
mod convergence;
mod doubled;
mod field;
mod formats;
mod gmsh;
mod gmsh_surface;
mod implicit;
mod input;
mod masses;
mod patch;
mod recovery;

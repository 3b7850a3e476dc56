//! Tests of finite elements, in one program: one link instead of 12.

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

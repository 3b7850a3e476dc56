//! Tests of natural elements, linked as one program instead of 14.

mod adopt;
mod beams;
mod common;
mod convergence;
mod cracks;
mod every_door;
mod field;
mod forces;
mod hard_cases;
mod inertia;
mod linear_forces;
mod notch;
mod patch;
mod snapped;
mod turned;

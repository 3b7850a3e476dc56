//! Tests of the particles, linked as one program instead of 24.

mod around;
mod bond;
mod bulk;
mod closed_forms;
mod contact;
mod contact_between;
mod contact_energy;
mod deep_start;
mod fracture;
mod grades;
mod hard_cases;
mod import;
mod kernel;
mod model;
mod obstacle;
mod packing;
mod particle_strength;
mod parts;
mod recovery;
mod screen;
mod shells;
mod softening;
mod stride;
mod toughness;
mod tumbling;

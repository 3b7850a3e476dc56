//! Tests of ranks as threads, in one program: one link instead of 9.

mod broken_parts;
mod elements;
mod interfaces;
mod loaded_parts;
mod natural;
mod particles;
mod support;
mod touching_parts;

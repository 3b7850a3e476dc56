//! Scenes as a library: read a file, change values, build what it asks for, run it, keep the results. Prints nothing and
//! ends no process; see the command line for both.

pub mod calibrate;
pub mod cells;
#[allow(dead_code, reason = "the example offers more than a scene asks for")]
#[path = "../../examples/chain/model.rs"]
mod chain;
pub mod check;
pub mod checkpoint;
pub mod crossing;
pub mod effects;
pub mod error;
pub mod output;
pub mod recorder;
pub mod run;
pub mod scene;
pub mod setup;
pub mod spectrum;
pub mod suggest;
pub mod sweep;
pub mod wake;

pub use error::{Error, Result};
pub use run::Input;

/// Told what is being done, how much of it is done and how much there is to do; workers call it from threads of their own.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

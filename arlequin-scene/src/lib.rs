//! Scenes as a library: read a file, change values, build what it asks for, run it, keep the results. Prints nothing and
//! ends no process; see the command line for both.

pub mod cells;
#[allow(dead_code, reason = "the example offers more than a scene asks for")]
#[path = "../../examples/chain/model.rs"]
mod chain;
pub mod checkpoint;
pub mod crossing;
pub mod error;
pub mod output;
pub mod recorder;
pub mod run;
pub mod scene;
pub mod setup;
pub mod spectrum;
pub mod wake;

pub use error::{Error, Result};
pub use run::Input;

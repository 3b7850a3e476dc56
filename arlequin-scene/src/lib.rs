//! Scenes as a library: read a file, change values, build what it asks for, run it, keep the results. Prints nothing and
//! ends no process; see the command line for both.

pub mod calibrate;
mod cells;
mod checkpoint;
mod crossing;
pub mod effects;
pub mod error;
pub mod output;
mod preview;
mod recorder;
mod run;
mod scene;
pub mod setup;
pub mod spec;
pub mod spectrum;
pub mod suggest;
pub mod sweep;
mod wake;

pub use crossing::OverlapBreak;
pub use error::{Error, Result};
pub use preview::Preview;
pub use recorder::{PhaseClock, Table};
pub use run::{End, Observer, Prepared, Recorded, Results, Resumed, RunFolder, Silent, resume};
pub use scene::{Scene, Source};
pub use spec::SceneSpec;

/// Told what is being done, how much of it is done and how much there is to do; workers call it from threads of their own.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

//! Runs of a scene: sessions, their recorders and writers, zones that follow, and checkpoints.

mod checkpoint;
mod crossing;
mod folder;
mod follow;
mod intrusion;
mod origin;
mod prepared;
mod quiet;
mod recorder;
mod results;
mod session;
mod statics;
mod summary;

pub use folder::RunFolder;
pub use prepared::{Prepared, Resumed, resume, resume_on};
pub use recorder::PhaseClock;
pub use results::{End, Observer, Recorded, Results, Silent};
pub(crate) use summary::{interfaces, models, process_bytes};

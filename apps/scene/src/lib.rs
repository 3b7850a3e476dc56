//! Scenes as a library: read a file, change values, build what it asks for, run it. Nothing is printed;
//! results are written by [`Prepared::run_into`] alone. Packings of spheres are kept in the user's cache,
//! or where `ARLEQUIN_CACHE` says.
//!
//! ```
//! use arlequin_scene::{Scene, Silent};
//!
//! # fn main() -> arlequin_scene::Result<()> {
//! // A steel bar of 1 m, held at one end and pulled at the other by 1 kN from time zero on.
//! let scene = Scene::from_text(r#"
//! [model.bar]
//! kind = "fem"
//! shape.bar = { from = 0.0, to = 1.0, section = 1e-4 }
//! spacing = 0.01
//! material = { young = 210e9, density = 7800.0 }
//! [[support]]
//! model = "bar"
//! where = "x-min"
//! [[load]]
//! model = "bar"
//! where = "x-max"
//! force = [1e3, 0.0, 0.0]
//! time = "step"
//! [time]
//! end = 1e-3
//! [probe.tip]
//! model = "bar"
//! where = "x-max"
//! component = "x"
//! "#)?;
//! let results = scene.set("time.end", 3.854e-4)?.prepare()?.run(&mut Silent)?;
//! // After a wave has run there and back, the tip has moved twice as far as at rest: 2 F L/(E A).
//! let tip = &results.summary().probes["tip"];
//! assert!((tip.last / (2.0 * 1e3 / (210e9 * 1e-4)) - 1.0).abs() < 0.02);
//! # Ok(())
//! # }
//! ```
//!
//! [`SceneSpec`] has every key of a scene with its meaning and unit.

pub mod calibrate;
mod cells;
mod checkpoint;
mod crossing;
pub mod effects;
pub mod error;
mod intrusion;
pub mod output;
mod preview;
mod ranks;
mod recorder;
mod run;
mod scene;
pub mod setup;
pub mod spec;
pub mod spectrum;
pub mod suggest;
pub mod sweep;
pub mod threads;
mod wake;

pub use crossing::OverlapBreak;
pub use error::{Error, Result};
pub use preview::{LinkLine, Preview};
pub use ranks::{RankLine, together};
pub use recorder::{PhaseClock, Table};
pub use run::{
    End, LoadStep, Observer, Prepared, Recorded, Results, Resumed, RunFolder, Silent, resume, resume_on,
};
pub use scene::{Scene, Source};
pub use spec::SceneSpec;

/// Callback for progress: description, amount done, amount in total. Worker threads call it too.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

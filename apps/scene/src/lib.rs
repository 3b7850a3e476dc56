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
//! The crate has four rooms. A file names its own room and the rooms before it only (a test checks this):
//!
//! | room | modules |
//! |---|---|
//! | scene | [`spec`], [`setup`], `scene`, `cells`: the file, and the models that it describes |
//! | output | [`output`]: folders and files of results |
//! | run | `run`: sessions, recorders, checkpoints, zones that follow |
//! | explore | [`sweep`], [`suggest`], [`calibrate`], [`compare`], [`effects`], previews |
//!
//! [`SceneSpec`] has every key of a scene with its meaning and unit.

mod cells;
pub mod error;
mod explore;
pub mod output;
mod ranks;
mod run;
mod scene;
pub mod setup;
pub mod spec;
pub mod spectrum;
pub mod threads;

pub use error::{Error, Result};
pub use explore::{LinkLine, Preview, calibrate, compare, effects, suggest, sweep};
pub use output::summary::{LoadStep, OverlapBreak};
pub use output::tables::Table;
pub use ranks::{RankLine, together};
pub use run::{
    End, Observer, PhaseClock, Prepared, Recorded, Results, Resumed, RunFolder, Silent, resume, resume_on,
};
pub use scene::{Scene, Source};
pub use spec::SceneSpec;

/// Callback for progress: description, amount done, amount in total. Worker threads call it too.
pub type Progress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

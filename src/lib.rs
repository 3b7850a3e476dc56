//! Facade of the workspace.
pub use arlequin_core as core;
pub use {cnem, dem_beam, fem_ref};

//! Result files.

mod folder;
mod frames;
pub(crate) mod packing;
pub(crate) mod plots;
pub(crate) mod summary;
mod vtu;

pub(crate) use folder::{Folder, check_free};
pub(crate) use frames::Frames;
pub(crate) use vtu::Entry;

use crate::error::{Result, write};
use std::fmt::Write as _;
use std::path::Path;

/// Writes columns of equal length as comma-separated values.
pub(crate) fn csv(path: &Path, names: &[String], columns: &[&[f64]]) -> Result<()> {
    let rows = columns.first().map_or(0, |c| c.len());
    let mut text = names.join(",");
    text.push('\n');
    for k in 0..rows {
        for (c, column) in columns.iter().enumerate() {
            let comma = if c > 0 { "," } else { "" };
            // Shortest digits that read back as the same number.
            let _ = write!(text, "{comma}{:e}", column[k]);
        }
        text.push('\n');
    }
    std::fs::write(path, text).map_err(write(path))
}

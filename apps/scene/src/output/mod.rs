//! Result files.

pub mod curves;
mod fields;
mod folder;
pub mod fragments;
mod frames;
pub mod mark;
mod painter;
mod pieces;
pub mod summary;
pub mod tables;
pub(crate) mod writer;

pub use crate::setup::packing;
pub use folder::{Folder, Place};
pub use frames::{Frames, Pictures};
pub use writer::{Array, Entry, Picture};

use crate::error::{Error, Result, write};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::Path;

/// Writes columns of equal length as comma-separated values.
pub fn csv(path: &Path, names: &[String], columns: &[&[f64]]) -> Result<()> {
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
    put(path, &[text.as_bytes()])
}

/// Writes a file completely, or removes it: on a full disk, half a file would take space from others.
pub fn put(path: &Path, parts: &[&[u8]]) -> Result<()> {
    put_with(path, |file| parts.iter().try_for_each(|p| file.write_all(p)))
}

/// Works like [`put`] with a function that writes the file.
pub(crate) fn put_with(
    path: &Path,
    write_parts: impl FnOnce(&mut File) -> std::io::Result<()>,
) -> Result<()> {
    File::create(path)
        .and_then(|mut f| write_parts(&mut f))
        .map_err(|e| {
            let _ = std::fs::remove_file(path);
            write(path)(e)
        })
}

/// Returns a value as indented JSON; `what` names the task in an error.
///
/// # Errors
/// A value that JSON cannot express.
pub fn json(what: &'static str, value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(value).map_err(|e| Error::System {
        what,
        message: e.to_string(),
    })
}

/// Length \[bytes\] and CRC-32 of a file; reads the file in blocks.
pub(crate) fn fingerprint(path: &Path) -> Result<(u64, u32)> {
    let read = |source| Error::Read {
        path: path.to_owned(),
        source,
    };
    let mut file = File::open(path).map_err(read)?;
    let (mut length, mut sum) = (0, crc32fast::Hasher::new());
    let mut block = vec![0; 1 << 16];
    loop {
        match file.read(&mut block).map_err(read)? {
            0 => return Ok((length, sum.finalize())),
            n => {
                sum.update(&block[..n]);
                length += n as u64;
            }
        }
    }
}

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
    put_with(path, |file| parts.iter().try_for_each(|p| file.write_all(p))).map(|_| ())
}

/// Works like [`put`] with a function that writes the file; returns its fingerprint.
pub(crate) fn put_with(
    path: &Path,
    write_parts: impl FnOnce(&mut Counted<File>) -> std::io::Result<()>,
) -> Result<Fingerprint> {
    let write_all = |file| {
        let mut file = Counted::new(file);
        write_parts(&mut file)?;
        Ok(file.fingerprint())
    };
    File::create(path).and_then(write_all).map_err(|e| {
        let _ = std::fs::remove_file(path);
        write(path)(e)
    })
}

/// Length \[bytes\] and CRC-32 of a file.
pub(crate) type Fingerprint = (u64, u32);

/// Takes the fingerprint of the bytes that pass to or from a file.
pub(crate) struct Counted<F> {
    file: F,
    length: u64,
    sum: crc32fast::Hasher,
}

impl<F> Counted<F> {
    fn new(file: F) -> Self {
        Self {
            file,
            length: 0,
            sum: crc32fast::Hasher::new(),
        }
    }

    fn count(&mut self, bytes: &[u8]) {
        self.sum.update(bytes);
        self.length += bytes.len() as u64;
    }

    fn fingerprint(self) -> Fingerprint {
        (self.length, self.sum.finalize())
    }
}

impl std::io::Write for Counted<File> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.count(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
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

/// Reads a file in blocks for its fingerprint.
pub(crate) fn fingerprint(path: &Path) -> Result<Fingerprint> {
    let read = |source| Error::Read {
        path: path.to_owned(),
        source,
    };
    let mut file = Counted::new(File::open(path).map_err(read)?);
    let mut block = vec![0; 1 << 16];
    loop {
        match file.file.read(&mut block).map_err(read)? {
            0 => return Ok(file.fingerprint()),
            n => file.count(&block[..n]),
        }
    }
}

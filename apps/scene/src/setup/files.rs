//! Files that a scene names.

use crate::error::{Error, Result, dem, fem};
use arlequin::dem_beam::Surface;
use std::ffi::OsStr;
use std::path::Path;

/// Content of a file in `shape`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ShapeFile {
    /// A closed surface, as STL.
    Surface,
    /// A mesh of Gmsh.
    Mesh,
}

impl ShapeFile {
    /// Tells by the extension what a file holds.
    pub(super) fn from_path(path: &Path) -> Self {
        if is(path, "stl") {
            Self::Surface
        } else {
            Self::Mesh
        }
    }
}

/// Reads a closed surface from an STL file, in units of `scale` metres.
pub(super) fn surface(key: &str, path: &Path, scale: f64) -> Result<Surface> {
    check_file(key, path)?;
    let surface = Surface::from_stl(&bytes(path)?).map_err(dem(key))?;
    surface.scaled(scale).map_err(dem(key))
}

/// Reads a text.
///
/// # Errors
/// A file that cannot be read; the first byte that is no UTF-8, with its line.
pub(crate) fn text(path: &Path) -> Result<String> {
    String::from_utf8(bytes(path)?).map_err(|e| {
        let (place, bytes) = (e.utf8_error().valid_up_to(), e.as_bytes());
        Error::NotText {
            path: path.to_owned(),
            line: 1 + bytes[..place].iter().filter(|b| **b == b'\n').count(),
            byte: bytes.get(place).copied().unwrap_or_default(),
        }
    })
}

pub(super) fn bytes(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::Read {
        path: path.to_owned(),
        source,
    })
}

/// Returns whether a path has the given extension; upper and lower case are equal.
pub(super) fn is(path: &Path, extension: &str) -> bool {
    path.extension()
        .and_then(OsStr::to_str)
        .is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Refuses a file that cannot be opened.
pub(super) fn check_file(key: &str, path: &Path) -> Result<()> {
    let opened = std::fs::File::open(path).map(|_| ());
    opened.map_err(|e| {
        fem(key)(arlequin::fem_ref::Error::File {
            path: path.display().to_string(),
            message: e.to_string(),
        })
    })
}

//! File formats of frames. A format is a file with its [`Writer`], and a line in [`WRITERS`].

mod vtu;

use super::Fingerprint;
use super::pieces::Piece;
use crate::error::{Result, unknown};
use crate::setup::Grid;
use crate::spec::Output;
use std::borrow::Cow;
use std::fmt::Debug;
use std::path::Path;

/// All formats; the first one is the default.
pub(super) const WRITERS: [&dyn Writer; 1] = [&vtu::Vtu];

/// Writes frames in a file format.
pub(crate) trait Writer: Debug + Sync {
    /// Name in the scene (`output.format`), and of the subfolder with the files.
    fn name(&self) -> &'static str;

    /// Ending of the file of a grid or a piece, and of the file that lists the pieces of a grid.
    fn endings(&self) -> [&'static str; 2];

    /// Names that [`Writer::write_index`] gives to files; the first one is the index.
    fn indices(&self) -> &'static [&'static str];

    /// Writes a grid, or `piece` of a partitioned one; returns the fingerprint of the file.
    fn write_grid(&self, path: &Path, picture: &Picture<'_>, piece: Option<&Piece>) -> Result<Fingerprint>;

    /// Writes the file that lists the pieces of a grid, which are in the same folder. `arrays` of points and
    /// of cells have no values.
    fn write_pieces(&self, path: &Path, arrays: &[Vec<Array<'_>>; 2], pieces: &[String]) -> Result<()>;

    /// Writes the list of all files over time. It is written during the run, too.
    fn write_index(&self, path: &Path, entries: &[Entry]) -> Result<()>;
}

/// Returns the format that a scene asks for.
///
/// # Errors
/// An unknown format.
pub(crate) fn writer(output: &Output) -> Result<&'static dyn Writer> {
    let format = WRITERS.into_iter().find(|w| w.name() == output.format);
    let names: Vec<String> = WRITERS.iter().map(|w| w.name().to_owned()).collect();
    format.ok_or_else(|| unknown("output.format", &output.format, "format", names.iter()))
}

/// A named array with values per point or cell.
#[derive(Debug, Clone)]
pub struct Array<'a> {
    /// Name with unit.
    pub name: String,
    /// Numbers per point or cell: 1, 3 or 6.
    pub components: usize,
    /// Values.
    pub values: Cow<'a, [f64]>,
    /// True for what follows from displacements and velocities: files hold it in single precision, with seven
    /// digits and half of the bytes.
    pub derived: bool,
}

impl<'a> Array<'a> {
    /// One derived number per point or cell.
    pub(super) fn scalar(name: &str, values: impl Into<Cow<'a, [f64]>>) -> Self {
        Self {
            name: name.into(),
            components: 1,
            values: values.into(),
            derived: true,
        }
    }

    /// Returns the array without its values.
    pub(super) fn empty(self) -> Array<'static> {
        Array {
            values: Cow::default(),
            name: self.name,
            components: self.components,
            derived: self.derived,
        }
    }

    /// Returns the array with values of its own.
    #[must_use]
    pub fn into_owned(self) -> Array<'static> {
        Array {
            values: self.values.into_owned().into(),
            name: self.name,
            components: self.components,
            derived: self.derived,
        }
    }
}

/// A model at one instant.
#[derive(Debug)]
pub struct Picture<'a> {
    /// Name of the model.
    pub name: String,
    /// Points and cells at rest.
    pub grid: &'a Grid,
    /// Values at the points.
    pub points: Vec<Array<'a>>,
    /// Values in the cells.
    pub cells: Vec<Array<'a>>,
}

/// An entry of the index.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Entry {
    /// Time \[s\].
    pub time: f64,
    /// Index of the model or mediator.
    pub part: usize,
    /// Name of the model or mediator.
    pub name: String,
    /// Path relative to the index.
    pub file: String,
}

//! Reads the frames of a run: the index `results.pvd` and the VTU files, whole or in pieces. An array is read
//! only when it is requested, so that at most one is in memory.

use super::pieces::Piece;
use crate::error::{Error, Result, value};
use arlequin::dem_beam::vtu::{self, Array, Section, Vtu};
use roxmltree::Document;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Files of one model, mediator or rigid body over time.
#[derive(Debug)]
pub(crate) struct Series {
    /// Name in the index.
    pub(crate) name: String,
    /// Times \[s\] and files, ascending.
    pub(crate) files: Vec<(f64, PathBuf)>,
}

impl Series {
    /// Returns the file for a time: the last file that is not later, or the first file.
    pub(super) fn file_at(&self, time: f64) -> Option<&Path> {
        let k = self.files.partition_point(|f| f.0 <= time);
        Some(&self.files.get(k.saturating_sub(1))?.1)
    }
}

/// Reads the index of a folder of results and returns its series in the order of the index.
pub(crate) fn index(folder: &Path) -> Result<Vec<Series>> {
    let path = folder.join("results.pvd");
    let text = std::fs::read_to_string(&path).map_err(read(&path))?;
    let xml = Document::parse(&text).map_err(|e| damaged(&path, &e.to_string()))?;
    let mut out: Vec<Series> = Vec::new();
    for set in xml.descendants().filter(|n| n.has_tag_name("DataSet")) {
        let word = |key: &str| set.attribute(key).unwrap_or_default();
        let time: f64 = word("timestep")
            .parse()
            .map_err(|_| damaged(&path, "a time is no number"))?;
        let file = (time, folder.join(word("file")));
        match out.iter_mut().find(|s| s.name == word("name")) {
            Some(series) => series.files.push(file),
            None => out.push(Series {
                name: word("name").to_owned(),
                files: vec![file],
            }),
        }
    }
    for series in &mut out {
        series.files.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    out.retain(|s| !s.files.is_empty());
    if out.is_empty() {
        return Err(damaged(&path, "it names no frames"));
    }
    Ok(out)
}

pub(super) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Error + '_ {
    move |source| Error::Read {
        path: path.to_owned(),
        source,
    }
}

pub(super) fn damaged(path: &Path, why: &str) -> Error {
    let rule = format!("is no frame that 'arlequin run' wrote, or a damaged one ({why}); make the run again");
    value("DIR", path.display(), &rule)
}

/// Turns an error of the reader into one that names the file.
pub(super) fn unreadable(path: &Path) -> impl Fn(arlequin::dem_beam::Error) -> Error + '_ {
    move |e| match e {
        arlequin::dem_beam::Error::BadFile { reason, .. } => damaged(path, &reason),
        e => damaged(path, &e.to_string()),
    }
}

/// A model at one time: one file, or pieces in `.vtu` files that a `.pvtu` file lists.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(super) path: PathBuf,
    /// The file of the whole model, or its pieces.
    pub(super) pieces: Vec<Piece>,
    pub(super) in_pieces: bool,
    pub(super) points: usize,
    pub(super) cells: usize,
    pub(super) arrays: Vec<Array>,
}

impl Frame {
    /// Reads the headers of the frame's file or files.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        if path.extension().is_some_and(|e| e == "pvtu") {
            return Self::open_pieces(path);
        }
        let file = FrameFile::open(path)?;
        Ok(Self {
            path: path.to_owned(),
            in_pieces: false,
            points: file.points,
            cells: file.cells,
            arrays: file.grid.arrays.clone(),
            pieces: vec![Piece::whole(file)],
        })
    }

    /// Returns an array by its name.
    pub(crate) fn find(&self, section: Section, name: &str) -> Option<Array> {
        let mut arrays = self.arrays.iter();
        arrays.find(|a| a.section == section && a.name == name).cloned()
    }

    /// Returns the array of positions.
    pub(crate) fn positions(&self) -> Option<Array> {
        let is_position = |a: &&Array| a.section == Section::Points && a.components == 3;
        self.arrays.iter().find(is_position).cloned()
    }
}

/// An open VTU file with one grid.
#[derive(Debug)]
pub(super) struct FrameFile {
    pub(super) path: PathBuf,
    file: Vtu<File>,
    pub(super) grid: vtu::Piece,
    pub(super) points: usize,
    pub(super) cells: usize,
}

impl FrameFile {
    /// Reads the header of a file.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let mut file = Vtu::open(File::open(path).map_err(read(path))?).map_err(unreadable(path))?;
        let bad = |why: &str| damaged(path, why);
        let first = file.pieces.drain(..).next();
        let grid = first.ok_or_else(|| bad("it has no piece"))?;
        let counts = grid.points.zip(grid.cells);
        let (points, cells) = counts.ok_or_else(|| bad("no counts"))?;
        if grid.arrays.iter().any(|a| a.components == 0) {
            return Err(bad("an array is of an unknown kind"));
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            grid,
            points,
            cells,
        })
    }

    /// Reads all numbers of an array.
    pub(super) fn numbers(&mut self, array: &Array) -> Result<Vec<f64>> {
        let numbers = self.file.numbers(array).map_err(unreadable(&self.path))?;
        let expected = match array.section {
            Section::PointData => Some(self.points * array.components),
            Section::CellData => Some(self.cells * array.components),
            Section::Points | Section::Cells => None,
        };
        if expected.is_some_and(|n| n != numbers.len()) {
            let why = format!("'{}' has {} numbers", array.name, numbers.len());
            return Err(damaged(&self.path, &why));
        }
        Ok(numbers)
    }
}

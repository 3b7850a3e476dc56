//! Assembles a frame whose pieces were written by several ranks: points and cells in the order of the whole
//! model, each once.

use super::frames::{Frame, FrameFile, damaged, read, unreadable};
use crate::error::Result;
use arlequin::dem_beam::vtu::{Array, CELL_NUMBERS, GHOSTS, POINT_NUMBERS, Section, pieces_of_pvtu};
use std::path::Path;

/// A file of a frame, with numbers if it is a rank's piece.
#[derive(Debug)]
pub(super) struct Piece {
    file: FrameFile,
    /// Numbers of the piece's points in the whole model.
    points: Vec<u32>,
    /// For each point: true if it is owned by another piece.
    ghost: Vec<bool>,
    /// Numbers of the piece's cells in the whole model.
    cells: Vec<u32>,
}

impl Frame {
    /// Opens a `.pvtu` file and the pieces it names. Fails unless they hold every point and cell of the
    /// whole model exactly once.
    pub(super) fn open_pieces(path: &Path) -> Result<Self> {
        let content = std::fs::read(path).map_err(read(path))?;
        let files = pieces_of_pvtu(&content).map_err(unreadable(path))?;
        let pieces = files.iter().map(|f| Piece::open(&path.with_file_name(f)));
        let pieces = pieces.collect::<Result<Vec<_>>>()?;
        let owned_count = |p: &Piece| p.ghost.iter().filter(|g| !**g).count();
        let shown = |a: &&Array| ![POINT_NUMBERS, CELL_NUMBERS, GHOSTS].contains(&a.name.as_str());
        let arrays = pieces.iter().take(1).flat_map(|p| &p.file.grid.arrays);
        let out = Self {
            points: pieces.iter().map(owned_count).sum(),
            cells: pieces.iter().map(|p| p.cells.len()).sum(),
            path: path.to_owned(),
            in_pieces: true,
            arrays: arrays.filter(shown).cloned().collect(),
            pieces,
        };
        let points = out.pieces.iter().flat_map(Piece::owned_points).map(|p| p.1);
        let cells = out.pieces.iter().flat_map(|p| &p.cells).copied();
        let in_range = |p: &Piece| p.points.iter().all(|k| (*k as usize) < out.points);
        if !once(points, out.points) || !once(cells, out.cells) || !out.pieces.iter().all(in_range) {
            return Err(damaged(path, "its pieces do not make a whole"));
        }
        Ok(out)
    }

    /// Reads all numbers of an array, in the order of the whole model.
    pub(crate) fn numbers(&mut self, array: &Array) -> Result<Vec<f64>> {
        if !self.in_pieces {
            return self.pieces[0].file.numbers(array);
        }
        match (array.section, array.name.as_str()) {
            (Section::Cells, "connectivity") => self.connectivity(),
            (Section::Cells, "offsets") => Ok(self.ends()?.into_iter().map(|e| e as f64).collect()),
            (Section::CellData | Section::Cells, _) => {
                let cell_pairs = |p: &Piece| (0..).zip(p.cells.iter().copied()).collect();
                self.gathered(array, self.cells, cell_pairs)
            }
            _ => self.gathered(array, self.points, |p| p.owned_points().collect()),
        }
    }

    /// Gathers an array of points or cells from all pieces. `pairs` returns pairs of numbers: in the piece
    /// and in the whole model.
    fn gathered(
        &mut self,
        array: &Array,
        count: usize,
        pairs: impl Fn(&Piece) -> Vec<(usize, u32)>,
    ) -> Result<Vec<f64>> {
        let width = array.components;
        let mut out = vec![0.0; width * count];
        for p in &mut self.pieces {
            let numbers = p.numbers(array.section, &array.name, width)?;
            for (local, global) in pairs(p) {
                let from = numbers.get(width * local..width * (local + 1));
                let from = from.ok_or_else(|| damaged(&self.path, "an array of a piece is too short"))?;
                out[width * global as usize..][..width].copy_from_slice(from);
            }
        }
        Ok(out)
    }

    /// Returns where the corners of each cell end in the connectivity of the whole model.
    fn ends(&mut self) -> Result<Vec<usize>> {
        let mut ends = vec![0; self.cells];
        for p in &mut self.pieces {
            let mut start = 0;
            let offsets = p.numbers(Section::Cells, "offsets", 1)?;
            for (cell, end) in p.cells.iter().zip(offsets) {
                // First the number of corners of each cell, summed up below.
                // Damaged offsets may decrease; the subtraction must not overflow.
                ends[*cell as usize] = (end as usize).saturating_sub(start);
                start = end as usize;
            }
        }
        let mut end = 0_usize;
        for e in &mut ends {
            end = end.saturating_add(*e);
            *e = end;
        }
        Ok(ends)
    }

    /// Returns the corners of all cells, numbered as in the whole model.
    fn connectivity(&mut self) -> Result<Vec<f64>> {
        let ends = self.ends()?;
        let rows = self
            .pieces
            .iter_mut()
            .map(|p| p.numbers(Section::Cells, "connectivity", 1));
        let rows = rows.collect::<Result<Vec<_>>>()?;
        let mut out = vec![0.0; rows.iter().map(Vec::len).sum()];
        let lost = || damaged(&self.path, "cells of a piece have corners that are not there");
        for (p, row) in self.pieces.iter().zip(rows) {
            let mut row = row.into_iter();
            for cell in p.cells.iter().map(|c| *c as usize) {
                let start = if cell == 0 { 0 } else { ends[cell - 1] };
                for to in out.get_mut(start..ends[cell]).ok_or_else(lost)? {
                    let corner = row.next().and_then(|c| p.points.get(c as usize));
                    *to = f64::from(*corner.ok_or_else(lost)?);
                }
            }
        }
        Ok(out)
    }
}

impl Piece {
    /// Takes a file with a whole model.
    pub(super) fn whole(file: FrameFile) -> Self {
        Self {
            file,
            points: Vec::new(),
            ghost: Vec::new(),
            cells: Vec::new(),
        }
    }

    fn open(path: &Path) -> Result<Self> {
        let mut file = FrameFile::open(path)?;
        let mut numbers = |section: Section, name: &str| {
            let array = file.grid.find(section, name).filter(|a| a.components == 1);
            let array = array.cloned();
            file.numbers(&array.ok_or_else(|| damaged(path, &format!("it has no '{name}'")))?)
        };
        let whole = |numbers: Vec<f64>| numbers.into_iter().map(|x| x as u32).collect();
        let points = whole(numbers(Section::PointData, POINT_NUMBERS)?);
        let ghost = numbers(Section::PointData, GHOSTS)?;
        let cells = whole(numbers(Section::CellData, CELL_NUMBERS)?);
        Ok(Self {
            file,
            points,
            ghost: ghost.into_iter().map(|g| g > 0.0).collect(),
            cells,
        })
    }

    /// Returns pairs of numbers, in the piece and in the whole model, of the points that the piece owns.
    fn owned_points(&self) -> impl Iterator<Item = (usize, u32)> {
        let numbered = self.points.iter().zip(&self.ghost).enumerate();
        numbered
            .filter(|(_, (_, ghost))| !**ghost)
            .map(|(k, (n, _))| (k, *n))
    }

    fn numbers(&mut self, section: Section, name: &str, components: usize) -> Result<Vec<f64>> {
        let array = self.file.grid.find(section, name);
        let array = array.filter(|a| a.components == components).cloned();
        let lost = || format!("it has no '{name}' as the other pieces");
        let array = array.ok_or_else(|| damaged(&self.file.path, &lost()))?;
        self.file.numbers(&array)
    }
}

/// Returns whether `numbers` are 0 to `count` − 1, each exactly once.
fn once(numbers: impl Iterator<Item = u32>, count: usize) -> bool {
    let mut seen = vec![false; count];
    let mut fresh = |k: u32| {
        seen.get_mut(k as usize)
            .is_some_and(|t| !std::mem::replace(t, true))
    };
    let mut numbers = numbers;
    numbers.all(&mut fresh)
}

//! Reads the frames of a run: the index `results.pvd` and the VTU files with raw appended data, whole or in
//! pieces. An array is read only when it is requested, so that at most one is in memory.

use super::pieces::Pieces;
use crate::error::{Error, Result, value};
use roxmltree::{Document, Node};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
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

/// Section of a file to which an array belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    Point,
    Cell,
    /// Positions, connectivity, offsets and types.
    Grid,
}

/// Description of an array in a file.
#[derive(Debug, Clone)]
pub(crate) struct Array {
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) components: usize,
    bytes: usize,
    decode: fn(&[u8]) -> f64,
    offset: u64,
}

/// A model at one time.
#[derive(Debug)]
pub(crate) struct Frame {
    content: Content,
    pub(super) points: usize,
    pub(super) cells: usize,
    pub(super) arrays: Vec<Array>,
}

#[derive(Debug)]
enum Content {
    Whole(Vtu),
    Pieces(Pieces),
}

impl Frame {
    /// Reads the headers of the frame's file or files.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        if path.extension().is_some_and(|e| e == "pvtu") {
            let pieces = Pieces::open(path)?;
            return Ok(Self {
                points: pieces.points,
                cells: pieces.cells,
                arrays: pieces.arrays(),
                content: Content::Pieces(pieces),
            });
        }
        let file = Vtu::open(path)?;
        Ok(Self {
            points: file.points,
            cells: file.cells,
            arrays: file.arrays.clone(),
            content: Content::Whole(file),
        })
    }

    /// Returns an array by its name; for an empty name the first array of vectors.
    pub(crate) fn find(&self, place: Place, name: &str) -> Option<Array> {
        named(&self.arrays, place, name)
    }

    /// Reads all numbers of an array.
    pub(crate) fn numbers(&mut self, array: &Array) -> Result<Vec<f64>> {
        match &mut self.content {
            Content::Whole(file) => file.numbers(array),
            Content::Pieces(pieces) => pieces.numbers(array),
        }
    }
}

/// Finds an array by its name; for an empty name the first array of vectors.
fn named(arrays: &[Array], place: Place, name: &str) -> Option<Array> {
    let mut candidates = arrays.iter();
    candidates
        .find(|a| a.place == place && (a.name == name || (name.is_empty() && a.components == 3)))
        .cloned()
}

/// An open VTU file.
#[derive(Debug)]
pub(super) struct Vtu {
    pub(super) path: PathBuf,
    file: File,
    data: u64,
    pub(super) points: usize,
    pub(super) cells: usize,
    pub(super) arrays: Vec<Array>,
}

impl Vtu {
    /// Reads the header of a file.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(read(path))?;
        let (head, data) = head(&mut file).map_err(read(path))?;
        let bad = |why: &str| damaged(path, why);
        let head = head.ok_or_else(|| bad("its data are not appended raw"))?;
        let xml = Document::parse(&head).map_err(|e| bad(&e.to_string()))?;
        let piece = xml.descendants().find(|n| n.has_tag_name("Piece"));
        let piece = piece.ok_or_else(|| bad("it has no piece"))?;
        let count = |key: &str| piece.attribute(key).and_then(|v| v.parse().ok());
        let (points, cells) = count("NumberOfPoints")
            .zip(count("NumberOfCells"))
            .ok_or_else(|| bad("no counts"))?;
        let mut arrays = Vec::new();
        for (section, place) in [
            ("PointData", Place::Point),
            ("CellData", Place::Cell),
            ("Points", Place::Grid),
            ("Cells", Place::Grid),
        ] {
            let sections = piece.children().filter(|n| n.has_tag_name(section));
            for node in sections
                .flat_map(|n| n.children())
                .filter(|n| n.has_tag_name("DataArray"))
            {
                arrays.push(array(node, place).ok_or_else(|| bad("an array is of an unknown kind"))?);
            }
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            data,
            points,
            cells,
            arrays,
        })
    }

    /// Returns an array by its name; for an empty name the first array of vectors.
    pub(super) fn find(&self, place: Place, name: &str) -> Option<Array> {
        named(&self.arrays, place, name)
    }

    /// Reads all numbers of an array.
    pub(super) fn numbers(&mut self, array: &Array) -> Result<Vec<f64>> {
        let path = self.path.clone();
        let bytes = self.bytes(array).map_err(read(&path))?;
        let numbers: Vec<f64> = bytes.chunks_exact(array.bytes).map(array.decode).collect();
        let expected = match array.place {
            Place::Point => Some(self.points * array.components),
            Place::Cell => Some(self.cells * array.components),
            Place::Grid => None,
        };
        if expected.is_some_and(|n| n != numbers.len()) {
            return Err(damaged(
                &path,
                &format!("'{}' has {} numbers", array.name, numbers.len()),
            ));
        }
        Ok(numbers)
    }

    fn bytes(&mut self, array: &Array) -> std::io::Result<Vec<u8>> {
        self.file.seek(SeekFrom::Start(self.data + array.offset))?;
        let mut size = [0; 8];
        self.file.read_exact(&mut size)?;
        let size = u64::from_le_bytes(size);
        // A damaged length must not allocate all memory.
        let remaining = self
            .file
            .metadata()?
            .len()
            .saturating_sub(self.data + array.offset + 8);
        if size > remaining {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        let mut bytes = vec![0; size as usize];
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

/// Returns the XML before the appended data, with the closing tag added, and the offset of the data
/// \[bytes\]. The text is `None` if no appended data were found.
fn head(file: &mut File) -> std::io::Result<(Option<String>, u64)> {
    const MARK: &[u8] = b"<AppendedData encoding=\"raw\">";
    let mut bytes = Vec::new();
    let mut block = vec![0; 1 << 14];
    loop {
        let n = file.read(&mut block)?;
        bytes.extend_from_slice(&block[..n]);
        let mark = bytes.windows(MARK.len()).position(|w| w == MARK);
        // The data begin behind the `_` that follows the tag.
        let start = mark.and_then(|m| Some((m, m + bytes[m..].iter().position(|b| *b == b'_')? + 1)));
        if let Some((mark, start)) = start {
            let text = String::from_utf8(bytes[..mark].to_vec()).ok();
            return Ok((text.map(|t| t + "</VTKFile>"), start as u64));
        }
        // A header holds only descriptions of arrays, so 1 MiB is ample.
        if n == 0 || bytes.len() > 1 << 20 {
            return Ok((None, 0));
        }
    }
}

fn array(node: Node<'_, '_>, place: Place) -> Option<Array> {
    fn raw<const N: usize>(b: &[u8]) -> [u8; N] {
        std::array::from_fn(|k| b[k])
    }
    let (bytes, decode): (usize, fn(&[u8]) -> f64) = match node.attribute("type")? {
        "Float64" => (8, |b| f64::from_le_bytes(raw(b))),
        "Float32" => (4, |b| f64::from(f32::from_le_bytes(raw(b)))),
        "Int64" => (8, |b| i64::from_le_bytes(raw(b)) as f64),
        "Int32" => (4, |b| f64::from(i32::from_le_bytes(raw(b)))),
        "UInt32" => (4, |b| f64::from(u32::from_le_bytes(raw(b)))),
        "UInt8" => (1, |b| f64::from(b[0])),
        _ => return None,
    };
    let components = node.attribute("NumberOfComponents").unwrap_or("1");
    Some(Array {
        name: node.attribute("Name").unwrap_or_default().to_owned(),
        place,
        components: components.parse().ok().filter(|c| *c > 0)?,
        bytes,
        decode,
        offset: node.attribute("offset")?.parse().ok()?,
    })
}

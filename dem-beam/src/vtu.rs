//! Reads VTU files, VTK's XML format for unstructured grids, and the list of pieces in a PVTU file.
//!
//! Supported: data as text, base64 or raw; in place or appended; 32- or 64-bit headers; zlib blocks or none;
//! little-endian; any kind of number. An array is read when it is asked for, so that a large file needs the
//! memory of one array. The crate for the format that was tried does not take raw data, which large files
//! have (decision 0027).

use crate::error::{Error, Result};
use roxmltree::{Document, Node};
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

/// Point array with the numbers of a piece's points in the whole grid.
pub const POINT_NUMBERS: &str = "GlobalPointIds";
/// Cell array with the numbers of a piece's cells in the whole grid.
pub const CELL_NUMBERS: &str = "GlobalCellIds";
/// Point array whose first bit marks a point that another piece owns.
pub const GHOSTS: &str = "vtkGhostType";

/// Section of a piece to which an array belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Section {
    /// Values at the points.
    PointData,
    /// Values in the cells.
    CellData,
    /// Positions.
    Points,
    /// Connectivity, offsets and types.
    Cells,
}

/// Sections in the order of [`Piece::arrays`].
const SECTIONS: [(&str, Section); 4] = [
    ("PointData", Section::PointData),
    ("CellData", Section::CellData),
    ("Points", Section::Points),
    ("Cells", Section::Cells),
];

/// Description of an array.
#[derive(Debug, Clone)]
pub struct Array {
    /// Name; may be empty.
    pub name: String,
    /// Section.
    pub section: Section,
    /// Numbers per point or cell; 0 if the file does not say it in digits.
    pub components: usize,
    /// VTK's name of the type of numbers.
    kind: String,
    /// Form of the data: `ascii`, `binary` (base64) or `appended`.
    format: String,
    /// Place in the head of data that are not appended.
    text: Range<usize>,
    /// Place in appended data.
    offset: Option<u64>,
}

/// A piece of a grid.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Number of points, if the file has it.
    pub points: Option<usize>,
    /// Number of cells, if the file has it.
    pub cells: Option<usize>,
    /// Arrays, section by section.
    pub arrays: Vec<Array>,
    /// Name of the point array with numbers in the whole grid, if there is one.
    pub point_numbers: Option<String>,
}

impl Piece {
    /// Arrays of a section.
    pub fn section(&self, section: Section) -> impl Iterator<Item = &Array> {
        self.arrays.iter().filter(move |a| a.section == section)
    }

    /// Returns an array by its name.
    pub fn find(&self, section: Section, name: &str) -> Option<&Array> {
        self.section(section).find(|a| a.name == name)
    }
}

/// Place where appended data begin, behind the mark `_`, and true if they are base64.
type Appended = (u64, bool);

/// An open VTU file.
#[derive(Debug)]
pub struct Vtu<R> {
    source: R,
    /// XML before the appended data.
    head: String,
    appended: Option<Appended>,
    /// Bytes per number in the headers of arrays.
    width: usize,
    zlib: bool,
    /// Pieces of the grid.
    pub pieces: Vec<Piece>,
}

impl<R: Read + Seek> Vtu<R> {
    /// Reads the descriptions of all arrays.
    ///
    /// # Errors
    /// [`Error::BadFile`] if it is no VTU file, or one of an unknown byte order or compressor.
    pub fn open(mut source: R) -> Result<Self> {
        let (head, appended) = read_head(&mut source).map_err(|e| bad(e.to_string()))?;
        let head = String::from_utf8(head).map_err(|_| bad("its head is no UTF-8 text"))?;
        let xml = Document::parse(&head).map_err(|e| bad(e.to_string()))?;
        let root = xml.root_element();
        if root.attribute("type") != Some("UnstructuredGrid") {
            return Err(bad("it is not a VTKFile of the type UnstructuredGrid"));
        }
        if root.attribute("byte_order") == Some("BigEndian") {
            return Err(bad("its byte order is BigEndian; save it as LittleEndian"));
        }
        let zlib = match root.attribute("compressor") {
            None => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                return Err(bad(format!(
                    "the compressor {other} is not known; use zlib or none"
                )));
            }
        };
        // Without a type, headers have 32 bits: the default of the format.
        let width = match root.attribute("header_type") {
            Some("UInt64") => 8,
            _ => 4,
        };
        let pieces = xml.descendants().filter(|n| n.has_tag_name("Piece"));
        let pieces = pieces.map(piece).collect();
        Ok(Self {
            source,
            head,
            appended,
            width,
            zlib,
            pieces,
        })
    }

    /// Reads the numbers of an array.
    ///
    /// # Errors
    /// [`Error::BadFile`] for data that are cut short, damaged or of an unknown kind.
    pub fn numbers(&mut self, array: &Array) -> Result<Vec<f64>> {
        let text = &self.head[array.text.clone()];
        let data = match array.format.as_str() {
            "ascii" => {
                let numbers = text.split_ascii_whitespace().map(str::parse::<f64>);
                return numbers
                    .collect::<std::result::Result<_, _>>()
                    .map_err(|e| bad(format!("an array of text: {e}")));
            }
            "binary" => base64(text.trim().as_bytes()),
            "appended" => self.appended(array.offset)?,
            other => return Err(bad(format!("the format {other} of an array is not known"))),
        };
        let data = self
            .unpack(data)
            .ok_or_else(|| bad("an array is cut short or damaged"))?;
        convert(&array.kind, &data)
    }

    /// Reads an appended array with its header. Fewer bytes than the header says if the file ends before.
    fn appended(&mut self, offset: Option<u64>) -> Result<Vec<u8>> {
        let (start, encoded) = self.appended.ok_or_else(|| bad("there is no appended data"))?;
        let end = self
            .source
            .seek(SeekFrom::End(0))
            .map_err(|e| bad(e.to_string()))?;
        // The offset stands in the file, so that a damaged one must not lead out of it.
        let first = offset.and_then(|o| start.checked_add(o)).filter(|f| *f <= end);
        let first = first.ok_or_else(|| bad("an offset is outside the appended data"))?;
        // The end of base64 data is known only after decoding: `base64` stops at the first other byte.
        if encoded {
            return Ok(base64(&self.read(first, u64::MAX)?));
        }
        // The length stands in the header, whose length stands in its first number if there are blocks.
        let mut header = self.read(first, self.width as u64)?;
        if self.zlib {
            let numbers = self.word(&header, 0).unwrap_or(0).saturating_add(3);
            header = self.read(first, (numbers as u64).saturating_mul(self.width as u64))?;
        }
        let data = match self.zlib {
            true => (3..header.len() / self.width).fold(0, |sum: usize, k| {
                sum.saturating_add(self.word(&header, k).unwrap_or(0))
            }),
            false => self.word(&header, 0).unwrap_or(0),
        };
        self.read(first, (header.len() as u64).saturating_add(data as u64))
    }

    /// Reads up to `count` bytes from `first` on. A damaged count allocates no more than the file holds.
    fn read(&mut self, first: u64, count: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let place = self.source.seek(SeekFrom::Start(first));
        place
            .and_then(|_| self.source.by_ref().take(count).read_to_end(&mut bytes))
            .map_err(|e| bad(e.to_string()))?;
        Ok(bytes)
    }

    /// Returns number `k` of a header. It comes from the file and may be wrong, so that ranges are checked.
    fn word(&self, data: &[u8], k: usize) -> Option<usize> {
        let raw = data.get(k * self.width..(k + 1) * self.width)?;
        usize::try_from(raw.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b))).ok()
    }

    /// Removes the header and decompresses the data; `None` if they are cut short or damaged.
    fn unpack(&self, mut data: Vec<u8>) -> Option<Vec<u8>> {
        if !self.zlib {
            let end = self.word(&data, 0)?.checked_add(self.width)?;
            data.get(self.width..end)?;
            data.truncate(end);
            data.drain(..self.width);
            return Some(data);
        }
        // The header holds the number of blocks, their size, the size of the last one if it is smaller, then
        // the compressed size of each.
        let (blocks, size) = (self.word(&data, 0)?, self.word(&data, 1)?);
        let mut start = blocks.checked_add(3)?.checked_mul(self.width)?;
        let mut out = Vec::new();
        for k in 0..blocks {
            let end = start.checked_add(self.word(&data, 3 + k)?)?;
            // With the limit of the header, so that a small damaged file cannot fill the memory.
            let block = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(data.get(start..end)?, size);
            out.extend(block.ok()?);
            start = end;
        }
        Some(out)
    }
}

/// Reads the XML before the appended data, with the closing tag added, and finds these data.
fn read_head(source: &mut impl Read) -> std::io::Result<(Vec<u8>, Option<Appended>)> {
    const MARK: &[u8] = b"<AppendedData";
    let (mut bytes, mut searched) = (Vec::new(), 0);
    loop {
        let count = source.by_ref().take(1 << 14).read_to_end(&mut bytes)?;
        let mark = bytes[searched..].windows(MARK.len()).position(|w| w == MARK);
        let Some(mark) = mark.map(|m| searched + m) else {
            if count == 0 {
                return Ok((bytes, None));
            }
            // The mark may lie across the border of two reads.
            searched = bytes.len().saturating_sub(MARK.len());
            continue;
        };
        searched = mark;
        let tag = &bytes[mark..];
        let tag_end = tag.iter().position(|b| *b == b'>');
        let start =
            tag_end.and_then(|end| Some((end, end + tag[end..].iter().position(|b| *b == b'_')? + 1)));
        if start.is_some() || count == 0 {
            let appended = start.map(|(end, start)| {
                let encoded = String::from_utf8_lossy(&tag[..end]).contains("base64");
                ((mark + start) as u64, encoded)
            });
            // Appended data need not be XML, so that the text before them is parsed alone.
            bytes.truncate(mark);
            bytes.extend(b"</VTKFile>");
            return Ok((bytes, appended));
        }
    }
}

fn piece(node: Node<'_, '_>) -> Piece {
    let child = |name: &str| node.children().find(|n| n.has_tag_name(name));
    let count = |name: &str| node.attribute(name).and_then(|n| n.parse().ok());
    let arrays = SECTIONS.into_iter().flat_map(|(name, section)| {
        let nodes = child(name).into_iter().flat_map(|s| s.children());
        nodes
            .filter(|n| n.has_tag_name("DataArray"))
            .map(move |n| array(n, section))
    });
    Piece {
        points: count("NumberOfPoints"),
        cells: count("NumberOfCells"),
        arrays: arrays.collect(),
        point_numbers: child("PointData").and_then(|d| Some(d.attribute("GlobalIds")?.to_owned())),
    }
}

fn array(node: Node<'_, '_>, section: Section) -> Array {
    let word = |key: &str| node.attribute(key).map(str::to_owned);
    Array {
        name: word("Name").unwrap_or_default(),
        section,
        components: word("NumberOfComponents").map_or(1, |c| c.parse().unwrap_or(0)),
        kind: word("type").unwrap_or_default(),
        format: word("format").unwrap_or_else(|| "ascii".to_owned()),
        text: node
            .first_child()
            .filter(Node::is_text)
            .map_or(0..0, |t| t.range()),
        offset: word("offset").and_then(|o| o.parse().ok()),
    }
}

/// Reads the names of the piece files from a PVTU file, in its order. The pieces lie beside it.
///
/// # Errors
/// [`Error::BadFile`] if it is not PVTU, or names no pieces.
pub fn pieces_of_pvtu(bytes: &[u8]) -> Result<Vec<String>> {
    let text = std::str::from_utf8(bytes).map_err(|_| bad("it is no UTF-8 text"))?;
    let xml = Document::parse(text).map_err(|e| bad(e.to_string()))?;
    if xml.root_element().attribute("type") != Some("PUnstructuredGrid") {
        return Err(bad("it is not a VTKFile of the type PUnstructuredGrid"));
    }
    let pieces = xml.descendants().filter(|n| n.has_tag_name("Piece"));
    let names: Vec<String> = pieces
        .filter_map(|n| n.attribute("Source").map(str::to_owned))
        .collect();
    if names.is_empty() {
        return Err(bad("it names no pieces"));
    }
    Ok(names)
}

pub(crate) fn bad(reason: impl Into<String>) -> Error {
    Error::BadFile {
        format: "VTU",
        reason: reason.into(),
    }
}

/// Converts little-endian numbers of a VTK type.
fn convert(kind: &str, data: &[u8]) -> Result<Vec<f64>> {
    fn decode<const N: usize>(data: &[u8], number_of: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        let mut raw = [0; N];
        let number = |c: &[u8]| {
            raw.copy_from_slice(c);
            number_of(raw)
        };
        data.chunks_exact(N).map(number).collect()
    }
    Ok(match kind {
        "Float64" => decode(data, f64::from_le_bytes),
        "Float32" => decode(data, |b| f64::from(f32::from_le_bytes(b))),
        "Int64" => decode(data, |b| i64::from_le_bytes(b) as f64),
        "UInt64" => decode(data, |b| u64::from_le_bytes(b) as f64),
        "Int32" => decode(data, |b| f64::from(i32::from_le_bytes(b))),
        "UInt32" => decode(data, |b| f64::from(u32::from_le_bytes(b))),
        "Int16" => decode(data, |b| f64::from(i16::from_le_bytes(b))),
        "UInt16" => decode(data, |b| f64::from(u16::from_le_bytes(b))),
        "Int8" => decode(data, |b: [u8; 1]| f64::from(b[0] as i8)),
        "UInt8" => decode(data, |b: [u8; 1]| f64::from(b[0])),
        other => return Err(bad(format!("arrays of type '{other}' are not known"))),
    })
}

/// Decodes base64 up to the first byte that is not base64. Padding may stand inside, because header and data
/// of compressed arrays are encoded one by one.
fn base64(text: &[u8]) -> Vec<u8> {
    let digit = |b: u8| match b {
        b'A'..=b'Z' => Some(b - b'A'),
        b'a'..=b'z' => Some(b - b'a' + 26),
        b'0'..=b'9' => Some(b - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        b'=' => Some(0),
        _ => None,
    };
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    for quad in text.chunks_exact(4) {
        let mut bits = 0_u32;
        for b in quad {
            let Some(d) = digit(*b) else { return out };
            bits = bits << 6 | u32::from(d);
        }
        let padding = quad.iter().filter(|b| **b == b'=').count();
        out.extend_from_slice(&bits.to_be_bytes()[1..4 - padding.min(2)]);
    }
    out
}

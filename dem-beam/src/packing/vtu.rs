//! Positions and radii from VTU files (VTK's XML format for unstructured grids).
//!
//! Supported: data as text, base64 or raw; in place or appended; 32- or 64-bit headers; zlib blocks or none;
//! little-endian; any kind of number. The crate for the format that was tried does not take raw data, which
//! large files have.

use crate::error::{Error, Result};
use crate::particles::check_spheres;
use nalgebra::Vector3;
use roxmltree::{Document, Node};

/// Names under which radii are searched, in this order.
const NAMES: [&str; 6] = ["radius [m]", "radius", "Radius", "radii", "Radii", "r"];
/// Arrays of a run's frame that hold the displacements of its points and mark its broken bonds.
const STATE: [&str; 2] = ["displacement [m]", "broken [-]"];

/// Reads the points of all pieces as centres \[m\] and a point array as radii \[m\]: the array `radius`, or
/// without a name the first of `radius [m]`, `radius`, `Radius`, `radii`, `Radii` and `r`. It ignores cells,
/// and points that `vtkGhostType` assigns to another piece. A frame of a run has its spheres at rest and
/// their displacements beside them. It is refused if a sphere has moved or a bond is broken, because it would
/// be read as an unbroken body at rest.
///
/// # Errors
/// [`Error::BadFile`] if it is not VTU, [`Error::MissingArray`], [`Error::LengthMismatch`],
/// [`Error::NotAtRest`]; for bad spheres [`Error::NotFinite`], [`Error::BadRadius`], [`Error::RadiusRatio`].
pub fn read_vtu(bytes: &[u8], radius: Option<&str>) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (spheres, state) = spheres(bytes, radius)?;
    state.check()?;
    checked(&spheres)
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

/// Works like [`read_vtu`] on the contents of all pieces of a PVTU file. If all pieces have global numbers
/// (`GlobalIds`), the spheres are sorted by them, as a single file would have them.
///
/// # Errors
/// Errors of [`read_vtu`].
pub fn read_pieces<P: AsRef<[u8]>>(
    pieces: &[P],
    radius: Option<&str>,
) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (mut collected, mut state) = (Vec::new(), State::default());
    for piece in pieces {
        let (spheres, piece_state) = spheres(piece.as_ref(), radius)?;
        collected.extend(spheres);
        state.add(piece_state);
    }
    state.check()?;
    if collected.iter().all(|s| s.number.is_some()) {
        collected.sort_by_key(|s| s.number);
    }
    checked(&collected)
}

/// A sphere read from a point.
struct Sphere {
    /// Global number, if the file has it.
    number: Option<u64>,
    centre: Vector3<f64>,
    radius: f64,
}

/// Displacements and broken bonds of a frame.
#[derive(Debug, Clone, Copy, Default)]
struct State {
    /// Largest displacement \[m\].
    farthest: f64,
    broken: usize,
}

impl State {
    fn add(&mut self, other: Self) {
        self.farthest = self.farthest.max(other.farthest);
        self.broken += other.broken;
    }

    fn check(self) -> Result<()> {
        if self.farthest > 0.0 || self.broken > 0 {
            return Err(Error::NotAtRest {
                farthest: self.farthest,
                broken: self.broken,
            });
        }
        Ok(())
    }
}

fn checked(spheres: &[Sphere]) -> Result<(Vec<Vector3<f64>>, Vec<f64>)> {
    let (positions, radii): (Vec<_>, Vec<_>) = spheres.iter().map(|s| (s.centre, s.radius)).unzip();
    check_spheres(&positions, &radii)?;
    Ok((positions, radii))
}

fn spheres(bytes: &[u8], radius: Option<&str>) -> Result<(Vec<Sphere>, State)> {
    // Appended data need not be XML: the text before them is closed by hand and parsed alone.
    let mark = b"<AppendedData";
    let cut = bytes.windows(mark.len()).position(|w| w == mark);
    let (head, tail) = bytes.split_at(cut.unwrap_or(bytes.len()));
    let mut head = std::str::from_utf8(head)
        .map_err(|_| bad("its head is no UTF-8 text"))?
        .to_owned();
    if cut.is_some() {
        head.push_str("</VTKFile>");
    }
    let xml = Document::parse(&head).map_err(|e| bad(e.to_string()))?;
    let file = Source::new(xml.root_element(), tail)?;
    let (mut out, mut state) = (Vec::new(), State::default());
    for piece in xml.descendants().filter(|n| n.has_tag_name("Piece")) {
        let array = child(piece, "Points").and_then(|p| child(p, "DataArray"));
        let points = file.numbers(array.ok_or_else(|| bad("a piece has no points"))?)?;
        let radii = file.numbers(radius_array(piece, radius)?)?;
        let count = points.len() / 3;
        let point_numbers = |name: &str, what: &'static str| {
            let values = file.numbers_of(piece, "PointData", name)?;
            match values.as_ref().map(Vec::len) {
                Some(found) if found != count => Err(Error::LengthMismatch {
                    what,
                    found,
                    expected: count,
                }),
                _ => Ok(values),
            }
        };
        if points.len() != 3 * radii.len() {
            return Err(Error::LengthMismatch {
                what: "radii",
                found: radii.len(),
                expected: count,
            });
        }
        let moved = file.numbers_of(piece, "PointData", STATE[0])?.unwrap_or_default();
        let broken = file.numbers_of(piece, "CellData", STATE[1])?.unwrap_or_default();
        state.add(State {
            farthest: moved.iter().fold(0.0, |m, x| x.abs().max(m)),
            broken: broken.iter().filter(|b| **b > 0.0).count(),
        });
        let ghosts = point_numbers("vtkGhostType", "ghost types")?;
        let ids = child(piece, "PointData").and_then(|d| d.attribute("GlobalIds"));
        let numbers = ids
            .map(|name| point_numbers(name, "global numbers"))
            .transpose()?
            .flatten();
        for (k, (centre, radius)) in points.chunks_exact(3).zip(radii).enumerate() {
            // The first bit marks a point that another piece owns.
            if ghosts.as_ref().is_some_and(|g| g[k] as u8 & 1 == 1) {
                continue;
            }
            out.push(Sphere {
                number: numbers.as_ref().map(|n| n[k] as u64),
                centre: Vector3::from_column_slice(centre),
                radius,
            });
        }
    }
    Ok((out, state))
}

fn bad(reason: impl Into<String>) -> Error {
    Error::BadFile {
        format: "VTU",
        reason: reason.into(),
    }
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|n| n.has_tag_name(name))
}

fn radius_array<'a>(piece: Node<'a, 'a>, wanted: Option<&str>) -> Result<Node<'a, 'a>> {
    let data = child(piece, "PointData");
    let arrays = || {
        let children = data.iter().flat_map(|d| d.children());
        children.filter(|n| n.has_tag_name("DataArray"))
    };
    let scalar = |n: &Node<'_, '_>| n.attribute("NumberOfComponents").is_none_or(|c| c == "1");
    let named = |name: &str| arrays().find(|n| n.attribute("Name") == Some(name) && scalar(n));
    let array = match wanted {
        Some(name) => named(name),
        None => NAMES.iter().find_map(|n| named(n)),
    };
    array.ok_or_else(|| {
        let have: Vec<&str> = arrays().filter_map(|n| n.attribute("Name")).collect();
        Error::MissingArray {
            wanted: wanted.map_or_else(|| NAMES.join(", "), ToOwned::to_owned),
            found: if have.is_empty() {
                "none".into()
            } else {
                have.join(", ")
            },
        }
    })
}

/// Source of the bytes of arrays.
struct Source<'a> {
    /// Appended bytes behind the mark `_`, with true if they are base64.
    appended: Option<(&'a [u8], bool)>,
    /// Bytes per number in the headers of arrays.
    width: usize,
    zlib: bool,
}

impl<'a> Source<'a> {
    fn new(root: Node<'_, '_>, tail: &'a [u8]) -> Result<Self> {
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
        let mark = |byte: u8| tail.iter().position(|b| *b == byte);
        let appended = mark(b'>').and_then(|end| {
            let base64 = String::from_utf8_lossy(&tail[..end]).contains("base64");
            let start = end + tail[end..].iter().position(|b| *b == b'_')? + 1;
            Some((&tail[start..], base64))
        });
        Ok(Self {
            appended,
            width: match root.attribute("header_type") {
                Some("UInt64") => 8,
                _ => 4,
            },
            zlib,
        })
    }

    /// Reads the numbers of an array.
    fn numbers(&self, array: Node<'_, '_>) -> Result<Vec<f64>> {
        let text = array.text().unwrap_or_default();
        let data = match array.attribute("format") {
            None | Some("ascii") => {
                let numbers = text.split_ascii_whitespace().map(str::parse::<f64>);
                return numbers
                    .collect::<std::result::Result<_, _>>()
                    .map_err(|e| bad(format!("an array of text: {e}")));
            }
            Some("binary") => base64(text.trim().as_bytes()),
            Some("appended") => {
                let offset = array.attribute("offset").and_then(|o| o.parse::<usize>().ok());
                let (appended, encoded) = self.appended.ok_or_else(|| bad("there is no appended data"))?;
                let bytes = offset.and_then(|offset| appended.get(offset..));
                let bytes = bytes.ok_or_else(|| bad("an offset is outside the appended data"))?;
                if encoded { base64(bytes) } else { bytes.to_vec() }
            }
            Some(other) => return Err(bad(format!("the format {other} of an array is not known"))),
        };
        let data = self
            .unpack(&data)
            .ok_or_else(|| bad("an array is cut short or damaged"))?;
        convert(array.attribute("type").unwrap_or_default(), &data)
    }

    /// Reads the array called `name` of the points or cells of a piece, if there is one.
    fn numbers_of(&self, piece: Node<'a, 'a>, data: &str, name: &str) -> Result<Option<Vec<f64>>> {
        let data = child(piece, data);
        let mut arrays = data.iter().flat_map(|d| d.children());
        let array = arrays.find(|n| n.has_tag_name("DataArray") && n.attribute("Name") == Some(name));
        array.map(|array| self.numbers(array)).transpose()
    }

    /// Removes the header and decompresses the data; `None` if they are cut short or damaged.
    fn unpack(&self, data: &[u8]) -> Option<Vec<u8>> {
        // Counts come from the file and may be wrong, so that ranges are checked.
        let count = |k: usize| -> Option<usize> {
            let raw = data.get(k * self.width..(k + 1) * self.width)?;
            usize::try_from(raw.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b))).ok()
        };
        if !self.zlib {
            let end = count(0)?.checked_add(self.width)?;
            return data.get(self.width..end).map(<[u8]>::to_vec);
        }
        // The header holds the number of blocks, their size, the size of the last one if it is smaller, then
        // the compressed size of each.
        let (blocks, size) = (count(0)?, count(1)?);
        let mut start = blocks.checked_add(3)?.checked_mul(self.width)?;
        let mut out = Vec::new();
        for k in 0..blocks {
            let end = start.checked_add(count(3 + k)?)?;
            let block = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(data.get(start..end)?, size);
            out.extend(block.ok()?);
            start = end;
        }
        Some(out)
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

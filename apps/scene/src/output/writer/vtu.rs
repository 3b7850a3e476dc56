//! VTU files: unstructured grids with raw appended data, and the PVD index over time.

use super::{Array, Entry, Picture, Piece, Writer};
use crate::error::Result;
use crate::output::painter::ASLEEP;
use crate::output::{Counted, Fingerprint, put, put_with};
use crate::setup::Grid;
use arlequin::dem_beam::vtu::{CELL_NUMBERS, GHOSTS, POINT_NUMBERS};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;

/// Data type of `POINT_NUMBERS` and `CELL_NUMBERS`: VTK's type of identifiers.
const NUMBER: &str = "Int64\" IdType=\"1";
/// Name of the coordinates.
const POSITION: &str = "position [m]";

/// Values that are converted to bytes at a time.
const BLOCK: usize = 1 << 13;

/// Writes the bytes of an array.
type WriteArray<'a> = Box<dyn FnOnce(&mut Counted<File>, &mut Vec<u8>) -> io::Result<()> + 'a>;

/// Data sections: their description, and the arrays, which become bytes only while they are written.
#[derive(Default)]
struct Appended<'a> {
    xml: String,
    length: usize,
    arrays: Vec<WriteArray<'a>>,
}

impl<'a> Appended<'a> {
    /// Adds an array of `count` items of `N` bytes; `fill` writes those from a number on.
    fn add<const N: usize>(
        &mut self,
        kind: &str,
        name: &str,
        components: usize,
        count: usize,
        fill: impl Fn(usize, &mut [[u8; N]]) + 'a,
    ) {
        let _ = writeln!(
            self.xml,
            "        <DataArray {} format=\"appended\" offset=\"{}\"/>",
            array_attributes(kind, name, components),
            self.length
        );
        // In raw appended data, each array follows its length in 8 bytes.
        self.length += 8 + N * count;
        self.arrays.push(Box::new(move |file, block| {
            file.write_all(&((N * count) as u64).to_le_bytes())?;
            for first in (0..count).step_by(BLOCK) {
                block.resize(N * BLOCK.min(count - first), 0);
                fill(first, block.as_chunks_mut().0);
                file.write_all(block)?;
            }
            Ok(())
        }));
    }

    fn floats(&mut self, array: &'a Array<'_>) {
        let values = &*array.values;
        let (kind, name, count) = (float_kind(array), &array.name, values.len());
        if array.derived {
            self.add(kind, name, array.components, count, move |first, slots| {
                copy(slots, &values[first..], |x| single(*x).to_le_bytes());
            });
        } else {
            self.add(kind, name, array.components, count, move |first, slots| {
                copy(slots, &values[first..], |x| x.to_le_bytes());
            });
        }
    }

    fn numbers(&mut self, name: &str, values: &'a [u32]) {
        let bytes = |k: &u32| i64::from(*k).to_le_bytes();
        self.add(NUMBER, name, 1, values.len(), move |first, slots| {
            copy(slots, &values[first..], bytes);
        });
    }

    fn section(&mut self, name: &str, numbers: Option<&str>, fill: impl FnOnce(&mut Self)) {
        let numbers = global_ids_attribute(numbers);
        let _ = writeln!(self.xml, "      <{name}{numbers}>");
        fill(self);
        let _ = writeln!(self.xml, "      </{name}>");
    }
}

/// Writes the bytes of values into slots.
fn copy<T, const N: usize>(slots: &mut [[u8; N]], values: &[T], bytes: impl Fn(&T) -> [u8; N]) {
    slots.iter_mut().zip(values).for_each(|(to, x)| *to = bytes(x));
}

/// Adds the corners of the cells of a grid, where they end, and their types.
fn cells<'a>(a: &mut Appended<'a>, grid: &'a Grid) {
    let (corners, count) = (&grid.connectivity, grid.cells());
    // Half of the bytes of wider numbers; grids have fewer than 2³¹ corners.
    a.add("Int32", "connectivity", 1, corners.len(), |first, slots| {
        copy(slots, &corners[first..], |k| k.cast_signed().to_le_bytes());
    });
    a.add("Int32", "offsets", 1, count, |first, slots| {
        let ends = (first + 1..).zip(slots);
        ends.for_each(|(k, to)| *to = ((k * grid.corners) as i32).to_le_bytes());
    });
    a.add("UInt8", "types", 1, count, |_, slots| {
        slots.fill([grid.cell_type]);
    });
}

/// Marks in VTK's array of ghosts: what sleeps is not drawn.
const HIDDEN_POINT: u8 = 2;
const HIDDEN_CELL: u8 = 32;

/// Hides points or cells that sleep.
fn hide<'a>(a: &mut Appended<'a>, arrays: &'a [Array<'_>], mark: u8) {
    for x in arrays.iter().filter(|x| x.name == ASLEEP) {
        a.add("UInt8", GHOSTS, 1, x.values.len(), move |first, slots| {
            copy(slots, &x.values[first..], |v| [if *v > 0.0 { mark } else { 0 }]);
        });
    }
}

/// Returns a number in single precision. Beyond its largest number a value would become infinite.
fn single(x: f64) -> f32 {
    x.clamp(f32::MIN.into(), f32::MAX.into()) as f32
}

/// Data type of an array of floating-point numbers.
fn float_kind(array: &Array<'_>) -> &'static str {
    if array.derived { "Float32" } else { "Float64" }
}

/// Returns the attributes of an array: type, name and number of components.
fn array_attributes(kind: &str, name: &str, components: usize) -> String {
    let name = escape(name);
    format!("type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\"")
}

/// Returns the attribute that names the array of global numbers of a section.
fn global_ids_attribute(array: Option<&str>) -> String {
    array.map_or_else(String::new, |name| format!(" GlobalIds=\"{name}\""))
}

/// The format VTU, with PVTU for grids in pieces and a PVD index.
#[derive(Debug)]
pub(super) struct Vtu;

impl Writer for Vtu {
    fn name(&self) -> &'static str {
        "vtu"
    }

    fn endings(&self) -> [&'static str; 2] {
        ["vtu", "pvtu"]
    }

    fn indices(&self) -> &'static [&'static str] {
        &["results.pvd", "results.pvd.tmp"]
    }

    fn write_grid(&self, path: &Path, picture: &Picture<'_>, piece: Option<&Piece>) -> Result<Fingerprint> {
        let (grid, mut a) = (picture.grid, Appended::default());
        a.section("PointData", piece.map(|_| POINT_NUMBERS), |a| {
            picture.points.iter().for_each(|x| a.floats(x));
            hide(a, &picture.points, HIDDEN_POINT);
            if let Some(p) = piece {
                a.numbers(POINT_NUMBERS, &p.points);
                a.add("UInt8", GHOSTS, 1, p.points.len(), |first, slots| {
                    (first..)
                        .zip(slots)
                        .for_each(|(k, to)| *to = [u8::from(k >= p.owned)]);
                });
            }
        });
        a.section("CellData", piece.map(|_| CELL_NUMBERS), |a| {
            picture.cells.iter().for_each(|x| a.floats(x));
            hide(a, &picture.cells, HIDDEN_CELL);
            if let Some(p) = piece {
                a.numbers(CELL_NUMBERS, &p.cells);
            }
        });
        a.section("Points", None, |a| {
            a.add::<24>("Float64", POSITION, 3, grid.points.len(), |first, slots| {
                for (to, x) in slots.iter_mut().zip(&grid.points[first..]) {
                    let coordinates: [[u8; 8]; 3] = [x.x, x.y, x.z].map(f64::to_le_bytes);
                    to.copy_from_slice(coordinates.as_flattened());
                }
            });
        });
        a.section("Cells", None, |a| cells(a, grid));
        let head = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n  <UnstructuredGrid>\n    <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n{}    \
             </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_",
            grid.points.len(),
            grid.cells(),
            a.xml
        );
        put_with(path, |file| {
            file.write_all(head.as_bytes())?;
            let mut block = Vec::new();
            a.arrays
                .into_iter()
                .try_for_each(|write| write(file, &mut block))?;
            file.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
        })
    }

    fn write_pieces(&self, path: &Path, arrays: &[Vec<Array<'_>>; 2], pieces: &[String]) -> Result<()> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n  <PUnstructuredGrid GhostLevel=\"0\">\n",
        );
        let [points, cells] = arrays;
        let float = |a: &Array<'_>| array_attributes(float_kind(a), &a.name, a.components);
        let number = |name: &str| array_attributes(NUMBER, name, 1);
        let point_arrays = [number(POINT_NUMBERS), array_attributes("UInt8", GHOSTS, 1)];
        for (section, name, arrays) in [
            (
                "PPointData",
                Some(POINT_NUMBERS),
                points.iter().map(float).chain(point_arrays).collect(),
            ),
            (
                "PCellData",
                Some(CELL_NUMBERS),
                cells.iter().map(float).chain([number(CELL_NUMBERS)]).collect(),
            ),
            ("PPoints", None, vec![array_attributes("Float64", POSITION, 3)]),
        ] {
            let arrays: Vec<String> = arrays;
            let _ = writeln!(text, "    <{section}{}>", global_ids_attribute(name));
            for array in arrays {
                let _ = writeln!(text, "      <PDataArray {array}/>");
            }
            let _ = writeln!(text, "    </{section}>");
        }
        for piece in pieces {
            let _ = writeln!(text, "    <Piece Source=\"{}\"/>", escape(piece));
        }
        text.push_str("  </PUnstructuredGrid>\n</VTKFile>\n");
        put(path, &[text.as_bytes()])
    }

    fn write_index(&self, path: &Path, entries: &[Entry]) -> Result<()> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n  \
             <Collection>\n",
        );
        for e in entries {
            let _ = writeln!(
                text,
                "    <DataSet timestep=\"{:e}\" part=\"{}\" name=\"{}\" file=\"{}\"/>",
                e.time,
                e.part,
                escape(&e.name),
                escape(&e.file)
            );
        }
        text.push_str("  </Collection>\n</VTKFile>\n");
        // Renaming replaces the index at once, because viewers read it during the run.
        let aside = path.with_extension("pvd.tmp");
        put(&aside, &[text.as_bytes()])?;
        std::fs::rename(&aside, path).map_err(crate::error::write(path))
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::single;

    #[test]
    fn numbers_that_single_precision_does_not_reach_stay_finite() {
        let bits = |x: f32| x.to_bits();
        assert_eq!(
            [1e300, -1e300, 0.1].map(|x| bits(single(x))),
            [f32::MAX, f32::MIN, 0.1].map(bits)
        );
    }
}

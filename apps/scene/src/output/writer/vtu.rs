//! VTU files: unstructured grids with raw appended data, and the PVD index over time.

use super::{Array, Entry, Picture, Piece, Writer};
use crate::error::Result;
use crate::output::put;
use arlequin::dem_beam::vtu::{CELL_NUMBERS, GHOSTS, POINT_NUMBERS};
use std::fmt::Write as _;
use std::path::Path;

/// Data type of `POINT_NUMBERS` and `CELL_NUMBERS`: VTK's type of identifiers.
const NUMBER: &str = "Int64\" IdType=\"1";
/// Name of the coordinates.
const POSITION: &str = "position [m]";

/// One data section and its description.
struct Appended {
    xml: String,
    data: Vec<u8>,
}

impl Appended {
    fn add(&mut self, kind: &str, name: &str, components: usize, bytes: &mut dyn Iterator<Item = u8>) {
        let _ = writeln!(
            self.xml,
            "        <DataArray {} format=\"appended\" offset=\"{}\"/>",
            array_attributes(kind, name, components),
            self.data.len()
        );
        // In raw appended data, each array follows its length in 8 bytes.
        let start = self.data.len();
        self.data.extend(0u64.to_le_bytes());
        self.data.extend(bytes);
        let size = (self.data.len() - start - 8) as u64;
        self.data[start..start + 8].copy_from_slice(&size.to_le_bytes());
    }

    fn floats(&mut self, name: &str, components: usize, values: impl Iterator<Item = f64>) {
        self.add(
            "Float64",
            name,
            components,
            &mut values.flat_map(f64::to_le_bytes),
        );
    }

    fn numbers(&mut self, name: &str, values: impl Iterator<Item = i64>) {
        self.add(NUMBER, name, 1, &mut values.flat_map(i64::to_le_bytes));
    }

    fn section(&mut self, name: &str, numbers: Option<&str>, fill: impl FnOnce(&mut Self)) {
        let numbers = global_ids_attribute(numbers);
        let _ = writeln!(self.xml, "      <{name}{numbers}>");
        fill(self);
        let _ = writeln!(self.xml, "      </{name}>");
    }
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

    fn write_grid(&self, path: &Path, picture: &Picture<'_>, piece: Option<&Piece>) -> Result<()> {
        let grid = picture.grid;
        let mut a = Appended {
            xml: String::new(),
            data: Vec::new(),
        };
        let arrays = |a: &mut Appended, list: &[Array]| {
            for x in list {
                a.floats(&x.name, x.components, x.values.iter().copied());
            }
        };
        a.section("PointData", piece.map(|_| POINT_NUMBERS), |a| {
            arrays(a, &picture.points);
            if let Some(p) = piece {
                a.numbers(POINT_NUMBERS, p.points.iter().map(|k| i64::from(*k)));
                let ghosts = (0..p.points.len()).map(|k| u8::from(k >= p.owned));
                a.add("UInt8", GHOSTS, 1, &mut { ghosts });
            }
        });
        a.section("CellData", piece.map(|_| CELL_NUMBERS), |a| {
            arrays(a, &picture.cells);
            if let Some(p) = piece {
                a.numbers(CELL_NUMBERS, p.cells.iter().map(|k| i64::from(*k)));
            }
        });
        a.section("Points", None, |a| {
            a.floats(POSITION, 3, grid.points.iter().flat_map(|p| [p.x, p.y, p.z]));
        });
        a.section("Cells", None, |a| {
            let corners = grid.connectivity.iter();
            a.add(
                "Int64",
                "connectivity",
                1,
                &mut corners.flat_map(|k| i64::from(*k).to_le_bytes()),
            );
            let ends = (1..=grid.cells()).map(|k| (k * grid.corners) as i64);
            a.add("Int64", "offsets", 1, &mut ends.flat_map(i64::to_le_bytes));
            a.add(
                "UInt8",
                "types",
                1,
                &mut std::iter::repeat_n(grid.cell_type, grid.cells()),
            );
        });
        let head = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n  <UnstructuredGrid>\n    <Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n{}    \
             </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_",
            grid.points.len(),
            grid.cells(),
            a.xml
        );
        let tail = b"\n  </AppendedData>\n</VTKFile>\n";
        put(path, &[head.as_bytes(), &a.data, tail])
    }

    fn write_pieces(&self, path: &Path, arrays: &[Vec<Array>; 2], pieces: &[String]) -> Result<()> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n  <PUnstructuredGrid GhostLevel=\"0\">\n",
        );
        let [points, cells] = arrays;
        let float = |a: &Array| array_attributes("Float64", &a.name, a.components);
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

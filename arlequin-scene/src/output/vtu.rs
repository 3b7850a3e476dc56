//! VTU files: unstructured grids with raw appended data, and the PVD index over time.

use super::put;
use crate::error::Result;
use crate::setup::Grid;
use std::fmt::Write as _;
use std::path::Path;

/// A named array with values per point or cell.
#[derive(Debug, Clone)]
pub struct Array {
    /// Name with unit.
    pub name: String,
    /// Values per point or cell: 1 or 3.
    pub components: usize,
    /// Values.
    pub values: Vec<f64>,
}

/// One data section and its description.
struct Appended {
    xml: String,
    data: Vec<u8>,
}

impl Appended {
    fn add(&mut self, kind: &str, name: &str, components: usize, bytes: &mut dyn Iterator<Item = u8>) {
        let _ = writeln!(
            self.xml,
            "        <DataArray type=\"{kind}\" Name=\"{}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{}\"/>",
            escape(name),
            self.data.len()
        );
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

    fn section(&mut self, name: &str, fill: impl FnOnce(&mut Self)) {
        let _ = writeln!(self.xml, "      <{name}>");
        fill(self);
        let _ = writeln!(self.xml, "      </{name}>");
    }
}

/// Writes one grid.
pub(super) fn write_grid(path: &Path, grid: &Grid, points: &[Array], cells: &[Array]) -> Result<()> {
    let mut a = Appended {
        xml: String::new(),
        data: Vec::new(),
    };
    let arrays = |a: &mut Appended, list: &[Array]| {
        for x in list {
            a.floats(&x.name, x.components, x.values.iter().copied());
        }
    };
    a.section("PointData", |a| arrays(a, points));
    a.section("CellData", |a| arrays(a, cells));
    a.section("Points", |a| {
        a.floats(
            "position [m]",
            3,
            grid.points.iter().flat_map(|p| [p.x, p.y, p.z]),
        );
    });
    a.section("Cells", |a| {
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

/// One file of the index.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Entry {
    /// Time \[s\].
    pub time: f64,
    /// Index of the model or mediator.
    pub part: usize,
    /// Its name.
    pub name: String,
    /// Path relative to the index.
    pub file: String,
}

/// Writes the index.
pub(super) fn write_index(path: &Path, entries: &[Entry]) -> Result<()> {
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
    // Whole at any moment: viewers read it while the run goes on.
    let aside = path.with_extension("pvd.tmp");
    put(&aside, &[text.as_bytes()])?;
    std::fs::rename(&aside, path).map_err(crate::error::write(path))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

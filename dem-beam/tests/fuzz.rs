//! The readers of surfaces and spheres on mutated files.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use dem_beam::Surface;
use dem_beam::packing::{pieces_of_pvtu, read_csv, read_vtu};
use reader_fuzz::Corpus;

reader_fuzz::counted!();

fn corpus(ending: &str, tokens: &'static [&'static str]) -> Corpus {
    Corpus {
        seeds: Corpus::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus"), ending),
        tokens,
        floor: 4 << 20,
        per_byte: 2000,
    }
}

#[test]
fn mutated_csv_is_read_or_refused() {
    let _alone = ALONE.lock();
    let tokens = &[
        "x,y,z,r\n",
        ",",
        ";",
        "\t",
        "1e-3",
        "-",
        "#",
        "\r\n",
        "\u{feff}",
        "NaN",
    ];
    corpus("csv", tokens).run("csv", &allocated, &|mut bytes| read_csv(&mut bytes).is_ok());
}

#[test]
fn mutated_stl_is_read_or_refused() {
    let _alone = ALONE.lock();
    let tokens = &[
        "solid ",
        "facet normal 0 0 1\n",
        "outer loop\n",
        "vertex 0 0 1\n",
        "endloop\n",
        "endfacet\n",
        "endsolid\n",
    ];
    corpus("stl", tokens).run("stl", &allocated, &|bytes| Surface::from_stl(bytes).is_ok());
}

#[test]
fn a_binary_stl_that_announces_too_much_is_refused_before_memory_is_taken() {
    let _alone = ALONE.lock();
    let mut file = vec![b' '; 80];
    file.extend(u32::MAX.to_le_bytes());
    file.resize(84 + 50 * 4, 0);
    let before = allocated();
    let error = Surface::from_stl(&file).unwrap_err().to_string();
    let used = allocated() - before;
    assert!(used < 1 << 20, "{used} bytes for '{error}'");
}

#[test]
fn issue_7_vtu_without_points_is_refused() {
    let _alone = ALONE.lock();
    let error = read_vtu(include_bytes!("corpus/no-points.vtu"), None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("a piece has no points"), "{error}");
}

#[test]
fn mutated_vtu_is_read_or_refused() {
    let _alone = ALONE.lock();
    let tokens = &[
        "<Piece NumberOfPoints=\"2\" NumberOfCells=\"0\">",
        "</Piece>",
        "<PointData>",
        "</PointData>",
        "<DataArray type=\"Float64\" Name=\"radius\" format=\"ascii\">",
        "</DataArray>",
        "<AppendedData encoding=\"raw\">_",
        "format=\"appended\" offset=\"0\"",
        "format=\"binary\"",
        "NumberOfComponents=\"3\"",
        "Float32",
        "Int64",
        "UInt8",
        "vtkGhostType",
        "PointData GlobalIds=\"r\"",
        "PUnstructuredGrid",
        "Piece Source=\"\"",
    ];
    corpus("vtu", tokens).run("vtu", &allocated, &|bytes| {
        pieces_of_pvtu(bytes).is_ok() || read_vtu(bytes, None).is_ok()
    });
}

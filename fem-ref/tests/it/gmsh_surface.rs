//! Surfaces in Gmsh files: of solids, and of surface meshes.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use approx::assert_abs_diff_eq;
use fem_ref::gmsh::{Triangles, load_surface};

const NODES: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n";

fn read(name: &str, elements: &str) -> Result<Triangles, fem_ref::Error> {
    let path = std::env::temp_dir().join(format!("fem-ref-{}-{name}.msh", std::process::id()));
    std::fs::write(&path, format!("{NODES}$Elements\n{elements}$EndElements\n")).unwrap();
    let loaded = load_surface(&path);
    std::fs::remove_file(&path).unwrap();
    loaded
}

/// Returns the enclosed volume by the divergence theorem.
fn volume(t: &Triangles) -> f64 {
    let position = |i: u32| t.points[i as usize].coords;
    let piece = |&[a, b, c]: &[u32; 3]| position(a).dot(&position(b).cross(&position(c))) / 6.0;
    t.triangles.iter().map(piece).sum()
}

#[test]
fn solids_and_surface_meshes() {
    let solid = read("solid", "1 1 1 1\n3 1 4 1\n1 1 2 3 4\n").unwrap();
    assert_eq!(solid.triangles.len(), 4);
    assert_abs_diff_eq!(volume(&solid), 1.0 / 6.0, epsilon = 1e-15);
    let faces = "1 4 1 4\n2 1 2 4\n1 1 3 2\n2 1 2 4\n3 2 3 4\n4 1 4 3\n";
    let surface = read("faces", faces).unwrap();
    assert_eq!(surface.triangles.len(), 4);
    assert_abs_diff_eq!(volume(&surface), 1.0 / 6.0, epsilon = 1e-15);
    let text = read("line", "1 1 1 1\n1 1 1 1\n1 1 2\n").unwrap_err().to_string();
    assert!(
        text.contains("there is no Tri3, Qua4, Tet4 or Hex8 element"),
        "{text}"
    );
}

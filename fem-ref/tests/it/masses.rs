//! Lumped masses are the integrals of the shape functions; node tags of a file are unique.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use arlequin_core::nalgebra::Point3;
use arlequin_core::{Model, Uniform};
use fem_ref::{Elastic, ElementKind, FemModel, generate, gmsh};

fn masses(model: &FemModel<f64>) -> Vec<f64> {
    let mut m = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut m).unwrap();
    m.into_iter().step_by(3).collect()
}

/// The lumped masses of a hexahedron whose section grows from 1 to 3 m² along x are `∫ N dV`: 5/24 m³ at each
/// of the four corners of the small end and 7/24 m³ at those of the large one, not an eighth of the 2 m³ at
/// each.
#[test]
fn the_lumped_mass_of_a_wedge_shaped_hexahedron_is_the_integral_of_its_shape_functions() {
    let block = generate::block(
        ElementKind::Hex8,
        Point3::origin(),
        Point3::new(1.0, 1.0, 1.0),
        [1, 1, 1],
    )
    .unwrap();
    let wedge = block
        .mapped(|p: &Point3<f64>| Point3::new(p.x, p.y * (1.0 + 2.0 * p.x), p.z))
        .unwrap();
    let model = FemModel::new("wedge", wedge, Elastic::new(1.0, 0.0, 24.0).unwrap()).unwrap();
    for (x, m) in model.nodes().iter().zip(masses(&model)) {
        let expected = if x.x < 0.5 { 5.0 } else { 7.0 };
        assert!((m - expected).abs() < 1e-13, "at {x}: {m}, not {expected}");
    }
}

/// Two tetrahedra in two blocks; the second block repeats a tag of the first.
const REPEATED: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n\
    $Nodes\n2 5 1 5\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 2 0 1\n5\n1 1 1\n$EndNodes\n\
    $Elements\n1 2 1 2\n3 1 4 2\n1 1 2 3 4\n2 2 3 4 5\n$EndElements\n";

#[test]
fn a_node_tag_that_occurs_twice_in_a_file_is_refused_by_name() {
    assert!(gmsh::parse::<f64>(REPEATED.as_bytes()).is_ok());
    // In another block, where the second place would silently win.
    let across = REPEATED
        .replace("3 2 0 1\n5\n", "3 2 0 1\n2\n")
        .replace("2 2 3 4 5", "2 2 3 4 2");
    let error = gmsh::parse::<f64>(across.as_bytes()).unwrap_err().to_string();
    assert_eq!(error, "Gmsh mesh: node tag 2 occurs twice; renumber the mesh");
    // In the same block.
    let within = REPEATED.replace("1\n2\n3\n4\n0 0 0", "1\n2\n3\n3\n0 0 0");
    let error = gmsh::parse::<f64>(within.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("repeats a node tag; renumber the mesh"), "{error}");
}

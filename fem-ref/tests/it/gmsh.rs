//! Gmsh 4.1 (2.2 is in `formats.rs`): ascii and binary, physical groups, broken and unsupported files.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "a test fails by panicking and may compare exact values"
)]

use approx::assert_abs_diff_eq;
use arlequin_core::nalgebra::Point3;
use fem_ref::{ElementKind, Error, Mesh, gmsh};

/// Two tetrahedra with a common face, "clamp" and "load" on two triangles, the volume named "body", a
/// nameless point. Node tags are dense but not in order, as Gmsh writes them after a renumbering.
const TETS: &str = r#"$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
2 1 "clamp"
2 2 "load side"
3 7 "body"
$EndPhysicalNames
$Entities
1 0 2 1
1 0 0 0 1 9
1 0 0 0 1 1 0 1 1 0
2 0 0 0 1 1 1 1 -2 0
1 0 0 0 1 1 1 1 7 0
$EndEntities
$Nodes
2 5 1 5
0 1 0 1
5
0 0 0
3 1 0 4
1
4
2
3
1 0 0
1 1 1
0 1 0
0 0 1
$EndNodes
$Elements
4 5 1 5
0 1 15 1
1 5
2 1 2 1
2 5 2 1
2 2 2 1
3 1 2 4
3 1 4 2
4 5 1 2 3
5 1 2 3 4
$EndElements
"#;

fn positions(mesh: &Mesh<f64>, nodes: &[usize]) -> Vec<[i32; 3]> {
    let mut out: Vec<[i32; 3]> = nodes
        .iter()
        .map(|&k| {
            let p = mesh.nodes()[k];
            [p.x as i32, p.y as i32, p.z as i32]
        })
        .collect();
    out.sort_unstable();
    out
}

fn check_tets(mesh: &Mesh<f64>) {
    assert_eq!((mesh.kind(), mesh.element_count()), (ElementKind::Tet4, 2));
    assert_abs_diff_eq!(mesh.volume(), 0.5, epsilon = 1e-15);
    let names: Vec<&str> = mesh.groups().keys().map(String::as_str).collect();
    assert_eq!(names, ["body", "clamp", "load side", "point-9"]);
    let clamp = mesh.surface("clamp").unwrap();
    assert!((clamp[0].area() - 0.5).abs() < 1e-15 && clamp[0].normal.z < -0.999);
    let load = mesh.surface("load side").unwrap();
    assert_eq!(positions(mesh, &load[0].nodes), [[0, 1, 0], [1, 0, 0], [1, 1, 1]]);
    assert_eq!(
        positions(mesh, &mesh.group_nodes("point-9").unwrap()),
        [[0, 0, 0]]
    );
    assert_eq!(mesh.group_nodes("body").unwrap().len(), 5);
}

#[test]
fn ascii_tetrahedra_with_physical_groups() {
    check_tets(&gmsh::parse(TETS.as_bytes()).unwrap());
    let windows = TETS.replace('\n', "\r\n");
    check_tets(&gmsh::parse(windows.as_bytes()).unwrap());
}

/// Returns the mesh of [`TETS`] in binary, in either byte order.
fn binary(big: bool) -> Vec<u8> {
    let int = |v: i32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let size = |v: u64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let real = |v: f64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let mut out = Vec::new();
    out.extend(b"$MeshFormat\n4.1 1 8\n");
    out.extend(int(1));
    out.extend(b"\n$EndMeshFormat\n");
    let names = TETS.find("$PhysicalNames").unwrap()..TETS.find("$Entities").unwrap();
    out.extend(TETS[names].as_bytes());
    out.extend(b"$Entities\n");
    [1, 0, 2, 1].iter().for_each(|n| out.extend(size(*n)));
    let entity = |out: &mut Vec<u8>, tag: i32, bounds: usize, physical: i32| {
        out.extend(int(tag));
        (0..bounds).for_each(|_| out.extend(real(0.0)));
        out.extend(size(1));
        out.extend(int(physical));
        if bounds == 6 {
            out.extend(size(0));
        }
    };
    entity(&mut out, 1, 3, 9);
    entity(&mut out, 1, 6, 1);
    entity(&mut out, 2, 6, -2);
    entity(&mut out, 1, 6, 7);
    out.extend(b"\n$EndEntities\n$Nodes\n");
    [2, 5, 1, 5].iter().for_each(|n| out.extend(size(*n)));
    [0, 1, 0].iter().for_each(|n| out.extend(int(*n)));
    [1, 5].iter().for_each(|n| out.extend(size(*n)));
    [0.0, 0.0, 0.0].iter().for_each(|x| out.extend(real(*x)));
    [3, 1, 0].iter().for_each(|n| out.extend(int(*n)));
    [4, 1, 4, 2, 3].iter().for_each(|n| out.extend(size(*n)));
    [1., 0., 0., 1., 1., 1., 0., 1., 0., 0., 0., 1.]
        .iter()
        .for_each(|x| out.extend(real(*x)));
    out.extend(b"\n$EndNodes\n$Elements\n");
    [4, 5, 1, 5].iter().for_each(|n| out.extend(size(*n)));
    let block = |out: &mut Vec<u8>, head: [i32; 3], count: u64, data: &[u64]| {
        head.iter().for_each(|n| out.extend(int(*n)));
        out.extend(size(count));
        data.iter().for_each(|n| out.extend(size(*n)));
    };
    block(&mut out, [0, 1, 15], 1, &[1, 5]);
    block(&mut out, [2, 1, 2], 1, &[2, 5, 2, 1]);
    block(&mut out, [2, 2, 2], 1, &[3, 1, 2, 4]);
    block(&mut out, [3, 1, 4], 2, &[4, 5, 1, 2, 3, 5, 1, 2, 3, 4]);
    out.extend(b"\n$EndElements\n");
    out
}

#[test]
fn binary_tetrahedra_in_both_byte_orders() {
    check_tets(&gmsh::parse(&binary(false)).unwrap());
    check_tets(&gmsh::parse(&binary(true)).unwrap());
}

#[test]
fn hexahedra_and_bars() {
    let hex = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 8 10 80\n3 1 0 8\n10\n20\n30\n40\n50\n60\n70\n80\n\
               0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n$EndNodes\n\
               $Elements\n1 1 1 1\n3 1 5 1\n1 10 20 30 40 50 60 70 80\n$EndElements\n";
    let mesh: Mesh<f64> = gmsh::parse(hex.as_bytes()).unwrap();
    assert_eq!((mesh.kind(), mesh.groups().len()), (ElementKind::Hex8, 0));
    assert_abs_diff_eq!(mesh.volume(), 1.0, epsilon = 1e-15);
    let bars = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n0 3 \"end\"\n$EndPhysicalNames\n\
                $Entities\n1 1 0 0\n2 2 0 0 1 3\n1 0 0 0 2 0 0 0 0\n$EndEntities\n\
                $Nodes\n1 3 1 3\n1 1 0 3\n1\n2\n3\n0 0 0\n2 0 0\n1 0 0\n$EndNodes\n\
                $Elements\n2 3 1 3\n0 2 15 1\n1 2\n1 1 1 2\n2 1 3\n3 3 2\n$EndElements\n";
    let mesh: Mesh<f64> = gmsh::parse(bars.as_bytes()).unwrap();
    assert_eq!((mesh.kind(), mesh.element_count()), (ElementKind::Bar2, 2));
    let end = &mesh.surface("end").unwrap()[0];
    assert_eq!((end.centre, end.normal.x), (Point3::new(2.0, 0.0, 0.0), 1.0));
}

#[test]
fn renumbering_keeps_the_mesh_and_brings_neighbours_together() {
    let bar: Vec<_> = [0, 5, 1, 4, 2, 3]
        .map(|x| Point3::new(f64::from(x), 0.0, 0.0))
        .to_vec();
    let mesh = Mesh::new(ElementKind::Bar2, bar, vec![0, 2, 2, 4, 4, 5, 5, 3, 3, 1]).unwrap();
    let mesh = mesh.with_nodes("right", |p| p.x > 3.5).unwrap().renumbered();
    assert!((0..5).all(|e| mesh.element(e)[0].abs_diff(mesh.element(e)[1]) == 1));
    assert_eq!(
        positions(&mesh, &mesh.group_nodes("right").unwrap()),
        [[4, 0, 0], [5, 0, 0]]
    );
}

fn text(content: &str) -> String {
    gmsh::parse::<f64>(content.as_bytes()).unwrap_err().to_string()
}

#[test]
fn broken_and_unsupported_files() {
    assert_eq!(
        text("solid cube"),
        "Gmsh mesh: the file does not start with $MeshFormat; is it a .msh file?"
    );
    assert_eq!(
        text(&TETS.replace("4.1 0 8", "4.0 0 8")),
        "Gmsh mesh: format 4.0 is not supported; save in 4.1 (Mesh.MshFileVersion = 4.1)"
    );
    assert_eq!(
        text(&TETS.replace("4.1 0 8", "4.1 0 3")),
        "Gmsh mesh: size 3 of integers is not supported; use 4 or 8"
    );
    assert_eq!(
        text(&TETS.replace("Nodes", "Knots")),
        "Gmsh mesh: there is no $Nodes section; the mesh has no nodes"
    );
    assert_eq!(
        text(&TETS.replace("4 5 1 5", "4 0 1 5")),
        "Gmsh mesh: section $Elements is empty; mesh the geometry before saving"
    );
    assert_eq!(
        text(&TETS.replace("1 1 1\n0 1 0\n", "1 1 what\n0 1 0\n")),
        "Gmsh mesh: a section is broken: node section: node entity block (2 of 2): node coordinates: An invalid node \
         definition was encountered.: z coordinate; save the mesh again in format 4.1"
    );
    assert_eq!(
        text(&TETS.replace("3 7 \"body\"", "3 body")),
        "Gmsh mesh: $PhysicalNames holds the broken line '3 body'"
    );
    assert_eq!(
        text(&TETS.replace("4 5 1 2 3\n", "4 5 1 2 8\n")),
        "Gmsh mesh: element 4 refers to node 8, which is not in $Nodes"
    );
    assert_eq!(
        text(&TETS.replace("1\n4\n2\n3\n1 0 0", "1\n4\n2\n2\n1 0 0")),
        "Gmsh mesh: a block of 4 nodes on entity 1 repeats a node tag; renumber the mesh"
    );
    assert_eq!(
        text(&TETS.replace("3 1 4 2\n4 5 1 2 3\n5 1 2 3 4", "3 1 6 1\n4 5 1 2 3 4 4")),
        "Gmsh mesh: 1 elements of type Pri6 are not supported; use Lin2, Tet4 or Hex8 of first order"
    );
    assert_eq!(
        text(
            &TETS
                .replace(
                    "3 1 4 2\n4 5 1 2 3\n5 1 2 3 4",
                    "3 1 4 1\n4 5 1 2 3\n3 1 5 1\n5 1 2 3 4 5 1 2 3"
                )
                .replace("4 5 1 5\n0 1 15", "5 5 1 5\n0 1 15")
        ),
        "Gmsh mesh: 1 Tet4 and 1 Hex8 elements are mixed; mesh all volumes with one kind"
    );
    assert_eq!(
        text(
            &TETS
                .replace("3 1 4 2\n4 5 1 2 3\n5 1 2 3 4\n", "")
                .replace("4 5 1 5\n0 1 15", "3 3 1 3\n0 1 15")
        ),
        "Gmsh mesh: 2 Tri3 and Qua4 elements bound no volume; mesh in three dimensions"
    );
    // Checks of the mesh itself apply to imported meshes too.
    let e = gmsh::parse::<f64>(TETS.replace("4 5 1 2 3\n", "4 1 5 2 3\n").as_bytes()).unwrap_err();
    assert!(matches!(e, Error::InvertedElement { .. }), "{e}");
    let e = gmsh::load::<f64>("no/such/file.msh").unwrap_err().to_string();
    assert!(
        e.starts_with("mesh file 'no/such/file.msh' cannot be read: "),
        "{e}"
    );
}

#[test]
fn truncated_files_are_errors_not_panics() {
    for bytes in [TETS.as_bytes().to_vec(), binary(false)] {
        for n in (0..bytes.len() - 14).step_by(3) {
            assert!(gmsh::parse::<f64>(&bytes[..n]).is_err(), "{n}");
        }
    }
}

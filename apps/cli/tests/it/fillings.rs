//! Particles that fill bodies from files, and particles read from files.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::common::{arlequin, number, scratch, succeed, summary, text};
use std::fmt::Write as _;
use std::path::Path;

fn write_scene(folder: &Path, name: &str, body: &str) -> String {
    let path = folder.join(name);
    let material = "material = { young = 72.5e9, poisson = 0.17, density = 2200.0 }\n\
        [time]\nsteps = 4\n[output]\nevery = 4\nplots = false\n";
    std::fs::write(&path, format!("[model.body]\nkind = \"dem\"\n{body}\n{material}")).unwrap();
    text(&path).to_owned()
}

/// Nodes and outward triangles of a box with edges `a`.
fn block(a: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let corner = |i: usize| {
        [
            (i & 1) as f64 * a[0],
            (i >> 1 & 1) as f64 * a[1],
            (i >> 2) as f64 * a[2],
        ]
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let cut = |q: [usize; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]];
    (
        (0..8).map(corner).collect(),
        quads.into_iter().flat_map(cut).collect(),
    )
}

fn stl(nodes: &[[f64; 3]], triangles: &[[usize; 3]]) -> String {
    let mut out = String::from("solid block\n");
    for t in triangles {
        out.push_str("facet normal 0 0 0\nouter loop\n");
        for &i in t {
            writeln!(
                out,
                "vertex {:e} {:e} {:e}",
                nodes[i][0], nodes[i][1], nodes[i][2]
            )
            .unwrap();
        }
        out.push_str("endloop\nendfacet\n");
    }
    out + "endsolid block\n"
}

/// Text of a Gmsh surface mesh; the last two triangles are the physical surface `pulled`.
fn msh(nodes: &[[f64; 3]], triangles: &[[usize; 3]]) -> String {
    let mut out = String::from(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 7 \"pulled\"\n$EndPhysicalNames\n\
         $Entities\n0 0 2 0\n1 0 0 0 1 1 1 0 0\n2 0 0 0 1 1 1 1 7 0\n$EndEntities\n",
    );
    writeln!(out, "$Nodes\n1 {0} 1 {0}\n2 1 0 {0}", nodes.len()).unwrap();
    (1..=nodes.len()).for_each(|k| writeln!(out, "{k}").unwrap());
    for n in nodes {
        writeln!(out, "{:e} {:e} {:e}", n[0], n[1], n[2]).unwrap();
    }
    let second_count = triangles.len() - 2;
    writeln!(out, "$EndNodes\n$Elements\n2 {0} 1 {0}", triangles.len()).unwrap();
    for (k, t) in triangles.iter().enumerate() {
        if k == 0 {
            writeln!(out, "2 1 2 {second_count}").unwrap();
        } else if k == second_count {
            writeln!(out, "2 2 2 2").unwrap();
        }
        writeln!(out, "{} {} {} {}", k + 1, t[0] + 1, t[1] + 1, t[2] + 1).unwrap();
    }
    out + "$EndElements\n"
}

#[test]
fn surfaces_in_files_are_filled() {
    let folder = scratch("fillings-surfaces");
    let (nodes, triangles) = block([4e-3, 2e-3, 2e-3]);
    std::fs::write(folder.join("block.stl"), stl(&nodes, &triangles)).unwrap();
    std::fs::write(folder.join("block.msh"), msh(&nodes, &triangles)).unwrap();
    let dem = "dem = { count = 400, protocol = \"quench\" }";
    for file in ["block.stl", "block.msh"] {
        let scene = write_scene(&folder, "scene.toml", &format!("shape.file = \"{file}\"\n{dem}"));
        succeed(&["check", &scene, "--json"]);
    }
    // The physical surface of the mesh is first held and then pulled.
    let held = "[[support]]\nmodel = \"body\"\nwhere = \"pulled\"\n";
    let scene = write_scene(
        &folder,
        "held.toml",
        &format!("shape.file = \"block.msh\"\n{dem}"),
    );
    std::fs::write(&scene, std::fs::read_to_string(&scene).unwrap() + held).unwrap();
    succeed(&["check", &scene]);
    let open = stl(&nodes, &triangles[1..]);
    std::fs::write(folder.join("block.stl"), open).unwrap();
    let scene = write_scene(
        &folder,
        "open.toml",
        &format!("shape.file = \"block.stl\"\n{dem}"),
    );
    let out = arlequin(&["check", &scene]);
    let message = String::from_utf8_lossy(&out.stderr);
    assert!(
        out.status.code() == Some(2) && message.contains("the surface is not closed"),
        "{message}"
    );
}

#[test]
fn a_written_frame_is_read_back() {
    let folder = scratch("fillings-frame");
    let shape = "shape.cylinder = { from = [1e-3, 2e-3, 0.0], length = 4e-3, radius = 1e-3 }";
    let first = write_scene(
        &folder,
        "first.toml",
        &format!("{shape}\ndem = {{ count = 400, protocol = \"quench\" }}"),
    );
    let out = folder.join("first");
    succeed(&["run", &first, "--out", text(&out)]);
    let nodes = |p: &Path| number(&summary(p), "/models/0/nodes");
    let step = |p: &Path| number(&summary(p), "/models/0/critical_dt");
    let file = "dem.file = \"first/vtu/body_00000000.vtu\"";
    let second = write_scene(&folder, "second.toml", &format!("{shape}\n{file}"));
    let twin = folder.join("second");
    succeed(&["run", &second, "--out", text(&twin)]);
    assert!((nodes(&out) - nodes(&twin)).abs() < 0.5);
    // z counts only the retained spheres here, so a few bonds are missing: nearly the same body.
    assert!((step(&twin) / step(&out) - 1.0).abs() < 0.02);
}

/// Issue 26, D.6: a late frame is refused as a packing, because its spheres have moved and bonds are broken.
#[test]
fn a_frame_whose_spheres_have_moved_is_refused() {
    let folder = scratch("fillings-late-frame");
    let shape = "shape.cylinder = { from = [1e-3, 2e-3, 0.0], length = 4e-3, radius = 1e-3 }";
    let first = write_scene(
        &folder,
        "first.toml",
        &format!("{shape}\ndem = {{ count = 400, protocol = \"quench\" }}"),
    );
    let pulled = std::fs::read_to_string(&first).unwrap()
        + "[[initial]]\nvelocity.polynomial = { component = \"x\", along = \"x\", coefficients = [0.0, 1e6] }\n\
           [[effect]]\nfracture = { criterion = \"axial\", strength = 1e6 }\n";
    std::fs::write(&first, pulled).unwrap();
    succeed(&["run", &first, "--out", text(&folder.join("first"))]);
    let read = |step: &str| {
        let file = format!("dem.file = \"first/vtu/body_0000000{step}.vtu\"");
        arlequin(&[
            "check",
            &write_scene(&folder, "second.toml", &format!("{shape}\n{file}")),
        ])
    };
    assert!(read("0").status.success());
    let late = read("4");
    let stderr = String::from_utf8_lossy(&late.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    assert_eq!(late.status.code(), Some(2), "{stderr}");
    assert!(
        stderr.contains("spheres have moved by up to") && stderr.contains("bonds are broken"),
        "{stderr}"
    );
    assert!(
        !stderr.contains(" 0 bonds are broken") && stderr.contains("arlequin resume"),
        "{stderr}"
    );
}

#[test]
fn bad_particle_files_are_named() {
    let folder = scratch("fillings-bad");
    let shape = "shape.box = { low = [0.0, 0.0, 0.0], high = [4e-3, 2e-3, 2e-3] }";
    std::fs::write(
        folder.join("apart.csv"),
        "x,y,z,r\n1e-3,1e-3,1e-3,5e-4\n3.9e-3,1e-3,1e-3,5e-4\n",
    )
    .unwrap();
    std::fs::write(folder.join("nan.csv"), "1e-3,NaN,1e-3,5e-4\n").unwrap();
    std::fs::write(folder.join("none.vtu"), "no XML").unwrap();
    std::fs::write(folder.join("what.xyz"), "").unwrap();
    let cases = [
        ("file = \"apart.csv\"", "particle 1 sticks out of the container"),
        ("file = \"nan.csv\"", "coordinate of particle 0 is NaN"),
        ("file = \"none.vtu\"", "this is no VTU file that can be read"),
        ("file = \"what.xyz\"", "spheres are read from CSV"),
        ("file = \"missing.csv\"", "cannot read"),
        ("file = \"nan.csv\", seed = 3", "dem.file brings its own spheres"),
    ];
    for (dem, wanted) in cases {
        let scene = write_scene(&folder, "scene.toml", &format!("{shape}\ndem = {{ {dem} }}"));
        let out = arlequin(&["check", &scene]);
        let message = String::from_utf8_lossy(&out.stderr);
        assert!(
            out.status.code() == Some(2) && message.contains(wanted),
            "{dem}: {message}"
        );
    }
}

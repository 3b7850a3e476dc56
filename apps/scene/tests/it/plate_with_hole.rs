//! The stress at the edge of a hole in a plate against Howland's solution.
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

use arlequin_scene::{Scene, Silent};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Half width of the plate \[m\].
const HALF: f64 = 5e-3;
/// Half length \[m\].
const LENGTH: f64 = 10e-3;
/// Radius of the hole \[m\].
const RADIUS: f64 = 1e-3;
/// Thickness \[m\].
const THICK: f64 = 0.5e-3;
/// Elements along a quarter of the hole.
const AROUND: usize = 32;
/// Elements from the hole to the sides of the square around it.
const AWAY: usize = 28;
/// Elements beyond the square.
const BEYOND: usize = 10;
/// Elements through the thickness.
const LAYERS: usize = 2;

/// Returns nodes and hexahedra of a quarter of the plate: rays from the hole to the sides of a square, and a
/// block beyond the square.
fn mesh() -> (Vec<[f64; 3]>, Vec<[usize; 8]>) {
    let mut nodes = Vec::new();
    let layer = |nodes: &mut Vec<[f64; 3]>, z: f64| {
        for i in 0..=AROUND {
            let angle = std::f64::consts::FRAC_PI_2 * i as f64 / AROUND as f64;
            let (s, c) = angle.sin_cos();
            let far = if 2 * i <= AROUND {
                [HALF, HALF * s / c]
            } else {
                [HALF * c / s, HALF]
            };
            for j in 0..=AWAY {
                // Elements at the hole are as long along its edge as away from it.
                let share = ((1.13_f64).powi(j as i32) - 1.0) / ((1.13_f64).powi(AWAY as i32) - 1.0);
                let near = [RADIUS * c, RADIUS * s];
                let [x, y] = [0, 1].map(|a: usize| near[a] + share * (far[a] - near[a]));
                nodes.push([x, y, z]);
            }
        }
        for k in 1..=BEYOND {
            for i in 0..=AROUND / 2 {
                let angle = std::f64::consts::FRAC_PI_2 * i as f64 / AROUND as f64;
                let x = HALF + (LENGTH - HALF) * k as f64 / BEYOND as f64;
                nodes.push([x, HALF * angle.tan(), z]);
            }
        }
    };
    for l in 0..=LAYERS {
        layer(&mut nodes, THICK * l as f64 / LAYERS as f64);
    }
    let (square, half) = ((AROUND + 1) * (AWAY + 1), AROUND / 2 + 1);
    let per_layer = square + BEYOND * half;
    let polar = |i: usize, j: usize| i * (AWAY + 1) + j;
    let block = |k: usize, i: usize| {
        if k == 0 {
            polar(i, AWAY)
        } else {
            square + (k - 1) * half + i
        }
    };
    let mut flat: Vec<[usize; 4]> = Vec::new();
    for i in 0..AROUND {
        flat.extend((0..AWAY).map(|j| [polar(i, j), polar(i, j + 1), polar(i + 1, j + 1), polar(i + 1, j)]));
    }
    for k in 0..BEYOND {
        flat.extend(
            (0..half - 1).map(|i| [block(k, i), block(k + 1, i), block(k + 1, i + 1), block(k, i + 1)]),
        );
    }
    let solid = (0..LAYERS).flat_map(|l| {
        flat.iter().map(move |q| {
            let [low, high] = [l, l + 1].map(|l| q.map(|k| l * per_layer + k));
            [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
        })
    });
    (nodes, solid.collect())
}

/// Returns the mesh as text of Gmsh 4.1.
fn gmsh(nodes: &[[f64; 3]], solids: &[[usize; 8]]) -> String {
    let (n, e) = (nodes.len(), solids.len());
    let mut out = format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n1 {n} 1 {n}\n3 1 0 {n}\n"
    );
    (1..=n).for_each(|k| {
        let _ = writeln!(out, "{k}");
    });
    for [x, y, z] in nodes {
        let _ = writeln!(out, "{x:e} {y:e} {z:e}");
    }
    let _ = writeln!(out, "$EndNodes\n$Elements\n1 {e} 1 {e}\n3 1 5 {e}");
    for (k, corners) in solids.iter().enumerate() {
        let _ = write!(out, "{}", k + 1);
        corners.iter().for_each(|c| {
            let _ = write!(out, " {}", c + 1);
        });
        out.push('\n');
    }
    out += "$EndElements\n";
    out
}

/// The stress at the edge of the hole is 3.14 times the mean stress of the whole section for `d/W = 0.2`
/// (Howland 1930; Peterson's formula gives 3.149), in plane strain as in plane stress: the stresses of plane
/// problems under given tractions do not depend on the material.
#[test]
fn a_plate_with_a_hole_has_the_stress_concentration_of_howland() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("plate-with-hole");
    std::fs::create_dir_all(&folder).expect("a folder");
    let (nodes, solids) = mesh();
    std::fs::write(folder.join("plate.msh"), gmsh(&nodes, &solids)).expect("written");
    let small = 1e-9;
    let plane = |name: &str, low: [f64; 3], high: [f64; 3], axis: &str| {
        format!(
            "[[support]]\nname = \"{name}\"\nmodel = \"plate\"\nwhere = {{ box = {{ low = {low:?}, high = {high:?} }} }}\n\
             components = [\"{axis}\"]\n"
        )
    };
    let text = format!(
        "[model.plate]\nkind = \"fem\"\nshape.file = \"plate.msh\"\n\
         material = {{ young = 70e9, poisson = 0.3, density = 2700.0 }}\n{}{}{}{}\
         [[load]]\nname = \"pull\"\nmodel = \"plate\"\ntraction = [1e6, 0.0, 0.0]\ntime = \"step\"\n\
         where = {{ box = {{ low = [{LENGTH}, -1.0, -1.0], high = [1.0, 1.0, 1.0] }} }}\n\
         [static]\nsteps = 1\n\
         [probe.peak]\nmodel = \"plate\"\nquantity = \"stress\"\ncomponent = \"xx\"\n\
         where = {{ box = {{ low = [-{small:?}, {}, -1.0], high = [{small:?}, {}, 1.0] }} }}\n\
         [probe.middle]\nmodel = \"plate\"\nquantity = \"stress\"\ncomponent = \"xx\"\nat = [9e-3, 2.5e-3, 0.2e-3]\n\
         [probe.side]\nmodel = \"plate\"\nquantity = \"stress\"\ncomponent = \"yy\"\n\
         where = {{ box = {{ low = [{}, -{small:?}, -1.0], high = [{}, {small:?}, 1.0] }} }}\n\
         [probe.held]\nof = \"left\"\nquantity = \"force\"\ncomponent = \"x\"\n",
        plane("left", [-small, -1.0, -1.0], [small, 1.0, 1.0], "x"),
        plane("below", [-1.0, -small, -1.0], [1.0, small, 1.0], "y"),
        plane("front", [-1.0, -1.0, -small], [1.0, 1.0, small], "z"),
        plane("back", [-1.0, -1.0, THICK - small], [1.0, 1.0, 1.0], "z"),
        RADIUS - small,
        RADIUS + small,
        RADIUS - small,
        RADIUS + small,
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).expect("written");
    let results = Scene::read(&path)
        .expect("reads")
        .prepare()
        .expect("built")
        .run(&mut Silent)
        .expect("runs");
    let last = |p: &str| *results.probe(p).expect("probe").1.last().expect("a value") / 1e6;
    let (peak, middle, side) = (last("peak"), last("middle"), last("side"));
    println!(
        "{} elements: K_t = {peak:.4}, far {middle:.4}, beside the hole {side:.4}",
        solids.len()
    );
    assert!((peak / (2.512 / 0.8) - 1.0).abs() < 0.02, "K_t = {peak}");
    assert!((middle - 1.0).abs() < 0.02, "far from the hole {middle}");
    // Compression of about one where the pull meets the hole: -1.0 in a wide plate, a little more here.
    assert!((-1.25..-1.0).contains(&side), "{side}");
    let held = last("held") * 1e6 / (1e6 * HALF * THICK);
    assert!((held + 1.0).abs() < 1e-10, "the reaction is the pull: {held}");
}

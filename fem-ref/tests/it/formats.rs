//! One body in every readable format of Gmsh, written by Gmsh itself: two bricks of one metre, soft and
//! stiff.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::{Elastic, Materials, Model};
use fem_ref::gmsh::{self, load_surface};
use fem_ref::{ElementKind, FemModel, Mesh};

fn path(name: &str) -> String {
    format!("{}/tests/corpus/bricks-{name}.msh", env!("CARGO_MANIFEST_DIR"))
}

fn read(name: &str) -> Mesh<f64> {
    gmsh::load(path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Returns names, numbers of nodes and numbers of facets of all groups.
fn groups(mesh: &Mesh<f64>) -> Vec<(String, usize, usize)> {
    let pairs = mesh.groups().iter();
    pairs
        .map(|(n, g)| (n.clone(), g.nodes.len(), g.facets.len()))
        .collect()
}

/// Returns the measure of every volume.
fn volumes(mesh: &Mesh<f64>) -> Vec<(String, f64)> {
    let volume_of = |k: usize| mesh.part(|e| mesh.regions()[e] as usize == k).unwrap().volume();
    let names = mesh.volumes().iter().enumerate();
    names.map(|(k, n)| (n.clone(), volume_of(k))).collect()
}

#[test]
fn a_body_is_the_same_in_all_formats() {
    for order in [1, 2] {
        let first = read(&format!("{order}-41-text"));
        assert_eq!(first.kind(), ElementKind::Tet4);
        assert!((first.volume() - 2.0).abs() < 1e-14);
        for name in ["41-binary", "22-text", "22-binary"] {
            let name = format!("{order}-{name}");
            let mesh = read(&name);
            let counts = |m: &Mesh<f64>| [m.nodes().len(), m.element_count()];
            assert_eq!(counts(&mesh), counts(&first), "{name}");
            assert_eq!(groups(&mesh), groups(&first), "{name}");
            assert!((mesh.volume() - 2.0).abs() < 1e-14, "{name}");
            let left = mesh.surface("left").unwrap();
            assert!((left.iter().map(|f| f.area()).sum::<f64>() - 1.0).abs() < 1e-14);
            let parts = volumes(&mesh);
            assert_eq!(parts.len(), 2, "{name}: {parts:?}");
            for ((part, volume), wanted) in parts.iter().zip(["soft", "stiff"]) {
                assert!(
                    part == wanted && (volume - 1.0).abs() < 1e-14,
                    "{name}: {part} {volume}"
                );
            }
            let surface = load_surface(path(&name)).unwrap();
            assert_eq!(
                surface.groups["right"].len(),
                mesh.surface("right").unwrap().len()
            );
        }
    }
}

#[test]
fn elements_of_second_order_are_read_as_linear_with_a_notice() {
    let (linear, quadratic) = (read("1-41-text"), read("2-41-text"));
    assert!(linear.notices().is_empty());
    let [notice] = quadratic.notices() else {
        panic!("{:?}", quadratic.notices())
    };
    let tets = quadratic.element_count();
    assert!(
        notice.contains(&format!("{tets} elements of second order")) && notice.contains("90 nodes"),
        "{notice}"
    );
    // Only the corners remain: the mid-side nodes are dropped.
    assert_eq!(linear.nodes().len(), quadratic.nodes().len());
    assert_eq!(linear.element_count(), tets);
    assert!(gmsh::load::<f64>(path("2-22-binary")).unwrap().notices()[0].contains("second order"));
}

#[test]
fn broken_files_of_format_2_are_refused_by_section_and_number() {
    let text = std::fs::read_to_string(path("1-22-text")).unwrap();
    let refused = |from: &str, to: &str| {
        let broken = text.replacen(from, to, 1);
        assert_ne!(broken, text, "{from}");
        gmsh::parse::<f64>(broken.as_bytes()).unwrap_err().to_string()
    };
    for (from, to, wanted) in [
        ("2.2 0 8", "3 0 8", "format 3 is not supported"),
        (
            "5 1 0 0\n",
            "5 1 zero 0\n",
            "section $Nodes is broken at its node 5 of 23",
        ),
        ("\n2 0 0 0\n", "\n1 0 0 0\n", "node tag 1 occurs twice"),
        (
            "$Nodes\n23",
            "$Nodes\n24",
            "section $Nodes is broken at its node 24 of 24",
        ),
        ("$Elements\n104", "$Elements\n0", "section $Elements is empty"),
        (
            "$Elements\n104",
            "$Elements\n105",
            "section $Elements is broken at its element 105 of 105",
        ),
        (
            "$Elements\n104",
            "$Elements\nmany",
            "the header of section $Elements is broken",
        ),
        (
            "\n1 2 2 4 1 2 1 13",
            "\n1 2 2 4 1 2 1 99",
            "element 1 refers to node 99",
        ),
        (
            "\n1 2 2 4 1 2 1 13",
            "\n1 77 2 4 1 2 1 13",
            "the type with code 77",
        ),
    ] {
        let e = refused(from, to);
        assert!(e.contains(wanted), "{wanted}: {e}");
    }
    let binary = std::fs::read(path("1-22-binary")).unwrap();
    let cut = gmsh::parse::<f64>(&binary[..binary.len() / 2])
        .unwrap_err()
        .to_string();
    assert!(cut.contains("$Elements") || cut.contains("$Nodes"), "{cut}");
}

/// Two materials in a row in tension without lateral strain have the stress `p = u/(Σ l_i/M_i)` each, and the
/// energy of the exact field, `½ Σ M_i ε_i² V_i`.
#[test]
fn every_volume_has_its_own_material() {
    let mesh = read("1-41-binary");
    let materials = [(1.0, 0.2, 1.0), (3.0, 0.3, 5.0)].map(|(e, nu, rho)| Elastic::new(e, nu, rho).unwrap());
    let regions = mesh.regions().to_vec();
    let per_element = Materials::of_elements(materials.to_vec(), regions).unwrap();
    let mut model = FemModel::new("bricks", mesh, per_element).unwrap();
    let [soft, stiff] = materials.map(|m| m.p_wave_modulus());
    let strain = [1e-3 / soft, 1e-3 / stiff];
    let along = |x: f64| strain[0] * x.min(1.0) + strain[1] * (x - 1.0).max(0.0);
    let u: Vec<f64> = model
        .nodes()
        .iter()
        .flat_map(|x| [along(x.x), 0.0, 0.0])
        .collect();
    let energy = 0.5 * (soft * strain[0].powi(2) + stiff * strain[1].powi(2));
    assert!((model.internal_energy(&u) / energy - 1.0).abs() < 1e-12);
    // The stress is equal on both sides: inner nodes have no force along x.
    let mut f = vec![0.0; u.len()];
    model.add_internal_forces(&u, &mut f).unwrap();
    for (x, f) in model.nodes().iter().zip(f.as_chunks::<3>().0) {
        if x.x > 1e-9 && x.x < 2.0 - 1e-9 {
            assert!(f[0].abs() < 1e-17, "{x}: {f:?}");
        }
    }
    let mut m = vec![0.0; u.len()];
    model
        .lumped_inertia(&arlequin_core::Uniform(1.0), &mut m)
        .unwrap();
    let mass: f64 = m.iter().step_by(3).sum();
    assert!((mass - 6.0).abs() < 1e-13, "{mass}");
    let wrong = FemModel::new(
        "bricks",
        read("1-41-text").part(|e| e < 4).unwrap(),
        Materials::of_elements(materials.to_vec(), vec![0; 9]).unwrap(),
    );
    let e = wrong.unwrap_err().to_string();
    assert!(e.contains("number of elements with a material = 9"), "{e}");
}

#[test]
fn halves_of_elements_fill_the_same_body_with_the_same_groups() {
    let warped = |m: Mesh<f64>| m.mapped(|x| x + Vector3::new(0.1 * x.y, 0.2 * x.x, -0.1 * x.x * x.y));
    let bricks = warped(read("1-41-text")).unwrap();
    for mesh in [
        bricks,
        fem_ref::generate::ball(ElementKind::Hex8, Point3::new(0.1, -0.2, 5.0), 1.0, 0.5).unwrap(),
    ] {
        let fine = mesh.refined().unwrap();
        assert_eq!(fine.element_count(), 8 * mesh.element_count());
        assert_eq!(fine.boundary().len(), 4 * mesh.boundary().len());
        assert_eq!(fine.regions().len(), 8 * mesh.regions().len());
        assert!(
            (fine.spacing() / mesh.spacing() - 0.5).abs() < 0.05,
            "{}",
            fine.spacing() / mesh.spacing()
        );
        if mesh.kind() == ElementKind::Tet4 {
            assert!((fine.volume() / mesh.volume() - 1.0).abs() < 1e-13);
        }
        for (name, group) in mesh.groups() {
            assert_eq!(
                fine.group(name).unwrap().facets.len(),
                4 * group.facets.len(),
                "{name}"
            );
            if !group.facets.is_empty() {
                // The refined surface keeps its area within 2 %, and the group has exactly the nodes of its
                // facets.
                let area = |m: &Mesh<f64>| m.surface(name).unwrap().iter().map(|f| f.area()).sum::<f64>();
                assert!((area(&fine) / area(&mesh) - 1.0).abs() < 0.02);
                let of_facets: std::collections::BTreeSet<u32> = fine
                    .group(name)
                    .unwrap()
                    .facets
                    .iter()
                    .flat_map(|f| fine.facet_nodes(*f))
                    .collect();
                assert_eq!(of_facets.len(), fine.group(name).unwrap().nodes.len(), "{name}");
            }
        }
    }
}

#[test]
fn a_ball_has_its_volume_and_surface_at_any_size() {
    for (kind, size) in [
        (ElementKind::Hex8, 1.0),
        (ElementKind::Hex8, 0.3),
        (ElementKind::Tet4, 0.4),
    ] {
        let centre = Point3::new(1e3, -2.0, 7.0);
        let mesh = fem_ref::generate::ball(kind, centre, 2.0, size).unwrap();
        let exact = 32.0 / 3.0 * std::f64::consts::PI;
        assert!(
            (mesh.volume() / exact - 1.0).abs() < 1e-9,
            "{size}: {}",
            mesh.volume()
        );
        assert_eq!(mesh.surface("surface").unwrap().len(), mesh.boundary().len());
        let ratio = mesh.spacing() / size;
        assert!((0.6..1.5).contains(&ratio), "{size}: {ratio}");
    }
    let e = fem_ref::generate::ball(ElementKind::Hex8, Point3::origin(), -1.0, 1.0).unwrap_err();
    assert!(e.to_string().contains("ball radius"), "{e}");
}

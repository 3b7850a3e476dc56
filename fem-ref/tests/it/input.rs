//! Bad input: each case has its own error text.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "a test fails by panicking and may compare exact values"
)]

use approx::assert_abs_diff_eq;
use arlequin_core::Model;
use arlequin_core::nalgebra::{Point3, Vector3};
use fem_ref::generate::{self, Cylinder, Rim};
use fem_ref::{Elastic, ElementKind, Error, FemModel, Mesh};

fn p(x: f64, y: f64, z: f64) -> Point3<f64> {
    Point3::new(x, y, z)
}

fn tetrahedron() -> Vec<Point3<f64>> {
    vec![p(0., 0., 0.), p(1., 0., 0.), p(0., 1., 0.), p(0., 0., 1.)]
}

fn text<V: std::fmt::Debug, E: std::fmt::Display>(r: Result<V, E>) -> String {
    r.unwrap_err().to_string()
}

#[test]
fn materials_out_of_range() {
    let make = |e: f64, n: f64, r: f64| text(Elastic::new(e, n, r));
    assert_eq!(
        make(-1.0, 0.3, 1.0),
        "young = -1: must be positive and finite [Pa]"
    );
    assert_eq!(
        make(f64::INFINITY, 0.3, 1.0),
        "young = inf: must be positive and finite [Pa]"
    );
    assert_eq!(
        make(1.0, 0.5, 1.0),
        "poisson = 0.5: an incompressible material has no finite bulk modulus in a displacement model; use a value \
         below 0.5; elements of first order lock near it, so that 0.45 is a better choice than 0.49"
    );
    assert_eq!(make(1.0, 0.6, 1.0), "poisson = 0.6: must lie between -1 and 0.5");
    assert_eq!(
        make(1.0, f64::NAN, 1.0),
        "poisson = NaN: must lie between -1 and 0.5"
    );
    assert_eq!(make(1.0, -1.0, 1.0), "poisson = -1: must lie between -1 and 0.5");
    assert_eq!(
        make(1.0, 0.3, -2200.0),
        "density = -2200: must be positive and finite [kg/m3]"
    );
    assert_eq!(
        make(1.0, 0.3, 0.0),
        "density = 0: must be positive and finite [kg/m3]"
    );
}

#[test]
fn meshes_that_are_not_valid() {
    let tet = |nodes: Vec<Point3<f64>>, c: &[u32]| text(Mesh::new(ElementKind::Tet4, nodes, c.to_vec()));
    let t = tetrahedron;
    assert_eq!(
        tet(vec![], &[]),
        "mesh has 0 nodes and 0 elements; give at least one element and the nodes it refers to"
    );
    assert_eq!(
        tet(t(), &[0, 1, 2]),
        "connectivity has 3 entries, which is no multiple of the 4 corners of a tet4; complete the last element"
    );
    let mut nan = t();
    nan[2].y = f64::NAN;
    assert_eq!(
        tet(nan, &[0, 1, 2, 3]),
        "node 2: coordinate y is NaN, not a finite number; check the input that feeds it"
    );
    assert_eq!(
        tet(t(), &[0, 1, 2, 9]),
        "tet4 element 0 refers to node 9, but the mesh has nodes 0 to 3 only"
    );
    let lone = [t(), vec![p(2., 0., 0.)]].concat();
    assert_eq!(
        tet(lone, &[0, 1, 2, 3]),
        "node 4 at (2.000000e0, 0.000000e0, 0.000000e0) m belongs to no element and would have no mass; remove it"
    );
    let twins = [t(), vec![p(1e-12, 0., 0.)]].concat();
    assert_eq!(
        tet(twins, &[0, 1, 2, 3, 4, 1, 2, 3]),
        "nodes 0 and 4 coincide at (0.000000e0, 0.000000e0, 0.000000e0) m (distance 1.0e-12 m, limit 1.7e-9 m); \
         merge them"
    );
    assert_eq!(
        tet(t(), &[0, 2, 1, 3]),
        "tet4 element 0 at (2.500000e-1, 2.500000e-1, 2.500000e-1) m is inverted: its relative Jacobian is \
         -3.536e-1 at corner 0, must exceed 1e-10; reverse its node order or repair the mesh"
    );
    let mut flat = t();
    flat[3] = p(1., 1., 0.);
    assert_eq!(
        tet(flat, &[0, 1, 2, 3]),
        "tet4 element 0 at (5.000000e-1, 5.000000e-1, 0.000000e0) m is flat: its relative Jacobian is 0.000e0 at \
         corner 0, must exceed 1e-10; remove it or move its nodes"
    );
}

#[test]
fn a_hexahedron_with_one_corner_pushed_through_is_inverted() {
    let mesh = generate::block(ElementKind::Hex8, Point3::origin(), p(1., 1., 1.), [1, 1, 1]).unwrap();
    // All corners but the seventh have a positive Jacobian.
    let e = mesh
        .mapped(|x| {
            if x.coords.sum() > 2.9 {
                p(0.3, 0.3, 0.3)
            } else {
                *x
            }
        })
        .unwrap_err();
    assert!(
        matches!(
            e,
            Error::InvertedElement {
                corner: 6,
                kind: "hex8",
                ..
            }
        ),
        "{e}"
    );
}

#[test]
fn groups_and_surfaces() {
    let mesh = generate::bar(0.0, 1.0, 2, 0.5).unwrap();
    assert_eq!(
        text(mesh.surface("end")),
        "mesh has no group 'end'; it has: x-max, x-min"
    );
    let facet = &mesh.surface("x-max").unwrap()[0];
    assert_eq!((facet.nodes[0], facet.shares[0], facet.normal.x), (2, 0.5, 1.0));
    let mesh = mesh.with_nodes("middle", |x| x.x > 0.4 && x.x < 0.6).unwrap();
    assert_eq!(
        text(mesh.surface("middle")),
        "group 'middle' has 1 nodes but no facets; name a surface instead"
    );
    assert_eq!(
        text(mesh.clone().with_surface("far", |x| x.x > 7.0)),
        "group 'far' is empty: no boundary facet of the mesh satisfies its condition; check it"
    );
    assert_eq!(
        text(mesh.with_section(0.0)),
        "section = 0: must be positive and finite [m2]"
    );
}

#[test]
fn surfaces_have_outward_normals_and_the_right_area() {
    for kind in [ElementKind::Hex8, ElementKind::Tet4] {
        let mesh = generate::block(kind, Point3::origin(), p(3., 2., 1.), [3, 2, 2]).unwrap();
        for (name, area, normal) in [
            ("x-min", 2.0, [-1., 0., 0.]),
            ("y-max", 3.0, [0., 1., 0.]),
            ("z-max", 6.0, [0., 0., 1.]),
        ] {
            let facets = mesh.surface(name).unwrap();
            let sum: f64 = facets.iter().map(|f| f.area()).sum();
            assert_abs_diff_eq!(sum, area, epsilon = 1e-13);
            assert!(
                facets
                    .iter()
                    .all(|f| (f.normal - Vector3::from(normal)).norm() < 1e-14)
            );
        }
        assert_eq!(
            mesh.surface_where(|c| c.x > 2.99).len(),
            mesh.surface("x-max").unwrap().len()
        );
        let shape = Cylinder {
            ends: [0.0, 1.0],
            radius: 0.5,
            core: 6,
            rings: 3,
            layers: 2,
            rim: Rim::EqualArea,
        };
        let rod = generate::cylinder(kind, &shape).unwrap();
        let sum = |n: &str| rod.surface(n).unwrap().iter().map(|f| f.area()).sum::<f64>();
        assert_abs_diff_eq!(sum("x-max"), std::f64::consts::PI / 4.0, epsilon = 1e-12);
        assert!((sum("side") / std::f64::consts::PI - 1.0).abs() < 0.01);
        assert!(
            rod.surface("side")
                .unwrap()
                .iter()
                .all(|f| f.normal.dot(&f.centre.coords) > 0.4)
        );
    }
}

#[test]
fn generators_refuse_nonsense() {
    assert_eq!(
        text(generate::bar(0.0, 1.0, 0, 1.0)),
        "bar elements = 0: must be at least 1"
    );
    assert_eq!(
        text(generate::bar(1.0, 1.0, 3, 1.0)),
        "bar end x1 = 1: must be finite and above its predecessor [m]"
    );
    assert_eq!(
        text(generate::bar_at(&[0.0, 2.0, 1.0], 1.0)),
        "bar coordinate = 1: must be finite and above its predecessor [m]"
    );
    assert!(text(generate::bar_at::<f64>(&[], 1.0)).starts_with("mesh has 0 nodes"));
    assert_eq!(
        text(generate::block(
            ElementKind::Bar2,
            Point3::origin(),
            p(1., 1., 1.),
            [1, 1, 1]
        )),
        "a box cannot be made of bar2 elements; use tet4 or hex8"
    );
    assert_eq!(
        text(generate::block(
            ElementKind::Hex8,
            Point3::origin(),
            p(1., 1., 1.),
            [1 << 20, 1 << 20, 2]
        )),
        "box elements = 2199023255552: must be at most 16777216"
    );
    assert_eq!(
        text(Cylinder::with_size([0.0, 1.0], 0.1, 0.0)),
        "element size = 0: must be positive and finite [m]"
    );
    let mut shape = Cylinder::with_size([0.0, 1.0], 0.1, 0.1).unwrap();
    shape.radius = -0.1;
    assert_eq!(
        text(generate::cylinder(ElementKind::Hex8, &shape)),
        "cylinder radius = -0.1: must be positive and finite [m]"
    );
}

#[test]
fn holes_take_whole_elements_and_are_refused_elsewhere() {
    let with_hole = |kind, hole: [Point3<f64>; 2]| {
        generate::hollow_block(kind, p(0., 0., 0.), p(4., 4., 2.), [4, 4, 2], hole)
    };
    // A pit that is open at the top, and a frame that is open above and below.
    for kind in [ElementKind::Hex8, ElementKind::Tet4] {
        let pit = with_hole(kind, [p(1., 1., 1.), p(3., 3., 9.)]).unwrap();
        assert!((pit.volume() - 28.0).abs() < 1e-12 && pit.nodes().len() == 74);
        let frame = with_hole(kind, [p(1., 1., -1.), p(3., 3., 9.)]).unwrap();
        assert!((frame.volume() - 24.0).abs() < 1e-12 && frame.nodes().len() == 72);
        let top = frame.surface("z-max").unwrap();
        assert!((top.iter().map(|f| f.area()).sum::<f64>() - 12.0).abs() < 1e-12);
    }
    let refused = |hole| text(with_hole(ElementKind::Hex8, hole));
    assert!(
        refused([p(1.5, 1., 0.), p(3., 3., 2.)])
            .contains("hole corner x = 1.5: must lie on a face between elements")
    );
    assert!(refused([p(5., 1., 0.), p(6., 3., 2.)]).contains("hole and box do not meet"));
    assert!(refused([p(-1., -1., -1.), p(9., 9., 9.)]).contains("the hole takes the whole box"));
    assert!(refused([p(3., 1., 0.), p(1., 3., 2.)]).contains("must be finite and above its predecessor"));
}

#[test]
fn models_refuse_slanted_bars_and_wrong_lengths() {
    let slanted = Mesh::new(ElementKind::Bar2, vec![p(0., 0., 0.), p(1., 1., 0.)], vec![0, 1]).unwrap();
    let material = Elastic::new(1.0, 0.0, 1.0).unwrap();
    assert_eq!(
        text(FemModel::new("bar", slanted, material)),
        "bar element 0 leaves the x direction by 7.854e-1 rad; the bar model carries axial displacements along x \
         only: turn the mesh"
    );
    let mut bar = FemModel::new("bar", generate::bar(0.0, 1.0, 2, 1.0).unwrap(), material).unwrap();
    let e = bar.add_internal_forces(&[0.0; 2], &mut [0.0; 3]).unwrap_err();
    assert_eq!(e.to_string(), "displacements of model 'bar': expected 3, found 2");
}

/// Returns the smallest ratio over all corners of the Jacobian to the product of the three edges: 1 for a
/// cube.
fn scaled_jacobian(mesh: &Mesh<f64>) -> f64 {
    let next = [
        [1, 3, 4],
        [2, 0, 5],
        [3, 1, 6],
        [0, 2, 7],
        [7, 5, 0],
        [4, 6, 1],
        [5, 7, 2],
        [6, 4, 3],
    ];
    let mut worst: f64 = 1.0;
    for e in 0..mesh.element_count() {
        let corner = |k: usize| mesh.nodes()[mesh.element(e)[k] as usize];
        for (k, n) in next.iter().enumerate() {
            let d = n.map(|j: usize| (corner(j) - corner(k)).normalize());
            worst = worst.min(d[0].cross(&d[1]).dot(&d[2]));
        }
    }
    worst
}

#[test]
fn cylinders_have_good_elements() {
    for (core, rings) in [(1, 1), (2, 1), (3, 2), (4, 2), (8, 4), (16, 8), (4, 6)] {
        let shape = Cylinder {
            ends: [0.0, 1.0],
            radius: 1.0,
            core,
            rings,
            layers: core,
            rim: Rim::EqualArea,
        };
        let q = scaled_jacobian(&generate::cylinder(ElementKind::Hex8, &shape).unwrap());
        assert!(q > 0.6, "core {core} rings {rings}: {q}");
        let tets = generate::cylinder(ElementKind::Tet4, &shape).unwrap();
        assert!((tets.volume() / std::f64::consts::PI - 1.0).abs() < 1e-12);
    }
}

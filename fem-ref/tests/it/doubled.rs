//! Elements that are listed twice, and nodes that share a place: one element, a slit, or two pieces.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::nalgebra::Point3;
use arlequin_core::{Model, Uniform};
use fem_ref::{ElementKind, Error, Facet, Mesh, generate, gmsh};
use std::fmt::Write as _;

/// Returns two bricks of one metre, written by Gmsh; lines of tetrahedra are `number 4 2 group entity nodes`.
fn bricks(format: &str) -> String {
    let path = format!(
        "{}/tests/corpus/bricks-1-{format}.msh",
        env!("CARGO_MANIFEST_DIR")
    );
    std::fs::read_to_string(path).unwrap()
}

/// Returns the nodes of a tetrahedron in another order of the same orientation.
fn turned(nodes: &[u64]) -> Vec<u64> {
    vec![nodes[1], nodes[2], nodes[0], nodes[3]]
}

/// Returns the bricks in format 2.2, with every tetrahedron of volumes 1 and 2 followed by the one that
/// `again` makes of its group, entity and nodes.
fn with_again(again: impl Fn([i64; 2], &[u64]) -> ([i64; 2], Vec<u64>)) -> String {
    let text = bricks("22-text");
    let (head, tail) = text.split_once("$Elements\n").unwrap();
    let mut lines: Vec<String> = tail
        .lines()
        .skip(1)
        .take_while(|l| *l != "$EndElements")
        .map(str::to_owned)
        .collect();
    for k in 0..lines.len() {
        let numbers: Vec<i64> = lines[k].split_whitespace().map(|w| w.parse().unwrap()).collect();
        if numbers[1] == 4 && numbers[3] < 3 {
            let nodes: Vec<u64> = numbers[5..].iter().map(|n| *n as u64).collect();
            let ([group, entity], nodes) = again([numbers[3], numbers[4]], &nodes);
            let nodes: Vec<String> = nodes.iter().map(u64::to_string).collect();
            lines.push(format!("{} 4 2 {group} {entity} {}", 1000 + k, nodes.join(" ")));
        }
    }
    format!(
        "{head}$Elements\n{}\n{}\n$EndElements\n",
        lines.len(),
        lines.join("\n")
    )
}

fn volume_of_all(mesh: &Mesh<f64>) -> f64 {
    let model = fem_ref::FemModel::new(
        "bricks",
        mesh.clone(),
        fem_ref::Elastic::new(1.0, 0.0, 1.0).unwrap(),
    )
    .unwrap();
    let mut inertia = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
    inertia.iter().step_by(3).sum()
}

#[test]
fn an_element_listed_twice_in_another_order_of_its_nodes_is_refused_for_every_kind() {
    let (low, high) = (Point3::origin(), Point3::new(2.0, 2.0, 2.0));
    let solid = |kind| generate::block(kind, low, high, [2, 2, 2]).unwrap();
    let cases: [(Mesh<f64>, &[usize]); 3] = [
        (generate::bar(0.0, 2.0, 4, 1.0).unwrap(), &[1, 0]),
        (solid(ElementKind::Tet4), &[1, 2, 0, 3]),
        (solid(ElementKind::Hex8), &[1, 2, 3, 0, 5, 6, 7, 4]),
    ];
    for (mesh, order) in cases {
        let count = mesh.element_count();
        for e in 0..count {
            let repeated = order.iter().map(|k| mesh.element(e)[*k]);
            let connectivity = mesh.connectivity().iter().copied().chain(repeated).collect();
            let refused = Mesh::new(mesh.kind(), mesh.nodes().to_vec(), connectivity).unwrap_err();
            assert!(
                matches!(refused, Error::RepeatedElement { first, second, .. } if first == e && second == count),
                "{refused}"
            );
        }
    }
}

#[test]
fn elements_of_a_file_that_are_listed_twice_in_another_order_count_once() {
    let first: Mesh<f64> = gmsh::parse(bricks("22-text").as_bytes()).unwrap();
    // Repeated in the same group, in a second group, in a second group with opposite orientation, and without
    // a group.
    let cases: [(i64, bool); 4] = [(0, true), (77, false), (-77, false), (-1, true)];
    for (group, expected) in cases {
        let text = with_again(|[group_tag, entity], nodes| {
            let group = match group {
                0 => group_tag,
                -1 => 0,
                other => other,
            };
            let nodes = if group < 0 {
                vec![nodes[1], nodes[0], nodes[2], nodes[3]]
            } else {
                turned(nodes)
            };
            ([group, entity], nodes)
        });
        let mesh: Mesh<f64> = gmsh::parse(text.as_bytes()).unwrap();
        assert_eq!(mesh.element_count(), first.element_count(), "group {group}");
        assert!((volume_of_all(&mesh) - 2.0).abs() < 1e-13, "group {group}");
        assert_eq!(mesh.boundary().len(), first.boundary().len(), "group {group}");
        assert_eq!(mesh.volumes(), first.volumes(), "group {group}");
        assert_eq!(mesh.regions(), first.regions(), "group {group}");
        let notice = mesh
            .notices()
            .iter()
            .any(|n| n.starts_with("48 of its elements are listed a second time"));
        assert_eq!(notice, expected, "group {group}: {:?}", mesh.notices());
        if group.abs() == 77 {
            assert_eq!(mesh.group("volume-77").unwrap().nodes.len(), mesh.nodes().len());
        }
    }
    let text = with_again(|[group, entity], nodes| ([group, entity + 10], turned(nodes)));
    let refused = gmsh::parse::<f64>(text.as_bytes()).unwrap_err().to_string();
    assert!(
        refused.starts_with(
            "Gmsh mesh: element 9 of entity 1 and element 1008 of entity 11 have the same nodes"
        ),
        "{refused}"
    );
}

#[test]
fn elements_listed_twice_in_format_4_count_once_on_one_entity_and_are_refused_on_two() {
    let file = |blocks: &str, count: usize, block_count: usize| {
        format!(
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 5 1 5\n3 1 0 5\n1\n2\n3\n4\n5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n\
             $EndNodes\n$Elements\n{block_count} {count} 1 {count}\n{blocks}$EndElements\n"
        )
    };
    let listed_once: Mesh<f64> =
        gmsh::parse(file("3 1 4 2\n1 1 2 3 4\n2 2 5 3 4\n", 2, 1).as_bytes()).unwrap();
    let listed_twice: Mesh<f64> =
        gmsh::parse(file("3 1 4 4\n1 1 2 3 4\n2 2 5 3 4\n3 2 3 1 4\n4 4 3 5 2\n", 4, 1).as_bytes()).unwrap();
    assert_eq!(listed_once.connectivity(), listed_twice.connectivity());
    assert_eq!(listed_once.regions(), listed_twice.regions());
    assert!(
        listed_twice.notices()[0].starts_with("2 of its elements are listed a second time"),
        "{:?}",
        listed_twice.notices()
    );
    let two_entities =
        gmsh::parse::<f64>(file("3 1 4 2\n1 1 2 3 4\n2 2 5 3 4\n3 2 4 1\n3 2 3 1 4\n", 3, 2).as_bytes());
    let text = two_entities.unwrap_err().to_string();
    assert!(
        text.contains("element 1 of entity 1 and element 3 of entity 2 have the same nodes"),
        "{text}"
    );
}

#[test]
fn a_face_of_a_surface_mesh_that_two_groups_list_in_another_order_bounds_the_body_once() {
    let corners = [[1, 3, 2], [1, 2, 4], [2, 3, 4], [1, 4, 3]];
    let mut text = String::from(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n8\n",
    );
    for (k, [a, b, c]) in corners.iter().enumerate() {
        let _ = writeln!(
            text,
            "{} 2 2 5 1 {a} {b} {c}\n{} 2 2 -6 1 {b} {a} {c}",
            2 * k + 1,
            2 * k + 2
        );
    }
    let path = std::path::PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("listed-twice.msh");
    std::fs::write(&path, text + "$EndElements\n").unwrap();
    let surface = gmsh::load_surface(&path).unwrap();
    assert_eq!(surface.triangles.len(), 4);
    assert_eq!(surface.groups["surface-5"].len(), 4);
    assert_eq!(surface.groups["surface-6"].len(), 4);
}

/// Returns the mesh in which the elements selected by `own` have a copy of node `node`.
fn with_own_node(mesh: &Mesh<f64>, node: u32, own: impl Fn(usize) -> bool) -> Result<Mesh<f64>, Error> {
    let mut nodes = mesh.nodes().to_vec();
    nodes.push(nodes[node as usize]);
    let corners = mesh.kind().corners();
    let copy = |(slot, k): (usize, &u32)| match *k == node && own(slot / corners) {
        true => nodes.len() as u32 - 1,
        false => *k,
    };
    let connectivity = mesh.connectivity().iter().enumerate().map(copy).collect();
    Mesh::new(mesh.kind(), nodes.clone(), connectivity)
}

#[test]
fn one_element_with_a_node_of_its_own_is_no_slit() {
    for kind in [ElementKind::Tet4, ElementKind::Hex8] {
        let mesh = generate::block(kind, Point3::origin(), Point3::new(4.0, 4.0, 4.0), [4, 4, 4]).unwrap();
        let outer = mesh.boundary();
        let mut tried = 0;
        for e in 0..mesh.element_count() {
            for k in mesh.element(e) {
                // If one of its faces lies in the body, the element is the end of a slit along this face.
                let faces = (0..kind.faces().len() as u8).map(|face| Facet {
                    element: e as u32,
                    face,
                });
                let inner = faces
                    .filter(|f| mesh.facet_nodes(*f).contains(k) && !outer.contains(f))
                    .count();
                if inner < 2 {
                    continue;
                }
                let refused = with_own_node(&mesh, *k, |f| f == e);
                assert!(
                    matches!(refused, Err(Error::CoincidentNodes { .. })),
                    "element {e}, node {k}"
                );
                tried += 1;
            }
        }
        assert!(tried > 300, "{tried} of {kind:?}");
    }
}

#[test]
fn two_tetrahedra_with_a_node_of_their_own_are_no_slit_and_half_of_those_around_it_are_one() {
    let mesh = generate::block(
        ElementKind::Tet4,
        Point3::origin(),
        Point3::new(4.0, 4.0, 4.0),
        [4, 4, 4],
    )
    .unwrap();
    let node = mesh.nodes_where(|x| *x == Point3::new(2.0, 2.0, 2.0))[0] as u32;
    let around: Vec<usize> = (0..mesh.element_count())
        .filter(|e| mesh.element(*e).contains(&node))
        .collect();
    let shared = |a: usize, b: usize| {
        mesh.element(a)
            .iter()
            .filter(|k| mesh.element(b).contains(k))
            .count()
    };
    let mut pairs = 0;
    for (i, a) in around.iter().enumerate() {
        for b in around[..i].iter().filter(|b| shared(*a, **b) == 3) {
            let refused = with_own_node(&mesh, node, |e| e == *a || e == *b);
            assert!(
                matches!(refused, Err(Error::CoincidentNodes { .. })),
                "elements {a} and {b}"
            );
            pairs += 1;
        }
    }
    assert!(pairs >= 20, "{pairs}");
    // The smallest slit: one copied node on a plane, and on a plane that meets another at a right angle.
    for half in [|x: f64, _: f64| x > 2.0, |x: f64, y: f64| x > 2.0 || y > 2.0] {
        let above = |e: usize| {
            let corners = mesh.element(e).iter().map(|k| mesh.nodes()[*k as usize]);
            let (x, y) = corners.fold((0.0, 0.0), |s, p| (s.0 + p.x / 4.0, s.1 + p.y / 4.0));
            half(x, y)
        };
        assert_eq!(with_own_node(&mesh, node, above).unwrap().doubled(), 1);
    }
}

#[test]
fn a_mesh_in_two_pieces_that_touch_is_refused_with_what_the_pieces_are() {
    // The second brick gets its own nodes where it meets the first.
    let mesh: Mesh<f64> = gmsh::parse(bricks("22-text").as_bytes()).unwrap();
    let mut nodes = mesh.nodes().to_vec();
    let mut connectivity = mesh.connectivity().to_vec();
    for k in mesh.nodes_where(|x| (x.x - 1.0).abs() < 1e-9) {
        nodes.push(mesh.nodes()[k]);
        for (slot, n) in connectivity.iter_mut().enumerate() {
            if *n == k as u32 && mesh.regions()[slot / 4] == 1 {
                *n = nodes.len() as u32 - 1;
            }
        }
    }
    let mut text = String::from(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 1 \"soft\"\n3 2 \"stiff\"\n$EndPhysicalNames\n$Nodes\n",
    );
    let _ = writeln!(text, "{}", nodes.len());
    for (k, x) in nodes.iter().enumerate() {
        let _ = writeln!(text, "{} {} {} {}", k + 1, x.x, x.y, x.z);
    }
    let _ = writeln!(text, "$EndNodes\n$Elements\n{}", mesh.element_count());
    for (e, c) in connectivity.chunks_exact(4).enumerate() {
        let volume = mesh.regions()[e] + 1;
        let _ = writeln!(
            text,
            "{} 4 2 {volume} {volume} {} {} {} {}",
            e + 1,
            c[0] + 1,
            c[1] + 1,
            c[2] + 1,
            c[3] + 1
        );
    }
    let refused = gmsh::parse::<f64>((text + "$EndElements\n").as_bytes()).unwrap_err();
    assert!(
        matches!(refused, Error::SeparatePieces { count: 2, .. }),
        "{refused}"
    );
    let words = refused.to_string();
    for part in [
        "24 elements from (0.0000e0, 0.0000e0, 0.0000e0) to (1.0000e0, 1.0000e0, 1.0000e0) m of 'soft'",
        "24 elements from (1.0000e0, 0.0000e0, 0.0000e0) to (2.0000e0, 1.0000e0, 1.0000e0) m of 'stiff'",
        "merge the nodes where the pieces meet",
    ] {
        assert!(words.contains(part), "{words}");
    }
}

//! Bodies and spheres from files: STL surfaces, VTU points.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use approx::{assert_abs_diff_eq, assert_relative_eq};
use dem_beam::packing::{pieces_of_pvtu, read_pieces, read_vtu};
use dem_beam::{Container, Error, Packing, PackingSpec, Surface};
use nalgebra::Vector3;
use std::f64::consts::PI;
use std::fmt::Write as _;

type Facet = [Vector3<f64>; 3];
/// A body and a function that selects the part of its bounding box that must stay empty.
type Case<'a> = (Vec<Facet>, &'a dyn Fn(&Vector3<f64>) -> bool);

fn text(facets: &[Facet]) -> Vec<u8> {
    let mut out = String::from("solid test\n");
    for f in facets {
        out.push_str("facet normal 0 0 0\nouter loop\n");
        for v in f {
            let v = v.map(|c| c as f32);
            writeln!(out, "vertex {:e} {:e} {:e}", v.x, v.y, v.z).unwrap();
        }
        out.push_str("endloop\nendfacet\n");
    }
    out.push_str("endsolid test\n");
    out.into_bytes()
}

/// Returns a binary STL file whose comment looks like the first word of a text file, as some programs write
/// it.
fn binary(facets: &[Facet]) -> Vec<u8> {
    let mut out = b"solid by a program".to_vec();
    out.resize(80, b' ');
    out.extend((facets.len() as u32).to_le_bytes());
    for f in facets {
        out.extend([0; 12]);
        out.extend(
            f.iter()
                .flat_map(|v| v.iter())
                .flat_map(|c| (*c as f32).to_le_bytes()),
        );
        out.extend([0; 2]);
    }
    out
}

/// Returns the facets of a surface over two parameters in `n` steps each; the first parameter is periodic.
fn patches(n: [u32; 2], at: impl Fn(f64, f64) -> Vector3<f64>) -> Vec<Facet> {
    let mut out = Vec::new();
    for i in 0..n[0] {
        for j in 0..n[1] {
            // Whole turns return to the same bits.
            let p = |a: u32, b: u32| {
                at(
                    f64::from(a % n[0]) / f64::from(n[0]),
                    f64::from(b) / f64::from(n[1]),
                )
            };
            let (a, b, c, d) = (p(i, j), p(i + 1, j), p(i + 1, j + 1), p(i, j + 1));
            out.extend([[a, b, c], [a, c, d]]);
        }
    }
    out
}

fn ball(radius: f64) -> Vec<Facet> {
    patches([24, 12], |u, v| {
        let ring = if v > 0.0 && v < 1.0 { (PI * v).sin() } else { 0.0 };
        let (sin, cos) = (2.0 * PI * u).sin_cos();
        Vector3::new(ring * cos, ring * sin, (PI * v).cos()) * radius
    })
}

fn torus(large: f64, small: f64) -> Vec<Facet> {
    patches([24, 12], |u, v| {
        let ((su, cu), (sv, cv)) = ((2.0 * PI * u).sin_cos(), (2.0 * PI * (v % 1.0)).sin_cos());
        Vector3::new((large + small * cv) * cu, (large + small * cv) * su, small * sv)
    })
}

/// Returns an L of three cubes of edge `a`, made of the faces that no two cubes share.
fn ell(a: f64) -> Vec<Facet> {
    let cubes = [[0, 0, 0], [1, 0, 0], [0, 1, 0]];
    let mut out = Vec::new();
    for c in cubes {
        for axis in 0..3 {
            for side in 0..2 {
                let mut neighbour = c;
                neighbour[axis] += 2 * side - 1;
                if cubes.contains(&neighbour) {
                    continue;
                }
                let corner = |s: i32, t: i32| {
                    let mut x = c;
                    x[axis] += side;
                    x[(axis + 1) % 3] += s;
                    x[(axis + 2) % 3] += t;
                    Vector3::from(x.map(f64::from)) * a
                };
                let (p, q, r, s) = (corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1));
                out.extend([[p, q, r], [p, r, s]]);
            }
        }
    }
    out
}

#[test]
fn stl_as_text_and_binary_is_the_same_body() {
    // The poles of the ball are facets with a repeated corner; faces of the L are turned at random.
    for (facets, volume) in [
        (ball(1e-3), 4.0 / 3.0 * PI * 1e-9),
        (torus(1e-3, 0.4e-3), 2.0 * PI * PI * 1e-3 * 0.16e-6),
        (ell(1e-3), 3e-9),
    ] {
        let a = Surface::from_stl(&text(&facets)).unwrap();
        let b = Surface::from_stl(&binary(&facets)).unwrap();
        assert_relative_eq!(a.volume(), b.volume(), epsilon = 0.0, max_relative = 1e-14);
        assert!(
            (a.volume() / volume - 1.0).abs() < 0.07,
            "{:e} {volume:e}",
            a.volume()
        );
    }
    let exact = Surface::from_stl(&text(&ell(1e-3))).unwrap().volume();
    assert_relative_eq!(exact, 3e-9, epsilon = 0.0, max_relative = 1e-6);
}

#[test]
fn bodies_from_stl_are_filled() {
    let hole = |x: &Vector3<f64>| x.xy().norm() < 0.55e-3;
    let notch = |x: &Vector3<f64>| x.x > 1.05e-3 && x.y > 1.05e-3;
    let nowhere = |_: &Vector3<f64>| false;
    let cases: [Case<'_>; 3] = [
        (ball(1e-3), &nowhere),
        (torus(1e-3, 0.4e-3), &hole),
        (ell(1e-3), &notch),
    ];
    for (facets, outside) in cases {
        let surface = Surface::from_stl(&binary(&facets)).unwrap();
        let packing = PackingSpec::quench(Container::Surface(surface.clone()), 250, 3)
            .build()
            .unwrap();
        let r = &packing.report;
        assert!(r.volume_fraction > 0.6 && r.dropped < 20, "{r:?}");
        assert_abs_diff_eq!(r.coordination_all, 6.2, epsilon = 0.01);
        assert!(
            packing
                .positions
                .iter()
                .all(|x| surface.contains(x) && !outside(x))
        );
        // The spheres reach every corner of the body.
        let (low, high) = surface.bounds();
        let ends = packing.positions.iter().zip(&packing.radii);
        for a in 0..3 {
            let reach = ends.clone().fold([f64::INFINITY, -f64::INFINITY], |m, (x, r)| {
                [m[0].min(x[a] - r), m[1].max(x[a] + r)]
            });
            assert!(reach[0] - low[a] < 0.6 * r.mean_radius && high[a] - reach[1] < 0.6 * r.mean_radius);
        }
    }
}

#[test]
fn cavities_are_left_empty() {
    let mut facets = ball(1e-3);
    facets.extend(ball(0.5e-3));
    let shell = Surface::from_stl(&text(&facets)).unwrap();
    let ratio = shell.volume() / Surface::from_stl(&text(&ball(1e-3))).unwrap().volume();
    assert_abs_diff_eq!(ratio, 0.875, epsilon = 1e-6);
    assert!(!shell.contains(&Vector3::zeros()) && shell.contains(&Vector3::new(0.75e-3, 0.0, 0.0)));
}

#[test]
fn bad_surfaces_have_names() {
    let mut open = ell(1e-3);
    open.pop();
    assert!(matches!(
        Surface::from_stl(&text(&open)),
        Err(Error::OpenSurface { count: 1, .. })
    ));
    let message = Surface::from_stl(b"what is this").unwrap_err().to_string();
    assert!(
        message.starts_with("this is no STL file that can be read"),
        "{message}"
    );
    let empty = Surface::from_stl(&binary(&[])).unwrap_err().to_string();
    assert!(empty.ends_with("it has no triangle"), "{empty}");
    let mut nan = ell(1e-3);
    nan.iter_mut()
        .flatten()
        .filter(|v| **v == Vector3::zeros())
        .for_each(|v| v.x = f64::NAN);
    assert!(matches!(
        Surface::from_stl(&binary(&nan)),
        Err(Error::NotFinite { object: "vertex", .. })
    ));
    // A Klein bottle as a grid: closed, every edge twice, yet one-sided.
    let n = 4_u32;
    let vertex = |i: u32, j: u32| {
        let (turned, j) = (i == n, j % n);
        (i % n) * n + if turned { (n - j) % n } else { j }
    };
    let mut klein = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let (a, b, c, d) = (
                vertex(i, j),
                vertex(i + 1, j),
                vertex(i + 1, j + 1),
                vertex(i, j + 1),
            );
            klein.extend([[a, b, c], [a, c, d]]);
        }
    }
    let points = (0..n * n).map(|k| Vector3::new(f64::from(k), f64::from(k * k), 1.0));
    let surface = Surface::oriented(points.collect(), klein);
    assert!(
        matches!(surface, Err(Error::OneSidedSurface { .. })),
        "{surface:?}"
    );
}

fn vtu(radius: &str, last: &str) -> Vec<u8> {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\">\n\
         <UnstructuredGrid><Piece NumberOfPoints=\"3\" NumberOfCells=\"0\">\n\
         <PointData><DataArray type=\"Float64\" Name=\"{radius}\" NumberOfComponents=\"1\" format=\"ascii\">\
         1e-3 1e-3 0.8e-3</DataArray></PointData>\n<CellData/>\n\
         <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\
         1e-3 2e-3 2e-3 3e-3 2e-3 2e-3 {last} 2e-3 2e-3</DataArray></Points>\n\
         <Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\"></DataArray>\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\"></DataArray>\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"></DataArray></Cells>\n\
         </Piece></UnstructuredGrid></VTKFile>\n"
    )
    .into_bytes()
}

#[test]
fn spheres_from_vtu_are_bonded_in_their_body() {
    let (x, r) = read_vtu(&vtu("radius", "4.8e-3"), None).unwrap();
    assert!(r == [1e-3, 1e-3, 0.8e-3] && x[2] == Vector3::new(4.8e-3, 2e-3, 2e-3));
    let named = read_vtu(&vtu("half width", "4.8e-3"), Some("half width")).unwrap();
    assert!(named.1 == r);
    let room = Container::cuboid(Vector3::zeros(), Vector3::new(6e-3, 4e-3, 4e-3)).unwrap();
    let packing = Packing::from_spheres(&room, &x, &r, 4.0 / 3.0).unwrap();
    assert!(packing.pairs == [[0, 1], [1, 2]] && (packing.volume / 96e-9 - 1.0).abs() < 1e-12);
}

#[test]
fn bad_vtu_files_have_names() {
    let message = |bytes: &[u8]| read_vtu(bytes, None).unwrap_err().to_string();
    let missing = message(&vtu("colour", "5e-3"));
    assert!(
        missing.starts_with("no point array named radius [m], radius"),
        "{missing}"
    );
    assert!(missing.ends_with("the file has: colour"), "{missing}");
    assert!(message(b"x,y,z,r").starts_with("this is no VTU file that can be read"));
    assert!(matches!(
        read_vtu(&vtu("r", "NaN"), None),
        Err(Error::NotFinite { index: 2, .. })
    ));
    // The third centre lies inside the second sphere.
    let (x, r) = read_vtu(&vtu("r", "3.5e-3"), None).unwrap();
    let room = Container::cuboid(Vector3::zeros(), Vector3::repeat(6e-3)).unwrap();
    let refusal = Packing::from_spheres(&room, &x, &r, 1.0).unwrap_err().to_string();
    assert!(
        refusal.contains("particles 1 and 2 are 5e-4 m apart")
            || refusal.contains("particles 1 and 2 are 4.99"),
        "{refusal}"
    );
}

/// Returns a piece with numbers of its points; another piece has the first of them.
fn piece(numbers: &str, kind: &str) -> Vec<u8> {
    let array = |name: &str, values: &str| {
        format!(
            "<DataArray type=\"Int64\" Name=\"{name}\" NumberOfComponents=\"1\" format=\"ascii\">{values}</DataArray>"
        )
    };
    let arrays = array("n", numbers) + &array("vtkGhostType", kind);
    String::from_utf8(vtu("r", "4.8e-3"))
        .unwrap()
        .replace("<PointData>", &format!("<PointData GlobalIds=\"n\">{arrays}"))
        .into_bytes()
}

#[test]
fn pieces_make_one_file_without_ghosts() {
    let (x, r) = read_vtu(&vtu("r", "4.8e-3"), None).unwrap();
    let (a, b) = (piece("7 3 0", "1 0 0"), piece("5 9 8", "0 1 1"));
    assert_eq!(read_vtu(&a, None).unwrap(), (x[1..].to_vec(), r[1..].to_vec()));
    // Sorted by their numbers 0, 3, 5.
    let merged = read_pieces(&[&a, &b], None).unwrap();
    assert_eq!(merged, (vec![x[2], x[1], x[0]], vec![r[2], r[1], r[0]]));
    // Without numbers in the order of the file.
    let plain = vtu("r", "4.8e-3");
    assert_eq!(read_pieces(&[&plain], None).unwrap(), (x, r));
    let short = read_vtu(&piece("5 9", "0 1 1"), None).unwrap_err();
    assert!(matches!(
        short,
        Error::LengthMismatch {
            what: "global numbers",
            found: 2,
            expected: 3
        }
    ));
    let named = b"<VTKFile type=\"PUnstructuredGrid\"><P><Piece Source=\"a_0.vtu\"/><Piece Source=\"a_1.vtu\"/></P></VTKFile>";
    assert_eq!(pieces_of_pvtu(named).unwrap(), ["a_0.vtu", "a_1.vtu"]);
    for (bad, wanted) in [
        (&plain[..], "PUnstructuredGrid"),
        (b"<VTKFile type=\"PUnstructuredGrid\"/>", "it names no pieces"),
        (b"", "this is no VTU file that can be read"),
    ] {
        let message = pieces_of_pvtu(bad).unwrap_err().to_string();
        assert!(message.contains(wanted), "{message}");
    }
}

/// Issue 26, D.6: a frame with displaced spheres or broken bonds is refused as a packing.
#[test]
fn a_frame_with_moved_spheres_or_broken_bonds_is_no_packing() {
    let frame = |moved: &str, broken: &str| {
        let array = |name: &str, parts: usize, values: &str| {
            format!(
                "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{parts}\" format=\"ascii\">{values}</DataArray>"
            )
        };
        let (moved, broken) = (
            array("displacement [m]", 3, moved),
            array("broken [-]", 1, broken),
        );
        String::from_utf8(vtu("r", "4.8e-3"))
            .unwrap()
            .replace("<PointData>", &format!("<PointData>{moved}"))
            .replace("<CellData/>", &format!("<CellData>{broken}</CellData>"))
            .into_bytes()
    };
    let still = "0 0 0 0 0 0 0 0 0";
    assert!(read_vtu(&frame(still, "0 0"), None).is_ok());
    let moved = frame("0 0 0 0 0 0 1e-9 -2e-9 0", "0 0");
    let broken = frame(still, "0 1");
    for (bytes, expected) in [(&moved, (2e-9, 0)), (&broken, (0.0, 1))] {
        for result in [
            read_vtu(bytes, None),
            read_pieces(&[&frame(still, "0 0"), bytes], None),
        ] {
            let Err(Error::NotAtRest { farthest, broken }) = result else {
                panic!("{result:?}");
            };
            assert!(
                (farthest - expected.0).abs() < 1e-24 && broken == expected.1,
                "{farthest} {broken}"
            );
        }
    }
}

/// Files with the same spheres in all forms that VTK writes give the same packing: base64 with 32-bit
/// headers, plain and zlib, in place and appended.
#[test]
fn vtu_forms_agree() {
    const POINTS: [&str; 2] = [
        "SAAAAPyp8dJNYlA//Knx0k1iYD/8qfHSTWJgP/p+arx0k2g//Knx0k1iYD/8qfHSTWJgP2EyVTAqqXM//Knx0k1iYD/8qfHSTWJgPw==",
        "AQAAAACAAABIAAAAKAAAAA==eJz7s/LjJd+kAPs/YDoBTv+qy9pTMjkDQzzRKNRAa2UxhjgA61kn1A==",
    ];
    const RADII: [&str; 2] = [
        "DAAAAG8SgzpvEoM6F7dROg==",
        "AQAAAACAAAAMAAAAEgAAAA==eJzLF2q2ygdi8e2BVgAYtQPW",
    ];
    let (x, r) = read_vtu(&vtu("radius", "4.8e-3"), None).unwrap();
    for (k, compressor) in ["", "compressor=\"vtkZLibDataCompressor\""]
        .into_iter()
        .enumerate()
    {
        for appended in [false, true] {
            let array = |name: &str, kind: &str, parts: usize, data: &str, offset: usize| {
                let head =
                    format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{parts}\"");
                match appended {
                    true => format!("{head} format=\"appended\" offset=\"{offset}\"/>"),
                    false => format!("{head} format=\"binary\">\n  {data}\n</DataArray>"),
                }
            };
            let tail = match appended {
                true => format!(
                    "<AppendedData encoding=\"base64\">\n_{}{}\n</AppendedData>",
                    RADII[k], POINTS[k]
                ),
                false => String::new(),
            };
            let text = format!(
                "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" header_type=\"UInt32\" {compressor}>\
                 <UnstructuredGrid><Piece NumberOfPoints=\"3\" NumberOfCells=\"0\"><PointData>{}</PointData>\
                 <Points>{}</Points></Piece></UnstructuredGrid>{tail}</VTKFile>",
                array("radius", "Float32", 1, RADII[k], 0),
                array("Points", "Float64", 3, POINTS[k], RADII[k].len()),
            );
            let (y, s) = read_vtu(text.as_bytes(), None).unwrap();
            assert!(y == x && s.iter().zip(&r).all(|(s, r)| (s / r - 1.0).abs() < 1e-7));
            // The data end in the middle of an array.
            let short = text.replace(&POINTS[k][60..], "");
            let message = read_vtu(short.as_bytes(), None).unwrap_err().to_string();
            assert!(message.ends_with("an array is cut short or damaged"), "{message}");
        }
    }
}

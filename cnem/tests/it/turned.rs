//! GOAL: a body stays the same when rotated, sheared, far away, tiny or huge, and with cospherical nodes;
//! doubtful results are refused. MODEL: structured and scattered blocks, cylinders, cones, prisms, tori,
//! L-shapes, holes, blocky random bodies; their own surface, the hull, or the surface of a mesh of
//! tetrahedra. EXPECTED: the energy of the six linear displacement fields to 1e-10, no node added in a
//! rotation, surface points inside.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::bodies::{Body, Map, all_bodies, grid_hull, rings, voxels};
use arlequin_core::{LinearModel, Model};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::generate::Cylinder;
use cnem::natural::{Interpolant, Scratch};
use cnem::{CnemModel, Elastic, Error, NaturalField, Options, Stabilisation};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

fn model(body: &Body) -> cnem::Result<CnemModel> {
    let domain = Domain::new(&body.points, &body.surface)?;
    CnemModel::new("body", domain, Elastic::new(1.0, 0.25, 1.0)?, Options::default())
}

/// Returns the largest relative error of the energies of the six linear fields, for λ = μ = 0.4.
fn defect(model: &CnemModel, volume: f64) -> f64 {
    let nodes = model.nodes();
    let middle = nodes.iter().map(|p| p.coords).sum::<Vector3<f64>>() / nodes.len() as f64;
    let mut worst = 0.0_f64;
    for k in 0..6 {
        let mut g = Matrix3::zeros();
        g[(k % 3, (k + k / 3) % 3)] = 1.0;
        let strain = (g + g.transpose()) * 0.5;
        let exact = (0.2 * strain.trace() * strain.trace() + 0.4 * strain.norm_squared()) * volume;
        let u: Vec<f64> = nodes
            .iter()
            .flat_map(|p| <[f64; 3]>::from(g * (p.coords - middle)))
            .collect();
        let error = (model.internal_energy(&u) / exact - 1.0).abs();
        worst = if error > worst || error.is_nan() {
            error
        } else {
            worst
        };
    }
    worst
}

/// Asserts the energies of every body under every map; with `keep`, also that no node is added.
fn assert_exact(bodies: &[Body], maps: impl Iterator<Item = Map>, keep: bool) {
    for (k, map) in maps.enumerate() {
        for body in bodies {
            let body = body.mapped(&map);
            let built = model(&body);
            let built = built.unwrap_or_else(|e| panic!("{} in place {k}: {e}", body.name));
            let error = defect(&built, body.volume);
            assert!(error <= 1e-10, "{} in place {k}: {error:e}", body.name);
            let finite = built.stiffness().data().iter().all(|x| x.is_finite());
            assert!(finite, "{} in place {k}: stiffness", body.name);
            let unchanged = built.nodes().len() == body.points.len();
            assert!(
                unchanged || !keep,
                "{} in place {k}: {} nodes",
                body.name,
                built.nodes().len()
            );
        }
    }
}

/// Asserts that the boundary of every body in every place is closed, has all facets outwards, and encloses
/// the volume.
fn assert_outward(bodies: &[Body], maps: impl Iterator<Item = Map>) {
    for (k, map) in maps.enumerate() {
        for body in bodies {
            let body = body.mapped(&map);
            let name = format!("{} in place {k}", body.name);
            let domain = Domain::new(&body.points, &body.surface).unwrap();
            let mut edges = std::collections::BTreeMap::<[usize; 2], i32>::new();
            let (nodes, mut volume) = (domain.nodes(), 0.0);
            for f in domain.boundary() {
                let [a, b, c] = f.map(|n| nodes[n] - nodes[0]);
                volume += a.dot(&b.cross(&c)) / 6.0;
                for [p, q] in [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]] {
                    *edges.entry([p.min(q), p.max(q)]).or_default() += if p < q { 1 } else { -1 };
                }
            }
            // The two facets at an edge run along it in opposite directions.
            assert!(edges.values().all(|n| *n == 0), "{name}: open, or turned");
            assert!(
                (volume / body.volume - 1.0).abs() < 1e-10,
                "{name}: {volume:e} m^3"
            );
        }
    }
}

#[test]
fn boundaries_look_outwards_turned_sheared_and_shifted() {
    let bodies = all_bodies();
    assert_outward(&bodies, (1..=20).map(Map::turn));
    assert_outward(&bodies, (1..=20).map(|seed| Map::shear(seed, 0.3)));
}

#[test]
fn linear_fields_have_their_energy_in_twenty_turns() {
    assert_exact(&all_bodies(), (1..=20).map(Map::turn), true);
}

#[test]
fn linear_fields_have_their_energy_in_twenty_shears() {
    assert_exact(&all_bodies(), (1..=20).map(|seed| Map::shear(seed, 0.3)), false);
}

#[test]
fn linear_fields_have_their_energy_tiny_huge_and_far_away() {
    let places = [
        Map::turn(31).scaled(1e-9),
        Map::turn(32).scaled(1e6),
        Map::turn(33).moved([100.0, -20.0, 50.0]),
        Map::turn(34).moved([1e4, 2e4, -5e3]),
        Map::turn(35).scaled(1e-4).moved([1.0, 2.0, -0.5]),
    ];
    assert_exact(&all_bodies(), places.into_iter(), true);
}

#[test]
fn turned_lattices_of_several_kinds() {
    let lattice = |name: &str, n: usize, cell: &[[f64; 3]]| {
        let mut points = Vec::new();
        for c in 0..(n + 1).pow(3) {
            let origin = [c % (n + 1), c / (n + 1) % (n + 1), c / (n + 1).pow(2)];
            let placed = cell
                .iter()
                .map(|d| [0, 1, 2].map(|k: usize| origin[k] as f64 + d[k]));
            points.extend(
                placed
                    .filter(|p| p.iter().all(|x| *x <= n as f64))
                    .map(Point3::from),
            );
        }
        Body::hull(name, points, (n as f64).powi(3))
    };
    let faces = [[0.0; 3], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]];
    let bodies = [
        lattice("face-centred", 2, &faces),
        lattice("body-centred", 3, &[[0.0; 3], [0.5; 3]]),
        lattice("grid", 6, &[[0.0; 3]]),
        rings("four rings", 6, 4, |_| 2.0),
        rings("frustum", 5, 3, |z| 2.0 + 0.4 * z),
    ];
    assert_exact(&bodies, (41..46).map(Map::turn), true);
}

/// The generated cylinder has exact energies, rotated by 30° about y.
#[test]
fn the_generated_cylinder_turned() {
    let shape = Cylinder::with_spacing([0.0, 6e-3], 1e-3, 0.5e-3).unwrap();
    let body = Body::hull(
        "cylinder",
        shape.nodes().unwrap(),
        shape.domain().unwrap().volume(),
    );
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 30.0_f64.to_radians());
    let map = Map {
        matrix: turn.into_inner(),
        shift: Vector3::zeros(),
    };
    assert_exact(&[body], [map].into_iter(), true);
}

/// Faces of a file with fewer digits are planar only to these digits, far above round-off: the body is exact,
/// or refused by name.
#[test]
fn coordinates_with_few_digits_are_exact_or_refused() {
    let bodies = [
        grid_hull([2, 2, 2]),
        rings("cylinder", 4, 2, |_| 1.5),
        rings("cone", 4, 2, |z| 0.5 * (3.0 - z)),
    ];
    let (mut exact, mut refused) = (0, 0);
    for digits in 5..16 {
        for (seed, body) in (200..203).flat_map(|s| bodies.iter().map(move |b| (s, b))) {
            let mut body = body.mapped(&Map::turn(seed));
            for x in body.points.iter_mut().flat_map(|p| p.iter_mut()) {
                *x = format!("{x:.digits$e}").parse().unwrap();
            }
            match model(&body) {
                Ok(built) => {
                    let error = defect(&built, built.domain().volume());
                    assert!(error <= 1e-9, "{} {digits} {seed}: {error:e}", body.name);
                    exact += 1;
                }
                Err(Error::WrongForces { .. } | Error::CellOpen { .. }) => refused += 1,
                Err(other) => panic!("{other}"),
            }
        }
    }
    assert!(exact >= 95 && refused <= 4, "{exact} exact, {refused} refused");
}

/// The tip of a cantilever of 9 × 3 × 3 nodes moves equally far for any direction of the beam.
#[test]
fn a_turned_cantilever_bends_as_far() {
    let beam = grid_hull([8, 2, 2]);
    let deflection = |degrees: f64, stabilisation: Stabilisation| {
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians());
        let map = Map {
            matrix: turn.into_inner(),
            shift: Vector3::zeros(),
        };
        let placed = beam.mapped(&map);
        let domain = Domain::new(&placed.points, &placed.surface).unwrap();
        let options = Options {
            stabilisation,
            ..Options::default()
        };
        let model = CnemModel::new("beam", domain, Elastic::new(1.0, 0.25, 1.0).unwrap(), options).unwrap();
        let mut fixed = vec![false; 3 * beam.points.len()];
        let mut load = vec![0.0; fixed.len()];
        let direction = turn * Vector3::z();
        for (i, p) in beam.points.iter().enumerate() {
            fixed[3 * i..3 * i + 3].fill(p.x == 0.0);
            if p.x > 7.5 {
                (0..3).for_each(|k| load[3 * i + k] = 1e-4 * direction[k]);
            }
        }
        let mut u = vec![0.0; fixed.len()];
        crate::common::solve(&model.stiffness(), &fixed, &load, &mut u);
        let tip = beam
            .points
            .iter()
            .position(|p| *p == Point3::new(8.0, 1.0, 1.0))
            .unwrap();
        direction.dot(&Vector3::new(u[3 * tip], u[3 * tip + 1], u[3 * tip + 2]))
    };
    for degrees in [25.0, 45.0, 55.0] {
        let ratio = deflection(degrees, Stabilisation::None) / deflection(0.0, Stabilisation::None);
        // The boundary is integrated by triangles, and round-off decides between equal diagonals of a grid.
        assert!((ratio - 1.0).abs() < 1e-3, "{degrees}: {ratio}");
        // The same holds for the stabilising tetrahedra: 0.7 % with two cells across.
        let stable = Stabilisation::default();
        let ratio = deflection(degrees, stable) / deflection(0.0, stable);
        assert!((ratio - 1.0).abs() < 1e-2, "{degrees}: {ratio}");
    }
}

/// Returns the integer points on a sphere, which are exactly cospherical.
fn sphere(square: i64) -> Vec<Point3<f64>> {
    let r = (square as f64).sqrt() as i64;
    let mut out = Vec::new();
    for (x, y) in (-r..=r).flat_map(|x| (-r..=r).map(move |y| (x, y))) {
        let z = ((square - x * x - y * y).max(0) as f64).sqrt().round() as i64;
        if x * x + y * y + z * z == square {
            out.push(Point3::new(x as f64, y as f64, z as f64));
            if z != 0 {
                out.push(Point3::new(x as f64, y as f64, -z as f64));
            }
        }
    }
    out
}

#[test]
fn exactly_cospherical_nodes_have_closed_cells() {
    for (square, count) in [(9, 30), (794, 504)] {
        let points = sphere(square);
        assert_eq!(points.len(), count);
        for map in [Map::turn(1), Map::turn(2).scaled(1e-3)]
            .map(Some)
            .into_iter()
            .chain([None])
        {
            let mut body = Body::hull("sphere", points.clone(), 1.0);
            if let Some(map) = map {
                body = body.mapped(&map);
            }
            let domain = Domain::new(&body.points, &body.surface).unwrap();
            let closure = domain.voronoi().unwrap().closure(&domain);
            assert!(
                closure.area < 1e-12 && closure.volume < 1e-12,
                "{count}: {closure:?}"
            );
            if count == 30 {
                body.volume = domain.volume();
                assert!(defect(&model(&body).unwrap(), body.volume) < 1e-12);
            }
        }
    }
}

#[test]
fn nodes_on_the_surface_only_are_warned_of_or_refused() {
    let domain = Domain::new(&sphere(794), &Surface::convex_hull()).unwrap();
    let warning = domain.neighbours().warning().unwrap();
    assert!(
        warning.contains("504 of 504 nodes lie on the surface"),
        "{warning}"
    );
    assert_eq!(grid_hull([3; 3]).points.len(), 64);
    assert_eq!(
        model(&grid_hull([3; 3])).unwrap().warnings(),
        Vec::<String>::new()
    );
    let many = Body::hull("sphere", sphere(MANY.0), 1.0);
    assert_eq!(many.points.len(), MANY.1);
    let error = model(&many).err();
    assert!(
        matches!(error, Some(Error::TooManyNeighbours { .. })),
        "{error:?}"
    );
}

/// Twenty-seven nodes inside 20 160 cospherical ones would have 589 neighbours on average and are refused at
/// once.
#[test]
fn many_cospherical_nodes_around_a_few_are_refused_at_once() {
    let mut points = sphere(MANY.0);
    let step = |i: i32| 300.0 * f64::from(i % 3 - 1);
    points.extend((0..27).map(|i| Point3::new(step(i), step(i / 3), step(i / 9))));
    let start = std::time::Instant::now();
    let error = model(&Body::hull("sphere", points, 1.0)).err();
    let seconds = start.elapsed().as_secs_f64();
    assert!(
        matches!(error, Some(Error::TooManyNeighbours { mean, limit, .. }) if mean > 500.0 && limit < 200.0),
        "{error:?}"
    );
    assert!(seconds < 30.0, "{seconds} s");
}

/// Square of the radius of a sphere, and its number of integer points.
const MANY: (i64, usize) = (901_325, 20_160);

#[test]
fn points_on_the_surface_are_inside() {
    let places = [
        Map::turn(51),
        Map::shear(52, 0.2),
        Map::turn(53).moved([100.0, 20.0, -50.0]),
    ];
    let (mut scratch, mut next) = (Scratch::new(), crate::common::noise(9));
    for (map, body) in places
        .iter()
        .flat_map(|m| all_bodies().into_iter().map(move |b| (m, b)))
    {
        let body = body.mapped(map);
        let domain = Domain::new(&body.points, &body.surface).unwrap();
        let size = domain.nodes().iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
        let faces = match body.surface.boundary_faces() {
            [] => domain.constrained_faces().map(|f| f.0).collect(),
            own => own.to_vec(),
        };
        for face in faces {
            let [a, b, c] = face.map(|v| body.points[v]);
            for _ in 0..10 {
                let (u, v) = (0.5 + 0.5 * next(), 0.5 + 0.5 * next());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let x = a + (b - a) * u + (c - a) * v;
                let row = domain.shape(Interpolant::Laplace, &x, &mut scratch).unwrap();
                let pairs = row.nodes.iter().zip(&row.values);
                let moment: Vector3<f64> = pairs.map(|(&v, w)| (domain.nodes()[v] - x) * *w).sum();
                assert!(moment.norm() < 1e-13 * (1.0 + size), "{} {moment}", body.name);
                let normal = (b - a).cross(&(c - a)).normalize() * (1e-9 * size);
                assert!(
                    !(domain.contains(&(x + normal)) && domain.contains(&(x - normal))),
                    "{}",
                    body.name
                );
            }
        }
    }
}

/// Points on straight edges are inside. Along such edges the complex has needles and flat tetrahedra, whose
/// planes point anywhere: before, 223 of 232 800 points were outside.
#[test]
fn points_on_straight_edges_are_inside() {
    for (body, turn) in all_bodies().iter().flat_map(|b| (1..=10).map(move |t| (b, t))) {
        let body = body.mapped(&Map::turn(turn));
        let domain = Domain::new(&body.points, &body.surface).unwrap();
        let mut next = crate::common::noise(turn);
        let faces: Vec<_> = match body.surface.boundary_faces() {
            [] => domain.constrained_faces().map(|f| f.0).collect(),
            own => own.to_vec(),
        };
        for (a, b) in faces
            .iter()
            .flat_map(|f| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])])
        {
            for _ in 0..4 {
                let x = body.points[a] + (body.points[b] - body.points[a]) * (0.5 + 0.5 * next());
                assert!(domain.contains(&x), "{} in turn {turn}: {x}", body.name);
            }
        }
    }
    for (n, turn) in [2, 4, 6].into_iter().flat_map(|n| (1..=30).map(move |t| (n, t))) {
        let (map, size) = (Map::turn(turn), n as f64);
        let body = grid_hull([n; 3]).mapped(&map);
        let domain = Domain::new(&body.points, &body.surface).unwrap();
        let mut next = crate::common::noise(turn);
        for (edge, _) in (0..12).flat_map(|e| (0..20).map(move |k| (e, k))) {
            let axis = edge % 3;
            let mut x = Vector3::zeros();
            x[axis] = size * (0.5 + 0.5 * next());
            x[(axis + 1) % 3] = size * f64::from(edge as u32 / 3 % 2);
            x[(axis + 2) % 3] = size * f64::from(edge as u32 / 6);
            assert!(
                domain.contains(&Point3::from(map.matrix * x)),
                "{n} cells in turn {turn}: {x}"
            );
            // Three tolerances away from the edge, points outside are called outside.
            let mut outward = x - Vector3::repeat(0.5 * size);
            outward[axis] = 0.0;
            let away = x + outward.normalize() * (3.0 * domain.tolerance());
            assert!(
                !domain.contains(&Point3::from(map.matrix * away)),
                "{n} cells in turn {turn}: {away}"
            );
        }
    }
}

#[test]
fn turned_lines_and_planes_are_named_as_exact_ones() {
    for seed in 1..=20 {
        let map = Map::turn(seed).moved([0.3, -2.0, 1.0]);
        let placed = |p: Vector3<f64>| Point3::from(map.matrix * p + map.shift);
        let line: Vec<_> = (0..9)
            .map(|i| placed(Vector3::new(f64::from(i), 0.0, 0.0)))
            .collect();
        let plane: Vec<_> = (0..25)
            .map(|i| placed(Vector3::new(f64::from(i % 5), f64::from(i / 5), 0.0)))
            .collect();
        let hull = Surface::convex_hull();
        assert_eq!(
            Domain::new(&line, &hull).err(),
            Some(Error::AllCollinear { nodes: 9 })
        );
        assert_eq!(
            Domain::new(&plane, &hull).err(),
            Some(Error::AllCoplanar { nodes: 25 })
        );
        let field = NaturalField::from_points(&plane, Interpolant::Laplace).err();
        assert_eq!(field, Some(Error::AllCoplanar { nodes: 25 }));
    }
}

#[test]
fn nodes_closer_than_round_off_are_named() {
    let mut body = grid_hull([2, 2, 2]).mapped(&Map::turn(4).moved([10.0, 0.0, 0.0]));
    let twin = body.points[13] + Vector3::new(0.0, 4e-15, 0.0);
    body.points.push(twin);
    assert_ne!(body.points[13], twin);
    let error = Domain::new(&body.points, &body.surface).err();
    assert!(
        matches!(
            error,
            Some(Error::NodesTooClose {
                first: 13,
                second: 27,
                ..
            })
        ),
        "{error:?}"
    );
}

#[test]
fn cylinders_that_make_no_sense_are_refused() {
    let good = Cylinder::with_spacing([0.0, 4.0], 1.0, 0.5).unwrap();
    let wrong = [
        ("rings", Cylinder { rings: 0, ..good }),
        ("layers", Cylinder { layers: 1, ..good }),
        ("radius", Cylinder { radius: -1.0, ..good }),
        (
            "radius",
            Cylinder {
                radius: f64::NAN,
                ..good
            },
        ),
        (
            "length",
            Cylinder {
                x: [1.0, 1.0],
                ..good
            },
        ),
        ("jitter", Cylinder { jitter: 0.6, ..good }),
    ];
    for (parameter, cylinder) in wrong {
        for error in [cylinder.nodes().err(), cylinder.domain().err()] {
            assert!(
                matches!(error, Some(Error::Parameter { name, .. }) if name == parameter),
                "{parameter}: {error:?}"
            );
        }
    }
    let ring = voxels("ring", [3, 3, 1], 0.0, |i, j, _| [i, j] != [1; 2]);
    assert!(model(&ring).is_ok());
}

//! Hard cases of the geometry and the outcome of each.

use approx::assert_abs_diff_eq;
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::{Interpolant, Scratch};
use cnem::{Error, Result};
use nalgebra::{Point3, Vector3};

fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Returns the corners of a box; bit k of the index belongs to axis k.
fn corners(low: [f64; 3], high: [f64; 3]) -> Vec<Point3<f64>> {
    let pick = |i: usize, k: usize| if i >> k & 1 == 1 { high[k] } else { low[k] };
    (0..8)
        .map(|i| Point3::new(pick(i, 0), pick(i, 1), pick(i, 2)))
        .collect()
}

/// Returns the twelve faces of a box whose corners start at `first`.
fn skin(first: usize) -> Vec<[usize; 3]> {
    let quads = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .map(|f| f.map(|v| v + first))
        .collect()
}

fn fill(points: &mut Vec<Point3<f64>>, n: usize, low: [f64; 3], high: [f64; 3], seed: u64) {
    let mut r = noise(seed);
    for _ in 0..n {
        points.push(Point3::from(
            [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * (0.05 + 0.9 * r())),
        ));
    }
}

fn assert_sound(domain: &Domain, volume: f64) {
    assert!(
        (domain.volume() - volume).abs() < 1e-9 * volume,
        "{} {:?}",
        domain.volume(),
        domain.recovery()
    );
    let nodes = domain.nodes();
    let mut s = Scratch::new();
    for t in domain.elements() {
        let p = t.map(|v| nodes[v].coords);
        let x = Point3::from(p[0] * 0.1 + p[1] * 0.2 + p[2] * 0.3 + p[3] * 0.4);
        for kind in [Interpolant::Sibson, Interpolant::Laplace] {
            let row = domain.shape(kind, &x, &mut s).expect("inside");
            let mut moment: Vector3<f64> = Vector3::zeros();
            for (&v, &w) in row.nodes.iter().zip(&row.values) {
                assert!(w >= 0.0);
                moment += (nodes[v] - x) * w;
            }
            assert!(moment.norm() < 1e-12, "{moment}");
            assert_abs_diff_eq!(row.values.iter().sum::<f64>(), 1.0, epsilon = 1e-12);
        }
    }
}

#[test]
fn four_nodes_only() -> Result<()> {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
    let domain = Domain::new(&points, &Surface::convex_hull())?;
    assert_sound(&domain, 1.0 / 6.0);
    let cells = domain.voronoi()?;
    assert!(cells.closure(&domain).volume < 1e-14);
    Ok(())
}

#[test]
fn all_nodes_in_a_plane() {
    let points: Vec<_> = (0..25)
        .map(|i| Point3::new(f64::from(i % 5), f64::from(i / 5), 0.0))
        .collect();
    assert_eq!(
        Domain::new(&points, &Surface::convex_hull()).err(),
        Some(Error::AllCoplanar { nodes: 25 })
    );
}

#[test]
fn duplicate_nodes() {
    let mut points = corners([0.0; 3], [1.0; 3]);
    points.push(points[3]);
    assert!(matches!(
        Domain::new(&points, &Surface::boundary(skin(0))),
        Err(Error::DuplicateNodes { count: 1, .. })
    ));
}

#[test]
fn node_outside_its_boundary() {
    let mut points = corners([0.0; 3], [1.0; 3]);
    points.push(Point3::new(0.5, 0.5, 1.5));
    let error = Domain::new(&points, &Surface::boundary(skin(0))).err();
    assert!(
        matches!(
            error,
            Some(Error::NodeOutside {
                node: 8,
                count: 1,
                ..
            })
        ),
        "{error:?}"
    );
}

#[test]
fn open_surface() {
    let points = corners([0.0; 3], [1.0; 3]);
    let mut faces = skin(0);
    faces.pop();
    let error = Domain::new(&points, &Surface::boundary(faces)).err();
    assert!(
        matches!(
            error,
            Some(Error::OpenSurface {
                open_edges: 3,
                faces: 1,
                ..
            })
        ),
        "{error:?}"
    );
}

#[test]
fn wrong_faces() {
    let points = corners([0.0; 3], [1.0; 3]);
    let build = |f: Vec<[usize; 3]>| Domain::new(&points, &Surface::boundary(f)).err();
    assert!(matches!(
        build(vec![[0, 1, 9]]),
        Some(Error::UnknownNode {
            face: 0,
            node: 9,
            nodes: 8
        })
    ));
    assert!(matches!(
        build(vec![[0, 1, 1]]),
        Some(Error::FlatFace { face: 0, .. })
    ));
    let twice = [skin(0), vec![[4, 0, 6]]].concat();
    assert!(matches!(
        build(twice),
        Some(Error::RepeatedFace {
            first: 0,
            second: 12,
            ..
        })
    ));
}

#[test]
fn self_intersecting_surface() {
    let mut points = corners([0.0; 3], [1.0; 3]);
    points.extend(corners([0.5, 0.3, 0.4], [1.7, 0.6, 0.7]));
    let error = Domain::new(&points, &Surface::boundary([skin(0), skin(8)].concat())).err();
    assert!(matches!(error, Some(Error::SelfIntersection { .. })), "{error:?}");
}

#[test]
fn hole() -> Result<()> {
    let mut points = corners([0.0; 3], [3.0; 3]);
    points.extend(corners([1.0; 3], [2.0; 3]));
    let domain = Domain::new(&points, &Surface::boundary([skin(0), skin(8)].concat()))?;
    assert_sound(&domain, 26.0);
    assert!(!domain.contains(&Point3::new(1.5, 1.5, 1.5)));
    assert!(domain.contains(&Point3::new(1.5, 1.5, 1.0)));
    Ok(())
}

#[test]
fn two_disjoint_bodies() -> Result<()> {
    let mut points = corners([0.0; 3], [1.0; 3]);
    points.extend(corners([1.5, 0.0, 0.0], [2.5, 1.0, 1.0]));
    fill(&mut points, 30, [0.0; 3], [1.0; 3], 1);
    fill(&mut points, 30, [1.5, 0.0, 0.0], [2.5, 1.0, 1.0], 2);
    let domain = Domain::new(&points, &Surface::boundary([skin(0), skin(8)].concat()))?;
    assert_sound(&domain, 2.0);
    let mut s = Scratch::new();
    let row = domain.shape(Interpolant::Sibson, &Point3::new(0.97, 0.5, 0.5), &mut s)?;
    assert!(
        row.nodes
            .iter()
            .zip(&row.values)
            .all(|(&v, &w)| w <= 0.0 || domain.nodes()[v].x <= 1.0)
    );
    let between = domain.shape(Interpolant::Sibson, &Point3::new(1.25, 0.5, 0.5), &mut s);
    assert!(matches!(between, Err(Error::OutsideDomain { .. })));
    Ok(())
}

#[test]
fn coarse_skin_with_nodes_on_it() -> Result<()> {
    let mut points = corners([0.0; 3], [4.0; 3]);
    for i in 0..125 {
        let p = Point3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25));
        if !points.contains(&p) {
            points.push(p);
        }
    }
    let domain = Domain::new(&points, &Surface::boundary(skin(0)))?;
    assert!(domain.recovery().inserted.is_empty());
    assert_sound(&domain, 64.0);
    Ok(())
}

/// Given diagonals that differ from those of the Delaunay complex are swapped, and no point is inserted.
#[test]
fn wrong_diagonals_on_a_grid() -> Result<()> {
    let node = |i: usize, j: usize, k: usize| i + 4 * (j + 4 * k);
    let points: Vec<_> = (0..64)
        .map(|i| Point3::new(f64::from(i % 4), f64::from(i / 4 % 4), f64::from(i / 16)))
        .collect();
    for second in [false, true] {
        let mut faces = Vec::new();
        let mut quad = |q: [usize; 4]| {
            let s = usize::from(second);
            faces.push([q[s], q[s + 1], q[s + 2]]);
            faces.push([q[s], q[s + 2], q[(s + 3) % 4]]);
        };
        for (a, b) in (0..9).map(|i| (i % 3, i / 3)) {
            for side in [0, 3] {
                quad([
                    node(side, a, b),
                    node(side, a + 1, b),
                    node(side, a + 1, b + 1),
                    node(side, a, b + 1),
                ]);
                quad([
                    node(a, side, b),
                    node(a + 1, side, b),
                    node(a + 1, side, b + 1),
                    node(a, side, b + 1),
                ]);
                quad([
                    node(a, b, side),
                    node(a + 1, b, side),
                    node(a + 1, b + 1, side),
                    node(a, b + 1, side),
                ]);
            }
        }
        let domain = Domain::new(&points, &Surface::boundary(faces))?;
        assert!(domain.recovery().inserted.is_empty());
        assert_sound(&domain, 27.0);
    }
    Ok(())
}

/// The faces of a coarse crack among many nodes are not Delaunay: they are recovered with inserted points, or
/// refused by name.
#[test]
fn missing_faces_are_recovered_or_named() -> Result<()> {
    let mut points = corners([0.0; 3], [4.0, 4.0, 2.0]);
    points.extend([[1.0, 1.0, 0.9], [3.0, 1.0, 1.0], [3.0, 3.0, 1.1], [1.0, 3.0, 1.0]].map(Point3::from));
    fill(&mut points, 120, [0.0; 3], [4.0, 4.0, 2.0], 3);
    let surface = Surface::boundary(skin(0)).with_cracks(vec![[8, 9, 10], [8, 10, 11]]);
    let error = Domain::with_limit(&points, &surface, 0).err();
    assert!(
        matches!(
            error,
            Some(Error::FacesNotRecovered {
                inserted: 0,
                limit: 0,
                ..
            })
        ),
        "{error:?}"
    );
    let domain = Domain::new(&points, &surface)?;
    let inserted = &domain.recovery().inserted;
    assert!(!inserted.is_empty() && inserted.len() < 400, "{}", inserted.len());
    let copies = domain.copies().count();
    assert_eq!(domain.nodes().len(), points.len() + inserted.len() + copies);
    assert!(inserted.iter().all(|i| i.face == 12 || i.face == 13));
    let area: f64 = domain
        .constrained_faces()
        .filter(|f| f.1)
        .map(|f| f.0.map(|v| domain.nodes()[v]))
        .map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)).norm())
        .sum();
    let p = |i: usize| points[i];
    let expected = 0.5 * (p(9) - p(8)).cross(&(p(10) - p(8))).norm()
        + 0.5 * (p(10) - p(8)).cross(&(p(11) - p(8))).norm();
    assert_abs_diff_eq!(area, expected, epsilon = 1e-12);
    assert_sound(&domain, 32.0);
    Ok(())
}

/// A coarse re-entrant surface between scattered nodes, given as the boundary of a tetrahedral mesh, is
/// recovered.
#[test]
fn coarse_re_entrant_surface_is_recovered() -> Result<()> {
    let mut points = corners([0.0; 3], [2.0; 3]);
    points.extend(corners([0.7; 3], [1.3; 3]));
    fill(&mut points, 300, [0.0, 0.0, 0.0], [2.0, 2.0, 0.74], 3);
    points.retain(|p| p.z <= 0.69 || p.z >= 1.29 || (p.x - 1.0).abs() > 0.29);
    let domain = Domain::new(&points, &Surface::boundary([skin(0), skin(8)].concat()))?;
    assert_sound(&domain, 8.0 - 0.216);
    Ok(())
}

#[test]
fn cylinder_between_its_nodes() -> Result<()> {
    let (around, along) = (16, 12);
    let angle = |i: usize| 2.0 * std::f64::consts::PI * (i % around) as f64 / around as f64;
    let mut points: Vec<_> = (0..around * along)
        .map(|i| Point3::new(angle(i).cos(), angle(i).sin(), (i / around) as f64 * 0.4))
        .collect();
    for k in 0..along {
        points.push(Point3::new(0.0, 0.0, k as f64 * 0.4));
    }
    let mut faces = Vec::new();
    for k in 0..along - 1 {
        for i in 0..around {
            let v = |di: usize, dk: usize| (i + di) % around + (k + dk) * around;
            faces.push([v(0, 0), v(1, 0), v(1, 1)]);
            faces.push([v(0, 0), v(1, 1), v(0, 1)]);
        }
    }
    for i in 0..around {
        let top = (along - 1) * around;
        faces.push([(i + 1) % around, i, around * along]);
        faces.push([top + i, top + (i + 1) % around, around * along + along - 1]);
    }
    let domain = Domain::new(&points, &Surface::boundary(faces))?;
    let volume =
        0.5 * around as f64 * (2.0 * std::f64::consts::PI / around as f64).sin() * (along - 1) as f64 * 0.4;
    assert_sound(&domain, volume);
    let closure = domain.voronoi()?.closure(&domain);
    assert!(closure.volume < 1e-12 && closure.area < 1e-11, "{closure:?}");
    Ok(())
}

/// Slivers among the nodes of a grid that are moved by up to 1e-9 leave a sound domain.
#[test]
fn slivers() -> Result<()> {
    let mut r = noise(3);
    let points: Vec<_> = (0..216)
        .map(|i| {
            Point3::new(f64::from(i % 6), f64::from(i / 6 % 6), f64::from(i / 36)).map(|c| c + 1e-9 * r())
        })
        .collect();
    let domain = Domain::new(&points, &Surface::convex_hull())?;
    assert_sound(&domain, domain.volume());
    Ok(())
}

#[test]
fn spacing_ratio_of_a_thousand() -> Result<()> {
    let mut points = corners([0.0; 3], [1.0; 3]);
    fill(&mut points, 200, [0.0; 3], [1.0; 3], 4);
    fill(&mut points, 200, [0.4; 3], [0.401; 3], 5);
    let domain = Domain::new(&points, &Surface::convex_hull())?;
    assert_sound(&domain, 1.0);
    let closure = domain.voronoi()?.closure(&domain);
    assert!(closure.volume < 1e-12, "{closure:?}");
    Ok(())
}

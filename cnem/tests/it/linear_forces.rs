//! GOAL: rigid motions and constant strains leave no forces but the tractions at the boundary, in bodies that
//! are hard to divide. MODEL: blocks with an oblique crack of a fan of triangles, blocky bodies, and boxes of
//! twelve triangles with nodes on their faces, rotated. EXPECTED: forces in equilibrium to 1e-11 of those
//! around a node; no body refused, no node added by a rotation.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::common::bodies::{Body, Map, blocky};
use arlequin_core::{LinearModel, Model};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::{CnemModel, Elastic, Options, generate};
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::PI;

/// Returns the largest nodal force that a linear field leaves, relative to the neighbours' forces on the
/// node.
fn force_defect(model: &mut CnemModel) -> f64 {
    let g = Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6);
    let [lambda, mu] = model.material().lame();
    let stress = Matrix3::identity() * (lambda * g.trace()) + (g + g.transpose()) * mu;
    let middle = nalgebra::center(&model.nodes()[0], &model.nodes()[model.nodes().len() - 1]);
    let displacement = |x: &Point3<f64>| <[f64; 3]>::from(g * (x - middle));
    let u: Vec<f64> = model.nodes().iter().flat_map(displacement).collect();
    let mut f = vec![0.0; u.len()];
    model.add_internal_forces(&u, &mut f).unwrap();
    for facet in model.boundary() {
        let traction = stress * facet.area;
        for (node, value) in facet.nodes.iter().zip(&facet.values) {
            (0..3).for_each(|k| f[3 * node + k] += traction[k] * value);
        }
    }
    let mut scales = vec![0.0; f.len() / 3];
    for (value, (i, j)) in model.stiffness().iter() {
        let between = (model.nodes()[i / 3] - model.nodes()[j / 3]).norm();
        scales[i / 3] += value.abs() * between;
    }
    let forces = f.as_chunks::<3>().0.iter().zip(scales);
    let defects = forces.map(|(f, s)| Vector3::from(*f).norm() / s);
    defects.fold(0.0, |m, d| if d > m || d.is_nan() { d } else { m })
}

/// Returns the force defect of a body and the number of nodes added to it.
fn measure(points: &[Point3<f64>], surface: &Surface) -> cnem::Result<(f64, usize)> {
    let domain = Domain::new(points, surface)?;
    let added = domain.recovery().inserted.len();
    let material = Elastic::new(1.0, 0.25, 1.0)?;
    let mut model = CnemModel::new("body", domain, material, Options::default())?;
    Ok((force_defect(&mut model), added))
}

/// Returns a block with a crack of four to nine triangles around a point near its middle, in a random plane.
fn block_with_fan(seed: u64) -> (Vec<Point3<f64>>, Surface) {
    let mut next = crate::common::noise(seed + 1);
    let cells = 3 + (seed % 4) as usize;
    let jitter = if seed.is_multiple_of(3) { 0.0 } else { 0.25 };
    let high = Point3::new(1.0, 1.0, 1.0);
    let mut points = generate::block(Point3::origin(), high, [cells; 3], jitter, seed).unwrap();
    let centre = Point3::from([0, 1, 2].map(|_| 0.5 + 0.1 * next()));
    let radius = 0.15 + 0.1 * (1.0 + next());
    let triangles = 4 + (seed % 6) as usize;
    let mut next = crate::common::noise(7 * seed + 3);
    let mut direction = || Vector3::new(next(), next(), next());
    let normal = direction().normalize();
    let u = normal.cross(&direction()).normalize();
    let v = normal.cross(&u);
    let first = points.len();
    points.push(centre);
    for i in 0..triangles {
        let angle = 2.0 * PI * (i as f64 + 0.3 * next()) / triangles as f64;
        let r = radius * (1.0 + 0.2 * next());
        points.push(centre + u * (r * angle.cos()) + v * (r * angle.sin()));
    }
    let rim = |i: usize| first + 1 + i % triangles;
    let faces = (0..triangles).map(|i| [first, rim(i), rim(i + 1)]).collect();
    (points, Surface::convex_hull().with_cracks(faces))
}

/// Bodies with oblique fan cracks are accepted and leave no forces. Before, three of them were refused by
/// `CellOpen`, and one with 5e-4 of its forces out of balance was accepted.
#[test]
fn bodies_with_oblique_fan_cracks_leave_no_forces() {
    for seed in 0..160 {
        let (points, surface) = block_with_fan(seed);
        let (defect, _) = measure(&points, &surface).unwrap_or_else(|e| panic!("fan {seed}: {e}"));
        assert!(defect < 1e-11, "fan {seed}: {defect:e}");
    }
}

#[test]
fn turned_blocky_bodies_leave_no_forces() {
    for (seed, turn) in (1..=16).flat_map(|s| (1..=16).map(move |t| (s, t))) {
        let body = blocky(4, 20, seed).mapped(&Map::turn(turn));
        let measured = measure(&body.points, &body.surface);
        let (defect, added) = measured.unwrap_or_else(|e| panic!("body {seed}, turn {turn}: {e}"));
        assert!(
            defect < 1e-11 && added == 0,
            "body {seed}, turn {turn}: {defect:e}, {added} added"
        );
    }
}

/// Returns a cube of `n` cells with a node at every cell corner, and a surface of twelve triangles on the
/// first eight nodes.
fn box_of_twelve_triangles(n: usize) -> Body {
    let place = |i: usize, side: usize, step: usize| {
        Point3::from([i % side, i / side % side, i / side / side].map(|c| (c * step) as f64))
    };
    let mut points: Vec<_> = (0..8).map(|i| place(i, 2, n)).collect();
    let grid = (0..(n + 1).pow(3)).map(|i| place(i, n + 1, 1));
    let inner: Vec<_> = grid.filter(|p| !points.contains(p)).collect();
    points.extend(inner);
    let sides: [[usize; 4]; 6] = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let halves = sides
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    Body::new("box of twelve triangles", points, halves.collect())
}

/// Rotated boxes of twelve triangles keep their nodes. Before, 4 of 450 rotations were refused and 55 got up
/// to 30 more nodes.
#[test]
fn turned_boxes_of_twelve_triangles_keep_their_nodes() {
    for (n, turn) in (2..=4).flat_map(|n| (1..=150).map(move |t| (n, t))) {
        let body = box_of_twelve_triangles(n).mapped(&Map::turn(turn));
        let measured = measure(&body.points, &body.surface);
        let (defect, added) = measured.unwrap_or_else(|e| panic!("{n} cells, turn {turn}: {e}"));
        assert!(
            defect < 1e-11 && added == 0,
            "{n} cells, turn {turn}: {defect:e}, {added} added"
        );
    }
}

/// One of 540 further fans has 3e-4 of its forces out of balance. The constructor of the model refuses it.
#[test]
fn a_body_with_forces_out_of_balance_is_refused_where_it_is_built() {
    let (points, surface) = block_with_fan(358);
    let refused = measure(&points, &surface);
    assert!(
        matches!(refused, Err(cnem::Error::WrongForces { defect, .. }) if defect > 1e-5),
        "{refused:?}"
    );
}

//! A V-notch keeps its nodes: the complex is constrained Delaunay, not refined until it conforms.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use crate::common::{largest, noise, silica, solve};
use arlequin_core::{LinearModel, Model};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::{Interpolant, Scratch};
use cnem::{CnemModel, Options, Stabilisation};
use nalgebra::{Matrix3, Point3, Vector3};

fn residual(domain: &Domain, options: Options) -> f64 {
    let g = Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6);
    let mut fixed = vec![false; 3 * domain.nodes().len()];
    domain
        .constrained_faces()
        .flat_map(|f| f.0)
        .for_each(|v| fixed[3 * v..3 * v + 3].fill(true));
    let model = CnemModel::new("notch", domain.clone(), silica(), options).unwrap();
    let exact: Vec<f64> = model
        .nodes()
        .iter()
        .flat_map(|x| (g * x.coords).data.0[0])
        .collect();
    let mut u: Vec<f64> = exact
        .iter()
        .zip(&fixed)
        .map(|(u, f)| if *f { *u } else { 0.0 })
        .collect();
    solve(&model.stiffness(), &fixed, &vec![0.0; u.len()], &mut u);
    let error: Vec<f64> = u.iter().zip(&exact).map(|(a, b)| a - b).collect();
    largest(&error) / largest(&exact)
}

/// Returns a block of 4 × 4 × 4 with a V-notch of a depth and half opening across its upper side: coarse
/// faces with `layers` of nodes along the notch, and scattered inner nodes.
fn scattered(half: f64, depth: f64, layers: usize, inside: usize, seed: u64) -> (Vec<Point3<f64>>, Surface) {
    let width = 2.0;
    let outline = [
        [-width, 0.0],
        [width, 0.0],
        [width, 4.0],
        [half, 4.0],
        [0.0, 4.0 - depth],
        [-half, 4.0],
        [-width, 4.0],
    ];
    let (mut points, n) = (Vec::new(), outline.len());
    for k in 0..=layers {
        points.extend(outline.map(|[x, y]| Point3::new(x, y, 4.0 * k as f64 / layers as f64)));
    }
    let mut faces = Vec::new();
    for k in 0..layers {
        for i in 0..n {
            let vertex = |di: usize, dk: usize| (i + di) % n + n * (k + dk);
            faces.push([vertex(0, 0), vertex(1, 0), vertex(1, 1)]);
            faces.push([vertex(0, 0), vertex(1, 1), vertex(0, 1)]);
        }
    }
    for (first, flip) in [(0, true), (n * layers, false)] {
        for t in [[0, 1, 4], [1, 2, 4], [2, 3, 4], [4, 5, 6], [4, 6, 0]] {
            let t = if flip { [t[0], t[2], t[1]] } else { t };
            faces.push(t.map(|v: usize| v + first));
        }
    }
    let mut r = noise(seed);
    while points.len() < n * (layers + 1) + inside {
        let p = Point3::new(width * r(), 2.0 + 2.0 * r(), 2.0 + 2.0 * r());
        let flank = half - p.x.abs() - (4.0 - p.y) / depth * half;
        let wall = (width - p.x.abs()).min(p.y).min(p.z).min(4.0 - p.y.max(p.z));
        if flank < -0.05 && wall > 0.05 {
            points.push(p);
        }
    }
    (points, Surface::boundary(faces))
}

/// A V-notch keeps its nodes and passes the patch test. Refined until the complex conformed, the first body
/// had 475 more nodes, the second 392 (spacing down to 1e-3) and a residual of 2e-8, the third 537.
#[test]
fn a_v_notch_keeps_its_nodes_and_passes_the_patch_test() {
    for (half, layers, seed, allowed) in [(0.1, 8, 0, 0), (0.1, 8, 1, 0), (0.1, 2, 0, 6), (1.0, 8, 0, 0)] {
        let (points, surface) = scattered(half, 2.0, layers, 300, seed);
        let domain = Domain::new(&points, &surface).unwrap();
        let recovery = domain.recovery();
        assert!(
            recovery.inserted.len() <= allowed && recovery.divided > 0,
            "{recovery:?}"
        );
        assert_eq!(domain.nodes().len(), points.len() + recovery.inserted.len());
        assert!((domain.volume() / (4.0 * (16.0 - 2.0 * half)) - 1.0).abs() < 1e-13);
        let closure = domain.voronoi().unwrap().closure(&domain);
        assert!(closure.volume < 1e-13 && closure.area < 1e-13, "{closure:?}");
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            let stabilisation = if seed == 0 {
                Stabilisation::default()
            } else {
                Stabilisation::None
            };
            let r = residual(
                &domain,
                Options {
                    kind,
                    stabilisation,
                    ..Options::default()
                },
            );
            println!(
                "half {half}, layers {layers}: {} inserted, {} faces divided, {kind:?} patch residual {r:.1e}",
                recovery.inserted.len(),
                recovery.divided
            );
            assert!(r < 1e-11, "{r:e}");
        }
    }
}

/// The functions on a constrained complex satisfy unity and linear precision and include no node of the other
/// flank.
#[test]
fn functions_beside_a_notch_see_no_node_behind_it() {
    let (points, surface) = scattered(0.1, 2.0, 8, 300, 0);
    let domain = Domain::new(&points, &surface).unwrap();
    let (mut s, mut r) = (Scratch::new(), noise(5));
    let (mut asked, mut near) = (0, 0);
    while asked < 600 {
        let x = Point3::new(r(), 3.0 + r(), 2.0 + 1.9 * r());
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            let Ok(row) = domain.shape(kind, &x, &mut s) else {
                continue;
            };
            asked += 1;
            let mut moment = Vector3::zeros();
            for (&v, &w) in row.nodes.iter().zip(&row.values) {
                let p = domain.nodes()[v];
                moment += (p - x) * w;
                // Well above the tip the other flank lies behind both walls.
                let across = x.y > 3.0 && p.y > 3.0 && p.x * x.x < 0.0 && p.x.abs() > 0.0;
                assert!(w >= 0.0 && !(across && w > 0.0), "{kind:?} {x} sees {p} by {w}");
                near += usize::from(x.y > 3.0 && x.x.abs() < 0.3);
            }
            assert!(moment.norm() < 1e-12 && (row.values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
    assert!(near > 100);
    let n = s.counters();
    assert!(n.linear * 50 < asked, "{n:?} of {asked}");
}

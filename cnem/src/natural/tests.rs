//! Compares shape functions with clipping: an independent method without cavities or circumcentres.

use super::*;
use crate::clip::Polyhedron;
use crate::constraint::Surface;
use proptest::prelude::*;

pub(crate) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut s = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1_u64 << 53) as f64
    }
}

pub(crate) fn random(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut r = noise(seed);
    (0..n).map(|_| Point3::new(r(), r(), r())).collect()
}

pub(crate) fn grid(n: usize, jitter: f64, seed: u64) -> Vec<Point3<f64>> {
    let mut r = noise(seed);
    let h = 1.0 / (n - 1) as f64;
    (0..n * n * n)
        .map(|i| {
            let index = [i % n, i / n % n, i / n / n];
            let position = index.map(|k| {
                let moved = if k == 0 || k == n - 1 {
                    0.0
                } else {
                    jitter * (r() - 0.5)
                };
                (k as f64 + moved) * h
            });
            Point3::from(position)
        })
        .collect()
}

/// Returns the values by clipping with the bisectors of `nodes` only.
fn by_clipping(kind: Interpolant, nodes: &[Point3<f64>], x: &Point3<f64>) -> Vec<f64> {
    let rel: Vec<_> = nodes.iter().map(|p| p - x).collect();
    let mut order: Vec<usize> = (0..rel.len()).collect();
    order.sort_by(|&a, &b| rel[a].norm_squared().total_cmp(&rel[b].norm_squared()));
    let mut cell = Polyhedron::default();
    cell.set_cube(1e4, u64::MAX);
    for &i in &order {
        cell.clip(&rel[i], 0.5 * rel[i].norm_squared(), i as u64);
    }
    let mut values = vec![0.0; nodes.len()];
    let neighbours: Vec<_> = cell.faces().collect();
    for (tag, sum) in &neighbours {
        assert_ne!(*tag, u64::MAX, "cell is bounded");
        let i = *tag as usize;
        values[i] += match kind {
            Interpolant::Laplace => sum.area.norm() / rel[i].norm(),
            Interpolant::Sibson => {
                let mut stolen = cell.clone();
                for &j in &order {
                    if j != i {
                        let offset = 0.5 * (rel[j].norm_squared() - rel[i].norm_squared());
                        stolen.clip(&(rel[j] - rel[i]), offset, j as u64);
                    }
                }
                stolen.volume()
            }
        };
    }
    let total: f64 = values.iter().sum();
    values.iter().map(|v| v / total).collect()
}

/// Checks partition of unity, linear precision and sign; returns the largest defect.
pub(super) fn defect(domain: &Domain, x: &Point3<f64>, row: &ShapeRow<f64>) -> f64 {
    let mut sum = -1.0;
    let mut moment: Vector3<f64> = Vector3::zeros();
    let mut negative = 0.0_f64;
    for (&v, &w) in row.nodes.iter().zip(&row.values) {
        sum += w;
        moment += (domain.nodes()[v] - x) * w;
        negative = negative.max(-w);
    }
    moment.amax().max(sum.abs()).max(negative)
}

fn gradient_defect(domain: &Domain, x: &Point3<f64>, row: &ShapeRow<f64>) -> f64 {
    let mut sum: Vector3<f64> = Vector3::zeros();
    let mut moment: nalgebra::Matrix3<f64> = -nalgebra::Matrix3::identity();
    for (&v, g) in row.nodes.iter().zip(&row.gradients) {
        sum += g;
        moment += (domain.nodes()[v] - x) * g.transpose();
    }
    sum.amax().max(moment.amax())
}

/// Returns the largest difference to clipping with all nodes (convex domains).
fn difference(domain: &Domain, kind: Interpolant, x: &Point3<f64>, s: &mut Scratch) -> f64 {
    let row = domain.shape(kind, x, s).expect("inside").clone();
    assert!(defect(domain, x, &row) < 1e-12, "{:?}", defect(domain, x, &row));
    let mut expected = by_clipping(kind, domain.nodes(), x);
    for (&v, &w) in row.nodes.iter().zip(&row.values) {
        expected[v] -= w;
    }
    expected.iter().fold(0.0, |m: f64, e| m.max(e.abs()))
}

#[test]
fn values_equal_clipping_on_random_and_degenerate_sets() {
    for (name, points) in [
        ("random", random(120, 3)),
        ("grid", grid(5, 0.0, 0)),
        ("jitter 1e-15", grid(5, 1e-15, 1)),
        ("jitter 1e-12", grid(5, 1e-12, 1)),
        ("jitter 1e-9", grid(5, 1e-9, 2)),
        ("jitter 1e-4", grid(5, 1e-4, 2)),
        ("jitter 0.3", grid(5, 0.3, 3)),
    ] {
        let domain = Domain::new(&points, &Surface::convex_hull()).expect(name);
        let mut s = Scratch::new();
        let mut r = noise(17);
        for _ in 0..100 {
            let x = Point3::new(r(), r(), r()).map(|c| 0.2 + 0.6 * c);
            for kind in [Interpolant::Laplace, Interpolant::Sibson] {
                let d = difference(&domain, kind, &x, &mut s);
                assert!(d < 1e-10, "{name} {kind:?} {x}: {d:e}");
            }
        }
        assert_eq!(s.counters().linear, 0, "{name}");
    }
}

#[test]
fn gradients_equal_finite_differences() {
    let domain = Domain::new(&random(200, 5), &Surface::convex_hull()).expect("random");
    let mut s = Scratch::new();
    let mut r = noise(23);
    for _ in 0..40 {
        let x = Point3::new(r(), r(), r()).map(|c| 0.2 + 0.6 * c);
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            let row = domain
                .shape_with_gradients(kind, &x, &mut s)
                .expect("inside")
                .clone();
            assert!(gradient_defect(&domain, &x, &row) < 1e-11);
            let field = |p: &Point3<f64>, s: &mut Scratch| {
                let row = domain.shape(kind, p, s).expect("inside");
                row.nodes
                    .iter()
                    .zip(&row.values)
                    .map(|(v, w)| w * ((v % 7) as f64))
                    .sum::<f64>()
            };
            let slope: Vector3<f64> = row
                .nodes
                .iter()
                .zip(&row.gradients)
                .map(|(v, g)| g * ((v % 7) as f64))
                .sum();
            for d in 0..3 {
                let mut step = Vector3::zeros();
                step[d] = 1e-6;
                let numeric = (field(&(x + step), &mut s) - field(&(x - step), &mut s)) / 2e-6;
                assert!(
                    (numeric - slope[d]).abs() < 1e-3 * (1.0 + slope.norm()),
                    "{kind:?} {numeric} {slope}"
                );
            }
        }
    }
}

#[test]
fn delta_at_nodes_and_vanishing_on_the_boundary() {
    let points = grid(5, 0.3, 9);
    let domain = Domain::new(&points, &Surface::convex_hull()).expect("grid");
    let mut s = Scratch::new();
    let mut r = noise(4);
    for kind in [Interpolant::Laplace, Interpolant::Sibson] {
        for (i, p) in points.iter().enumerate() {
            for slopes in [false, true] {
                let row = if slopes {
                    domain.shape_with_gradients(kind, p, &mut s)
                } else {
                    domain.shape(kind, p, &mut s)
                };
                let row = row.expect("node");
                for (&v, &w) in row.nodes.iter().zip(&row.values) {
                    assert!((w - f64::from(u8::from(v == i))).abs() < 1e-15);
                }
                assert!(!slopes || gradient_defect(&domain, p, row) < 2e-6);
            }
        }
        for k in 0..300 {
            let mut x = Point3::new(r(), r(), r());
            x[k % 3] = f64::from(u8::from(k % 2 == 0));
            if k % 5 == 0 {
                x[(k + 1) % 3] = 0.0;
            }
            let row = domain
                .shape_with_gradients(kind, &x, &mut s)
                .expect("on the boundary");
            assert!(
                defect(&domain, &x, row) < 1e-12,
                "{x} {}",
                defect(&domain, &x, row)
            );
            for (&v, &w) in row.nodes.iter().zip(&row.values) {
                assert!(w.abs() < 1e-14 || (points[v][k % 3] - x[k % 3]).abs() < 1e-15);
            }
        }
    }
    assert_eq!(s.counters().linear, 0);
}

#[test]
fn boundary_values_are_limits_from_inside() {
    let points = grid(5, 0.3, 9);
    let domain = Domain::new(&points, &Surface::convex_hull()).expect("grid");
    let mut s = Scratch::new();
    let mut r = noise(6);
    for kind in [Interpolant::Laplace, Interpolant::Sibson] {
        for _ in 0..100 {
            let x = Point3::new(r(), r(), 0.0);
            let close = Point3::new(x.x, x.y, 1e-7);
            let mut dense = vec![0.0; points.len()];
            let row = domain.shape(kind, &x, &mut s).expect("boundary");
            row.nodes
                .iter()
                .zip(&row.values)
                .for_each(|(&v, w)| dense[v] += w);
            let row = domain.shape(kind, &close, &mut s).expect("inside");
            row.nodes
                .iter()
                .zip(&row.values)
                .for_each(|(&v, w)| dense[v] -= w);
            let largest = dense.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
            assert!(largest < 3e-5, "{kind:?} {x} {largest:e}");
        }
    }
}

#[test]
fn close_to_the_boundary_unity_and_linear_precision_hold() {
    let domain = Domain::new(&grid(5, 0.3, 9), &Surface::convex_hull()).expect("grid");
    let mut s = Scratch::new();
    let mut r = noise(8);
    for exponent in 3..16 {
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            for _ in 0..20 {
                let x = Point3::new(r(), r(), 10_f64.powi(-exponent));
                let row = domain.shape(kind, &x, &mut s).expect("inside");
                assert!(
                    defect(&domain, &x, row) < 1e-12,
                    "{kind:?} {x:?} {:e}",
                    defect(&domain, &x, row)
                );
            }
        }
    }
}

/// Builds the cubes of a grid in `[0, n]^3` that `keep` selects, as elements on the grid nodes in use.
pub(crate) fn blocks(
    n: usize,
    jitter: f64,
    keep: impl Fn(usize, usize, usize) -> bool,
) -> (Vec<Point3<f64>>, Surface) {
    let m = n + 1;
    let mut r = noise(31);
    let cube = |i, j, k| i < n && j < n && k < n && keep(i, j, k);
    let mut elements = Vec::new();
    let mut id = std::collections::BTreeMap::new();
    let mut points = Vec::new();
    for (i, j, k) in (0..n * n * n)
        .map(|c| (c % n, c / n % n, c / n / n))
        .filter(|&(i, j, k)| keep(i, j, k))
    {
        let corner = |c: usize| (i + (c & 1), j + (c >> 1 & 1), k + (c >> 2));
        let v: Vec<usize> = (0..8)
            .map(|c| {
                let place = corner(c);
                *id.entry(place).or_insert_with(|| {
                    let around = (0..8).filter(|q| {
                        let o = |a: usize, b: usize| a.wrapping_sub(b);
                        cube(o(place.0, q & 1), o(place.1, q >> 1 & 1), o(place.2, q >> 2))
                    });
                    let size = if around.count() == 8 { jitter } else { 0.0 };
                    let p = [place.0, place.1, place.2].map(|a| a as f64 + size * (r() - 0.5));
                    points.push(Point3::from(p));
                    points.len() - 1
                })
            })
            .collect();
        for t in [
            [0, 1, 3, 7],
            [0, 3, 2, 7],
            [0, 2, 6, 7],
            [0, 6, 4, 7],
            [0, 4, 5, 7],
            [0, 5, 1, 7],
        ] {
            elements.push(t.map(|c| v[c]));
        }
    }
    assert!(m > 1);
    (points, Surface::of_elements(&elements))
}

#[test]
fn re_entrant_edge() {
    let keep = |i: usize, j: usize, _k: usize| i < 2 || j < 2;
    let (points, surface) = blocks(4, 0.3, keep);
    let domain = Domain::new(&points, &surface).expect("L-shaped block");
    assert!(
        (domain.volume() - 48.0).abs() < 1e-12,
        "{} {:?}",
        domain.volume(),
        domain.recovery()
    );
    let mut s = Scratch::new();
    let mut r = noise(77);
    let (mut compared, mut total) = (0, 0);
    for _ in 0..1500 {
        let x = Point3::new(4.0 * r(), 4.0 * r(), 4.0 * r());
        let clear = |m: f64| x.x < 2.0 - m || x.y < 2.0 - m;
        if !clear(0.0) {
            assert!(domain.shape(Interpolant::Sibson, &x, &mut s).is_err());
            continue;
        }
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            total += 1;
            let before = s.counters();
            let row = domain.shape(kind, &x, &mut s).expect("inside").clone();
            assert!(defect(&domain, &x, &row) < 1e-12);
            let after = s.counters();
            if (after.reentrant, after.linear) != (before.reentrant, before.linear) {
                continue;
            }
            // Where the cavity is star-shaped and closed by free faces only, its nodes alone give the
            // functions.
            let inner = |c: f64| c > 0.9 && c < 3.1;
            if !(inner(x.z) && x.x > 0.9 && x.y > 0.9 && (x.x < 1.1 || x.y < 1.1 || clear(0.9))) {
                continue;
            }
            compared += 1;
            let nodes: Vec<_> = row.nodes.iter().map(|&v| domain.nodes()[v]).collect();
            let expected = by_clipping(kind, &nodes, &x);
            for (w, e) in row.values.iter().zip(&expected) {
                assert!((w - e).abs() < 1e-10, "{kind:?} {x} {w} {e}");
            }
        }
    }
    assert!(compared > 20, "{compared} of {total}");
    assert!(
        s.counters().reentrant * 4 < total && s.counters().linear * 10 < total,
        "{:?} of {total}",
        s.counters()
    );
}

#[test]
fn crack_is_not_seen_through() {
    let points = grid(5, 0.0, 0);
    let index = |i: usize, j: usize, k: usize| i + 5 * (j + 5 * k);
    let mut crack = Vec::new();
    for i in 0..2 {
        for j in 0..4 {
            crack.push([index(i, j, 2), index(i + 1, j, 2), index(i + 1, j + 1, 2)]);
            crack.push([index(i, j, 2), index(i + 1, j + 1, 2), index(i, j + 1, 2)]);
        }
    }
    let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).expect("cracked cube");
    assert!(domain.recovery().inserted.is_empty());
    let mut s = Scratch::new();
    let mut r = noise(5);
    for _ in 0..400 {
        let x = Point3::new(0.3 * r(), r(), 0.5 + 0.2 * (r() - 0.5));
        for kind in [Interpolant::Laplace, Interpolant::Sibson] {
            let row = domain.shape(kind, &x, &mut s).expect("inside");
            assert!(defect(&domain, &x, row) < 1e-12);
            for (&v, &w) in row.nodes.iter().zip(&row.values) {
                let other_side = (domain.nodes()[v].z - 0.5) * (x.z - 0.5) < 0.0;
                assert!(!other_side || w.abs() < 1e-14, "{x} sees {v}");
            }
        }
    }
}

/// Returns the largest difference between the constrained functions at `x` and clipping with the nodes that
/// `keep` selects.
fn against_part(
    domain: &Domain,
    kind: Interpolant,
    x: &Point3<f64>,
    keep: &dyn Fn(&Point3<f64>) -> bool,
    s: &mut Scratch,
) -> f64 {
    let part: Vec<usize> = (0..domain.nodes().len())
        .filter(|&v| domain.original(v) == v && keep(&domain.nodes()[v]))
        .collect();
    let nodes: Vec<_> = part.iter().map(|&v| domain.nodes()[v]).collect();
    let mut dense = vec![0.0; domain.nodes().len()];
    for (v, w) in part.iter().zip(by_clipping(kind, &nodes, x)) {
        dense[*v] += w;
    }
    let row = domain.shape(kind, x, s).expect("inside");
    row.nodes
        .iter()
        .zip(&row.values)
        .for_each(|(&v, w)| dense[domain.original(v)] -= w);
    dense.iter().fold(0.0, |m: f64, d| m.max(d.abs()))
}

/// Close to the wall of a leg, away from the re-entrant edge, the functions are those of the leg alone: nodes
/// of the other leg, closer through the notch, are hidden.
#[test]
fn a_leg_of_a_re_entrant_block_does_not_see_the_other() {
    for jitter in [0.0, 0.3] {
        let (points, surface) = blocks(5, jitter, |i, j, _| i < 2 || j < 2);
        let domain = Domain::new(&points, &surface).expect("L-shaped block");
        let mut s = Scratch::new();
        let mut r = noise(13);
        for _ in 0..60 {
            let x = Point3::new(2.0 - 0.5 * r() - 1e-3, 3.6 + 1.2 * r(), 0.5 + 4.0 * r());
            for kind in [Interpolant::Laplace, Interpolant::Sibson] {
                let d = against_part(&domain, kind, &x, &|p| p.x <= 2.0 + 1e-9, &mut s);
                assert!(d < 1e-10, "{kind:?} {x} {d:e}");
            }
        }
        assert_eq!((s.counters().linear, s.counters().reentrant), (0, 0));
    }
}

/// A crack through the whole section makes each side a body of its own.
#[test]
fn a_full_crack_separates() {
    for jitter in [0.0, 1e-13, 0.3] {
        let n = 7;
        let mut points = grid(n, jitter, 3);
        for p in &mut points {
            if (p.z - 0.5).abs() < 0.05 {
                p.z = 0.5;
            }
        }
        let index = |i: usize, j: usize| i + n * (j + n * 3);
        let mut crack = Vec::new();
        for (i, j) in (0..(n - 1) * (n - 1)).map(|k| (k % (n - 1), k / (n - 1))) {
            crack.push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
            crack.push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
        }
        let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).expect("cracked cube");
        assert!(domain.recovery().inserted.is_empty(), "{:?}", domain.recovery());
        let mut s = Scratch::new();
        let mut r = noise(29);
        for _ in 0..60 {
            let x = Point3::new(0.1 + 0.8 * r(), 0.1 + 0.8 * r(), 0.5 - 0.1 * r() - 1e-3);
            for kind in [Interpolant::Laplace, Interpolant::Sibson] {
                let d = against_part(&domain, kind, &x, &|p| p.z <= 0.5, &mut s);
                assert!(d < 1e-10, "{jitter} {kind:?} {x} {d:e}");
            }
        }
        assert_eq!((s.counters().linear, s.counters().reentrant), (0, 0));
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(24))]

    #[test]
    fn unity_and_linear_precision(seed in 1_u64..10_000, exponent in -16_i32..0) {
        let domain = Domain::new(&grid(4, 10_f64.powi(exponent), seed), &Surface::convex_hull()).expect("grid");
        let mut s = Scratch::new();
        let mut r = noise(seed);
        for _ in 0..40 {
            let x = Point3::new(r(), r(), r());
            for kind in [Interpolant::Laplace, Interpolant::Sibson] {
                let row = domain.shape_with_gradients(kind, &x, &mut s).expect("inside");
                prop_assert!(defect(&domain, &x, row) < 1e-12, "{} {:e}", x, defect(&domain, &x, row));
                prop_assert!(gradient_defect(&domain, &x, row) < 1e-10, "{} {:e}", x, gradient_defect(&domain, &x, row));
            }
        }
    }
}

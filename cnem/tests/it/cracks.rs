//! Cracks open: each lip has its own unknowns, and the front is shared.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares coordinates of grids and shows what it measured"
)]

use crate::common::{noise, solve};
use approx::{assert_abs_diff_eq, assert_relative_eq};
use arlequin_core::{LinearModel, Model, Uniform};
use cnem::constraint::Surface;
use cnem::domain::Domain;
use cnem::natural::{Interpolant, Scratch};
use cnem::{CnemModel, Elastic, Inertia, Options, generate};
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// An axis, the layer across it, and the grid faces of that layer that are cracked.
type Cut<'a> = (usize, usize, &'a dyn Fn(usize, usize) -> bool);

/// Returns a grid of `n` cells of size `h` with cracks: each cut is an axis, the index of a plane across it,
/// and a function that selects the cracked cell faces of this plane by the other two indices in the order of
/// the axes.
fn cracked(n: [usize; 3], h: f64, jitter: f64, cuts: &[Cut<'_>]) -> Domain {
    let size = n.map(|c| c as f64 * h);
    let mut points = generate::block(Point3::origin(), Point3::from(size), n, jitter, 3).unwrap();
    let id = |v: [usize; 3]| v[0] + (n[0] + 1) * (v[1] + (n[1] + 1) * v[2]);
    let mut faces = Vec::new();
    for &(axis, layer, keep) in cuts {
        let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
        for j in 0..n[u] {
            for k in 0..n[w] {
                let order = if u < w { (j, k) } else { (k, j) };
                if !keep(order.0, order.1) {
                    continue;
                }
                let corner = |dj: usize, dk: usize| {
                    let mut v = [layer; 3];
                    v[u] = j + dj;
                    v[w] = k + dk;
                    id(v)
                };
                let quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                for v in quad {
                    points[v][axis] = layer as f64 * h;
                }
                faces.push([quad[0], quad[1], quad[2]]);
                faces.push([quad[0], quad[2], quad[3]]);
            }
        }
    }
    let surface = Surface::convex_hull().with_cracks(faces);
    Domain::with_limit(&points, &surface, 0).unwrap()
}

/// Returns `f·u` of a linear elastic body under a unit stress along the axis on both ends; `held` unknowns
/// are zero.
fn compliance(model: &CnemModel, axis: usize, held: &dyn Fn(&Point3<f64>, usize) -> bool) -> f64 {
    let n = model.layout().dofs();
    let mut f = vec![0.0; n];
    let length = model.nodes().iter().map(|p| p[axis]).fold(0.0, f64::max);
    let end = |x: f64| x < 1e-9 * length || x > (1.0 - 1e-9) * length;
    for facet in model.surface(|f| end(f.centroid[axis])).unwrap() {
        for (node, share) in facet.nodes.iter().zip(&facet.shares) {
            f[3 * node + axis] += facet.normal[axis] * share;
        }
    }
    let mut fixed: Vec<bool> = (0..n).map(|i| held(&model.nodes()[i / 3], i % 3)).collect();
    // Three nodes of one end hold the remaining rigid motions; loads in equilibrium cause no reaction there.
    let far =
        |p: &Point3<f64>, a: usize| p[axis] == 0.0 && p[a] > 0.0 && (0..3).all(|c| c == a || p[c] == 0.0);
    let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
    for (i, p) in model.nodes().iter().enumerate() {
        if p.coords.amax() == 0.0 {
            fixed[3 * i..3 * i + 3].fill(true);
        } else if far(p, u) {
            fixed[3 * i + axis] = true;
            fixed[3 * i + w] = true;
        } else if far(p, w) {
            fixed[3 * i + axis] = true;
        }
    }
    let mut x = vec![0.0; n];
    solve(&model.stiffness(), &fixed, &f, &mut x);
    f.iter().zip(&x).map(|(f, x)| f * x).sum()
}

fn unit() -> Elastic<f64> {
    Elastic::new(1.0, 0.3, 1.0).unwrap()
}

fn model(domain: Domain) -> CnemModel {
    CnemModel::new("body", domain, unit(), Options::default()).unwrap()
}

/// Returns a bar of 8 × 4 × 2 cells, cut across from one side to a depth.
fn bar(depth: usize, jitter: f64) -> Domain {
    cracked([8, 4, 2], 0.25, jitter, &[(0, 4, &|j, _| j < depth)])
}

#[test]
fn none_half_and_full_cut_differ() {
    for jitter in [0.0, 0.2] {
        let [uncut, half, deep] = [0, 2, 3].map(|d| compliance(&model(bar(d, jitter)), 0, &|_, _| false));
        println!("jitter {jitter}: compliance none {uncut:.4}, half {half:.4}, three quarters {deep:.4}");
        assert!((uncut / 1.0 - 1.0).abs() < 1e-10, "L A / E: {uncut}");
        assert!(half > 2.0 * uncut && deep > 2.0 * half);
        // Cut through: either half moves without the other in any motion.
        let mut cut = model(bar(4, jitter));
        let right: Vec<bool> = halves(&cut);
        let k = cut.stiffness();
        assert!(
            k.iter()
                .all(|(v, (i, j))| right[i / 3] == right[j / 3] || *v == 0.0)
        );
        let scale = k.iter().fold(0.0, |m: f64, e| m.max(e.0.abs()));
        for (turn, move_) in [
            (Vector3::zeros(), Vector3::x()),
            (Vector3::new(1.0, 2.0, 3.0), Vector3::y()),
        ] {
            let u: Vec<f64> = cut
                .nodes()
                .iter()
                .zip(&right)
                .flat_map(|(p, r)| {
                    if *r {
                        (move_ + turn.cross(&p.coords)).data.0[0]
                    } else {
                        [0.0; 3]
                    }
                })
                .collect();
            let mut f = vec![0.0; u.len()];
            cut.add_internal_forces(&u, &mut f).unwrap();
            assert!(
                f.iter().all(|f| f.abs() < 1e-13 * scale * 10.0),
                "{:e}",
                f.iter().fold(0.0, |m: f64, f| m.max(f.abs()))
            );
            assert!(cut.internal_energy(&u).abs() < 1e-13 * scale);
        }
    }
}

/// Returns for each node whether the tetrahedra connect it to the last node.
fn halves(model: &CnemModel) -> Vec<bool> {
    let domain = model.domain();
    let mut right = vec![false; domain.nodes().len()];
    for t in domain.elements() {
        let middle: f64 = t.iter().map(|&v| domain.nodes()[v].x).sum::<f64>() / 4.0;
        t.iter().for_each(|&v| right[v] |= middle > 1.0);
    }
    right
}

#[test]
fn each_lip_has_its_own_unknowns_and_the_front_is_shared() {
    let domain = bar(2, 0.0);
    // Two of the five rows of three nodes on the crack plane lie behind the front.
    assert_eq!(domain.copies().count(), 6);
    assert_eq!(domain.nodes().len(), 9 * 5 * 3 + 6);
    for c in domain.copies() {
        assert_eq!(domain.nodes()[c.node], domain.nodes()[c.original]);
        assert!(c.original < 135 && c.node >= 135 && domain.original(c.node) == c.original);
        assert!(domain.nodes()[c.node].y < 0.5 && domain.nodes()[c.node].x == 1.0);
    }
    for lips in domain.lips() {
        for (below, above) in lips.below.unwrap().iter().zip(lips.above.unwrap()) {
            let front = domain.nodes()[above].y == 0.5;
            assert_eq!(*below == above, front);
            // The normal of these triangles is +x: the original node stays with the lip below.
            assert!(*below < 135);
        }
    }
    let cells = domain.voronoi().unwrap();
    let closure = cells.closure(&domain);
    assert!(closure.volume < 1e-13 && closure.area < 1e-13, "{closure:?}");
    // The masses of two lips are halves of the cut cell.
    for c in domain.copies() {
        let [a, b] = [c.node, c.original].map(|v| cells.volumes()[v]);
        assert_relative_eq!(a, b, epsilon = 0.0, max_relative = 1e-12);
    }
    let model = model(domain);
    let mut mass = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut mass).unwrap();
    assert_relative_eq!(mass.iter().sum::<f64>(), 3.0, epsilon = 0.0, max_relative = 1e-13);
}

/// With a cut right through, the centroid masses of each half have the half's total and first moments.
#[test]
fn masses_around_centroids_stay_on_their_side_of_a_crack() {
    let domain = cracked([4, 4, 4], 0.25, 0.3, &[(0, 2, &|_, _| true)]);
    let below: Vec<usize> = domain.lips().flat_map(|l| l.below.unwrap()).collect();
    let options = Options {
        inertia: Inertia::Centroids,
        ..Options::default()
    };
    let model = CnemModel::new("body", domain, unit(), options).unwrap();
    let mut mass = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut mass).unwrap();
    let mut halves = [(0.0, Vector3::zeros()); 2];
    for (i, (m, x)) in mass.iter().step_by(3).zip(model.nodes()).enumerate() {
        let half = &mut halves[usize::from(x.x > 0.5 || (x.x == 0.5 && !below.contains(&i)))];
        half.0 += m;
        half.1 += x.coords * *m;
    }
    for ((m, first), middle) in halves.into_iter().zip([0.25, 0.75]) {
        assert_abs_diff_eq!(m, 0.5, epsilon = 1e-13);
        let error = (first / m - Vector3::new(middle, 0.5, 0.5)).norm();
        assert!(error < 1e-13, "{error:e}");
    }
}

/// Cracks that cross, meet in a T or branch get one unknown per connected group around a node.
#[test]
fn crossing_and_branching_cracks_split_into_all_groups() {
    let everywhere = |_: usize, _: usize| true;
    let half = |_: usize, k: usize| k < 2;
    let cross = cracked(
        [4, 4, 4],
        0.25,
        0.0,
        &[(0, 2, &everywhere), (1, 2, &everywhere), (2, 2, &everywhere)],
    );
    let middle = 62;
    let copies_of = |d: &Domain, v: usize| d.copies().filter(|c| c.original == v).count();
    assert_eq!(copies_of(&cross, middle), 7);
    // Per plane 25 nodes; lines of 5 lie in two planes, the middle in three.
    assert_eq!(cross.copies().count(), 3 * 16 + 3 * 4 * 3 + 7);
    let tee = cracked(
        [4, 4, 4],
        0.25,
        0.0,
        &[(0, 2, &everywhere), (1, 2, &|j, _| j >= 2)],
    );
    assert_eq!(copies_of(&tee, middle), 2);
    let part = cracked([4, 4, 4], 0.25, 0.0, &[(0, 2, &half)]);
    assert_eq!(copies_of(&part, middle), 0);
    for domain in [cross, tee, part] {
        let closure = domain.voronoi().unwrap().closure(&domain);
        assert!(closure.volume < 1e-12 && closure.area < 1e-12, "{closure:?}");
        let model = model(domain);
        let g = nalgebra::Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.7, -0.4, 0.1, 0.2, -0.6);
        let u: Vec<f64> = model
            .nodes()
            .iter()
            .flat_map(|p| (g * p.coords).data.0[0])
            .collect();
        let [lambda, mu] = unit().lame();
        let e = (g + g.transpose()) * 0.5;
        let exact = 0.5 * lambda * e.trace().powi(2) + mu * e.norm_squared();
        assert!((model.internal_energy(&u) / exact - 1.0).abs() < 1e-12);
    }
}

/// A field on given points refuses cracks that would split nodes, since particles have no second lip.
#[test]
fn a_field_on_given_points_refuses_nodes_that_a_crack_splits() {
    let points = generate::block(Point3::origin(), Point3::new(2.0, 2.0, 2.0), [2; 3], 0.0, 1).unwrap();
    let quads = [[1, 4, 13, 10], [4, 7, 16, 13], [10, 13, 22, 19], [13, 16, 25, 22]];
    let crack = quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .collect();
    let surface = Surface::convex_hull().with_cracks(crack);
    let error = cnem::NaturalField::within(&points, &surface, Interpolant::Laplace).err();
    assert!(
        matches!(
            error,
            Some(cnem::Error::Parameter {
                name: "crack faces",
                ..
            })
        ),
        "{error:?}"
    );
}

/// Functions on both lips satisfy unity and linear precision and include no node of the other side.
#[test]
fn functions_on_a_lip_are_those_of_its_side() {
    let domain = bar(4, 0.2);
    let mut s = Scratch::new();
    let mut next = noise(4);
    let right: Vec<bool> = halves(&model(domain.clone()));
    for k in 0..400 {
        let offset = if k % 2 == 0 { 1e-12 } else { 0.2 } * next();
        let x = Point3::new(1.0 + offset, 0.5 * (1.0 + next()), 0.25 * (1.0 + next()));
        for kind in [Interpolant::Sibson, Interpolant::Laplace] {
            let row = domain.shape(kind, &x, &mut s).unwrap();
            let mut moment = Vector3::zeros();
            for (&v, &w) in row.nodes.iter().zip(&row.values) {
                moment += (domain.nodes()[v] - x) * w;
                assert!(
                    w == 0.0 || offset.abs() < 1e-13 || right[v] == (offset > 0.0),
                    "{x} {v} {w}"
                );
            }
            assert!(moment.norm() < 1e-12);
        }
    }
}

/// The stress intensity of a centre crack of length `2 a` in a strip of width `2 w` in plane strain is within
/// 5 % of `K = σ √(π a sec(π a / 2w))`. It follows from the energy released: `G = ½ dC/da` per thickness,
/// `K² = G E / (1 − ν²)`.
#[test]
fn stress_intensity_of_a_centre_crack_is_within_five_percent() {
    let (cells, h) = (20, 0.1);
    let energy = |a: usize| {
        let cut = |j: usize, _: usize| (cells / 2 - a..cells / 2 + a).contains(&j);
        let body = model(cracked([2 * cells, cells, 1], h, 0.0, &[(0, cells, &cut)]));
        compliance(&body, 0, &|_, axis| axis == 2) / h
    };
    let e = 1.0 / (1.0 - 0.09);
    for a in [3, 5] {
        // Two fronts advance.
        let g = 0.5 * (energy(a + 1) - energy(a - 1)) / (2.0 * h) / 2.0;
        let (a, w) = (a as f64 * h, 0.5 * cells as f64 * h);
        let handbook = (PI * a / (PI * a / (2.0 * w)).cos()).sqrt();
        let error = (g * e).sqrt() / handbook - 1.0;
        println!("K at a/w = {:.1}: {:+.2} % of the handbook", a / w, 100.0 * error);
        assert!(error.abs() < 0.05, "{error}");
    }
}

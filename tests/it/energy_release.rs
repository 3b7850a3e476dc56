//! The energy that a crack releases, in known fields, rotated bodies, and natural elements.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and shows what it measured"
)]

use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::{CnemModel, Options, generate};
use arlequin::core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin::core::sprs::TriMat;
use arlequin::core::{CoarseModel, CrackFront, Elastic, EnergyRelease, LinearModel, Model, Real, Uniform};
use arlequin::fem_ref::{self, ElementKind, FemModel, Mesh};
use std::collections::HashMap;
use std::f64::consts::PI;

const POISSON: f64 = 0.3;

fn steel() -> Elastic<f64> {
    Elastic::new(210e9, POISSON, 7850.0).unwrap()
}

/// Returns a block `[−1, 1]² × [0, ¼]` with a slit at y = 0 for x < 0, whose nodes are doubled, and the
/// numbers of the nodes of the upper lip.
fn slit(n: usize) -> (Mesh<f64>, Vec<usize>) {
    let [low, high] = [Point3::new(-1.0, -1.0, 0.0), Point3::new(1.0, 1.0, 0.25)];
    let mesh = fem_ref::generate::block(ElementKind::Hex8, low, high, [2 * n, 2 * n, 2]).unwrap();
    let mut nodes = mesh.nodes().to_vec();
    let mut second: HashMap<u32, u32> = HashMap::new();
    let mut connectivity = Vec::new();
    for e in 0..mesh.element_count() {
        let middle: f64 = mesh.element(e).iter().map(|v| nodes[*v as usize].y).sum();
        for &v in mesh.element(e) {
            let p = nodes[v as usize];
            let lip = p.y.abs() < 1e-9 && p.x < -1e-9 && middle > 0.0;
            connectivity.push(if lip {
                *second.entry(v).or_insert_with(|| {
                    nodes.push(p);
                    nodes.len() as u32 - 1
                })
            } else {
                v
            });
        }
    }
    let mesh = Mesh::new(ElementKind::Hex8, nodes, connectivity).unwrap();
    assert_eq!(mesh.doubled(), second.len());
    let mut upper: Vec<usize> = second.into_values().map(|v| v as usize).collect();
    upper.sort_unstable();
    (mesh, upper)
}

/// Returns the displacement around a crack in plane strain with the stress intensities of the three modes
/// (Williams 1957).
fn williams(k: [f64; 3], x: &Point3<f64>, upper: bool) -> Vector3<f64> {
    let mu = steel().lame()[1];
    let (r, mut t) = (x.x.hypot(x.y), x.y.atan2(x.x));
    if x.y.abs() < 1e-12 && x.x < 0.0 {
        t = if upper { PI } else { -PI };
    }
    let kappa = 3.0 - 4.0 * POISSON;
    let ((s, c), root) = ((0.5 * t).sin_cos(), (r / (2.0 * PI)).sqrt() / (2.0 * mu));
    let first = Vector3::new(
        c * (kappa - 1.0 + 2.0 * s * s),
        s * (kappa + 1.0 - 2.0 * c * c),
        0.0,
    );
    let second = Vector3::new(
        s * (kappa + 1.0 + 2.0 * c * c),
        c * (1.0 - kappa + 2.0 * s * s),
        0.0,
    );
    let third = Vector3::new(0.0, 0.0, 4.0 * s);
    (first * k[0] + second * k[1] + third * k[2]) * root
}

fn front(radii: [f64; 2]) -> CrackFront<f64> {
    CrackFront {
        ends: [Point3::origin(), Point3::new(0.0, 0.0, 0.25)],
        direction: Vector3::x(),
        radii,
    }
}

/// Returns the energy that a model releases at the displacements `u`, with the nodal forces `f`.
fn released(model: &impl CoarseModel<f64>, crack: &CrackFront<f64>, u: &[f64], f: &[f64]) -> f64 {
    let field = model.coarse_field();
    let domain = EnergyRelease::new(model, &*field, &Uniform(1.0), crack).unwrap();
    domain.at(u, f, |_| true).unwrap()
}

/// The fields of the three modes release `J = (1 − ν²)/E (K_I² + K_II²) + K_III²/(2 μ)`.
#[test]
fn fields_of_the_three_modes_release_the_energy_of_irwin() {
    let (e, mu) = (steel().young(), steel().lame()[1]);
    for k in [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, -0.7, 0.5],
    ] {
        let exact = (1.0 - POISSON * POISSON) / e * (k[0] * k[0] + k[1] * k[1]) + k[2] * k[2] / (2.0 * mu);
        let errors = [12, 24].map(|n| {
            let (mesh, upper) = slit(n);
            let model = FemModel::new("block", mesh, steel()).unwrap();
            let displacement =
                |(v, x): (usize, &Point3<f64>)| williams(k, x, upper.binary_search(&v).is_ok());
            let u: Vec<f64> = model
                .nodes()
                .iter()
                .enumerate()
                .flat_map(|p| displacement(p).data.0[0])
                .collect();
            let no_forces = vec![0.0; u.len()];
            let j = [[0.25, 0.6], [0.4, 0.9]].map(|radii| released(&model, &front(radii), &u, &no_forces));
            j.map(|j| j / exact - 1.0)
        });
        println!("{k:?}: {errors:?}");
        for (coarse, fine) in errors[0].iter().zip(&errors[1]) {
            assert!(
                fine.abs() < 0.003 && fine.abs() < 0.4 * coarse.abs() + 1e-4,
                "{k:?}: {errors:?}"
            );
        }
    }
}

/// A body that is turned, moved far away and scaled releases the same energy, times the factor of its size.
#[test]
fn turned_moved_and_scaled_bodies_release_the_same() {
    let (mesh, upper) = slit(6);
    let model = FemModel::new("block", mesh.clone(), steel()).unwrap();
    let displacement =
        |(v, x): (usize, &Point3<f64>)| williams([1.0, 0.4, 0.2], x, upper.binary_search(&v).is_ok());
    let u: Vec<Vector3<f64>> = model.nodes().iter().enumerate().map(displacement).collect();
    let flat = |u: &[Vector3<f64>]| u.iter().flat_map(|u| u.data.0[0]).collect::<Vec<f64>>();
    // Including forces, since this field is not in equilibrium.
    let forced = |model: &mut FemModel<f64>, crack: &CrackFront<f64>, u: &[f64]| {
        let mut f = vec![0.0; u.len()];
        model.add_internal_forces(u, &mut f).unwrap();
        released(model, crack, u, &f)
    };
    let radii = [0.3, 0.8];
    let plain = forced(&mut model.clone(), &front(radii), &flat(&u));
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.3);
    for (size, shift) in [(1.0, 0.0), (1.0, 1e3), (1e-3, 0.0), (1e4, -7e3)] {
        let map = |x: &Point3<f64>| turn * (x * size) + Vector3::new(shift, -2.0 * shift, 0.5 * shift);
        let mut moved = FemModel::new("block", mesh.clone().mapped(map).unwrap(), steel()).unwrap();
        let crack = CrackFront {
            ends: front(radii).ends.map(|x| map(&x)),
            direction: turn * Vector3::new(3.0, 0.0, 0.0),
            radii: radii.map(|r| r * size),
        };
        // The strains stay equal: displacements scale with the body.
        let turned: Vec<Vector3<f64>> = u.iter().map(|u| turn * u * size).collect();
        let moved_release = forced(&mut moved, &crack, &flat(&turned)) / size;
        println!("size {size}, at {shift}: {moved_release} of {plain}");
        assert!(
            (moved_release / plain - 1.0).abs() < 1e-9,
            "{moved_release}, {plain}"
        );
    }
}

/// A bar of natural elements with an opening crack, pulled at its ends, releases `∫ J da` equal to the gain
/// of the work of the loads.
#[test]
fn cracks_of_natural_elements_release_what_the_bar_gains() {
    let (n, size) = (16, [2.0, 1.0, 0.25]);
    let with_depth = |depth: usize| {
        let steps = [2 * n, n, n / 4];
        let points = generate::block(Point3::origin(), Point3::from(size), steps, 0.0, 1).unwrap();
        let id = |j: usize, k: usize| n + (2 * n + 1) * (j + (n + 1) * k);
        let mut crack = Vec::new();
        for j in 0..depth {
            for k in 0..n / 4 {
                crack.push([id(j, k), id(j + 1, k), id(j + 1, k + 1)]);
                crack.push([id(j, k), id(j + 1, k + 1), id(j, k + 1)]);
            }
        }
        let domain = Domain::new(&points, &Surface::convex_hull().with_cracks(crack)).unwrap();
        let mut model = CnemModel::new("bar", domain, steel(), Options::default()).unwrap();
        let u = pulled(&model, size);
        let mut f = vec![0.0; u.0.len()];
        model.add_internal_forces(&u.0, &mut f).unwrap();
        let end = depth as f64 / n as f64;
        let j = [[0.13, 0.3], [0.19, 0.37]].map(|radii| {
            let crack = CrackFront {
                ends: [Point3::new(1.0, end, 0.0), Point3::new(1.0, end, size[2])],
                direction: Vector3::y(),
                radii,
            };
            released(&model, &crack, &u.0, &f)
        });
        (j, 0.5 * u.1)
    };
    let [low, middle, high] = [7, 8, 9].map(with_depth);
    let change = (high.1 - low.1) / (2.0 / n as f64 * size[2]);
    let errors = [0, 1].map(|k| (low.0[k] + 4.0 * middle.0[k] + high.0[k]) / 6.0 / change - 1.0);
    println!("{:?} of {change}: off by {errors:?}", middle.0);
    assert!(errors.iter().all(|o| o.abs() < 0.03), "{errors:?}");
}

/// Returns the displacements of a bar under a unit stress on both ends, held at three nodes, and the work of
/// the loads.
fn pulled(model: &CnemModel, size: [f64; 3]) -> (Vec<f64>, f64) {
    let nodes = model.nodes();
    let ends = model
        .surface(|f| !(1e-9..=size[0] - 1e-9).contains(&f.centroid.x))
        .unwrap();
    let mut f = vec![0.0; 3 * nodes.len()];
    for facet in &ends {
        for (node, share) in facet.nodes.iter().zip(&facet.shares) {
            f[3 * node] += facet.normal.x * share;
        }
    }
    let corner = |p: [f64; 3]| nodes.iter().position(|n| *n == Point3::from(p)).unwrap();
    let [o, y, z] = [[0.0; 3], [0.0, size[1], 0.0], [0.0, 0.0, size[2]]].map(corner);
    let held = [3 * o, 3 * o + 1, 3 * o + 2, 3 * y, 3 * y + 2, 3 * z];
    let mut k = TriMat::new((f.len(), f.len()));
    for (v, (i, j)) in model.stiffness().iter() {
        if !held.contains(&i) && !held.contains(&j) {
            k.add_triplet(i, j, *v);
        }
    }
    held.iter().for_each(|&i| k.add_triplet(i, i, steel().young()));
    let mut u = f.clone();
    held.iter().for_each(|&i| u[i] = 0.0);
    f64::cholesky(&k.to_csr(), None).unwrap().solve(&mut u);
    let work = f.iter().zip(&u).map(|(f, u)| f * u).sum();
    (u, work)
}

/// Nodes on opposite lips of a slit may coincide; nodes that coincide in any other way are refused.
#[test]
fn only_lips_that_face_each_other_may_coincide() {
    let (mesh, upper) = slit(3);
    let lips =
        |nodes: Vec<Point3<f64>>, connectivity: Vec<u32>| Mesh::new(ElementKind::Hex8, nodes, connectivity);
    assert_eq!(mesh.doubled(), upper.len());
    // Cut through, the two halves are disconnected.
    let [low, high] = [Point3::origin(), Point3::new(1.0, 1.0, 1.0)];
    let cube = fem_ref::generate::block(ElementKind::Hex8, low, high, [1, 1, 1]).unwrap();
    let mut nodes = cube.nodes().to_vec();
    nodes.extend(cube.nodes().iter().map(|x| x + Vector3::x()));
    let mut connectivity = cube.connectivity().to_vec();
    connectivity.extend(cube.connectivity().iter().map(|v| v + 8));
    let message = lips(nodes, connectivity).unwrap_err().to_string();
    assert!(message.contains("2 pieces"), "{message}");
    // The lips cross: nodes of the other side were assigned to the same side.
    let mut connectivity = mesh.connectivity().to_vec();
    connectivity.extend_from_slice(mesh.element(0));
    let first = mesh.element(0)[0];
    let place = mesh.nodes().len() as u32;
    let last = connectivity.len() - 8;
    connectivity[last..]
        .iter_mut()
        .filter(|v| **v == first)
        .for_each(|v| *v = place);
    let mut nodes = mesh.nodes().to_vec();
    nodes.push(mesh.nodes()[first as usize]);
    let message = lips(nodes, connectivity).unwrap_err().to_string();
    assert!(message.contains("coincide"), "{message}");
}

//! Nodes inside a closed surface, and the tetrahedra between them.
//!
//! The surface keeps its corners; edges longer than the spacing are halved, longest first. Inside, nodes lie
//! on a body-centred cubic lattice, at least half a spacing from the surface: its Delaunay tetrahedra are
//! congruent and well shaped.

use super::faces::Faces;
use super::files;
use crate::error::{Result, cnem, fem, key, value};
use arlequin::cnem::constraint;
use arlequin::cnem::domain::Domain;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::Surface;
use arlequin::fem_ref::{ElementKind, Mesh};
use std::collections::{BTreeMap, BinaryHeap};
use std::path::Path;

/// Largest number of nodes.
const MOST: f64 = 1e7;
/// Length of surface edges above which they are halved, in spacings.
const LONGEST: f64 = 1.25;
/// Smallest distance of inner nodes from the surface, in spacings.
const AWAY: f64 = 0.5;

/// Triangles of a surface, each by its three corners \[m\].
pub(super) fn corners(surface: &Surface) -> Vec<[Point3<f64>; 3]> {
    let vertex = |k: u32| Point3::from(surface.vertices()[k as usize]);
    surface.triangles().iter().map(|t| t.map(vertex)).collect()
}

/// Fills the surface of an STL file, in units of `scale` metres, with nodes about `size` \[m\] apart.
pub(super) fn fill(path: &str, file: &Path, scale: f64, size: f64) -> Result<Mesh<f64>> {
    let key_path = format!("{path}.shape.file");
    let surface = files::surface(&key_path, file, scale)?;
    let expected = surface.volume() / size.powi(3);
    if expected > MOST {
        let (low, high) = surface.bounds();
        let e = high - low;
        let rule = format!(
            "{expected:.1e} nodes that far apart fill the shape of {:.3e} by {:.3e} by {:.3e} m, {MOST:e} at most are placed; is \
             the file in millimetres? then give scale = 1e-3",
            e.x, e.y, e.z
        );
        return Err(value(format!("{path}.spacing"), size, &rule));
    }
    let (mut points, triangles) = divided(&surface, size);
    points.extend(lattice(&surface, size));
    let hull = constraint::Surface::boundary(triangles.iter().map(|t| t.map(|k| k as usize)).collect());
    let domain = Domain::new(&points, &hull).map_err(cnem(&key_path))?;
    let connectivity: Vec<u32> = domain.elements().flatten().map(|k| k as u32).collect();
    if connectivity.is_empty() {
        return Err(key(key_path, "holds no tetrahedron; choose a smaller spacing"));
    }
    Mesh::new(ElementKind::Tet4, domain.nodes().to_vec(), connectivity)
        .map(Mesh::renumbered)
        .map_err(fem(&key_path))
}

/// Divides a surface until no edge is much longer than `size` \[m\]; returns its corners and triangles.
fn divided(surface: &Surface, size: f64) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let mut points: Vec<Point3<f64>> = surface.vertices().iter().map(|x| Point3::from(*x)).collect();
    let mut triangles = surface.triangles().to_vec();
    // Triangles at each edge. The queue holds squared lengths as bits: for positive numbers these sort like
    // the numbers.
    let mut triangles_at: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    let edges = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].map(|[a, b]| [a.min(b), a.max(b)]);
    for (k, t) in triangles.iter().enumerate() {
        edges(t)
            .into_iter()
            .for_each(|e| triangles_at.entry(e).or_default().push(k as u32));
    }
    let long = (LONGEST * size).powi(2);
    let length =
        |points: &[Point3<f64>], e: [u32; 2]| (points[e[0] as usize] - points[e[1] as usize]).norm_squared();
    let mut queue: BinaryHeap<(u64, [u32; 2])> = BinaryHeap::new();
    for e in triangles_at.keys() {
        queue.push((length(&points, *e).to_bits(), *e));
    }
    while let Some((bits, [a, b])) = queue.pop() {
        if f64::from_bits(bits) <= long {
            break;
        }
        let Some(edge_triangles) = triangles_at.remove(&[a, b]) else {
            continue;
        };
        let m = points.len() as u32;
        points.push(arlequin::core::nalgebra::center(
            &points[a as usize],
            &points[b as usize],
        ));
        for k in edge_triangles {
            let old = triangles[k as usize];
            let [first, second] = [b, a].map(|corner| old.map(|v| if v == corner { m } else { v }));
            let new = triangles.len() as u32;
            triangles[k as usize] = first;
            triangles.push(second);
            for e in edges(&old) {
                // These edges belonged to the first half until now.
                if let Some(list) = triangles_at.get_mut(&e).filter(|_| e.contains(&b)) {
                    list.iter_mut().filter(|n| **n == k).for_each(|n| *n = new);
                }
            }
            for (half, number) in [(first, k), (second, new)] {
                for e in edges(&half).into_iter().filter(|e| e.contains(&m)) {
                    let list = triangles_at.entry(e).or_default();
                    if list.is_empty() {
                        queue.push((length(&points, e).to_bits(), e));
                    }
                    list.push(number);
                }
            }
        }
    }
    // Vertices that no triangle uses are dropped.
    let vertices = triangles.iter().flatten();
    let mut place = vec![u32::MAX; points.len()];
    let mut kept_points = Vec::new();
    for &k in vertices {
        if place[k as usize] == u32::MAX {
            place[k as usize] = kept_points.len() as u32;
            kept_points.push(points[k as usize]);
        }
    }
    (
        kept_points,
        triangles.iter().map(|t| t.map(|k| place[k as usize])).collect(),
    )
}

/// Nodes of a body-centred cubic lattice inside a surface.
fn lattice(surface: &Surface, size: f64) -> Vec<Point3<f64>> {
    // Nearest neighbours are half a space diagonal of the cubic cell apart.
    let edge = size * 2.0 / 3f64.sqrt();
    let (low, high) = surface.bounds();
    let faces = Faces::new(corners(surface));
    let middle = (low + high) * 0.5;
    let reach = ((high - low) * (0.5 / edge)).map(|n| n.ceil() as i64);
    let mut out = Vec::new();
    for i in -reach.x..=reach.x {
        for j in -reach.y..=reach.y {
            for k in -reach.z..=reach.z {
                // The two points of a body-centred cubic cell.
                for half in [0.0, 0.5] {
                    let step = Vector3::new(i as f64, j as f64, k as f64).add_scalar(half);
                    let x = middle + step * edge;
                    if surface.contains(&x) && faces.distance(&Point3::from(x)) >= AWAY * size {
                        out.push(Point3::from(x));
                    }
                }
            }
        }
    }
    out
}

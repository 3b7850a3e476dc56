//! Bodies with flat faces, and maps that rotate, shear and move them.
#![allow(dead_code, reason = "every target uses its own part")]

use cnem::constraint::Surface;
use cnem::delaunay::Delaunay;
use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// A body: nodes, boundary and volume \[m³\].
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub(crate) name: String,
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) surface: Surface,
    pub(crate) volume: f64,
}

/// Affine map `x ↦ matrix x + shift`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Map {
    pub(crate) matrix: Matrix3<f64>,
    pub(crate) shift: Vector3<f64>,
}

impl Map {
    pub(crate) fn turn(seed: u64) -> Self {
        let mut next = super::noise(seed);
        let q = UnitQuaternion::from_quaternion(Quaternion::new(next(), next(), next(), next()));
        Self {
            matrix: q.to_rotation_matrix().into_inner(),
            shift: Vector3::zeros(),
        }
    }

    /// Returns a rotation followed by a shear with coefficients up to `amount`.
    pub(crate) fn shear(seed: u64, amount: f64) -> Self {
        let mut next = super::noise(seed + 1000);
        let mut turned = Self::turn(seed);
        let slant = Matrix3::from_fn(|i, j| if i == j { 1.0 } else { amount * next() });
        turned.matrix = slant * turned.matrix;
        turned
    }

    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        self.matrix *= factor;
        self
    }

    pub(crate) fn moved(mut self, shift: [f64; 3]) -> Self {
        self.shift = shift.into();
        self
    }
}

impl Body {
    pub(crate) fn new(name: &str, points: Vec<Point3<f64>>, faces: Vec<[usize; 3]>) -> Self {
        let six = |f: &[usize; 3]| {
            let [a, b, c] = f.map(|v| points[v].coords);
            a.cross(&b).dot(&c)
        };
        Self {
            volume: faces.iter().map(six).sum::<f64>().abs() / 6.0,
            name: name.into(),
            points,
            surface: Surface::boundary(faces),
        }
    }

    /// Returns a body of given nodes within their convex hull, which has the given volume.
    pub(crate) fn hull(name: &str, points: Vec<Point3<f64>>, volume: f64) -> Self {
        Self {
            name: name.into(),
            points,
            surface: Surface::convex_hull(),
            volume,
        }
    }

    pub(crate) fn mapped(&self, map: &Map) -> Self {
        Self {
            name: self.name.clone(),
            points: self
                .points
                .iter()
                .map(|p| Point3::from(map.matrix * p.coords + map.shift))
                .collect(),
            surface: self.surface.clone(),
            volume: self.volume * map.matrix.determinant().abs(),
        }
    }
}

/// Returns the grid cells of size 1 that `keep` selects; inner nodes are moved by up to `amount`.
pub(crate) fn voxels(
    name: &str,
    counts: [usize; 3],
    amount: f64,
    keep: impl Fn(usize, usize, usize) -> bool,
) -> Body {
    let volume = (0..counts.iter().product())
        .filter(|c| {
            keep(
                c % counts[0],
                c / counts[0] % counts[1],
                c / counts[0] / counts[1],
            )
        })
        .count() as f64;
    let (points, faces) = super::block_mesh(counts, 1.0, amount, 7, keep);
    Body {
        volume,
        ..Body::new(name, points, faces)
    }
}

pub(crate) fn grid_hull(counts: [usize; 3]) -> Body {
    let full = voxels("grid, hull", counts, 0.0, |_, _, _| true);
    Body::hull("grid, hull", full.points, full.volume)
}

/// Returns a structured mesh of tetrahedra, six per cube, like that of a transfinite volume.
pub(crate) fn six_per_cube(counts: [usize; 3]) -> Body {
    let n = counts.map(|c| c + 1);
    let id = |i: usize, j: usize, k: usize| i + n[0] * (j + n[1] * k);
    let grid_point = |v: usize| {
        Point3::new(
            (v % n[0]) as f64,
            (v / n[0] % n[1]) as f64,
            (v / n[0] / n[1]) as f64,
        )
    };
    let mut elements = Vec::new();
    for c in 0..counts.iter().product() {
        let (i, j, k) = (
            c % counts[0],
            c / counts[0] % counts[1],
            c / counts[0] / counts[1],
        );
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let mut corner = [i, j, k];
            let mut t = [id(i, j, k); 4];
            for (slot, axis) in order.into_iter().enumerate() {
                corner[axis] += 1;
                t[slot + 1] = id(corner[0], corner[1], corner[2]);
            }
            elements.push(t);
        }
    }
    Body {
        name: "six tetrahedra per cube".into(),
        points: (0..n.iter().product()).map(grid_point).collect(),
        surface: Surface::of_elements(&elements),
        volume: counts.iter().product::<usize>() as f64,
    }
}

/// Returns a block with a structured border and scattered inner nodes, as the surface of a mesh of
/// tetrahedra.
pub(crate) fn scattered_mesh(counts: [usize; 3]) -> Body {
    let (points, _) = super::block_mesh(counts, 1.0, 0.35, 3, |_, _, _| true);
    let mesh: Vec<_> = Delaunay::new(&points).unwrap().tetrahedra().collect();
    Body {
        name: "scattered mesh".into(),
        surface: Surface::of_elements(&mesh),
        points,
        volume: counts.iter().product::<usize>() as f64,
    }
}

/// Returns layers of rings of `6 k` nodes; the layer at height `z` has the radius `radius(z)`. Convex bodies
/// only.
pub(crate) fn rings(name: &str, layers: usize, rings: usize, radius: impl Fn(f64) -> f64) -> Body {
    let (mut points, mut volume, mut last) = (Vec::new(), 0.0, 0.0);
    for layer in 0..layers {
        let z = layer as f64;
        let r = radius(z);
        for ring in 0..=if r > 0.0 { rings } else { 0 } {
            let count = (6 * ring).max(1);
            for k in 0..count {
                let angle = 2.0 * PI * k as f64 / count as f64;
                let ring_radius = r * ring as f64 / rings as f64;
                points.push(Point3::new(
                    ring_radius * angle.cos(),
                    ring_radius * angle.sin(),
                    z,
                ));
            }
        }
        let corners = 6.0 * rings as f64;
        let area = 0.5 * corners * (2.0 * PI / corners).sin();
        if layer > 0 {
            volume += area * (r * r + r * last + last * last) / 3.0;
        }
        last = r;
    }
    Body::hull(name, points, volume)
}

/// Returns a torus around the z axis with hexagonal sections and flat faces between them.
pub(crate) fn torus(sections: usize, sides: usize) -> Body {
    let (big, small) = (2.2, 0.9);
    let ring = sides + 1;
    let mut points = Vec::new();
    for s in 0..sections {
        let (sin, cos) = (2.0 * PI * s as f64 / sections as f64).sin_cos();
        let place = |r: f64, z: f64| Point3::new(r * cos, r * sin, z);
        points.push(place(big, 0.0));
        for k in 0..sides {
            let (v, u) = (2.0 * PI * k as f64 / sides as f64).sin_cos();
            points.push(place(big + small * u, small * v));
        }
    }
    let id = |s: usize, k: usize| (s % sections) * ring + 1 + k % sides;
    let mut faces = Vec::new();
    for s in 0..sections {
        for k in 0..sides {
            let q = [id(s, k), id(s + 1, k), id(s + 1, k + 1), id(s, k + 1)];
            faces.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }
    Body::new("torus", points, faces)
}

/// Returns a prism along z over a polygon around the axis, with its own surface: caps of wedges, sides of
/// quadrilaterals.
pub(crate) fn prism(sides: usize, layers: usize) -> Body {
    let ring = sides + 1;
    let mut points = Vec::new();
    for layer in 0..=layers {
        points.push(Point3::new(0.0, 0.0, layer as f64 * 0.7));
        for k in 0..sides {
            let (sin, cos) = (2.0 * PI * k as f64 / sides as f64).sin_cos();
            points.push(Point3::new(cos, sin, layer as f64 * 0.7));
        }
    }
    let id = |l: usize, k: usize| l * ring + 1 + k % sides;
    let mut faces = Vec::new();
    for k in 0..sides {
        faces.push([0, id(0, k + 1), id(0, k)]);
        faces.push([layers * ring, id(layers, k), id(layers, k + 1)]);
        for l in 0..layers {
            let q = [id(l, k), id(l, k + 1), id(l + 1, k + 1), id(l + 1, k)];
            faces.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }
    Body::new("prism", points, faces)
}

/// Returns the grid cells of a random walk.
pub(crate) fn blocky(n: usize, cells: usize, seed: u64) -> Body {
    let mut next = super::noise(seed);
    let mut keep = vec![false; n * n * n];
    let mut cell = [n / 2; 3];
    while keep.iter().filter(|k| **k).count() < cells {
        keep[cell[0] + n * (cell[1] + n * cell[2])] = true;
        let axis = ((next() + 1.0) * 1.5) as usize % 3;
        let forward = next() > 0.0;
        cell[axis] = if forward {
            (cell[axis] + 1).min(n - 1)
        } else {
            cell[axis].saturating_sub(1)
        };
    }
    voxels("blocky", [n; 3], 0.0, |i, j, k| keep[i + n * (j + n * k)])
}

/// Returns every body that the tests of geometry rotate.
pub(crate) fn all_bodies() -> Vec<Body> {
    let l = |i: usize, j: usize, _: usize| i < 1 || j < 1;
    let mut out = vec![
        grid_hull([2, 2, 2]),
        voxels("grid, own surface", [3, 2, 2], 0.0, |_, _, _| true),
        voxels("jittered, own surface", [3, 2, 2], 0.3, |_, _, _| true),
        six_per_cube([4, 2, 2]),
        scattered_mesh([3, 3, 3]),
        rings("cylinder", 4, 2, |_| 1.5),
        rings("cone", 4, 2, |z| 0.5 * (3.0 - z)),
        prism(12, 2),
        torus(10, 6),
        voxels("L", [2, 2, 2], 0.0, l),
        voxels("jittered L", [4, 4, 4], 0.3, |i, j, _| i < 2 || j < 2),
        voxels("hole", [3, 3, 3], 0.0, |i, j, k| [i, j, k] != [1; 3]),
        voxels("ring", [3, 3, 1], 0.0, |i, j, _| [i, j] != [1; 2]),
    ];
    out.extend((1..4).map(|seed| blocky(4, 20, seed)));
    out
}

//! Meshes of balls: a cube inside shells of elements.

use super::count;
use crate::element::ElementKind;
use crate::error::{Result, parameter};
use crate::mesh::Mesh;
use arlequin_core::Real;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, PI};

/// Shape of the inner cube, relative to the ball's radius: half side of a cube, and radius of a ball, whose
/// positions are added. The elements in the middle and in the shells are then about as long as those at the
/// surface.
const INNER: [f64; 2] = [0.246, 0.354];

/// Meshes a ball with hexahedra of about the given size \[m\], or with six tetrahedra in place of each. The
/// surface is faceted; its nodes lie slightly outside of the ball, so that the mesh has the volume of the
/// ball. Group: `surface`.
///
/// ```
/// use arlequin_core::nalgebra::Point3;
/// use fem_ref::{ElementKind, generate};
/// let mesh = generate::ball(ElementKind::Hex8, Point3::new(1.0, 0.0, 0.0), 2.0, 0.5)?;
/// assert!((mesh.volume() / (4.0 / 3.0 * std::f64::consts::PI * 8.0) - 1.0).abs() < 1e-12);
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::Parameter`] unless radius and size are positive and finite, and for too many elements;
/// [`crate::Error::Kind`] for bars.
pub fn ball<T: Real>(kind: ElementKind, centre: Point3<T>, radius: T, size: T) -> Result<Mesh<T>> {
    for (name, x) in [("ball radius", radius), ("element size", size)] {
        if !(x.is_finite() && x > T::zero()) {
            return Err(parameter(name, x, "must be positive and finite [m]"));
        }
    }
    let across = (radius / size).as_f64();
    // A quarter of a great circle has as many elements as a side of the cube.
    let side = ((across * PI / 2.0).round() as usize).max(2);
    let rings = ((across * 0.5).round() as usize).max(1);
    count(
        "ball elements",
        side.saturating_pow(2)
            .saturating_mul(side.saturating_add(6 * rings)),
    )?;
    let (nodes, connectivity) = cube_in_shells(side, rings);
    let nodes: Vec<Point3<T>> = nodes.iter().map(|x| Point3::from(x.map(T::of))).collect();
    let unit = Mesh::new(ElementKind::Hex8, nodes, connectivity)?;
    let wanted = T::of(4.0 / 3.0 * PI) * radius * radius * radius;
    // Scaled once the mesh is known: the volume of the faceted ball is then exact.
    let scale = (wanted / unit.volume()).cbrt();
    let mesh = unit.mapped(|x| centre + x.coords * scale)?;
    // Takes in the outermost shell only.
    let inside = scale * T::of(1.0 - 1e-4);
    mesh.with_surface("surface", |x| (x - centre).norm() >= inside)?
        .into_kind(kind, "a ball")
}

/// Nodes and hexahedra of the unit ball.
fn cube_in_shells(side: usize, rings: usize) -> (Vec<Vector3<f64>>, Vec<u32>) {
    let station = |k: usize| 2.0 * k as f64 / side as f64 - 1.0;
    // Maps a point of the cube's surface to a direction; the tangent spaces the angles evenly.
    let direction = |p: Vector3<f64>| p.map(|c| (FRAC_PI_4 * c).tan()).normalize();
    let mut nodes = Vec::new();
    let mut places = BTreeMap::new();
    let lattice = (0..=side).flat_map(|i| (0..=side).flat_map(move |j| (0..=side).map(move |k| [i, j, k])));
    for corner in lattice {
        let p = Vector3::from(corner.map(station));
        let reach = p.amax();
        // The middle of the cube has no direction.
        let bulged = if reach > 0.0 {
            direction(p / reach) * reach
        } else {
            p
        };
        places.insert(corner, nodes.len() as u32);
        nodes.push(p * INNER[0] + bulged * INNER[1]);
    }
    let mut connectivity = Vec::new();
    for i in 0..side {
        for j in 0..side {
            for k in 0..side {
                let ring = |k| [[i, j, k], [i + 1, j, k], [i + 1, j + 1, k], [i, j + 1, k]];
                connectivity.extend(
                    [ring(k), ring(k + 1)]
                        .as_flattened()
                        .iter()
                        .map(|corner| places[corner]),
                );
            }
        }
    }
    let border: Vec<[usize; 3]> = places
        .keys()
        .copied()
        .filter(|corner| corner.iter().any(|c| *c == 0 || *c == side))
        .collect();
    let quads = border_quads(side);
    let mut inner: BTreeMap<[usize; 3], u32> =
        border.iter().map(|corner| (*corner, places[corner])).collect();
    for ring in 1..=rings {
        let t = ring as f64 / rings as f64;
        let mut outer = BTreeMap::new();
        for corner in &border {
            let start = nodes[places[corner] as usize];
            // Shells run from the bulged cube to the sphere, straight along their rays.
            let end = direction(Vector3::from(corner.map(station)));
            outer.insert(*corner, nodes.len() as u32);
            nodes.push(start + (end - start) * t);
        }
        for quad in &quads {
            connectivity.extend(quad.map(|corner| inner[&corner]));
            connectivity.extend(quad.map(|corner| outer[&corner]));
        }
        inner = outer;
    }
    (nodes, connectivity)
}

/// Squares of the surface of a cube of `side` steps per edge, counter-clockwise seen from outside.
fn border_quads(side: usize) -> Vec<[[usize; 3]; 4]> {
    let mut out = Vec::with_capacity(6 * side * side);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            for end in [0, side] {
                let corner = |a: usize, b: usize| {
                    let mut place = [0; 3];
                    (place[axis], place[u], place[v]) = (end, i + a, j + b);
                    place
                };
                let [p, q, r, s] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                out.push(if end == 0 { [p, s, r, q] } else { [p, q, r, s] });
            }
        }
    }
    out
}

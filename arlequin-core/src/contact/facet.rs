//! Facets of a surface in their present places, and the foot of a point on them.
//!
//! A sphere touches the nearest facet: within it, on its edge or at its corner. A point of another surface
//! touches the nearest facet that it lies behind and that faces its own surface. The facet then need not be
//! the nearest of all: at the rim of two blocks of one width, the side is as near as the top. Where it lies
//! deeper than a quarter of the facet, the facet must be the nearest of all: a corner that has just entered
//! by one face lies deep behind the next. A point beyond the rim of a facet does not touch it if it lies
//! nearer in front of another one: it is outside.
//! Each point has one foot, so edges and corners are not counted twice, and the spring of the point goes
//! with it from facet to facet.

use super::place::{Place, Triangle};
use crate::geometry::{Faces, closest_on_triangle};
use nalgebra::{Point3, Vector3};

/// Largest cosine between the normals of two facets that face each other.
const FACING: f64 = -0.1;
/// Part of its size by which a facet reaches beyond its edges for points of another surface: the rims of two
/// blocks of one width shift against each other when they are pressed.
const RIM: f64 = 0.03;
/// Part of the depth of a facet to which it holds points that have another facet nearer.
const GRAZED: f64 = 0.25;
/// Difference of two distances, over the size of the facet, below which they are equal.
const EQUAL: f64 = 1e-9;

/// A facet of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Facet {
    pub(super) triangle: Triangle,
    /// Outward normal at rest, with the length of twice the area \[m²\].
    pub(super) doubled: Vector3<f64>,
    /// Size \[m\]: see [`Triangle::size`].
    pub(super) size: f64,
    /// Depth to which the facet holds points \[m\]: its size, or half of the body's thickness below it.
    pub(super) depth: f64,
}

/// Foot of a point on a facet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Foot {
    pub(super) place: Place,
    /// Distance of the point from the surface \[m\], negative inside; infinite without a foot.
    pub(super) distance: f64,
    /// Unit vector from the surface to the point, or outwards if the point is inside.
    pub(super) normal: Vector3<f64>,
    /// Cosine of the angle by which the facet has turned since rest.
    pub(super) turn: f64,
    /// Depth below which the point loses its foot \[m\].
    pub(super) depth: f64,
}

impl Foot {
    /// No foot: the point is far from all facets.
    pub(super) fn none() -> Self {
        Self {
            place: Place::default(),
            distance: f64::INFINITY,
            normal: Vector3::zeros(),
            turn: 1.0,
            depth: f64::INFINITY,
        }
    }
}

/// Facets of a surface that have an area.
pub(super) fn facets(triangles: &[Triangle], nodes: &[Point3<f64>]) -> Vec<Facet> {
    let corners = |t: &Triangle| t.places(|n| nodes[n as usize].coords);
    let faces = Faces::new(triangles.iter().map(|t| corners(t).map(Point3::from)).collect());
    let facet = |t: &Triangle| {
        let x = corners(t);
        let doubled = (x[1] - x[0]).cross(&(x[2] - x[0]));
        let area = doubled.norm();
        let normal = doubled / area;
        let size = t.size(0.5 * area);
        let centre = (x[0] + x[1] + x[2]) / 3.0;
        (area > 0.0).then(|| Facet {
            triangle: *t,
            doubled,
            size,
            depth: size.min(0.5 * thickness(&faces, &centre, &normal, 2.0 * size)),
        })
    };
    triangles.iter().filter_map(facet).collect()
}

/// Thickness of a body below a point of its surface \[m\], infinite beyond `reach`.
fn thickness(faces: &Faces, x: &Vector3<f64>, normal: &Vector3<f64>, reach: f64) -> f64 {
    let end = x - normal * reach;
    let ends = [Point3::from(x.inf(&end)), Point3::from(x.sup(&end))];
    let mut nearest = f64::INFINITY;
    faces.each_near(&ends, &mut |k| {
        let [a, b, c] = faces.triangles()[k].map(|p| p.coords);
        let n = (b - a).cross(&(c - a));
        let slope = n.dot(normal);
        // Only facets on the other side look the other way.
        if slope >= 0.0 {
            return;
        }
        let way = n.dot(&(x - a)) / slope;
        let hit = x - normal * way;
        let inside = [[a, b], [b, c], [c, a]]
            .iter()
            .all(|[p, q]| (q - p).cross(&(hit - p)).dot(&n) >= 0.0);
        if way > 0.0 && inside {
            nearest = nearest.min(way);
        }
    });
    nearest
}

/// A point that looks for its foot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeker {
    pub(super) at: Vector3<f64>,
    /// Outward normal of the surface to which the point belongs, of any length; `None` for spheres.
    pub(super) normal: Option<Vector3<f64>>,
    /// Radius of a sphere \[m\]. Its centre may lie as deep, no deeper: all facets within the radius are
    /// known, so that the nearest of them says on which side the centre lies.
    pub(super) radius: f64,
}

/// Finds the foot of a point among some facets, whose nodes are at `place`.
pub(super) fn foot<'a>(
    seeker: &Seeker,
    facets: impl Iterator<Item = &'a Facet>,
    place: impl Fn(u32) -> Vector3<f64>,
) -> Foot {
    // Feet within facets and beyond their rims, with their ranks; height above the nearest facet below.
    let mut best = [(Foot::none(), 0.0); 2];
    let (mut front, mut nearest_of_all) = (f64::INFINITY, f64::INFINITY);
    for facet in facets {
        let corners = facet.triangle.places(&place);
        let doubled = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let Some(n) = doubled.try_normalize(0.0) else {
            continue;
        };
        let x = closest_on_triangle(&seeker.at, &corners);
        let d = seeker.at - x;
        nearest_of_all = nearest_of_all.min(d.norm());
        if seeker.normal.is_some_and(|own| own.dot(&n) > FACING * own.norm()) {
            continue;
        }
        let height = n.dot(&d);
        let aside = (d - n * height).norm();
        let beyond = seeker.normal.is_some() && aside > EQUAL * facet.size;
        if height >= 0.0 && !beyond {
            front = front.min(height);
        }
        let depth = match seeker.normal {
            Some(_) => facet.depth,
            None => facet.depth.min(seeker.radius),
        };
        let nearest = if seeker.normal.is_some() {
            (height < 0.0 && height >= -depth && aside <= RIM * facet.size).then_some((height, n))
        } else {
            let size = d.norm();
            let normal = if size > EQUAL * facet.size { d / size } else { n };
            match height >= 0.0 {
                true => Some((size, normal)),
                false => (size <= depth).then_some((-size, -normal)),
            }
        };
        let Some((distance, normal)) = nearest else {
            continue;
        };
        // On an edge, the facet whose plane is farther from a sphere says on which side the sphere lies, and
        // a point belongs to the facet that it lies behind.
        let rank = if seeker.normal.is_some() {
            -aside
        } else {
            height.abs()
        };
        let (best, best_rank) = &mut best[usize::from(beyond)];
        let closer = best.distance.abs() - distance.abs();
        let equal = closer.abs() <= EQUAL * facet.size;
        if (equal && rank > *best_rank) || (!equal && closer > 0.0) {
            *best_rank = rank;
            *best = Foot {
                place: facet.triangle.place(weights(&x, &corners)),
                distance,
                normal,
                turn: n.dot(&facet.doubled) / facet.doubled.norm(),
                depth,
            };
        }
    }
    let [(within, _), (beyond, _)] = best;
    let depth = beyond.distance.abs();
    let foot = if depth < within.distance.abs() && depth < front {
        beyond
    } else {
        within
    };
    let is_deep = -foot.distance > GRAZED * foot.depth;
    if seeker.normal.is_some() && is_deep && nearest_of_all < -foot.distance * (1.0 - EQUAL) {
        return Foot::none();
    }
    foot
}

/// Weights of the corners at a point of a triangle with an area.
fn weights(x: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> [f64; 3] {
    let (u, v, w) = (b - a, c - a, x - a);
    let (uu, uv, vv) = (u.dot(&u), u.dot(&v), v.dot(&v));
    let (wu, wv) = (w.dot(&u), w.dot(&v));
    let scale = 1.0 / (uu * vv - uv * uv);
    let second = ((vv * wu - uv * wv) * scale).clamp(0.0, 1.0);
    let third = ((uu * wv - uv * wu) * scale).clamp(0.0, 1.0 - second);
    [1.0 - second - third, second, third]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners of the unit cube and its faces.
    fn cube() -> (Vec<Point3<f64>>, Vec<[u32; 4]>) {
        let bit = |k: usize, c: usize| f64::from(u8::from(k >> c & 1 == 1));
        let nodes = (0..8)
            .map(|k| Point3::new(bit(k, 0), bit(k, 1), bit(k, 2)))
            .collect();
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        (nodes, quads.to_vec())
    }

    #[test]
    fn spheres_see_faces_edges_and_corners_from_outside_and_inside() {
        let (nodes, quads) = cube();
        let halves: Vec<[u32; 4]> = quads
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c, *c], [*a, *c, *d, *d]])
            .collect();
        for faces in [halves, quads] {
            see_a_cube(&nodes, &facets(&Triangle::cut(&faces, 8), &nodes));
        }
    }

    fn see_a_cube(nodes: &[Point3<f64>], facets: &[Facet]) {
        assert!(
            facets.iter().all(|f| (f.depth - 0.5).abs() < 1e-14),
            "half of the thickness"
        );
        let see = |x: f64, y: f64, z: f64, normal: Option<Vector3<f64>>| {
            let (at, radius) = (Vector3::new(x, y, z), 0.2);
            foot(&Seeker { at, normal, radius }, facets.iter(), |n| {
                nodes[n as usize].coords
            })
        };
        for (x, distance, normal) in [
            ([0.3, 0.4, 1.2], 0.2, Vector3::z()),
            ([0.3, 0.4, 0.9], -0.1, Vector3::z()),
            ([1.3, 0.5, 1.4], 0.5, Vector3::new(0.6, 0.0, 0.8)),
            ([1.2, 1.3, 1.6], 0.7, Vector3::new(2.0, 3.0, 6.0) / 7.0),
        ] {
            let f = see(x[0], x[1], x[2], None);
            assert!((f.distance - distance).abs() < 1e-14, "{x:?}: {}", f.distance);
            assert!((f.normal - normal).norm() < 1e-13, "{x:?}: {}", f.normal);
            let place: Vector3<f64> = f.place.nodes().map(|(n, w)| nodes[n].coords * w).sum();
            let back = place + f.normal * f.distance - Vector3::from(x);
            assert!(back.norm() < 1e-14, "{x:?}");
        }
        // A point of a surface that looks down sees the top, even at the rim, and nothing beside or above it.
        let down = Some(-Vector3::z());
        assert!((see(0.999, 0.5, 0.95, down).distance + 0.05).abs() < 1e-14);
        assert!((see(1.001, 0.5, 0.95, down).distance + 0.05).abs() < 1e-14);
        for x in [[1.2, 0.5, 0.95], [0.5, 0.5, 1.05], [0.5, 0.5, 0.1]] {
            assert!(see(x[0], x[1], x[2], down).distance.is_infinite(), "{x:?}");
        }
        // A point at a rim, whose normal is slanted, lies behind the plane of a side but in front of the
        // bottom.
        let slanted = Some(Vector3::new(1.0, 0.0, 1.0));
        assert!(see(0.2, 0.5, -0.01, slanted).distance.is_infinite());
        assert!((see(0.2, 0.5, 0.01, slanted).distance + 0.01).abs() < 1e-14);
    }
}

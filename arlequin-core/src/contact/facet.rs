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
/// Part of its size by which a facet is taken to be larger where others are nearer: above round-off.
const NEAR: f64 = 1e-6;
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
pub(super) fn thickness(faces: &Faces, x: &Vector3<f64>, normal: &Vector3<f64>, reach: f64) -> f64 {
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
        // The other lip of a crack is no other side.
        if way > NEAR * reach && inside {
            nearest = nearest.min(way);
        }
    });
    nearest
}

/// A facet in its present place.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlacedFacet {
    facet: Facet,
    corners: [Vector3<f64>; 3],
    /// Outward unit normal.
    normal: Vector3<f64>,
    /// Centre, and largest distance of a corner from it \[m\].
    centre: Vector3<f64>,
    radius: f64,
}

impl PlacedFacet {
    /// Places a facet whose nodes are at `place`; one without area touches nothing.
    pub(super) fn new(facet: &Facet, place: impl Fn(u32) -> Vector3<f64>) -> Self {
        let corners = facet.triangle.places(place);
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
        let centre = (a + b + c) / 3.0;
        let farthest = corners.iter().fold(0.0_f64, |m, x| m.max((x - centre).norm()));
        Self {
            facet: *facet,
            corners,
            radius: normal.map_or(f64::NEG_INFINITY, |_| farthest),
            normal: normal.unwrap_or_default(),
            centre,
        }
    }

    /// Returns whether the facet may have a point nearer than a distance \[m\].
    fn may_reach(&self, x: &Vector3<f64>, distance: f64) -> bool {
        let far = distance + self.radius + NEAR * self.facet.size;
        far >= 0.0 && (x - self.centre).norm_squared() <= far * far
    }

    /// Foot at a point `x` of the facet, at a signed distance \[m\] and with a normal.
    fn foot(&self, x: &Vector3<f64>, distance: f64, normal: Vector3<f64>, depth: f64) -> Foot {
        let rest = &self.facet.doubled;
        Foot {
            place: self.facet.triangle.place(weights(x, &self.corners)),
            distance,
            normal,
            turn: self.normal.dot(rest) / rest.norm(),
            depth,
        }
    }
}

/// A point that looks for its foot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeker {
    pub(super) at: Vector3<f64>,
    /// Outward normal of the surface to which the point belongs, of any length; `None` for spheres.
    pub(super) normal: Option<Vector3<f64>>,
    /// Radius of a sphere \[m\], which has no foot farther away. Its centre may lie as deep, no deeper: all
    /// facets within the radius are known, so that the nearest of them says on which side the centre lies.
    pub(super) radius: f64,
}

/// The nearest foot so far. Of feet that are equally near, the one with the highest rank counts.
#[derive(Debug)]
struct Nearest {
    foot: Foot,
    rank: f64,
}

impl Nearest {
    fn none() -> Self {
        Self {
            foot: Foot::none(),
            rank: 0.0,
        }
    }

    fn distance(&self) -> f64 {
        self.foot.distance.abs()
    }

    fn offer(&mut self, distance: f64, rank: f64, size: f64, foot: impl FnOnce() -> Foot) {
        let closer = self.distance() - distance.abs();
        let equal = closer.abs() <= EQUAL * size;
        if (equal && rank > self.rank) || (!equal && closer > 0.0) {
            (self.foot, self.rank) = (foot(), rank);
        }
    }
}

/// Finds the foot of a point among some facets.
pub(super) fn foot<'a>(seeker: &Seeker, facets: impl Iterator<Item = &'a PlacedFacet> + Clone) -> Foot {
    match seeker.normal {
        Some(own) => foot_of_surface(&seeker.at, &own, facets),
        None => foot_of_sphere(&seeker.at, seeker.radius, facets),
    }
}

fn foot_of_sphere<'a>(at: &Vector3<f64>, radius: f64, facets: impl Iterator<Item = &'a PlacedFacet>) -> Foot {
    let mut best = Nearest::none();
    for f in facets {
        if !f.may_reach(at, radius.min(best.distance())) {
            continue;
        }
        let x = closest_on_triangle(at, &f.corners);
        let d = at - x;
        let (height, size) = (f.normal.dot(&d), d.norm());
        let depth = f.facet.depth.min(radius);
        let is_outside = height >= 0.0;
        if !is_outside && size > depth {
            continue;
        }
        let outwards = if size > EQUAL * f.facet.size {
            d / if is_outside { size } else { -size }
        } else {
            f.normal
        };
        let distance = if is_outside { size } else { -size };
        // On an edge, the facet whose plane is farther says on which side the sphere lies.
        best.offer(distance, height.abs(), f.facet.size, || {
            f.foot(&x, distance, outwards, depth)
        });
    }
    best.foot
}

fn foot_of_surface<'a>(
    at: &Vector3<f64>,
    own: &Vector3<f64>,
    facets: impl Iterator<Item = &'a PlacedFacet> + Clone,
) -> Foot {
    let (mut within, mut beyond) = (Nearest::none(), Nearest::none());
    let limit = FACING * own.norm();
    let is_facing = |f: &PlacedFacet| own.dot(&f.normal) <= limit;
    for f in facets.clone() {
        let height = f.normal.dot(&(at - f.centre));
        let depth = f.facet.depth;
        // Beyond the rim, a facet is farther than it is deep.
        let reach = depth.min(within.distance()) + RIM * f.facet.size;
        if height >= 0.0 || height < -depth || !is_facing(f) || !f.may_reach(at, reach) {
            continue;
        }
        let x = closest_on_triangle(at, &f.corners);
        let aside = (at - x - f.normal * height).norm();
        if aside > RIM * f.facet.size {
            continue;
        }
        let is_beyond = aside > EQUAL * f.facet.size;
        let best = if is_beyond { &mut beyond } else { &mut within };
        // On an edge, the point belongs to the facet that it lies behind.
        best.offer(height, -aside, f.facet.size, || {
            f.foot(&x, height, f.normal, depth)
        });
    }
    let way_to = |f: &PlacedFacet, far: f64| {
        f.may_reach(at, far)
            .then(|| at - closest_on_triangle(at, &f.corners))
    };
    let far = beyond.distance();
    let is_in_front = |f: &PlacedFacet| {
        is_facing(f)
            && way_to(f, far).is_some_and(|d| {
                let height = f.normal.dot(&d);
                (0.0..=far).contains(&height) && (d - f.normal * height).norm() <= EQUAL * f.facet.size
            })
    };
    let takes_beyond = far < within.distance() && !facets.clone().any(is_in_front);
    let foot = if takes_beyond { beyond.foot } else { within.foot };
    let depth = -foot.distance;
    let is_grazed = |f: &PlacedFacet| way_to(f, depth).is_some_and(|d| d.norm() < depth * (1.0 - EQUAL));
    if depth > GRAZED * foot.depth && facets.clone().any(is_grazed) {
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

    /// Facets of a slit hold points as deep as those of a block: the other lip is not the other side.
    #[test]
    fn lips_of_a_slit_are_as_deep_as_other_facets() {
        let (nodes, quads) = cube();
        let lifted = nodes.iter().map(|x| Point3::new(x.x, x.y, x.z + 1.0));
        // Turned, so that round-off parts the lips.
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.8, 0.5));
        let nodes: Vec<_> = nodes.iter().copied().chain(lifted).map(|x| turn * x).collect();
        let above = quads.iter().map(|q| q.map(|n| n + 8));
        let quads: Vec<_> = quads.iter().copied().chain(above).collect();
        let facets = facets(&Triangle::cut(&quads, nodes.len()), &nodes);
        assert!(facets.iter().all(|f| (f.depth - 0.5).abs() < 1e-14));
    }

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
            let (at, radius) = (Vector3::new(x, y, z), 0.8);
            let placed = facets
                .iter()
                .map(|f| PlacedFacet::new(f, |n| nodes[n as usize].coords));
            let placed: Vec<PlacedFacet> = placed.collect();
            foot(&Seeker { at, normal, radius }, placed.iter())
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
        // Deep behind a facet while another one is nearer: a corner that has entered by the other one.
        assert!((see(0.9, 0.5, 0.88, down).distance + 0.12).abs() < 1e-14);
        assert!((see(0.8, 0.5, 0.85, down).distance + 0.15).abs() < 1e-14);
        assert!(see(0.9, 0.5, 0.85, down).distance.is_infinite());
        // A point at a rim, whose normal is slanted, lies behind the plane of a side but in front of the
        // bottom.
        let slanted = Some(Vector3::new(1.0, 0.0, 1.0));
        assert!(see(0.2, 0.5, -0.01, slanted).distance.is_infinite());
        assert!((see(0.2, 0.5, 0.01, slanted).distance + 0.01).abs() < 1e-14);
    }
}

//! Points of bodies, and triangles of the surface of bodies of elements, for the watch over intrusions.

use crate::setup::Grid;
use arlequin::core::geometry::{bounds_of, closest_on_triangle};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::RigidShape;
use arlequin::dem_beam::packing::surface::winding;
use arlequin::fem_ref::ElementKind;

/// Depth of one body in another, and its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Depth {
    /// Depth \[m\], positive inside.
    pub(super) depth: f64,
    /// Place \[m\].
    pub(super) place: Point3<f64>,
}

impl Depth {
    fn deeper(a: Option<Self>, b: Self) -> Option<Self> {
        match a {
            Some(a) if a.depth >= b.depth => Some(a),
            _ => Some(b),
        }
    }
}

/// Points and surface of a body in their displaced positions.
#[derive(Debug, Clone)]
pub(super) struct Shell {
    /// Numbers of the points in the model, and their positions at rest \[m\].
    nodes: Vec<u32>,
    at_rest: Vec<Point3<f64>>,
    now: Vec<Point3<f64>>,
    /// Radii of particles \[m\]; empty for nodes of elements.
    radii: Vec<f64>,
    /// For each point: true if it sleeps, so that another model is the body there. Empty if none can.
    asleep: Vec<bool>,
    /// Triangles of the surface of elements by their points, normal outwards; empty for particles.
    triangles: Vec<[u32; 3]>,
    /// Smallest x of each triangle with its number, ascending, and the largest extent of a triangle along x
    /// \[m\].
    sorted: Vec<(f64, u32)>,
    widest: f64,
}

impl Shell {
    /// Returns whether a grid shows solid elements.
    pub(super) fn is_solid(grid: &Grid) -> bool {
        kind(grid).is_some()
    }

    /// Takes the particles, or the surface of the elements; `None` for lines.
    pub(super) fn from_grid(grid: &Grid) -> Option<Self> {
        if !grid.radii.is_empty() {
            let nodes = (0..grid.points.len() as u32).collect();
            return Some(Self::new(nodes, grid, grid.radii.clone(), Vec::new()));
        }
        let mut triangles = boundary(grid, kind(grid)?);
        // Six times the signed volume between a triangle and the origin; the sum is positive for outward
        // normals.
        let volume = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| grid.points[k as usize].coords);
            a.dot(&b.cross(&c))
        };
        if triangles.iter().map(volume).sum::<f64>() < 0.0 {
            // The elements have the reverse orientation.
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let local = |k: &mut u32| *k = nodes.partition_point(|n| n < k) as u32;
        triangles.iter_mut().flatten().for_each(local);
        Some(Self::new(nodes, grid, Vec::new(), triangles))
    }

    fn new(nodes: Vec<u32>, grid: &Grid, radii: Vec<f64>, triangles: Vec<[u32; 3]>) -> Self {
        let at_rest: Vec<_> = nodes.iter().map(|k| grid.points[*k as usize]).collect();
        let mut out = Self {
            now: at_rest.clone(),
            sorted: Vec::with_capacity(triangles.len()),
            widest: 0.0,
            nodes,
            at_rest,
            radii,
            asleep: Vec::new(),
            triangles,
        };
        out.sort();
        out
    }

    /// Moves the points by the displacements `q` of the model, three per node \[m\].
    pub(super) fn displace(&mut self, q: &[f64]) {
        for ((now, at_rest), k) in self.now.iter_mut().zip(&self.at_rest).zip(&self.nodes) {
            *now = at_rest + Vector3::from_column_slice(&q[3 * *k as usize..][..3]);
        }
        self.sort();
    }

    /// Leaves points that sleep out of depths in obstacles.
    pub(super) fn leave_out(&mut self, sleeps: impl Fn(usize) -> bool) {
        self.asleep = self.nodes.iter().map(|k| sleeps(*k as usize)).collect();
    }

    fn sleeps(&self, point: usize) -> bool {
        self.asleep.get(point).copied().unwrap_or(false)
    }

    /// Moves the points back to their positions at rest.
    pub(super) fn put_back(&mut self) {
        self.now.clone_from(&self.at_rest);
        self.sort();
    }

    fn sort(&mut self) {
        // Sorted by x, the triangles near a point are one stretch of the list.
        self.sorted.clear();
        self.widest = 0.0;
        for (k, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|i| self.now[i as usize].x);
            let low = a.min(b).min(c);
            self.sorted.push((low, k as u32));
            self.widest = self.widest.max(a.max(b).max(c) - low);
        }
        self.sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    }

    fn corners(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|i| self.now[i as usize])
    }

    fn radius(&self, point: usize) -> f64 {
        self.radii.get(point).copied().unwrap_or(0.0)
    }

    /// Returns the largest depth of the body in an obstacle displaced by `by`; `None` if they are apart.
    pub(super) fn depth_in_obstacle(&self, shape: &RigidShape, by: &Vector3<f64>) -> Option<Depth> {
        let mut deepest = None;
        let mut meet = |distance: f64, place: Point3<f64>| {
            if distance < 0.0 {
                let depth = -distance;
                deepest = Depth::deeper(deepest, Depth { depth, place });
            }
        };
        let points = self.now.iter().zip(&self.radii).enumerate();
        for (_, (x, r)) in points.filter(|(k, _)| !self.sleeps(*k)) {
            meet(shape.distance(x, by).0 - r, *x);
        }
        let awake = |k: &usize| !self.triangles[*k].iter().any(|i| self.sleeps(*i as usize));
        for k in (0..self.triangles.len()).filter(awake) {
            let corners = self.corners(k);
            let [first, second, third] = &corners;
            let size = (second - first).norm().max((third - first).norm());
            // No point of a triangle is farther from its first corner than the longer edge there.
            if shape.distance(first, by).0 < size {
                let (distance, place) = shape.distance_of_triangle(&corners, by);
                meet(distance, place);
            }
        }
        // A ball can lie wholly within the elements and cut no triangle.
        // Where some sleep, those that are awake enclose nothing.
        if let (None, RigidShape::Sphere { centre, radius }, false) =
            (deepest, shape, self.asleep.contains(&true))
        {
            let place = centre + by;
            if self.holds(&place) {
                let depth = self.distance_from_surface(&place) + radius;
                return Some(Depth { depth, place });
            }
        }
        deepest
    }

    /// Returns whether a point lies within the elements.
    fn holds(&self, x: &Point3<f64>) -> bool {
        let [low, high] = bounds_of(self.now.iter());
        // The winding number costs a pass over all triangles.
        if self.triangles.is_empty() || (0..3).any(|c| x[c] < low[c] || x[c] > high[c]) {
            return false;
        }
        let corners = |k: usize| self.corners(k).map(|p| p.coords);
        // Inside it is one, outside zero; a half tells them apart despite rounding.
        winding(&x.coords, (0..self.triangles.len()).map(corners)) > 0.5
    }

    fn distance_from_surface(&self, x: &Point3<f64>) -> f64 {
        let distance = |k: usize| {
            let corners = self.corners(k).map(|p| p - x);
            closest_on_triangle(&Vector3::zeros(), &corners).norm()
        };
        (0..self.triangles.len())
            .map(distance)
            .fold(f64::INFINITY, f64::min)
    }

    /// Returns the largest depth of the body and another in each other; `None` if they are apart.
    pub(super) fn depth_in(&self, other: &Self) -> Option<Depth> {
        let within = self.common(other);
        match (self.triangles.is_empty(), other.triangles.is_empty()) {
            (true, true) => self.overlap(other, &within),
            (true, false) => self.depth_behind(other, &within),
            (false, true) => other.depth_behind(self, &within),
            // A corner of either body may be inside the other.
            (false, false) => {
                let depths = [
                    self.depth_behind(other, &within),
                    other.depth_behind(self, &within),
                ];
                depths
                    .into_iter()
                    .flatten()
                    .reduce(|a, b| if a.depth >= b.depth { a } else { b })
            }
        }
    }

    /// Box that contains all points that may meet the other body \[m\].
    fn common(&self, other: &Self) -> [Point3<f64>; 2] {
        let [a, b] = [self, other].map(|s| bounds_of(s.now.iter()));
        let radius = |s: &Self| s.radii.iter().fold(0.0, |m: f64, r| m.max(*r));
        let reach = Vector3::repeat(radius(self) + radius(other));
        [a[0].sup(&b[0]) - reach, a[1].inf(&b[1]) + reach]
    }

    /// Returns the largest depth of the points in a box behind the surface of the elements of `other`.
    /// Considers points up to the extent of a triangle from the surface.
    fn depth_behind(&self, other: &Self, within: &[Point3<f64>; 2]) -> Option<Depth> {
        let reach = other.widest;
        let mut deepest = None;
        for (k, x) in self.now.iter().enumerate().filter(|(_, x)| contains(within, x)) {
            let r = self.radius(k);
            if let Some(height) = other.height(x, r + reach) {
                let depth = r - height;
                if depth > 0.0 {
                    deepest = Depth::deeper(deepest, Depth { depth, place: *x });
                }
            }
        }
        deepest
    }

    /// Height of a point above the surface \[m\], negative behind it; `None` beyond `reach`.
    fn height(&self, x: &Point3<f64>, reach: f64) -> Option<f64> {
        // A triangle that starts earlier ends before the reach of the point.
        let first = self.sorted.partition_point(|s| s.0 < x.x - reach - self.widest);
        let near = self.sorted[first..].iter().take_while(|s| s.0 <= x.x + reach);
        let mut best: Option<(f64, f64)> = None;
        for (_, k) in near {
            let corners = self.corners(*k as usize);
            let d = x.coords - closest_on_triangle(&x.coords, &corners.map(|p| p.coords));
            let distance = d.norm();
            if distance > reach {
                continue;
            }
            let [a, b, c] = corners;
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
            let height = normal.dot(&d);
            // At an edge or corner several triangles are equally near; the one with the largest height
            // decides the side.
            let slack = 1e-9 * reach;
            let nearer = best.is_none_or(|(least, before)| {
                distance < least - slack || (distance < least + slack && height.abs() > before.abs())
            });
            if nearer {
                best = Some((distance, height));
            }
        }
        // Beside a triangle the height over its plane is smaller than the distance; only its sign counts.
        best.map(|(distance, height)| distance.copysign(height))
    }

    /// Returns the largest overlap of particles with those of `other`: sum of the radii minus distance of the
    /// centres.
    fn overlap(&self, other: &Self, within: &[Point3<f64>; 2]) -> Option<Depth> {
        let largest = other.radii.iter().fold(0.0, |m: f64, r| m.max(*r));
        let mut near: Vec<(f64, usize)> = Vec::new();
        let inside = other.now.iter().enumerate().filter(|(_, x)| contains(within, x));
        near.extend(inside.map(|(k, x)| (x.x, k)));
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut deepest = None;
        for (k, x) in self.now.iter().enumerate().filter(|(_, x)| contains(within, x)) {
            let reach = self.radii[k] + largest;
            let first = near.partition_point(|n| n.0 < x.x - reach);
            for (_, other_k) in near[first..].iter().take_while(|n| n.0 <= x.x + reach) {
                let y = other.now[*other_k];
                let depth = self.radii[k] + other.radii[*other_k] - (x - y).norm();
                if depth > 0.0 {
                    let place = x + (y - x) * 0.5;
                    deepest = Depth::deeper(deepest, Depth { depth, place });
                }
            }
        }
        deepest
    }
}

fn contains([low, high]: &[Point3<f64>; 2], x: &Point3<f64>) -> bool {
    (0..3).all(|c| low[c] <= x[c] && x[c] <= high[c])
}

/// Element type of a grid; `None` for lines and particles.
fn kind(grid: &Grid) -> Option<ElementKind> {
    // Cell types of VTK.
    match grid.cell_type {
        10 => Some(ElementKind::Tet4),
        12 => Some(ElementKind::Hex8),
        _ => None,
    }
}

/// Triangles of the faces that belong to one cell only, with outward normals.
fn boundary(grid: &Grid, kind: ElementKind) -> Vec<[u32; 3]> {
    // Corners of a face, sorted and in their order; a triangular face has no fourth.
    let mut faces: Vec<[[u32; 4]; 2]> = Vec::new();
    for cell in grid.connectivity.chunks_exact(grid.corners) {
        for face in kind.faces() {
            let mut corners = [u32::MAX; 4];
            corners.iter_mut().zip(*face).for_each(|(to, c)| *to = cell[*c]);
            let mut ascending = corners;
            ascending.sort_unstable();
            faces.push([ascending, corners]);
        }
    }
    faces.sort_unstable();
    let alone = faces.chunk_by(|a, b| a[0] == b[0]).filter(|same| same.len() == 1);
    let halves = alone.flat_map(|face| {
        let [a, b, c, d] = face[0][1];
        [[a, b, c], [a, c, d]]
    });
    // A triangular face has no second half.
    halves.filter(|t| t[2] != u32::MAX).collect()
}

//! A closed triangle surface: volume, inside test, and nearest point through a uniform grid.

use super::nesting::{Place, place};
use crate::error::{Error, Result, finite, positive};
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Largest number of walls that push a sphere at once.
const WALLS: usize = 4;
/// Two walls count as one if the cosine between their normals is above this value.
const SAME_WALL: f64 = 0.97;

/// A closed, outward oriented triangle surface \[m\].
#[derive(Debug, Clone)]
pub struct Surface {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Bounding ball of each triangle: centre and radius \[m\]. It excludes most far triangles cheaply.
    balls: Vec<[f64; 4]>,
    volume: f64,
    bounds: (Vector3<f64>, Vector3<f64>),
    grid: Grid,
}

/// Triangles near each cell of a uniform grid over the bounding box, with a layer of cells around it.
#[derive(Debug, Clone, Default)]
struct Grid {
    size: f64,
    dims: [usize; 3],
    reach: f64,
    start: Vec<u32>,
    /// Distance from the centre of the cell \[m\] and number of each triangle, nearest first.
    triangles: Vec<(f64, u32)>,
    /// For cells without a near triangle: true if they are inside.
    inside: Vec<bool>,
}

impl Surface {
    /// Makes a closed surface after checking it.
    ///
    /// # Errors
    /// [`Error::NotFinite`] coordinates, [`Error::OutOfRange`] for a vertex number that does not exist,
    /// [`Error::OpenSurface`] if an edge is not shared by exactly two triangles in opposite directions,
    /// [`Error::NoVolume`] if the orientation is inward or the volume zero.
    pub fn new(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self> {
        for (i, v) in vertices.iter().enumerate() {
            for c in v.iter() {
                finite("coordinate", "vertex", i, *c)?;
            }
        }
        let mut edges: BTreeMap<(u32, u32), (usize, i64)> = BTreeMap::new();
        for t in &triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                if a as usize >= vertices.len() {
                    return Err(Error::no_vertex(a));
                }
                // Number of triangles at the edge, and their directions along it summed with sign.
                let e = edges.entry((a.min(b), a.max(b))).or_default();
                e.0 += 1;
                e.1 += if a < b { 1 } else { -1 };
            }
        }
        if let Some((&(a, b), &(count, _))) = edges.iter().find(|(_, e)| **e != (2, 0)) {
            return Err(Error::OpenSurface {
                first: a as usize,
                second: b as usize,
                count,
            });
        }
        let vertex = |i: u32| vertices[i as usize];
        let volume = triangles
            .iter()
            .map(|&[a, b, c]| vertex(a).dot(&vertex(b).cross(&vertex(c))) / 6.0)
            .sum::<f64>();
        // Vertices of no triangle may lie anywhere and do not count.
        let used = || triangles.iter().flatten().map(|&i| vertex(i));
        let low = used().fold(Vector3::repeat(f64::INFINITY), |m, v| m.inf(&v));
        let high = used().fold(Vector3::repeat(f64::NEG_INFINITY), |m, v| m.sup(&v));
        if volume.is_nan() || volume <= 1e-12 * (high - low).product() {
            return Err(Error::NoVolume { volume });
        }
        let mut out = Self {
            balls: balls(&vertices, &triangles),
            vertices,
            triangles,
            volume,
            bounds: (low, high),
            grid: Grid::default(),
        };
        out.prepare((high - low).min() / 20.0);
        Ok(out)
    }

    /// Makes a surface that need not be closed and has no inside, for [`Self::nearest`] up to `reach` \[m\].
    pub(crate) fn open(triangles: &[[Vector3<f64>; 3]], reach: f64) -> Self {
        let vertices: Vec<Vector3<f64>> = triangles.iter().flatten().copied().collect();
        let low = vertices
            .iter()
            .fold(Vector3::repeat(f64::INFINITY), |m, v| m.inf(v));
        let high = vertices
            .iter()
            .fold(Vector3::repeat(f64::NEG_INFINITY), |m, v| m.sup(v));
        let numbers = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
        let triangles: Vec<[u32; 3]> = numbers.collect();
        let mut out = Self {
            balls: balls(&vertices, &triangles),
            vertices,
            triangles,
            volume: 0.0,
            bounds: (low, high),
            grid: Grid::default(),
        };
        out.prepare(reach);
        out
    }

    /// Corners \[m\].
    #[must_use]
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Vertex numbers of the triangles, counter-clockwise from outside.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Scales the surface, for example by 1e-3 if it was read from a file in millimetres.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] unless the factor is positive; errors of [`Self::new`].
    pub fn scaled(self, factor: f64) -> Result<Self> {
        positive("scale of a surface", factor)?;
        if (factor - 1.0).abs() <= 0.0 {
            return Ok(self);
        }
        let vertices = self.vertices.iter().map(|x| x * factor).collect();
        Self::new(vertices, self.triangles)
    }

    /// Enclosed volume \[m³\].
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Smallest and largest corner of the bounding box \[m\].
    #[must_use]
    pub fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        self.bounds
    }

    /// Returns the separate bodies within: one per shell that faces outwards, with its cavities, in the order
    /// of their first triangles.
    #[must_use]
    pub fn bodies(&self) -> Vec<Self> {
        let shells = super::orient::shells(&self.triangles);
        if shells.len() == 1 {
            return vec![self.clone()];
        }
        let corners = |t: &[u32; 3]| t.map(|i| self.vertices[i as usize]);
        let volume = |shell: &[[u32; 3]]| -> f64 {
            let tetrahedron = |t| {
                let [a, b, c]: [Vector3<f64>; 3] = corners(t);
                a.dot(&b.cross(&c)) / 6.0
            };
            shell.iter().map(tetrahedron).sum()
        };
        let (mut outer, cavities): (Vec<_>, Vec<_>) = shells.into_iter().partition(|s| volume(s) > 0.0);
        let sizes: Vec<f64> = outer.iter().map(|s| volume(s)).collect();
        let facing = |shell: &[[u32; 3]]| shell.iter().map(corners).collect::<Vec<_>>();
        let outside: Vec<_> = outer.iter().map(|o| facing(o)).collect();
        let mut owners = Vec::with_capacity(cavities.len());
        for cavity in &cavities {
            let inner = facing(cavity);
            let holds = (0..outer.len()).filter(|&o| place(&inner, &outside[o]) == Place::Inside);
            // A cavity belongs to the smallest shell around it.
            owners.push(holds.min_by(|&a, &b| sizes[a].total_cmp(&sizes[b])));
        }
        for (cavity, owner) in cavities.into_iter().zip(owners) {
            match owner {
                Some(o) => outer[o].extend(cavity),
                // A cavity in no shell: the surface is not consistent and stays whole.
                None => return vec![self.clone()],
            }
        }
        let bodies: Result<Vec<Self>> = outer
            .into_iter()
            .map(|triangles| self.restrict(triangles))
            .collect();
        bodies.unwrap_or_else(|_| vec![self.clone()])
    }

    /// Returns the surface of some of the triangles, with only their vertices.
    fn restrict(&self, mut triangles: Vec<[u32; 3]>) -> Result<Self> {
        let mut place = BTreeMap::new();
        let mut vertices = Vec::new();
        for i in triangles.iter_mut().flatten() {
            let old = *i;
            *i = *place.entry(old).or_insert_with(|| {
                vertices.push(self.vertices[old as usize]);
                vertices.len() as u32 - 1
            });
        }
        Self::new(vertices, triangles)
    }

    pub(crate) fn identity(&self, out: &mut Vec<f64>) {
        out.extend(self.vertices.iter().flat_map(|v| v.iter().copied()));
        out.extend(self.triangles.iter().flatten().map(|&i| f64::from(i)));
    }

    /// Rebuilds the grid so that [`Self::nearest`] finds every point up to `reach` \[m\].
    pub(crate) fn prepare(&mut self, reach: f64) {
        let extent = self.bounds.1 - self.bounds.0;
        // The bound on the cell size limits the memory of the grid.
        let size = reach.max(extent.max() / 128.0);
        // One layer of cells around the box, because centres of spheres may leave it by a little.
        let dims = [0, 1, 2].map(|a| (extent[a] / size).ceil() as usize + 2);
        let cells = dims[0] * dims[1] * dims[2];
        let mut per_cell: Vec<Vec<(f64, u32)>> = vec![Vec::new(); cells];
        let grid = Grid {
            size,
            dims,
            reach,
            ..Grid::default()
        };
        for (t, tri) in self.triangles.iter().enumerate() {
            let c = tri.map(|i| self.vertices[i as usize]);
            let low = grid.cell(&(c[0].inf(&c[1]).inf(&c[2]).add_scalar(-reach)), &self.bounds.0);
            let high = grid.cell(&(c[0].sup(&c[1]).sup(&c[2]).add_scalar(reach)), &self.bounds.0);
            for (i, centre) in grid.cells_between(low, high, &self.bounds.0) {
                // The farthest point of a cell is half a diagonal (0.8660 sizes) from its centre.
                let distance = (closest_on_triangle(&centre, &c) - centre).norm();
                if distance <= reach + 0.8661 * size {
                    per_cell[i].push((distance, t as u32));
                }
            }
        }
        let mut start = Vec::with_capacity(cells + 1);
        let mut flat = Vec::new();
        start.push(0);
        for n in &mut per_cell {
            n.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            flat.extend_from_slice(n);
            start.push(flat.len() as u32);
        }
        let mut inside = vec![false; cells];
        let all_cells = grid.cells_between([0; 3], dims.map(|d| d - 1), &self.bounds.0);
        for (i, centre) in all_cells {
            // No surface passes between two neighbouring cells without a near triangle.
            let follows = i % dims[2] > 0 && per_cell[i - 1].is_empty();
            if per_cell[i].is_empty() {
                inside[i] = if follows {
                    inside[i - 1]
                } else {
                    self.winding(&centre) > 0.5
                };
            }
        }
        self.grid = Grid {
            start,
            triangles: flat,
            inside,
            ..grid
        };
    }

    fn winding(&self, x: &Vector3<f64>) -> f64 {
        let corners = |t: &[u32; 3]| t.map(|i| self.vertices[i as usize]);
        winding(x, self.triangles.iter().map(corners))
    }

    /// Returns the signed distance \[m\] (positive inside) and the inward normal of the nearest surface
    /// point, if it is within `reach` (at most the reach prepared for).
    #[must_use]
    pub fn nearest(&self, x: &Vector3<f64>, reach: f64) -> Option<(f64, Vector3<f64>)> {
        let (range, off) = self.triangles_near(x);
        if range.is_empty() {
            return None;
        }
        let limit = reach.min(self.grid.reach);
        let (mut best, mut sign, mut steep) = (f64::INFINITY, 0.0, 0.0);
        let (mut foot, mut face) = (Vector3::zeros(), Vector3::zeros());
        for &(distance, t) in &self.grid.triangles[range] {
            // Equally near triangles must be compared below, hence a little more.
            let limit_of_ties = best * (1.0 + 1e-6);
            if distance - off > limit_of_ties {
                break;
            }
            let [a, b, c, radius] = self.balls[t as usize];
            let clear = limit_of_ties + radius;
            if (x - Vector3::new(a, b, c)).norm_squared() > clear * clear {
                continue;
            }
            let c = self.triangles[t as usize].map(|i| self.vertices[i as usize]);
            let p = closest_on_triangle(x, &c);
            let d = (p - x).norm();
            // A triangle without area lies in the edges of its neighbours and has no normal.
            let Some(n) = (c[1] - c[0]).cross(&(c[2] - c[0])).try_normalize(0.0) else {
                continue;
            };
            // On a shared edge or corner several faces are equally near. The one seen most frontally tells
            // the side.
            let front = if d > 0.0 { (p - x).dot(&n) / d } else { 1.0 };
            // Distances to a common edge differ by round-off from face to face.
            let tie = d <= best * (1.0 + 1e-9);
            if d < best * (1.0 - 1e-9) || (tie && front.abs() > steep) {
                best = d.min(best);
                (sign, steep, foot, face) = (front.signum(), front.abs(), p, n);
            }
        }
        if best > limit && sign >= 0.0 || !best.is_finite() {
            return None;
        }
        let normal = if best > 1e-12 * self.grid.size {
            (x - foot) * (sign / best)
        } else {
            -face
        };
        Some((sign * best, normal))
    }

    /// Calls `wall(gap, inward normal)` for the nearest point, if it is nearer than `reach`. It also calls it
    /// for faces of other directions above which `x` lies within `reach`: in an edge both walls must push, or
    /// a sphere there never comes to rest.
    #[inline]
    pub(crate) fn walls(&self, x: &Vector3<f64>, reach: f64, mut wall: impl FnMut(f64, Vector3<f64>)) {
        let Some((gap, n)) = self.nearest(x, reach) else {
            return;
        };
        wall(gap, n);
        if gap <= 0.0 || gap >= reach {
            return;
        }
        let (mut seen, mut count) = ([n; WALLS], 1);
        let (range, off) = self.triangles_near(x);
        for &(distance, t) in &self.grid.triangles[range] {
            if distance - off > reach || count == WALLS {
                break;
            }
            let [a, b, c, radius] = self.balls[t as usize];
            let clear = reach + radius;
            if (x - Vector3::new(a, b, c)).norm_squared() > clear * clear {
                continue;
            }
            let c = self.triangles[t as usize].map(|i| self.vertices[i as usize]);
            let Some(inwards) = (c[2] - c[0]).cross(&(c[1] - c[0])).try_normalize(0.0) else {
                continue;
            };
            let height = (x - c[0]).dot(&inwards);
            let is_seen = |s: &Vector3<f64>| s.dot(&inwards) > SAME_WALL;
            if height <= 0.0 || height >= reach || seen[..count].iter().any(is_seen) {
                continue;
            }
            if (closest_on_triangle(x, &c) - x).norm() <= height * (1.0 + 1e-9) {
                wall(height, inwards);
                seen[count] = inwards;
                count += 1;
            }
        }
    }

    /// Returns the range of the triangles near a point, and its distance from the centre of its cell \[m\].
    #[inline]
    fn triangles_near(&self, x: &Vector3<f64>) -> (std::ops::Range<usize>, f64) {
        let place = self.grid.cell(x, &self.bounds.0);
        let cell = self.grid.index(place);
        let middle = Vector3::from(place.map(|i| i as f64 - 0.5)) * self.grid.size + self.bounds.0;
        let range = self.grid.start[cell] as usize..self.grid.start[cell + 1] as usize;
        (range, (x - middle).norm())
    }

    /// Returns whether `x` is inside.
    #[must_use]
    pub fn contains(&self, x: &Vector3<f64>) -> bool {
        let (low, high) = self.bounds;
        if (0..3).any(|a| x[a] < low[a] || x[a] > high[a]) {
            return false;
        }
        let cell = self.grid.index(self.grid.cell(x, &low));
        if self.grid.start[cell] == self.grid.start[cell + 1] {
            return self.grid.inside[cell];
        }
        // The sign of the nearest face is cheaper than the winding number over all triangles.
        match self.nearest(x, self.grid.reach) {
            Some((gap, _)) => gap >= 0.0,
            None => self.winding(x) > 0.5,
        }
    }
}

impl Grid {
    /// Returns the cell of a point; points outside of the box fall in the layer around it.
    fn cell(&self, x: &Vector3<f64>, low: &Vector3<f64>) -> [usize; 3] {
        [0, 1, 2].map(|a| {
            let c = ((x[a] - low[a]) / self.size).floor() + 1.0;
            (c.max(0.0) as usize).min(self.dims[a] - 1)
        })
    }

    fn index(&self, c: [usize; 3]) -> usize {
        (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]
    }

    /// Returns the numbers and centres of all cells of a range, ends included.
    fn cells_between(
        &self,
        low: [usize; 3],
        high: [usize; 3],
        origin: &Vector3<f64>,
    ) -> Vec<(usize, Vector3<f64>)> {
        let mut out = Vec::new();
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
                    let c = Vector3::new(i as f64, j as f64, k as f64).add_scalar(-0.5);
                    out.push((self.index([i, j, k]), origin + c * self.size));
                }
            }
        }
        out
    }
}

/// Returns the centroid of each triangle and the distance of its farthest corner, rounded up.
fn balls(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<[f64; 4]> {
    let ball = |t: &[u32; 3]| {
        let corners = t.map(|i| vertices[i as usize]);
        let middle = corners.iter().sum::<Vector3<f64>>() / 3.0;
        let radius = corners.iter().fold(0.0_f64, |r, x| r.max((x - middle).norm()));
        [middle.x, middle.y, middle.z, radius * (1.0 + 1e-12)]
    };
    triangles.iter().map(ball).collect()
}

/// Returns the winding number of a surface about `x`: 1 inside, 0 outside (van Oosterom and Strackee).
pub fn winding(x: &Vector3<f64>, triangles: impl Iterator<Item = [Vector3<f64>; 3]>) -> f64 {
    let mut angle = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|v| v - x);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let det = a.dot(&b.cross(&c));
        let den = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        angle += 2.0 * det.atan2(den);
    }
    angle / (4.0 * std::f64::consts::PI)
}

//! A closed triangle surface: volume, inside test, and nearest point through a uniform grid.

mod grid;
mod listed;
mod nearest;

pub(crate) use listed::{Listed, Listing, Mover};

use super::nesting::{Place, place};
use crate::error::{Error, Result, finite, positive};
use grid::Grid;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A closed, outward oriented triangle surface \[m\].
#[derive(Debug, Clone)]
pub struct Surface {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Bounding ball of each triangle: centre and radius \[m\]. It excludes most far triangles cheaply.
    balls: Vec<[f64; 4]>,
    /// Outward unit normal of each triangle; zero for a triangle without area.
    normals: Vec<Vector3<f64>>,
    volume: f64,
    bounds: (Vector3<f64>, Vector3<f64>),
    grid: Box<Grid>,
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
                ends: [a, b].map(|v| vertices[v as usize].into()),
                count,
            });
        }
        let vertex = |i: u32| vertices[i as usize];
        let volume = triangles
            .iter()
            // Signed tetrahedra from the origin: what lies outside of the body cancels.
            .map(|&[a, b, c]| vertex(a).dot(&vertex(b).cross(&vertex(c))) / 6.0)
            .sum::<f64>();
        // Vertices of no triangle may lie anywhere and do not count.
        let used = || triangles.iter().flatten().map(|&i| vertex(i));
        let low = used().fold(Vector3::repeat(f64::INFINITY), |m, v| m.inf(&v));
        let high = used().fold(Vector3::repeat(f64::NEG_INFINITY), |m, v| m.sup(&v));
        // Not above round-off: a flat surface, or one that is turned inside out.
        if volume.is_nan() || volume <= 1e-12 * (high - low).product() {
            return Err(Error::NoVolume { volume });
        }
        let mut out = Self {
            balls: balls(&vertices, &triangles),
            normals: normals(&vertices, &triangles),
            vertices,
            triangles,
            volume,
            bounds: (low, high),
            grid: Box::default(),
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
            normals: normals(&vertices, &triangles),
            vertices,
            triangles,
            volume: 0.0,
            bounds: (low, high),
            grid: Box::default(),
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

    fn corners(&self, triangle: &[u32; 3]) -> [Vector3<f64>; 3] {
        triangle.map(|i| self.vertices[i as usize])
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
        let corners = |t: &[u32; 3]| self.corners(t);
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
}

/// Returns the centroid of each triangle and the distance of its farthest corner, rounded up.
fn balls(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<[f64; 4]> {
    let ball = |t: &[u32; 3]| {
        let corners = t.map(|i| vertices[i as usize]);
        let middle = corners.iter().sum::<Vector3<f64>>() / 3.0;
        let radius = corners.iter().fold(0.0_f64, |r, x| r.max((x - middle).norm()));
        // Rounded up, so that no triangle is passed over whose corner lies on the ball.
        [middle.x, middle.y, middle.z, radius * (1.0 + 1e-12)]
    };
    triangles.iter().map(ball).collect()
}

/// Returns the unit normal of each triangle; zero for a triangle without area.
fn normals(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| vertices[i as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
    };
    triangles.iter().map(normal).collect()
}

/// Returns the winding number of a surface about `x`: 1 inside, 0 outside (van Oosterom and Strackee).
pub fn winding(x: &Vector3<f64>, triangles: impl Iterator<Item = [Vector3<f64>; 3]>) -> f64 {
    let mut angle = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|v| v - x);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let det = a.dot(&b.cross(&c));
        let den = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        // `atan2` keeps the sign and the angles beyond a half-space, where a quotient would lose both.
        angle += 2.0 * det.atan2(den);
    }
    angle / (4.0 * std::f64::consts::PI)
}

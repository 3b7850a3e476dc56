//! Convex polyhedra, their half-spaces and volumes.

use super::clip::Body;
use super::{Sample, tetrahedron_volume};
use crate::Real;
use nalgebra::{Matrix3, Point3, Vector3};

/// Half-space `normal · x ≤ offset`.
#[derive(Debug, Clone, Copy)]
pub struct HalfSpace<T: Real> {
    /// Outward normal (any length).
    pub normal: Vector3<T>,
    /// Offset along the normal.
    pub offset: T,
}

impl<T: Real> HalfSpace<T> {
    /// Half-space bounded by the plane through `point`.
    pub fn new(point: &Point3<T>, normal: Vector3<T>) -> Self {
        Self {
            normal,
            offset: normal.dot(&point.coords),
        }
    }
    /// The other side of the same plane.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self {
            normal: -self.normal,
            offset: -self.offset,
        }
    }
    /// Signed distance beyond the plane, in units of the normal's length; negative inside.
    pub(crate) fn excess(&self, x: &Point3<T>) -> T {
        self.normal.dot(&x.coords) - self.offset
    }
}

/// A convex polyhedron as a list of planar face loops. Orientation of the loops is irrelevant.
#[derive(Debug, Clone, Default)]
pub struct Polyhedron<T: Real> {
    /// Face loops, each a list of corners in order.
    pub faces: Vec<Vec<Point3<T>>>,
}

impl<T: Real> Polyhedron<T> {
    /// Tetrahedron with the given corners.
    pub fn tetrahedron(p: [Point3<T>; 4]) -> Self {
        let face = |a: usize, b: usize, c: usize| vec![p[a], p[b], p[c]];
        Self {
            faces: vec![face(0, 2, 1), face(0, 1, 3), face(1, 2, 3), face(0, 3, 2)],
        }
    }

    /// Hexahedron with corners in the order of the usual isoparametric element (bottom loop, then top loop).
    /// Its faces must be planar.
    pub fn hexahedron(p: [Point3<T>; 8]) -> Self {
        let loops = [
            [0, 3, 2, 1],
            [4, 5, 6, 7],
            [0, 1, 5, 4],
            [1, 2, 6, 5],
            [2, 3, 7, 6],
            [3, 0, 4, 7],
        ];
        Self {
            faces: loops.iter().map(|l| l.iter().map(|&k| p[k]).collect()).collect(),
        }
    }

    /// Mean of the corners, an inner point.
    pub fn centre(&self) -> Point3<T> {
        let mut sum = Vector3::zeros();
        // Corners count once per face. The mean is inside in any case, which is all that is asked of it.
        let mut count = T::zero();
        for p in self.faces.iter().flatten() {
            sum += p.coords;
            count += T::one();
        }
        if count > T::zero() {
            Point3::from(sum / count)
        } else {
            Point3::origin()
        }
    }

    /// Bounding half-spaces, with normals that point away from the inside.
    pub fn half_spaces(&self) -> Vec<HalfSpace<T>> {
        let centre = self.centre();
        let plane = |f: &Vec<Point3<T>>| {
            let normal = loop_normal(f);
            // A face without area has no normal, and bounds nothing that its neighbours do not bound.
            (normal.norm_squared() > T::zero()).then(|| {
                let h = HalfSpace::new(&plane_point(f), normal.normalize());
                // Loops may run either way round.
                if h.excess(&centre) > T::zero() {
                    h.flipped()
                } else {
                    h
                }
            })
        };
        self.faces.iter().filter_map(plane).collect()
    }

    /// Part on the inner side of a plane; empty if nothing remains.
    #[must_use]
    pub fn clip(&self, plane: &HalfSpace<T>) -> Self {
        self.intersection(std::slice::from_ref(plane))
    }

    /// Intersection with another convex polyhedron, which is given by its half-spaces.
    #[must_use]
    pub fn intersection(&self, planes: &[HalfSpace<T>]) -> Self {
        Body::new(self).within(planes).unwrap_or_default()
    }

    /// Visits tetrahedra that fill the body: the triangles of every face, joined to the centre.
    pub fn for_each_tetrahedron(&self, mut visit: impl FnMut([Point3<T>; 4])) {
        // A tetrahedron needs no division; the general way would make four parts of it.
        if self.faces.len() == 4 && self.faces.iter().all(|f| f.len() == 3) {
            let base = &self.faces[0];
            if let Some(apex) = self.faces[1].iter().find(|p| !base.contains(p)) {
                return visit([base[0], base[1], base[2], *apex]);
            }
        }
        let centre = self.centre();
        for face in &self.faces {
            for k in 1..face.len() - 1 {
                visit([face[0], face[k], face[k + 1], centre]);
            }
        }
    }

    /// Visits tetrahedra that fill the body from one of its corners, about half as many as from the centre.
    /// The corner is the one on the most triangles.
    pub(super) fn for_each_tetrahedron_from_a_corner(&self, mut visit: impl FnMut([Point3<T>; 4])) {
        let triangles_on = |x: &Point3<T>| -> usize {
            let incident = self.faces.iter().filter(|f| f.contains(x));
            incident.map(|f| f.len().saturating_sub(2)).sum()
        };
        let mut best: Option<(usize, &Point3<T>)> = None;
        for x in self.faces.iter().flatten() {
            let count = triangles_on(x);
            // The first of equals, so that the choice is unique.
            if best.is_none_or(|b| count > b.0) {
                best = Some((count, x));
            }
        }
        let Some((_, apex)) = best else { return };
        for face in self.faces.iter().filter(|f| !f.contains(apex)) {
            for k in 1..face.len().saturating_sub(1) {
                visit([face[0], face[k], face[k + 1], *apex]);
            }
        }
    }

    /// Appends four samples that integrate quadratic polynomials over the whole body, `c + √3 L v_k` with the
    /// centroid `c`, the covariance `L Lᵀ` and the corners `v_k` of a regular tetrahedron. Returns `false`,
    /// and appends nothing, if one of them falls outside.
    pub(super) fn quadratic_rule(&self, out: &mut Vec<Sample<T>>) -> bool {
        let (mut volume, mut first) = (T::zero(), Vector3::zeros());
        self.for_each_tetrahedron(|t| {
            let v = tetrahedron_volume(&t).abs();
            volume += v;
            first += t.iter().fold(Vector3::zeros(), |s, p| s + p.coords) * (v * T::of(0.25));
        });
        if volume <= T::zero() {
            return true;
        }
        let centre = Point3::from(first / volume);
        let mut covariance = Matrix3::zeros();
        self.for_each_tetrahedron(|t| {
            let v = tetrahedron_volume(&t).abs();
            let d = t.map(|p| p - centre);
            let sum = d.iter().fold(Vector3::zeros(), |s, x| s + x);
            let squares = d.iter().fold(Matrix3::zeros(), |s, x| s + x * x.transpose());
            // Second moments of a tetrahedron about the centre.
            covariance += (squares + sum * sum.transpose()) * (v / T::of(20.0));
        });
        // A flat body has no covariance across it.
        let Some(factor) = (covariance / volume).cholesky() else {
            return false;
        };
        let corners = [
            [1.0, 1.0, 1.0],
            [1.0, -1.0, -1.0],
            [-1.0, 1.0, -1.0],
            [-1.0, -1.0, 1.0],
        ];
        let points = corners.map(|v| centre + factor.l() * Vector3::from(v.map(T::of)));
        let inside = |h: &HalfSpace<T>| points.iter().all(|x| h.excess(x) <= T::zero());
        let all_inside = self.half_spaces().iter().all(inside);
        if all_inside {
            out.extend(points.map(|point| Sample {
                point,
                measure: volume * T::of(0.25),
            }));
        }
        all_inside
    }

    /// Volume \[m³\].
    pub fn volume(&self) -> T {
        // Unsigned: the loops of the faces may run either way round.
        let mut v = T::zero();
        self.for_each_tetrahedron(|t| v += tetrahedron_volume(&t).abs());
        v
    }
}

fn loop_normal<T: Real>(face: &[Point3<T>]) -> Vector3<T> {
    let mut n = Vector3::zeros();
    for k in 1..face.len().saturating_sub(1) {
        n += (face[k] - face[0]).cross(&(face[k + 1] - face[0]));
    }
    n
}

/// A point of the plane of a face: a corner of a triangle, else the mean of the corners, as round-off may
/// have bent the face.
fn plane_point<T: Real>(face: &[Point3<T>]) -> Point3<T> {
    if face.len() == 3 {
        return face[0];
    }
    // Summed relative to the first corner, to lose no digits to large coordinates.
    let arms = face.iter().fold(Vector3::zeros(), |s, p| s + (p - face[0]));
    face[0] + arms / T::of(face.len() as f64)
}

//! Integration cells: segments with a cross-section and convex polyhedra, their intersections and quadrature.
//!
//! Everything here works in the reference configuration and only at set-up.

use crate::Real;
use nalgebra::{Point3, Vector3};

pub use crate::tree::BoxTree;

/// A sampling point of an integral: position \[m\] and measure \[m³\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T: Real> {
    /// Position \[m\].
    pub point: Point3<T>,
    /// Measure attached to it \[m³\].
    pub measure: T,
}

/// A piece of a domain on which shape functions are smooth.
#[derive(Debug, Clone)]
pub enum Cell<T: Real> {
    /// A straight line with a constant cross-section.
    Segment {
        /// End points \[m\].
        ends: [Point3<T>; 2],
        /// Cross-section \[m²\].
        section: T,
    },
    /// A convex body with planar faces.
    Polyhedron(Polyhedron<T>),
}

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
    fn excess(&self, x: &Point3<T>) -> T {
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

    /// The bounding half-spaces, normals pointing away from the inside.
    pub fn half_spaces(&self) -> Vec<HalfSpace<T>> {
        let centre = self.centre();
        let plane = |f: &Vec<Point3<T>>| {
            let normal = loop_normal(f);
            (normal.norm_squared() > T::zero()).then(|| {
                let h = HalfSpace::new(&f[0], normal.normalize());
                if h.excess(&centre) > T::zero() {
                    h.flipped()
                } else {
                    h
                }
            })
        };
        self.faces.iter().filter_map(plane).collect()
    }

    /// The part on the inner side of a plane; empty if nothing remains.
    #[must_use]
    pub fn clip(&self, plane: &HalfSpace<T>) -> Self {
        // Where nothing is cut off, a face in the plane must not be capped a second time.
        if !self.faces.iter().flatten().any(|p| plane.excess(p) > T::zero()) {
            return self.clone();
        }
        let mut kept = Vec::with_capacity(self.faces.len() + 1);
        let mut cut: Vec<Point3<T>> = Vec::new();
        for face in &self.faces {
            let piece = clip_loop(face, plane, &mut cut);
            if piece.len() >= 3 {
                kept.push(piece);
            }
        }
        if cut.len() >= 3 && !kept.is_empty() {
            kept.push(ordered_cap(cut, &plane.normal));
        }
        if kept.len() < 4 {
            Self::default()
        } else {
            Self { faces: kept }
        }
    }

    /// The intersection with another convex polyhedron given by its half-spaces.
    #[must_use]
    pub fn intersection(&self, planes: &[HalfSpace<T>]) -> Self {
        let mut body = self.clone();
        for plane in planes {
            if body.faces.is_empty() {
                break;
            }
            body = body.clip(plane);
        }
        body
    }

    /// Tetrahedra that fill the body: every face fan joined to the centre.
    pub fn for_each_tetrahedron(&self, mut visit: impl FnMut([Point3<T>; 4])) {
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

    /// Volume \[m³\].
    pub fn volume(&self) -> T {
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

fn clip_loop<T: Real>(face: &[Point3<T>], plane: &HalfSpace<T>, cut: &mut Vec<Point3<T>>) -> Vec<Point3<T>> {
    let mut out = Vec::with_capacity(face.len() + 1);
    for (k, a) in face.iter().enumerate() {
        let b = &face[(k + 1) % face.len()];
        let (ea, eb) = (plane.excess(a), plane.excess(b));
        if ea <= T::zero() {
            out.push(*a);
            if ea == T::zero() {
                cut.push(*a);
            }
        }
        if (ea < T::zero() && eb > T::zero()) || (ea > T::zero() && eb < T::zero()) {
            // Always from the inner to the outer corner, so that both faces of an edge cut it at the same bits.
            let (p, q, ep, eq) = if ea < T::zero() {
                (a, b, ea, eb)
            } else {
                (b, a, eb, ea)
            };
            let x = p + (q - p) * (ep / (ep - eq));
            out.push(x);
            cut.push(x);
        }
    }
    out
}

/// Orders the corners of a plane section around their centre.
fn ordered_cap<T: Real>(mut cut: Vec<Point3<T>>, normal: &Vector3<T>) -> Vec<Point3<T>> {
    let count = T::of(cut.len() as f64);
    let centre = Point3::from(cut.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / count);
    let n = normal.normalize();
    let e = if n.x.abs() < T::of(0.7) {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let u = n.cross(&e).normalize();
    let v = n.cross(&u);
    let angle = |p: &Point3<T>| {
        let d = p - centre;
        d.dot(&v).atan2(d.dot(&u)).as_f64()
    };
    cut.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    cut.dedup();
    cut
}

/// Signed volume of a tetrahedron \[m³\].
pub fn tetrahedron_volume<T: Real>(p: &[Point3<T>; 4]) -> T {
    (p[1] - p[0]).cross(&(p[2] - p[0])).dot(&(p[3] - p[0])) / T::of(6.0)
}

impl<T: Real> Cell<T> {
    /// Measure \[m³\]: volume, or length times section.
    pub fn measure(&self) -> T {
        match self {
            Self::Segment { ends, section } => (ends[1] - ends[0]).norm() * *section,
            Self::Polyhedron(p) => p.volume(),
        }
    }

    /// Corners of the axis-aligned bounding box.
    pub fn bounds(&self) -> [Point3<T>; 2] {
        match self {
            Self::Segment { ends, .. } => bounds_of(ends.iter()),
            Self::Polyhedron(p) => bounds_of(p.faces.iter().flatten()),
        }
    }

    /// The common part of two cells of the same kind; `None` where it is empty or of lower dimension.
    /// Two segments intersect only along a common line.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        match (self, other) {
            (
                Self::Segment { ends, section },
                Self::Segment {
                    ends: e2,
                    section: s2,
                },
            ) => {
                let length = (ends[1] - ends[0]).norm();
                let axis = (ends[1] - ends[0]) / length;
                let tolerance = length * T::epsilon() * T::of(64.0);
                let at = |p: &Point3<T>| axis.dot(&(p - ends[0]));
                let off = |p: &Point3<T>| (p - ends[0] - axis * at(p)).norm() > length * T::epsilon().sqrt();
                if e2.iter().any(off) {
                    return None;
                }
                let (a, b) = (at(&e2[0]).min(at(&e2[1])), at(&e2[0]).max(at(&e2[1])));
                let (a, b) = (a.max(T::zero()), b.min(length));
                (b - a > tolerance).then(|| Self::Segment {
                    ends: [ends[0] + axis * a, ends[0] + axis * b],
                    section: section.min(*s2),
                })
            }
            (Self::Polyhedron(p), Self::Polyhedron(q)) => {
                let body = p.intersection(&q.half_spaces());
                let size = p.volume().min(q.volume());
                (!body.faces.is_empty() && body.volume() > size * T::epsilon() * T::of(16.0))
                    .then_some(Self::Polyhedron(body))
            }
            _ => None,
        }
    }

    /// The part on the inner side of a plane.
    pub fn clip(&self, plane: &HalfSpace<T>) -> Option<Self> {
        match self {
            Self::Segment { ends, section } => {
                let (ea, eb) = (plane.excess(&ends[0]), plane.excess(&ends[1]));
                if ea >= T::zero() && eb >= T::zero() {
                    return None;
                }
                if ea <= T::zero() && eb <= T::zero() {
                    return Some(self.clone());
                }
                let x = ends[0] + (ends[1] - ends[0]) * (ea / (ea - eb));
                let ends = if ea < T::zero() {
                    [ends[0], x]
                } else {
                    [x, ends[1]]
                };
                Some(Self::Segment {
                    ends,
                    section: *section,
                })
            }
            Self::Polyhedron(p) => {
                let body = p.clip(plane);
                (!body.faces.is_empty()).then_some(Self::Polyhedron(body))
            }
        }
    }

    /// Appends quadrature samples that integrate polynomials up to `degree` (at most 5) exactly.
    pub fn quadrature(&self, degree: usize, out: &mut Vec<Sample<T>>) {
        match self {
            Self::Segment { ends, section } => {
                let length = (ends[1] - ends[0]).norm() * *section;
                for (s, w) in gauss_line(degree) {
                    let point = ends[0] + (ends[1] - ends[0]) * T::of(s);
                    out.push(Sample {
                        point,
                        measure: length * T::of(w),
                    });
                }
            }
            Self::Polyhedron(p) => p.for_each_tetrahedron(|t| tetrahedron_quadrature(&t, degree, out)),
        }
    }

    /// All corners, with repetitions.
    pub fn corners(&self) -> Vec<Point3<T>> {
        match self {
            Self::Segment { ends, .. } => ends.to_vec(),
            Self::Polyhedron(p) => p.faces.iter().flatten().copied().collect(),
        }
    }
}

/// Bounding box of points.
pub fn bounds_of<'a, T: Real>(points: impl Iterator<Item = &'a Point3<T>>) -> [Point3<T>; 2] {
    let big = T::of(f64::from(f32::MAX));
    let mut b = [Point3::new(big, big, big), Point3::new(-big, -big, -big)];
    for p in points {
        b[0] = b[0].inf(p);
        b[1] = b[1].sup(p);
    }
    b
}

/// Gauss-Legendre points and weights on `[0, 1]`, exact to degree 1, 3 or 5.
fn gauss_line(degree: usize) -> Vec<(f64, f64)> {
    if degree <= 1 {
        return vec![(0.5, 1.0)];
    }
    if degree <= 3 {
        let a = 0.5 / 3f64.sqrt();
        return vec![(0.5 - a, 0.5), (0.5 + a, 0.5)];
    }
    let a = 0.5 * 0.6f64.sqrt();
    vec![(0.5 - a, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.5 + a, 5.0 / 18.0)]
}

/// Degree 1 (centroid), 2 (4 points) or 5 (14 points, Walkington 2000), all with positive weights.
fn tetrahedron_quadrature<T: Real>(t: &[Point3<T>; 4], degree: usize, out: &mut Vec<Sample<T>>) {
    let volume = tetrahedron_volume(t).abs();
    if volume <= T::zero() {
        return;
    }
    let mut push = |b: [f64; 4], w: f64| {
        let x = (0..4).fold(Vector3::zeros(), |s, k| s + t[k].coords * T::of(b[k]));
        out.push(Sample {
            point: Point3::from(x),
            measure: volume * T::of(w),
        });
    };
    let mut corners = |a: f64, w: f64| {
        for k in 0..4 {
            let mut b = [a; 4];
            b[k] = 1.0 - 3.0 * a;
            push(b, w);
        }
    };
    match degree {
        0 | 1 => push([0.25; 4], 1.0),
        2 => corners(0.138_196_601_125_010_5, 0.25),
        _ => {
            corners(0.310_885_919_263_300_6, 0.112_687_925_718_015_9);
            corners(0.092_735_250_310_891_23, 0.073_493_043_116_361_96);
            let a = 0.045_503_704_125_649_65;
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let mut b = [0.5 - a; 4];
                b[i] = a;
                b[j] = a;
                push(b, 0.042_546_020_777_081_47);
            }
        }
    }
}

/// Mean of a function over a cell, by quadrature on `8^levels` parts; exact for quintics at any level.
pub fn mean<T: Real>(cell: &Cell<T>, levels: usize, f: &dyn Fn(&Point3<T>) -> T) -> T {
    let mut parts = vec![cell.clone()];
    for _ in 0..levels {
        parts = parts.iter().flat_map(halves).collect();
    }
    let mut samples = Vec::new();
    for p in &parts {
        p.quadrature(5, &mut samples);
    }
    let total: T = samples.iter().map(|s| s.measure).sum();
    samples.iter().map(|s| f(&s.point) * s.measure).sum::<T>() / total
}

/// The cell cut through its centre across its three box directions (8 parts), a segment in two.
fn halves<T: Real>(cell: &Cell<T>) -> Vec<Cell<T>> {
    if let Cell::Segment {
        ends: [a, b],
        section,
    } = cell
    {
        let mid = nalgebra::center(a, b);
        return [[*a, mid], [mid, *b]]
            .map(|ends| Cell::Segment {
                ends,
                section: *section,
            })
            .into();
    }
    let [low, high] = cell.bounds();
    let mid = nalgebra::center(&low, &high);
    let mut parts = vec![cell.clone()];
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let plane = HalfSpace::new(&mid, axis);
        parts = parts
            .iter()
            .flat_map(|c| [c.clip(&plane), c.clip(&plane.flipped())])
            .flatten()
            .collect();
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cube(low: f64, side: f64) -> Polyhedron<f64> {
        let p = |i: f64, j: f64, k: f64| Point3::new(low + i * side, low + j * side, low + k * side);
        let (o, l) = (0.0, 1.0);
        Polyhedron::hexahedron([
            p(o, o, o),
            p(l, o, o),
            p(l, l, o),
            p(o, l, o),
            p(o, o, l),
            p(l, o, l),
            p(l, l, l),
            p(o, l, l),
        ])
    }

    #[test]
    fn cube_intersections_have_the_exact_volume() {
        for shift in [-1.0, -0.4, 0.0, 0.3, 0.999, 1.0, 2.0] {
            let other = Cell::Polyhedron(cube(shift, 1.0));
            let v = Cell::Polyhedron(cube(0.0, 1.0))
                .intersection(&other)
                .map_or(0.0, |c| c.measure());
            let side = f64::max(0.0, 1.0 - f64::abs(shift));
            assert!((v - side.powi(3)).abs() < 1e-14, "{shift}: {v}");
        }
    }

    #[test]
    fn quintic_rule_is_exact_on_a_tetrahedron() {
        let p = Point3::new;
        let t = Cell::Polyhedron(Polyhedron::tetrahedron([
            p(0., 0., 0.),
            p(1., 0., 0.),
            p(0., 1., 0.),
            p(0., 0., 1.),
        ]));
        let fact = |n: u32| (1..=n).map(f64::from).product::<f64>();
        for (degree, max) in [(1, 1), (2, 2), (5, 5)] {
            let mut q: Vec<Sample<f64>> = Vec::new();
            t.quadrature(degree, &mut q);
            for a in 0..=max {
                for b in 0..=max - a {
                    for c in 0..=max - a - b {
                        let s: f64 = q
                            .iter()
                            .map(|s| s.measure * s.point.x.powi(a) * s.point.y.powi(b) * s.point.z.powi(c))
                            .sum();
                        let exact =
                            fact(a as u32) * fact(b as u32) * fact(c as u32) / fact((a + b + c + 3) as u32);
                        assert!((s - exact).abs() < 1e-15, "{a} {b} {c}");
                    }
                }
            }
        }
    }

    #[test]
    fn mean_over_a_segment_with_a_kink() {
        let ends = [Point3::new(-1.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0)];
        let cell = Cell::Segment { ends, section: 2.0 };
        assert!((mean(&cell, 1, &|x: &Point3<f64>| x.x.abs()) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn a_plane_through_a_face_cuts_nothing_or_everything() {
        let plane = HalfSpace {
            normal: Vector3::z(),
            offset: 1.0,
        };
        assert!((cube(0.0, 1.0).clip(&plane).volume() - 1.0).abs() < 1e-15);
        assert_eq!(cube(0.0, 1.0).clip(&plane.flipped()).faces.len(), 0);
    }

    proptest! {
        #[test]
        fn a_cut_conserves_volume(n in prop::array::uniform3(-1.0..1.0f64), d in -1.0..1.0f64) {
            prop_assume!(n.iter().map(|x| x * x).sum::<f64>() > 1e-3);
            let plane = HalfSpace { normal: Vector3::from(n), offset: d };
            let body = cube(-0.5, 1.0);
            let sum = body.clip(&plane).volume() + body.clip(&plane.flipped()).volume();
            prop_assert!((sum - 1.0).abs() < 1e-12);
        }
    }
}

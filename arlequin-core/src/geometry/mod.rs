//! Integration cells: segments with a cross-section and convex polyhedra, their intersections and quadrature.
//!
//! All functions work in the reference configuration, and only at set-up.

mod clip;
mod faces;
mod polyhedron;
mod quadrature;

use crate::Real;
use nalgebra::{Point3, Vector3};
use quadrature::{gauss_line, tetrahedron_quadrature};

pub use crate::tree::BoxTree;
pub(crate) use clip::Body;
pub use faces::Faces;
pub use polyhedron::{HalfSpace, Polyhedron};
pub use quadrature::tetrahedron_volume;

/// A sampling point of an integral: position \[m\] and measure \[m³\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T: Real> {
    /// Position \[m\].
    pub point: Point3<T>,
    /// Measure attached to it \[m³\].
    pub measure: T,
}

/// A part of a domain on which shape functions are smooth.
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

    /// Common part of two cells of one kind; `None` where it is empty or of lower dimension. Two segments
    /// intersect only along a common line.
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
                let coordinate = |p: &Point3<T>| axis.dot(&(p - ends[0]));
                // Ends within √ε lengths of the line count as on it.
                let off = |p: &Point3<T>| {
                    (p - ends[0] - axis * coordinate(p)).norm() > length * T::epsilon().sqrt()
                };
                if e2.iter().any(off) {
                    return None;
                }
                let (a, b) = (
                    coordinate(&e2[0]).min(coordinate(&e2[1])),
                    coordinate(&e2[0]).max(coordinate(&e2[1])),
                );
                let (a, b) = (a.max(T::zero()), b.min(length));
                (b - a > tolerance).then(|| Self::Segment {
                    ends: [ends[0] + axis * a, ends[0] + axis * b],
                    section: section.min(*s2),
                })
            }
            (Self::Polyhedron(p), Self::Polyhedron(q)) => {
                let body = p.intersection(&q.half_spaces());
                let size = p.volume().min(q.volume());
                // A smaller volume is round-off of the clipping.
                (!body.faces.is_empty() && body.volume() > size * T::epsilon() * T::of(16.0))
                    .then_some(Self::Polyhedron(body))
            }
            _ => None,
        }
    }

    /// Part of the cell on the inner side of a plane; `None` if nothing remains.
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
            Self::Polyhedron(p) => {
                // Four samples serve the whole body if they lie inside; otherwise every tetrahedron gets its
                // own.
                if degree > 2 || !p.quadratic_rule(out) {
                    p.for_each_tetrahedron(|t| tetrahedron_quadrature(&t, degree, out));
                }
            }
        }
    }

    /// Appends samples like [`Self::quadrature`], but only half to two thirds as many, from tetrahedra at a
    /// common corner. The rule is not symmetric: use it only for integrands that it integrates exactly, or
    /// nearly.
    pub fn lean_quadrature(&self, degree: usize, out: &mut Vec<Sample<T>>) {
        match self {
            Self::Polyhedron(p) if degree > 2 => {
                p.for_each_tetrahedron_from_a_corner(|t| tetrahedron_quadrature(&t, degree, out));
            }
            _ => self.quadrature(degree, out),
        }
    }

    /// Bounding half-spaces of a polyhedron; empty for a segment.
    pub(crate) fn half_spaces(&self) -> Vec<HalfSpace<T>> {
        match self {
            Self::Segment { .. } => Vec::new(),
            Self::Polyhedron(p) => p.half_spaces(),
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

/// Bounding box of a cell, smaller by a millionth: it does not meet the boxes of cells beside it.
pub fn inner_bounds<T: Real>(cell: &Cell<T>) -> [Point3<T>; 2] {
    let [low, high] = cell.bounds();
    let margin = (high - low) * T::of(1e-6);
    [low + margin, high - margin]
}

/// Bounding box of points.
pub fn bounds_of<'a, T: Real>(points: impl Iterator<Item = &'a Point3<T>>) -> [Point3<T>; 2] {
    // Finite in both precisions.
    let big = T::of(f64::from(f32::MAX));
    let mut b = [Point3::new(big, big, big), Point3::new(-big, -big, -big)];
    for p in points {
        b[0] = b[0].inf(p);
        b[1] = b[1].sup(p);
    }
    b
}

/// Point of a triangle that is closest to `p`; the triangle may be a line or a point (Ericson, Real-Time
/// Collision Detection, 5.1.5).
pub fn closest_on_triangle(p: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> Vector3<f64> {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    // Beyond corner `a`.
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    // Beyond corner `b`.
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    // Beyond edge `ab`.
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    // Beyond corner `c`.
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    // Beyond edge `ac`.
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    // Beyond edge `bc`.
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    // Barycentric coordinates: only here is the denominator certain not to vanish.
    // Within the triangle.
    let denom = 1.0 / (va + vb + vc);
    a + ab * (vb * denom) + ac * (vc * denom)
}

/// Mean of a function over a cell, by quadrature on `8^levels` parts; exact for quintics at any level.
pub fn mean<T: Real>(cell: &Cell<T>, levels: usize, f: &dyn Fn(&Point3<T>) -> T) -> T {
    let mut samples = Vec::new();
    for p in &parts(cell, levels) {
        p.quadrature(5, &mut samples);
    }
    // Over the sum of the samples, not the measure: a constant keeps its value to the last digit.
    let total: T = samples.iter().map(|s| s.measure).sum();
    samples.iter().map(|s| f(&s.point) * s.measure).sum::<T>() / total
}

/// Cuts a cell into up to `8^levels` parts, a segment into `2^levels`.
pub(crate) fn parts<T: Real>(cell: &Cell<T>, levels: usize) -> Vec<Cell<T>> {
    let mut parts = vec![cell.clone()];
    for _ in 0..levels {
        parts = parts.iter().flat_map(cut_at_centre).collect();
    }
    parts
}

/// Cuts a cell through the centre of its box across the three axes into up to 8 parts, a segment into two.
fn cut_at_centre<T: Real>(cell: &Cell<T>) -> Vec<Cell<T>> {
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
    // Axis by axis: each of the three cuts halves all parts made so far.
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
mod tests;

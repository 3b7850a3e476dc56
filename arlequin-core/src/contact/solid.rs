//! A rigid body bounded by triangles.

use super::facet::thickness;
use crate::Result;
use crate::error::invalid;
use crate::geometry::{Faces, closest_on_triangle};
use nalgebra::{Point3, Vector3};
use std::sync::OnceLock;

/// Relative difference below which triangles count as equally near: an edge belongs to two of them.
const TIE: f64 = 1e-9;
/// Largest number of triangles at which the depth of a body is measured.
const SAMPLES: usize = 1024;
/// Number of chords from each of these triangles: three lead to the middle of a box.
const CHORDS: usize = 6;
/// Faces at both ends of a chord are parallel if the cosine of the angle between them is larger.
const PARALLEL: f64 = 0.985;
/// Part of the surface that a thin part must have to count: chips of a triangulation do not.
const LEAST_AREA: f64 = 0.01;

/// A rigid body bounded by a closed surface of triangles, in its initial position.
#[derive(Debug, Clone)]
pub struct Solid {
    faces: Faces,
    /// Outward unit normals; zero for triangles without area.
    normals: Vec<Vector3<f64>>,
    depth: OnceLock<f64>,
}

impl Solid {
    /// A body from the triangles of its surface \[m\], with corners counter-clockwise from outside.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for coordinates that are not finite, and for a surface that is open
    /// (the sum of its area vectors is not zero) or encloses no volume.
    pub fn new(triangles: Vec<[Point3<f64>; 3]>) -> Result<Self> {
        let finite = triangles
            .iter()
            .flatten()
            .all(|x| x.iter().all(|c| c.is_finite()));
        let area = |[a, b, c]: &[Point3<f64>; 3]| (b - a).cross(&(c - a)) * 0.5;
        let whole: f64 = triangles.iter().map(|t| area(t).norm()).sum();
        let sum: Vector3<f64> = triangles.iter().map(area).sum();
        if !finite || triangles.is_empty() || sum.norm() > 1e-6 * whole {
            let rule = "must be finite and closed: repair the surface so that every edge joins two triangles";
            return Err(invalid("triangles of a rigid body", triangles.len(), rule));
        }
        let volume: f64 = triangles.iter().map(|t| area(t).dot(&t[0].coords) / 3.0).sum();
        if volume <= 0.0 {
            let rule = "must be positive: the triangles must face outwards";
            return Err(invalid("volume of a rigid body", volume, rule));
        }
        Ok(Self {
            normals: triangles
                .iter()
                .map(|t| area(t).try_normalize(0.0).unwrap_or_default())
                .collect(),
            faces: Faces::new(triangles),
            depth: OnceLock::new(),
        })
    }

    /// Corners of the triangles \[m\].
    #[must_use]
    pub fn triangles(&self) -> &[[Point3<f64>; 3]] {
        self.faces.triangles()
    }

    /// Lowest and highest corner \[m\].
    #[must_use]
    pub fn bounds(&self) -> [Point3<f64>; 2] {
        self.faces.bounds()
    }

    /// Depth to which the body holds points \[m\], measured when it is first asked for: half of the thickness
    /// of its thinnest part that has two parallel faces, or the depth of its deepest point.
    #[must_use]
    pub fn depth(&self) -> f64 {
        *self.depth.get_or_init(|| self.measure_depth())
    }

    /// Measures the depth by chords at right angles to the surface, from the centres of some triangles; each
    /// chord begins where the surface is nearest to the middle of the one before it.
    fn measure_depth(&self) -> f64 {
        let mut whole = 0.0;
        // Half of the thickness at triangles of parts with parallel faces, and their areas.
        let mut parts: Vec<[f64; 2]> = Vec::new();
        let mut deepest = 0.0_f64;
        for k in (0..self.normals.len()).step_by(self.normals.len().div_ceil(SAMPLES)) {
            let [a, b, c] = self.triangles()[k];
            let area = (b - a).cross(&(c - a)).norm();
            whole += area;
            let mut foot = (a.coords + b.coords + c.coords) / 3.0;
            let mut normal = self.normals[k];
            let mut last = [0.0; 2];
            for _ in 0..CHORDS {
                let Some(chord) = self.chord(&mut foot, &mut normal) else {
                    break;
                };
                last = chord;
                deepest = deepest.max(last[1]);
            }
            let [half, depth] = last;
            // A middle is as far from both ends only if the faces there are parallel and no other is nearer.
            if depth > PARALLEL * half {
                parts.push([depth, area]);
            }
        }
        parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut area = 0.0;
        let thinnest = parts.iter().find(|part| {
            area += part[1];
            area > LEAST_AREA * whole
        });
        thinnest.map_or(deepest, |part| part[0])
    }

    /// Returns half of the length and the depth of the middle of the chord that begins at a point of the
    /// surface \[m\], and moves the point and the normal there to the place that is nearest to the middle.
    fn chord(&self, foot: &mut Vector3<f64>, normal: &mut Vector3<f64>) -> Option<[f64; 2]> {
        let [low, high] = self.bounds();
        let half = 0.5 * thickness(&self.faces, foot, normal, (high - low).norm());
        if !half.is_finite() {
            return None;
        }
        let middle = *foot - *normal * half;
        let (distance, outwards) = self.distance(&Point3::from(middle));
        (*foot, *normal) = (middle - outwards * distance, outwards);
        Some([half, -distance])
    }

    /// Distance of a point from the surface \[m\], negative inside, and the outward normal there.
    #[must_use]
    pub fn distance(&self, x: &Point3<f64>) -> (f64, Vector3<f64>) {
        let nearest = self.faces.nearest(x).1;
        let reach = Vector3::repeat(nearest * (1.0 + TIE) + f64::MIN_POSITIVE);
        let (mut steepest, mut best) = (-1.0, (nearest, Vector3::x()));
        // On a shared edge or corner, the triangle that is seen most frontally tells the side.
        self.faces.each_near(&[x - reach, x + reach], &mut |k| {
            let normal = self.normals[k];
            let foot = closest_on_triangle(&x.coords, &self.faces.triangles()[k].map(|p| p.coords));
            let away = x.coords - foot;
            let d = away.norm();
            if d > nearest * (1.0 + TIE) || normal == Vector3::zeros() {
                return;
            }
            let height = if d > 0.0 { away.dot(&normal) / d } else { 1.0 };
            if height.abs() > steepest {
                steepest = height.abs();
                let side = height.signum();
                let direction = if d > 0.0 { away * (side / d) } else { normal };
                best = (side * d, direction);
            }
        });
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cube [0, 1]³.
    fn cube() -> Vec<[Point3<f64>; 3]> {
        let mut out = Vec::new();
        for c in 0..3 {
            for (end, side) in [(0, 0.0), (1, 1.0)] {
                let corner = |u: f64, v: f64| {
                    let mut x = Point3::origin();
                    (x[c], x[(c + 1) % 3], x[(c + 2) % 3]) = (side, u, v);
                    x
                };
                let [p, q, r, s] = [
                    corner(0.0, 0.0),
                    corner(1.0, 0.0),
                    corner(1.0, 1.0),
                    corner(0.0, 1.0),
                ];
                let turned = |t: [Point3<f64>; 3]| if end == 1 { t } else { [t[0], t[2], t[1]] };
                out.extend([turned([p, q, r]), turned([p, r, s])]);
            }
        }
        out
    }

    #[test]
    fn distances_from_a_cube_have_the_sign_of_the_side_also_beyond_edges_and_corners() {
        let solid = Solid::new(cube()).unwrap();
        for k in 0..500_u32 {
            let t = f64::from(k);
            let x = Point3::new(
                0.5 + 0.9 * (0.37 * t).sin(),
                0.5 + 0.9 * (0.91 * t).cos(),
                0.5 + 0.9 * (1.7 * t).sin(),
            );
            let beyond = (x - Point3::new(0.5, 0.5, 0.5)).abs() - Vector3::repeat(0.5);
            let expected = beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0);
            let (d, n) = solid.distance(&x);
            assert!((d - expected).abs() < 1e-12, "{x}: {d} and {expected}");
            assert!((n.norm() - 1.0).abs() < 1e-12);
            // The normal leads back to the surface.
            assert!(solid.distance(&(x - n * d)).0.abs() < 1e-12);
        }
    }

    /// The depth of a plate is half of its thickness, however the plate is turned, also where it stands on a
    /// thick block: points must not pass through its thinnest part.
    #[test]
    fn the_depth_is_half_of_the_thickness_of_the_thinnest_part() {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.8, 0.5));
        let part = |size: [f64; 3], from: [f64; 3]| {
            let place = |x: Point3<f64>| {
                turn * Point3::from(x.coords.component_mul(&Vector3::from(size)) + Vector3::from(from))
            };
            cube().iter().map(|t| t.map(place)).collect::<Vec<_>>()
        };
        for size in [[3.0, 2.0, 0.1], [0.1, 3.0, 2.0], [1.0, 1.0, 1.0]] {
            let half = 0.5 * size.iter().copied().fold(f64::INFINITY, f64::min);
            let alone = Solid::new(part(size, [0.0; 3])).unwrap().depth();
            assert!((alone - half).abs() < 1e-12, "{size:?}: {alone}");
            let beside = [part(size, [0.0; 3]), part([4.0; 3], [5.0; 3])].concat();
            let beside = Solid::new(beside).unwrap().depth();
            assert!((beside - half).abs() < 1e-12, "{size:?} beside a block: {beside}");
        }
        // A pyramid has no parallel faces: its depth is that of the deepest point, nearly the ball inside.
        let corner = |k: usize| {
            Point3::new(
                [0.0, 1.0, 0.0, 0.0][k],
                [0.0, 0.0, 1.0, 0.0][k],
                [0.0, 0.0, 0.0, 1.0][k],
            )
        };
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|f| f.map(corner));
        let depth = Solid::new(faces.to_vec()).unwrap().depth();
        let ball = 1.0 / (3.0 + 3.0_f64.sqrt());
        assert!(depth > 0.75 * ball && depth < ball, "{depth} and {ball}");
    }

    #[test]
    fn open_and_inverted_surfaces_are_refused() {
        let open = cube()[1..].to_vec();
        assert!(Solid::new(open).unwrap_err().to_string().contains("closed"));
        let inverted = cube().iter().map(|t| [t[0], t[2], t[1]]).collect();
        assert!(
            Solid::new(inverted)
                .unwrap_err()
                .to_string()
                .contains("face outwards")
        );
    }
}

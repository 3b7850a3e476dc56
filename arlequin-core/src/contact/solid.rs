//! A rigid body bounded by triangles.

use super::facet::thickness;
use crate::Result;
use crate::error::invalid;
use crate::geometry::{Faces, closest_on_triangle};
use nalgebra::{Point3, Vector3};
use std::sync::OnceLock;

/// Relative difference below which triangles count as equally near: an edge belongs to two of them.
const TIE: f64 = 1e-9;
/// Number of triangles from which the depth of a body is measured, and of chords from each: three lead to the
/// middle of a box.
const SAMPLES: usize = 256;
const CHORDS: usize = 6;

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

    /// Depth of the deepest point \[m\], measured when it is first asked for.
    #[must_use]
    pub fn depth(&self) -> f64 {
        *self.depth.get_or_init(|| self.measure_depth())
    }

    /// Returns the largest depth of the middles of chords through the body, at right angles to its surface.
    /// The first begin at the centres of some triangles, and each leads to the next, at the place of the
    /// surface that is nearest to its middle. For a plate the depth is half of its thickness, also if the
    /// plate is turned, unlike that of the box around it.
    fn measure_depth(&self) -> f64 {
        let [low, high] = self.bounds();
        let reach = (high - low).norm();
        let mut deepest = 0.0_f64;
        for k in (0..self.normals.len()).step_by(self.normals.len().div_ceil(SAMPLES)) {
            let [a, b, c] = self.triangles()[k];
            let mut foot = (a.coords + b.coords + c.coords) / 3.0;
            let mut normal = self.normals[k];
            for _ in 0..CHORDS {
                let chord = thickness(&self.faces, &foot, &normal, reach);
                let middle = Point3::from(foot - normal * (0.5 * chord));
                if !chord.is_finite() {
                    break;
                }
                let (distance, outwards) = self.distance(&middle);
                deepest = deepest.max(-distance);
                normal = outwards;
                foot = middle.coords - outwards * distance;
            }
        }
        deepest
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

    /// The depth of a plate is half of its thickness, however the plate is turned.
    #[test]
    fn the_depth_of_a_plate_is_half_of_its_thickness() {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.8, 0.5));
        for size in [[3.0, 2.0, 0.1], [0.1, 3.0, 2.0], [1.0, 1.0, 1.0]] {
            let place = |x: Point3<f64>| turn * Point3::from(x.coords.component_mul(&Vector3::from(size)));
            let plate = Solid::new(cube().iter().map(|t| t.map(place)).collect()).unwrap();
            let half = 0.5 * size.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(
                (plate.depth() - half).abs() < 1e-12,
                "{size:?}: {}",
                plate.depth()
            );
        }
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

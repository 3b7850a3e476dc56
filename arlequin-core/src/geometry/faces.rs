//! Distances from triangles.

use super::{bounds_of, closest_on_triangle};
use crate::tree::BoxTree;
use nalgebra::{Point3, Vector3};

/// Triangles with a search tree for the nearest one; degenerate triangles (lines and points) are allowed.
#[derive(Debug, Clone)]
pub struct Faces {
    triangles: Vec<[Point3<f64>; 3]>,
    tree: BoxTree<f64>,
    bounds: [Point3<f64>; 2],
}

impl Faces {
    /// Builds the tree of some triangles.
    #[must_use]
    pub fn new(triangles: Vec<[Point3<f64>; 3]>) -> Self {
        let boxes: Vec<_> = triangles.iter().map(|t| bounds_of(t.iter())).collect();
        Self {
            bounds: bounds_of(boxes.iter().flatten()),
            tree: BoxTree::new(boxes),
            triangles,
        }
    }

    /// Returns whether there is no triangle.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Corners of the triangles \[m\].
    #[must_use]
    pub fn triangles(&self) -> &[[Point3<f64>; 3]] {
        &self.triangles
    }

    /// Lowest and highest corner \[m\].
    #[must_use]
    pub fn bounds(&self) -> [Point3<f64>; 2] {
        self.bounds
    }

    /// Number of the nearest triangle and its distance \[m\]; the lowest number among equal ones. There must
    /// be at least one triangle.
    #[must_use]
    pub fn nearest(&self, x: &Point3<f64>) -> (usize, f64) {
        let [low, high] = &self.bounds;
        // No triangle is closer than the bounding box; a search radius a little larger finds one soon.
        let distance_to_box = (low - x).sup(&(x - high)).sup(&Vector3::zeros()).norm();
        let mut reach = distance_to_box + 0.02 * (high - low).norm() + f64::MIN_POSITIVE;
        let mut best = (usize::MAX, f64::INFINITY);
        loop {
            let half_size = Vector3::repeat(reach);
            self.tree.any(&[x - half_size, x + half_size], &mut |k| {
                let d = distance(x, &self.triangles[k]);
                if d < best.1 || (d <= best.1 && k < best.0) {
                    best = (k, d);
                }
                false
            });
            if best.1 <= reach || !reach.is_finite() {
                return best;
            }
            // A triangle outside of the search box may be closer: search again within the distance found, or
            // twice as far if none was found.
            reach = if best.1.is_finite() { best.1 } else { 2.0 * reach };
        }
    }

    /// Calls `visit` with the number of every triangle that may meet a box.
    pub fn each_near(&self, ends: &[Point3<f64>; 2], visit: &mut dyn FnMut(usize)) {
        self.tree.any(ends, &mut |k| {
            visit(k);
            false
        });
    }

    /// Returns whether a test holds for any triangle that may meet a box.
    #[must_use]
    pub fn any_near(&self, ends: &[Point3<f64>; 2], test: &dyn Fn(&[Point3<f64>; 3]) -> bool) -> bool {
        self.tree.any(ends, &mut |k| test(&self.triangles[k]))
    }

    /// Closest point of all triangles; `None` without triangles.
    #[must_use]
    pub fn foot(&self, x: &Point3<f64>) -> Option<Point3<f64>> {
        self.triangles.first()?;
        let nearest = self.triangles.get(self.nearest(x).0)?;
        Some(closest_on_triangle(&x.coords, &nearest.map(|p| p.coords)).into())
    }

    /// Distance of the nearest triangle \[m\].
    #[must_use]
    pub fn distance(&self, x: &Point3<f64>) -> f64 {
        self.nearest(x).1
    }
}

/// Distance from a point to a triangle \[m\].
fn distance(x: &Point3<f64>, triangle: &[Point3<f64>; 3]) -> f64 {
    (closest_on_triangle(&x.coords, &triangle.map(|p| p.coords)) - x.coords).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_triangle_is_found_from_anywhere() {
        let p = Point3::new;
        let strip: Vec<[Point3<f64>; 3]> = (0..40)
            .map(|k| {
                let x = f64::from(k);
                [p(x, 0.0, 0.0), p(x + 1.0, 0.0, 0.0), p(x, 1.0, 0.0)]
            })
            .collect();
        let faces = Faces::new(strip.clone());
        for k in 0..200 {
            let t = f64::from(k);
            let x = p(
                60.0 * (0.37 * t).sin(),
                9.0 * (0.91 * t).cos(),
                5.0 * (1.7 * t).sin(),
            );
            let distances = strip.iter().map(|t| distance(&x, t));
            let least = distances.fold(f64::INFINITY, f64::min);
            assert!((faces.distance(&x) - least).abs() <= 1e-12 * least);
            let foot = faces.foot(&x).expect("a triangle");
            assert!(((foot - x).norm() - least).abs() <= 1e-12 * least);
        }
        // Points and lines are degenerate triangles.
        let point = Faces::new(vec![[p(1.0, 2.0, 3.0); 3]]);
        assert!((point.distance(&p(1.0, 2.0, 7.0)) - 4.0).abs() < 1e-14);
        let line = Faces::new(vec![[p(0.0, 0.0, 0.0), p(2.0, 0.0, 0.0), p(2.0, 0.0, 0.0)]]);
        assert!((line.distance(&p(1.0, 3.0, 0.0)) - 3.0).abs() < 1e-14);
    }
}

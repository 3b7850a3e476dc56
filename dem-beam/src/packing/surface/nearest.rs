//! Queries of a surface: nearest point, walls that push a sphere, inside test.

use super::Surface;
use super::grid::Near;
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::Vector3;

/// Largest number of walls that push a sphere at once.
const WALLS: usize = 4;
/// Two walls count as one if the cosine between their normals is above this value.
const SAME_WALL: f64 = 0.97;
/// Largest number of triangles whose planes are compared before the nearest point is searched for.
const FEW: usize = 8;

/// Nearest point of a surface, seen from a query point.
pub(super) struct Foot {
    /// Distance from the query point \[m\].
    pub(super) distance: f64,
    /// 1 if the query point lies inside, -1 outside.
    pub(super) sign: f64,
    point: Vector3<f64>,
    /// Outward normal of the face.
    normal: Vector3<f64>,
}

impl Surface {
    /// Returns the signed distance \[m\] (positive inside) and the inward normal of the nearest surface
    /// point, if it is within `reach` (at most the reach prepared for).
    #[must_use]
    pub fn nearest(&self, x: &Vector3<f64>, reach: f64) -> Option<(f64, Vector3<f64>)> {
        self.nearest_among(x, reach, &self.grid.near(x))
    }

    /// Does what [`Self::nearest`] does, among given triangles.
    #[inline]
    pub(super) fn nearest_among(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        near: &Near<'_>,
    ) -> Option<(f64, Vector3<f64>)> {
        if self.is_below_all(x, reach, near) {
            return None;
        }
        let foot = self.foot(x, near)?;
        if foot.distance > reach.min(self.grid.reach) && foot.sign >= 0.0 {
            return None;
        }
        let normal = if foot.distance > 1e-12 * self.grid.size {
            (x - foot.point) * (foot.sign / foot.distance)
        } else {
            -foot.normal
        };
        Some((foot.sign * foot.distance, normal))
    }

    /// Returns whether `x` lies farther than `reach` inside of the planes of given triangles, if these are
    /// few: it then lies inside and farther from all of them, which spares the search for the nearest point.
    #[inline]
    fn is_below_all(&self, x: &Vector3<f64>, reach: f64, near: &Near<'_>) -> bool {
        // Rounded up: the distance decides where both agree up to round-off.
        let clear = reach.min(self.grid.reach) * (1.0 + 1e-6);
        let mut triangles = near.triangles.iter();
        near.triangles.len() <= FEW && triangles.all(|&(_, t)| self.height(x, t) > clear)
    }

    /// Returns the nearest point on given triangles; `None` without triangles.
    #[inline]
    pub(super) fn foot(&self, x: &Vector3<f64>, near: &Near<'_>) -> Option<Foot> {
        let bound = self.bound(x, near);
        let (mut best, mut steep, mut out) = (f64::INFINITY, 0.0, None);
        for &(distance, t) in near.triangles {
            if distance - near.off > bound {
                break;
            }
            if self.is_beyond(x, t, bound) {
                continue;
            }
            let point = self.closest(x, t);
            let d = (point - x).norm();
            // A triangle without area lies in the edges of its neighbours and has no normal.
            let normal = self.normals[t as usize];
            if normal == Vector3::zeros() {
                continue;
            }
            // On a shared edge or corner several faces are equally near. The one seen most frontally tells
            // the side.
            let front = if d > 0.0 {
                (point - x).dot(&normal) / d
            } else {
                1.0
            };
            // Distances to a common edge differ by round-off from face to face.
            let tie = d <= best * (1.0 + 1e-9);
            if d < best * (1.0 - 1e-9) || (tie && front.abs() > steep) {
                (best, steep) = (d.min(best), front.abs());
                out = Some(Foot {
                    distance: best,
                    sign: front.signum(),
                    point,
                    normal,
                });
            }
        }
        out
    }

    /// Returns an upper bound of the distance from `x` to the nearest of given triangles \[m\]: the distance
    /// to the nearest centroid, and a little more, because equally near triangles must be compared.
    #[inline]
    fn bound(&self, x: &Vector3<f64>, near: &Near<'_>) -> f64 {
        let (mut least, mut bound) = (f64::INFINITY, f64::INFINITY);
        for &(distance, t) in near.triangles {
            if distance - near.off > bound {
                break;
            }
            let [a, b, c, _] = self.balls[t as usize];
            let squared = (x - Vector3::new(a, b, c)).norm_squared();
            if squared < least && self.normals[t as usize] != Vector3::zeros() {
                least = squared;
                // Rounded up: round-off must not exclude the nearest triangle.
                bound = squared.sqrt() * (1.0 + 1e-6);
            }
        }
        bound
    }

    /// Returns whether the bounding ball of triangle `t` is farther than `reach` from `x`.
    #[inline]
    pub(super) fn is_beyond(&self, x: &Vector3<f64>, t: u32, reach: f64) -> bool {
        let [a, b, c, radius] = self.balls[t as usize];
        let clear = reach + radius;
        (x - Vector3::new(a, b, c)).norm_squared() > clear * clear
    }

    #[inline]
    pub(super) fn closest(&self, x: &Vector3<f64>, t: u32) -> Vector3<f64> {
        closest_on_triangle(x, &self.corners(&self.triangles[t as usize]))
    }

    /// Returns the height of `x` above the plane of triangle `t`, positive on its inner side \[m\].
    #[inline]
    pub(super) fn height(&self, x: &Vector3<f64>, t: u32) -> f64 {
        let corner = self.vertices[self.triangles[t as usize][0] as usize];
        (x - corner).dot(&(Vector3::zeros() - self.normals[t as usize]))
    }

    /// Calls `wall(gap, inward normal)` for the nearest point, if it is nearer than `reach`. It also calls it
    /// for faces of other directions above which `x` lies within `reach`: in an edge both walls must push, or
    /// a sphere there never comes to rest.
    #[inline]
    pub(crate) fn walls(&self, x: &Vector3<f64>, reach: f64, wall: impl FnMut(f64, Vector3<f64>)) {
        self.walls_among(x, reach, &self.grid.near(x), wall);
    }

    /// Does what [`Self::walls`] does, among given triangles.
    #[inline]
    pub(super) fn walls_among(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        near: &Near<'_>,
        mut wall: impl FnMut(f64, Vector3<f64>),
    ) {
        let Some((gap, n)) = self.nearest_among(x, reach, near) else {
            return;
        };
        wall(gap, n);
        if gap <= 0.0 || gap >= reach {
            return;
        }
        let (mut seen, mut count) = ([n; WALLS], 1);
        for &(distance, t) in near.triangles {
            if distance - near.off > reach || count == WALLS {
                break;
            }
            if self.is_beyond(x, t, reach) {
                continue;
            }
            let inwards = Vector3::zeros() - self.normals[t as usize];
            let height = self.height(x, t);
            let is_seen = |s: &Vector3<f64>| s.dot(&inwards) > SAME_WALL;
            // A triangle without area has the height zero.
            if height <= 0.0 || height >= reach || seen[..count].iter().any(is_seen) {
                continue;
            }
            if (self.closest(x, t) - x).norm() <= height * (1.0 + 1e-9) {
                wall(height, inwards);
                seen[count] = inwards;
                count += 1;
            }
        }
    }

    /// Returns whether `x` is inside.
    #[must_use]
    pub fn contains(&self, x: &Vector3<f64>) -> bool {
        let (low, high) = self.bounds;
        if (0..3).any(|a| x[a] < low[a] || x[a] > high[a]) {
            return false;
        }
        let near = self.grid.near(x);
        if near.triangles.is_empty() {
            return self.grid.inside[near.cell];
        }
        // The sign of the nearest face is cheaper than the winding number over all triangles.
        let reach = self.grid.reach;
        let is_inner = |gap: Option<(f64, _)>| gap.is_none_or(|g| g.0 >= 0.0);
        match self.nearest_among(x, reach, &near) {
            Some((gap, _)) => gap >= 0.0,
            // No face is within the reach of `x`, which is longer than half a diagonal of the cell, so that
            // the middle of the cell lies on the same side. The triangles of a cell include the one nearest
            // to its middle.
            None => is_inner(self.nearest(&near.middle, reach)),
        }
    }
}

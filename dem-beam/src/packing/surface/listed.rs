//! Lists of the few triangles that matter to a sphere while it moves a little.
//!
//! Queries with a list give the same bits as without. Where a list does not hold, because the point has left
//! the cell in which the list was made, the query takes all triangles of its cell.

use super::Surface;
use super::grid::Near;
use nalgebra::Vector3;

/// Relative margin for round-off.
const ROUND_OFF: f64 = 1e-6;

/// Triangles in a list; they hold in one cell of the grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listed {
    cell: usize,
    first: usize,
    end: usize,
}

/// Walls near a sphere.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Listing {
    /// No wall reaches the sphere before it has moved by this distance \[m\].
    Free(f64),
    /// Only these triangles can matter as long as the sphere moves no farther than was asked.
    Near(Listed),
}

/// A sphere for which triangles are listed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mover {
    /// Centre when the list is made \[m\].
    pub(crate) centre: Vector3<f64>,
    /// Radius \[m\].
    pub(crate) radius: f64,
    /// Distance that the sphere may move before the next list is made \[m\].
    pub(crate) travel: f64,
}

impl Surface {
    /// Lists the triangles for [`Self::walls`] of a moving sphere, with its radius as the reach.
    pub(crate) fn list_walls(&self, mover: &Mover, list: &mut Vec<(f64, u32)>) -> Listing {
        let &Mover {
            ref centre,
            radius,
            travel,
        } = mover;
        let near = self.grid.near(centre);
        let foot = self.foot(centre, &near);
        let distance = foot.as_ref().map_or(f64::INFINITY, |f| f.distance);
        let is_inside = match foot {
            Some(f) => f.sign >= 0.0,
            None => self.grid.inside[near.cell],
        };
        if is_inside || near.triangles.is_empty() {
            // Triangles beyond the reach of the grid may be missing in this cell, but not in others.
            let known = if is_inside {
                distance.min(self.grid.reach)
            } else {
                0.0
            };
            let free = (known - radius).max((distance - radius).min(room(&near, centre, self.grid.size)));
            if let Some(free) = longer(free, travel) {
                return Listing::Free(free);
            }
            if distance > (radius + travel) * (1.0 + ROUND_OFF) {
                return Listing::Near(no_triangle(&near, list));
            }
        }
        // A sphere that cannot leave the surface meets only walls that it touches; outside, the nearest one
        // pushes it from any distance.
        let touching = radius + travel;
        let limit = match is_inside && distance > travel {
            true => touching,
            false => touching.max(distance + 2.0 * travel),
        };
        Listing::Near(self.list(centre, limit, &near, list))
    }

    /// Lists the triangles for [`Self::nearest`] of a moving sphere, if only points on the outer side of the
    /// surface count that are farther from it than `margin` less the radius \[m\].
    pub(crate) fn list_margin(&self, mover: &Mover, margin: f64, list: &mut Vec<(f64, u32)>) -> Listing {
        let &Mover {
            ref centre,
            radius,
            travel,
        } = mover;
        let near = self.grid.near(centre);
        let room = room(&near, centre, self.grid.size);
        let Some(foot) = self.foot(centre, &near) else {
            return longer(room, travel)
                .map_or_else(|| Listing::Near(no_triangle(&near, list)), Listing::Free);
        };
        if let Some(free) = longer(margin - radius - foot.distance, travel) {
            return Listing::Free(free);
        }
        if foot.sign >= 0.0 {
            // More than it may travel, so that the next lists can be left out.
            let path = travel + 0.5 * radius;
            let all = self.list(centre, foot.distance + 2.0 * path, &near, list);
            let is_above = |&(_, t): &(f64, u32)| self.height(centre, t) > path * (1.0 + ROUND_OFF);
            let stays_inside = list[all.first..].iter().all(is_above);
            list.truncate(all.first);
            if stays_inside {
                // Only then do other cells have the same triangles.
                let is_known = (foot.distance + 2.0 * path) * (1.0 + ROUND_OFF) < self.grid.reach;
                return match longer(if is_known { path } else { path.min(room) }, travel) {
                    Some(free) => Listing::Free(free),
                    None => Listing::Near(no_triangle(&near, list)),
                };
            }
        }
        Listing::Near(self.list(centre, foot.distance + 2.0 * travel, &near, list))
    }

    /// Appends the triangles up to `limit` from `x` to the list, in the order of the cell.
    fn list(&self, x: &Vector3<f64>, limit: f64, near: &Near<'_>, list: &mut Vec<(f64, u32)>) -> Listed {
        let limit = limit * (1.0 + ROUND_OFF);
        let start = no_triangle(near, list);
        for &(distance, t) in near.triangles {
            if distance - near.off > limit {
                break;
            }
            if !self.is_beyond(x, t, limit) && (self.closest(x, t) - x).norm() <= limit {
                list.push((distance, t));
            }
        }
        Listed {
            end: list.len(),
            ..start
        }
    }

    /// Does what [`Self::walls`] does, with listed triangles.
    #[inline]
    pub(crate) fn walls_listed(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        (listed, list): (&Listed, &[(f64, u32)]),
        wall: impl FnMut(f64, Vector3<f64>),
    ) {
        self.walls_among(x, reach, &self.near_listed(x, listed, list), wall);
    }

    /// Does what [`Self::nearest`] does, with listed triangles.
    #[inline]
    pub(crate) fn nearest_listed(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        (listed, list): (&Listed, &[(f64, u32)]),
    ) -> Option<(f64, Vector3<f64>)> {
        self.nearest_among(x, reach, &self.near_listed(x, listed, list))
    }

    #[inline]
    fn near_listed<'a>(&'a self, x: &Vector3<f64>, listed: &Listed, list: &'a [(f64, u32)]) -> Near<'a> {
        let near = self.grid.near(x);
        if near.cell != listed.cell {
            return near;
        }
        Near {
            triangles: &list[listed.first..listed.end],
            ..near
        }
    }
}

/// Returns the distance, less a margin for round-off, if it is longer than `travel`.
fn longer(distance: f64, travel: f64) -> Option<f64> {
    let distance = distance * (1.0 - ROUND_OFF);
    (distance > travel).then_some(distance)
}

/// Returns the distance of a point to the border of its cell \[m\].
fn room(near: &Near<'_>, x: &Vector3<f64>, size: f64) -> f64 {
    0.5 * size * (1.0 - ROUND_OFF) - (x - near.middle).amax()
}

fn no_triangle(near: &Near<'_>, list: &[(f64, u32)]) -> Listed {
    Listed {
        cell: near.cell,
        first: list.len(),
        end: list.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn octahedron() -> Result<Surface> {
        let corners = [0, 1, 2].map(|a| Vector3::ith(a, 1.0));
        let corners = corners.iter().flat_map(|c| [*c, -c]).collect();
        let face = |k: u32| [k & 1, 2 + (k >> 1 & 1), 4 + (k >> 2)];
        let mut out = Surface::oriented(corners, (0..8).map(face).collect())?;
        out.prepare(0.3);
        Ok(out)
    }

    /// A mover, and a place that it may reach before the next list.
    fn mover(rng: &mut Pcg64) -> (Mover, Vector3<f64>) {
        let mut vector = || Vector3::from_fn(|_, _| 2.0 * rng.random::<f64>() - 1.0);
        let (centre, step) = (vector(), vector());
        let travel = 0.06 * rng.random::<f64>();
        let mover = Mover {
            centre,
            radius: 0.15,
            travel,
        };
        (mover, centre + 0.57 * travel * step)
    }

    #[test]
    fn listed_walls_are_those_of_the_full_search() {
        let surface = octahedron().expect("octahedron");
        let mut rng = Pcg64::seed_from_u64(1);
        let (mut free, mut near) = (0, 0);
        for _ in 0..20_000 {
            let (mover, x) = mover(&mut rng);
            let (mut list, mut expected, mut walls) = (Vec::new(), Vec::new(), Vec::new());
            surface.walls(&x, mover.radius, |gap, n| expected.push((gap, n)));
            match surface.list_walls(&mover, &mut list) {
                Listing::Free(_) => free += 1,
                Listing::Near(listed) => {
                    near += usize::from(!expected.is_empty());
                    surface.walls_listed(&x, mover.radius, (&listed, &list), |gap, n| walls.push((gap, n)));
                }
            }
            assert_eq!(walls, expected, "{mover:?}, {x}");
        }
        assert!(free > 2_000 && near > 2_000, "{free} {near}");
    }

    #[test]
    fn a_listed_border_pushes_back_like_the_full_search() {
        let corners: Vec<_> = octahedron().expect("octahedron").vertices().to_vec();
        let face = |k: usize| [corners[0], corners[2 + k], corners[4]];
        let (margin, radius) = (0.5, 0.15);
        let border = Surface::open(&[face(0), face(1)], margin + 1.5 * radius);
        let mut rng = Pcg64::seed_from_u64(2);
        let (mut free, mut near) = (0, 0);
        for _ in 0..20_000 {
            let (mover, x) = mover(&mut rng);
            let counts = |g: &(f64, Vector3<f64>)| g.0 < 0.0 && margin + g.0 < radius;
            let expected = border.nearest(&x, margin + radius).filter(counts);
            let mut list = Vec::new();
            let found = match border.list_margin(&mover, margin, &mut list) {
                Listing::Free(_) => {
                    free += 1;
                    None
                }
                Listing::Near(listed) => border.nearest_listed(&x, margin + radius, (&listed, &list)),
            };
            near += usize::from(expected.is_some());
            assert_eq!(found.filter(counts), expected, "{mover:?}, {x}");
        }
        assert!(free > 2_000 && near > 500, "{free} {near}");
    }
}

//! Walls near the spheres of a packing, listed together with the neighbours.
//!
//! Most spheres are far from all walls. For them nothing is computed until they may have come near, and for
//! the others only triangles that may matter.

use super::cells::{CHUNK, Sphere, centre};
use super::container::Container;
use super::surface::{Listed, Listing, Mover};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Triangles near a sphere: of the surface, and of the border of a part of a body.
pub(crate) type NearWalls = [Option<Listed>; 2];

/// Walls near [`CHUNK`] consecutive spheres.
#[derive(Debug, Default, Clone)]
pub(crate) struct WallChunk {
    /// Spheres near enough to a wall to touch it soon, by their index in the chunk.
    spheres: Vec<(u32, NearWalls)>,
    list: Vec<(f64, u32)>,
}

/// Walls near all spheres.
#[derive(Debug)]
pub(crate) struct WallList {
    pub(crate) chunks: Vec<WallChunk>,
    /// Distance that each sphere may move before any wall can reach it \[m\].
    free: Vec<f64>,
}

impl WallList {
    pub(crate) fn new(count: usize) -> Self {
        Self {
            chunks: vec![WallChunk::default(); count.div_ceil(CHUNK)],
            free: vec![0.0; count],
        }
    }

    /// Takes the growth of all radii by `factor` into account.
    pub(crate) fn grow(&mut self, spheres: &[Sphere], factor: f64) {
        for (free, s) in self.free.iter_mut().zip(spheres) {
            *free -= s[3] * (factor - 1.0).max(0.0);
        }
    }

    /// Lists the walls of spheres that will move by up to `travel` \[m\]; `before` are the spheres when the
    /// walls were last listed.
    pub(crate) fn renew(
        &mut self,
        container: &Container,
        spheres: &[Sphere],
        before: &[Sphere],
        travel: f64,
    ) {
        let places = spheres.par_chunks(CHUNK).zip(before.par_chunks(CHUNK));
        let work = self.chunks.par_iter_mut().zip(self.free.par_chunks_mut(CHUNK));
        work.zip(places).for_each(|((chunk, free), (spheres, before))| {
            chunk.spheres.clear();
            chunk.list.clear();
            for (k, ((free, s), b)) in free.iter_mut().zip(spheres).zip(before).enumerate() {
                *free -= (centre(s) - centre(b)).norm();
                if *free > travel {
                    continue;
                }
                let mover = Mover {
                    centre: centre(s),
                    radius: s[3],
                    travel,
                };
                match container.list_walls(&mover, &mut chunk.list) {
                    Ok(distance) => *free = distance,
                    Err(walls) => chunk.spheres.push((k as u32, walls)),
                }
            }
        });
    }
}

impl WallChunk {
    /// Adds the forces of walls on the spheres of the chunk.
    pub(crate) fn add_forces(&self, container: &Container, spheres: &[Sphere], force: &mut [[f64; 4]]) {
        for (k, walls) in &self.spheres {
            let s = &spheres[*k as usize];
            let f = &mut force[*k as usize];
            container.walls_listed(&centre(s), s[3], (walls, &self.list), |gap, n| {
                let push = s[3] - gap;
                for a in 0..3 {
                    f[a] += push * n[a];
                }
            });
        }
    }
}

impl Container {
    /// Lists the walls that a moving sphere may meet: `Ok` with the distance that it may move without meeting
    /// any \[m\], else the triangles that may matter.
    fn list_walls(&self, mover: &Mover, list: &mut Vec<(f64, u32)>) -> Result<f64, NearWalls> {
        let listings = match self {
            Self::Surface(s) => [s.list_walls(mover, list), Listing::Free(f64::INFINITY)],
            Self::Around(a) => a.list_walls(mover, list),
            _ => {
                let far = mover.radius + 4.0 * mover.travel;
                // Rounded down: a sphere that is thought free must not touch.
                let free = (self.gap(&mover.centre, far) - mover.radius) * (1.0 - 1e-6);
                return if free > mover.travel {
                    Ok(free)
                } else {
                    Err([None; 2])
                };
            }
        };
        match listings {
            [Listing::Free(a), Listing::Free(b)] => Ok(a.min(b)),
            _ => Err(listings.map(|l| match l {
                Listing::Free(_) => None,
                Listing::Near(listed) => Some(listed),
            })),
        }
    }

    /// Does what [`Self::walls`] does, with listed triangles.
    #[inline]
    fn walls_listed(
        &self,
        x: &Vector3<f64>,
        reach: f64,
        (walls, list): (&NearWalls, &[(f64, u32)]),
        wall: impl FnMut(f64, Vector3<f64>),
    ) {
        match (self, walls) {
            (Self::Surface(s), [Some(listed), _]) => s.walls_listed(x, reach, (listed, list), wall),
            (Self::Surface(_), _) => {}
            (Self::Around(a), _) => a.walls_listed(x, reach, (walls, list), wall),
            _ => self.walls(x, reach, wall),
        }
    }
}

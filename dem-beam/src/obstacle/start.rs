//! Check that no particle starts inside an obstacle.
//!
//! A particle that overlaps the obstacle at rest pushes only when it comes closer, as if its radius were
//! smaller by the overlap. As long as the centre lies in front of the surface this is harmless: packings end
//! in spheres of which some stick out. If the centre lies behind the surface, no radius is left: the particle
//! is inside, and the obstacle is in the wrong place. An obstacle that is smaller than the particle is inside
//! the particle once it overlaps by its own radius.

use super::{Body, RigidShape, near};
use crate::error::{Error, Result};
use crate::packing::cells::Sphere;
use arlequin_core::Owned;
use arlequin_core::contact::RigidBody;
use nalgebra::{Point3, Vector3};

/// Particles that overlap an obstacle by more than the smaller radius of both, and the deepest of them.
#[derive(Debug, Clone, Copy, Default)]
struct Inside {
    count: u64,
    depth: f64,
    /// Smaller radius of particle and obstacle \[m\].
    limit: f64,
    place: [f64; 3],
}

/// Words per rank of an [`Inside`] in the all-gather.
const WORDS: usize = 6;

impl Inside {
    fn find<'a>(
        shape: &RigidShape,
        moved: &Vector3<f64>,
        particles: impl Iterator<Item = (&'a f64, Point3<f64>)>,
    ) -> Self {
        let mut out = Self::default();
        let size = shape.depth();
        for (radius, centre) in particles {
            let depth = radius - shape.distance(&centre, moved).0;
            let limit = radius.min(size);
            if depth > limit {
                out.add(&Self {
                    count: 1,
                    depth,
                    limit,
                    place: centre.coords.into(),
                });
            }
        }
        out
    }

    fn add(&mut self, other: &Self) {
        let count = self.count + other.count;
        if other.depth > self.depth {
            *self = *other;
        }
        self.count = count;
    }

    /// Combines the results of all ranks, with the same result on all of them. Collective.
    fn on_all_ranks(self, owned: &Owned) -> arlequin_core::Result<Self> {
        let [x, y, z] = self.place;
        let reals = [self.depth, self.limit, x, y, z].map(|v| v.to_bits().cast_signed());
        let words: Vec<i64> = [self.count.cast_signed()].into_iter().chain(reals).collect();
        let gathered = owned.all_gather(words)?;
        let mut out = Self::default();
        for [count, reals @ ..] in gathered.as_chunks::<WORDS>().0 {
            let [depth, limit, x, y, z] = reals.map(|v| f64::from_bits(v.cast_unsigned()));
            out.add(&Self {
                count: count.cast_unsigned(),
                depth,
                limit,
                place: [x, y, z],
            });
        }
        Ok(out)
    }

    fn refuse(&self, obstacle: &str) -> Result<()> {
        if self.count == 0 {
            return Ok(());
        }
        Err(Error::StartsInside {
            object: format!("obstacle '{obstacle}'"),
            count: self.count as usize,
            place: self.place,
            depth: self.depth,
            limit: self.limit,
        })
    }
}

/// Returns an error if spheres overlap a shape by more than the smaller radius of both at time zero.
///
/// # Errors
/// [`Error::StartsInside`] with the number of spheres and the deepest one.
pub(super) fn check(
    obstacle: &str,
    shape: &RigidShape,
    moved: &Vector3<f64>,
    spheres: &[Sphere],
) -> Result<()> {
    let particles = spheres.iter().map(|s| (&s[3], Point3::new(s[0], s[1], s[2])));
    Inside::find(shape, moved, particles).refuse(obstacle)
}

impl Body {
    /// Returns an error if particles are displaced into the obstacle before the first step. Collective on a
    /// partitioned body.
    pub(super) fn check_start(&mut self, rigid: &RigidBody, q: &[f64]) -> arlequin_core::Result<()> {
        if std::mem::replace(&mut self.checked, true) {
            return Ok(());
        }
        let (owned, grains) = self.owned();
        let displaced = grains
            .rest_spheres
            .iter()
            .enumerate()
            .map(|(i, s)| (&s[3], near::place(s, q, i)));
        let inside = Inside::find(rigid.shape(), &rigid.moved(), displaced).on_all_ranks(&owned)?;
        let named = |e| arlequin_core::Error::of_model(&self.host, e);
        inside.refuse(&self.name).map_err(named)
    }
}

//! Refuses particles that start deep inside an obstacle.
//!
//! A particle that overlaps the obstacle at rest pushes from there on, as if its radius were smaller by the
//! overlap. That is no more than touching while the centre lies in front of the surface: packings end in
//! spheres of which some stick out. Once the centre is behind the surface nothing is left of the radius, the
//! particle is inside, and the obstacle is in the wrong place.

use super::{Body, RigidShape, near};
use crate::error::{Error, Result};
use crate::packing::cells::Sphere;
use arlequin_core::ranks::Portion;
use nalgebra::{Point3, Vector3};

/// Particles whose centres lie inside an obstacle, and the deepest of them.
#[derive(Debug, Clone, Copy, Default)]
struct Inside {
    count: u64,
    depth: f64,
    radius: f64,
    place: [f64; 3],
}

/// Words of it between ranks.
const WORDS: usize = 6;

impl Inside {
    fn of<'a>(
        shape: &RigidShape,
        moved: &Vector3<f64>,
        particles: impl Iterator<Item = (&'a f64, Point3<f64>)>,
    ) -> Self {
        let mut out = Self::default();
        for (radius, centre) in particles {
            let distance = shape.distance(&centre, moved).0;
            if distance < 0.0 {
                out.add(&Self {
                    count: 1,
                    depth: radius - distance,
                    radius: *radius,
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

    /// Of all ranks, the same on all of them.
    fn on_all_ranks(self, portion: &Portion) -> arlequin_core::Result<Self> {
        let [x, y, z] = self.place;
        let reals = [self.depth, self.radius, x, y, z].map(|v| v.to_bits().cast_signed());
        let words: Vec<i64> = [self.count.cast_signed()].into_iter().chain(reals).collect();
        let all = portion.listed(&words)?;
        let mut out = Self::default();
        for [count, reals @ ..] in all.as_chunks::<WORDS>().0 {
            let [depth, radius, x, y, z] = reals.map(|v| f64::from_bits(v.cast_unsigned()));
            out.add(&Self {
                count: count.cast_unsigned(),
                depth,
                radius,
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
            limit: self.radius,
        })
    }
}

/// Refuses spheres with centres inside a shape where it is at time zero.
///
/// # Errors
/// [`Error::StartsInside`].
pub(super) fn check(
    obstacle: &str,
    shape: &RigidShape,
    moved: &Vector3<f64>,
    spheres: &[Sphere],
) -> Result<()> {
    let particles = spheres.iter().map(|s| (&s[3], Point3::new(s[0], s[1], s[2])));
    Inside::of(shape, moved, particles).refuse(obstacle)
}

impl Body {
    /// Refuses the state before the first step if particles are displaced into the obstacle. On a body in
    /// parts all ranks must ask.
    pub(super) fn check_start(&mut self, q: &[f64]) -> arlequin_core::Result<()> {
        if std::mem::replace(&mut self.checked, true) {
            return Ok(());
        }
        let crowd = self.crowd.as_ref();
        let rest = &crowd.map_or(&self.grains, |c| &c.grains).rest;
        let displaced = rest
            .iter()
            .enumerate()
            .map(|(i, s)| (&s[3], near::place(s, q, i)));
        let mut inside = Inside::of(&self.shape, &self.moved, displaced);
        if let Some(crowd) = crowd {
            inside = inside.on_all_ranks(crowd.portion())?;
        }
        let named = |e| arlequin_core::Error::of_model(&self.host, e);
        inside.refuse(&self.name).map_err(named)
    }
}

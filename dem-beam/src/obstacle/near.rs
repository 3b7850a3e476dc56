//! List of the particles that an obstacle may touch.

use super::RigidShape;
use crate::packing::cells::{Sphere, mean_radius};
use nalgebra::{Point3, Vector3};

/// Reach of the list beyond touching, in mean radii of the particles.
const SKIN: f64 = 0.5;

/// Particles per comparison of the largest motion with its limit: enough to use the processor's vector lanes.
const CHUNK: usize = 64;

/// Particles near an obstacle. The list is rebuilt when particles and obstacle together have moved by the
/// skin.
#[derive(Debug)]
pub(super) struct Near {
    skin: f64,
    /// Near particles, ascending.
    pub(super) particles: Vec<u32>,
    /// Displacements when the list was built; empty before.
    built: Vec<f64>,
    moved: Vector3<f64>,
    pub(super) searches: usize,
}

impl Near {
    pub(super) fn new(rest_spheres: &[Sphere]) -> Self {
        Self {
            skin: SKIN * mean_radius(rest_spheres),
            particles: Vec::with_capacity(rest_spheres.len()),
            built: Vec::with_capacity(3 * rest_spheres.len()),
            moved: Vector3::zeros(),
            searches: 0,
        }
    }

    /// Makes an empty list with the same skin for another number of particles.
    pub(super) fn for_particles(&self, particles: usize) -> Self {
        Self {
            skin: self.skin,
            particles: Vec::new(),
            built: Vec::with_capacity(3 * particles),
            moved: Vector3::zeros(),
            searches: 0,
        }
    }

    /// Returns whether no particle outside of the list can touch the obstacle: a distance changes by at most
    /// the sum of both motions.
    fn holds(&self, u: &[f64], moved: &Vector3<f64>) -> bool {
        // A margin of a thousandth for round-off.
        let slack = 0.999 * self.skin - (moved - self.moved).norm();
        if self.built.len() != u.len() || slack < 0.0 {
            return false;
        }
        let far = |(now, then): (&[f64], &[f64])| {
            let points = now.as_chunks::<3>().0.iter().zip(then.as_chunks::<3>().0);
            let square = |(a, b): (&[f64; 3], &[f64; 3])| {
                let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
                d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
            };
            // Counted over a chunk: leaving at the first particle would prevent vector instructions.
            points.map(|p| u32::from(square(p) > slack * slack)).sum::<u32>() > 0
        };
        !u.chunks(3 * CHUNK).zip(self.built.chunks(3 * CHUNK)).any(far)
    }

    /// Rebuilds the list if it no longer holds. Calls `lost` for each particle that is not on the new list.
    pub(super) fn refresh(
        &mut self,
        shape: &RigidShape,
        moved: &Vector3<f64>,
        u: &[f64],
        rest_spheres: &[Sphere],
        mut lost: impl FnMut(usize),
    ) {
        if self.holds(u, moved) {
            return;
        }
        self.searches += 1;
        self.built.clear();
        self.built.extend_from_slice(u);
        self.moved = *moved;
        self.particles.clear();
        for (i, s) in rest_spheres.iter().enumerate() {
            let (distance, _) = shape.distance(&place(s, u, i), moved);
            if distance < s[3] + self.skin {
                self.particles.push(i as u32);
            } else {
                lost(i);
            }
        }
    }

    /// Clears the list; the next refresh rebuilds it.
    pub(super) fn clear(&mut self) {
        self.built.clear();
        self.particles.clear();
    }
}

/// Centre of particle `i`, displaced by `u` \[m\].
pub(super) fn place(sphere: &Sphere, u: &[f64], i: usize) -> Point3<f64> {
    Point3::new(
        sphere[0] + u[3 * i],
        sphere[1] + u[3 * i + 1],
        sphere[2] + u[3 * i + 2],
    )
}

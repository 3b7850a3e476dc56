//! Energy and forces of single bonds from the unknowns of a model, in plain form: for output and for bonds
//! that break.

use super::forces::Orientations;
use crate::bond::{BeamRigidity, Twist};
use crate::finite::{self, Pose};
use crate::particles::BondedParticles;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Reads the state of particles from the unknowns of a model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    /// Unknowns of the model.
    pub(crate) q: &'a [f64],
    /// Orientations reached last; `None` under small rotations.
    pub(crate) orientations: Option<Orientations<'a>>,
    /// Section rigidities.
    pub(crate) rigidity: BeamRigidity,
    /// States of the ghosts, which are numbered behind the owned particles; see [`Reader::state_to_send`].
    pub(crate) ghosts: &'a [[f64; 7]],
}

impl Reader<'_> {
    #[inline]
    fn three(&self, at: usize) -> Vector3<f64> {
        Vector3::new(self.q[at], self.q[at + 1], self.q[at + 2])
    }

    /// Returns the state of particle `i` if it is a ghost.
    #[inline]
    fn ghost(&self, i: usize) -> Option<&[f64; 7]> {
        // The unknowns are those of owned particles alone, six each.
        let owned = self.q.len() / 6;
        self.ghosts.get(i.checked_sub(owned)?)
    }

    /// Returns the state of particle `i` that is sent to other ranks: its displacement, then its rotation
    /// vector or quaternion (scalar first).
    pub(crate) fn state_to_send(&self, i: usize) -> [f64; 7] {
        let Twist { linear: u, angular } = self.twist(i);
        match self.orientations {
            None => [u.x, u.y, u.z, angular.x, angular.y, angular.z, 0.0],
            Some(orientations) => {
                let q = orientations.orientation(i, angular.into());
                [u.x, u.y, u.z, q.w, q.i, q.j, q.k]
            }
        }
    }

    /// Returns displacement and small rotation of particle `i`.
    #[inline]
    pub(crate) fn twist(&self, i: usize) -> Twist {
        if let Some(state) = self.ghost(i) {
            return Twist {
                linear: Vector3::from_column_slice(&state[..3]),
                angular: Vector3::from_column_slice(&state[3..6]),
            };
        }
        Twist {
            linear: self.three(3 * i),
            angular: self.three(self.q.len() / 2 + 3 * i),
        }
    }

    /// Returns the poses of two particles under finite rotations; `None` under small ones.
    #[inline]
    pub(crate) fn poses(&self, ends: [usize; 2]) -> Option<[Pose; 2]> {
        let orientations = self.orientations?;
        Some(ends.map(|i| {
            if let Some(state) = self.ghost(i) {
                let [s, x, y, z] = [state[3], state[4], state[5], state[6]];
                return Pose {
                    displacement: Vector3::from_column_slice(&state[..3]),
                    rotation: UnitQuaternion::new_unchecked(Quaternion::new(s, x, y, z)),
                };
            }
            let twist = self.twist(i);
            Pose {
                displacement: twist.linear,
                rotation: orientations.orientation(i, twist.angular.into()),
            }
        }))
    }

    /// Returns the weighted energy of bond `b` \[J\].
    pub(crate) fn energy(&self, body: &BondedParticles, b: usize) -> f64 {
        // Most bonds of a zone that follows have no weight, and their energies would be zero.
        if body.has_no_stiffness(b) {
            return 0.0;
        }
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = body.bond(b);
        match self.poses([i, j]) {
            Some([a, b]) => finite::energy(&bond, &self.rigidity, &a, &b),
            None => bond.energy(&self.rigidity, &self.twist(i), &self.twist(j)),
        }
    }

    /// Returns the weighted energy of bond `b` \[J\], and the forces and torques on its two ends \[N, N m\].
    pub(crate) fn bond(&self, body: &BondedParticles, b: usize) -> (f64, [Twist; 2]) {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = body.bond(b);
        let (fi, fj) = match self.poses([i, j]) {
            Some([a, b]) => finite::wrenches(&bond, &self.rigidity, &a, &b),
            None => bond.wrenches(&self.rigidity, &self.twist(i), &self.twist(j)),
        };
        (self.energy(body, b), [fi, fj])
    }
}

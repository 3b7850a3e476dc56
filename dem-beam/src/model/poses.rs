//! Single bonds of a model read from the unknowns: energy and forces in plain form, for output and for bonds that break.

use super::forces::Reached;
use crate::bond::{BeamRigidity, Twist};
use crate::finite::{self, Pose};
use crate::particles::BondedParticles;
use nalgebra::Vector3;

/// Reads the state of particles from the unknowns of a model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    /// Unknowns.
    pub(crate) q: &'a [f64],
    /// Where orientations start from, if rotations are finite.
    pub(crate) reached: Option<Reached<'a>>,
    /// Section rigidities.
    pub(crate) rigidity: BeamRigidity,
}

impl Reader<'_> {
    #[inline]
    fn three(&self, at: usize) -> Vector3<f64> {
        Vector3::new(self.q[at], self.q[at + 1], self.q[at + 2])
    }

    /// Displacement and small rotation.
    #[inline]
    pub(crate) fn twist(&self, i: usize) -> Twist {
        Twist {
            linear: self.three(3 * i),
            angular: self.three(self.q.len() / 2 + 3 * i),
        }
    }

    /// Two particles under finite rotations; `None` under small ones.
    #[inline]
    pub(crate) fn poses(&self, ends: [usize; 2]) -> Option<[Pose; 2]> {
        let reached = self.reached?;
        Some(ends.map(|i| {
            let twist = self.twist(i);
            Pose {
                displacement: twist.linear,
                rotation: reached.orientation(i, twist.angular.into()),
            }
        }))
    }

    /// Weighted energy of bond `b` \[J\].
    pub(crate) fn energy(&self, body: &BondedParticles, b: usize) -> f64 {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = &body.bonds()[b];
        match self.poses([i, j]) {
            Some([a, b]) => finite::energy(bond, &self.rigidity, &a, &b),
            None => bond.energy(&self.rigidity, &self.twist(i), &self.twist(j)),
        }
    }

    /// Weighted energy of bond `b` \[J\] and the forces and torques on its two ends \[N, N m\].
    pub(crate) fn bond(&self, body: &BondedParticles, b: usize) -> (f64, [Twist; 2]) {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = &body.bonds()[b];
        let (fi, fj) = match self.poses([i, j]) {
            Some([a, b]) => finite::wrenches(bond, &self.rigidity, &a, &b),
            None => bond.wrenches(&self.rigidity, &self.twist(i), &self.twist(j)),
        };
        (self.energy(body, b), [fi, fj])
    }
}

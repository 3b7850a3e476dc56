//! Single bonds of a model read from the unknowns: energy and forces in plain form, for output and for bonds that break.

use crate::bond::{BeamRigidity, Twist};
use crate::finite::{self, Pose};
use crate::particles::BondedParticles;
use nalgebra::{UnitQuaternion, Vector3};

/// Reads the state of particles from the unknowns of a model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    /// Unknowns.
    pub(crate) q: &'a [f64],
    /// Whether rotations are finite.
    pub(crate) finite: bool,
    /// Nodal factors, if any.
    pub(crate) factors: Option<&'a [f64]>,
    /// Section rigidities.
    pub(crate) rigidity: BeamRigidity,
}

impl Reader<'_> {
    #[inline]
    fn three(&self, at: usize) -> Vector3<f64> {
        Vector3::new(self.q[at], self.q[at + 1], self.q[at + 2])
    }

    #[inline]
    fn angle(&self, i: usize) -> Vector3<f64> {
        self.three(self.q.len() / 2 + 3 * i)
    }

    /// Displacement and rotation vector.
    #[inline]
    pub(crate) fn twist(&self, i: usize) -> Twist {
        Twist {
            linear: self.three(3 * i),
            angular: self.angle(i),
        }
    }

    pub(crate) fn pose(&self, i: usize) -> Pose {
        Pose {
            displacement: self.three(3 * i),
            rotation: UnitQuaternion::from_scaled_axis(self.angle(i)),
        }
    }

    /// Weighted energy of bond `b` (J).
    pub(crate) fn energy(&self, body: &BondedParticles, b: usize) -> f64 {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = &body.bonds()[b];
        let energy = if self.finite {
            finite::energy(bond, &self.rigidity, &self.pose(i), &self.pose(j))
        } else {
            bond.energy(&self.rigidity, &self.twist(i), &self.twist(j))
        };
        match self.factors {
            Some(w) => 0.5 * (w[i] + w[j]) * energy,
            None => energy,
        }
    }

    /// Weighted energy of bond `b` (J) and the forces `-dU/dq` on its two ends (N, N m).
    pub(crate) fn bond(&self, body: &BondedParticles, b: usize) -> (f64, [Twist; 2]) {
        let [i, j] = body.pairs()[b].map(|i| i as usize);
        let bond = &body.bonds()[b];
        let mut forces = if self.finite {
            let (mut fi, mut fj) = finite::wrenches(bond, &self.rigidity, &self.pose(i), &self.pose(j));
            fi.angular = finite::generalised(&self.angle(i), &fi.angular);
            fj.angular = finite::generalised(&self.angle(j), &fj.angular);
            [fi, fj]
        } else {
            let (fi, fj) = bond.wrenches(&self.rigidity, &self.twist(i), &self.twist(j));
            [fi, fj]
        };
        if let Some(w) = self.factors {
            for (f, w) in forces.iter_mut().zip([w[i], w[j]]) {
                f.linear *= w;
                f.angular *= w;
            }
        }
        (self.energy(body, b), forces)
    }
}

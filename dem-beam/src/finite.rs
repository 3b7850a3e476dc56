//! The finite-rotation law of one bond, in plain form: the reference the fast kernel is tested
//! against. Potential, gradient and meaning: see the kernel's law.
//!
//! ```text
//! U = w [ k_n (l-l0)^2/2 + k_t s^2/2 + 2 k_b ((1-c_i^2) + (t_i.t_j - c_i c_j) + (1-c_j^2)) ]
//! ```

use crate::bond::{BeamRigidity, LinearBond};
use nalgebra::{UnitQuaternion, Vector3};

/// Where a particle is relative to its place at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Displacement of the centre (m).
    pub displacement: Vector3<f64>,
    /// Rotation since rest.
    pub rotation: UnitQuaternion<f64>,
}

/// Elastic energy of a bond between two particles (J).
#[must_use]
pub fn energy(bond: &LinearBond, k: &BeamRigidity, i: &Pose, j: &Pose) -> f64 {
    let inverse = bond.axis.norm();
    let scale = bond.scale * inverse * inverse;
    let n0 = bond.axis / inverse;
    let rest = 1.0 / inverse;
    let du = j.displacement - i.displacement;
    let d = n0 * rest + du;
    let length = d.norm();
    let n = d / length;
    let stretch = (n0 * rest + d).dot(&du) / (length + rest);
    let (ti, tj) = (i.rotation * n0, j.rotation * n0);
    let relative = j.rotation.quaternion() * i.rotation.quaternion().conjugate();
    let twist = 2.0 * n.dot(&relative.imag());
    // Transverse parts: 1 - c^2 = |e|^2 and t_i.t_j - c_i c_j = e_i.e_j, without cancellation.
    let (ei, ej) = (ti - n * n.dot(&ti), tj - n * n.dot(&tj));
    scale
        * (0.5 * k.axial * stretch * stretch
            + 0.5 * k.torsion * twist * twist
            + 2.0 * k.bending * (ei.dot(&ei) + ei.dot(&ej) + ej.dot(&ej)))
}

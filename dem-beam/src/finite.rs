//! The finite-rotation law of one bond in plain form: the reference that the fast kernel is tested against.
//! The kernel's law explains potential and gradient.
//!
//! ```text
//! U = w [ k_n (l-l0)^2/2 + k_t s^2/2 + 2 k_b ((1-c_i^2) + (t_i.t_j - c_i c_j) + (1-c_j^2)) ]
//! ```

use crate::bond::{BeamRigidity, LinearBond, Twist};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Displacement and rotation of a particle since rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Displacement of the centre \[m\].
    pub displacement: Vector3<f64>,
    /// Rotation since rest.
    pub rotation: UnitQuaternion<f64>,
}

/// Geometry of a bond between two displaced and rotated particles.
pub(crate) struct Deformed {
    /// Inverse of the length at rest \[1/m\].
    pub(crate) inverse: f64,
    /// Distance of the centres \[m\].
    pub(crate) length: f64,
    /// Unit vector from the first centre to the second.
    pub(crate) n: Vector3<f64>,
    /// `l - l0 = (d + d0).du/(l + l0)`, without cancellation for small strains.
    pub(crate) stretch: f64,
    /// Unit axis at rest, rotated with the first and with the second particle.
    pub(crate) t: [Vector3<f64>; 2],
    /// Rotation of the second particle relative to the first.
    pub(crate) relative: Quaternion<f64>,
}

impl Deformed {
    #[inline]
    pub(crate) fn new(bond: &LinearBond, i: &Pose, j: &Pose) -> Self {
        let inverse = bond.axis.norm();
        let (n0, rest_length) = (bond.axis / inverse, 1.0 / inverse);
        let du = j.displacement - i.displacement;
        let d = n0 * rest_length + du;
        let length = d.norm();
        Self {
            inverse,
            length,
            n: d / length,
            stretch: (n0 * rest_length + d).dot(&du) / (length + rest_length),
            t: [i.rotation * n0, j.rotation * n0],
            relative: j.rotation.quaternion() * i.rotation.quaternion().conjugate(),
        }
    }
}

/// Returns the elastic energy of a bond between two particles \[J\].
#[must_use]
pub fn energy(bond: &LinearBond, k: &BeamRigidity, i: &Pose, j: &Pose) -> f64 {
    let Deformed {
        inverse,
        n,
        stretch,
        t: [ti, tj],
        relative,
        ..
    } = Deformed::new(bond, i, j);
    // `bond.scale` is `w l`; over the square of the length it is `w/l0`, which all rigidities share.
    let scale = bond.scale * inverse * inverse;
    let twist = 2.0 * n.dot(&relative.imag());
    // Transverse parts: 1 - c^2 = |e|^2 and t_i.t_j - c_i c_j = e_i.e_j, without cancellation.
    let (ei, ej) = (ti - n * n.dot(&ti), tj - n * n.dot(&tj));
    scale
        * (0.5 * k.axial * stretch * stretch
            + 0.5 * k.torsion * twist * twist
            + 2.0 * k.bending * (ei.dot(&ei) + ei.dot(&ej) + ej.dot(&ej)))
}

/// Returns the forces and torques of a bond on its two particles: minus the gradient of [`energy`] with
/// respect to displacements and spins.
#[must_use]
pub fn wrenches(bond: &LinearBond, k: &BeamRigidity, i: &Pose, j: &Pose) -> (Twist, Twist) {
    let Deformed {
        inverse,
        length,
        n,
        stretch,
        t: [ti, tj],
        relative,
    } = Deformed::new(bond, i, j);
    let scale = bond.scale * inverse * inverse;
    let (r, r0) = (relative.imag(), relative.scalar());
    // The vector part of a quaternion is the axis times the sine of half the angle.
    let twist = 2.0 * n.dot(&r);
    let (ci, cj) = (n.dot(&ti), n.dot(&tj));
    let (kt, kb) = (k.torsion * scale * twist, 2.0 * k.bending * scale);
    let (a, b) = (2.0 * ci + cj, ci + 2.0 * cj);
    let g = (ti * a + tj * b) * -kb;
    let across = (r * 2.0 - n * twist) * kt + g - n * n.dot(&g);
    let force = n * (k.axial * scale * stretch) + across / length;
    let turn = n.cross(&r) * kt;
    (
        Twist {
            linear: force,
            angular: n * (kt * r0) + turn - ti.cross(&(tj - n * a)) * kb,
        },
        Twist {
            linear: -force,
            angular: n * (-kt * r0) + turn - tj.cross(&(ti - n * b)) * kb,
        },
    )
}

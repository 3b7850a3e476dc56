//! The force at a contact of two bodies.
//!
//! ```text
//! k = E 2 r_i r_j/(r_i + r_j) for spheres, E A/h for a point of a surface (see [`super::SurfaceObstacle`])
//! f_n = max(0, k gap - c v_n)      c = 2 zeta sqrt(k m)
//! e = exp(-zeta/s (pi - atan2(2 zeta s, 1 - 2 zeta^2))), s = sqrt(1 - zeta^2)    m the reduced mass
//! (the restitution of a spring and dashpot that never pull, Schwager and Poeschel 2007)
//! f_t = -k_t xi, xi the sliding since touch in the tangent plane, |f_t| <= friction f_n
//! m_r = -k_t r^2 psi, psi the rolling since touch, |m_r| <= rolling r f_n, r the reduced radius
//! ```

use super::{Twist, positive};
use crate::Result;
use crate::error::invalid;
use nalgebra::Vector3;

/// Part of the largest unknown change of speed that is left after a step.
const FADE: f64 = 0.95;

/// Slightly above the restitution of a critically damped contact, exp(-2) = 0.135.
const LEAST_RESTITUTION: f64 = 0.15;

/// Parameters of the contact law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLaw {
    /// Modulus `E` of the normal spring \[Pa\]. The modulus of the packing is a good value.
    pub modulus: f64,
    /// Coefficient of restitution of a collision of two free spheres, 0.15 to 1 (elastic).
    pub restitution: f64,
    /// Coefficient of Coulomb friction, 0 for none.
    pub friction: f64,
    /// Ratio of tangential to normal stiffness.
    pub shear_ratio: f64,
    /// Rolling resistance (lever over reduced radius), 0 for none.
    pub rolling: f64,
    /// Skin of the neighbour list in mean radii, or mean sizes of the facets if they are smaller: a larger
    /// skin lists more pairs and searches less often.
    pub skin: f64,
}

impl ContactLaw {
    /// Law of an elastic contact without friction, with a skin of 0.4 mean radii.
    #[must_use]
    pub fn elastic(modulus: f64) -> Self {
        Self {
            modulus,
            restitution: 1.0,
            friction: 0.0,
            shear_ratio: 0.5,
            rolling: 0.0,
            skin: 0.4,
        }
    }

    /// Checks all parameters. Effects that use the law call this themselves.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for the first parameter out of its range.
    pub fn check(&self) -> Result<()> {
        positive("contact modulus", self.modulus)?;
        positive("shear ratio of contact", self.shear_ratio)?;
        positive("skin of the neighbour list", self.skin)?;
        let bad = |name, value: f64, rule| Err(invalid(name, value, rule));
        if !(self.restitution >= LEAST_RESTITUTION && self.restitution <= 1.0) {
            return bad(
                "coefficient of restitution",
                self.restitution,
                "must lie in [0.15, 1]",
            );
        }
        if !(self.friction >= 0.0 && self.friction.is_finite()) {
            return bad(
                "friction coefficient",
                self.friction,
                "must be finite and not negative",
            );
        }
        if !(self.rolling >= 0.0 && self.rolling.is_finite()) {
            return bad(
                "rolling resistance",
                self.rolling,
                "must be finite and not negative",
            );
        }
        Ok(())
    }

    /// Returns the fraction of critical damping that gives the coefficient of restitution.
    #[must_use]
    pub fn damping_ratio(&self) -> f64 {
        if self.restitution >= 1.0 {
            return 0.0;
        }
        let restitution = |z: f64| {
            let s = (1.0 - z * z).sqrt();
            (-z / s * (std::f64::consts::PI - (2.0 * z * s).atan2(1.0 - 2.0 * z * z))).exp()
        };
        // Bisection: the restitution falls from 1 to exp(-2) between no and critical damping.
        // Not quite critical, where `s` would be zero. 60 halvings reach the last bit.
        let (mut low, mut high) = (0.0, 1.0 - 1e-9);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if restitution(middle) > self.restitution {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Unweighted normal stiffness of two spheres with these radii \[N/m\].
    #[must_use]
    pub fn stiffness(&self, [a, b]: [f64; 2]) -> f64 {
        2.0 * self.modulus * a * b / (a + b)
    }

    /// Returns `omega^2` \[1/s²\] and the damping rate \[1/s\] of one contact on a particle with `top = k/m`.
    ///
    /// The `omega^2` of a pair, `k (1/m_i + 1/m_j)`, is at most twice the larger `k/m` of its ends. Sliding
    /// also rotates the sphere: `1/m + r^2/I = 3.5/m`.
    #[must_use]
    pub fn demand(&self, top: f64) -> [f64; 2] {
        let slide = if self.friction > 0.0 {
            3.5 * self.shear_ratio
        } else {
            0.0
        };
        // A full ball has `I = 2/5 m r²`, so `r²/I = 2.5/m`.
        let roll = if self.rolling > 0.0 {
            2.5 * self.shear_ratio
        } else {
            0.0
        };
        let square = 2.0 * top * (slide + roll).max(1.0);
        // The rate `2 ζ ω` for each of the two ends.
        [square, 2.0 * 2.0 * self.damping_ratio() * top.sqrt()]
    }

    /// Computes the force on the second body, the torques on both and the energy of the springs, for the
    /// damping ratio `zeta`.
    ///
    /// Advances the springs by a step `dt` \[s\]. The result is not yet limited by the energy budget (see
    /// [`super::BudgetedLaw`]).
    pub fn respond(&self, p: &Pair, zeta: f64, dt: f64, spring: &mut Spring) -> Response {
        let n = p.normal;
        let k = p.share * p.stiffness;
        let kt = k * self.shear_ratio;
        let damping = 2.0 * zeta * (k / p.inverse_mass).sqrt();
        let [i, j] = &p.motion;
        let lever = i.angular * p.arms[0] + j.angular * p.arms[1];
        let v = j.linear - i.linear - lever.cross(&n);
        let vn = v.dot(&n);
        // The dashpot may not pull: spheres that part have no adhesion.
        let push = (k * p.gap - damping * vn).max(0.0);
        spring.closed = true;
        let mut out = Response {
            force: n * push,
            torque: [Vector3::zeros(); 2],
            stiffness: k,
            stored: 0.5 * k * p.gap * p.gap,
        };
        if self.friction > 0.0 {
            let moved = spring.slide + (v - n * vn) * dt;
            // Only the part in the current tangent plane is kept: the plane rotates with the pair.
            spring.slide = capped(moved - n * n.dot(&moved), self.friction * push / kt);
            let drag = spring.slide * -kt;
            out.force += drag;
            let turn = n.cross(&drag);
            out.torque = [turn * -p.arms[0], turn * -p.arms[1]];
            out.stored += 0.5 * kt * spring.slide.norm_squared();
        }
        if self.rolling > 0.0 {
            let radius = p.reduced_radius;
            let kr = kt * radius * radius;
            let turned = spring.roll + (j.angular - i.angular) * dt;
            // The springs never hold more than friction allows: the excess slides or rolls.
            spring.roll = capped(turned - n * n.dot(&turned), self.rolling * radius * push / kr);
            let moment = spring.roll * -kr;
            out.torque[0] -= moment;
            out.torque[1] += moment;
            out.stored += 0.5 * kr * spring.roll.norm_squared();
        }
        out
    }
}

fn capped(x: Vector3<f64>, limit: f64) -> Vector3<f64> {
    let size = x.norm();
    if size > limit { x * (limit / size) } else { x }
}

/// Two touching bodies: spheres, or an obstacle and a point of a surface.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// Unit vector from the first to the second.
    pub normal: Vector3<f64>,
    /// Overlap beyond the overlap at rest \[m\].
    pub gap: f64,
    /// Normal stiffness without weights \[N/m\].
    pub stiffness: f64,
    /// Reduced radius `r_i r_j/(r_i + r_j)` for rolling resistance \[m\].
    pub reduced_radius: f64,
    /// Distances of the centres from the point of contact \[m\]; their sum is the distance of the centres.
    pub arms: [f64; 2],
    /// Factor on the stiffness from the weights.
    pub share: f64,
    /// Sum of the inverse weighted masses \[1/kg\].
    pub inverse_mass: f64,
    /// Velocities and spins.
    pub motion: [Twist; 2],
}

/// State of one contact that lasts from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spring {
    /// True while the contact is closed.
    pub closed: bool,
    /// Sliding since touch in the tangent plane \[m\].
    pub slide: Vector3<f64>,
    /// Rolling since touch \[rad\].
    pub roll: Vector3<f64>,
    /// Energy \[J\] that the contact took in since touch and has not given back.
    pub budget: f64,
    /// Largest change of the contact's speed in a step by forces that were unknown when the contact was
    /// computed \[m/s\]; earlier ones fade.
    pub unknown: f64,
}

impl Spring {
    /// Count of numbers that [`Self::numbers`] returns.
    pub const NUMBERS: usize = 8;

    /// Returns `slide`, `roll`, the budget and the unknown speed as numbers. The flag `closed` is saved
    /// separately.
    #[must_use]
    pub fn numbers(&self) -> [f64; Self::NUMBERS] {
        let (s, r) = (self.slide, self.roll);
        [s.x, s.y, s.z, r.x, r.y, r.z, self.budget, self.unknown]
    }

    /// Inverse of [`Self::numbers`].
    #[must_use]
    pub fn from_numbers(closed: bool, x: [f64; Self::NUMBERS]) -> Self {
        Self {
            closed,
            slide: Vector3::new(x[0], x[1], x[2]),
            roll: Vector3::new(x[3], x[4], x[5]),
            budget: x[6],
            unknown: x[7],
        }
    }

    /// Corrects the budget for a change of the power `excess` \[W\] of the contact's force \[N\] in a step of
    /// length `dt` \[s\], which forces caused that were unknown when the contact was computed. For the next
    /// steps the contact holds back what as large a change could cost; a body that comes to rest is then held
    /// by the full force.
    pub fn settle(&mut self, dt: f64, excess: f64, force: f64) {
        self.budget -= 0.5 * dt * excess;
        if force > 0.0 {
            self.unknown = (FADE * self.unknown).max(excess.abs() / force);
        }
    }
}

/// Forces and energy of one contact at an instant.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// Force on the second body \[N\]; the first feels the opposite force.
    pub force: Vector3<f64>,
    /// Torques on both bodies \[N m\].
    pub torque: [Vector3<f64>; 2],
    /// Weighted normal stiffness \[N/m\].
    pub stiffness: f64,
    /// Energy of the springs \[J\].
    pub stored: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// An unknown change of the power takes its work in the half step from the budget, and its speed is held
    /// back; the memory of it fades, and a larger change takes its place.
    #[test]
    fn a_contact_remembers_the_largest_unknown_change_for_some_steps() {
        let (dt, force) = (0.1, 5.0);
        let mut spring = Spring {
            budget: 1.0,
            ..Spring::default()
        };
        spring.settle(dt, -2.0, force);
        assert_abs_diff_eq!(spring.budget, 1.1);
        assert_abs_diff_eq!(spring.unknown, 0.4);
        spring.settle(dt, 0.0, force);
        assert_abs_diff_eq!(spring.unknown, 0.38);
        spring.settle(dt, 10.0, force);
        assert_abs_diff_eq!(spring.unknown, 2.0);
        // Without a force there is no speed to learn.
        spring.settle(dt, 10.0, 0.0);
        assert_abs_diff_eq!(spring.unknown, 2.0);
    }
}

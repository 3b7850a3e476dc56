//! Forces of a contact effect on the unknowns of one model within a step: those of the contacts that have
//! been decided, and those that the others propose. Positive and negative components are summed apart: two
//! contacts share their common work only where both push an unknown to the same side (see
//! [`super::budget`]).

use super::End;
use super::place::Place;
use crate::effect::Instant;
use nalgebra::Vector3;

/// Forces of one effect on one model within a step.
#[derive(Debug, Default)]
pub(super) struct StepForces {
    /// Inverse inertia of every unknown; zero where it is held.
    pub(super) inverse_inertia: Vec<f64>,
    decided: Vec<[f64; 2]>,
    proposed: Vec<[f64; 2]>,
}

/// A force \[N\] at a place and a torque \[N m\] on the unknowns that begin at `turning`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Push {
    pub(super) place: Place,
    pub(super) turning: Option<usize>,
    pub(super) force: Vector3<f64>,
    pub(super) torque: Vector3<f64>,
}

impl Push {
    /// Calls `f` with the component (0 to 5), the unknown, the weight and the component's value.
    fn each(&self, mut f: impl FnMut(usize, usize, f64, f64)) {
        for (n, w) in self.place.nodes() {
            (0..3).for_each(|c| f(c, 3 * n + c, w, self.force[c]));
        }
        if let Some(first) = self.turning {
            (0..3).for_each(|c| f(3 + c, first + c, 1.0, self.torque[c]));
        }
    }

    /// Adds the push to nodal forces.
    pub(super) fn add(&self, f: &mut [f64]) {
        self.each(|_, o, w, x| f[o] += w * x);
    }
}

/// Place of a positive or negative component in a pair of sums.
fn sign(x: f64) -> usize {
    usize::from(x < 0.0)
}

impl StepForces {
    /// No forces, with the inverse inertia of every unknown.
    pub(super) fn new(inverse_inertia: Vec<f64>) -> Self {
        let zero = vec![[0.0; 2]; inverse_inertia.len()];
        Self {
            decided: zero.clone(),
            proposed: zero,
            inverse_inertia,
        }
    }

    /// Returns whether a node can move.
    pub(super) fn moves(&self, node: usize) -> bool {
        self.inverse_inertia[3 * node..3 * node + 3]
            .iter()
            .any(|x| *x > 0.0)
    }

    /// Velocities of the place of a push during the step, under the forces `f` of others and those of this
    /// effect.
    pub(super) fn end(&self, push: &Push, instant: &Instant<'_, f64>, f: &[f64]) -> End {
        let mut out = End::default();
        push.each(|c, o, w, x| {
            // As for particles: half of the kick leads to the instant, all of it to half a step later.
            let kick = instant.dt * self.inverse_inertia[o];
            let (v, [own, later]) = (instant.v_half[o], [self.decided[o], self.proposed[o]]);
            let (all, same) = (own[0] + own[1], sign(x));
            out.middle[c] += w * (v + kick * (0.5 * (f[o] + later[same]) + all));
            out.after[c] += w * (v + kick * (f[o] + all + later[0] + later[1]));
            out.decided[c] += w * kick * own[same];
            out.inverse_inertia[c] += w * w * self.inverse_inertia[o];
        });
        out
    }

    /// Proposes a push.
    pub(super) fn propose(&mut self, push: &Push) {
        push.each(|_, o, w, x| self.proposed[o][sign(x)] += w * x);
    }

    /// Withdraws what [`Self::propose`] proposed.
    pub(super) fn withdraw(&mut self, push: &Push) {
        push.each(|_, o, w, x| self.proposed[o][sign(x)] -= w * x);
    }

    /// Adds a push that has been decided.
    pub(super) fn decide(&mut self, push: &Push) {
        push.each(|_, o, w, x| self.decided[o][sign(x)] += w * x);
    }

    /// Moves the forces at the place of a push to `f`. A second call for the same nodes adds nothing.
    pub(super) fn deliver(&mut self, push: &Push, f: &mut [f64]) {
        push.each(|_, o, _, _| {
            // What is left of proposals is round-off.
            self.proposed[o] = [0.0; 2];
            let [positive, negative] = std::mem::take(&mut self.decided[o]);
            f[o] += positive + negative;
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// Of two pushes on a node to the same side, the first counts half of what the second proposes, and the
    /// second gets as much of what the first was given; pushes to opposite sides share nothing.
    #[test]
    fn only_pushes_to_the_same_side_share_their_work() {
        let (dt, mass, f) = (0.5, 2.0, [0.0; 3]);
        let instant = Instant {
            time: 0.0,
            dt,
            number: 1,
            q: &f,
            v_half: &f,
            internal: &f,
            internal_before: &f,
        };
        let push = |x: f64| Push {
            place: Place::node(0),
            turning: None,
            force: Vector3::new(x, 0.0, 0.0),
            torque: Vector3::zeros(),
        };
        for (other, shared) in [(3.0, 3.0), (-3.0, 0.0)] {
            let mut forces = StepForces::new(vec![1.0 / mass; 3]);
            forces.propose(&push(other));
            let first = forces.end(&push(1.0), &instant, &f);
            assert_abs_diff_eq!(first.middle[0], 0.5 * dt * shared / mass);
            assert_abs_diff_eq!(first.after[0], dt * other / mass);
            forces.withdraw(&push(other));
            forces.decide(&push(other));
            let second = forces.end(&push(1.0), &instant, &f);
            assert_abs_diff_eq!(second.middle[0], dt * other / mass);
            assert_abs_diff_eq!(second.decided[0], dt * shared / mass);
        }
    }
}

//! Energy budgets: a contact gives back at most the energy that it took in.
//!
//! In velocity Verlet the force `F` of an instant works on the mean of the velocities before and after it.
//! Scaled by `s` it does the work
//!
//! ```text
//! W(s) = s b + s^2 a - c  a = dt^2/2 F.M^-1 F      b = dt F.u      u = v_- + dt/2 M^-1 (f + h) + dt M^-1 g
//!                         c = dt^2/2 F.M^-1 g
//! ```
//!
//! with the other forces `f` of the instant, the forces `g` of the contacts that were taken before this
//! one, and those `h` that the contacts after it would have if they were not scaled; in `h`, and in the `g`
//! of `c`, only components with the sign of `F` count. Contacts are taken one after the other, so their
//! works sum to what the ledger books, `dt F.(v_- + v_+)/2`, however many contacts share a particle. Two
//! contacts that push a node to the same side have half of their common work each, so contacts at rest do
//! none. With `h = 0` and `c = 0` the first of them would take in what the second gives, in each step, and
//! the budgets would scale forces that balance each other. `c` is never negative: a contact may always give
//! up its force. The budget of a contact is the energy that it took in since touch, and `s` is the largest
//! number up to one whose work the budget covers. A spring alone does not conserve energy: it closes and
//! opens between two instants, which adds or removes up to `(omega dt)^2/4` of the energy of the approach.
//!
//! Multipliers, and effects that are computed later, act on the ends in a way that the contact learns in the
//! next step ([`Spring::settle`]). If it has opened by then, it cannot give energy back. It therefore holds
//! back the work that twice the largest such change of the last steps would do.
//!
//! An elastic contact that is about to open in this step gives back the rest of its budget. The rebound is
//! then elastic to round-off with any step; otherwise every other collision would lose a few per cent.

use super::law::{ContactLaw, Pair, Response, Spring};
use nalgebra::Vector3;

/// Largest change by unknown forces for which a contact holds energy back, over the largest of the last
/// steps.
const SAFETY: f64 = 2.0;

/// One end of a contact during the step: three displacements and three rotations.
#[derive(Debug, Clone, Copy, Default)]
pub struct End {
    /// Velocity `u` on which the next contact does its work.
    pub middle: [f64; 6],
    /// Velocity after the step from the forces known so far.
    pub after: [f64; 6],
    /// Part of the velocities from contacts that knew the unscaled force of the next contact.
    pub decided: [f64; 6],
    /// Inverse inertia; zero where the motion is prescribed.
    pub inverse_inertia: [f64; 6],
}

impl End {
    /// Power of a force and a torque on the velocities after the step \[W\].
    #[must_use]
    pub fn power(&self, force: &Vector3<f64>, torque: &Vector3<f64>) -> f64 {
        let three = |c: usize| Vector3::new(self.after[c], self.after[c + 1], self.after[c + 2]);
        force.dot(&three(0)) + torque.dot(&three(3))
    }
}

/// Work of a response over the step: `s linear + s^2 square - credit` if the response is scaled by `s` \[J\].
#[derive(Debug, Clone, Copy)]
struct Work {
    linear: f64,
    square: f64,
    credit: f64,
}

impl Work {
    fn from_response(r: &Response, ends: [&End; 2], dt: f64) -> Self {
        let (mut linear, mut square, mut credit) = (0.0, 0.0, 0.0);
        for (e, (end, sign)) in ends.into_iter().zip([-1.0, 1.0]).enumerate() {
            for c in 0..6 {
                let f = if c < 3 {
                    sign * r.force[c]
                } else {
                    r.torque[e][c - 3]
                };
                // Work of the force on the velocity half a step on, and on the velocity that the force itself
                // adds.
                linear += f * end.middle[c];
                square += f * f * end.inverse_inertia[c];
                credit += f * end.decided[c];
            }
        }
        Self {
            linear: dt * linear,
            square: 0.5 * dt * dt * square,
            credit: 0.5 * dt * credit,
        }
    }

    /// Returns the work if unknown forces make it larger by `reserve` \[J\].
    fn with_reserve(&self, reserve: f64) -> Self {
        Self {
            linear: self.linear + reserve,
            ..*self
        }
    }

    fn at_scale(&self, s: f64) -> f64 {
        s * (self.linear + s * self.square) - self.credit
    }

    /// Returns the largest scale whose work is at most `budget`. If there is none (a negative budget),
    /// returns the scale with the least work.
    fn scale(&self, budget: f64) -> f64 {
        let (a, b, budget) = (self.square, self.linear, budget + self.credit);
        if a <= 0.0 {
            // Both ends are driven, so the work is linear in the scale.
            return if b > 0.0 { (budget / b).max(0.0) } else { 1.0 };
        }
        let root = (b * b + 4.0 * a * budget).max(0.0).sqrt();
        // Avoids cancellation in `root - b`.
        let s = if b > 0.0 && budget > 0.0 {
            2.0 * budget / (b + root)
        } else {
            (root - b) / (2.0 * a)
        };
        s.max(0.0)
    }
}

/// Response of a closed contact by the law alone, before its budget limits it.
#[derive(Debug, Clone, Copy)]
pub struct Proposal {
    /// Forces and energy.
    pub response: Response,
    /// Unit vector from the first body to the second, and the overlap \[m\].
    normal: Vector3<f64>,
    gap: f64,
}

/// The contact law with the state that all contacts of a run share.
#[derive(Debug)]
pub struct BudgetedLaw {
    /// The law.
    pub law: ContactLaw,
    damping_ratio: f64,
    /// True once a step has been made.
    pub begun: bool,
    /// Energy of contacts that were closed when the run began \[J\].
    pub supplied: f64,
}

impl BudgetedLaw {
    /// A law whose contacts have budgets.
    #[must_use]
    pub fn new(law: ContactLaw) -> Self {
        Self {
            damping_ratio: law.damping_ratio(),
            law,
            begun: false,
            supplied: 0.0,
        }
    }

    /// Fraction of critical damping of the law.
    #[must_use]
    pub fn damping_ratio(&self) -> f64 {
        self.damping_ratio
    }

    /// Must be called before the contacts of a step.
    pub fn begin(&mut self, dt: f64) {
        if dt > 0.0 && !self.begun {
            // The first step replaces the energies of the instant before it.
            self.supplied = 0.0;
        }
    }

    /// Must be called after the contacts of a step.
    pub fn end(&mut self, dt: f64) {
        self.begun |= dt > 0.0;
    }

    /// Computes the response of a closed contact within its budget.
    ///
    /// `ends` is called only in steps (`dt > 0`). The first body feels no torque unless `turns`.
    pub fn respond(
        &mut self,
        pair: &Pair,
        turns: bool,
        ends: impl FnOnce() -> [End; 2],
        dt: f64,
        spring: &mut Spring,
    ) -> Response {
        let proposal = self.propose(pair, turns, dt, spring);
        self.decide(&proposal, ends, dt, spring)
    }

    /// Computes the response of a closed contact by the law alone and advances its spring. The first body
    /// feels no torque unless `turns`.
    pub fn propose(&mut self, pair: &Pair, turns: bool, dt: f64, spring: &mut Spring) -> Proposal {
        let old = spring.closed;
        let mut r = self.law.respond(pair, self.damping_ratio, dt, spring);
        if !turns {
            r.torque[0] = Vector3::zeros();
        }
        if dt > 0.0 {
            if old && !self.begun {
                // Starting energy `k/2 q_0 q_1` of a contact that was closed when the run began: the
                // geometric mean of its energies at both instants.
                spring.budget = (spring.budget * r.stored).sqrt();
                self.supplied += spring.budget;
            }
        } else {
            spring.budget = r.stored;
            self.supplied += r.stored;
        }
        Proposal {
            response: r,
            normal: pair.normal,
            gap: pair.gap,
        }
    }

    /// Scales a proposed response so that the budget of the contact covers its work. `ends` is called only in
    /// steps (`dt > 0`).
    pub fn decide(
        &self,
        proposal: &Proposal,
        ends: impl FnOnce() -> [End; 2],
        dt: f64,
        spring: &mut Spring,
    ) -> Response {
        if dt > 0.0 {
            let [a, b] = ends();
            return spend(proposal, [&a, &b], dt, self.damping_ratio <= 0.0, spring);
        }
        proposal.response
    }
}

/// Scales a response so that its budget covers the work, deducts the work from the budget and sets the stored
/// energy at this instant. An `elastic` contact that opens gives back the rest.
fn spend(p: &Proposal, ends: [&End; 2], dt: f64, elastic: bool, spring: &mut Spring) -> Response {
    let mut r = p.response;
    let work = Work::from_response(&r, ends, dt);
    let reserve = SAFETY * 0.5 * dt * r.force.norm() * spring.unknown;
    let dearest = work.with_reserve(reserve);
    let mut wanted = 1.0;
    if elastic {
        let three = |x: &[f64; 6]| Vector3::new(x[0], x[1], x[2]);
        let inverse_mass = |end: &End| {
            Vector3::new(
                end.inverse_inertia[0],
                end.inverse_inertia[1],
                end.inverse_inertia[2],
            )
        };
        let kick = r
            .force
            .component_mul(&(inverse_mass(ends[0]) + inverse_mass(ends[1])))
            * dt;
        let leaving = (three(&ends[1].after) - three(&ends[0].after) + kick).dot(&p.normal);
        let far = dt * leaving;
        if far >= p.gap {
            // Twice the energy by which touching and parting between two instants can differ.
            let slack = 0.25 * r.stiffness * far * far;
            // May exceed one: a contact that opens gives back all that is left.
            wanted = dearest
                .scale((dearest.at_scale(1.0) + slack).min(spring.budget))
                .max(wanted);
        }
    }
    let s = wanted.min(dearest.scale(spring.budget));
    r.force *= s;
    r.torque.iter_mut().for_each(|t| *t *= s);
    let done = work.at_scale(s);
    // Half of the work is done in the half step before this instant; what is held back is not stored.
    r.stored = r.stored.min(spring.budget - 0.5 * done - reserve).max(0.0);
    spring.budget -= done;
    r
}

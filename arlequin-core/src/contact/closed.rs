//! Closed contacts of the points of a surface: their law, springs and budgets, and the responses of the last
//! step.

use super::place::Place;
use super::{BudgetedLaw, ContactLaw, End, Proposal, Response, Spring};
use crate::record::Record;
use nalgebra::Vector3;

/// Numbers and integers of a closed contact in a record.
const WIDTH: (usize, usize) = (12, 5);
/// Numbers of a spring in a record.
const SPRING: usize = Spring::NUMBERS;

/// Name of the figure that tells by how much a surface has turned where it touches or is pressed. The surface
/// of a linear model strains by half of its square.
pub const LARGEST_TURN: &str = "largest turn of the surface [rad]";

/// Name of a figure of contacts without damping and friction: the energy that they still held when they
/// opened, over the energy that they took in. An exact contact loses none. A loss shows that the contact is
/// too soft, or that a point slipped off a rim.
pub const PART_LOST: &str = "part of the energy that elastic contacts lost";

/// Figure of the largest turn, from the cosine of its angle.
pub(crate) fn largest_turn(cosine: f64) -> (String, f64) {
    (LARGEST_TURN.into(), cosine.clamp(-1.0, 1.0).acos())
}

/// A closed contact and its response in the last step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Active {
    pub(super) point: u32,
    /// Place on the facet that the point touches; none for a rigid body.
    pub(super) foot: Place,
    /// Force on the point \[N\].
    pub(super) force: Vector3<f64>,
    /// Torque \[N m\] on the point if it is a sphere.
    pub(super) torque: Vector3<f64>,
    pub(super) stored: f64,
    /// Power on the velocities after the step, from the forces that were known \[W\].
    pub(super) expected: f64,
}

/// A contact that is closed at this instant, before its budget limits it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposed {
    pub(super) point: u32,
    /// Place on the facet that the point touches; none for a rigid body.
    pub(super) foot: Place,
    pub(super) proposal: Proposal,
}

/// Contacts of some points, of which each has one spring.
#[derive(Debug)]
pub(super) struct Closed {
    pub(super) law: BudgetedLaw,
    pub(super) springs: Vec<Spring>,
    pub(super) active: Vec<Active>,
    pub(super) proposed: Vec<Proposed>,
    backwards: bool,
    /// Energy \[J\] that contacts gave beyond their budgets, by forces that they did not know. All contacts
    /// repay it.
    debt: f64,
    /// Energy that all contacts have taken in so far \[J\].
    taken: f64,
    /// Energy that contacts without damping and friction still held when they opened \[J\]: it is lost.
    lost: f64,
    /// Smallest cosine of the angle by which a facet in contact has turned since rest.
    turn: f64,
}

impl Closed {
    pub(super) fn new(law: ContactLaw, points: usize) -> Self {
        Self {
            law: BudgetedLaw::new(law),
            springs: vec![Spring::default(); points],
            active: Vec::new(),
            proposed: Vec::new(),
            backwards: false,
            debt: 0.0,
            taken: 0.0,
            lost: 0.0,
            turn: 1.0,
        }
    }

    /// Corrects the budgets for forces in the last step that were unknown when contacts were computed.
    /// `power` is that of a contact on the velocities after the step.
    pub(super) fn settle(&mut self, dt: f64, power: impl Fn(&Active) -> f64) {
        // The first step gives all contacts that it finds closed their budgets.
        let active: &[Active] = if self.law.begun { &self.active } else { &[] };
        for a in active {
            let spring = &mut self.springs[a.point as usize];
            spring.settle(dt, power(a) - a.expected, a.force.norm());
            self.debt -= spring.budget.min(0.0);
            spring.budget = spring.budget.max(0.0);
        }
    }

    /// Takes the power of each contact on the velocities after the step, from all forces known now.
    pub(super) fn expect(&mut self, power: impl Fn(&Active) -> f64) {
        self.active.iter_mut().for_each(|a| a.expected = power(a));
    }

    /// Begins a step of length `dt` \[s\]: forgets the responses of the last one.
    pub(super) fn begin(&mut self, dt: f64) {
        self.active.clear();
        self.proposed.clear();
        self.law.begin(dt);
    }

    /// Ends a step. The order of the contacts is reversed in the next one.
    pub(super) fn end(&mut self, dt: f64) {
        self.law.end(dt);
        self.backwards = !self.backwards;
    }

    /// Number of the `n`-th of `count` contacts in this step.
    pub(super) fn turn(&self, n: usize, count: usize) -> usize {
        if self.backwards { count - 1 - n } else { n }
    }

    /// Opens the contact of a point: it forgets its sliding and its budget.
    pub(super) fn open(&mut self, point: usize) {
        let held = self.finish(point);
        let is_elastic = self.law.damping_ratio() <= 0.0 && self.law.law.friction <= 0.0;
        self.lost += if is_elastic { held } else { 0.0 };
    }

    /// Ends the contact of a point, whose place another model takes or whose weight grows. Returns the energy
    /// that it held \[J\].
    pub(super) fn finish(&mut self, point: usize) -> f64 {
        if !self.springs[point].closed {
            return 0.0;
        }
        self.repay(point);
        std::mem::take(&mut self.springs[point]).budget
    }

    /// Lets contacts lose force after a change of weights: each keeps the part that `part` returns, and a
    /// part of zero ends it.
    pub(super) fn weaken(&mut self, mut part: impl FnMut(&Active) -> f64) {
        let mut active = std::mem::take(&mut self.active);
        active.retain_mut(|a| {
            let part = part(a);
            if part <= 0.0 {
                self.finish(a.point as usize);
            }
            // The power that is expected remains that of the whole force: budgets are settled by what the
            // part does.
            (a.force, a.torque, a.stored) = (a.force * part, a.torque * part, a.stored * part);
            part > 0.0
        });
        self.active = active;
    }

    /// Lets a contact repay the debt of the effect from its own budget.
    fn repay(&mut self, point: usize) {
        let budget = &mut self.springs[point].budget;
        let paid = budget.max(0.0).min(self.debt);
        *budget -= paid;
        self.debt -= paid;
    }

    /// Scales a proposed response so that the budget of the contact, less the debt, covers its work.
    pub(super) fn decide(&mut self, p: &Proposed, ends: [End; 2], dt: f64) -> Response {
        let point = p.point as usize;
        self.repay(point);
        let spring = &mut self.springs[point];
        let before = spring.budget;
        let response = self.law.decide(&p.proposal, || ends, dt, spring);
        self.taken += (spring.budget - before).max(0.0);
        response
    }

    /// Records the cosine of the angle by which a facet in contact has turned since rest, if it is the
    /// smallest.
    pub(super) fn turned(&mut self, cosine: f64) {
        self.turn = self.turn.min(cosine);
    }

    /// Figures for reports: names (with units) and values.
    pub(super) fn facts(&self) -> [(String, f64); 3] {
        let part = self.lost / self.taken.max(f64::MIN_POSITIVE);
        [
            ("contacts".into(), self.active.len() as f64),
            largest_turn(self.turn),
            (PART_LOST.into(), part),
        ]
    }

    /// Energy of the springs \[J\], less the debt.
    pub(super) fn stored(&self) -> f64 {
        let springs = self.active.iter().fold(0.0, |sum, a| sum + a.stored);
        (springs - self.debt).max(0.0)
    }

    /// Appends the state to a record.
    pub(super) fn save(&self, out: &mut Record<f64>) {
        let closed = || self.springs.iter().enumerate().filter(|s| s.1.closed);
        let flags = [self.law.begun, self.backwards].map(u64::from);
        out.integers.extend(flags);
        out.integers.push(closed().count() as u64);
        out.numbers
            .extend([self.law.supplied, self.turn, self.debt, self.taken, self.lost]);
        for (k, spring) in closed() {
            out.integers.push(k as u64);
            out.numbers.extend(spring.numbers());
        }
        for a in &self.active {
            out.integers.push(u64::from(a.point));
            out.integers.extend(a.foot.nodes.map(u64::from));
            out.numbers.extend(a.force.iter().chain(a.torque.iter()));
            out.numbers.extend([a.stored, a.expected]);
            out.numbers.extend(a.foot.weights);
        }
    }

    /// Restores what [`Self::save`] wrote; `None` for a record of other points. `nodes` is the number of
    /// nodes of the model on which a point has its foot.
    pub(super) fn restore(
        &mut self,
        integers: &[u64],
        numbers: &[f64],
        nodes: impl Fn(u32) -> usize,
    ) -> Option<()> {
        let (&[begun, backwards, closed], integers) = integers.split_first_chunk::<3>()?;
        let (&[supplied, turn, debt, taken, lost], numbers) = numbers.split_first_chunk::<5>()?;
        let closed = usize::try_from(closed).ok()?;
        let (places, integers) = integers.split_at_checked(closed)?;
        let (springs, numbers) = numbers.split_at_checked(closed.checked_mul(SPRING)?)?;
        let (integers, numbers) = (
            integers.as_chunks::<{ WIDTH.1 }>(),
            numbers.as_chunks::<{ WIDTH.0 }>(),
        );
        if integers.0.len() != numbers.0.len() || !integers.1.is_empty() || !numbers.1.is_empty() {
            return None;
        }
        (self.law.supplied, self.turn, self.debt) = (supplied, turn, debt);
        (self.taken, self.lost) = (taken, lost);
        [self.law.begun, self.backwards] = [begun == 1, backwards == 1];
        self.springs.fill(Spring::default());
        for (k, x) in places.iter().zip(springs.as_chunks::<SPRING>().0) {
            *self.springs.get_mut(usize::try_from(*k).ok()?)? = Spring::from_numbers(true, *x);
        }
        self.active.clear();
        for (places, x) in integers.0.iter().zip(numbers.0) {
            let [point, foot @ ..] = *places;
            if point as usize >= self.springs.len() || foot.iter().any(|n| *n as usize >= nodes(point as u32))
            {
                return None;
            }
            self.active.push(Active {
                point: point as u32,
                foot: Place {
                    nodes: foot.map(|n| n as u32),
                    weights: [x[8], x[9], x[10], x[11]],
                },
                force: Vector3::new(x[0], x[1], x[2]),
                torque: Vector3::new(x[3], x[4], x[5]),
                stored: x[6],
                expected: x[7],
            });
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Pair, Twist};
    use approx::assert_abs_diff_eq;

    /// What contacts give too much is a debt: it outlives the contact and a restart, counts against what is
    /// stored, and is repaid by others before they give anything back.
    #[test]
    fn others_repay_what_a_contact_has_given_too_much() {
        let mut closed = Closed::new(ContactLaw::elastic(1e9), 2);
        closed.law.begun = true;
        let contact = |point: u32| Active {
            point,
            foot: Place::default(),
            force: Vector3::x(),
            torque: Vector3::zeros(),
            stored: 0.75,
            expected: 0.0,
        };
        closed.active = vec![contact(0), contact(1)];
        for (spring, budget) in closed.springs.iter_mut().zip([0.25, 2.0]) {
            *spring = Spring {
                closed: true,
                budget,
                ..Spring::default()
            };
        }
        // Half of 2.5 W in a step of one second: the first contact lacks 1 J.
        closed.settle(1.0, |a| if a.point == 0 { 2.5 } else { 0.0 });
        assert_abs_diff_eq!(closed.springs[0].budget, 0.0);
        assert_abs_diff_eq!(closed.debt, 1.0);
        assert_abs_diff_eq!(closed.stored(), 0.5);
        closed.open(0);
        let mut record = Record::default();
        closed.save(&mut record);
        let mut closed = Closed::new(ContactLaw::elastic(1e9), 2);
        closed.restore(&record.integers, &record.numbers, |_| 1).unwrap();
        closed.repay(1);
        assert_abs_diff_eq!(closed.springs[1].budget, 1.0);
        assert_abs_diff_eq!(closed.debt, 0.0);
        // What a contact has left when it opens pays as well.
        closed.debt = 1.5;
        closed.open(1);
        assert_abs_diff_eq!(closed.debt, 0.5);
    }

    /// A contact takes in 2 J and opens with 1 J left: half is lost if the law is elastic. A restart keeps
    /// the figures.
    #[test]
    fn what_elastic_contacts_keep_and_how_far_they_turn_are_figures_that_outlive_a_restart() {
        for (law, lost) in [
            (ContactLaw::elastic(1e9), 0.5),
            (
                ContactLaw {
                    friction: 0.1,
                    ..ContactLaw::elastic(1e9)
                },
                0.0,
            ),
            (
                ContactLaw {
                    restitution: 0.5,
                    ..ContactLaw::elastic(1e9)
                },
                0.0,
            ),
        ] {
            let mut closed = Closed::new(law, 1);
            closed.law.begun = true;
            closed.turned(0.2_f64.cos());
            closed.springs[0].closed = true;
            let pair = Pair {
                normal: Vector3::x(),
                gap: 1e-3,
                stiffness: 1.0,
                reduced_radius: 0.0,
                arms: [0.0; 2],
                share: 1.0,
                inverse_mass: 1.0,
                motion: [Twist::zero(); 2],
            };
            let proposal = closed.law.propose(&pair, false, 1.0, &mut closed.springs[0]);
            let proposed = Proposed {
                point: 0,
                foot: Place::default(),
                proposal,
            };
            // The end comes closer: the force works against its speed, so the contact takes energy in.
            let mut end = End::default();
            end.middle[0] = -2.0 / proposal.response.force.x;
            closed.decide(&proposed, [End::default(), end], 1.0);
            assert_abs_diff_eq!(closed.springs[0].budget, 2.0, epsilon = 1e-14);
            closed.springs[0].budget = 1.0;
            closed.open(0);
            let mut record = Record::default();
            closed.save(&mut record);
            let mut again = Closed::new(law, 1);
            again.restore(&record.integers, &record.numbers, |_| 1).unwrap();
            for [_, turn, part] in [closed.facts(), again.facts()] {
                assert_abs_diff_eq!(turn.1, 0.2, epsilon = 1e-14);
                assert_abs_diff_eq!(part.1, lost, epsilon = 1e-14);
            }
        }
    }

    /// A contact that falls asleep ends, and the energy that it held is no loss of an elastic contact; one
    /// that loses weight keeps as much force.
    #[test]
    fn a_change_of_weights_weakens_contacts_and_ends_those_that_sleep() {
        let mut closed = Closed::new(ContactLaw::elastic(1e9), 2);
        closed.taken = 2.0;
        for point in 0..2 {
            closed.springs[point].closed = true;
            closed.springs[point].budget = 1.0;
            closed.active.push(Active {
                point: point as u32,
                foot: Place::default(),
                force: Vector3::x(),
                torque: Vector3::y(),
                stored: 0.5,
                expected: 3.0,
            });
        }
        closed.weaken(|a| f64::from(a.point) * 0.25);
        let [a] = closed.active[..] else {
            panic!("{:?}", closed.active)
        };
        assert!(!closed.springs[0].closed && closed.springs[1].closed);
        assert_eq!(
            (a.point, a.force.x, a.torque.y, a.stored, a.expected),
            (1, 0.25, 0.25, 0.125, 3.0)
        );
        assert_abs_diff_eq!(closed.facts()[2].1, 0.0);
    }
}

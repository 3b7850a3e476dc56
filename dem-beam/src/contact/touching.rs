//! Closed contacts between the particles of one model or of two.

use super::grains::{self, Grains};
use super::neighbours::Listed;
use arlequin_core::Exact;
use arlequin_core::contact::{BudgetedLaw, ContactLaw, Pair, Spring};
use arlequin_core::effect::{Instant, StepDemand};
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;

/// Allowance for the critical step: contacts of full stiffness that a particle may have beside its bonds.
pub const STIFF_CONTACTS: f64 = 4.0;

/// Allowance for the critical step: contacts of a particle that may be damped at the same time.
pub const DAMPED_CONTACTS: f64 = 2.0;

/// Numbers and integers of a closed contact in a record.
const WIDTH: [usize; 2] = [11, 1];

/// A closed contact: its particles and its response in the last step.
#[derive(Debug, Clone, Copy)]
struct Active {
    /// Place in the list.
    pair: usize,
    ends: [u32; 2],
    /// Force on the second particle \[N\]; the first feels the opposite force.
    force: Vector3<f64>,
    /// Generalised torques on both particles \[N m\].
    torque: [Vector3<f64>; 2],
    stored: f64,
    /// Power \[W\] of the force on the velocities after the step, as the forces known at its instant give
    /// them.
    expected: f64,
}

/// Contacts of a list: their law, their responses, and the state they keep beside their springs.
///
/// `grains`, instants and forces come in slices of one element (both ends in the same model) or of two (first
/// ends in the first model).
#[derive(Debug)]
pub(crate) struct Touching {
    law: BudgetedLaw,
    active: Vec<Active>,
    calls: usize,
    top_contacts: usize,
}

impl Touching {
    /// Number of integers that precede the closed contacts in a record.
    pub(crate) const COUNTS: usize = 4;

    pub(crate) fn new(law: ContactLaw) -> Self {
        Self {
            law: BudgetedLaw::new(law),
            active: Vec::new(),
            calls: 0,
            top_contacts: 0,
        }
    }

    /// Corrects the budgets for the work of forces in the last step that were unknown when contacts were
    /// computed: multipliers, prescribed motion, later effects. Must be called before the list changes.
    pub(crate) fn settle(&mut self, listed: &mut Listed, instants: &[Instant<'_, f64>]) {
        self.calls += 1;
        let dt = instants[0].dt;
        for a in &self.active {
            let power = a.power([instants[0].v_half, instants[instants.len() - 1].v_half]);
            listed.springs.get_mut(a.pair).budget -= 0.5 * dt * (power - a.expected);
        }
    }

    /// Returns whether forces have been computed at an earlier instant.
    pub(crate) fn has_been_called(&self) -> bool {
        self.calls > 0
    }

    /// Computes all closed contacts and adds their forces to `f`, pair after pair. The pairs must have been
    /// measured.
    ///
    /// # Errors
    /// [`arlequin_core::Error::InvalidParameter`] for a particle that has sunk into another by the smaller
    /// radius: they would leave each other on the wrong side.
    pub(crate) fn respond(
        &mut self,
        listed: &mut Listed,
        grains: &mut [Grains],
        instants: &[Instant<'_, f64>],
        f: &mut [&mut [f64]],
    ) -> arlequin_core::Result<()> {
        self.active.clear();
        self.law.begin(instants[0].dt);
        let (count, last) = (listed.touching().len(), grains.len() - 1);
        // Sequential: a contact works on the velocity that the contacts before it have left.
        for n in 0..count {
            // The order alternates: energy that a particle shared by two contacts moves between their budgets
            // then evens out over the steps.
            let place = if self.calls.is_multiple_of(2) {
                n
            } else {
                count - 1 - n
            };
            let (k, overlap) = listed.touching()[place];
            let ends = listed.pairs[k].ends;
            // A particle that sleeps is where it fell asleep: it touches nothing.
            if overlap > 0.0 && grains[0].is_awake(ends[0]) && grains[last].is_awake(ends[1]) {
                check_overlap(ends, overlap, grains)?;
                self.close((k, ends, overlap), listed.springs.get_mut(k), grains, instants, f);
            } else {
                // An open contact forgets its sliding, its rolling and its budget.
                listed.springs.take(k);
            }
        }
        self.law.end(instants[0].dt);
        // The expected power needs the forces of all contacts, so it follows the loop.
        for a in &mut self.active {
            let [i, j] = a.ends.map(|e| e as usize);
            let after = [
                grains[0].end(&instants[0], f[0], i).after,
                grains[last].end(&instants[last], f[last], j).after,
            ];
            a.expected = a.power_of_ends(after);
        }
        for a in &self.active {
            for (m, e) in [0, last].into_iter().zip(a.ends) {
                grains[m].deliver(e as usize, f[m]);
            }
        }
        self.top_contacts = self.top_contacts.max(self.active.len());
        Ok(())
    }

    fn close(
        &mut self,
        (k, ends, overlap): (usize, [u32; 2], f64),
        spring: &mut Spring,
        grains: &mut [Grains],
        instants: &[Instant<'_, f64>],
        f: &[&mut [f64]],
    ) {
        let [i, j] = ends.map(|e| e as usize);
        let last = grains.len() - 1;
        let pair = pair(
            &self.law.law,
            [&grains[0], &grains[last]],
            [i, j],
            overlap,
            instants,
        );
        let end_states = || {
            [
                grains[0].end(&instants[0], f[0], i),
                grains[last].end(&instants[last], f[last], j),
            ]
        };
        let r = self.law.respond(&pair, true, end_states, instants[0].dt, spring);
        grains[0].push(i, &-r.force, &r.torque[0]);
        grains[last].push(j, &r.force, &r.torque[1]);
        self.active.push(Active {
            pair: k,
            ends,
            force: r.force,
            torque: r.torque,
            stored: r.stored,
            expected: 0.0,
        });
    }

    /// Lets contacts lose as much force as share after a change of weights, and ends those of particles that
    /// sleep: a kept force would throw what has become light. `before` are the shares of both ends' models.
    pub(crate) fn weaken(&mut self, listed: &mut Listed, grains: &[Grains], before: [&[f64]; 2]) {
        let last = &grains[grains.len() - 1];
        self.active.retain_mut(|a| {
            let [i, j] = a.ends.map(|e| e as usize);
            let part = grains[0].share(i).min(last.share(j)) / before[0][i].min(before[1][j]);
            if part <= 0.0 {
                listed.springs.take(a.pair);
            } else if part < 1.0 {
                a.force *= part;
                a.torque.iter_mut().for_each(|t| *t *= part);
                a.stored *= part;
            }
            part > 0.0
        });
    }

    /// Adds the forces on the particles of one of two models.
    pub(crate) fn add_to(&self, side: usize, f: &mut [f64]) {
        for a in &self.active {
            let force = if side == 0 { -a.force } else { a.force };
            grains::add(f, a.ends[side] as usize, &force, &a.torque[side]);
        }
    }

    pub(crate) fn power(&self, v: [&[f64]; 2]) -> f64 {
        self.active.iter().map(|a| a.power(v)).sum()
    }

    /// Adds the power of each end for which `local` returns a number, within one model, as separate terms.
    pub(crate) fn add_power(&self, v: &[f64], local: &dyn Fn(usize) -> Option<usize>, sum: &mut Exact) {
        for (i, force, torque) in self.end_forces(local) {
            sum.add(grains::power(v, i, &force, &torque));
        }
    }

    /// Iterates over forces and torques on all ends within one model for which `local` returns their number.
    pub(crate) fn end_forces<'a>(
        &'a self,
        local: &'a dyn Fn(usize) -> Option<usize>,
    ) -> impl Iterator<Item = (usize, Vector3<f64>, Vector3<f64>)> + 'a {
        let both_ends = move |a: &'a Active| {
            let signed = [-a.force, a.force];
            (0..2).filter_map(move |e| Some((local(a.ends[e] as usize)?, signed[e], a.torque[e])))
        };
        self.active.iter().flat_map(both_ends)
    }

    /// Renumbers the particles of the closed contacts.
    pub(crate) fn renumber(&mut self, number: impl Fn(u32) -> u32) {
        self.active.iter_mut().for_each(|a| a.ends = a.ends.map(&number));
    }

    /// Iterates over the list places of the pairs that pushed in the last step.
    pub(crate) fn pushing(&mut self) -> impl Iterator<Item = &mut usize> {
        self.active.iter_mut().map(|a| &mut a.pair)
    }

    pub(crate) fn stored(&self) -> f64 {
        self.active.iter().fold(0.0, |sum, a| sum + a.stored)
    }

    pub(crate) fn supplied(&self) -> f64 {
        self.law.supplied
    }

    /// Demand of contacts on the step, for particles with the largest `k/m` of `top` \[1/s²\].
    pub(crate) fn demand(&self, top: f64) -> StepDemand<f64> {
        let [stiffness, damping] = self.law.law.demand(top);
        StepDemand {
            stiffness: STIFF_CONTACTS * stiffness,
            damping: DAMPED_CONTACTS * damping,
            ..StepDemand::none()
        }
    }

    pub(crate) fn stiffness(&self, radii: [f64; 2]) -> f64 {
        self.law.law.stiffness(radii)
    }

    /// Figures for reports, with the numbers of searches and pairs of the list.
    pub(crate) fn facts(&self, [searches, pairs]: [usize; 2]) -> Vec<(String, f64)> {
        vec![
            ("contacts".into(), self.active.len() as f64),
            ("most contacts".into(), self.top_contacts as f64),
            ("neighbour searches".into(), searches as f64),
            ("listed pairs".into(), pairs as f64),
            ("calls".into(), self.calls as f64),
        ]
    }

    /// Writes the state. Integers: counts, then the pair of each closed contact. Numbers: energy at the
    /// start, then each contact.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        let counts = [
            self.calls,
            self.top_contacts,
            usize::from(self.law.begun),
            self.active.len(),
        ];
        out.integers.extend(counts.map(|c| c as u64));
        out.numbers.push(self.law.supplied);
        for a in &self.active {
            out.integers.push(a.pair as u64);
            for v in [&a.force, &a.torque[0], &a.torque[1]] {
                out.numbers.extend(v.iter());
            }
            out.numbers.extend([a.stored, a.expected]);
        }
    }

    /// Restores what [`Self::save`] wrote and returns the remaining integers and numbers. The list must be
    /// restored as well.
    pub(crate) fn restore<'a>(
        &mut self,
        integers: &'a [u64],
        numbers: &'a [f64],
    ) -> Option<(&'a [u64], &'a [f64])> {
        let (&[calls, top, begun, count], integers) = integers.split_first_chunk::<{ Self::COUNTS }>()?;
        let (&[supplied], numbers) = numbers.split_first_chunk::<1>()?;
        let count = usize::try_from(count).ok()?;
        let (pushes, integers) = integers.split_at_checked(count.checked_mul(WIDTH[1])?)?;
        let (pushed, numbers) = numbers.split_at_checked(count.checked_mul(WIDTH[0])?)?;
        (self.calls, self.top_contacts) = (calls as usize, top as usize);
        self.law.begun = begun == 1;
        self.law.supplied = supplied;
        self.active.clear();
        for (pair, x) in pushes.iter().zip(pushed.as_chunks::<11>().0) {
            let three = |k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
            self.active.push(Active {
                pair: *pair as usize,
                ends: [0; 2],
                force: three(0),
                torque: [three(3), three(6)],
                stored: x[9],
                expected: x[10],
            });
        }
        Some((integers, numbers))
    }

    /// Sets the particles of the restored contacts from the list; `None` if a pair is not in the list.
    pub(crate) fn find(&mut self, listed: &Listed) -> Option<()> {
        for a in &mut self.active {
            a.ends = listed.pairs.get(a.pair)?.ends;
        }
        Some(())
    }
}

impl Active {
    /// Power on the velocities `v` of the models of both ends \[W\].
    fn power(&self, v: [&[f64]; 2]) -> f64 {
        let [i, j] = self.ends.map(|e| e as usize);
        grains::power(v[0], i, &-self.force, &self.torque[0])
            + grains::power(v[1], j, &self.force, &self.torque[1])
    }

    /// Power on the velocities of both ends \[W\].
    fn power_of_ends(&self, ends: [[f64; 6]; 2]) -> f64 {
        let end_power = |v: &[f64; 6], force: &Vector3<f64>, torque: &Vector3<f64>| {
            force.dot(&grains::three(v, 0)) + torque.dot(&grains::three(v, 3))
        };
        end_power(&ends[0], &-self.force, &self.torque[0]) + end_power(&ends[1], &self.force, &self.torque[1])
    }
}

/// Returns an error for two particles that overlap by more than the smaller radius.
fn check_overlap(ends: [u32; 2], overlap: f64, grains: &[Grains]) -> arlequin_core::Result<()> {
    let [a, b] = [(0, ends[0]), (grains.len() - 1, ends[1])].map(|(m, e)| grains[m].now[e as usize]);
    let limit = a[3].min(b[3]);
    if overlap <= limit {
        return Ok(());
    }
    Err(arlequin_core::invalid(
        &format!(
            "overlap of two particles near ({:.3e}, {:.3e}, {:.3e}) m",
            a[0], a[1], a[2]
        ),
        format_args!("{overlap:.3e} m"),
        &format!(
            "must stay below the smaller radius {limit:.3e} m, or they may pass through each other: enlarge the modulus of the contact"
        ),
    ))
}

fn pair(
    law: &ContactLaw,
    grains: [&Grains; 2],
    [i, j]: [usize; 2],
    gap: f64,
    instants: &[Instant<'_, f64>],
) -> Pair {
    let (a, b) = (&grains[0].now[i], &grains[1].now[j]);
    let d = Vector3::new(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
    let distance = d.norm();
    Pair {
        // Any direction will do for centres in one place.
        normal: if distance > 0.0 {
            d / distance
        } else {
            Vector3::x()
        },
        gap,
        stiffness: law.stiffness([a[3], b[3]]),
        reduced_radius: a[3] * b[3] / (a[3] + b[3]),
        // The point of contact divides the distance of the centres in proportion to the radii.
        arms: [a[3], b[3]].map(|r| distance * r / (a[3] + b[3])),
        share: grains[0].share(i).min(grains[1].share(j)),
        inverse_mass: grains[0].inverse_mass(i) + grains[1].inverse_mass(j),
        motion: [
            grains[0].motion(&instants[0], i),
            grains[1].motion(&instants[instants.len() - 1], j),
        ],
    }
}

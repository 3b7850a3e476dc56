//! External solvers in the place of a model that the core steps.

use super::step::StepEnd;
use super::{Stepper, Subdomain};
use crate::interface::Transfer;
use crate::participant::{Outline, Participant};
use crate::record::Record;
use crate::weight::Weights;
use crate::{Error, Interpolation, Real, Result};
use std::sync::Arc;

/// External solver, and the data that the core keeps about it.
pub(super) struct External<T: Real> {
    solver: Box<dyn Participant<T>>,
    /// Working buffer: change of velocities, then the impulse of it.
    change: Vec<T>,
    /// Kinetic energy at the start and energy that impulses have brought since \[J\].
    received: T,
    /// Velocities that the solver should report after all impulses of this instant.
    due: Vec<T>,
    /// Sum `Σ |p|` over the impulses of this instant.
    given_impulse: T,
}

/// Relative error of a solver in single precision: four roundings (impulse, mass, quotient, sum), and as much
/// again for a solver that converts units.
const ROUNDED: f64 = 8.0 * f32::EPSILON as f64;

impl<T: Real> std::fmt::Debug for External<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Guest {}", self.solver.name())
    }
}

impl<T: Real> Subdomain<T> {
    /// Makes a subdomain of an external solver, with the field that interfaces and probes see. The solver
    /// owns its state: it takes no initial state, support or effect from the core.
    ///
    /// # Errors
    /// Errors of [`Participant::weigh`]; a layout that the core does not know, or nodes that do not fit the
    /// layout.
    pub fn participant(
        mut solver: Box<dyn Participant<T>>,
        field: Arc<dyn Interpolation<T>>,
        weights: Weights<T>,
    ) -> Result<Self> {
        let (layout, nodes) = (solver.layout(), solver.nodes().len());
        layout.check(solver.name())?;
        if nodes != layout.nodes {
            return Err(Error::SizeMismatch {
                what: format!("nodes of participant '{}'", solver.name()),
                expected: layout.nodes,
                found: nodes,
            });
        }
        let mut inertia = vec![T::zero(); layout.dofs()];
        // The partition check compares the weighted inertia with this one, without weights.
        solver.weigh(&Weights::uncoupled(), &mut inertia)?;
        let outline = Outline::new(&*solver, inertia);
        // Weights are the solver's business: the outline must not be weighted at its nodes.
        let mut out = Self::new(Box::new(outline), field, Weights::uncoupled());
        out.weights = weights;
        let external = External {
            solver,
            change: vec![T::zero(); layout.dofs()],
            received: T::zero(),
            due: vec![T::zero(); layout.dofs()],
            given_impulse: T::zero(),
        };
        out.stepper = Stepper::External(Box::new(external));
        Ok(out)
    }

    /// Returns whether an external solver makes the own steps.
    pub(crate) fn is_external(&self) -> bool {
        matches!(self.stepper, Stepper::External(_))
    }

    /// Passes the weights to an external solver; refuses supports, effects, initial states and the implicit
    /// scheme, which only models of the core can have.
    pub(super) fn weigh_external(&mut self, paired: bool) -> Result<()> {
        let Stepper::External(external) = &mut self.stepper else {
            return Ok(());
        };
        let is_at_rest = self.state.q.iter().chain(&self.state.v).all(|x| *x == T::zero());
        let what = if !self.supports.is_empty() {
            "a support"
        } else if !self.chosen.is_empty() || paired {
            "an effect"
        } else if !is_at_rest {
            "an initial state"
        } else if self.requested_step == super::OwnStep::Implicit {
            "the core's implicit scheme"
        } else {
            external.solver.weigh(&self.weights, &mut self.inertia)?;
            external.solver.displacements(&mut self.state.q);
            external.solver.velocities(&mut self.state.v);
            return Ok(());
        };
        Err(Error::Unsupported {
            model: external.solver.name().to_owned(),
            what: format!("have {what} of the core: it is a solver of its own; give it there"),
        })
    }

    /// Advances the external solver and reads its state.
    pub(super) fn external_step(&mut self, step_end: StepEnd<T>) -> Result<()> {
        let Stepper::External(external) = &mut self.stepper else {
            return Ok(());
        };
        external
            .solver
            .advance(step_end.time - step_end.since, step_end.since)?;
        external.solver.displacements(&mut self.state.q);
        external.solver.velocities(&mut self.state.v);
        // The impulses of the next reflections are added to this by `hand_over`.
        external.due.copy_from_slice(&self.state.v);
        external.given_impulse = T::zero();
        Ok(())
    }

    /// Reads the accelerations of an external solver at the start; zero if it reports none.
    pub(super) fn external_start(&mut self) {
        if let Stepper::External(external) = &mut self.stepper
            && !external.solver.accelerations(&mut self.state.a)
        {
            self.state.a.fill(T::zero());
        }
    }

    /// Passes the impulse of a whole reflection to an external solver; `half` is the half that is already in
    /// the velocities of this instant.
    pub(crate) fn hand_over(&mut self, half: &Transfer<T>) -> Result<()> {
        if let Stepper::External(external) = &mut self.stepper {
            external.change.fill(T::zero());
            half.kick(&mut external.change);
            let moving = self.model.layout().translations();
            external
                .due
                .iter_mut()
                .zip(&external.change)
                .for_each(|(v, half)| *v += *half + *half);
            for ((p, m), v) in external.change.iter_mut().zip(&self.inertia).zip(&self.state.v) {
                // Velocities are those in the middle of the impulse, so that `p·v` is exactly the energy it
                // brings.
                *p *= *m * T::of(2.0);
                external.received += *p * *v;
            }
            external.given_impulse += external.change[..moving].iter().map(|p| p.abs()).sum::<T>();
            external.solver.kick(&external.change)?;
        }
        Ok(())
    }

    /// Passes the impulse of the start to an external solver: the change that the projection made to its
    /// velocities, and all `halves` of reflections that are still to come.
    pub(crate) fn hand_over_start(&mut self, halves: &[&Transfer<T>]) -> Result<()> {
        if let Stepper::External(external) = &mut self.stepper {
            external.solver.velocities(&mut external.change);
            let half = T::of(0.5);
            // The solver goes on with the velocities after the first half reflections.
            let mut going = self.state.v.clone();
            halves.iter().for_each(|h| h.kick(&mut going));
            external.received = T::zero();
            for ((p, m), v) in external.change.iter_mut().zip(&self.inertia).zip(&going) {
                external.received += half * *m * *v * *v;
                *p = *m * (*v - *p);
            }
            external.solver.kick(&external.change)?;
        }
        Ok(())
    }

    /// Returns the invariant that an external solver reports, otherwise the energy it has received \[J\].
    pub(super) fn external_invariant(&mut self) -> T {
        let kinetic = self.kinetic_energy();
        let Stepper::External(external) = &self.stepper else {
            return kinetic;
        };
        let energy = external.solver.invariant().unwrap_or(external.received);
        self.energies.now = Some(energy - kinetic);
        energy
    }

    /// Returns whether the energy is known; that of an external solver is if it reports an invariant.
    pub(crate) fn reports_energy(&self) -> bool {
        match &self.stepper {
            Stepper::External(external) => external.solver.invariant().is_some(),
            _ => true,
        }
    }

    /// Returns the momentum by which the velocities of an external solver are off after the impulses of this
    /// step, and the part that round-off explains, both relative to `Σ |p|`. `None` if the solver reports an
    /// invariant or received no impulse.
    pub(crate) fn missed_impulse(&mut self) -> Option<[T; 2]> {
        if self.reports_energy() {
            return None;
        }
        let moving = self.model.layout().translations();
        let Stepper::External(external) = &mut self.stepper else {
            return None;
        };
        if external.given_impulse <= T::zero() {
            return None;
        }
        external.solver.velocities(&mut external.change);
        let reported = external.change[..moving]
            .iter()
            .zip(&external.due)
            .zip(&self.inertia);
        let (off, total) = reported.fold((T::zero(), T::zero()), |(off, total), ((v, due), m)| {
            (off + *m * (*v - *due).abs(), total + *m * due.abs())
        });
        // Velocities that are large beside their change have larger round-off.
        let rounded = T::of(ROUNDED) * (T::one() + total / external.given_impulse);
        Some([off / external.given_impulse, rounded])
    }

    /// Returns the state that the model saves. For an external solver, inertia, velocities, centre of mass
    /// and received energy follow, by which [`Self::restore_model`] recognises it.
    pub(super) fn save_model(&self) -> Result<Record<T>> {
        let Stepper::External(external) = &self.stepper else {
            return Ok(self.model.save());
        };
        let mut record = external.solver.save()?;
        let mut velocities = vec![T::zero(); self.inertia.len()];
        external.solver.velocities(&mut velocities);
        record.numbers.extend_from_slice(&self.inertia);
        record.numbers.extend(velocities);
        record.numbers.extend(self.centre());
        record.numbers.push(external.received);
        Ok(record)
    }

    /// Restores the state of [`Self::save_model`]; displacements are those of the snapshot already.
    pub(super) fn restore_model(&mut self, from: &Record<T>) -> Result<()> {
        let (n, centre) = (self.inertia.len(), self.centre());
        let Stepper::External(external) = &mut self.stepper else {
            return self.model.restore(from);
        };
        let mut record = from.clone();
        let solver_numbers = record.numbers.len().checked_sub(2 * n + centre.len() + 1);
        let saved = solver_numbers
            .map(|solver_numbers| record.numbers.split_off(solver_numbers))
            .unwrap_or_default();
        let name = external.solver.name().to_owned();
        let (Some((inertia, remainder)), true) = (saved.split_at_checked(n), !saved.is_empty()) else {
            return Err(Error::SizeMismatch {
                what: format!("what the checkpoint knows of the solver '{name}'"),
                expected: 2 * n + centre.len() + 1,
                found: from.numbers.len(),
            });
        };
        let (velocities, remainder) = remainder.split_at(n);
        let (place, received) = remainder.split_at(centre.len());
        same_as_saved(&name, "inertia of unknown", &self.inertia, inertia)?;
        same_as_saved(&name, "centre of mass along axis", &centre, place)?;
        external.solver.restore(&record)?;
        external.received = received[0];
        let mut reported = vec![T::zero(); n];
        external.solver.displacements(&mut reported);
        same_as_saved(&name, "displacement of unknown", &reported, &self.state.q)?;
        external.solver.velocities(&mut reported);
        same_as_saved(&name, "velocity of unknown", &reported, velocities)
    }

    /// Centre of mass at rest \[m\].
    fn centre(&self) -> [T; 3] {
        let (nodes, d) = (self.model.nodes(), self.model.layout().components);
        let mut sum = [T::zero(); 4];
        for (x, m) in nodes.iter().zip(self.inertia.chunks(d)) {
            (0..3).for_each(|c| sum[c] += m[0] * x[c]);
            sum[3] += m[0];
        }
        let [x, y, z, mass] = sum;
        [x, y, z].map(|s| if mass > T::zero() { s / mass } else { s })
    }
}

/// Refuses values that differ from those of a checkpoint by more than the round-off of a solver in single
/// precision.
fn same_as_saved<T: Real>(model: &str, what: &'static str, restored: &[T], saved: &[T]) -> Result<()> {
    let top = saved.iter().fold(T::zero(), |m, x| m.max(x.abs()));
    let allowed = top * T::of(ROUNDED);
    // A comparison with NaN is false: a value that is not a number never agrees.
    let agrees = |(a, b): (&T, &T)| (*a - *b).abs() <= allowed;
    match restored.iter().zip(saved).position(|pair| !agrees(pair)) {
        None => Ok(()),
        Some(place) => Err(Error::NotRestored {
            model: model.to_owned(),
            what,
            place,
            found: restored[place].as_f64(),
            saved: saved[place].as_f64(),
        }),
    }
}

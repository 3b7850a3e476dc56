//! Whole solvers in the place of a model that the core steps.

use super::step::Reached;
use super::{Stepper, Subdomain};
use crate::interface::Transfer;
use crate::participant::{Outline, Participant};
use crate::record::Record;
use crate::weight::Weights;
use crate::{Error, Interpolation, Real, Result};
use std::sync::Arc;

/// A participant and what the core keeps of it.
pub(super) struct Guest<T: Real> {
    solver: Box<dyn Participant<T>>,
    /// Last change of its velocities, and the impulse handed over.
    change: Vec<T>,
    /// Energy \[J\] at the start and what impulses have brought since.
    received: T,
}

impl<T: Real> std::fmt::Debug for Guest<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Guest {}", self.solver.name())
    }
}

impl<T: Real> Subdomain<T> {
    /// A whole solver, with the field that interfaces and probes see. Its state is its own: it takes no initial state,
    /// support or effect of the core's.
    ///
    /// # Errors
    /// Those of [`Participant::weigh`]; a layout that the core does not know, or nodes that do not fit it.
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
        solver.weigh(&Weights::uncoupled(), &mut inertia)?;
        let outline = Outline::of(&*solver, inertia);
        // Weights are the solver's business: the outline must not be weighted at its nodes.
        let mut out = Self::new(Box::new(outline), field, Weights::uncoupled());
        out.weights = weights;
        let guest = Guest {
            solver,
            change: vec![T::zero(); layout.dofs()],
            received: T::zero(),
        };
        out.stepper = Stepper::Guest(Box::new(guest));
        Ok(out)
    }

    /// Whether a solver of its own stands here.
    pub(crate) fn is_guest(&self) -> bool {
        matches!(self.stepper, Stepper::Guest(_))
    }

    /// Has the guest take its weights; refuses what only models of the core can have.
    pub(super) fn weigh_guest(&mut self, paired: bool) -> Result<()> {
        let Stepper::Guest(guest) = &mut self.stepper else {
            return Ok(());
        };
        let rest = self.state.q.iter().chain(&self.state.v).all(|x| *x == T::zero());
        let what = if !self.supports.is_empty() {
            "a support"
        } else if !self.chosen.is_empty() || paired {
            "an effect"
        } else if !rest || self.memory.is_some() {
            "an initial state"
        } else if self.own == super::OwnStep::Implicit {
            "the core's implicit scheme"
        } else {
            guest.solver.weigh(&self.weights, &mut self.inertia)?;
            guest.solver.displacements(&mut self.state.q);
            guest.solver.velocities(&mut self.state.v);
            return Ok(());
        };
        Err(Error::Unsupported {
            model: guest.solver.name().to_owned(),
            what: format!("have {what} of the core: it is a solver of its own; give it there"),
        })
    }

    /// The solver goes on.
    pub(super) fn guest_step(&mut self, reached: Reached<T>) -> Result<()> {
        let Stepper::Guest(guest) = &mut self.stepper else {
            return Ok(());
        };
        guest
            .solver
            .advance(reached.time - reached.since, reached.since)?;
        guest.solver.displacements(&mut self.state.q);
        guest.solver.velocities(&mut self.state.v);
        Ok(())
    }

    /// Accelerations of the start, where the solver has them.
    pub(super) fn guest_start(&mut self) {
        if let Stepper::Guest(guest) = &mut self.stepper
            && !guest.solver.accelerations(&mut self.state.a)
        {
            self.state.a.fill(T::zero());
        }
    }

    /// Hands the whole reflection over: half of it is in the velocities, of this instant.
    pub(crate) fn hand_over(&mut self, half: &Transfer<T>) -> Result<()> {
        if let Stepper::Guest(guest) = &mut self.stepper {
            guest.change.fill(T::zero());
            half.kick(&mut guest.change);
            for ((p, m), v) in guest.change.iter_mut().zip(&self.inertia).zip(&self.state.v) {
                *p *= *m * T::of(2.0);
                guest.received += *p * *v;
            }
            guest.solver.kick(&guest.change)?;
        }
        Ok(())
    }

    /// The same at the start: what the projection of its velocities changed, and all `halves` of reflections that are still
    /// to come.
    pub(crate) fn hand_over_start(&mut self, halves: &[&Transfer<T>]) -> Result<()> {
        if let Stepper::Guest(guest) = &mut self.stepper {
            guest.solver.velocities(&mut guest.change);
            let half = T::of(0.5);
            let mut going = self.state.v.clone();
            halves.iter().for_each(|h| h.kick(&mut going));
            guest.received = T::zero();
            for ((p, m), v) in guest.change.iter_mut().zip(&self.inertia).zip(&going) {
                guest.received += half * *m * *v * *v;
                *p = *m * (*v - *p);
            }
            guest.solver.kick(&guest.change)?;
        }
        Ok(())
    }

    pub(super) fn guest_invariant(&mut self) -> T {
        let kinetic = self.kinetic_energy();
        let Stepper::Guest(guest) = &self.stepper else {
            return kinetic;
        };
        let all = guest.solver.invariant().unwrap_or(guest.received);
        self.energies.now = Some(all - kinetic);
        all
    }

    /// What the model remembers, or the solver and what it received.
    pub(super) fn save_model(&self) -> Result<Record<T>> {
        let Stepper::Guest(guest) = &self.stepper else {
            return Ok(self.model.save());
        };
        let mut record = guest.solver.save()?;
        record.numbers.push(guest.received);
        Ok(record)
    }

    /// Undoes [`Self::save_model`].
    pub(super) fn restore_model(&mut self, from: &Record<T>) -> Result<()> {
        let Stepper::Guest(guest) = &mut self.stepper else {
            return self.model.restore(from);
        };
        let mut record = from.clone();
        guest.received = record.numbers.pop().unwrap_or_default();
        guest.solver.restore(&record)
    }
}

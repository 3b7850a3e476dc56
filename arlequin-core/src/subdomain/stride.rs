//! Steps that the model makes itself.

use super::Subdomain;
use super::account::Energies;
use super::step::{Announce, StepEnd};
use crate::effect::Instant;
use crate::model::{Drift, Kick, State, Stride};
use crate::phase::Phase;
use crate::{Real, Result};

impl<T: Real> Subdomain<T> {
    /// Lets the model make the step itself if it can and nothing else acts within the step; returns whether
    /// it did. `keep` as in [`Self::predict`].
    ///
    /// Accelerations are then those of the internal forces alone, so that neither forces nor displacements of
    /// the step before are stored.
    pub(super) fn stride(&mut self, step_end: StepEnd<T>, keep: bool) -> Result<bool> {
        let alone = self.forces.are_internal() && self.moving().next().is_none();
        // Effects and moving supports read forces and displacements of the step, which the model does not
        // keep.
        if !alone || self.model.evolving().is_some() || self.model.stepping().is_none() {
            return Ok(false);
        }
        // Only the ledger needs the energy before the step.
        let before = match self.energies.now {
            None if keep => Some(self.model.internal_energy(&self.state.q)),
            known => known,
        };
        // Three arrays of the size of the state, which nothing reads as long as the model makes its steps.
        self.forces.release();
        let State { q, v, a } = &mut self.state;
        let step = Stride {
            dt: step_end.since,
            q,
            v,
            a,
            inverse_inertia: &self.inverse_inertia,
            // The step multiplies with inverse masses; only the ledger needs the masses.
            inertia: keep.then_some(&self.inertia[..]),
        };
        let drawn = self
            .model
            .stepping()
            .map(|m| m.stride(step))
            .transpose()?
            .flatten();
        self.energies = Energies {
            before,
            now: drawn.map(|d| d.internal),
            moving: drawn.map(|d| d.moving),
        };
        // Supports only fix unknowns here: with moving supports the model does not make the step itself.
        for &d in self.supports.iter().flat_map(|m| &m.dofs) {
            (self.state.v[d], self.state.a[d]) = (T::zero(), T::zero());
        }
        Ok(true)
    }
    /// Lets the model make the step in two halves if other forces act on few nodes only; returns whether it
    /// did. The nodes on which they act wait: the core accelerates them. Parameters as in [`Self::predict`].
    ///
    /// Every force is the sum of the same terms in the same order as without the model's own steps.
    pub(super) fn stride_with_loads(
        &mut self,
        number: usize,
        step_end: StepEnd<T>,
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<bool> {
        // The ledger needs the forces of two instants on all nodes.
        if keep || !self.loads_are_sparse() || self.model.stepping().is_none() {
            return Ok(false);
        }
        // The drift comes first: effects find their nodes by the positions at the end of the step.
        self.drift(step_end)?;
        self.mark_loads(number, step_end, announce)?;
        let State { v, a, .. } = &mut self.state;
        let kick = Kick {
            dt: step_end.since,
            v,
            a,
            inverse_inertia: &self.inverse_inertia,
            waiting: &mut self.forces.waiting,
            f: &mut self.forces.internal,
        };
        self.model.stepping().map(|m| m.kick(kick)).transpose()?;
        // Without a ledger in this step, energies are evaluated when somebody asks for them.
        self.energies = Energies::unknown();
        // Bonds break before effects act: a contact reads the internal forces, in which broken bonds have no
        // part.
        if self.model.evolving().is_some() {
            announce(Phase::Evolve(number));
            self.evolve(step_end.time)?;
            announce(Phase::Predict(number));
        }
        if !self.forces.are_internal() {
            self.forces.load_waiting(&self.model.layout());
            self.add_loads(step_end, number, announce)?;
        }
        // Last, by the sum of all forces. The kick has accelerated all other nodes.
        self.accelerate_waiting(step_end);
        Ok(true)
    }

    /// Returns whether all effects act on few nodes and moving supports move no rotations.
    fn loads_are_sparse(&mut self) -> bool {
        let moved = 0..self.model.layout().translations();
        !self.is_paired()
            && self.moving().all(|m| m.dofs.iter().all(|d| moved.contains(d)))
            && self.effects.iter_mut().all(|e| e.effect.sparse().is_some())
    }

    /// Moves all unknowns; nodes of moving supports wait for their forces, which do work.
    fn drift(&mut self, step_end: StepEnd<T>) -> Result<()> {
        let layout = self.model.layout();
        let evolves = self.model.evolving().is_some();
        let (forces, state) = (&mut self.forces, &mut self.state);
        forces.begin_waiting(layout.nodes);
        // Unknowns with an amplitude of zero do not move, so that their supports do no work.
        for motion in self.supports.iter().filter(|m| m.amplitude != T::zero()) {
            let now = motion.position(step_end.time);
            for &d in &motion.dofs {
                forces.waiting[layout.node_of(d)] = true;
                forces.placed.push((d, now));
            }
        }
        // The energy of a break needs the displacements of both ends of the step. A swap keeps the old ones
        // without a copy.
        if evolves {
            std::mem::swap(&mut state.q, &mut forces.q_before);
        }
        let drift = Drift {
            dt: step_end.since,
            q_before: evolves.then_some(&forces.q_before[..]),
            q: &mut state.q,
            v: &mut state.v,
            a: &state.a,
            prescribed: &forces.placed,
        };
        self.model.stepping().map(|m| m.drift(drift)).transpose()?;
        Ok(())
    }

    /// Lets the effects name the nodes on which they may act.
    fn mark_loads(&mut self, number: usize, step_end: StepEnd<T>, announce: &mut Announce<'_>) -> Result<()> {
        let instant = Instant {
            time: step_end.time,
            q: &self.state.q,
            v_half: &self.state.v,
            dt: step_end.since,
            // No forces exist yet at this point of the step.
            internal: &[],
            internal_before: &[],
        };
        for (k, e) in self.effects.iter_mut().enumerate() {
            announce(Phase::Effect(number, k));
            if let Some(effect) = e.effect.sparse() {
                effect.mark(&instant, &mut self.forces.waiting)?;
            }
        }
        announce(Phase::Predict(number));
        Ok(())
    }
}

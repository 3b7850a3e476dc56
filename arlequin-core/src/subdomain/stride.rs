//! Steps that the model makes itself.

use super::Subdomain;
use super::account::Energies;
use super::step::StepEnd;
use crate::model::{State, Stride};
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
            None if keep => Some(self.model.energy_from_forces(&self.state.q)),
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
}

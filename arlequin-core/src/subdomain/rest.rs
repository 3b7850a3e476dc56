//! Subdomains at rest: states without velocities, as statics reaches them.

use super::account::Energies;
use super::{Stepper, Subdomain};
use crate::effect::Instant;
use crate::model::State;
use crate::weight::Weighting;
use crate::{Real, Result, parallel};

impl<T: Real> Subdomain<T> {
    /// Returns the reason why the equilibrium is not the solution of one linear system; `None` if it is.
    pub(crate) fn not_direct(&mut self) -> Option<String> {
        if self.model.evolving().is_some() {
            return Some("it changes itself as it moves".into());
        }
        self.not_linear()
    }

    /// Returns the reason why the equilibrium is not the solution of one linear system even while the model
    /// stays as it is; `None` if it is.
    pub(crate) fn not_linear(&mut self) -> Option<String> {
        if self.is_external() {
            return Some("it is a solver of its own".into());
        }
        if self.weights.weighting == Weighting::Nodal || self.model.views().linear.is_none() {
            return Some("its forces are not linear, or weighted at its nodes".into());
        }
        // Damping has no force at rest; effects that add stiffness have.
        let mut bound = self.effects.iter();
        let bound = bound.find(|e| !e.effect.is_dead() && e.effect.step_demand().stiffness > T::zero());
        bound.map(|e| format!("effect '{}' depends on positions", e.effect.name()))
    }

    /// Returns whether the model has changed itself since the start.
    pub(crate) fn has_changed(&self) -> bool {
        self.evolved.is_some_and(|e| e.work != T::zero())
    }

    /// Returns whether the model would stay as it is at rest in the displacements `q`.
    pub(crate) fn stays(&mut self, q: &[T]) -> bool {
        self.model.evolving().is_none_or(|model| model.stays(q))
    }

    /// Returns `−Σ m v (a − a₋)` and `Σ m v²` over the unknowns, with the accelerations `before` of one step
    /// earlier. The first over the second and the step is the square of a frequency, the Rayleigh quotient of
    /// the motion: multipliers do not count, as they have no power on velocities that fulfil the constraints.
    pub(crate) fn motion_sums(&self, before: &[T]) -> [T; 2] {
        let (m, State { v, a, .. }) = (&self.inertia, &self.state);
        self.sums(&|range| {
            let stiff = range.clone().map(|i| m[i] * v[i] * (before[i] - a[i])).sum();
            [stiff, parallel::weighted_squares(&m[range.clone()], &v[range])]
        })
    }

    /// Sets displacements at a time \[s\], with zero velocities and accelerations, and evaluates all forces
    /// there.
    pub(crate) fn set_at_rest(&mut self, q: &[T], time: T) -> Result<()> {
        self.state.q.copy_from_slice(q);
        self.state.v.fill(T::zero());
        self.state.a.fill(T::zero());
        self.energies = Energies::unknown();
        let mut forces = vec![T::zero(); q.len()];
        self.model.advance(q, &mut forces)?;
        self.forces.settle(forces);
        let instant = Instant {
            time,
            q: &self.state.q,
            v_half: &self.state.v,
            dt: self.pace.dt,
            number: 0,
            internal: self.forces.internal(),
            internal_before: self.forces.internal(),
        };
        let mut loads = self.forces.internal().to_vec();
        // Effects are evaluated too, since they remember their forces.
        for e in &mut self.effects {
            e.effect.add_forces(&instant, &mut loads)?;
        }
        self.forces.settle_loads(&loads);
        Ok(())
    }

    /// Adds the weighted internal forces of the present displacements, always evaluated anew.
    pub(crate) fn forces_of_displacements(&mut self, out: &mut [T]) -> Result<()> {
        self.model.add_internal_forces(&self.state.q, out)
    }

    /// Writes the weighted internal forces of the present state, without other forces.
    pub(crate) fn internal_forces_now(&mut self, out: &mut [T]) -> Result<()> {
        // A model that makes its steps itself stores no forces.
        if self.forces.are_released() && matches!(self.stepper, Stepper::Verlet) {
            out.fill(T::zero());
            return self.model.add_internal_forces(&self.state.q, out);
        }
        out.copy_from_slice(self.forces.internal());
        Ok(())
    }
}

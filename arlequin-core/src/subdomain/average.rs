//! The implicit stepper: average acceleration, for linear continua.
//!
//! ```text
//! (M + Δt²/4 K) v̄ = M v_0 + Δt/2 (F_½ − K q_0),     q_1 = q_0 + Δt v̄,     v_1 = 2 v̄ − v_0
//! ```
//!
//! Newmark's scheme with `β = 1/4`, loads taken in the middle of the step. It has no critical step and keeps
//! `½vᵀMv + ½qᵀKq`, which changes by the work `Δt F_½·v̄` alone. The matrix is factored once.

use super::{Stepper, Subdomain};
use crate::effect::{Attached, Effect, Instant};
use crate::linalg::SpdFactor;
use crate::model::State;
use crate::model::unknown_places;
use crate::weight::Weighting;
use crate::{Error, Real, Result, parallel};
use sprs::TriMat;

use super::step::StepEnd;

/// Factor and working buffers of the implicit stepper.
#[derive(Debug)]
pub(super) struct Average<T> {
    factor: Box<dyn SpdFactor<T>>,
    /// Mean velocities of the step.
    mean: Vec<T>,
    /// Loads in the middle of the step.
    loads: Vec<T>,
    /// Displacements: in the middle of the step where they are prescribed, at its start elsewhere. `pull`
    /// holds the internal forces there.
    trial: Vec<T>,
    pull: Vec<T>,
    /// Work of the moving supports in the step \[J\].
    pub(super) support: T,
}

impl<T: Real> Average<T> {
    /// Evaluates the loads of an instant.
    pub(super) fn load(
        &mut self,
        effects: &mut [Attached<T, dyn Effect<T>>],
        instant: &Instant<'_, T>,
    ) -> Result<()> {
        self.loads.fill(T::zero());
        effects
            .iter_mut()
            .try_for_each(|e| e.effect.add_forces(instant, &mut self.loads))
    }

    /// Loads of the last [`Self::load`].
    pub(super) fn loads(&self) -> &[T] {
        &self.loads
    }
}

/// Returns the instant of a state, for dead loads.
pub(super) fn instant<'a, T: Real>(time: T, dt: T, state: &'a State<T>, internal: &'a [T]) -> Instant<'a, T> {
    Instant {
        time,
        q: &state.q,
        v_half: &state.v,
        dt,
        number: 0,
        internal,
        internal_before: internal,
    }
}

impl<T: Real> Subdomain<T> {
    /// Factors the matrix of the implicit stepper for the present length of own steps.
    pub(super) fn make_implicit(&mut self) -> Result<()> {
        if let Some(why) = self.not_implicit() {
            return Err(Error::Unsupported {
                model: self.model.name().to_owned(),
                what: format!(
                    "step implicitly: {why}; let it step explicitly, with own steps where it needs them"
                ),
            });
        }
        let Some(linear) = self.model.views().linear else {
            return Ok(());
        };
        let quarter = self.pace.dt * self.pace.dt * T::of(0.25);
        let (stiffness, n) = (linear.stiffness(), self.inertia.len());
        let free = |i: usize| self.inverse_inertia[i] > T::zero();
        let mut matrix = TriMat::with_capacity((n, n), stiffness.nnz() + n);
        for (k, (i, j)) in stiffness.iter().filter(|(_, (i, j))| free(*i) && free(*j)) {
            matrix.add_triplet(i, j, quarter * *k);
        }
        for (i, m) in self.inertia.iter().enumerate() {
            // Prescribed unknowns have a row of the identity and zero on the right-hand side.
            matrix.add_triplet(i, i, if free(i) { *m } else { T::one() });
        }
        let places = unknown_places(&*self.model);
        let factor = T::cholesky(&matrix.to_csc(), Some(&places)).map_err(|e| Error::Unsupported {
            model: self.model.name().to_owned(),
            what: format!(
                "step implicitly by {:e} s: of M + Δt²/4 K, {e}; take a shorter step of the run",
                self.pace.dt.as_f64()
            ),
        })?;
        let zeros = || vec![T::zero(); n];
        self.stepper = Stepper::Average(Box::new(Average {
            factor,
            mean: zeros(),
            loads: zeros(),
            trial: zeros(),
            pull: zeros(),
            support: T::zero(),
        }));
        Ok(())
    }

    /// Returns the reason why the implicit stepper cannot be used; `None` if it can.
    fn not_implicit(&mut self) -> Option<String> {
        if self.model.evolving().is_some() {
            return Some("it changes itself as it moves".into());
        }
        if self.model.layout().rotations > 0 {
            return Some("its particles turn, and the scheme is for linear continua".into());
        }
        if self.weights.weighting == Weighting::Nodal {
            return Some("nodal weights leave it no symmetric stiffness".into());
        }
        if self.model.views().linear.is_none() {
            return Some("its forces are not linear".into());
        }
        if self.is_paired() {
            return Some(
                "an effect between it and another model needs positions of the end of the step".into(),
            );
        }
        let bound = self.effects.iter().find(|e| !e.effect.is_dead());
        bound.map(|e| {
            format!(
                "effect '{}' needs velocities or positions; only dead loads are known ahead",
                e.effect.name()
            )
        })
    }

    /// Makes one implicit step.
    pub(super) fn average_step(&mut self, step_end: StepEnd<T>) -> Result<()> {
        self.load_middle(step_end)?;
        self.compute_mean(step_end);
        self.finish_step(step_end)
    }

    /// Evaluates the loads in the middle of the step, and the internal forces with prescribed displacements
    /// already there.
    fn load_middle(&mut self, step_end: StepEnd<T>) -> Result<()> {
        let Stepper::Average(average) = &mut self.stepper else {
            return Ok(());
        };
        let middle = step_end.time - step_end.since * T::of(0.5);
        let middle_instant = instant(middle, step_end.since, &self.state, self.forces.internal());
        average.load(&mut self.effects, &middle_instant)?;
        let Average { trial, pull, .. } = &mut **average;
        let (q, now) = (&self.state.q, self.forces.internal());
        if self.supports.iter().all(|m| m.amplitude == T::zero()) {
            // Without moving supports the internal forces are those at the start.
            parallel::copy(pull, now);
            return Ok(());
        }
        trial.copy_from_slice(q);
        for motion in &self.supports {
            let end = motion.position(step_end.time);
            let middle = |d: &usize| trial[*d] = (q[*d] + end) * T::of(0.5);
            motion.dofs.iter().for_each(middle);
        }
        pull.fill(T::zero());
        self.model.add_internal_forces(trial, pull)
    }

    /// Computes the mean velocities of the step, and the work of moving supports but for that against the
    /// internal forces at the end of the step.
    fn compute_mean(&mut self, step_end: StepEnd<T>) {
        let Stepper::Average(average) = &mut self.stepper else {
            return;
        };
        let Average {
            factor,
            mean,
            loads,
            pull,
            support,
            ..
        } = &mut **average;
        let (dt, half) = (step_end.since, step_end.since * T::of(0.5));
        let State { q, v, .. } = &self.state;
        for (i, mean) in mean.iter_mut().enumerate() {
            let free = self.inverse_inertia[i] > T::zero();
            *mean = if free {
                self.inertia[i] * v[i] + half * (loads[i] + pull[i])
            } else {
                T::zero()
            };
        }
        factor.solve(mean);
        *support = T::zero();
        let now = self.forces.internal();
        for motion in &self.supports {
            let (end, velocity, _) = motion.kinematics(step_end.time, step_end.dt);
            for &d in &motion.dofs {
                mean[d] = (end - q[d]) / dt;
                // Work against loads and initial internal forces, and kinetic energy of the supported masses.
                let kinetic = self.inertia[d] * (velocity * velocity - v[d] * v[d]) * T::of(0.5);
                *support += kinetic - mean[d] * (dt * loads[d] + half * now[d]);
            }
        }
    }

    /// Computes state, forces and works at the end of the step.
    fn finish_step(&mut self, step_end: StepEnd<T>) -> Result<()> {
        let Stepper::Average(average) = &mut self.stepper else {
            return Ok(());
        };
        let Average {
            mean, loads, support, ..
        } = &mut **average;
        let dt = step_end.since;
        let State { q, v, a } = &mut self.state;
        let now = self.forces.internal_mut();
        for ((q, v), mean) in q.iter_mut().zip(v.iter_mut()).zip(&*mean) {
            *q += dt * *mean;
            *v = *mean + *mean - *v;
        }
        for motion in &self.supports {
            // Prescribed unknowns follow their motion exactly, the others the scheme.
            let (end, velocity, _) = motion.kinematics(step_end.time, step_end.dt);
            motion.dofs.iter().for_each(|&d| (q[d], v[d]) = (end, velocity));
        }
        now.fill(T::zero());
        self.model.advance(q, now)?;
        for &d in self.supports.iter().flat_map(|m| &m.dofs) {
            *support -= dt * T::of(0.5) * mean[d] * now[d];
        }
        let forces = now.iter().zip(&*loads);
        for ((a, w), (f, g)) in a.iter_mut().zip(&self.inverse_inertia).zip(forces) {
            *a = *w * (*f + *g);
        }
        for motion in &self.supports {
            let (.., acceleration) = motion.kinematics(step_end.time, step_end.dt);
            motion.dofs.iter().for_each(|&d| a[d] = acceleration);
        }
        for e in &mut self.effects {
            let work = dt * e.effect.power(mean);
            e.add_whole(work);
        }
        Ok(())
    }

    /// Returns the invariant `½vᵀMv + U(q)` \[J\].
    pub(super) fn average_invariant(&mut self) -> T {
        let internal = self.internal_energy();
        self.energies.now = Some(internal);
        internal + self.kinetic_energy()
    }
}

//! Change of the weights of a subdomain in the middle of a run, and nodes that sleep.

use super::account::Energies;
use super::{Stepper, Subdomain};
use crate::effect::{Attached, Effect, EffectSpec};
use crate::error::invalid;
use crate::weight::{Changed, Weighting, Weights};
use crate::{Error, Real, Result, parallel};
use std::ops::Range;

/// Masses up to this number of units of round-off of the largest mass count as zero.
const ROUND_OFF: f64 = 4.0;

/// An effect that a subdomain has after a change of weights: made anew, or `None` for the old one.
pub(crate) type NewEffect<T> = Option<Box<dyn EffectSpec<T>>>;

impl<T: Real> Subdomain<T> {
    /// Returns whether nodes without weight sleep.
    pub fn has_sleep(&self) -> bool {
        self.sleeps
    }

    /// Returns whether a node sleeps: the model has no weight there.
    pub fn is_asleep(&self, node: usize) -> bool {
        self.inertia[node * self.model.layout().components] <= T::zero()
    }

    /// Stops nodes whose mass is round-off of the largest mass `top`, and takes the remainder of their
    /// inertia.
    pub(super) fn put_to_sleep(&mut self, top: T) {
        let layout = self.model.layout();
        let (d, r, first) = (layout.components, layout.rotations, layout.translations());
        for node in 0..layout.nodes {
            if self.inertia[node * d] > top * T::epsilon() * T::of(ROUND_OFF) {
                continue;
            }
            let [moving, turning] = [d * node..d * (node + 1), first + r * node..first + r * (node + 1)];
            // Without mass and velocity the node leaves the step and the operators by a product with zero,
            // without a branch.
            for k in moving.chain(turning) {
                self.inertia[k] = T::zero();
                (self.state.v[k], self.state.a[k]) = (T::zero(), T::zero());
            }
        }
    }

    /// Refuses a change of weights that the subdomain cannot make.
    pub(crate) fn check_rezoning(&mut self, new: &Weights<T>) -> Result<()> {
        let why = if self.weights.weighting == Weighting::Nodal || new.weighting == Weighting::Nodal {
            "weights at nodes conserve no energy that could be accounted for; take weights of elements"
        } else if self.model.evolving().is_some_and(|model| !model.sleep()) {
            "it changes itself, and cannot leave out what sleeps, whose strain is stale; switch that off"
        } else {
            return Ok(());
        };
        Err(Error::Unsupported {
            model: self.model.name().to_owned(),
            what: format!("change its weights: {why}"),
        })
    }

    /// Changes the weights. `effects` replace those of the subdomain and take over their works and memories;
    /// where there is `None`, the old effect stays. The state stays; forces are those of the old weights
    /// until the next start.
    pub(crate) fn reweigh(
        &mut self,
        weights: Weights<T>,
        effects: Vec<NewEffect<T>>,
        changed: Option<&Changed<T>>,
    ) -> Result<()> {
        if effects.len() != self.effects.len() {
            let names: Vec<_> = self.effects().map(|e| e.name().to_owned()).collect();
            let what = format!("new effects of '{}'", self.model.name());
            let rule = format!("must be those that it has, {names:?}, each made for the new weights");
            return Err(invalid(&what, effects.len(), &rule));
        }
        // As at set-up: weights first, then what the model remembers.
        let memory = self.model.save();
        self.weights = weights;
        match changed {
            Some(changed) => {
                self.model
                    .change_internal_weight(&*self.weights.internal, changed)?;
            }
            None => self.model.set_internal_weight(&*self.weights.internal)?,
        }
        self.model.restore(&memory)?;
        self.lump()?;
        self.weigh_unknowns()?;
        self.forces.expect_anywhere();
        self.energies = Energies::unknown();
        // Put back also after an error, so that a run that ends names its effects.
        let mut attached = std::mem::take(&mut self.effects);
        let renewed = self.renew(&mut attached, effects);
        self.effects = attached;
        renewed?;
        let (run, steps) = (self.pace.dt * T::of(self.pace.steps as f64), self.pace.steps);
        match self.stepper {
            // The matrix holds masses and stiffness.
            Stepper::Average(_) => self.set_pace(run, steps),
            _ => Ok(()),
        }
    }

    /// Gives the attached effects the present weights, by the new effects or by themselves.
    fn renew(&self, attached: &mut [Attached<T, dyn Effect<T>>], effects: Vec<NewEffect<T>>) -> Result<()> {
        for (k, (spec, old)) in effects.into_iter().zip(attached).enumerate() {
            let Some(spec) = spec else {
                old.reweigh(&self.host())?;
                continue;
            };
            let mut new = Attached::new(spec.attach(&self.host())?);
            if new.effect.name() != old.effect.name() {
                let what = format!("new effect {k} of '{}'", self.model.name());
                let rule = format!("must be '{}', made for the new weights", old.effect.name());
                return Err(invalid(&what, new.effect.name(), &rule));
            }
            // The effect goes on with the work and the memory of before, so that its ledger line has no jump.
            new.restore(old.work(), &old.effect.save())?;
            *old = new;
        }
        Ok(())
    }

    /// Invariant \[J\] that the next own step will have, for a linear law and the velocities `v⁺` that the
    /// subdomain has now:
    ///
    /// ```text
    /// ½ wᵀMw + U(q) − ½ Δt fᵀw,   w = v⁺ + Δt/2 a      velocity Verlet
    /// ½ v⁺ᵀMv⁺ + U(q)                                  average acceleration
    /// ```
    pub(crate) fn invariant_ahead(&mut self) -> Result<T> {
        let energy = self.model.internal_energy(&self.state.q);
        if !matches!(self.stepper, Stepper::Verlet) {
            return Ok(energy + self.kinetic_energy());
        }
        // Of a restored state or of a model that makes its steps itself the forces are not known.
        let mut force = vec![T::zero(); self.inertia.len()];
        self.model.add_internal_forces(&self.state.q, &mut force)?;
        let (dt, half) = (self.pace.dt, T::of(0.5));
        let (v, a, m) = (&self.state.v, &self.state.a, &self.inertia);
        let part = |range: Range<usize>| {
            range.fold(T::zero(), |sum, i| {
                let w = v[i] + half * dt * a[i];
                sum + half * w * (m[i] * w - dt * force[i])
            })
        };
        Ok(energy + parallel::sum(force.len(), &part))
    }
}

//! A subdomain: one model with its weights, supports, effects and state.
//!
//! [`Subdomain`] is assembled here. `prepare` computes its inertia and attaches the effects, `step` makes the
//! part of the step that velocity Verlet does and owns the forces, `account` owns works and energies.

mod account;
mod average;
mod external;
mod follow;
mod motion;
mod own;
mod prepare;
mod reaction;
mod record;
mod rest;
mod rezone;
mod share;
mod step;
mod stride;

pub use motion::PrescribedMotion;
pub use own::OwnStep;
pub use reaction::Resultant;
pub use record::SubdomainSnapshot;
pub(crate) use rezone::NewEffect;
pub(crate) use step::{Announce, StepEnd};

use crate::effect::{Attached, Effect, EffectSpec};
use crate::field::{Interpolation, ShapeRow};
use crate::model::{CoarseModel, Finding, FineModel, Model, State};
use crate::named::named;
use crate::ranks::Communicator;
use crate::scalar::check_finite;
use crate::weight::{Weighting, Weights};
use crate::{Error, Exact, NodallyWeighted, Owned, Real, Result};
use account::{Energies, Evolved};
use average::Average;
use external::External;
use nalgebra::{Point3, Vector3};
use own::Pace;
use std::sync::Arc;
use step::Forces;

/// Requirement on the sum of the weights of a model and of the models it is tied to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Partition {
    /// The sum must be one wherever one of these models is; refused otherwise.
    #[default]
    Checked,
    /// The sum is not checked, for deliberate studies such as an impedance jump by constant weights over
    /// whole models. Mass and stiffness are then not those of the body.
    Unchecked,
}

named!(Partition, "partition":
    Checked = "checked",
    Unchecked = "unchecked",
);

/// Method that makes the own steps.
#[derive(Debug)]
enum Stepper<T: Real> {
    /// Velocity Verlet.
    Verlet,
    /// Average acceleration, which is implicit.
    Average(Box<Average<T>>),
    /// An external solver.
    External(Box<External<T>>),
}

/// One model with all data that the coupled run has about it.
pub struct Subdomain<T: Real> {
    model: Box<dyn Model<T>>,
    field: Arc<dyn Interpolation<T>>,
    weights: Weights<T>,
    partition: Partition,
    /// True if nodes without weight sleep; a model without sleep must have weight at all of its nodes.
    sleeps: bool,
    /// The model with a weight of one, if nodes may sleep; set when the run is built.
    unweighted: Option<prepare::Unweighted<T>>,
    supports: Vec<PrescribedMotion<T>>,
    /// Effects that are not attached yet.
    chosen: Vec<Box<dyn EffectSpec<T>>>,
    /// Attached effects with their lines of the ledger.
    effects: Vec<Attached<T, dyn Effect<T>>>,
    /// Ranks among which the run will partition the model; `None` once it has.
    ranks: Option<Arc<dyn Communicator>>,
    /// True once the run has partitioned the model.
    is_partitioned: bool,
    state: State<T>,
    inertia: Vec<T>,
    inverse_inertia: Vec<T>,
    forces: Forces<T>,
    /// Requested own step.
    requested_step: OwnStep<T>,
    /// Chosen own step.
    pace: Pace<T>,
    stepper: Stepper<T>,
    /// Line of the ledger for a model that changes itself.
    evolved: Option<Evolved<T>>,
    energies: Energies<T>,
    /// Working buffer for the powers of effects and supports.
    powers: Vec<Exact>,
}

impl<T: Real> std::fmt::Debug for Subdomain<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subdomain")
            .field("model", &self.model.name())
            .finish_non_exhaustive()
    }
}

impl<T: Real> Subdomain<T> {
    /// Makes a subdomain of a model in the coarse role.
    pub fn coarse(model: impl CoarseModel<T> + 'static, weights: Weights<T>) -> Self {
        let field = model.coarse_field();
        Self::new(Box::new(model), field, weights)
    }

    /// Makes a subdomain of a model in the fine role.
    pub fn fine(model: impl FineModel<T> + 'static, weights: Weights<T>) -> Self {
        let field = model.fine_field();
        Self::new(Box::new(model), field, weights)
    }

    /// Makes a subdomain of a model with an explicitly chosen field.
    pub fn new(model: Box<dyn Model<T>>, field: Arc<dyn Interpolation<T>>, weights: Weights<T>) -> Self {
        let mut model = match weights.weighting {
            Weighting::Energy => model,
            // A wrapper, so that no other place of the core distinguishes both kinds of weights.
            Weighting::Nodal => Box::new(NodallyWeighted::new(model)),
        };
        let n = model.layout().dofs();
        Self {
            field,
            weights,
            partition: Partition::Checked,
            sleeps: false,
            unweighted: None,
            supports: Vec::new(),
            chosen: Vec::new(),
            effects: Vec::new(),
            ranks: None,
            is_partitioned: false,
            state: State::zero(n),
            inertia: vec![T::zero(); n],
            inverse_inertia: vec![T::zero(); n],
            forces: Forces::zero(n),
            requested_step: OwnStep::Same,
            pace: Pace {
                steps: 1,
                dt: T::zero(),
            },
            stepper: Stepper::Verlet,
            evolved: model.evolving().map(|e| Evolved::new(e.effect())),
            energies: Energies::unknown(),
            powers: Vec::new(),
            model,
        }
    }

    /// Adds an effect.
    #[must_use]
    pub fn with_effect(mut self, effect: Box<dyn EffectSpec<T>>) -> Self {
        self.chosen.push(effect);
        self
    }

    /// Adds a support or a prescribed motion.
    #[must_use]
    pub fn with_support(mut self, motion: PrescribedMotion<T>) -> Self {
        self.supports.push(motion);
        self
    }

    /// Sets whether the weights must sum to one with those of the models this one is tied to; checked by
    /// default. One unchecked model frees all models of its group.
    #[must_use]
    pub fn with_partition(mut self, partition: Partition) -> Self {
        self.partition = partition;
        self
    }

    /// Lets nodes sleep where the weight of the model is zero: they have neither mass nor forces, keep their
    /// displacements and do not move. Without this, a node without weight is refused. A sleeping node wakes
    /// when [`crate::Coupled::rezone`] gives it weight.
    #[must_use]
    pub fn with_sleep(mut self) -> Self {
        self.sleeps = true;
        // A model that cannot is refused when its weights change.
        if let Some(model) = self.model.evolving() {
            model.sleep();
        }
        self
    }

    /// Sets initial displacements \[m\] (and rotation vectors \[rad\]) and velocities \[m/s\] (and spins
    /// \[rad/s\]).
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] or [`Error::NotFinite`].
    pub fn with_initial(mut self, q: Vec<T>, v: Vec<T>) -> Result<Self> {
        for (what, x) in [("initial displacement", &q), ("initial velocity", &v)] {
            let expected = self.model.layout().dofs();
            if x.len() != expected {
                return Err(Error::SizeMismatch {
                    what: what.into(),
                    expected,
                    found: x.len(),
                });
            }
            check_finite(what, x)?;
        }
        self.state.q = q;
        self.state.v = v;
        Ok(self)
    }

    /// Returns findings in the present state that need an effect, whether the effect is on or not.
    pub(crate) fn watch(&self) -> Vec<Finding> {
        self.model
            .views()
            .watching
            .map_or_else(Vec::new, |m| m.watch(&self.state))
    }

    /// The model.
    pub fn model(&self) -> &dyn Model<T> {
        &*self.model
    }
    /// Nodes of the model that this rank owns.
    pub fn owned(&self) -> Owned {
        self.model.owned()
    }
    /// The displacement field that interfaces and probes see.
    pub fn field(&self) -> &Arc<dyn Interpolation<T>> {
        &self.field
    }
    /// The weights.
    pub fn weights(&self) -> &Weights<T> {
        &self.weights
    }
    /// Current state.
    pub fn state(&self) -> &State<T> {
        &self.state
    }
    /// Lumped inertia weighted by `β` \[kg, kg m²\].
    pub fn inertia(&self) -> &[T] {
        &self.inertia
    }
    /// Inverse of [`Self::inertia`]; zero for prescribed unknowns.
    pub fn inverse_inertia(&self) -> &[T] {
        &self.inverse_inertia
    }
    /// Effects in the order they were added; empty until the run has attached them.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect<T>> {
        self.effects.iter().map(|e| &*e.effect)
    }
    /// Supports and prescribed motions.
    pub fn supports(&self) -> &[PrescribedMotion<T>] {
        &self.supports
    }

    /// Supports with an amplitude other than zero.
    pub(crate) fn moving(&self) -> impl Iterator<Item = &PrescribedMotion<T>> {
        self.supports.iter().filter(|m| m.amplitude != T::zero())
    }

    /// Requirement on the sum of the weights of this model and those tied to it.
    pub(crate) fn partition(&self) -> Partition {
        self.partition
    }

    /// Velocities, to be corrected by constraints.
    pub(crate) fn velocities(&mut self) -> &mut [T] {
        &mut self.state.v
    }

    /// Displacements, to be corrected by constraints.
    pub(crate) fn displacements(&mut self) -> &mut [T] {
        self.forces.unsettle();
        &mut self.state.q
    }

    /// Returns displacement \[m\] and velocity \[m/s\] of the field at a point.
    ///
    /// # Errors
    /// [`Error::OutsideDomain`] if the field does not reach the point.
    pub fn sample(&self, x: &Point3<T>) -> Result<[Vector3<T>; 2]> {
        let mut row = ShapeRow::default();
        self.field().shape_at(x, false, &mut row)?;
        let d = self.model().layout().components;
        let mut out = [Vector3::zeros(); 2];
        for (sum, values) in out.iter_mut().zip([&self.state.q, &self.state.v]) {
            for (&k, &n) in row.nodes.iter().zip(&row.values) {
                sum.iter_mut()
                    .zip(&values[k * d..(k + 1) * d])
                    .for_each(|(s, v)| *s += n * *v);
            }
        }
        Ok(out)
    }
}

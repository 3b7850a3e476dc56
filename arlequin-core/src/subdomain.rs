//! A subdomain: one model with its weights, supports, effects and state; velocity Verlet's half of the step.

use crate::coupled::Partition;
use crate::effect::{Effect, EffectSpec, Finding, Host, Instant, StepDemand};
use crate::error::invalid;
use crate::field::Interpolation;
use crate::model::{CoarseModel, Evolution, FineModel, Model, State};
use crate::observer::Phase;
use crate::parallel;
use crate::scalar::check_finite;
use crate::snapshot::Record;
use crate::weight::{Weighting, Weights};
use crate::{Error, NodallyWeighted, Real, Result};
use std::sync::Arc;

pub use crate::motion::PrescribedMotion;

/// Hears what a step is doing.
pub(crate) type Announce<'a> = dyn FnMut(Phase) + Send + 'a;

/// What left a model that evolves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Evolved<T> {
    /// The effect that took it.
    pub(crate) effect: &'static str,
    /// Its work \[J\], negative.
    pub(crate) work: T,
}

/// One model with everything the coupled run knows of it.
pub struct Subdomain<T: Real> {
    model: Box<dyn Model<T>>,
    field: Arc<dyn Interpolation<T>>,
    weights: Weights<T>,
    pub(crate) partition: Partition,
    supports: Vec<PrescribedMotion<T>>,
    /// Effects before and after they are attached.
    chosen: Vec<Box<dyn EffectSpec<T>>>,
    pub(crate) effects: Vec<Box<dyn Effect<T>>>,
    pub(crate) works: Vec<T>,
    /// What the last instant added to them.
    pub(crate) last_works: Vec<T>,
    /// Work line of a model that evolves; `None` for all others.
    pub(crate) evolved: Option<Evolved<T>>,
    pub(crate) state: State<T>,
    pub(crate) inertia: Vec<T>,
    pub(crate) inverse_inertia: Vec<T>,
    pub(crate) internal: Vec<T>,
    pub(crate) internal_before: Vec<T>,
    /// Internal and all other forces; empty where there are none but the internal ones.
    total: Vec<T>,
    pub(crate) q_before: Vec<T>,
    /// Whether effects between two subdomains act on this one; it is accelerated after them.
    pub(crate) paired: bool,
    /// Internal energy \[J\] found by the last [`Self::invariant`].
    pub(crate) drawn_energy: T,
    /// What the model is to remember from the start.
    memory: Option<Record<T>>,
}

impl<T: Real> std::fmt::Debug for Subdomain<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subdomain")
            .field("model", &self.model.name())
            .finish_non_exhaustive()
    }
}

impl<T: Real> Subdomain<T> {
    /// A model in the coarse role.
    pub fn coarse(model: impl CoarseModel<T> + 'static, weights: Weights<T>) -> Self {
        let field = model.coarse_field();
        Self::new(Box::new(model), field, weights)
    }

    /// A model in the fine role.
    pub fn fine(model: impl FineModel<T> + 'static, weights: Weights<T>) -> Self {
        let field = model.fine_field();
        Self::new(Box::new(model), field, weights)
    }

    /// A model with an explicitly chosen field.
    pub fn new(model: Box<dyn Model<T>>, field: Arc<dyn Interpolation<T>>, weights: Weights<T>) -> Self {
        let mut model = match weights.weighting {
            Weighting::Energy => model,
            Weighting::Nodal => Box::new(NodallyWeighted::new(model)),
        };
        let n = model.layout().dofs();
        let work = T::zero();
        let evolved = model.evolving().map(|e| Evolved {
            effect: e.effect(),
            work,
        });
        let zeros = || vec![T::zero(); n];
        Self {
            field,
            weights,
            partition: Partition::Checked,
            supports: Vec::new(),
            chosen: Vec::new(),
            effects: Vec::new(),
            works: Vec::new(),
            last_works: Vec::new(),
            evolved,
            state: State::zero(n),
            inertia: zeros(),
            inverse_inertia: zeros(),
            internal: zeros(),
            internal_before: zeros(),
            total: Vec::new(),
            q_before: zeros(),
            paired: false,
            drawn_energy: T::zero(),
            memory: None,
            model,
        }
    }

    /// Adds an effect.
    #[must_use]
    pub fn with_effect(mut self, effect: Box<dyn EffectSpec<T>>) -> Self {
        self.chosen.push(effect);
        self.works.push(T::zero());
        self.last_works.push(T::zero());
        self
    }

    /// Adds a support or a prescribed motion.
    #[must_use]
    pub fn with_support(mut self, motion: PrescribedMotion<T>) -> Self {
        self.supports.push(motion);
        self
    }

    /// Says whether the weights must sum to one with those of the models this one is tied to; one unchecked model frees
    /// all of them. Checked unless said otherwise.
    #[must_use]
    pub fn with_partition(mut self, partition: Partition) -> Self {
        self.partition = partition;
        self
    }

    /// Sets initial displacements \[m\] (and rotation vectors \[rad\]) and velocities \[m/s\] (and spins \[rad/s\]).
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

    /// Lets the model go on from what an equal one remembered, [`Model::save`]: the initial displacements are then those
    /// at which it was saved.
    #[must_use]
    pub fn with_memory(mut self, of: Record<T>) -> Self {
        self.memory = Some(of);
        self
    }

    /// What the present state would need effects for, whether they are on or not.
    pub(crate) fn watch(&self) -> Vec<Finding> {
        self.model
            .watching()
            .map_or_else(Vec::new, |m| m.watch(&self.state))
    }

    /// The model.
    pub fn model(&self) -> &dyn Model<T> {
        &*self.model
    }
    pub(crate) fn model_mut(&mut self) -> &mut dyn Model<T> {
        &mut *self.model
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
    /// Its inverse; zero for prescribed unknowns.
    pub fn inverse_inertia(&self) -> &[T] {
        &self.inverse_inertia
    }
    /// Effects in the order they were added; none before the run has attached them.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect<T>> {
        self.effects.iter().map(|e| &**e)
    }
    /// Supports and prescribed motions.
    pub fn supports(&self) -> &[PrescribedMotion<T>] {
        &self.supports
    }

    /// Weights the model, computes its inertia and attaches the effects.
    pub(crate) fn prepare(&mut self) -> Result<()> {
        let layout = self.model.layout();
        self.model.set_internal_weight(&*self.weights.internal)?;
        if let Some(memory) = self.memory.take() {
            self.model.restore(&memory)?;
        }
        self.model
            .lumped_inertia(&*self.weights.kinetic, &mut self.inertia)?;
        check_finite("weighted inertia", &self.inertia)?;
        let top = self.inertia[..layout.translations()]
            .iter()
            .fold(T::zero(), |a, b| a.max(*b));
        let mut prescribed = vec![false; layout.dofs()];
        for motion in &self.supports {
            motion.time.validate()?;
            if !motion.amplitude.is_finite() {
                return Err(invalid(
                    "amplitude of a prescribed motion",
                    motion.amplitude,
                    "must be finite",
                ));
            }
            for &d in &motion.dofs {
                if d >= layout.dofs() {
                    let what = format!("supported unknowns of '{}'", self.model.name());
                    return Err(Error::SizeMismatch {
                        what,
                        expected: layout.dofs(),
                        found: d + 1,
                    });
                }
                if std::mem::replace(&mut prescribed[d], true) {
                    let what = format!("support of '{}'", self.model.name());
                    return Err(invalid(
                        &what,
                        format_args!("unknown {d}"),
                        "is prescribed twice; remove one of the supports",
                    ));
                }
            }
        }
        for (i, m) in self.inertia.iter().enumerate() {
            // Round-off of element means may leave a few epsilon of the largest mass where there should be none.
            if !prescribed[i]
                && *m <= top * T::epsilon() * T::of(4.0)
                && (i < layout.translations() || *m <= T::zero())
            {
                let node = if i < layout.translations() {
                    i / layout.components
                } else {
                    (i - layout.translations()) / 3
                };
                let x = self
                    .model
                    .nodes()
                    .get(node)
                    .map_or([f64::NAN; 3], |p| [p.x.as_f64(), p.y.as_f64(), p.z.as_f64()]);
                return Err(Error::ZeroMass {
                    model: self.model.name().into(),
                    node,
                    point: x,
                    mass: m.as_f64(),
                });
            }
            self.inverse_inertia[i] = if prescribed[i] { T::zero() } else { T::one() / *m };
        }
        // Loads, and coupling forces on moving supports, must stay out of the invariant's internal forces.
        if !self.chosen.is_empty() || self.paired || self.has_moving_support() {
            self.total.resize(layout.dofs(), T::zero());
        }
        let chosen = std::mem::take(&mut self.chosen);
        let host = self.host();
        self.effects = chosen
            .into_iter()
            .map(|e| e.attach(&host))
            .collect::<Result<_>>()?;
        Ok(())
    }

    /// What effects may see of the prepared subdomain.
    pub(crate) fn host(&self) -> Host<'_, T> {
        Host {
            model: &*self.model,
            weights: &self.weights,
            inertia: &self.inertia,
            inverse_inertia: &self.inverse_inertia,
        }
    }

    /// Critical step of the weighted model with its effects and those `between` it and others \[s\].
    ///
    /// Damping forces use the velocity half a step earlier, which shortens the stable step to
    /// `2/ω (√(1 + ζ²) − ζ)` with `ζ = c/(2ω)`; see [`crate::effect::StepDemand`] for what adds to `ω` and `c`.
    pub(crate) fn critical_step(&mut self, between: &[StepDemand<T>]) -> Result<T> {
        let free = self.model.critical_step(&self.inverse_inertia)?;
        if self.effects.is_empty() && between.is_empty() {
            return Ok(free);
        }
        let own = self.effects.iter().map(|e| e.step_demand());
        Ok(crate::effect::shortened(free, own.chain(between.iter().copied())))
    }

    /// Effect forces at the current displacements beside the internal ones, which are there. `since` is the length of the
    /// step that led here, `own` the number of this subdomain.
    fn evaluate(&mut self, t: T, since: T, own: usize, announce: &mut Announce<'_>) -> Result<()> {
        if !self.total.is_empty() {
            parallel::copy(&mut self.total, &self.internal);
            let at = Instant {
                time: t,
                q: &self.state.q,
                v_half: &self.state.v,
                dt: since,
                internal: &self.internal,
                internal_before: &self.internal_before,
            };
            for (k, e) in self.effects.iter_mut().enumerate() {
                announce(Phase::Effect(own, k));
                e.add_forces(&at, &mut self.total)?;
            }
            announce(Phase::Predict(own));
        }
        Ok(())
    }

    /// The instant, and the forces to which effects between two subdomains add theirs; empty unless paired.
    pub(crate) fn open(&mut self, time: T, since: T) -> (Instant<'_, T>, &mut [T]) {
        let at = Instant {
            time,
            q: &self.state.q,
            v_half: &self.state.v,
            dt: since,
            internal: &self.internal,
            internal_before: &self.internal_before,
        };
        (at, &mut self.total)
    }

    /// `a` from all forces, `v += half a`; prescribed motion.
    pub(crate) fn accelerate(&mut self, t: T, [dt, half]: [T; 2]) {
        let force = if self.total.is_empty() {
            &self.internal
        } else {
            &self.total
        };
        let State { v, a, .. } = &mut self.state;
        parallel::accelerate(half, v, a, force, &self.inverse_inertia);
        for motion in &self.supports {
            let (_, velocity, acceleration) = motion.kinematics(t, dt);
            for &d in &motion.dofs {
                a[d] = acceleration;
                v[d] = velocity;
            }
        }
    }

    /// Sets prescribed displacements and velocities of time `t`.
    pub(crate) fn hold(&mut self, t: T, dt: T) {
        for motion in &self.supports {
            let (q, v, _) = motion.kinematics(t, dt);
            for &d in &motion.dofs {
                self.state.q[d] = q;
                self.state.v[d] = v;
            }
        }
    }

    /// Finds forces and accelerations of the start, after [`Self::hold`].
    pub(crate) fn start(&mut self, t: T, dt: T) -> Result<()> {
        self.internal.fill(T::zero());
        self.model.advance(&self.state.q, &mut self.internal)?;
        self.evaluate(t, T::zero(), 0, &mut |_| {})?;
        if !self.paired {
            self.accelerate(t, [dt, T::zero()]);
        }
        Ok(())
    }

    /// First half of velocity Verlet, up to the uncorrected velocity `u̇*` and acceleration `ü*` at time `t`; where
    /// effects between two subdomains act, up to the forces, and [`Self::accelerate`] follows them.
    ///
    /// Two passes over the unknowns beside the model's: before its forces and after. `own` is the number of this
    /// subdomain, for what is announced.
    pub(crate) fn predict(
        &mut self,
        own: usize,
        [t, dt]: [T; 2],
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        if parallel::pays(self.inertia.len()) {
            // One entry into the pool for all passes: each would cost a wake-up otherwise.
            rayon::scope(|_| self.passes(own, [t, dt], keep, announce))
        } else {
            self.passes(own, [t, dt], keep, announce)
        }
    }

    fn passes(&mut self, own: usize, [t, dt]: [T; 2], keep: bool, announce: &mut Announce<'_>) -> Result<()> {
        let half = dt * T::of(0.5);
        std::mem::swap(&mut self.internal, &mut self.internal_before);
        let keeps = keep || self.evolved.is_some();
        if keeps {
            std::mem::swap(&mut self.state.q, &mut self.q_before);
        }
        let State { q, v, a } = &mut self.state;
        if keeps {
            parallel::kick_and_drift_from([half, dt], &self.q_before, [q, v], a, &mut self.internal);
        } else {
            parallel::kick_and_drift(half, dt, q, v, a, &mut self.internal);
        }
        for motion in &self.supports {
            let now = motion.at(t);
            motion.dofs.iter().for_each(|&d| q[d] = now);
        }
        // Found at zero by the model: the pass before left it so.
        self.model.advance(&self.state.q, &mut self.internal)?;
        if self.evolved.is_some() {
            announce(Phase::Evolve(own));
            self.evolve(t)?;
            announce(Phase::Predict(own));
        }
        self.evaluate(t, dt, own, announce)?;
        if !self.paired {
            self.accelerate(t, [dt, half]);
        }
        Ok(())
    }

    fn has_moving_support(&self) -> bool {
        self.supports.iter().any(|m| m.amplitude != T::zero())
    }

    /// Lets the model change itself; what leaves it is a negative work.
    fn evolve(&mut self, time: T) -> Result<()> {
        if let (Some(model), Some(line)) = (self.model.evolving(), &mut self.evolved) {
            line.work -= model.evolve(Evolution {
                time,
                q_before: &self.q_before,
                q: &self.state.q,
                f_before: &mut self.internal_before,
                f: &mut self.internal,
            })?;
        }
        Ok(())
    }

    /// The force vector, where moving supports make the coupling forces on them a part of the balance.
    pub(crate) fn force_on_moving_supports(&mut self) -> Option<&mut [T]> {
        self.has_moving_support().then_some(&mut self.total[..])
    }

    /// Adds the work of effects over the step; returns that of the moving supports.
    pub(crate) fn account(&mut self, dt: T) -> T {
        let works = self.works.iter_mut().zip(&mut self.last_works);
        for ((w, last), e) in works.zip(&self.effects) {
            *last = dt * e.power(&self.state.v);
            *w += *last;
        }
        let mut support = T::zero();
        for motion in self.supports.iter().filter(|m| m.amplitude != T::zero()) {
            for &d in &motion.dofs {
                let reaction = self.inertia[d] * self.state.a[d] - self.total[d];
                support += dt * reaction * self.state.v[d];
            }
        }
        support
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.state.v.iter().all(|v| v.is_finite())
    }
}

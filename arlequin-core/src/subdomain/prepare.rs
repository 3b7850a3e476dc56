//! Preparation of a subdomain before the first step: weights, inertia, attached effects, critical step.

use super::Subdomain;
use crate::effect::{Attached, Effect, Host, StepDemand, shortened};
use crate::error::invalid;
use crate::scalar::check_finite;
use crate::{Error, Exact, Real, Result, Uniform};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Share of the critical step without weights that a model gets whose weights will change. Linear weights of
/// overlaps have been measured to take up to 13 % of it. The noise that a change leaves in the fastest modes
/// grows with the step: at 0.75 and 0.85, pulses in particles gained up to 6e-3 of their energy over 28
/// changes, in place of 2e-3.
const CHANGING: f64 = 0.65;

/// A model with a weight of one everywhere.
pub(super) struct Unweighted<T> {
    /// Mass of each node \[kg\].
    mass: Vec<T>,
    /// Critical step \[s\].
    step: T,
}

impl<T: Real> Subdomain<T> {
    /// Weights the model, computes its inertia and attaches the effects; `paired` is true if pair effects act
    /// on this subdomain.
    pub(crate) fn prepare(&mut self, paired: bool) -> Result<()> {
        self.model.layout().check(self.model.name())?;
        self.check_energy()?;
        if self.sleeps && !self.is_external() {
            self.unweighted = Some(self.without_weight()?);
            if let Some(model) = self.model.evolving() {
                // A model that cannot sleep is refused by the first change.
                model.sleep();
            }
        }
        // The check left a trial weight behind.
        self.model.set_internal_weight(&*self.weights.internal)?;
        if self.is_external() {
            self.weigh_external(paired)?;
        } else {
            self.lump()?;
        }
        self.weigh_unknowns()?;
        if self.is_to_be_partitioned() {
            // Effects are attached after partitioning, to this rank's part.
            return Ok(());
        }
        self.attach(paired)
    }

    /// Computes the weighted inertia.
    pub(super) fn lump(&mut self) -> Result<()> {
        let (model, kinetic) = (&self.model, &*self.weights.kinetic);
        match model.views().means.filter(|_| self.weights.are_one()) {
            Some(means) => means.inertia_by_internal_weight(kinetic, &mut self.inertia),
            None => model.lumped_inertia(kinetic, &mut self.inertia),
        }
    }

    /// Checks the weighted inertia and computes its inverse.
    pub(super) fn weigh_unknowns(&mut self) -> Result<()> {
        check_finite("weighted inertia", &self.inertia)?;
        let prescribed = self.prescribed()?;
        self.invert(&prescribed)
    }

    /// Attaches the effects.
    pub(super) fn attach(&mut self, paired: bool) -> Result<()> {
        // The invariant needs internal forces without loads, so loads get an array of their own.
        self.forces.expect_loads(!self.chosen.is_empty(), paired);
        let chosen = std::mem::take(&mut self.chosen);
        let host = self.host();
        let attached = chosen.into_iter().map(|e| e.attach(&host).map(Attached::new));
        self.effects = attached.collect::<Result<_>>()?;
        self.powers.reserve_exact(self.effects.len() + 1);
        self.check_parts()
    }

    /// Refuses effects that need the whole of a partitioned model, and ranks whose effects or supports
    /// differ. Collective.
    fn check_parts(&self) -> Result<()> {
        let owned = self.owned();
        if !owned.is_part() {
            return Ok(());
        }
        let model = self.model.name();
        // One number shows whether all ranks were given the same effects and supports.
        let mut hasher = DefaultHasher::new();
        for e in &self.effects {
            e.effect.name().hash(&mut hasher);
        }
        for m in &self.supports {
            m.amplitude.as_f64().to_bits().hash(&mut hasher);
        }
        let what = format!("the effects on '{model}' and its supports");
        owned.agree(&what, hasher.finish())?;
        let (layout, v) = (self.model.layout(), &self.state.v);
        // An effect that cannot add its power unit by unit acts on whole models only.
        let whole = |e: &&Attached<T, _>| !Effect::add_power(&*e.effect, &layout, v, &mut Exact::zero());
        self.effects.iter().find(whole).map_or(Ok(()), |e| {
            let (effect, ranks) = (e.effect.name(), owned.ranks());
            Err(Error::Unsupported {
                model: model.to_owned(),
                what: format!(
                    "have the effect '{effect}' while it is in parts on {ranks} ranks; run it on one"
                ),
            })
        })
    }

    /// Marks the unknowns whose motion is prescribed; refuses unknowns that do not exist or are prescribed
    /// twice.
    fn prescribed(&self) -> Result<Vec<bool>> {
        let dofs = self.model.layout().dofs();
        let mut out = vec![false; dofs];
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
                if d >= dofs {
                    return Err(Error::SizeMismatch {
                        what: format!("supported unknowns of '{}'", self.model.name()),
                        expected: dofs,
                        found: d + 1,
                    });
                }
                if std::mem::replace(&mut out[d], true) {
                    let what = format!("support of '{}'", self.model.name());
                    return Err(invalid(
                        &what,
                        format_args!("unknown {d}"),
                        "is prescribed twice; remove one of the supports",
                    ));
                }
            }
        }
        Ok(out)
    }

    /// Computes the inverse inertia, zero where motion is prescribed and where nodes sleep; refuses other
    /// nodes without mass.
    fn invert(&mut self, prescribed: &[bool]) -> Result<()> {
        let layout = self.model.layout();
        let top = self.inertia[..layout.translations()]
            .iter()
            .fold(T::zero(), |a, b| a.max(*b));
        let top = self.owned().largest(top);
        if self.sleeps {
            self.put_to_sleep(top);
        }
        for (i, m) in self.inertia.iter().enumerate() {
            // Round-off of element means may leave a few epsilon of the largest mass where there should be
            // none. Inertia of rotations may be that small beside masses, so only zero is refused there.
            let sleeps = self.sleeps && self.is_asleep(layout.node_of(i));
            if !prescribed[i]
                && !sleeps
                && *m <= top * T::epsilon() * T::of(4.0)
                && (i < layout.translations() || *m <= T::zero())
            {
                let node = layout.node_of(i);
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
            // A zero keeps forces and constraints from moving a prescribed unknown.
            self.inverse_inertia[i] = if prescribed[i] || sleeps {
                T::zero()
            } else {
                T::one() / *m
            };
        }
        Ok(())
    }

    /// Returns the view of the prepared subdomain that effects get.
    pub(crate) fn host(&self) -> Host<'_, T> {
        Host {
            model: &*self.model,
            weights: &self.weights,
            inertia: &self.inertia,
            inverse_inertia: &self.inverse_inertia,
            is_partitioned: self.is_partitioned,
        }
    }

    /// Returns the critical step \[s\] of the weighted model with its effects and with the demands `between`
    /// of pair effects.
    ///
    /// Damping forces use the velocity half a step earlier, which shortens the stable step to `2/ω (√(1 +
    /// ζ²) − ζ)` with `ζ = c/(2ω)`; see [`crate::effect::StepDemand`] for what adds to `ω` and `c`.
    ///
    /// If a lower bound of it is not below the own step `asked`, this bound is returned, with `true`.
    ///
    /// Where nodes may sleep, weights change: the step is then at most that of the model with a weight of
    /// one, and a share of it unless a step is asked for.
    pub(crate) fn critical_step(&mut self, between: &[StepDemand<T>], asked: Option<T>) -> Result<(T, bool)> {
        let share = if asked.is_some() {
            T::one()
        } else {
            T::of(CHANGING)
        };
        let limit = self.unweighted.as_ref().map(|u| share * u.step);
        let limited = |step: T| limit.map_or(step, |limit| step.min(limit));
        let bound = |dt| {
            let bound = self.model.views().step_bound?.step_bound(&self.inverse_inertia);
            Some((dt, self.with_demands(limited(bound), between)))
        };
        if let Some((dt, bound)) = asked.and_then(bound)
            && dt <= bound
        {
            return Ok((bound, true));
        }
        let free = match self.partly_weighted() {
            // What has the weight one is stiffest as a whole, and what sleeps does not move.
            Some(inverse_inertia) => self.model.critical_step(&inverse_inertia)?,
            None => self.model.critical_step(&self.inverse_inertia)?,
        };
        Ok((self.with_demands(limited(free), between), false))
    }

    /// Returns the masses and the critical step of the model with a weight of one everywhere. The model keeps
    /// this weight.
    fn without_weight(&mut self) -> Result<Unweighted<T>> {
        self.model.set_internal_weight(&Uniform(T::one()))?;
        let mut inertia = vec![T::zero(); self.inertia.len()];
        self.model.lumped_inertia(&Uniform(T::one()), &mut inertia)?;
        let layout = self.model.layout();
        let mass = (0..layout.nodes)
            .map(|k| inertia[k * layout.components])
            .collect();
        inertia
            .iter_mut()
            .for_each(|m| *m = if *m > T::zero() { m.recip() } else { T::zero() });
        Ok(Unweighted {
            mass,
            step: self.model.critical_step(&inertia)?,
        })
    }

    /// Returns the inverse inertia of the nodes with a weight between zero and one, zero for the others;
    /// `None` if the masses without weight are not known.
    fn partly_weighted(&self) -> Option<Vec<T>> {
        let mass = &self.unweighted.as_ref()?.mass;
        let layout = self.model.layout();
        let is_part = |node: usize| {
            let own = self.inertia[node * layout.components];
            own < mass[node] * (T::one() - T::of(1e-9))
        };
        let value = |(i, w): (usize, &T)| if is_part(layout.node_of(i)) { *w } else { T::zero() };
        Some(self.inverse_inertia.iter().enumerate().map(value).collect())
    }

    /// Returns the critical step \[s\] with effects, from that of the model alone.
    fn with_demands(&self, free: T, between: &[StepDemand<T>]) -> T {
        if self.effects.is_empty() && between.is_empty() {
            return free;
        }
        let demands = self
            .effects
            .iter()
            .map(|e| self.largest_demand(e.effect.step_demand()));
        shortened(free, demands.chain(between.iter().copied()))
    }

    /// Returns the largest demand of an effect over all ranks.
    fn largest_demand(&self, d: StepDemand<T>) -> StepDemand<T> {
        let owned = self.owned();
        let largest = |x: T| owned.largest(x);
        StepDemand {
            stiffness: largest(d.stiffness),
            gain: largest(d.gain),
            damping: largest(d.damping),
            viscosity: largest(d.viscosity),
        }
    }
}

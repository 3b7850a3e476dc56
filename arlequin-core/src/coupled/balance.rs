//! Energy balance, evaluated every few steps, and the limits of its drift.
//!
//! The drift `H − H_0 − work` may be as large as
//!
//! ```text
//! |drift| ≤ 1e-9 E + digits + 10 Σ |ΔU + ½ Δq·(f_n + f_{n+1})|
//! ```
//!
//! with the largest energy `E` so far (in single precision 4096 units of round-off in place of 1e-9). The sum
//! is over all own steps, extrapolated from those at which the balance is evaluated. Each term is the error
//! of the trapezium rule, by which the scheme takes the work of the internal forces `f`: a step changes `H`
//! by the mean of its term and that of the step before. For a linear law the term is round-off; for others it
//! is of third order in the step, and of either sign. A larger drift gives a warning, and a drift above
//! [`Guard::growth`](super::Guard::growth) ends the run.

use super::ledger::EnergySample;
use super::warning::{Suspect, Warning};
use super::{Coupled, ROUND_OFF, portions};
use crate::interface::joint::Joint;
use crate::subdomain::Subdomain;
use crate::weight::Weighting;
use crate::{Error, Real, Result, parallel};

/// Largest share of the energy in play that effects may create. Sound laws create none but for round-off and
/// for the work, within a step, of forces that they do not know (multipliers): decision 0011 has the figures.
const CREATED: f64 = 1e-3;

/// Accepted drift of linear laws, relative to the largest energy so far; measured: below 1e-11 after a
/// million steps.
const LINEAR: f64 = 1e-9;

/// Accepted drift of linear laws and accepted velocity jump in units of round-off. In single precision this
/// is more than the limits above and replaces them.
const DIGITS: f64 = 4096.0;

/// Safety factor of the sum in the module's bound, which is extrapolated from every tenth step.
const SAMPLED: f64 = 10.0;

/// Relative drift above which there is a warning whatever the laws.
const ANY_LAW: f64 = 1e-2;

/// Velocity jump, relative to the largest velocity, above which there is a warning, and above which the run
/// ends.
const VELOCITY_JUMP: [f64; 2] = [1e-6, 0.05];

/// Displacement jump over the deformation of the overlap above which there is a warning.
const DISPLACEMENT_JUMP: f64 = 0.05;

/// Share of an impulse that may be missing before the run ends.
const MISSED: f64 = 0.05;

impl<T: Real> Coupled<T> {
    /// Refuses effects that created energy.
    pub(super) fn check_created(&mut self) -> Result<()> {
        let created = self.created();
        let (_, volume) = self.total_work();
        // Energy in play: that of the start, or the moduli of all works if more.
        let reference = self.ledger.start.unwrap_or_default().abs().max(volume);
        if reference > T::zero() {
            let relative = created / reference;
            self.ledger.top_created = self.ledger.top_created.max(relative);
        }
        // A user may tighten the guard, but not loosen this limit.
        let share = self.guard.growth.min(T::of(CREATED));
        let bound = share * reference + self.rounded;
        // Without energy in play there is nothing to compare with.
        if created <= bound || reference <= T::zero() {
            return Ok(());
        }
        Err(Error::EnergyGrowth {
            step: self.step,
            time: self.time.as_f64(),
            excess: created.as_f64(),
            bound: bound.as_f64(),
            percent: 100.0 * share.as_f64(),
        })
    }

    /// Returns the sum of all works, and the sum of their moduli \[J\].
    fn total_work(&self) -> (T, T) {
        let works = self
            .subdomains
            .iter()
            .flat_map(Subdomain::works)
            .chain(self.pairs.iter().map(|p| p.line.work()));
        // Supports and the constraint do work as well: without them the balance would not close.
        let rezoning = self.conversions.work().unwrap_or_else(T::zero);
        let mut all_works = works.chain([self.ledger.supports, self.ledger.constraint, rezoning]);
        all_works
            .by_ref()
            .fold((T::zero(), T::zero()), |(s, a), w| (s + w, a + w.abs()))
    }

    /// Returns the error for a quantity that is no longer finite. It names the first model with such
    /// velocities, or else with such an energy.
    pub(super) fn diverged(&self, what: &'static str) -> Error {
        // A failed exchange makes sums NaN on all ranks: it is the cause then.
        if let Err(e) = portions::check_communication(&self.subdomains) {
            return e;
        }
        let energy = |s: &Subdomain<T>| s.kinetic_energy() + s.drawn_energy();
        let subdomains = || self.subdomains.iter();
        let culprit = subdomains().find(|s| !s.is_finite());
        let culprit = culprit.or_else(|| subdomains().find(|s| !energy(s).is_finite()));
        Error::Diverged {
            step: self.step,
            time: self.time.as_f64(),
            what,
            model: culprit.map_or_else(String::new, |s| s.model().name().to_owned()),
        }
    }

    /// Evaluates the balance; `curvature` holds the terms of the module's sum in one macro step.
    pub(super) fn balance(&mut self, [invariant, curvature]: [T; 2]) -> Result<EnergySample<T>> {
        // The kinetic energy is finite only if all velocities are.
        let kinetic: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        if !kinetic.is_finite() {
            return Err(self.diverged("velocity"));
        }
        portions::agree(&self.subdomains, invariant, self.step)?;
        let residual = self.check_jumps()?;
        let (work, volume) = self.total_work();
        // Before the first evaluation only a model that changed itself in the first step has done work.
        let start = *self.ledger.start.get_or_insert(invariant - work);
        let drift = invariant - start - work;
        // The scale never shrinks: a drift is judged against the largest energy there was.
        let scale = self.ledger.scale.max(start.abs());
        let scale = scale.max(invariant.abs()).max(volume);
        self.ledger.scale = scale;
        let relative = if scale > T::zero() {
            drift / scale
        } else {
            T::zero()
        };
        // One evaluation stands for all steps since the one before.
        let steps = self.guard.interval.min(self.step);
        self.ledger.curvature += curvature * T::of(steps as f64);
        let grown = relative.abs() > self.ledger.top_drift;
        self.ledger.top_drift = self.ledger.top_drift.max(relative.abs());
        self.ledger.top_residual = self.ledger.top_residual.max(residual);
        let sample = EnergySample {
            step: self.step,
            time: self.time,
            kinetic,
            internal: self.subdomains.iter().map(|s| s.drawn_energy()).sum(),
            invariant,
            work,
            drift,
            relative_drift: relative,
            momentum_drift: self.momentum_drift(),
            constraint_residual: residual,
        };
        if !drift.is_finite() {
            return Err(self.diverged("energy"));
        }
        self.warn_of_momentum();
        // A drift that is not the largest so far has been judged before.
        if grown {
            self.check_drift(drift)?;
        }
        // Growth is relative to the energy put in, since the energy itself grows.
        self.check_growth(drift, start.abs().max(volume))?;
        self.ledger.last = Some(sample.clone());
        Ok(sample)
    }

    /// Checks the jumps of all interfaces; returns the largest velocity jump over the largest speed so far.
    fn check_jumps(&mut self) -> Result<T> {
        let top = self.top_speed();
        self.ledger.top_velocity = top;
        let mut residual = T::zero();
        for k in 0..self.interfaces.len() {
            let [velocity, displacement] = self.jumps(k);
            residual = residual.max(velocity);
            self.check_velocity_jump(k, velocity, top)?;
            let sides = self.interfaces[k].sides().map(|s| &self.subdomains[s]);
            let own_steps = sides.map(Subdomain::own_steps);
            // The side with more own steps has more round-off.
            let steps = self.step * own_steps[0].max(own_steps[1]);
            self.overlaps[k].update(sides, displacement, steps, &mut self.ledger.jumps[k]);
            if self.overlaps[k].has_settled() {
                self.warn_of_displacement_jump(k);
            }
        }
        Ok(if top > T::zero() { residual / top } else { residual })
    }

    /// Largest component of velocity so far \[m/s\], over all models and ranks.
    fn top_speed(&self) -> T {
        let speed = |s: &Subdomain<T>| {
            let largest = parallel::largest(&s.state().v[..s.model().layout().translations()]);
            s.owned().largest(largest)
        };
        let speeds = self.subdomains.iter().map(speed);
        speeds.fold(self.ledger.top_velocity, |a, b| a.max(b))
    }

    /// Checks the velocity jump of interfaces whose multipliers did not reach their tolerance in this step.
    pub(super) fn check_multipliers(&mut self) -> Result<()> {
        for k in 0..self.interfaces.len() {
            let together = |j: &Joint<T>| j.is_unsolved() && j.members.contains(&k);
            let i = &self.interfaces[k];
            if !i.is_cut_short() && (i.is_unsolved() || self.joints.iter().any(together)) {
                let (top, [velocity, _]) = (self.top_speed(), self.jumps(k));
                self.check_velocity_jump(k, velocity, top)?;
            }
        }
        Ok(())
    }

    /// Checks the velocity jumps of all interfaces at the start.
    pub(super) fn check_start(&mut self) -> Result<()> {
        let top = self.top_speed();
        for k in 0..self.interfaces.len() {
            let [velocity, _] = self.jumps(k);
            self.check_velocity_jump(k, velocity, top)?;
        }
        Ok(())
    }

    /// Warns of a velocity jump \[m/s\] that is too large beside the `top` speed. Refuses a larger one,
    /// unless the user limited the iterations.
    fn check_velocity_jump(&mut self, k: usize, jump: T, top: T) -> Result<()> {
        let i = &self.interfaces[k];
        let [noted, accepted] = VELOCITY_JUMP;
        let noted = T::of(noted).max(T::epsilon() * T::of(DIGITS));
        // A lumped operator meets the constraint in the mean only: a jump is no fault.
        if i.report().solver == "lumped" || jump <= top * noted {
            return Ok(());
        }
        let (share, iterations) = ((jump / top).as_f64(), i.iterations());
        // Direct solvers have no iterations to add: their jump is reported, not refused.
        if share > accepted && iterations > 0 && !i.is_cut_short() {
            return Err(Error::MultipliersUnsolved {
                interface: i.report().name.clone(),
                step: self.step,
                iterations,
                share,
                limit: accepted,
            });
        }
        // A known warning is updated in place: a step that is warned of again must not allocate.
        for known in &mut self.warnings {
            if let Warning::VelocityJump {
                interface,
                step,
                iterations: taken,
                share: largest,
                ..
            } = known
                && *interface == i.report().name
            {
                // Step and iterations belong to the largest share.
                if *largest < share {
                    (*step, *taken, *largest) = (self.step, iterations, share);
                }
                return Ok(());
            }
        }
        let warning = Warning::VelocityJump {
            interface: i.report().name.clone(),
            step: self.step,
            iterations,
            share,
            limit: noted.as_f64(),
        };
        self.warn(warning);
        Ok(())
    }

    /// Warns of displacement jumps as they stand, even where the amplitude of an overlap has not settled. To
    /// be called where a run ends; within a run the same warnings come once amplitudes have settled.
    pub fn warn_of_jumps(&mut self) {
        (0..self.interfaces.len()).for_each(|k| self.warn_of_displacement_jump(k));
    }

    fn warn_of_displacement_jump(&mut self, k: usize) {
        let jump = self.ledger.jumps[k];
        if jump.share() <= T::of(DISPLACEMENT_JUMP) {
            return;
        }
        let i = &self.interfaces[k];
        // A known warning is updated in place: a step that is warned of again must not allocate.
        for known in &mut self.warnings {
            if let Warning::DisplacementJump {
                interface,
                jump: largest,
                share,
                ..
            } = known
                && *interface == i.report().name
            {
                *largest = largest.max(jump.largest.as_f64());
                *share = share.max(jump.share().as_f64());
                return;
            }
        }
        let sides = i.sides().map(|s| &self.subdomains[s]);
        let warning = Warning::DisplacementJump {
            interface: i.report().name.clone(),
            models: sides.map(|s| s.model().name().to_owned()),
            own_steps: sides.map(Subdomain::own_steps),
            jump: jump.largest.as_f64(),
            share: jump.share().as_f64(),
            limit: DISPLACEMENT_JUMP,
        };
        self.warn(warning);
    }

    /// Returns the sum of the invariants of all models, and the terms of the module's sum in one macro step.
    pub(super) fn draw_invariants(&mut self) -> [T; 2] {
        let mut curvature = T::zero();
        let invariants = self.subdomains.iter_mut().map(|s| {
            let [invariant, term] = s.invariant();
            // The term of the last own step stands for all own steps of the macro step.
            curvature += term.abs() * T::of(s.own_steps() as f64);
            invariant
        });
        [invariants.sum(), curvature]
    }

    /// Drift of the balance so far that the laws of the models and round-off explain, relative to the largest
    /// energy.
    pub fn explained_drift(&self) -> T {
        let linear = T::of(LINEAR).max(T::epsilon() * T::of(DIGITS));
        let scale = self.ledger.scale;
        if scale <= T::zero() {
            return linear;
        }
        let laws = linear + T::of(SAMPLED) * self.ledger.curvature / scale;
        // Whatever the laws, one per cent is not explained.
        laws.min(T::of(ANY_LAW)) + self.rounded / scale
    }

    /// Warns of the largest drift so far if it exceeds what is explained, and refuses a loss beyond the
    /// guard.
    fn check_drift(&mut self, drift: T) -> Result<()> {
        let (limit, scale) = (self.explained_drift(), self.ledger.scale);
        if drift.abs() <= limit * scale {
            return Ok(());
        }
        // Round-off of the present displacements takes a pass over all unknowns, so it is computed only here.
        let digits = self.round_off() * T::of(ROUND_OFF);
        if drift.abs() <= limit * scale + digits {
            return Ok(());
        }
        let bound = self.guard.growth * scale + digits;
        // Only a loss: growth is judged against the energy put in.
        if -drift > bound {
            return Err(Error::EnergyLoss {
                step: self.step,
                time: self.time.as_f64(),
                missing: -drift.as_f64(),
                bound: bound.as_f64(),
                percent: 100.0 * self.guard.growth.as_f64(),
                suspect: self.suspect().to_string(),
            });
        }
        let suspect = self.suspect();
        self.warn(Warning::EnergyDrift {
            step: self.step,
            time: self.time.as_f64(),
            drift: drift.as_f64(),
            share: (drift.abs() / scale).as_f64(),
            limit: limit.as_f64(),
            suspect,
        });
        Ok(())
    }

    /// Returns the most likely cause of an energy error.
    fn suspect(&self) -> Suspect {
        let name = |s: &Subdomain<T>| s.model().name().to_owned();
        let mut subdomains = self.subdomains.iter();
        // Nodal weights are known to change the energy, so they come first.
        if let Some(s) = subdomains.find(|s| s.weights().weighting == Weighting::Nodal) {
            return Suspect::Nodal(name(s));
        }
        let mut subdomains = self.subdomains.iter();
        subdomains
            .find(|s| s.is_external())
            .map_or(Suspect::Anybody, |s| Suspect::Solver(name(s)))
    }

    /// Warns of external solvers that report no energy.
    pub(super) fn warn_of_unknown_energy(&mut self) {
        for model in self.unknown_energies() {
            self.warn(Warning::EnergyUnknown { model });
        }
    }

    /// Names of the models whose energy is not known: external solvers that report no invariant.
    pub fn unknown_energies(&self) -> Vec<String> {
        let unknown = self.subdomains.iter().filter(|s| !s.reports_energy());
        unknown.map(|s| s.model().name().to_owned()).collect()
    }

    /// Compares the velocities of external solvers that report no energy with the impulses that they received
    /// in this step; warns of a difference and refuses a large one.
    pub(super) fn check_impulses(&mut self) -> Result<()> {
        for k in 0..self.subdomains.len() {
            let Some([missed, limit]) = self.subdomains[k].missed_impulse() else {
                continue;
            };
            if missed <= limit {
                continue;
            }
            let model = self.subdomains[k].model().name().to_owned();
            let (share, limit) = (missed.as_f64(), limit.as_f64());
            // Round-off never ends a run.
            if share > MISSED.max(limit) {
                return Err(Error::ImpulseMissed {
                    model,
                    step: self.step,
                    share,
                    limit: MISSED,
                });
            }
            self.warn(Warning::ImpulseMissed { model, share, limit });
        }
        Ok(())
    }

    /// Returns the largest relative changes of linear and of angular momentum over all bodies.
    fn momentum_drift(&mut self) -> [T; 2] {
        let finest = self.subdomains.iter().map(Subdomain::own_steps).max();
        let finest = T::of(finest.unwrap_or(1) as f64);
        // Own steps so far over the length of one, for the finest model.
        let rate = T::of(self.step as f64) * finest * finest / self.dt;
        let mut drift = [T::zero(); 2];
        for b in &mut self.ledger.bodies {
            let changes = b.balance(&self.subdomains, rate);
            (0..2).for_each(|k| drift[k] = drift[k].max(changes[k]));
        }
        drift
    }

    /// Refuses an energy that has grown by more than the guard allows.
    fn check_growth(&self, drift: T, reference: T) -> Result<()> {
        let bound = self.guard.growth * reference + self.rounded;
        if reference > T::zero() && drift > bound {
            return Err(Error::EnergyGrowth {
                step: self.step,
                time: self.time.as_f64(),
                excess: drift.as_f64(),
                bound: bound.as_f64(),
                percent: 100.0 * self.guard.growth.as_f64(),
            });
        }
        Ok(())
    }
}

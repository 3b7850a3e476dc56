//! Statics as a run: a sequence of equilibria, one for each instant.
//!
//! Linear models under forces that depend on time alone are solved directly ([`Coupled::equilibrium`]), and
//! so are models that change themselves (bonds that break) until their first change. All others (contact,
//! large rotations) are relaxed: the models move as in a run while time
//! stands still, and all velocities are set to zero whenever the kinetic energy has passed a maximum (kinetic
//! damping, Cundall 1976). From one instant to the next, supports and loads change over [`Relaxation::ramp`]
//! steps.

use super::statics::Equilibrium;
use super::{Coupled, portions};
use crate::error::invalid;
use crate::geometry::bounds_of;
use crate::phase::Phase;
use crate::subdomain::{StepEnd, Subdomain};
use crate::{Error, Real, Result, parallel};

/// Parameters of a relaxation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation<T> {
    /// Residual that counts as equilibrium: largest unbalanced force on a free displacement, relative to the
    /// largest internal force since the instant before.
    pub tolerance: T,
    /// Largest number of steps.
    pub most: usize,
    /// Steps over which supports and loads change.
    pub ramp: usize,
}

impl<T: Real> Default for Relaxation<T> {
    /// Tolerance 1e-6, at most 200 000 steps, 500 of them for the change of loads.
    fn default() -> Self {
        Self {
            tolerance: T::of(1e-6),
            most: 200_000,
            ramp: 500,
        }
    }
}

/// An equilibrium that was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled<T> {
    /// Method that found the equilibrium: `direct` or `relaxed`.
    pub method: &'static str,
    /// Relative residual of the linear system, or the residual of [`Relaxation::tolerance`].
    pub residual: T,
    /// Steps of the relaxation; zero for a direct solution.
    pub iterations: usize,
    /// Weighted internal energy \[J\].
    pub energy: T,
}

/// Steps between two evaluations of the residual while the kinetic energy passes no maximum.
const LOOK: usize = 200;

/// Halvings of a load step in which a model changes itself: the relaxation begins within 1/64 of the load
/// step before the change.
const BISECTIONS: usize = 6;

impl<T: Real> Coupled<T> {
    /// Returns `Ok` if every equilibrium can be solved directly, otherwise the reason why not.
    pub fn solves_directly(&mut self) -> std::result::Result<(), String> {
        // A force between two models depends on their positions, which one linear system cannot know.
        if let Some(p) = self.pairs.first() {
            return Err(format!("'{}' acts between two models", p.line.effect.name()));
        }
        for s in &mut self.subdomains {
            if let Some(why) = s.not_direct() {
                return Err(format!("'{}': {why}", s.model().name()));
            }
        }
        Ok(())
    }

    /// Returns whether the run is solved directly until one of its models changes itself; none has yet.
    pub fn solves_until_change(&mut self) -> bool {
        let linear = |s: &mut Subdomain<T>| !s.has_changed() && s.not_linear().is_none();
        // A free rigid motion makes the system singular; relaxed runs resist it by inertia.
        self.pairs.is_empty()
            && !self.relaxes
            && self.subdomains.iter_mut().all(linear)
            && self.free_motions().is_empty()
    }

    /// Moves the run to the equilibrium under the loads and prescribed displacements of `time` \[s\]. The
    /// present state is that of the loads at `from` \[s\]. Velocities are zero afterwards, and the step
    /// counts as one. Works are not recorded.
    ///
    /// # Errors
    /// Errors of [`Coupled::equilibrium`]; [`Error::NotSettled`] if relaxation does not reach its tolerance;
    /// [`Error::Unsupported`] for an external solver and for a partitioned model.
    pub fn settle(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        if how.tolerance <= T::zero() || how.most == 0 {
            let settings = format_args!("tolerance {}, {} steps", how.tolerance, how.most);
            return Err(invalid(
                "relaxation",
                settings,
                "needs a positive tolerance and at least one step",
            ));
        }
        self.check_settling()?;
        let settled = match self.solves_directly() {
            // Not a fallback after a failure: models that cannot be solved directly are never tried.
            Ok(()) => {
                let equilibrium = self.equilibrium(time)?;
                self.rest_in(&equilibrium, time)?
            }
            Err(_) if self.solves_until_change() => self.settle_until_change(from, time, how)?,
            Err(_) => self.relax(from, time, how)?,
        };
        self.time = time;
        self.step += 1;
        Ok(settled)
    }

    /// Refuses a run that [`Self::settle`] cannot bring to rest, before its first load step.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for an external solver and for a partitioned model; [`Error::SingularSystem`]
    /// if models that are solved directly have a free rigid motion.
    pub fn check_rest(&mut self) -> Result<()> {
        self.check_settling()?;
        if self.solves_directly().is_err() {
            return Ok(());
        }
        let free = self.free_motions();
        // A free rigid motion makes the system singular; relaxed runs resist it by inertia.
        if free.is_empty() {
            return Ok(());
        }
        Err(Error::SingularSystem {
            size: self.subdomains.iter().map(|s| s.model().layout().dofs()).sum(),
            residual: f64::NAN,
            free: format!(": {free}"),
        })
    }

    fn check_settling(&self) -> Result<()> {
        portions::require_whole(&self.subdomains, "be brought to rest")?;
        match self.subdomains.iter().find(|s| s.is_external()) {
            None => Ok(()),
            Some(s) => Err(Error::Unsupported {
                model: s.model().name().to_owned(),
                what: "be brought to rest: it is a solver of its own".into(),
            }),
        }
    }

    /// Solves directly if the models stay as they are; otherwise relaxes from shortly before their change.
    fn settle_until_change(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        match self.equilibrium(time) {
            Ok(equilibrium) if self.stays_in(&equilibrium) => self.rest_in(&equilibrium, time),
            Ok(_) => {
                let start = self.approach_change(from, time)?;
                self.relax(start, time, how)
            }
            // Parts of a model that nothing holds, such as loose grains, are known by the factor alone.
            Err(Error::SingularSystem { .. }) => {
                self.relaxes = true;
                self.relax(from, time, how)
            }
            Err(e) => Err(e),
        }
    }

    /// Moves the run to an equilibrium shortly before a model changes itself on the way from one instant to
    /// another, by bisection; returns its time.
    fn approach_change(&mut self, from: T, time: T) -> Result<T> {
        let [mut low, mut high] = [from, time];
        let mut last = None;
        for _ in 0..BISECTIONS {
            let middle = (low + high) * T::of(0.5);
            let equilibrium = self.equilibrium(middle)?;
            if self.stays_in(&equilibrium) {
                (low, last) = (middle, Some(equilibrium));
            } else {
                high = middle;
            }
        }
        if let Some(equilibrium) = last {
            self.rest_in(&equilibrium, low)?;
        }
        Ok(low)
    }

    /// Returns whether all models stay as they are in an equilibrium.
    fn stays_in(&mut self, equilibrium: &Equilibrium<T>) -> bool {
        let mut states = self.subdomains.iter_mut().zip(&equilibrium.displacements);
        states.all(|(s, q)| s.stays(q))
    }

    /// Sets the run at rest in an equilibrium of the loads at `time` \[s\].
    fn rest_in(&mut self, equilibrium: &Equilibrium<T>, time: T) -> Result<Settled<T>> {
        for (s, q) in self.subdomains.iter_mut().zip(&equilibrium.displacements) {
            s.set_at_rest(q, time)?;
        }
        for (i, lambda) in self.interfaces.iter_mut().zip(&equilibrium.multipliers) {
            i.hold(lambda);
        }
        for j in &mut self.joints {
            j.restore(&self.interfaces);
        }
        Ok(Settled {
            // Partial pivoting takes several times as long, after a factor without it was given up.
            method: if equilibrium.pivoted {
                "direct, with pivoting"
            } else {
                "direct"
            },
            residual: equilibrium.residual,
            iterations: 0,
            energy: equilibrium.energy,
        })
    }

    /// Relaxes with one own step of all models.
    fn relax(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        let steps: Vec<usize> = self.subdomains.iter().map(Subdomain::own_steps).collect();
        if steps.iter().all(|m| *m == 1) {
            return self.relax_in_step(from, time, how);
        }
        // With several own steps, a model moves between two reflections under forces that the multipliers
        // balance in the mean only. It moves by its stiffness, and the state that returns at every reflection
        // is no equilibrium.
        let run = self.dt;
        // The shortest own step is stable for every model.
        let shortest = self.subdomains.iter().fold(run, |m, s| m.min(s.own_dt()));
        self.change_pace(shortest, &vec![1; steps.len()])?;
        let settled = self.relax_in_step(from, time, how);
        // The run gets its steps back even if it did not settle.
        self.change_pace(run, &steps)?;
        settled
    }

    /// Changes the macro step and the own steps; multipliers stay as they are.
    fn change_pace(&mut self, run: T, steps: &[usize]) -> Result<()> {
        for (s, m) in self.subdomains.iter_mut().zip(steps) {
            s.set_pace(run, *m)?;
        }
        self.dt = run;
        for i in &mut self.interfaces {
            // Impulses are multipliers times the step, so they are computed again for the new step.
            let lambda = i.multipliers().to_vec();
            i.pace(run);
            i.hold(&lambda);
        }
        for j in &mut self.joints {
            j.pace(run);
            j.restore(&self.interfaces);
        }
        Ok(())
    }

    fn relax_in_step(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        let mut peak = T::zero();
        let mut residual = T::of(f64::INFINITY);
        self.stop()?;
        // Where bonds break, forces are compared with the largest one before, not with the zero that is left.
        let mut borne = self.largest_internal_force()?;
        for k in 1..=how.most {
            // Loads ramp up over the first steps, so that the relaxation does not start with a blow.
            let share = T::of((k as f64 / how.ramp.max(1) as f64).min(1.0));
            let now = if k >= how.ramp {
                time
            } else {
                from + (time - from) * share
            };
            self.still_step(now)?;
            let kinetic: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
            if !kinetic.is_finite() {
                return Err(self.diverged("velocity"));
            }
            // Past a maximum of kinetic energy the models are near a minimum of potential energy: stop them
            // there.
            let passed = kinetic < peak;
            peak = kinetic;
            // Between maxima the residual is looked at rarely: it costs an evaluation of all forces.
            if passed || (k >= how.ramp && k.is_multiple_of(LOOK)) {
                if passed {
                    self.stop()?;
                    peak = T::zero();
                }
                // Forces below round-off cannot be balanced any better.
                borne = borne
                    .max(self.largest_internal_force()?)
                    .max(self.round_off_force() / how.tolerance);
                // While loads still change there is no equilibrium to reach.
                if k >= how.ramp {
                    let off = self.largest_unbalanced_force(now)?;
                    residual = if borne > T::zero() { off / borne } else { off };
                    if residual <= how.tolerance {
                        self.stop()?;
                        return Ok(Settled {
                            method: "relaxed",
                            residual,
                            iterations: k,
                            energy: self.subdomains.iter().map(Subdomain::internal_energy).sum(),
                        });
                    }
                }
            }
        }
        Err(Error::NotSettled {
            time: time.as_f64(),
            residual: residual.as_f64(),
            tolerance: how.tolerance.as_f64(),
            steps: how.most,
            free: String::new(),
        })
    }

    /// Makes one macro step while time stands still.
    fn still_step(&mut self, time: T) -> Result<()> {
        self.apply_second_half();
        for g in 0..self.lockstep.len() {
            let first = &self.subdomains[self.lockstep[g].members[0]];
            let (steps, dt) = (first.own_steps(), first.own_dt());
            for _ in 0..steps {
                // Prescribed unknowns are moved, but have no velocity.
                let step_end = StepEnd {
                    time,
                    since: dt,
                    dt: T::zero(),
                };
                self.own_step(g, step_end, false, &mut |_: Phase| {})?;
            }
        }
        self.reflect()
    }

    /// Sets all velocities to zero; the multipliers become those of the accelerations at rest.
    fn stop(&mut self) -> Result<()> {
        for s in &mut self.subdomains {
            s.velocities().fill(T::zero());
        }
        self.reflect_start()
    }

    /// Returns the force \[N\] that round-off of displacements and positions is worth, `m ω² ε (|q| + |x|)`
    /// with the highest frequency `ω` of each model.
    fn round_off_force(&self) -> T {
        let models = self.subdomains.iter().zip(&self.critical);
        models
            .map(|(s, critical)| {
                let layout = s.model().layout();
                let mass = parallel::largest(&s.inertia()[..layout.translations()]);
                let [low, high] = bounds_of(s.model().nodes().iter());
                // A rigid displacement is round-off of positions too, hence the extent of the body.
                let reach = parallel::largest(&s.state().q[..layout.translations()]) + (high - low).norm();
                let omega = T::of(2.0) / *critical;
                mass * omega * omega * reach * T::epsilon()
            })
            .filter(|f| f.is_finite())
            .fold(T::zero(), |a, b| a.max(b))
    }

    /// Returns the largest internal force on a displacement \[N\].
    fn largest_internal_force(&mut self) -> Result<T> {
        let mut most = T::zero();
        for s in &mut self.subdomains {
            let layout = s.model().layout();
            let mut forces = vec![T::zero(); layout.dofs()];
            s.internal_forces_now(&mut forces)?;
            most = most.max(parallel::largest(&forces[..layout.translations()]));
        }
        Ok(most)
    }

    /// Returns the largest unbalanced force on a free displacement \[N\].
    fn largest_unbalanced_force(&mut self, time: T) -> Result<T> {
        let mut off = T::zero();
        for k in 0..self.subdomains.len() {
            let s = &mut self.subdomains[k];
            let moving = s.model().layout().translations();
            let mut forces = vec![T::zero(); s.model().layout().dofs()];
            s.write_forces(time, &mut forces)?;
            for i in &self.interfaces {
                for (m, sign) in [-T::one(), T::one()].into_iter().enumerate() {
                    // Multipliers act by −Bᵀλ on the coarse and by +Bᵀλ on the fine model.
                    if i.sides[m] == k {
                        i.coupling[m].add_force(sign, i.multipliers(), &mut forces);
                    }
                }
            }
            // Supports balance the prescribed unknowns.
            let free = self.subdomains[k].inverse_inertia()[..moving].iter().zip(&forces);
            // Inverse inertia zero marks prescribed unknowns.
            let free = free.filter(|(w, _)| **w > T::zero());
            off = free.fold(off, |m, (_, f)| m.max(f.abs()));
        }
        Ok(off)
    }
}

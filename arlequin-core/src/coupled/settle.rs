//! Statics as a run: the state goes to the equilibrium of one instant after another.
//!
//! Linear models under forces that depend on time alone are solved directly ([`Coupled::equilibrium`]).
//! Whatever else there is (contact, bonds that break, large rotations) is relaxed: the models move as in a
//! run at a time that stands still, and all velocities are taken away whenever the kinetic energy has
//! passed a maximum (kinetic damping, Cundall 1976). On the way from one instant to the next, supports and
//! loads change over [`Relaxation::ramp`] steps.

use super::{Coupled, portions};
use crate::error::invalid;
use crate::geometry::bounds_of;
use crate::phase::Phase;
use crate::subdomain::{Reached, Subdomain};
use crate::{Error, Real, Result, parallel};

/// How a state is relaxed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation<T> {
    /// Residual that counts as equilibrium: largest unbalanced force on a free displacement over the
    /// largest internal force that there was on the way from the instant before.
    pub tolerance: T,
    /// Most steps.
    pub most: usize,
    /// Steps over which supports and loads change.
    pub ramp: usize,
}

impl<T: Real> Default for Relaxation<T> {
    /// To 1e-6, in at most 200 000 steps, 500 of them for the change.
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
    /// `direct` or `relaxed`.
    pub method: &'static str,
    /// Relative residual of the linear system, or that of [`Relaxation::tolerance`].
    pub residual: T,
    /// Steps of the relaxation; none for a direct solution.
    pub iterations: usize,
    /// Weighted internal energy \[J\].
    pub energy: T,
}

/// Steps between two looks at the residual while nothing peaks.
const LOOK: usize = 200;

impl<T: Real> Coupled<T> {
    /// Whether the run can be solved directly; why not otherwise.
    pub fn solves_directly(&mut self) -> std::result::Result<(), String> {
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

    /// Goes to the equilibrium under the loads and prescribed displacements of a time \[s\], from the
    /// present state under those of `from`: velocities are zero then, and the step counts as one. Works are
    /// not accounted for.
    ///
    /// # Errors
    /// Those of [`Coupled::equilibrium`]; [`Error::NotSettled`] where relaxation does not reach its
    /// tolerance; [`Error::Unsupported`] for a solver of its own.
    pub fn settle(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        if how.tolerance <= T::zero() || how.most == 0 {
            let found = format_args!("tolerance {}, {} steps", how.tolerance, how.most);
            return Err(invalid(
                "relaxation",
                found,
                "needs a positive tolerance and at least one step",
            ));
        }
        self.check_settling()?;
        let settled = match self.solves_directly() {
            Ok(()) => self.settle_directly(time)?,
            Err(_) => self.relax(from, time, how)?,
        };
        self.time = time;
        self.step += 1;
        Ok(settled)
    }

    /// Refuses a run that [`Self::settle`] cannot bring to rest, before its first load step.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a solver of its own, and for models in parts; [`Error::SingularSystem`]
    /// where a rigid motion of models that are solved for directly is held by nothing.
    pub fn check_rest(&mut self) -> Result<()> {
        self.check_settling()?;
        if self.solves_directly().is_err() {
            return Ok(());
        }
        let free = self.free_motions();
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
        portions::whole(&self.subdomains, "be brought to rest")?;
        match self.subdomains.iter().find(|s| s.is_guest()) {
            None => Ok(()),
            Some(s) => Err(Error::Unsupported {
                model: s.model().name().to_owned(),
                what: "be brought to rest: it is a solver of its own".into(),
            }),
        }
    }

    fn settle_directly(&mut self, time: T) -> Result<Settled<T>> {
        let found = self.equilibrium(time)?;
        for (s, q) in self.subdomains.iter_mut().zip(&found.displacements) {
            s.rest(q, time)?;
        }
        for (i, lambda) in self.interfaces.iter_mut().zip(&found.multipliers) {
            i.hold(lambda);
        }
        for j in &mut self.joints {
            j.restore(&self.interfaces);
        }
        Ok(Settled {
            method: "direct",
            residual: found.residual,
            iterations: 0,
            energy: found.energy,
        })
    }

    /// Relaxes with one own step of all models. With several, a model moves on between two reflections
    /// under forces that the multipliers balance in the mean only, by its stiffness: what comes back at
    /// every reflection is no equilibrium.
    fn relax(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
        let steps: Vec<usize> = self.subdomains.iter().map(Subdomain::own_steps).collect();
        if steps.iter().all(|m| *m == 1) {
            return self.relax_in_step(from, time, how);
        }
        let run = self.dt;
        let shortest = self.subdomains.iter().fold(run, |m, s| m.min(s.own_dt()));
        self.change_pace(shortest, &vec![1; steps.len()])?;
        let settled = self.relax_in_step(from, time, how);
        self.change_pace(run, &steps)?;
        settled
    }

    /// Steps of another length from now on; multipliers stay as they are.
    fn change_pace(&mut self, run: T, steps: &[usize]) -> Result<()> {
        for (s, m) in self.subdomains.iter_mut().zip(steps) {
            s.set_pace(run, *m)?;
        }
        self.dt = run;
        for i in &mut self.interfaces {
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
        // What came apart is held against what it bore, not against the nothing that is left.
        let mut borne = self.carried()?;
        for k in 1..=how.most {
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
            let passed = kinetic < peak;
            peak = kinetic;
            if passed || (k >= how.ramp && k.is_multiple_of(LOOK)) {
                if passed {
                    self.stop()?;
                    peak = T::zero();
                }
                borne = borne.max(self.carried()?).max(self.last_digits() / how.tolerance);
                if k >= how.ramp {
                    let off = self.unbalanced(now)?;
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

    /// One step of the run at a time that stands still.
    fn still_step(&mut self, time: T) -> Result<()> {
        self.kick_again();
        for g in 0..self.lockstep.len() {
            let first = &self.subdomains[self.lockstep[g].members[0]];
            let (steps, dt) = (first.own_steps(), first.own_dt());
            for _ in 0..steps {
                // Prescribed unknowns are moved, but have no velocity.
                let reached = Reached {
                    time,
                    since: dt,
                    dt: T::zero(),
                };
                self.own_step(g, reached, false, &mut |_: Phase| {})?;
            }
        }
        self.reflect()
    }

    /// Takes all velocities away; multipliers are then those that accelerations at rest need.
    fn stop(&mut self) -> Result<()> {
        for s in &mut self.subdomains {
            s.velocities().fill(T::zero());
        }
        self.reflect_start()
    }

    /// Force that last digits of displacements and places are worth, `m ω² ε (|q| + |x|)` with the highest
    /// frequency of each model.
    fn last_digits(&self) -> T {
        let all = self.subdomains.iter().zip(&self.critical);
        all.map(|(s, critical)| {
            let layout = s.model().layout();
            let mass = parallel::largest(&s.inertia()[..layout.translations()]);
            let [low, high] = bounds_of(s.model().nodes().iter());
            let reach = parallel::largest(&s.state().q[..layout.translations()]) + (high - low).norm();
            let omega = T::of(2.0) / *critical;
            mass * omega * omega * reach * T::epsilon()
        })
        .filter(|f| f.is_finite())
        .fold(T::zero(), |a, b| a.max(b))
    }

    /// Largest internal force on a displacement.
    fn carried(&mut self) -> Result<T> {
        let mut most = T::zero();
        for s in &mut self.subdomains {
            let layout = s.model().layout();
            let mut forces = vec![T::zero(); layout.dofs()];
            s.internal_forces_now(&mut forces)?;
            most = most.max(parallel::largest(&forces[..layout.translations()]));
        }
        Ok(most)
    }

    /// Largest unbalanced force on a free displacement.
    fn unbalanced(&mut self, time: T) -> Result<T> {
        let mut off = T::zero();
        for k in 0..self.subdomains.len() {
            let s = &mut self.subdomains[k];
            let moving = s.model().layout().translations();
            let mut forces = vec![T::zero(); s.model().layout().dofs()];
            s.pull(time, &mut forces)?;
            for i in &self.interfaces {
                for (m, sign) in [-T::one(), T::one()].into_iter().enumerate() {
                    if i.sides[m] == k {
                        i.coupling[m].add_force(sign, i.multipliers(), &mut forces);
                    }
                }
            }
            let free = self.subdomains[k].inverse_inertia()[..moving].iter().zip(&forces);
            let free = free.filter(|(w, _)| **w > T::zero());
            off = free.fold(off, |m, (_, f)| m.max(f.abs()));
        }
        Ok(off)
    }
}

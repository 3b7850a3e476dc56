//! Relaxation: the models move as in a run while time stands still, damped until they are at rest.
//!
//! The damping is proportional to the masses, so that it keeps the constraints of interfaces, and changes
//! from step to step (adaptive dynamic relaxation, Underwood 1983):
//!
//! ```text
//! v <- (1 − c ΔT/2)/(1 + c ΔT/2) v    c = max(2 ω, 3/t)    ω² = −vᵀM(a − a₋)/(ΔT vᵀMv)
//! ```
//!
//! `ω` is the Rayleigh quotient of the motion, with the accelerations `a` and, one step before, `a₋`.
//! Near-critical damping of fast motion lets it die first; what is left moves with a lower `ω`, down to the
//! slowest motion, which is then critically damped. A body that hangs on one bond swings over thousands of
//! steps: it comes to rest within a few periods. Velocities that are set to zero at each peak of kinetic
//! energy (kinetic damping, Cundall 1976) let it creep, because the fast motions have peaks all the time.
//!
//! A loose piece that drifts has no stiffness and would take all damping away (`ω` = 0). The second term,
//! with the time `t` since the start of the load step, slows it like `t⁻³`.
//!
//! A body that swings slowly as a whole has small forces on each node while its supports are far from
//! balance. Equilibrium therefore also means that the unbalanced forces of a model sum up to little:
//!
//! ```text
//! max |f| <= ε max |f_int|      |Σ f| <= 10 ε (Σ |f_ext| + Σ |R|)     along each axis, f on free unknowns
//! ```
//!
//! with the external forces `f_ext` of free unknowns and the reactions `R`, each the resultant of a support.
//!
//! Bonds break in the order in which this motion brings them to their strength, with the true masses and
//! while time stands still. The motion hardly swings beyond an equilibrium.

use super::Coupled;
use super::settle::{Relaxation, Settled};
use crate::geometry::bounds_of;
use crate::phase::Phase;
use crate::subdomain::{StepEnd, Subdomain};
use crate::{Error, Real, Result, parallel};

/// Steps between two evaluations of the residual, each of which costs as much as two steps.
const LOOK: usize = 100;
/// Residual of the sum of the unbalanced forces over that of single ones. A single force is compared with the
/// largest one at any bond, a sum with the whole load; where the load is less, as in a torn body, the sum is
/// held to the limit of a single force.
const OF_SUM: f64 = 10.0;
/// Largest `c ΔT/2`. Damping that stops the motion within a step would leave nothing to find `ω` from.
const MOST_DAMPING: f64 = 0.9;

impl<T: Real> Coupled<T> {
    /// Relaxes with one own step of all models.
    pub(super) fn relax(&mut self, from: T, time: T, how: &Relaxation<T>) -> Result<Settled<T>> {
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
        let mut residual = T::of(f64::INFINITY);
        self.stop()?;
        let accelerations = |s: &Subdomain<T>| s.state().a.clone();
        let mut before: Vec<Vec<T>> = self.subdomains.iter().map(accelerations).collect();
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
            self.still_step(now, k)?;
            self.damp(k, &mut before)?;
            if !k.is_multiple_of(LOOK) && k < how.most {
                continue;
            }
            // Forces below round-off cannot be balanced any better.
            borne = borne
                .max(self.largest_internal_force()?)
                .max(self.round_off_force() / how.tolerance);
            // While loads still change there is no equilibrium to reach.
            if k < how.ramp {
                continue;
            }
            let (off, sum) = self.unbalanced_forces(now, borne)?;
            let single = if borne > T::zero() { off / borne } else { off };
            residual = single.max(sum / T::of(OF_SUM));
            if residual <= how.tolerance {
                // Loose pieces may still drift. They are stopped where they are: a rigid motion strains
                // nothing, so that they are in equilibrium anywhere.
                self.stop()?;
                return Ok(Settled {
                    method: "relaxed",
                    residual,
                    iterations: k,
                    energy: self.subdomains.iter().map(Subdomain::internal_energy).sum(),
                });
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

    /// Damps the velocities after step `k` of a relaxation; `before` has the accelerations of the step
    /// before, and then those of this one.
    fn damp(&mut self, k: usize, before: &mut [Vec<T>]) -> Result<()> {
        let (mut stiff, mut heavy) = (T::zero(), T::zero());
        for (s, before) in self.subdomains.iter().zip(before) {
            let [of_stiffness, of_mass] = s.motion_sums(before);
            stiff += of_stiffness;
            heavy += of_mass;
            parallel::copy(before, &s.state().a);
        }
        if !heavy.is_finite() {
            return Err(self.diverged("velocity"));
        }
        // Negative where a bond broke, and 0/0 at rest: neither is a frequency.
        let squared = stiff * self.dt / heavy;
        let swing = if squared > T::zero() {
            squared.sqrt()
        } else {
            T::zero()
        };
        let damping = swing.max(T::of(1.5 / k as f64)).min(T::of(MOST_DAMPING));
        let keep = (T::one() - damping) / (T::one() + damping);
        for s in &mut self.subdomains {
            parallel::scale(keep, s.velocities());
        }
        Ok(())
    }

    /// Makes macro step `number`, counted from one, while time stands still.
    fn still_step(&mut self, time: T, number: usize) -> Result<()> {
        self.apply_second_half();
        for g in 0..self.lockstep.len() {
            let first = &self.subdomains[self.lockstep[g].members[0]];
            let (steps, dt) = (first.own_steps(), first.own_dt());
            for j in 1..=steps {
                // Prescribed unknowns are moved, but have no velocity.
                let step_end = StepEnd {
                    time,
                    since: dt,
                    dt: T::zero(),
                    number: (number - 1) * steps + j,
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

    /// Returns the largest unbalanced force on a free displacement \[N\], and the largest sum of them in a
    /// model along an axis over external forces and reactions, or over `borne/10` if these are less \[–\].
    fn unbalanced_forces(&mut self, time: T, borne: T) -> Result<(T, T)> {
        let (mut largest, mut sum) = (T::zero(), T::zero());
        for k in 0..self.subdomains.len() {
            let s = &mut self.subdomains[k];
            let layout = s.model().layout();
            let mut forces = vec![T::zero(); layout.dofs()];
            let mut internal = forces.clone();
            s.write_forces(time, &mut forces)?;
            s.internal_forces_now(&mut internal)?;
            for i in &self.interfaces {
                for (m, sign) in [-T::one(), T::one()].into_iter().enumerate() {
                    // Multipliers act by −Bᵀλ on the coarse and by +Bᵀλ on the fine model.
                    if i.sides[m] == k {
                        i.coupling[m].add_force(sign, i.multipliers(), &mut forces);
                    }
                }
            }
            let (mut lost, mut load) = ([T::zero(); 3], [T::zero(); 3]);
            let s = &self.subdomains[k];
            for dof in 0..layout.translations() {
                // Supports balance the prescribed unknowns, which inverse inertia zero marks.
                if s.inverse_inertia()[dof] > T::zero() {
                    let (force, axis) = (forces[dof], dof % layout.components);
                    largest = largest.max(force.abs());
                    lost[axis] += force;
                    load[axis] += (force - internal[dof]).abs();
                }
            }
            for support in s.supports() {
                // Within a support, forces of both signs may be far larger than what it bears.
                let mut reaction = [T::zero(); 3];
                for dof in support.dofs.iter().filter(|d| **d < layout.translations()) {
                    reaction[dof % layout.components] += forces[*dof];
                }
                load.iter_mut().zip(reaction).for_each(|(l, r)| *l += r.abs());
            }
            for (lost, load) in lost.into_iter().zip(load) {
                let load = load.max(borne / T::of(OF_SUM));
                sum = sum.max(if load > T::zero() {
                    lost.abs() / load
                } else {
                    T::zero()
                });
            }
        }
        Ok((largest, sum))
    }
}

//! Consistent start: displacements, velocities and accelerations meet the constraint.

use super::ledger::DisplacementJump;
use super::{Coupled, ROUND_OFF, pair};
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result};

/// Largest accepted jump of the initial displacements beside an external solver, relative to the largest
/// displacement: the core cannot change the solver's displacements.
const EXTERNAL_JUMP: f64 = 1e-6;

/// How large displacement jumps are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Jumps {
    /// Refused: an initial state of the user that contradicts itself.
    Refused,
    /// Removed like small ones.
    Removed,
}

impl<T: Real> Coupled<T> {
    /// Projects `u_0` and `v_0` on the constraint once, weighted by the inertia, and computes the first half
    /// reflection, that of a constant acceleration, `δ_0 = −ΔT/2 P a_0`. Without the projection a
    /// displacement jump would stay for ever, as the constraint is on velocities. Without `δ_0` multipliers
    /// would change their sign in every step.
    pub(super) fn start(&mut self) -> Result<()> {
        self.start_positions(Jumps::Refused)?;
        self.start_forces()?;
        let before: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        self.reflect_start()?;
        self.start_loss = before - self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        // Momenta count from the projected velocities.
        self.find_bodies();
        self.ledger.jumps = vec![DisplacementJump::default(); self.interfaces.len()];
        self.rounded = self.round_off() * T::of(ROUND_OFF);
        self.check_start()
    }

    /// Sets prescribed values and removes the displacement jumps.
    pub(super) fn start_positions(&mut self, large: Jumps) -> Result<()> {
        for s in &mut self.subdomains {
            // Prescribed values come first: projections leave them as they are.
            s.set_prescribed(self.time);
        }
        for i in &mut self.interfaces {
            i.pace(self.dt);
            self.work
                .resize(self.work.len().max(i.multipliers().len()), T::zero());
        }
        self.joints.iter_mut().for_each(|j| j.pace(self.dt));
        self.close_jumps(large)
    }

    /// Evaluates forces and accelerations at the present displacements, which must be without jumps.
    pub(super) fn start_forces(&mut self) -> Result<()> {
        let time = self.time;
        for s in &mut self.subdomains {
            s.start(time)?;
        }
        for g in 0..self.lockstep.len() {
            self.add_pair_forces(g, |s| s.at_start(time), &mut |_| {})?;
        }
        Ok(())
    }

    /// Returns the energy \[J\] that round-off is worth, `½ ω² Σ m (ε q² + ε² x²)` with the highest frequency
    /// `ω` of each model. The first term is for displacements `q` whose energy cancels, as in a rigid motion;
    /// the second is for lengths that are differences of positions `x`.
    pub(super) fn round_off(&self) -> T {
        let models = self.subdomains.iter().zip(&self.critical);
        models
            .map(|(s, critical)| {
                let sizes = s.displaced() + s.spread() * T::epsilon();
                // ω = 2/Δt_c
                sizes * T::of(2.0) * T::epsilon() / (*critical * *critical)
            })
            .sum()
    }
}

/// Copies the displacements of some models.
fn displacements<T: Real>(subdomains: &[Subdomain<T>], models: &[usize]) -> Vec<Vec<T>> {
    models.iter().map(|s| subdomains[*s].state().q.clone()).collect()
}

impl<T: Real> Coupled<T> {
    /// Removes the jumps of the initial displacements and reports them.
    fn close_jumps(&mut self, large: Jumps) -> Result<()> {
        for k in 0..self.interfaces.len() {
            let models = self.interfaces[k].sides;
            if !self.interfaces[k].is_alone() || !self.is_open(&[k], &models, large)? {
                continue;
            }
            let before = displacements(&self.subdomains, &models);
            let sides = pair(&mut self.subdomains, models[0], models[1]);
            self.interfaces[k].reflect(sides.map(Subdomain::displacements));
            self.report_moved(&[k], &models, &before);
        }
        for k in 0..self.joints.len() {
            let (members, models) = (self.joints[k].members.clone(), self.joints[k].models.clone());
            if !self.is_open(&members, &models, large)? {
                continue;
            }
            let before = displacements(&self.subdomains, &models);
            let subdomains = &self.subdomains;
            self.joints[k].find(|s| &subdomains[s].state().q, T::one());
            for (s, change) in self.joints[k].kicks() {
                change.kick(self.subdomains[s].displacements());
            }
            self.report_moved(&members, &models, &before);
        }
        Ok(())
    }

    /// Returns whether interfaces that are solved together have displacement jumps that can be removed; large
    /// ones are treated as `large` says.
    fn is_open(&mut self, members: &[usize], models: &[usize], large: Jumps) -> Result<bool> {
        // The core cannot change the displacements of an external solver: they must agree from the start.
        let movable = !models.iter().any(|s| self.subdomains[*s].is_external());
        let mut open = false;
        for &k in members {
            let i = &mut self.interfaces[k];
            let sides = i.sides.map(|s| &self.subdomains[s]);
            let jump = i.jump(sides.map(|s| &*s.state().q), &mut self.work);
            // Displacements count as vectors, so that the directions of axes do not matter.
            let largest = sides.map(|s| {
                let layout = s.model().layout();
                let q = s.state().q[..layout.translations()].chunks_exact(layout.components);
                let squares = q.map(|u| u.iter().map(|x| *x * *x).sum::<T>());
                s.owned().largest(squares.fold(T::zero(), |m, x| m.max(x))).sqrt()
            });
            let largest = largest[0].max(largest[1]);
            i.report.start_jump = jump.as_f64();
            let limit = if movable {
                i.start_jump
            } else {
                i.start_jump.min(T::of(EXTERNAL_JUMP))
            };
            if large == Jumps::Refused && jump > largest * limit {
                return Err(Error::InitialJump {
                    interface: i.report.name.clone(),
                    jump: jump.as_f64(),
                    largest: largest.as_f64(),
                    limit: limit.as_f64(),
                });
            }
            open |= jump > T::zero();
        }
        Ok(open && movable)
    }

    /// Reports the largest change that the projection made to the displacements.
    fn report_moved(&mut self, members: &[usize], models: &[usize], before: &[Vec<T>]) {
        let change = |(s, before): (&usize, &Vec<T>)| {
            let entries = self.subdomains[*s].state().q.iter().zip(before);
            let largest = entries.fold(T::zero(), |m, (a, b)| m.max((*a - *b).abs()));
            self.subdomains[*s].owned().largest(largest)
        };
        let most = models
            .iter()
            .zip(before)
            .map(change)
            .fold(T::zero(), |a, b| a.max(b));
        for &k in members {
            self.interfaces[k].report.start_moved = most.as_f64();
        }
    }
}

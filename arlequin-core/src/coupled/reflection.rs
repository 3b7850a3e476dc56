//! Reflections of all interfaces. Interfaces that share nodes are reflected together, all others one after
//! another.

use super::{Coupled, pair};
use crate::interface::Transfer;
use crate::subdomain::Subdomain;
use crate::{Real, Result};

impl<T: Real> Coupled<T> {
    /// Applies the second half of the last reflections.
    pub(super) fn apply_second_half(&mut self) {
        let alone = self.interfaces.iter().filter(|i| i.is_alone());
        let sides = alone.flat_map(|i| (0..2).map(|m| (i.sides[m], &i.coupling[m])));
        let joints = self.joints.iter().flat_map(|j| j.kicks());
        for (s, change) in sides.chain(joints) {
            // An external solver received both halves in `hand_over`.
            if !self.subdomains[s].is_external() {
                change.kick(self.subdomains[s].velocities());
            }
        }
    }

    /// Computes the next reflections and applies their first half.
    pub(super) fn reflect(&mut self) -> Result<()> {
        for i in self.interfaces.iter_mut().filter(|i| i.is_alone()) {
            let [coarse, fine] = i.sides;
            i.reflect(pair(&mut self.subdomains, coarse, fine).map(Subdomain::velocities));
            for (m, s) in i.sides.into_iter().enumerate() {
                self.subdomains[s].hand_over(&i.coupling[m])?;
            }
        }
        for j in &mut self.joints {
            let subdomains = &self.subdomains;
            j.find(|s| &subdomains[s].state().v, T::one());
            j.hand_out(&mut self.interfaces);
            for (s, change) in j.kicks() {
                change.kick(self.subdomains[s].velocities());
                self.subdomains[s].hand_over(change)?;
            }
        }
        Ok(())
    }

    /// Removes the jumps of the initial velocities and computes the half reflections `δ_0 = −ΔT/2 P a_0` that
    /// the first step applies.
    pub(super) fn reflect_start(&mut self) -> Result<()> {
        let half = self.dt * T::of(0.5);
        for i in self.interfaces.iter_mut().filter(|i| i.is_alone()) {
            let [coarse, fine] = i.sides;
            let [c, d] = pair(&mut self.subdomains, coarse, fine);
            i.reflect([&mut *c, &mut *d].map(Subdomain::velocities));
            i.find([&c.state().a, &d.state().a], half);
        }
        for j in &mut self.joints {
            let subdomains = &self.subdomains;
            j.find(|s| &subdomains[s].state().v, T::one());
            for (s, change) in j.kicks() {
                change.kick(self.subdomains[s].velocities());
            }
            let subdomains = &self.subdomains;
            j.find(|s| &subdomains[s].state().a, half);
            // The multipliers of the start are those of the accelerations.
            j.hand_out(&mut self.interfaces);
        }
        for (k, subdomain) in self.subdomains.iter_mut().enumerate() {
            let alone = self.interfaces.iter().filter(|i| i.is_alone());
            let sides = alone.flat_map(|i| (0..2).map(|m| (i.sides[m], &i.coupling[m])));
            let joints = self.joints.iter().flat_map(|j| j.kicks());
            let transfers = sides.chain(joints).filter(|(s, _)| *s == k);
            subdomain.hand_over_start(&transfers.map(|m| m.1).collect::<Vec<&Transfer<T>>>())?;
        }
        Ok(())
    }
}

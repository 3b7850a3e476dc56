//! Reactions: what supports and effects exert on the models, from the balance of the nodes at an instant.
//!
//! ```text
//! R_C = M_C q̈ − F_int,α − F_ext,γ + B_Cᵀλ,     R_D = M_D q̈ − F_int,α − F_ext,γ − B_Dᵀλ
//! ```
//!
//! on the unknowns whose motion is prescribed, with the weighted inertia and forces of each model and the
//! multipliers of all interfaces it belongs to; `λ` is the mean over the step of the run. In an overlap
//! both models have their share of a support: their sum is what the support exerts on the body. Internal
//! forces have no resultant, and multipliers none over both sides, so that reactions, loads and inertia
//! balance to round-off.

use super::Coupled;
use crate::energy_release::EnergyRelease;
use crate::error::invalid;
use crate::ranks::Exact;
use crate::scalar::check_finite;
use crate::subdomain::Resultant;
use crate::{Real, Result};
use nalgebra::Point3;

impl<T: Real> Coupled<T> {
    /// Forces \[N\] and torques \[N m\] of the supports on the unknowns of one subdomain, zero where these
    /// are free; of a model in parts those on the unknowns here. All ranks must ask, as for resultants,
    /// which are those of all of it. The acceleration is that of the discrete motion: at the start, it
    /// includes what sets the support moving.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if there is no such subdomain; those of the model's forces;
    /// [`crate::Error::Unsupported`] between [`Coupled::restore`] and the next step.
    pub fn reactions(&mut self, subdomain: usize) -> Result<Vec<T>> {
        self.known(subdomain)?;
        let time = self.time;
        let s = &mut self.subdomains[subdomain];
        let mut forces = vec![T::zero(); s.model().layout().dofs()];
        s.pull(time, &mut forces)?;
        for i in &self.interfaces {
            for (m, sign) in [-T::one(), T::one()].into_iter().enumerate() {
                if i.sides[m] == subdomain {
                    i.coupling[m].add_force(sign, i.multipliers(), &mut forces);
                }
            }
        }
        let s = &self.subdomains[subdomain];
        s.react(&mut forces);
        check_finite(&format!("reactions of '{}'", s.model().name()), &forces)?;
        Ok(forces)
    }

    /// Force and moment about a point \[m\] of one support, by its number in
    /// [`supports`](crate::Subdomain::supports), from the reactions of its subdomain as
    /// [`Coupled::reactions`] returned them.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if there is no such subdomain or support.
    pub fn support_resultant(
        &self,
        subdomain: usize,
        support: usize,
        reactions: &[T],
        about: &Point3<T>,
    ) -> Result<Resultant<T>> {
        self.known(subdomain)?;
        let s = &self.subdomains[subdomain];
        let Some(motion) = s.supports().get(support) else {
            let rule = format!("'{}' has {} supports", s.model().name(), s.supports().len());
            return Err(invalid("number of a support", support, &rule));
        };
        crate::model::check_size(s.model(), "reactions", reactions.len())?;
        Ok(s.resultant(reactions, motion.dofs.iter().copied(), about))
    }

    /// Force and moment about a point \[m\] of what the effects of the given name exert on one subdomain:
    /// loads, dampings, rigid bodies, and the contact with another subdomain. Zero where none has the name.
    ///
    /// # Errors
    /// As those of [`Coupled::reactions`].
    pub fn effect_resultant(
        &mut self,
        subdomain: usize,
        name: &str,
        about: &Point3<T>,
    ) -> Result<Resultant<T>> {
        self.known(subdomain)?;
        let time = self.time;
        let s = &mut self.subdomains[subdomain];
        // Brings the loads of an implicit step to this instant.
        s.refresh(time)?;
        let s = &self.subdomains[subdomain];
        let mut out = Resultant::zero();
        for e in s.effects().filter(|e| e.name() == name) {
            out += s.resultant_of_effect(about, e);
        }
        for p in self.pairs.iter().filter(|p| p.line.effect.name() == name) {
            for (m, side) in p.sides.into_iter().enumerate() {
                if side == subdomain {
                    let still = vec![T::zero(); self.subdomains[p.sides[1 - m]].inertia().len()];
                    let effect = &p.line.effect;
                    let power = |v: &[T], to: &mut Exact| {
                        let power = effect.power(if m == 0 { [v, &still] } else { [&still, v] });
                        to.add(power.as_f64());
                    };
                    out += s.resultant_by_power(about, effect.arms(), &power);
                }
            }
        }
        Ok(out)
    }

    /// Energy that a crack in a subdomain releases per area at the present displacements \[J/m²\], the mean
    /// over the part of its front; takes the time of one evaluation of the model's forces.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if there is no such subdomain; those of the model's forces and of
    /// [`EnergyRelease::at`].
    pub fn energy_release(&mut self, subdomain: usize, crack: &EnergyRelease<T>) -> Result<T> {
        self.known(subdomain)?;
        let s = &mut self.subdomains[subdomain];
        let mut forces = vec![T::zero(); s.model().layout().dofs()];
        s.forces_of_displacements(&mut forces)?;
        let free = |d: usize| s.inverse_inertia()[d] > T::zero();
        crack.at(&s.state().q, &forces, free)
    }

    /// Adds the last forces of all contacts on one subdomain \[N, N m\], weighted, to `f`; whether there is
    /// any effect of the kind.
    pub fn add_contact_forces(&self, subdomain: usize, f: &mut [T]) -> bool {
        let Some(s) = self.subdomains.get(subdomain) else {
            return false;
        };
        let mut any = false;
        for e in s.effects() {
            any |= e.add_contact(f);
        }
        for p in &self.pairs {
            for m in (0..2).filter(|m| p.sides[*m] == subdomain) {
                any |= p.line.effect.add_contact(m, f);
            }
        }
        any
    }

    fn known(&self, subdomain: usize) -> Result<()> {
        let count = self.subdomains.len();
        if subdomain < count {
            return Ok(());
        }
        let rule = format!("must be below {count}, the number of subdomains");
        Err(invalid("number of a subdomain", subdomain, &rule))
    }
}

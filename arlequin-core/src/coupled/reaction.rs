//! Reactions: forces of supports and effects on the models, from the balance of forces at an instant.
//!
//! ```text
//! R_C = M_C q̈ − F_int,α − F_ext,γ + B_Cᵀλ,     R_D = M_D q̈ − F_int,α − F_ext,γ − B_Dᵀλ
//! ```
//!
//! on the unknowns whose motion is prescribed, with the weighted inertia and forces of each model and the
//! multipliers of all its interfaces; `λ` is the mean over the macro step. In an overlap each model has its
//! share of a support, and the sum of both is the force of the support on the body. Internal forces have no
//! resultant, nor do multipliers over both sides, so that reactions, loads and inertia balance to round-off.

use super::Coupled;
use crate::Exact;
use crate::energy_release::EnergyRelease;
use crate::error::invalid;
use crate::scalar::check_finite;
use crate::subdomain::Resultant;
use crate::{Real, Result};
use nalgebra::Point3;

impl<T: Real> Coupled<T> {
    /// Returns the forces \[N\] and torques \[N m\] of the supports on the unknowns of one subdomain; zero
    /// for free unknowns. For a partitioned model these are the unknowns of this rank. Collective. The
    /// acceleration is that of the discrete motion: at the start, it includes the one that sets a support
    /// moving.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if the subdomain does not exist; errors of the model's forces;
    /// [`crate::Error::Unsupported`] between [`Coupled::restore`] and the next step.
    pub fn reactions(&mut self, subdomain: usize) -> Result<Vec<T>> {
        self.check_number(subdomain)?;
        let time = self.time;
        let s = &mut self.subdomains[subdomain];
        let mut forces = vec![T::zero(); s.model().layout().dofs()];
        s.write_forces(time, &mut forces)?;
        for i in &self.interfaces {
            // Multipliers act by −Bᵀλ on the coarse and by +Bᵀλ on the fine model.
            for (m, sign) in [-T::one(), T::one()].into_iter().enumerate() {
                if i.sides[m] == subdomain {
                    i.coupling[m].add_force(sign, i.multipliers(), &mut forces);
                }
            }
        }
        let s = &self.subdomains[subdomain];
        s.replace_by_reactions(&mut forces);
        check_finite(&format!("reactions of '{}'", s.model().name()), &forces)?;
        Ok(forces)
    }

    /// Returns force and moment about a point \[m\] of one support, given by its number in
    /// [`supports`](crate::Subdomain::supports). `reactions` are those of [`Coupled::reactions`] for this
    /// subdomain. Collective; the resultant is that of the whole model.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if the subdomain or the support does not exist.
    pub fn support_resultant(
        &self,
        subdomain: usize,
        support: usize,
        reactions: &[T],
        about: &Point3<T>,
    ) -> Result<Resultant<T>> {
        self.check_number(subdomain)?;
        let s = &self.subdomains[subdomain];
        let Some(motion) = s.supports().get(support) else {
            let rule = format!("'{}' has {} supports", s.model().name(), s.supports().len());
            return Err(invalid("number of a support", support, &rule));
        };
        crate::model::check_size(s.model(), "reactions", reactions.len())?;
        Ok(s.resultant(reactions, motion.dofs.iter().copied(), about))
    }

    /// Returns force and moment about a point \[m\] of all effects with the given name on one subdomain:
    /// loads, dampings, rigid bodies, and contact with another subdomain. Zero if no effect has the name.
    /// Collective.
    ///
    /// # Errors
    /// Errors of [`Coupled::reactions`].
    pub fn effect_resultant(
        &mut self,
        subdomain: usize,
        name: &str,
        about: &Point3<T>,
    ) -> Result<Resultant<T>> {
        self.check_number(subdomain)?;
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
                    // The power of this side alone: the other side stands still.
                    let still = vec![T::zero(); self.subdomains[p.sides[1 - m]].inertia().len()];
                    let effect = &p.line.effect;
                    let power = |v: &[T], sum: &mut Exact| {
                        let power = effect.power(if m == 0 { [v, &still] } else { [&still, v] });
                        sum.add(power.as_f64());
                    };
                    out += s.resultant_by_power(about, effect.arms(), &power);
                }
            }
        }
        Ok(out)
    }

    /// Returns the energy that a crack in a subdomain releases per area at the present displacements
    /// \[J/m²\], as the mean over the part of the front that `crack` describes. Takes the time of one
    /// evaluation of the model's forces.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if the subdomain does not exist; errors of the model's forces and
    /// of [`EnergyRelease::at`].
    pub fn energy_release(&mut self, subdomain: usize, crack: &EnergyRelease<T>) -> Result<T> {
        self.check_number(subdomain)?;
        let s = &mut self.subdomains[subdomain];
        let mut forces = vec![T::zero(); s.model().layout().dofs()];
        s.forces_of_displacements(&mut forces)?;
        let free = |d: usize| s.inverse_inertia()[d] > T::zero();
        crack.at(&s.state().q, &forces, free)
    }

    /// Adds the last forces of all contacts on one subdomain \[N, N m\], weighted, to `f`. Returns whether
    /// there is any contact.
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

    fn check_number(&self, subdomain: usize) -> Result<()> {
        let count = self.subdomains.len();
        if subdomain < count {
            return Ok(());
        }
        let rule = format!("must be below {count}, the number of subdomains");
        Err(invalid("number of a subdomain", subdomain, &rule))
    }
}

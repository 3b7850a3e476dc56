//! Effects that are one formula: body force, dampings, prestress.

use super::{Effect, EffectSpec, ForceLaw, Host, Instant, StepDemand};
use crate::error::{invalid, not_negative};
use crate::model::Arms;
use crate::parallel::Pieces;
use crate::time::TimeFunction;
use crate::{Real, Result};
use nalgebra::Vector3;

/// Gravity or any constant acceleration field \[m/s²\]: `F_i = M_γ,i g`.
#[derive(Debug, Clone)]
pub struct BodyForce<T: Real>(Vector3<T>, TimeFunction<T>);

impl<T: Real> BodyForce<T> {
    /// Body force with the given acceleration \[m/s²\]; bars and chains feel its x component.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if it is not finite.
    pub fn new(acceleration: Vector3<T>) -> Result<Self> {
        if acceleration.iter().all(|a| a.is_finite()) {
            return Ok(Self(acceleration, TimeFunction::Step));
        }
        let value = format_args!("{acceleration:?}");
        Err(invalid("body acceleration", value, "must be finite"))
    }

    /// Multiplies the acceleration by a function of time.
    ///
    /// # Errors
    /// Errors of [`TimeFunction::validate`].
    pub fn over_time(self, time: TimeFunction<T>) -> Result<Self> {
        time.validate()?;
        Ok(Self(self.0, time))
    }
}

impl<T: Real> EffectSpec<T> for BodyForce<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let layout = host.model.layout();
        let mut force = vec![T::zero(); layout.dofs()];
        // The model's own lumping under `γ`: gravity then acts on the masses that move.
        host.model.lumped_inertia(&*host.weights.external, &mut force)?;
        for (i, m) in force.iter_mut().enumerate() {
            // Gravity has no moment on rotations.
            *m *= if i < layout.translations() {
                self.0[i % layout.components]
            } else {
                T::zero()
            };
        }
        let time = self.1;
        if time == TimeFunction::Step {
            // `own_forces` holds the constant force from the start and needs no update.
            let add = |_: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
                f.iter_mut().zip(own_forces).for_each(|(f, g)| *f += *g);
            };
            return Ok(Box::new(ForceLaw {
                force,
                dead: true,
                local: true,
                shared: true,
                ..ForceLaw::new("body-force", 0, add)
            }));
        }
        let dofs = force.len();
        let add = move |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            let factor = time.value(instant.time);
            for ((f, own_force), g) in f.iter_mut().zip(own_forces).zip(&force) {
                *own_force = factor * *g;
                *f += *own_force;
            }
        };
        Ok(Box::new(ForceLaw {
            dead: true,
            local: true,
            shared: true,
            ..ForceLaw::new("body-force", dofs, add)
        }))
    }
}

/// Mass-proportional damping `F = −c M_β v` with a rate `c` \[1/s\].
#[derive(Debug, Clone)]
pub struct MassDamping<T>(T);

impl<T: Real> MassDamping<T> {
    /// Damping with the given rate \[1/s\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if it is negative or not finite.
    pub fn new(rate: T) -> Result<Self> {
        not_negative("damping rate", rate).map(Self)
    }
}

impl<T: Real> EffectSpec<T> for MassDamping<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let (rate, inertia) = (self.0, host.inertia.to_vec());
        let dofs = inertia.len();
        // What sleeps has no forces.
        let pieces = Pieces::with_mass(&host.model.layout(), &inertia);
        let moving = pieces.clone();
        let law = move |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            for piece in moving.ranges() {
                let (f, g) = (&mut f[piece.clone()], &mut own_forces[piece.clone()]);
                let (m, v) = (&inertia[piece.clone()], &instant.v_half[piece.clone()]);
                for (((f, g), m), v) in f.iter_mut().zip(g).zip(m).zip(v) {
                    *g = -rate * *m * *v;
                    *f += *g;
                }
            }
        };
        Ok(Box::new(ForceLaw {
            pieces: Some(pieces),
            demand: StepDemand::damping(rate),
            local: true,
            shared: true,
            ..ForceLaw::dissipating("mass-damping", dofs, law)
        }))
    }
}

/// The stiffness part of Rayleigh damping, `F = −c K v` with a time `c` \[s\]; the mass part is
/// [`MassDamping`].
///
/// Computed as `c (f_{n+1} − f_n)/Δt` from the internal forces themselves: costs no further evaluation,
/// holds for any model, and follows bonds that break. Damps a mode of frequency `ω` by the ratio `c ω/2`.
#[derive(Debug, Clone)]
pub struct StiffnessDamping<T>(T);

impl<T: Real> StiffnessDamping<T> {
    /// Damping with the time `c` \[s\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if it is negative or not finite.
    pub fn new(time: T) -> Result<Self> {
        not_negative("stiffness damping time", time).map(Self)
    }
}

impl<T: Real> EffectSpec<T> for StiffnessDamping<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let time = self.0;
        let law = move |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            // At the start of a run there is no step before to take the difference over.
            if instant.dt <= T::zero() {
                return;
            }
            let factor = time / instant.dt;
            let change = instant.internal.iter().zip(instant.internal_before);
            for ((f, g), (now, before)) in f.iter_mut().zip(own_forces).zip(change) {
                *g = factor * (*now - *before);
                *f += *g;
            }
        };
        let demand = StepDemand {
            viscosity: time,
            ..StepDemand::none()
        };
        Ok(Box::new(ForceLaw {
            demand,
            arms: Some(Arms::Reference),
            local: true,
            shared: true,
            ..ForceLaw::dissipating("stiffness-damping", host.inertia.len(), law)
        }))
    }
}

/// Local damping: every unknown feels `−share |F| sgn(v)`, where `F` is the sum of the internal forces and of
/// all other effects of the subdomain. Brings a body to rest without slowing a steady motion. Must be the
/// last effect of its subdomain.
#[derive(Debug, Clone)]
pub struct LocalDamping<T>(T);

impl<T: Real> LocalDamping<T> {
    /// Damping by the given share, usually 0.1 to 0.8.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] unless it is at least 0 and below 1.
    pub fn new(share: T) -> Result<Self> {
        if share >= T::zero() && share < T::one() {
            return Ok(Self(share));
        }
        let rule = "must be at least 0 and below 1; take 0.2";
        Err(invalid("local damping share", share, rule))
    }
}

impl<T: Real> EffectSpec<T> for LocalDamping<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let share = self.0;
        let law = move |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            for ((f, g), v) in f.iter_mut().zip(own_forces).zip(instant.v_half) {
                // `f` holds the forces before this effect only: hence it must be the last one.
                let size = share * f.abs();
                *g = if *v > T::zero() {
                    -size
                } else if *v < T::zero() {
                    size
                } else {
                    T::zero()
                };
                *f += *g;
            }
        };
        let demand = StepDemand {
            // All forces grow by the share at most: the highest frequency, squared, grows by it.
            gain: T::one() + share,
            ..StepDemand::none()
        };
        Ok(Box::new(ForceLaw {
            demand,
            local: true,
            shared: true,
            ..ForceLaw::dissipating("local-damping", host.inertia.len(), law)
        }))
    }
}

/// Subtracts the internal forces of the initial displacements permanently, `F = −F_int(q_0)`: the body starts
/// in equilibrium in the given shape, and its stiffness acts on displacements from there.
///
/// Counts as a dead load in the energy balance: its work comes from outside.
#[derive(Debug, Clone, Copy, Default)]
pub struct Prestress;

impl<T: Real> EffectSpec<T> for Prestress {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let law = |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            // The step is zero at the start of a run only: keep the internal forces of that instant.
            if instant.dt <= T::zero() {
                own_forces
                    .iter_mut()
                    .zip(instant.internal)
                    .for_each(|(g, now)| *g = -*now);
            }
            f.iter_mut().zip(own_forces).for_each(|(f, g)| *f += *g);
        };
        Ok(Box::new(ForceLaw {
            arms: Some(Arms::Reference),
            dead: true,
            remembers: true,
            local: true,
            shared: true,
            ..ForceLaw::new("prestress", host.inertia.len(), law)
        }))
    }
}

//! Effects given by a formula for the force on every unknown.

use super::{AnyEffect, Effect, Instant, StepDemand};
use crate::model::{Arms, DofLayout};
use crate::parallel::Pieces;
use crate::record::Record;
use crate::scalar::dot;
use crate::{Exact, add_products, add_products_in};
use crate::{Real, Result};

/// An effect given by a closure. `law(instant, f, own_forces)` writes the effect's forces to `own_forces`
/// \[N, N m\] and adds them to `f`. At the call `own_forces` holds what the closure wrote the last time, and
/// `f` all forces before those of the effect.
///
/// ```
/// use arlequin_core::effect::{Effect, EffectSpec, ForceLaw, Host, Instant};
///
/// /// Springs of stiffness `k` \[N/m\] that pull every unknown back to where it was.
/// struct ElasticSupport(f64);
///
/// impl EffectSpec<f64> for ElasticSupport {
///     fn attach(self: Box<Self>, host: &Host<'_, f64>) -> arlequin_core::Result<Box<dyn Effect<f64>>> {
///         let top = host.inverse_inertia.iter().fold(0.0_f64, |a, b| a.max(*b));
///         let k = self.0;
///         let law = move |instant: &Instant<'_, f64>, f: &mut [f64], own_forces: &mut [f64]| {
///             for ((f, own_force), q) in f.iter_mut().zip(own_forces).zip(instant.q) {
///                 *own_force = -k * q;
///                 *f += *own_force;
///             }
///         };
///         let mut support = ForceLaw::new("elastic-support", host.inertia.len(), law);
///         support.demand.stiffness = k * top;
///         Ok(Box::new(support))
///     }
/// }
/// ```
pub struct ForceLaw<T: Real, L> {
    /// Name in the ledger.
    pub name: &'static str,
    /// The law.
    pub law: L,
    /// Forces that the closure wrote last \[N, N m\].
    pub force: Vec<T>,
    /// Demand on the time step; none unless set.
    pub demand: StepDemand<T>,
    /// Value of [`AnyEffect::arms`]; `None` unless set.
    pub arms: Option<Arms>,
    /// Value of [`AnyEffect::supplied`]: zero for an effect that only dissipates; `None` unless set.
    pub supplied: Option<T>,
    /// Value of [`Effect::is_dead`]; `false` unless set.
    pub dead: bool,
    /// True if the last forces belong to the state of a run, for a law that reads them; `false` unless set.
    pub remembers: bool,
    /// True if the force on an unknown follows from values of its own node alone. The effect then acts on
    /// partitioned models as well. `false` unless set.
    pub local: bool,
    /// Value of [`AnyEffect::acts_on_shares`]; `false` unless set.
    pub shared: bool,
    /// Ranges of the unknowns with forces; all unless set.
    pub(super) pieces: Option<Pieces>,
}

impl<T: Real, L> ForceLaw<T, L> {
    /// Effect by a law for `dofs` unknowns.
    pub fn new(name: &'static str, dofs: usize, law: L) -> Self {
        Self {
            name,
            law,
            force: vec![T::zero(); dofs],
            demand: StepDemand::none(),
            arms: None,
            supplied: None,
            dead: false,
            remembers: false,
            local: false,
            shared: false,
            pieces: None,
        }
    }

    /// Effect by a law that only takes energy away.
    pub fn dissipating(name: &'static str, dofs: usize, law: L) -> Self {
        Self {
            supplied: Some(T::zero()),
            ..Self::new(name, dofs, law)
        }
    }
}

impl<T: Real, L> std::fmt::Debug for ForceLaw<T, L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ForceLaw {}", self.name)
    }
}

impl<T: Real, L: Send> AnyEffect<T> for ForceLaw<T, L> {
    fn name(&self) -> &str {
        self.name
    }
    fn arms(&self) -> Option<Arms> {
        self.arms
    }
    fn acts_on_shares(&self) -> bool {
        self.shared
    }
    fn supplied(&self) -> Option<T> {
        self.supplied
    }
    fn save(&self) -> Record<T> {
        Record {
            numbers: if self.remembers {
                self.force.clone()
            } else {
                Vec::new()
            },
            integers: Vec::new(),
        }
    }
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        let expected = if self.remembers { self.force.len() } else { 0 };
        from.expect(self.name, expected, 0)?;
        self.force[..expected].copy_from_slice(&from.numbers);
        Ok(())
    }
}

impl<T: Real, L: FnMut(&Instant<'_, T>, &mut [T], &mut [T]) + Send> Effect<T> for ForceLaw<T, L> {
    fn add_forces(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        (self.law)(instant, f, &mut self.force);
        Ok(())
    }
    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }
    fn add_power(&self, layout: &DofLayout, v: &[T], sum: &mut Exact) -> bool {
        if self.local {
            match &self.pieces {
                Some(pieces) => add_products_in(layout, pieces, [&self.force, v], sum),
                None => add_products(layout, &self.force, v, sum),
            }
        }
        self.local
    }
    fn is_dead(&self) -> bool {
        self.dead
    }
    fn step_demand(&self) -> StepDemand<T> {
        self.demand
    }
}

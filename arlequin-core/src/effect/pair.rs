//! Effects between two subdomains: contact of two bodies.
//!
//! An [`Effect`](super::Effect) sees one subdomain. A pair effect sees two at the same instant, after the
//! positions, the internal forces and the effects of both are known and before either is accelerated. It is
//! one line of the ledger and makes a demand on the time step. If it returns a `supplied` energy, `supplied −
//! work − stored` must not become negative. Effects of the subdomains do not see its forces, so that local
//! damping does not act on them.

use super::{AnyEffect, Host, Instant, StepDemand};
use crate::{Real, Result};

/// The two subdomains that a pair effect is attached to.
#[derive(Debug)]
pub struct HostPair<'a, T: Real> {
    /// The two subdomains.
    pub sides: [Host<'a, T>; 2],
    /// For each node of either side: true if an interface between the two subdomains acts on it. Empty if
    /// there is no interface. A tied node moves with the other side and should not be pushed away from it.
    pub tied: [Vec<bool>; 2],
}

/// Specification of a pair effect, like [`super::EffectSpec`].
pub trait PairEffectSpec<T: Real>: Send {
    /// Name that the effect will have.
    fn name(&self) -> &str;

    /// Prepares the effect for its two subdomains.
    ///
    /// # Errors
    /// Models or parameters that the effect cannot work with.
    fn attach(self: Box<Self>, hosts: &HostPair<'_, T>) -> Result<Box<dyn PairEffect<T>>>;
}

/// Forces between two subdomains, ready to act. Arrays hold the first side, then the second.
pub trait PairEffect<T: Real>: AnyEffect<T> {
    /// Adds the weighted forces \[N, N m\] to `f` of both sides and keeps them for [`Self::power`]. At the
    /// call `f` holds all forces except those of later pair effects and of interfaces. Must not allocate. The
    /// forces must sum to zero to conserve momentum: [`crate::conformance::reaction`] checks this.
    ///
    /// # Errors
    /// Any error of the effect.
    fn add_forces(&mut self, instants: [&Instant<'_, T>; 2], f: [&mut [T]; 2]) -> Result<()>;

    /// Power of the last added forces at the velocities of both sides \[W\].
    fn power(&self, v: [&[T]; 2]) -> T;

    /// Adds the last contact forces on one side to `f`, for output. Returns `false` if the effect is no
    /// contact.
    fn add_contact(&self, _side: usize, _: &mut [T]) -> bool {
        false
    }

    /// Adapts the effect to new weights of its subdomains without losing its state, like
    /// [`super::Effect::reweigh`]. No interface ties the two sides.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] by default.
    fn reweigh(&mut self, hosts: &HostPair<'_, T>) -> Result<()> {
        Err(crate::Error::Unsupported {
            model: hosts.sides[0].model.name().to_owned(),
            what: format!(
                "change its weights beside the effect '{}'; leave it out",
                self.name()
            ),
        })
    }

    /// Demand on the time step of either side.
    fn step_demand(&self) -> [StepDemand<T>; 2] {
        [StepDemand::none(), StepDemand::none()]
    }
}

/// A pair effect and its two subdomains.
pub struct PairSpec<T: Real> {
    /// Numbers of the two subdomains, which must differ.
    pub sides: [usize; 2],
    /// The effect.
    pub effect: Box<dyn PairEffectSpec<T>>,
}

impl<T: Real> std::fmt::Debug for PairSpec<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PairSpec")
            .field("sides", &self.sides)
            .field("effect", &self.effect.name())
            .finish()
    }
}

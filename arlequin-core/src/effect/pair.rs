//! Effects between two subdomains: contact of two bodies.
//!
//! An [`Effect`](super::Effect) sees one subdomain. A pair effect sees two at the same instant, after the
//! positions, the internal forces and the effects of both are known and before either is accelerated. It is
//! one line of the ledger, demands its share of the step, and where it says what was `supplied` it is held
//! to the same rule: `supplied − work − stored` does not become negative. Effects of the subdomains do not
//! see its forces, so a local damping leaves them alone.

use super::{AnyEffect, Host, Instant, StepDemand};
use crate::{Real, Result};

/// The two subdomains that a pair effect acts on, as it sees them when it is attached.
#[derive(Debug)]
pub struct HostPair<'a, T: Real> {
    /// The two subdomains.
    pub sides: [Host<'a, T>; 2],
    /// Nodes of either side that an interface between these two subdomains holds; empty where there is
    /// none. What is tied to the other side moves with it and should not be pushed away from it.
    pub tied: [Vec<bool>; 2],
}

/// What a user chooses of a pair effect, as [`super::EffectSpec`].
pub trait PairEffectSpec<T: Real>: Send {
    /// Name that the effect will have.
    fn name(&self) -> &str;

    /// Makes the effect ready for its two subdomains.
    ///
    /// # Errors
    /// Models or parameters that the effect cannot work with.
    fn attach(self: Box<Self>, to: &HostPair<'_, T>) -> Result<Box<dyn PairEffect<T>>>;
}

/// Forces between two subdomains, ready to act. Arrays hold the first side, then the second.
pub trait PairEffect<T: Real>: AnyEffect<T> {
    /// Adds the weighted forces \[N, N m\] to those of both sides, which hold all others but those of later
    /// pair effects and of interfaces, and remembers them for [`Self::power`]. Must not allocate. Forces
    /// must sum to zero, or momentum is made: [`crate::conformance::reaction`].
    ///
    /// # Errors
    /// Whatever keeps the effect from doing so.
    fn add_forces(&mut self, at: [&Instant<'_, T>; 2], f: [&mut [T]; 2]) -> Result<()>;

    /// Power of the last added forces on the velocities of both sides \[W\].
    fn power(&self, v: [&[T]; 2]) -> T;

    /// Adds the last forces of contact on one side to `f`, for output; `false` for an effect that is none.
    fn add_contact(&self, _side: usize, _: &mut [T]) -> bool {
        false
    }

    /// What the effect demands of the step of either side.
    fn step_demand(&self) -> [StepDemand<T>; 2] {
        [StepDemand::none(), StepDemand::none()]
    }
}

/// A pair effect and the two subdomains it is between.
pub struct PairSpec<T: Real> {
    /// Numbers of the subdomains, two different ones.
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

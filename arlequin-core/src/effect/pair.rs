//! Effects between two subdomains: contact of two bodies.
//!
//! An [`Effect`](super::Effect) sees one subdomain. A pair effect sees two at the same instant, after the positions, the
//! internal forces and the effects of both are known and before either is accelerated. It is one line of the ledger,
//! demands its share of the step, and where it says what was `supplied` it is held to the same rule: `supplied − work −
//! stored` does not become negative. Effects
//! of the subdomains do not see its forces, so a local damping leaves them alone.

use super::{Demand, Instant, Site};
use crate::momentum::Arms;
use crate::snapshot::Record;
use crate::subdomain::Subdomain;
use crate::{Real, Result};

/// What a pair effect may see when it is attached.
#[derive(Debug)]
pub struct PairSite<'a, T: Real> {
    /// The two subdomains.
    pub sites: [Site<'a, T>; 2],
    /// Nodes of either side that an interface between these two subdomains holds; empty where there is none. What is
    /// tied to the other side moves with it and should not be pushed away from it.
    pub tied: [Vec<bool>; 2],
}

/// Forces between two subdomains. Arrays hold the first side, then the second.
pub trait PairEffect<T: Real>: Send {
    /// Name in the ledger; names both models, such as `contact ball-block`.
    fn name(&self) -> &str;

    /// Prepares the effect; called once before the first step.
    ///
    /// # Errors
    /// Models or parameters that the effect cannot work with.
    fn attach(&mut self, site: &PairSite<'_, T>) -> Result<()>;

    /// Adds the weighted forces \[N, N m\] to those of both sides, which hold all others but those of later pair effects
    /// and of interfaces, and remembers them for [`PairEffect::power`]. Must not allocate. Forces must sum to zero, or
    /// momentum is made: [`crate::conformance::reaction`].
    ///
    /// # Errors
    /// Whatever keeps the effect from doing so.
    fn add_forces(&mut self, at: [&Instant<'_, T>; 2], f: [&mut [T]; 2]) -> Result<()>;

    /// Power of the last added forces on the velocities of both sides \[W\].
    fn power(&self, v: [&[T]; 2]) -> T;

    /// What the effect demands of the step of either side.
    fn demand(&self) -> [Demand<T>; 2] {
        [Demand::none(), Demand::none()]
    }

    /// Positions about which its forces on both sides have no moment; `None` where that is not known.
    fn arms(&self) -> Option<Arms> {
        None
    }

    /// Energy the effect holds now and could give back \[J\], as [`super::Effect::stored`].
    fn stored(&self) -> T {
        T::zero()
    }

    /// As [`super::Effect::supplied`].
    fn supplied(&self) -> Option<T> {
        None
    }

    /// What the effect must remember to go on with the same bits.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Goes back to what [`PairEffect::save`] returned; called after [`PairEffect::attach`].
    ///
    /// # Errors
    /// A record of another effect.
    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        from.expect(self.name(), 0, 0)
    }

    /// Figures for reports: names (with units) and values.
    fn facts(&self) -> Vec<(String, f64)> {
        Vec::new()
    }
}

/// A pair effect and the two subdomains it is between.
pub struct PairSpec<T: Real> {
    /// Numbers of the subdomains, two different ones.
    pub sides: [usize; 2],
    /// The effect.
    pub effect: Box<dyn PairEffect<T>>,
}

impl<T: Real> std::fmt::Debug for PairSpec<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PairSpec")
            .field("sides", &self.sides)
            .field("effect", &self.effect.name())
            .finish()
    }
}

/// A pair effect at work, with its line of the ledger.
pub(crate) struct Pair<T: Real> {
    pub(crate) sides: [usize; 2],
    pub(crate) effect: Box<dyn PairEffect<T>>,
    pub(crate) work: T,
    /// What the last instant added to it.
    pub(crate) last_work: T,
}

impl<T: Real> std::fmt::Debug for Pair<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pair")
            .field("sides", &self.sides)
            .field("effect", &self.effect.name())
            .field("work", &self.work)
            .finish_non_exhaustive()
    }
}

impl<T: Real> Pair<T> {
    pub(crate) fn new(spec: PairSpec<T>) -> Self {
        Self {
            sides: spec.sides,
            effect: spec.effect,
            work: T::zero(),
            last_work: T::zero(),
        }
    }

    /// Refuses sides that are not two different subdomains.
    pub(crate) fn check(&self, count: usize) -> Result<()> {
        let [a, b] = self.sides;
        if a != b && a.max(b) < count {
            return Ok(());
        }
        let what = format!("subdomains of '{}'", self.effect.name());
        let rule = format!("must be two different ones of {count}; within one, use an effect on it");
        Err(crate::error::invalid(&what, format_args!("{a} and {b}"), &rule))
    }

    /// Energy \[J\] the effect has created, above zero only where its law is at fault.
    pub(crate) fn created(&self) -> T {
        let work = self.work - self.last_work * T::of(0.5);
        let of = |from: T| (work + self.effect.stored() - from).max(T::zero());
        self.effect.supplied().map_or_else(T::zero, of)
    }

    /// Adds the work of this instant.
    pub(crate) fn account(&mut self, dt: T, subdomains: &[Subdomain<T>]) {
        let v = self.sides.map(|s| &subdomains[s].state.v[..]);
        self.last_work = dt * self.effect.power(v);
        self.work += self.last_work;
    }
}

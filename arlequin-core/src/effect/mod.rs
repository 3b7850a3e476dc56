//! Effects: body force, loads, damping, absorber. A run has only the effects that its scene lists.
//!
//! An effect adds forces to one subdomain and is one line of the energy ledger; a [`PairEffect`] acts between
//! two subdomains. Users create an [`EffectSpec`]; the run attaches it and gets the [`Effect`]. A
//! user-defined effect whose force is a formula needs a spec and a closure: [`ForceLaw`].

mod absorber;
mod account;
mod bulk_viscosity;
mod law;
mod load;
mod pair;
mod pressure;
mod simple;

pub use crate::model::Finding;
pub use absorber::{Absorber, RateField};
pub use account::EffectLine;
pub(crate) use account::{Attached, shortened};
pub use bulk_viscosity::BulkViscosity;
pub use law::ForceLaw;
pub use load::{Load, SurfaceFacet};
pub use pair::{HostPair, PairEffect, PairEffectSpec, PairSpec};
pub use pressure::FollowingPressure;
pub use simple::*;

use crate::model::{Arms, DofLayout, Model};
use crate::record::Record;
use crate::weight::Weights;
use crate::{Exact, Owned, Real, Result};
use nalgebra::Vector3;

/// The subdomain that an effect is attached to. If the model is partitioned, all fields are those of this
/// rank's part. Unknowns in a specification are numbered in the whole model ([`Host::unknown`] converts
/// them).
#[derive(Clone, Copy)]
pub struct Host<'a, T: Real> {
    /// The model.
    pub model: &'a dyn Model<T>,
    /// The model's weights; loads take `external`.
    pub weights: &'a Weights<T>,
    /// Lumped inertia weighted by `β` \[kg, kg m²\].
    pub inertia: &'a [T],
    /// Inverse of the inertia; zero for prescribed unknowns.
    pub inverse_inertia: &'a [T],
    /// True if the run has partitioned the model, so that effects can communicate with other ranks.
    pub is_partitioned: bool,
}

impl<T: Real> Host<'_, T> {
    /// Returns the nodes that this rank owns, for an effect that communicates with other ranks.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] for a model that was partitioned before the run received it.
    pub fn owned(&self) -> Result<Owned> {
        let owned = self.model.owned();
        if owned.is_part() && !self.is_partitioned {
            let what = "have an effect that hears of other ranks where it is in parts already; the run must share it out itself \
                        (Subdomain::shared)";
            return Err(crate::Error::Unsupported {
                model: self.model.name().to_owned(),
                what: what.to_owned(),
            });
        }
        Ok(owned)
    }

    /// Number of unknowns of the whole model.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.model.owned().whole_layout(&self.model.layout()).dofs()
    }

    /// Local number of an unknown of the whole model; `None` if another rank owns it.
    ///
    /// # Panics
    /// For an unknown that the whole model does not have.
    #[must_use]
    pub fn unknown(&self, number: usize) -> Option<usize> {
        self.model.owned().local_unknown(&self.model.layout(), number)
    }
}

impl<T: Real> std::fmt::Debug for Host<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Host {}", self.model.name())
    }
}

/// The instant at which forces are evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, T> {
    /// Time \[s\].
    pub time: T,
    /// Displacements at [`Self::time`].
    pub q: &'a [T],
    /// Velocities half a step earlier, which is what an explicit scheme knows. Times [`Instant::dt`] they are
    /// the displacement of the step.
    pub v_half: &'a [T],
    /// Length of the step that led here \[s\]; zero at the start of a run.
    pub dt: T,
    /// Number of own steps that the model has made since the start of the run. Zero if no step led to this
    /// instant: at the start, after a change of weights, and at rest.
    pub number: usize,
    /// Weighted internal forces of the model now \[N, N m\].
    pub internal: &'a [T],
    /// Weighted internal forces one step earlier; zero at the start of a run.
    pub internal_before: &'a [T],
}

/// Demand of an effect on the time step, in terms of the highest frequency `ω` of the model without the
/// effect: `ω² → gain (ω² + stiffness)`, damped at the rate `damping + viscosity ω²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepDemand<T> {
    /// Largest `ω²` that the effect can add \[1/s²\], as springs of a contact do.
    pub stiffness: T,
    /// Factor on all forces: dampings that scale with the force.
    pub gain: T,
    /// Largest damping rate `c/m` \[1/s\].
    pub damping: T,
    /// Damping proportional to the stiffness, `F = −viscosity K v` \[s\].
    pub viscosity: T,
}

impl<T: Real> StepDemand<T> {
    /// No demand.
    pub fn none() -> Self {
        Self {
            stiffness: T::zero(),
            gain: T::one(),
            damping: T::zero(),
            viscosity: T::zero(),
        }
    }

    /// A damping rate \[1/s\] only.
    pub fn damping(rate: T) -> Self {
        Self {
            damping: rate,
            ..Self::none()
        }
    }
}

/// Specification of an effect, which a user creates. The run attaches it to its subdomain before the first
/// step and gets the [`Effect`] that has forces.
pub trait EffectSpec<T: Real>: Send {
    /// Prepares the effect for its subdomain.
    ///
    /// # Errors
    /// Parameters that are invalid for this subdomain.
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>>;
}

/// Position and motion of a rigid body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion<T: Real> {
    /// Displacement since the start \[m\].
    pub displacement: Vector3<T>,
    /// Velocity half a step earlier \[m/s\].
    pub velocity: Vector3<T>,
    /// Angular velocity half a step earlier \[rad/s\].
    pub spin: Vector3<T>,
}

/// Common part of effects on one subdomain and between two: a line of the energy ledger, and a memory.
pub trait AnyEffect<T: Real>: Send {
    /// Name in the ledger. An effect between two subdomains names both models, such as `contact ball-block`.
    fn name(&self) -> &str;

    /// Positions about which the forces have no moment, if they sum to zero; `None` if they come from
    /// outside, or if that is not known.
    fn arms(&self) -> Option<Arms> {
        None
    }

    /// Returns whether the effect acts on every share of a body, like gravity and damping. In an overlap it
    /// then belongs on both models, and a run warns if only one of them has it.
    fn acts_on_shares(&self) -> bool {
        false
    }

    /// Energy that the effect holds and could give back \[J\], such as that of compressed contact springs.
    /// Where [`Self::supplied`] is known, it is counted like the ledger's energies, in which the work of this
    /// instant is half done: a linear spring holds `k/4 q_n (q_{n−1} + q_{n+1})`, which is less than `k/2
    /// q_n²` by the relative amount `(ω Δt)²/2`.
    fn stored(&self) -> T {
        T::zero()
    }

    /// Energy that the effect has taken from outside the run up to this instant \[J\]: the work of a driven
    /// obstacle. The effect has then dissipated `supplied − work − stored`, and a run in which this becomes
    /// negative is stopped. `None` for loads, whose work comes from outside entirely.
    fn supplied(&self) -> Option<T> {
        None
    }

    /// Motion of the effect's rigid body, if it has one; for output.
    fn rigid(&self) -> Option<RigidMotion<T>> {
        None
    }

    /// Returns what the effect must remember to resume with the same bits: contact histories, the motion of
    /// an obstacle. Empty for most effects.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Returns whether, for a partitioned model, [`Self::save`] returns the state of the whole model on rank
    /// 0 and [`Self::restore`] receives all of it on every rank. Otherwise a record holds one number per
    /// local unknown, or none. Saving is collective.
    fn saves_whole(&self) -> bool {
        false
    }

    /// Restores the state that [`Self::save`] returned.
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

/// A load, a damping or any other force on one subdomain beside the internal forces, ready to act.
pub trait Effect<T: Real>: AnyEffect<T> {
    /// Adds the weighted forces \[N, N m\] to `f` and keeps them for [`Self::power`]. Must not allocate.
    ///
    /// # Errors
    /// Any error of the effect.
    fn add_forces(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()>;

    /// Power of the last added forces at the velocities `v` \[W\]: negative where energy is dissipated.
    fn power(&self, v: &[T]) -> T;

    /// Adds the power of the last added forces at `v` to an exact sum, one term per unknown, node or unit of
    /// nodes, so that the sum over all ranks does not depend on the partition. Returns `false` if the effect
    /// cannot do so; it then acts only on models that are not partitioned.
    fn add_power(&self, _layout: &DofLayout, _v: &[T], _sum: &mut Exact) -> bool {
        false
    }

    /// Nodes of this rank to whose displacement components alone the effect adds forces; `None` for an effect
    /// that may add forces anywhere. A step then copies no internal forces elsewhere.
    fn nodes(&self) -> Option<&[u32]> {
        None
    }

    /// Adapts the effect to new weights of its subdomain without losing its state. A change of weights calls
    /// this for effects that are not made anew ([`crate::Rezoning::with_kept_effect`]). At the instant of the
    /// change, contacts then keep the forces that [`Self::add_contact`] returns.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] by default.
    fn reweigh(&mut self, host: &Host<'_, T>) -> Result<()> {
        Err(crate::Error::Unsupported {
            model: host.model.name().to_owned(),
            what: format!(
                "keep the effect '{}' with other weights; make it anew",
                self.name()
            ),
        })
    }

    /// Demand on the time step; for a partitioned model, by the nodes of this rank.
    fn step_demand(&self) -> StepDemand<T> {
        StepDemand::none()
    }

    /// Adds the last contact forces to `f`. Returns `false` if the effect is no contact.
    fn add_contact(&self, _: &mut [T]) -> bool {
        false
    }

    /// Returns whether the forces depend on time alone. Only then the effect can act on a model that steps
    /// implicitly.
    fn is_dead(&self) -> bool {
        false
    }
}

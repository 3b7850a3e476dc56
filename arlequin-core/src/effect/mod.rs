//! Effects: body force, loads, damping, absorber. Only what a scene lists exists in the run.
//!
//! An effect adds forces to one subdomain and is one line of the energy ledger; a [`PairEffect`] acts
//! between two. What a user makes is an [`EffectSpec`]; the run attaches it and gets the [`Effect`]. One of
//! your own whose force is a formula needs a spec and a closure: [`ForceLaw`].

mod absorber;
mod account;
mod bulk_viscosity;
mod law;
mod load;
mod pair;
mod simple;

pub use crate::model::Finding;
pub use absorber::{Absorber, RateField};
pub use account::EffectLine;
pub(crate) use account::{Attached, shortened};
pub use bulk_viscosity::BulkViscosity;
pub use law::ForceLaw;
pub use load::{Load, SurfaceFacet};
pub use pair::{HostPair, PairEffect, PairEffectSpec, PairSpec};
pub use simple::*;

use crate::model::{Arms, DofLayout, Model};
use crate::ranks::{Exact, Portion};
use crate::record::Record;
use crate::subdomain::local;
use crate::weight::Weights;
use crate::{Real, Result};
use nalgebra::Vector3;
use std::sync::Arc;

/// The subdomain that an effect acts on, as the effect sees it when it is attached. Of a model in parts all
/// of it is of the part that is here; unknowns that a specification names are those of the whole model
/// ([`Host::unknown`]).
#[derive(Clone, Copy)]
pub struct Host<'a, T: Real> {
    /// The model.
    pub model: &'a dyn Model<T>,
    /// The model's weights; loads take `external`.
    pub weights: &'a Weights<T>,
    /// Lumped inertia weighted by `β` \[kg, kg m²\].
    pub inertia: &'a [T],
    /// Its inverse, zero for prescribed unknowns.
    pub inverse_inertia: &'a [T],
    /// What this rank holds of a model that the run has shared out: by which effects hear of other ranks as
    /// they act.
    pub portion: Option<&'a Arc<Portion>>,
}

impl<T: Real> Host<'_, T> {
    /// [`Self::portion`] for an effect that needs to hear of other ranks.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] for a model that was in parts before the run had it.
    pub fn shared(&self) -> Result<Option<&Arc<Portion>>> {
        if self.portion.is_none() && self.model.portion().is_some() {
            let what = "have an effect that hears of other ranks where it is in parts already; the run must share it out itself \
                        (Subdomain::shared)";
            return Err(crate::Error::Unsupported {
                model: self.model.name().to_owned(),
                what: what.to_owned(),
            });
        }
        Ok(self.portion)
    }

    /// Unknowns of the whole model.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.whole().dofs()
    }

    /// Number here of an unknown of the whole model; none if another rank holds it.
    ///
    /// # Panics
    /// For an unknown that is not there.
    #[must_use]
    pub fn unknown(&self, of_whole: usize) -> Option<usize> {
        match self.model.portion() {
            Some(portion) => local(portion, &self.whole(), of_whole),
            None => Some(of_whole),
        }
    }

    fn whole(&self) -> DofLayout {
        let layout = self.model.layout();
        let nodes = self
            .model
            .portion()
            .map_or(layout.nodes, |p| p.division().nodes());
        DofLayout { nodes, ..layout }
    }
}

impl<T: Real> std::fmt::Debug for Host<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Host {}", self.model.name())
    }
}

/// The instant at which forces are wanted.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, T> {
    /// Time \[s\].
    pub time: T,
    /// Displacements at that time.
    pub q: &'a [T],
    /// Velocities half a step earlier: what an explicit scheme knows. Times [`Instant::dt`] they are the
    /// displacement of the step.
    pub v_half: &'a [T],
    /// Length of the step that led here \[s\]; zero at the start of a run.
    pub dt: T,
    /// Weighted internal forces of the model now \[N, N m\].
    pub internal: &'a [T],
    /// The same one step earlier; zero at the start of a run.
    pub internal_before: &'a [T],
}

/// What an effect demands of the time step, in terms of the highest frequency `ω` of the model without it:
/// `ω² → gain (ω² + stiffness)`, damped at the rate `damping + viscosity ω²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepDemand<T> {
    /// Largest `ω²` the effect can add \[1/s²\]: contact springs.
    pub stiffness: T,
    /// Factor on all forces: dampings that scale with the force.
    pub gain: T,
    /// Largest damping rate `c/m` \[1/s\].
    pub damping: T,
    /// Damping proportional to the stiffness, `F = −viscosity K v` \[s\].
    pub viscosity: T,
}

impl<T: Real> StepDemand<T> {
    /// Nothing.
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

/// What a user chooses of an effect. A run attaches it to its subdomain before the first step; only then
/// there is something that has forces.
pub trait EffectSpec<T: Real>: Send {
    /// Makes the effect ready for its subdomain.
    ///
    /// # Errors
    /// Parameters that make no sense for this subdomain.
    fn attach(self: Box<Self>, to: &Host<'_, T>) -> Result<Box<dyn Effect<T>>>;
}

/// Where a rigid body is and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion<T: Real> {
    /// Displacement since the start \[m\].
    pub displacement: Vector3<T>,
    /// Velocity half a step earlier \[m/s\].
    pub velocity: Vector3<T>,
    /// Angular velocity then \[rad/s\].
    pub spin: Vector3<T>,
}

/// What effects on one subdomain and between two have in common: a line of the energy ledger, and a memory.
pub trait AnyEffect<T: Real>: Send {
    /// Name in the ledger; between two subdomains it names both models, such as `contact ball-block`.
    fn name(&self) -> &str;

    /// Positions about which its forces have no moment, if they add up to nothing; `None` where they come
    /// from outside, or where that is not known.
    fn arms(&self) -> Option<Arms> {
        None
    }

    /// Whether it acts on all of a body by the share that the model has of it, as weight and damping do: in
    /// an overlap it belongs on both models, and a run warns where only one has it.
    fn acts_on_shares(&self) -> bool {
        false
    }

    /// Energy the effect holds now and could give back \[J\], such as that of compressed contact springs.
    /// With [`Self::supplied`] it counts in the sense of the ledger, in which the work of this instant is
    /// half done: a linear spring holds `k/4 q_n (q_{n−1} + q_{n+1})`, which is `(ω Δt)²/2` less than `k/2
    /// q_n²`.
    fn stored(&self) -> T {
        T::zero()
    }

    /// Energy the effect has taken from outside the run up to this instant \[J\]: the work of a driven
    /// obstacle. Then `supplied − work − stored` is what it has dissipated, and a run in which that becomes
    /// negative is stopped. `None` for loads, whose work is all from outside.
    fn supplied(&self) -> Option<T> {
        None
    }

    /// How the rigid body of the effect moves, if it has one: for output.
    fn rigid(&self) -> Option<RigidMotion<T>> {
        None
    }

    /// What the effect must remember to go on with the same bits: contact histories, the motion of an
    /// obstacle. Nothing for most.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Whether, of a model in parts, it saves by itself what it remembers of the whole, on the first rank,
    /// and every rank goes back to all of that. All ranks save together. Else a record has a number for
    /// every unknown here, or none.
    fn saves_whole(&self) -> bool {
        false
    }

    /// Goes back to what [`Self::save`] returned.
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

/// A load, a damping or any other force on one subdomain beside its internal ones, ready to act.
pub trait Effect<T: Real>: AnyEffect<T> {
    /// Adds the weighted forces \[N, N m\] and remembers them for [`Self::power`]. Must not allocate.
    ///
    /// # Errors
    /// Whatever keeps the effect from doing so.
    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()>;

    /// Power of the last added forces on the velocities `v` \[W\]: negative where energy is dissipated.
    fn power(&self, v: &[T]) -> T;

    /// Adds the power of the last added forces on `v`, each term of the forces on one unknown, node or unit
    /// of nodes, so that the sum over all ranks that hold a model in parts does not depend on who holds
    /// what. `false` for an effect that cannot: it then acts on whole models only.
    fn add_power(&self, _layout: &DofLayout, _v: &[T], _to: &mut Exact) -> bool {
        false
    }

    /// What the effect demands of the time step; of a model in parts, of the nodes here.
    fn step_demand(&self) -> StepDemand<T> {
        StepDemand::none()
    }

    /// Adds the last forces of contact to `f`, for output; `false` for an effect that is none.
    fn add_contact(&self, _: &mut [T]) -> bool {
        false
    }

    /// Whether its forces depend on time alone: only such can act on a model that steps implicitly.
    fn is_dead(&self) -> bool {
        false
    }
}

//! Effects: body force, loads, damping, absorber. Only what a scene lists exists in the run.
//!
//! An effect adds forces to one subdomain and is one line of the energy ledger; a [`PairEffect`] acts between two.

mod absorber;
mod account;
mod load;
mod pair;
mod prestress;
mod viscous;

pub use absorber::{Absorber, RateField};
pub use account::EffectLine;
pub(crate) use account::shortened;
pub use load::{Load, SurfaceFacet};
pub(crate) use pair::Pair;
pub use pair::{PairEffect, PairSite, PairSpec};
pub use prestress::Prestress;
pub use viscous::{BulkViscosity, LocalDamping, StiffnessDamping};

use crate::model::{DofLayout, Model};
use crate::momentum::Arms;
use crate::snapshot::Record;
use crate::weight::Weights;
use crate::{Real, Result};
use nalgebra::Vector3;

/// What an effect may see when it is attached to a subdomain.
#[derive(Clone, Copy)]
pub struct Site<'a, T: Real> {
    /// The model.
    pub model: &'a dyn Model<T>,
    /// The model's weights; loads take `external`.
    pub weights: &'a Weights<T>,
    /// Lumped inertia weighted by `β` \[kg, kg m²\].
    pub inertia: &'a [T],
    /// Its inverse, zero for prescribed unknowns.
    pub inverse_inertia: &'a [T],
}

impl<T: Real> std::fmt::Debug for Site<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Site of {}", self.model.name())
    }
}

/// The instant at which forces are wanted.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, T> {
    /// Time \[s\].
    pub time: T,
    /// Displacements at that time.
    pub q: &'a [T],
    /// Velocities half a step earlier: what an explicit scheme knows. Times [`Instant::dt`] they are the displacement
    /// of the step.
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
pub struct Demand<T> {
    /// Largest `ω²` the effect can add \[1/s²\]: contact springs.
    pub stiffness: T,
    /// Factor on all forces: dampings that scale with the force.
    pub gain: T,
    /// Largest damping rate `c/m` \[1/s\].
    pub damping: T,
    /// Damping proportional to the stiffness, `F = −viscosity K v` \[s\].
    pub viscosity: T,
}

impl<T: Real> Demand<T> {
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

/// Something a model would need an effect for that is not on.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the effect to switch on.
    pub effect: &'static str,
    /// What was found, with value and limit.
    pub message: String,
}

/// A load, a damping or any other force on one subdomain beside its internal ones.
pub trait Effect<T: Real>: Send {
    /// Name in the ledger.
    fn name(&self) -> &str;

    /// Prepares the effect for its subdomain; called once before the first step.
    ///
    /// # Errors
    /// Invalid parameters for this subdomain.
    fn attach(&mut self, site: &Site<'_, T>) -> Result<()>;

    /// Adds the weighted forces \[N, N m\] and remembers them for [`Effect::power`]. Must not allocate.
    ///
    /// # Errors
    /// Whatever keeps the effect from doing so.
    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()>;

    /// Power of the last added forces on the velocities `v` \[W\]: negative where energy is dissipated.
    fn power(&self, v: &[T]) -> T;

    /// What the effect demands of the time step.
    fn demand(&self) -> Demand<T> {
        Demand::none()
    }

    /// Positions about which its forces have no moment, if they add up to nothing; `None` where they come from outside.
    fn arms(&self) -> Option<Arms> {
        None
    }

    /// Energy the effect holds now and could give back \[J\], such as that of compressed contact springs. With
    /// [`Effect::supplied`] it counts in the sense of the ledger, in which the work of this instant is half done: a linear
    /// spring holds `k/4 q_n (q_{n−1} + q_{n+1})`, which is `(ω Δt)²/2` less than `k/2 q_n²`.
    fn stored(&self) -> T {
        T::zero()
    }

    /// Energy the effect has taken from outside the run up to this instant \[J\]: the work of a driven obstacle. Then
    /// `supplied − work − stored` is what it has dissipated, and a run in which that becomes negative is stopped.
    /// `None` for loads, whose work is all from outside.
    fn supplied(&self) -> Option<T> {
        None
    }

    /// What the effect must remember to go on with the same bits: contact histories, the motion of an obstacle.
    /// Nothing for most.
    fn save(&self) -> Record<T> {
        Record::default()
    }

    /// Goes back to what [`Effect::save`] returned; called after [`Effect::attach`].
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

/// Gravity or any constant acceleration field \[m/s²\]: `F_i = M_γ,i g`.
#[derive(Debug, Clone)]
pub struct BodyForce<T: Real> {
    acceleration: Vector3<T>,
    force: Vec<T>,
}

impl<T: Real> BodyForce<T> {
    /// Body force with the given acceleration \[m/s²\]; bars and chains feel its x component.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if it is not finite.
    pub fn new(acceleration: Vector3<T>) -> Result<Self> {
        if acceleration.iter().all(|a| a.is_finite()) {
            Ok(Self {
                acceleration,
                force: Vec::new(),
            })
        } else {
            Err(crate::error::invalid(
                "body acceleration",
                format_args!("{acceleration:?}"),
                "must be finite",
            ))
        }
    }
}

impl<T: Real> Effect<T> for BodyForce<T> {
    fn name(&self) -> &str {
        "body-force"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        let DofLayout { components, .. } = site.model.layout();
        let mut mass = vec![T::zero(); site.model.layout().dofs()];
        site.model
            .lumped_inertia(&*site.weights.external, site.weights.weighting, &mut mass)?;
        mass.truncate(site.model.layout().translations());
        for (i, m) in mass.iter_mut().enumerate() {
            *m *= self.acceleration[i % components];
        }
        self.force = mass;
        Ok(())
    }

    fn add_forces(&mut self, _: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        f.iter_mut().zip(&self.force).for_each(|(f, g)| *f += *g);
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }
}

/// Mass-proportional damping `F = −c M_β v` with a rate `c` \[1/s\].
#[derive(Debug, Clone)]
pub struct MassDamping<T: Real> {
    rate: T,
    inertia: Vec<T>,
    force: Vec<T>,
}

impl<T: Real> MassDamping<T> {
    /// Damping with the given rate \[1/s\].
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] if it is negative or not finite.
    pub fn new(rate: T) -> Result<Self> {
        if rate >= T::zero() && rate.is_finite() {
            Ok(Self {
                rate,
                inertia: Vec::new(),
                force: Vec::new(),
            })
        } else {
            Err(crate::error::invalid(
                "damping rate",
                rate,
                "must be finite and not negative",
            ))
        }
    }
}

impl<T: Real> Effect<T> for MassDamping<T> {
    fn name(&self) -> &str {
        "mass-damping"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        self.inertia = site.inertia.to_vec();
        self.force = vec![T::zero(); self.inertia.len()];
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        for (((f, g), m), v) in f
            .iter_mut()
            .zip(&mut self.force)
            .zip(&self.inertia)
            .zip(at.v_half)
        {
            *g = -self.rate * *m * *v;
            *f += *g;
        }
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }

    fn demand(&self) -> Demand<T> {
        Demand::damping(self.rate)
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

pub(crate) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |s, (x, y)| s + *x * *y)
}

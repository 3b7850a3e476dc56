//! Weight functions: how overlapping models share energy, mass and load.
//!
//! `f = 1` where only the coarse model lives and `0` where only the fine model does. In the overlap `f = ε +
//! (1 − ε − ε_D) p(s)` with a profile `p` of the normalised position `s ∈ [0, 1]`, counted from the fine
//! border. `ε` is the floor (smallest weight) of the coarse model, `ε_D` that of the fine model, equal to `ε`
//! unless given.

use crate::error::invalid;
use crate::geometry::{self, Cell, HalfSpace};
use crate::overlap::{CellPlace, Overlap, Place};
use crate::{Real, Result};
use nalgebra::Point3;
use std::sync::Arc;

use crate::named::named;
use crate::profile::Profile;

/// How weights enter a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weighting {
    /// Every element or bond carries the mean of the weight over itself, in stiffness **and** mass.
    /// Conserves the weighted energy and leaves the critical step as it is for any weight.
    #[default]
    Energy,
    /// Nodal forces and masses are multiplied by the weight at the node, see [`crate::NodallyWeighted`].
    /// Not conservative; kept for comparison with the literature.
    Nodal,
}

named!(Weighting, "weighting":
    Energy = "energy",
    Nodal = "nodal",
);

impl Weighting {
    /// Usual floor `ε` of a weight whose user gives none \[–\]. `breaks` tells that bonds of the model can
    /// break.
    pub fn usual_floor(self, breaks: bool) -> f64 {
        match self {
            // With less, the outermost particles at the border where the weight vanishes are loaded several
            // times as much as the body, even at rest (decision 0022).
            _ if breaks => 0.1,
            // Energy weighting needs no floor; this one only keeps nodal quantities at the border positive.
            Self::Energy => 1e-6,
            // Weights at nodes shorten the critical step where they are small; the literature takes 0.05.
            Self::Nodal => 0.05,
        }
    }
}

/// A weight function. Over all models, the weights of one kind sum to one at every point.
pub trait Weight<T: Real>: Send + Sync {
    /// Value at a point \[–\].
    fn value(&self, x: &Point3<T>) -> T;

    /// Mean over a cell. The default integrates numerically; a weight that knows its kinks does it exactly.
    fn mean(&self, cell: &Cell<T>) -> T {
        geometry::mean(cell, 2, &|x| self.value(x))
    }
}

/// Returns whether a weight may have changed somewhere in a box, which is given by its low and high corners
/// \[m\].
pub type Changed<T> = dyn Fn(&[Point3<T>; 2]) -> bool + Send + Sync;

/// A weight with one value everywhere; `Uniform(1)` is for a model that is not coupled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uniform<T>(pub T);

impl<T: Real> Weight<T> for Uniform<T> {
    fn value(&self, _: &Point3<T>) -> T {
        self.0
    }
    fn mean(&self, _: &Cell<T>) -> T {
        self.0
    }
}

/// One minus other weights: the weight of the fine model beside one or several coarse ones.
#[derive(Clone)]
pub struct Complement<T: Real>(pub Vec<Arc<dyn Weight<T>>>);

impl<T: Real> std::fmt::Debug for Complement<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Complement of {} weights", self.0.len())
    }
}

impl<T: Real> Weight<T> for Complement<T> {
    fn value(&self, x: &Point3<T>) -> T {
        // From one, so that the weights sum to one at every point, whatever the others are.
        T::one() - self.0.iter().map(|w| w.value(x)).sum()
    }
    fn mean(&self, cell: &Cell<T>) -> T {
        // Means of the same cell by the same rule: they sum to one as the values do.
        T::one() - self.0.iter().map(|w| w.mean(cell)).sum()
    }
}

/// Product of weights: the weight `(1 − f) g` of a model that receives `g` of what a coarser one leaves. All
/// weights of a chain, `f`, `(1 − f) g`, `(1 − f)(1 − g)`, …, are positive and sum to one, even where more
/// than two models overlap.
#[derive(Clone)]
pub struct Product<T: Real>(pub Vec<Arc<dyn Weight<T>>>);

impl<T: Real> std::fmt::Debug for Product<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Product of {} weights", self.0.len())
    }
}

impl<T: Real> Weight<T> for Product<T> {
    fn value(&self, x: &Point3<T>) -> T {
        self.0.iter().fold(T::one(), |p, w| p * w.value(x))
    }
    /// Exact where only one factor varies over the cell: its mean times the other factors. Otherwise
    /// numerical.
    fn mean(&self, cell: &Cell<T>) -> T {
        let corners = cell.corners();
        // Profiles are monotone: a weight that is zero or one at all corners is so between them.
        let fixed = |w: &Arc<dyn Weight<T>>| {
            let is_everywhere = |v: T| corners.iter().all(|x| w.value(x) == v);
            [T::zero(), T::one()]
                .into_iter()
                // The mean decides too: an overlap may pass through the middle of a cell without reaching its
                // corners.
                .find(|v| is_everywhere(*v) && w.mean(cell) == *v)
        };
        let (mut factor, mut varying) = (T::one(), Vec::new());
        for w in &self.0 {
            match fixed(w) {
                Some(v) => factor *= v,
                None => varying.push(w),
            }
        }
        match varying.as_slice() {
            [] => factor,
            [single] => factor * single.mean(cell),
            _ => geometry::mean(cell, 2, &|x| self.value(x)),
        }
    }
}

/// The weight of the coarse model across one overlap.
#[derive(Clone)]
pub struct Ramp<T: Real> {
    overlap: Arc<dyn Overlap<T>>,
    profile: Profile<T>,
    epsilon: T,
    fine_epsilon: T,
}

impl<T: Real> std::fmt::Debug for Ramp<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ramp")
            .field("profile", &self.profile)
            .field("epsilon", &self.epsilon)
            .field("fine_epsilon", &self.fine_epsilon)
            .finish()
    }
}

impl<T: Real> Ramp<T> {
    /// Weight with the given profile, kept in `[ε, 1 − ε]` inside the overlap; [`Self::with_fine_floor`]
    /// changes the upper limit.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for `ε` outside `[0, 0.5)` or a constant outside `[0, 1]`.
    pub fn new(overlap: Arc<dyn Overlap<T>>, profile: Profile<T>, epsilon: T) -> Result<Self> {
        // Not `epsilon < 0`: a NaN must be refused, too. From one half on the weight would fall across the
        // overlap.
        if !(epsilon >= T::zero() && epsilon < T::of(0.5)) {
            return Err(invalid("epsilon", epsilon, "must be at least 0 and below 0.5"));
        }
        if let Profile::Constant(c) = profile
            && !(c >= T::zero() && c <= T::one())
        {
            return Err(invalid("constant weight", c, "must be between 0 and 1"));
        }
        Ok(Self {
            overlap,
            profile,
            epsilon,
            fine_epsilon: epsilon,
        })
    }

    /// Sets the floor of the fine model: its smallest weight, at the border to the coarse model's region.
    ///
    /// The scatter of a packing leaves forces unbalanced. Where the weight vanishes, these forces strain next
    /// to no stiffness, and the outermost particles are loaded several times as hard as the body. A floor of
    /// 0.1 prevents this (decision 0022).
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a value outside `[0, 0.5)`.
    pub fn with_fine_floor(mut self, epsilon: T) -> Result<Self> {
        if !(epsilon >= T::zero() && epsilon < T::of(0.5)) {
            return Err(invalid(
                "fine_epsilon",
                epsilon,
                "must be at least 0 and below 0.5",
            ));
        }
        self.fine_epsilon = epsilon;
        Ok(self)
    }

    fn at_place(&self, place: Place<T>) -> T {
        match place {
            Place::Coarse => T::one(),
            Place::Fine => T::zero(),
            Place::Overlap(s) => match self.profile {
                // A constant is the user's own choice and keeps its value whatever the floor.
                Profile::Constant(c) => c,
                _ => self.epsilon + (T::one() - self.epsilon - self.fine_epsilon) * self.profile.value(s),
            },
        }
    }

    /// Exact mean where `s(x) = gradient · x + offset`: cuts the cell at the kinks of the profile and
    /// integrates every part exactly.
    fn exact_mean(&self, cell: &Cell<T>, gradient: nalgebra::Vector3<T>, offset: T) -> T {
        let (one, zero) = (T::one(), T::zero());
        let corners = cell.corners();
        let position = |x: &Point3<T>| gradient.dot(&x.coords) + offset;
        let low = corners
            .iter()
            .map(position)
            .fold(T::of(f64::MAX), |a, b| a.min(b));
        let high = corners
            .iter()
            .map(position)
            .fold(-T::of(f64::MAX), |a, b| a.max(b));
        // Most cells lie outside of the overlap: their mean needs no cut.
        if high <= zero || low >= one {
            return if high <= zero { zero } else { one };
        }
        let mut total = zero;
        // What is left of the cell beyond the kinks cut so far.
        let mut remainder = Some(cell.clone());
        let mut sum = zero;
        let mut samples = Vec::new();
        let mut add = |piece: &Cell<T>, value: &dyn Fn(T) -> T| {
            samples.clear();
            // Exact to degree five, that of the quintic profile.
            piece.quadrature(5, &mut samples);
            for s in &samples {
                sum += s.measure * value(position(&s.point));
                total += s.measure;
            }
        };
        for (k, b) in self.profile.breaks().into_iter().enumerate() {
            let plane = HalfSpace {
                normal: gradient,
                offset: b - offset,
            };
            let Some(body) = remainder else { break };
            if let Some(piece) = body.clip(&plane) {
                // The fine model's own region lies before the first kink.
                let value = |s: T| match k {
                    0 => zero,
                    _ => self.at_place(Place::Overlap(s.clamp(zero, one))),
                };
                add(&piece, &value);
            }
            remainder = body.clip(&plane.flipped());
        }
        if let Some(body) = remainder {
            add(&body, &|_| one);
        }
        // Over the measure of the parts: a weight of one has the mean one, whatever round-off the cuts leave.
        sum / total
    }
}

impl<T: Real> Weight<T> for Ramp<T> {
    fn value(&self, x: &Point3<T>) -> T {
        self.at_place(self.overlap.place(x))
    }

    fn mean(&self, cell: &Cell<T>) -> T {
        // A plane overlap first: its means are exact, those of all others are sums over samples.
        match (self.overlap.linear_position(), self.overlap.place_of_cell(cell)) {
            (Some((gradient, offset)), _) => self.exact_mean(cell, gradient, offset),
            (None, Some(CellPlace::Coarse)) => T::one(),
            (None, Some(CellPlace::Fine)) => T::zero(),
            (None, Some(CellPlace::Halved(levels))) => geometry::mean(cell, levels, &|x| self.value(x)),
            (None, None) => {
                let places: Vec<_> = cell.corners().iter().map(|x| self.overlap.place(x)).collect();
                let is_everywhere = |p: &dyn Fn(&Place<T>) -> bool| places.iter().all(p);
                // Away from the borders one rule will do; a border inside the cell needs a fine subdivision.
                let levels = if is_everywhere(&|p| matches!(p, Place::Coarse))
                    || is_everywhere(&|p| matches!(p, Place::Fine))
                {
                    0
                } else if is_everywhere(&|p| matches!(p, Place::Overlap(_))) {
                    1
                } else {
                    3
                };
                geometry::mean(cell, levels, &|x| self.value(x))
            }
        }
    }
}

/// The three weights of one model: `α` on internal energy, `β` on kinetic energy, `γ` on external work.
#[derive(Clone)]
pub struct Weights<T: Real> {
    /// `α`.
    pub internal: Arc<dyn Weight<T>>,
    /// `β`.
    pub kinetic: Arc<dyn Weight<T>>,
    /// `γ`.
    pub external: Arc<dyn Weight<T>>,
    /// How the weights enter the model.
    pub weighting: Weighting,
}

impl<T: Real> std::fmt::Debug for Weights<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Weights")
            .field("weighting", &self.weighting)
            .finish_non_exhaustive()
    }
}

impl<T: Real> Weights<T> {
    /// One weight for all three energies, applied by elements and bonds ([`Weighting::Energy`]).
    pub fn from_weight(weight: Arc<dyn Weight<T>>) -> Self {
        Self {
            internal: weight.clone(),
            kinetic: weight.clone(),
            external: weight,
            weighting: Weighting::Energy,
        }
    }

    /// Weights of one, for a model that is not coupled.
    pub fn uncoupled() -> Self {
        Self::from_weight(Arc::new(Uniform(T::one())))
    }

    /// Weights of the fine model: one minus those of its coarse partners, applied like those of the first
    /// partner.
    pub fn complement_of(coarse: &[Self]) -> Self {
        let pick = |f: &dyn Fn(&Self) -> Arc<dyn Weight<T>>| -> Arc<dyn Weight<T>> {
            Arc::new(Complement(coarse.iter().map(f).collect()))
        };
        let weighting = coarse.first().map_or(Weighting::Energy, |w| w.weighting);
        let internal = pick(&|w| w.internal.clone());
        // Weights that are one object stay so: set-ups then evaluate it once instead of three times.
        if coarse.iter().all(Self::are_one) {
            return Self::from_weight(internal).with_weighting(weighting);
        }
        Self {
            internal,
            kinetic: pick(&|w| w.kinetic.clone()),
            external: pick(&|w| w.external.clone()),
            weighting,
        }
    }

    /// Returns whether all three weights are known to be one object, so that it is enough to evaluate one of
    /// them.
    pub(crate) fn are_one(&self) -> bool {
        let place = |w: &Arc<dyn Weight<T>>| Arc::as_ptr(w).cast::<()>();
        [&self.kinetic, &self.external]
            .iter()
            .all(|w| std::ptr::eq(place(w), place(&self.internal)))
    }

    /// Weights of a model that receives `self` of what coarser models leave (`remainder`): the products of
    /// both. Keeps the weighting of `self`.
    #[must_use]
    pub fn within(self, remainder: &Self) -> Self {
        let product = |share: Arc<dyn Weight<T>>, remainder: &Arc<dyn Weight<T>>| -> Arc<dyn Weight<T>> {
            Arc::new(Product(vec![remainder.clone(), share]))
        };
        if self.are_one() && remainder.are_one() {
            return Self::from_weight(product(self.internal, &remainder.internal))
                .with_weighting(self.weighting);
        }
        Self {
            internal: product(self.internal, &remainder.internal),
            kinetic: product(self.kinetic, &remainder.kinetic),
            external: product(self.external, &remainder.external),
            weighting: self.weighting,
        }
    }

    /// Sets how the weights enter the model.
    #[must_use]
    pub fn with_weighting(mut self, weighting: Weighting) -> Self {
        self.weighting = weighting;
        self
    }
}

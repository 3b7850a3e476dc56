//! Forces on given unknowns: nodal loads and surface tractions with a time function.

use super::{AnyEffect, Effect, EffectSpec, Host, Instant};
use crate::Exact;
use crate::error::invalid;
use crate::model::DofLayout;
use crate::time::TimeFunction;
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// A facet of a model's surface, as loads need it.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceFacet<T: Real> {
    /// Nodes that carry the facet's load.
    pub nodes: Vec<usize>,
    /// Area of each node's share \[m²\].
    pub shares: Vec<T>,
    /// Centre \[m\].
    pub centre: Point3<T>,
    /// Outward unit normal.
    pub normal: Vector3<T>,
}

impl<T: Real> SurfaceFacet<T> {
    /// Area \[m²\].
    pub fn area(&self) -> T {
        self.shares.iter().copied().sum()
    }
}

#[derive(Debug, Clone)]
enum Spread<T: Real> {
    /// Forces \[N\] (moments \[N m\]) on unknowns.
    Dofs(Vec<(usize, T)>),
    /// Forces on unknowns that are weighted already.
    Shares(Vec<(usize, T)>),
    /// Tractions \[Pa\], one per facet.
    Facets(Vec<(SurfaceFacet<T>, Vector3<T>)>),
}

/// A dead load on some unknowns, scaled by a time function and weighted by `γ`; or a sum of such loads.
#[derive(Debug, Clone)]
pub struct Load<T: Real> {
    name: String,
    terms: Vec<(Spread<T>, TimeFunction<T>)>,
}

/// A load attached to a subdomain.
struct WeightedLoad<T: Real> {
    name: String,
    terms: Vec<Term<T>>,
}

/// Weighted forces on unknowns that rise and fall together.
struct Term<T: Real> {
    forces: Vec<(usize, T)>,
    time: TimeFunction<T>,
    factor: T,
}

impl<T: Real> Load<T> {
    /// Load of forces \[N\] or moments \[N m\] on unknowns `(dof, amplitude)`, numbered in the whole model
    /// even if it is partitioned.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for an empty or non-finite list or time function.
    pub fn on_dofs(name: &str, forces: Vec<(usize, T)>, time: TimeFunction<T>) -> Result<Self> {
        let good = !forces.is_empty() && forces.iter().all(|(_, f)| f.is_finite());
        Self::checked(name, good, forces.len(), Spread::Dofs(forces), time)
    }

    /// Load of forces \[N\] or moments \[N m\] that are the share of this model already: `γ` is not applied.
    /// For callers that divide one load among several models themselves.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for an empty or non-finite list or time function.
    pub fn shared(name: &str, forces: Vec<(usize, T)>, time: TimeFunction<T>) -> Result<Self> {
        let good = !forces.is_empty() && forces.iter().all(|(_, f)| f.is_finite());
        Self::checked(name, good, forces.len(), Spread::Shares(forces), time)
    }

    /// Load of a traction field `t(x)` \[Pa\], sampled at the facet centres.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for an empty surface, a non-finite traction or an invalid time function.
    pub fn traction(
        name: &str,
        facets: Vec<SurfaceFacet<T>>,
        field: &dyn Fn(&SurfaceFacet<T>) -> Vector3<T>,
        time: TimeFunction<T>,
    ) -> Result<Self> {
        let loaded: Vec<_> = facets
            .into_iter()
            .map(|f| (field(&f), f))
            .map(|(t, f)| (f, t))
            .collect();
        let good = !loaded.is_empty() && loaded.iter().all(|(_, t)| t.iter().all(|c| c.is_finite()));
        Self::checked(name, good, loaded.len(), Spread::Facets(loaded), time)
    }

    fn checked(
        name: &str,
        good: bool,
        count: usize,
        spread: Spread<T>,
        time: TimeFunction<T>,
    ) -> Result<Self> {
        time.validate()?;
        if !good {
            let what = format!("load '{name}'");
            return Err(invalid(
                &what,
                format_args!("{count} entries"),
                "needs at least one finite entry; check the selection",
            ));
        }
        Ok(Self {
            name: name.to_owned(),
            terms: vec![(spread, time)],
        })
    }

    /// Adds the forces of another load, each with its own time function. The sum keeps the name of `self`.
    #[must_use]
    pub fn plus(mut self, other: Self) -> Self {
        self.terms.extend(other.terms);
        self
    }
}

impl<T: Real> Spread<T> {
    /// Returns the forces on unknowns of the host, weighted, each unknown once in ascending order.
    fn weighted(&self, name: &str, host: &Host<'_, T>) -> Result<Vec<(usize, T)>> {
        let layout = host.model.layout();
        let gamma = &*host.weights.external;
        let weigh = |dof: usize| gamma.value(&host.model.nodes()[layout.node_of(dof)]);
        let whole = host.unknowns();
        let mut sum = std::collections::BTreeMap::<usize, T>::new();
        match self {
            Self::Dofs(forces) | Self::Shares(forces) => {
                let shared = matches!(self, Self::Shares(_));
                for &(dof, f) in forces {
                    if dof >= whole {
                        let what = format!("unknowns of '{}' in load '{name}'", host.model.name());
                        return Err(Error::SizeMismatch {
                            what,
                            expected: whole,
                            found: dof + 1,
                        });
                    }
                    if let Some(dof) = host.unknown(dof) {
                        *sum.entry(dof).or_default() += if shared { f } else { f * weigh(dof) };
                    }
                }
            }
            Self::Facets(facets) => {
                // The weight at the centre of the facet, where the traction is sampled as well.
                for (facet, traction) in facets {
                    let w = gamma.value(&facet.centre);
                    for (node, share) in facet.nodes.iter().zip(&facet.shares) {
                        for c in 0..layout.components {
                            if let Some(dof) = host.unknown(node * layout.components + c) {
                                *sum.entry(dof).or_default() += traction[c] * *share * w;
                            }
                        }
                    }
                }
            }
        }
        // Unknowns without a force would be visited in every step.
        Ok(sum.into_iter().filter(|(_, f)| *f != T::zero()).collect())
    }
}

impl<T: Real> EffectSpec<T> for Load<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let name = self.name;
        let terms = self.terms.into_iter().map(|(spread, time)| {
            Ok(Term {
                forces: spread.weighted(&name, host)?,
                time,
                factor: T::zero(),
            })
        });
        let terms = terms.collect::<Result<_>>()?;
        Ok(Box::new(WeightedLoad { name, terms }))
    }
}

impl<T: Real> AnyEffect<T> for WeightedLoad<T> {
    fn name(&self) -> &str {
        &self.name
    }
}

impl<T: Real> Effect<T> for WeightedLoad<T> {
    fn add_forces(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        for term in &mut self.terms {
            term.factor = term.time.value(instant.time);
            // A load that is switched off costs nothing.
            if term.factor != T::zero() {
                term.forces.iter().for_each(|&(dof, a)| f[dof] += a * term.factor);
            }
        }
        Ok(())
    }

    fn is_dead(&self) -> bool {
        true
    }

    fn add_power(&self, _: &DofLayout, v: &[T], sum: &mut Exact) -> bool {
        for term in self.acting() {
            let powers = term.forces.iter().map(|&(dof, a)| a * v[dof] * term.factor);
            powers.for_each(|x| sum.add(x.as_f64()));
        }
        true
    }

    fn power(&self, v: &[T]) -> T {
        let power = |t: &Term<T>| t.forces.iter().fold(T::zero(), |s, &(dof, a)| s + a * v[dof]) * t.factor;
        self.acting().map(power).sum()
    }
}

impl<T: Real> WeightedLoad<T> {
    /// Terms that acted in the last step.
    fn acting(&self) -> impl Iterator<Item = &Term<T>> {
        self.terms.iter().filter(|t| t.factor != T::zero())
    }
}

//! Checks that mediators fill the overlap, and counts the nodes that multipliers act on.

use super::partition::{Filling, ROUND_OFF, SHARE, numbers};
use crate::extent::Extent;
use crate::interface::{Draft, Interface, InterfaceSpec, coupled_nodes};
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result};
use nalgebra::Point3;

/// Mediator, the places of its two models in the group, and measures of the overlap inside and outside of it.
pub(super) struct Tie<'a, T: Real> {
    pub(super) name: &'a str,
    pub(super) number: usize,
    pub(super) sides: [usize; 2],
    pub(super) extent: Extent<'a, T>,
    /// Element size `h_B` of the mediator \[m\]. The elements at its border hold points up to half of this
    /// outside.
    pub(super) spacing: T,
    pub(super) overlap: T,
    /// Measure where only the one or the other model is present and weight is missing.
    pub(super) only: [T; 2],
    pub(super) outside: T,
    /// A point of the overlap outside of the mediator.
    pub(super) outside_point: Point3<T>,
    /// Volumes that particles and the other model fill of the overlap.
    pub(super) filling: Filling<T>,
    pub(super) deep: T,
    pub(super) deep_point: Point3<T>,
}

impl<'a, T: Real> Tie<'a, T> {
    pub(super) fn new(number: usize, spec: &'a InterfaceSpec<T>, sides: [usize; 2], rough: bool) -> Self {
        Self {
            name: &spec.name,
            number,
            sides,
            extent: Extent::of_cells(&*spec.mediator, None),
            spacing: spec.mediator.spacing(),
            overlap: T::zero(),
            only: [T::zero(); 2],
            outside: T::zero(),
            outside_point: Point3::origin(),
            filling: Filling::new(rough),
            deep: T::zero(),
            deep_point: Point3::origin(),
        }
    }
}

/// Returns the share of the overlap outside of a mediator; refuses an overlap that reaches too far beyond it.
pub(super) fn outside_of<T: Real>(t: &Tie<'_, T>) -> Result<f64> {
    if t.overlap <= T::zero() {
        return Ok(0.0);
    }
    let share = |x: T| (x / t.overlap).as_f64();
    // Only points farther than half an element count: nearer ones still feel the border elements.
    if share(t.deep) > SHARE {
        return Err(Error::UncoveredOverlap {
            interface: t.name.to_owned(),
            outside: share(t.outside),
            point: numbers(&t.deep_point),
            limit: SHARE,
        });
    }
    Ok(share(t.outside))
}

/// Largest entry of a multiplier on a sleeping node, relative to the measure of the multiplier: round-off.
const ASLEEP: f64 = 1e-12;

/// Refuses multipliers on nodes that sleep: a node without mass cannot follow the other model. Sums over
/// particles leave out those that sleep at the border of the mediator (`interface::sums`): their entries are
/// exactly zero, so that this limit need not know how small a mass is that counts as none.
pub(super) fn refuse_asleep<T: Real>(draft: &Draft<T>, subdomains: &[Subdomain<T>]) -> Result<()> {
    for (m, s) in draft.interface.sides.iter().enumerate() {
        let s = &subdomains[*s];
        if !s.has_sleep() {
            continue;
        }
        let (node, share) = draft.largest_share(m, &|node| s.is_asleep(node));
        if share > T::of(ASLEEP) {
            return Err(Error::ZeroMass {
                model: s.model().name().to_owned(),
                node,
                point: numbers(&s.model().nodes()[node]),
                mass: 0.0,
            });
        }
    }
    Ok(())
}

/// Returns the shares of the coarse and of the fine model's nodes in the overlap on which multipliers act: by
/// volume for particles, by number otherwise.
pub(super) fn tied_shares<T: Real>(interface: &Interface<T>, subdomains: &[Subdomain<T>]) -> [f64; 2] {
    [0, 1].map(|m| {
        let [s, partner] = [m, 1 - m].map(|m| &subdomains[interface.sides[m]]);
        let coupled = coupled_nodes(&interface.coupling[m], interface.components());
        let particles = s.model().views().particles;
        let (mut held, mut total) = (0.0, 0.0);
        for (k, x) in s.model().nodes().iter().enumerate() {
            // Both weights must be shared, as a model may share other places with other partners.
            let inside = [s, partner].into_iter().all(|s| {
                let w = s.weights().kinetic.value(x).as_f64();
                w > ROUND_OFF && w < 1.0 - ROUND_OFF
            });
            if !inside {
                continue;
            }
            let size = particles.map_or(1.0, |p| p[k].measure.as_f64());
            total += size;
            if coupled.binary_search(&k).is_ok() {
                held += size;
            }
        }
        if total > 0.0 { held / total } else { 1.0 }
    })
}

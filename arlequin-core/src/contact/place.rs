//! A place on a facet: its motion is that of the linear facet, and a force at it goes to the facet's nodes
//! with the same weights.

use super::End;
use crate::effect::Instant;
use nalgebra::Vector3;

/// Nodes of a facet and their weights.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Place {
    pub(super) nodes: [u32; 3],
    pub(super) weights: [f64; 3],
}

impl Place {
    /// The place of a node.
    pub(super) fn node(node: u32) -> Self {
        Self {
            nodes: [node; 3],
            weights: [1.0, 0.0, 0.0],
        }
    }

    /// Iterates over the nodes with their weights.
    pub(super) fn nodes(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let pairs = self.nodes.iter().zip(self.weights);
        pairs.filter(|(_, w)| *w > 0.0).map(|(n, w)| (*n as usize, w))
    }

    /// Interpolates a nodal field of three components.
    pub(super) fn value(&self, x: &[f64]) -> Vector3<f64> {
        self.nodes().fold(Vector3::zeros(), |sum, (n, w)| {
            sum + Vector3::new(x[3 * n], x[3 * n + 1], x[3 * n + 2]) * w
        })
    }

    /// Sum of a nodal quantity times the squared weights: the inverse mass of the place from those of nodes.
    pub(super) fn squared(&self, quantity: impl Fn(usize) -> f64) -> f64 {
        self.nodes().map(|(n, w)| w * w * quantity(n)).sum()
    }

    /// Mean of a nodal quantity.
    pub(super) fn mean(&self, quantity: impl Fn(usize) -> f64) -> f64 {
        self.nodes().map(|(n, w)| w * quantity(n)).sum()
    }

    /// Velocities of the place during the step, under the forces `f` of others and the `own` forces of the
    /// effect so far.
    pub(super) fn end(&self, instant: &Instant<'_, f64>, inverse: &[f64], f: &[f64], own: &[f64]) -> End {
        let mut out = End::default();
        for (n, w) in self.nodes() {
            for c in 0..3 {
                let o = 3 * n + c;
                // As for particles: half of the kick leads to the instant, all of it to half a step later.
                let kick = instant.dt * inverse[o];
                out.middle[c] += w * (instant.v_half[o] + kick * (0.5 * f[o] + own[o]));
                out.after[c] += w * (instant.v_half[o] + kick * (f[o] + own[o]));
                out.inverse_inertia[c] += w * w * inverse[o];
            }
        }
        out
    }

    /// Adds a force at the place to nodal forces.
    pub(super) fn add(&self, force: &Vector3<f64>, f: &mut [f64]) {
        for (n, w) in self.nodes() {
            for c in 0..3 {
                f[3 * n + c] += w * force[c];
            }
        }
    }
}

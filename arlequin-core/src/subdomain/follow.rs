//! Check that the energy of a model scales with its weight.

use super::Subdomain;
use crate::conformance::fixed_noise;
use crate::geometry::bounds_of;
use crate::weight::{Uniform, Weighting};
use crate::{Error, Real, Result};

/// Largest accepted deviation from 0.5 of the ratio of energies with weights of one half and one.
const HALF: f64 = 1e-3;
/// Trial displacements, relative to the distance of nodes, and trial rotations \[rad\].
const AMPLITUDE: f64 = 1e-3;

impl<T: Real> Subdomain<T> {
    /// Refuses a model whose internal energy with a weight of one half is not half of that with one. The
    /// weight must be set again afterwards. External solvers are not checked: only they know their energy.
    pub(super) fn check_energy(&mut self) -> Result<()> {
        // A model whose weights are one everywhere need not follow them.
        let weighted = |s: &Self| {
            let w = &s.weights.internal;
            s.model.nodes().iter().any(|x| w.value(x) != T::one())
        };
        if self.is_external()
            || self.owned().is_part()
            || self.weights.weighting == Weighting::Nodal
            || !weighted(self)
        {
            return Ok(());
        }
        let q = self.trial_displacements();
        let mut energy = |weight: f64| -> Result<f64> {
            self.model.set_internal_weight(&Uniform(T::of(weight)))?;
            Ok(self.model.internal_energy(&q).as_f64())
        };
        let (whole, half) = (energy(1.0)?, energy(0.5)?);
        let ratio = half / whole;
        // A zero energy has nothing to weight. An energy that is not a number is another fault, which the run
        // reports.
        if !ratio.is_finite() || (ratio - 0.5).abs() <= HALF {
            return Ok(());
        }
        Err(Error::UnweightedEnergy {
            model: self.model.name().to_owned(),
            ratio,
            limit: HALF,
        })
    }

    /// Returns displacements of all nodes in all directions, small beside the distance of nodes.
    fn trial_displacements(&self) -> Vec<T> {
        let nodes = self.model.nodes();
        let [low, high] = bounds_of(nodes.iter());
        let sides = (high - low).map(Real::as_f64);
        let wide: Vec<f64> = sides
            .iter()
            .copied()
            .filter(|s| *s > 1e-9 * sides.amax())
            .collect();
        // Sides without extent are left out, so that spacing is right for planes and lines too.
        let per_node = wide.iter().product::<f64>() / nodes.len().max(1) as f64;
        let spacing = per_node.powf(1.0 / wide.len().max(1) as f64);
        let layout = self.model.layout();
        let amplitude = |i: usize| {
            if i < layout.translations() {
                AMPLITUDE * spacing
            } else {
                AMPLITUDE
            }
        };
        (0..layout.dofs())
            .map(|i| fixed_noise::<T>(i) * T::of(amplitude(i)))
            .collect()
    }
}

//! Weights of bonds and particles.

use super::DemModel;
use arlequin_core::Weight;
use arlequin_core::geometry::Cell;
use rayon::prelude::*;

/// A weight `1 - sum` may be negative by this much through round-off.
const ROUND_OFF: f64 = 1e-9;

impl DemModel {
    /// Returns the mean of a weight over each bond, from centre to centre.
    pub(super) fn bond_means(&self, weight: &dyn Weight<f64>) -> arlequin_core::Result<Vec<f64>> {
        let mean = |&[i, j]: &[u32; 2]| {
            let w = weight.mean(&Cell::Segment {
                ends: [i, j].map(|k| self.body.positions()[k as usize].into()),
                section: 1.0,
            });
            if w < 0.0 && w > -ROUND_OFF { 0.0 } else { w }
        };
        let means: Vec<f64> = self.body.pairs().par_iter().map(mean).collect();
        arlequin_core::check_finite("bond weights", &means)?;
        Ok(means)
    }

    /// Returns the mean of the bond weights of each particle. A particle without bonds gets the weight at its
    /// centre.
    pub(super) fn particle_means(&self, weight: &dyn Weight<f64>) -> arlequin_core::Result<Vec<f64>> {
        let alone = |i: usize| weight.value(&self.nodes[i]).max(0.0);
        Ok(self.body.mean_over_bonds(&self.bond_means(weight)?, alone))
    }
}

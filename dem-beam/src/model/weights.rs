//! Weights of bonds and particles.

use super::DemModel;
use arlequin_core::geometry::Cell;
use arlequin_core::{Changed, Weight, check_size};
use rayon::prelude::*;

/// A weight `1 - sum` may be negative by this much through round-off.
const ROUND_OFF: f64 = 1e-9;

impl DemModel {
    /// Returns the mean of a weight over each bond, from centre to centre. With `changed`, bonds elsewhere
    /// keep the weights that they have.
    pub(super) fn bond_means(
        &self,
        weight: &dyn Weight<f64>,
        changed: Option<&Changed<f64>>,
    ) -> arlequin_core::Result<Vec<f64>> {
        let mean = |(b, &[i, j]): (usize, &[u32; 2])| {
            let bond = Cell::Segment {
                ends: [i, j].map(|k| self.body.positions()[k as usize].into()),
                section: 1.0,
            };
            if changed.is_some_and(|changed| !changed(&bond.bounds())) {
                return self.body.weight(b);
            }
            let w = weight.mean(&bond);
            if w < 0.0 && w > -ROUND_OFF { 0.0 } else { w }
        };
        let bonds = self.body.pairs().par_iter().enumerate();
        let means: Vec<f64> = bonds.map(mean).collect();
        arlequin_core::check_finite("bond weights", &means)?;
        Ok(means)
    }

    /// Gives the bonds their weights.
    pub(super) fn weigh(&mut self, bonds: &[f64]) -> arlequin_core::Result<()> {
        self.body.set_weights(bonds).map_err(|e| self.named_error(&e))?;
        self.spare_overlap();
        self.kernel.renew();
        Ok(())
    }

    /// Writes the inertia of each particle for the weights that `bonds` returns: a particle has the mean of
    /// its bonds, and one without bonds the weight at its centre.
    pub(super) fn lump(
        &self,
        (weight, bonds): (&dyn Weight<f64>, impl Fn(usize) -> f64),
        out: &mut [f64],
    ) -> arlequin_core::Result<()> {
        check_size(self, "inertia", out.len())?;
        let alone = |i: usize| weight.value(&self.centres()[i]).max(0.0);
        let means = self.body.mean_over_bonds(bonds, alone);
        let (linear, angular) = out.split_at_mut(3 * self.centres().len());
        for (i, w) in means.iter().enumerate().take(self.centres().len()) {
            linear[3 * i..3 * i + 3].fill(w * self.mass[i]);
            angular[3 * i..3 * i + 3].fill(w * self.inertia[i]);
        }
        Ok(())
    }
}

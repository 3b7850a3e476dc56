//! What contact between two models needs to know of either.

use super::neighbours;
use crate::model::DemModel;
use crate::packing::cells::{Sphere, spheres};
use arlequin_core::Model;

/// The spheres of a model at rest with their masses: outlives the model's move into a run.
#[derive(Debug, Clone)]
pub struct ContactBody {
    pub(super) name: String,
    pub(super) spheres: Vec<Sphere>,
    /// Unweighted masses \[kg\].
    pub(super) mass: Vec<f64>,
}

impl ContactBody {
    /// Of a model.
    #[must_use]
    pub fn of(model: &DemModel) -> Self {
        Self {
            name: model.name().to_owned(),
            spheres: spheres(model.body().positions(), model.body().radii()),
            mass: model.masses().to_vec(),
        }
    }

    /// Name of the model.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Pairs of particles of this and another model, displaced by `q` \[m\], that overlap by more than
    /// `tolerance` of the sum of their radii beyond rest: how many, and the largest overlap over that sum;
    /// `None` if there are none.
    #[must_use]
    pub fn overlaps(&self, other: &Self, q: [&[f64]; 2], tolerance: f64) -> Option<(usize, f64)> {
        neighbours::overlaps_between([&self.spheres, &other.spheres], q, tolerance)
    }
}

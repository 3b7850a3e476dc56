//! Data of a model that contact with another model needs.

use super::neighbours;
use crate::model::DemModel;
use crate::packing::cells::{Sphere, spheres};
use arlequin_core::Model;
use arlequin_core::contact::Exterior;

/// The spheres of a model at rest with their masses: remains available when the model has moved into a run.
#[derive(Debug, Clone)]
pub struct ContactBody {
    pub(super) name: String,
    pub(super) spheres: Vec<Sphere>,
    /// Unweighted masses \[kg\].
    pub(super) mass: Vec<f64>,
}

impl ContactBody {
    /// Copies the spheres and masses of a model.
    #[must_use]
    pub fn from_model(model: &DemModel) -> Self {
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

    /// The spheres, for contact with the surface of another model.
    #[must_use]
    pub fn exterior(&self) -> Exterior {
        Exterior::spheres(&self.name, &self.spheres)
    }

    /// Counts pairs of a particle of this and one of another model, displaced by `q` \[m\], that overlap
    /// beyond rest by more than `tolerance` times the sum of their radii.
    ///
    /// Returns the number of pairs and the largest overlap over the sum of radii, or `None` if there are no
    /// pairs.
    #[must_use]
    pub fn overlaps(&self, other: &Self, q: [&[f64]; 2], tolerance: f64) -> Option<(usize, f64)> {
        neighbours::overlaps_between([&self.spheres, &other.spheres], q, tolerance)
    }
}

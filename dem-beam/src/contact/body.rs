//! Data of a model that contact with another model needs.

use super::neighbours;
use crate::model::DemModel;
use crate::packing::cells::Sphere;
use arlequin_core::contact::Exterior;
use arlequin_core::{Interpolation, Model, ParticleField};
use std::sync::{Arc, OnceLock};

/// Spheres of a model at rest for all contacts of the model, made when the first one asks for them: most
/// models have none.
#[derive(Debug, Clone)]
pub(crate) struct RestSpheres {
    centres: Arc<ParticleField<f64>>,
    radii: Arc<Vec<f64>>,
    spheres: Arc<OnceLock<Arc<Vec<Sphere>>>>,
}

impl RestSpheres {
    pub(crate) fn new(centres: Arc<ParticleField<f64>>, radii: Arc<Vec<f64>>) -> Self {
        Self {
            centres,
            radii,
            spheres: Arc::default(),
        }
    }

    pub(crate) fn get(&self) -> Arc<Vec<Sphere>> {
        let build = || {
            let spheres = self.centres.nodes().iter().zip(&*self.radii);
            Arc::new(spheres.map(|(x, r)| [x.x, x.y, x.z, *r]).collect())
        };
        self.spheres.get_or_init(build).clone()
    }
}

/// The spheres of a model at rest with their masses: remains available when the model has moved into a run.
#[derive(Debug, Clone)]
pub struct ContactBody {
    pub(super) name: String,
    pub(super) spheres: RestSpheres,
    /// Unweighted masses \[kg\].
    pub(super) mass: Arc<Vec<f64>>,
}

impl ContactBody {
    /// Takes the spheres and masses of a model; all bodies of a model share them.
    #[must_use]
    pub fn from_model(model: &DemModel) -> Self {
        Self {
            name: model.name().to_owned(),
            spheres: model.shared_spheres(),
            mass: model.shared_masses(),
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
        Exterior::spheres(&self.name, &self.spheres.get())
    }

    /// Counts pairs of a particle of this and one of another model, displaced by `q` \[m\], that overlap
    /// beyond rest by more than `tolerance` times the sum of their radii.
    ///
    /// Returns the number of pairs and the largest overlap over the sum of radii, or `None` if there are no
    /// pairs.
    #[must_use]
    pub fn overlaps(&self, other: &Self, q: [&[f64]; 2], tolerance: f64) -> Option<(usize, f64)> {
        neighbours::overlaps_between([&self.spheres.get(), &other.spheres.get()], q, tolerance)
    }
}

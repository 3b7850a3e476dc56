//! A model with the data that supports, loads, interfaces and output need.

use super::mesh::Grid;
use crate::error::Result;
use crate::setup::BodyShape;
use crate::setup::packing::PackingLine;
use crate::setup::skin::Skin;
use arlequin::core::contact::SharedBody;
use arlequin::core::effect::{self, SurfaceFacet};
use arlequin::core::{Interpolation, Materials, Model, Participant};
use arlequin::dem_beam::ContactBody;
use arlequin::dem_beam::fracture::SharedLog;
use arlequin::fem_ref::Elastic;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

/// Rigid bodies that one model touches, by the number of the effect.
pub(crate) type RigidBodies = BTreeMap<usize, SharedBody>;

/// A model with the data that supports, loads and output need.
pub struct Body {
    /// The model.
    pub model: Box<dyn Model<f64>>,
    /// The external solver behind the model, for a link.
    pub solver: Option<Box<dyn Participant<f64>>>,
    /// Displacement field of the model.
    pub field: Arc<dyn Interpolation<f64>>,
    /// Mesh for output.
    pub grid: Arc<Grid>,
    /// Nodes of the named groups.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// Facets of the named surfaces.
    pub surfaces: BTreeMap<String, Vec<SurfaceFacet<f64>>>,
    /// All facets of the surface, for models that have one.
    pub boundary: Vec<SurfaceFacet<f64>>,
    /// Mean distance between nodes or particles \[m\].
    pub spacing: f64,
    /// Main material; volumes of a mesh file can have others. `None` for a link, which does not report it.
    pub material: Option<Elastic<f64>>,
    /// Materials of the elements; `None` for a link.
    pub materials: Option<Materials<f64>>,
    /// Shape of the body.
    pub shape: BodyShape,
    /// Data that only particles have.
    pub grains: Option<Grains>,
    /// Warnings for the user, without the name of the model.
    pub warnings: Vec<String>,
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Body of {}", self.model.name())
    }
}

/// Data of a body of particles besides its model.
pub struct Grains {
    /// Contact and obstacles, by the number of the effect in the scene.
    pub effects: BTreeMap<usize, Box<dyn effect::EffectSpec<f64>>>,
    /// Log of broken bonds, if fracture is on.
    pub breaks: Option<SharedLog>,
    /// True if the scene has a fracture effect on the model, enabled or not.
    pub brittle: bool,
    /// Data for contact with other models.
    pub body: ContactBody,
    /// Properties of the packing.
    pub packing: PackingLine,
    /// Number of probes that have been placed at points of this model.
    pub(super) points: AtomicUsize,
    /// Surface that carries tractions and pressures.
    pub(super) skin: Skin,
}

impl std::fmt::Debug for Grains {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Grains of {} with effects {:?}",
            self.body.name(),
            self.effects.keys()
        )
    }
}

/// Main material of a body.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn material<'a>(path: &str, body: &'a Body) -> Result<&'a Elastic<f64>> {
    body.material.as_ref().ok_or_else(|| {
        let name = body.model.name();
        let rule =
            format!("needs the material of model '{name}', which is a link and does not tell it; remove it");
        crate::error::key(path, rule)
    })
}

/// Largest wave speed over all materials of a body \[m/s\]; the function maps a material to its speed.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn fastest(path: &str, body: &Body, speed: impl Fn(&Elastic<f64>) -> f64) -> Result<f64> {
    let main = speed(material(path, body)?);
    let materials = body.materials.iter().flat_map(Materials::all);
    Ok(materials.map(speed).fold(main, f64::max))
}

/// Speed of bar waves at each node \[m/s\]: the highest of the elements around the node.
///
/// # Errors
/// A link, which does not report its material.
pub(super) fn bar_speeds(path: &str, body: &Body) -> Result<Vec<f64>> {
    let main = material(path, body)?.bar_speed();
    let Some(materials) = body.materials.as_ref().filter(|m| m.elements().is_some()) else {
        return Ok(vec![main; body.model.nodes().len()]);
    };
    let mut out = vec![0.0_f64; body.model.nodes().len()];
    for (e, corners) in body.grid.connectivity.chunks_exact(body.grid.corners).enumerate() {
        let speed = materials.at(e).bar_speed();
        for k in corners {
            out[*k as usize] = out[*k as usize].max(speed);
        }
    }
    Ok(out)
}

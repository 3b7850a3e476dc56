//! Kinds of models: the rules of a kind's table, its body, and the uses that it refuses.

use super::body::Body;
use super::body::RigidBodies;
use super::clock::SetupClock;
use super::mesh::{self, Elements};
use super::zone::Supports;
use crate::error::Result;
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::{Effect, Load};
use std::path::Path;

/// Input that a kind checks, and builds a body from.
#[derive(Clone, Copy)]
pub(crate) struct Order<'a> {
    /// Name of the model.
    pub name: &'a str,
    /// Key path of the table.
    pub key: &'a str,
    /// Table of the model.
    pub table: &'a LoweredModel,
    /// Folder to which paths in the table are relative.
    pub folder: &'a Path,
    /// Effects on the model, with their numbers in the scene.
    pub effects: &'a [(usize, &'a Effect)],
    /// Rigid bodies that the model touches; `None` where nothing is built.
    pub rigid: Option<&'a RigidBodies>,
    /// Supports of the model, with their numbers in the scene.
    pub supports: Supports<'a>,
}

/// A use of a model that some kinds refuse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Feature {
    /// The key `crack`.
    Crack,
    /// The key `materials`.
    Volumes,
    /// The coarse side of an interface.
    CoarseSide,
    /// The model of a zone.
    Zone,
    /// A partition among ranks.
    Partition,
    /// The body of a zone that follows: elements sleep where the zone is.
    Sleep,
}

/// Refusal of kinds that cannot be partitioned.
pub(crate) const WHOLE: &str = "only bodies of particles, of finite and of natural elements go in parts";

/// A kind of model.
pub(crate) trait Kind: Sync {
    /// Name in a scene.
    fn name(&self) -> &'static str;

    /// Meaning, for the schema and the reference.
    fn meaning(&self) -> &'static str;

    /// Checks the keys of the table before anything is meshed or packed.
    ///
    /// # Errors
    /// The key, its value, the limit and the remedy.
    fn check(&self, order: &Order<'_>) -> Result<()>;

    /// Builds the body.
    ///
    /// # Errors
    /// See [`Self::check`]; errors of meshes, packings and models.
    fn build(&self, order: &Order<'_>, clock: &mut SetupClock<'_>) -> Result<Body>;

    /// Checks the model together with the other tables of its scene.
    ///
    /// # Errors
    /// The key and the remedy.
    fn check_in(&self, _scene: &LoweredScene, _order: &Order<'_>) -> Result<()> {
        Ok(())
    }

    /// Elements in which a strain can be read; `None` if the model has no such elements.
    fn elements(&self) -> Option<Elements> {
        None
    }

    /// Returns whether the model is a packing of spheres.
    fn has_spheres(&self) -> bool {
        false
    }

    /// Returns whether the model lives in another process, which alone knows its shape and material.
    fn is_remote(&self) -> bool {
        false
    }

    /// Returns whether the forces are linear, so that the implicit scheme can solve for them.
    fn is_linear(&self) -> bool {
        self.elements().is_some()
    }

    /// Reason for which the kind refuses a use of the model; `None` if it allows that use.
    fn refusal(&self, _feature: Feature) -> Option<&'static str> {
        None
    }

    /// Returns whether the model can carry a load; one without a surface cannot carry tractions.
    fn carries(&self, _load: &Load) -> bool {
        true
    }

    /// Names of the groups of a shape; `None` if they are known only after the body is built.
    fn groups(&self, shape: &BodyShape) -> Option<&'static [&'static str]> {
        mesh::groups(shape)
    }

    /// Share of element-wise strains in the strains of the model \[–\].
    fn element_share(&self, _table: &LoweredModel) -> f64 {
        1.0
    }
}

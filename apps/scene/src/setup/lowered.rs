//! A scene as set-up reads it: `[body]` and `[zone.NAME]` are models and interfaces as well, and each model
//! says where its shape comes from.

use super::zone::Piece;
use crate::error::{Result, key};
use crate::spec::{Interface, Material, ModelTable, OverlapShape, SceneSpec, Shape};

/// Tables of a scene with the models and interfaces of its body and zones.
pub type LoweredScene = SceneSpec<LoweredModel, LoweredInterface>;

/// Table of a model, given in the scene or derived from the body and a zone.
pub type LoweredModel = ModelTable<BodyShape>;

/// Table of an interface, given in the scene or derived from a zone.
pub type LoweredInterface = Interface<OverlapSource>;

/// Source of the shape of a model.
#[derive(Debug, Clone)]
pub enum BodyShape {
    /// The scene gives the shape.
    Given(Shape),
    /// The model has the part of the body that `[body]` and `[zone.NAME]` leave to it.
    Piece(Piece),
    /// The model has the spheres among which a zone that follows goes: `follow.within`.
    Reservoir(Piece),
    /// Only the program behind a link knows the shape.
    Remote,
}

impl BodyShape {
    /// Returns the shape if the scene gives it.
    pub fn in_scene(&self) -> Option<&Shape> {
        match self {
            Self::Given(shape) => Some(shape),
            Self::Piece(_) | Self::Reservoir(_) | Self::Remote => None,
        }
    }

    /// Returns the name for messages: the key of a given shape.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Given(shape) => shape.name(),
            Self::Piece(_) | Self::Reservoir(_) => "a part of the body",
            Self::Remote => "that of a link",
        }
    }

    /// Returns whether the model is a line.
    pub(crate) fn is_line(&self) -> bool {
        matches!(self, Self::Given(Shape::Bar { .. }))
    }

    /// Returns whether the shape is that of a file.
    pub(crate) fn is_file(&self) -> bool {
        matches!(self, Self::Given(Shape::File(_)))
    }
}

/// Source of the overlap of an interface.
#[derive(Debug, Clone)]
pub enum OverlapSource {
    /// The scene gives the overlap.
    Given(OverlapShape),
    /// The overlap is the layer of the body's elements around a zone.
    Zone(Piece),
}

impl<S> ModelTable<S> {
    /// Returns the material, which all kinds but links need; `path` is the key of the table.
    ///
    /// # Errors
    /// A table without material.
    pub(crate) fn known_material(&self, path: &str) -> Result<&Material> {
        let material = self.material.as_ref();
        material.ok_or_else(|| key(path, "missing field `material`"))
    }
}

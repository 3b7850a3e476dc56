//! The kinds of models. A kind is one file of this folder and its lines here; keys of its own, if it has any,
//! are a table of [`ModelTable`](crate::spec::ModelTable).

mod chain;
mod cnem;
mod dem;
mod fem;
mod link;

pub(crate) use link::link_of;

use super::body::Body;
use super::clock::SetupClock;
use super::kind::{Feature, Kind, Order};
use super::materials::elastic;
use super::slit;
use super::time;
use crate::error::{Result, key};
use crate::setup::BodyShape;
use crate::spec::ModelKind;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserialize, Deserializer, Error as _};
use serde_json::json;
use std::borrow::Cow;
use std::sync::LazyLock;

/// All kinds, in the order of the reference.
const KINDS: [&dyn Kind; 5] = [&fem::Fem, &cnem::Cnem, &dem::Dem, &chain::Chain, &link::Link];

/// Returns what a kind of model can do.
pub(crate) fn kind(kind: ModelKind) -> &'static dyn Kind {
    KINDS[kind.0]
}

impl ModelKind {
    /// Returns the kind that packs spheres.
    pub(crate) fn spheres() -> Self {
        let place = KINDS.iter().position(|k| k.has_spheres());
        Self(place.unwrap_or_default())
    }
}

impl<'de> Deserialize<'de> for ModelKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        static NAMES: LazyLock<[&str; KINDS.len()]> = LazyLock::new(|| KINDS.map(Kind::name));
        let name = String::deserialize(deserializer)?;
        let place = NAMES.iter().position(|n| *n == name);
        place
            .map(Self)
            .ok_or_else(|| D::Error::unknown_variant(&name, &*NAMES))
    }
}

impl JsonSchema for ModelKind {
    fn schema_name() -> Cow<'static, str> {
        "ModelKind".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let choice =
            |k: &dyn Kind| json!({ "type": "string", "const": k.name(), "description": k.meaning() });
        json_schema!({
            "oneOf": KINDS.map(choice),
            "description": "Kinds of models, by their names in a scene.",
        })
    }
}

/// Checks what can be checked before anything is meshed or packed.
pub(super) fn check(order: &Order<'_>) -> Result<()> {
    let Order { name, key, table, .. } = *order;
    let kind = kind(table.kind);
    if !kind.is_remote() {
        link::check_keys(key, table)?;
    }
    slit::check(key, table, kind.refusal(Feature::Crack))?;
    if !kind.is_remote() {
        elastic(key, table.known_material(key)?)?;
    }
    kind.check(order)?;
    volumes(order)?;
    time::check_own(name, table, kind.is_linear())
}

/// Builds the body of a model.
pub(super) fn build(order: &Order<'_>, clock: &mut SetupClock<'_>) -> Result<Body> {
    clock.begin(format!("model '{}'", order.name));
    kind(order.table.kind).build(order, clock)
}

/// Refuses materials for volumes if the kind cannot have them or the shape has no volumes.
fn volumes(order: &Order<'_>) -> Result<()> {
    let filed = match &order.table.shape {
        BodyShape::Piece(piece) | BodyShape::Reservoir(piece) => piece.is_of_file(),
        shape => shape.is_file(),
    };
    let rule = match (
        order.table.materials.is_empty(),
        kind(order.table.kind).refusal(Feature::Volumes),
    ) {
        (true, _) => return Ok(()),
        (false, Some(rule)) => rule,
        (false, None) if filed => return Ok(()),
        (false, None) => "only a mesh file tells volumes apart; give one material",
    };
    Err(key(format!("{}.materials", order.key), rule))
}

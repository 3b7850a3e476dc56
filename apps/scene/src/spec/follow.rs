//! `zone.NAME.follow`: a zone that goes where it is needed.

use super::body::ZoneShape;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use std::borrow::Cow;

/// Where a zone may go, and when it grows. Spheres fill this region once; those outside of the zone and its
/// overlap sleep.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct FollowTable {
    /// Region that is filled with spheres. The zone's own elements stay inside of it by the width of the
    /// overlap. Default: the whole body.
    pub within: Option<ZoneShape>,
    /// Load of a bond over its strength \[–\], in the displacements of the body, at which the element
    /// around it joins the zone.
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0))]
    pub wake: f64,
    /// Number of the body's elements that stay between the overlap and any bond that breaks or is loaded
    /// above 0.8 of its strength.
    #[schemars(range(min = 1))]
    pub margin: usize,
    /// Steps of the run between two looks. Default: the time in which a wave crosses an element of the body.
    #[schemars(range(min = 1))]
    pub every: Option<usize>,
    /// Load of a bond over its strength \[–\] below which an element goes back to the body, if this lasts as
    /// long as a wave needs to cross half of the zone, and no bond in it or within `margin` elements has
    /// broken. Elements of `shape` stay. Without it, the zone only grows.
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0))]
    pub release: Option<f64>,
    /// Ends the run if an element woke too late: a bond would have broken before; and if the body is loaded
    /// beyond the strength of spheres outside of `within`. Otherwise the run warns.
    pub strict: bool,
}

impl Default for FollowTable {
    fn default() -> Self {
        Self {
            within: None,
            wake: 0.4,
            margin: 3,
            every: None,
            release: None,
            strict: false,
        }
    }
}

/// `true`, `false` or a table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Follow(pub Option<FollowTable>);

impl<'de> Deserialize<'de> for Follow {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Choice;
        impl<'de> Visitor<'de> for Choice {
            type Value = Follow;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("true, false or { within, wake, margin, every, release, strict }")
            }

            fn visit_bool<E>(self, on: bool) -> Result<Follow, E> {
                Ok(Follow(on.then(FollowTable::default)))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Follow, A::Error> {
                FollowTable::deserialize(MapAccessDeserializer::new(map)).map(|t| Follow(Some(t)))
            }
        }
        deserializer.deserialize_any(Choice)
    }
}

impl JsonSchema for Follow {
    fn schema_name() -> Cow<'static, str> {
        "Follow".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<FollowTable>();
        json_schema!({ "oneOf": [{ "type": "boolean" }, table] })
    }
}

//! `[wake]`: a model that sleeps until the one that stands in for it is strained enough.

use super::choice::choice;
use super::schema;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[wake]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wake {
    /// The model that sleeps, of any kind.
    pub model: String,
    /// The model that carries its region until then, `fem` or `cnem`.
    pub by: String,
    /// Assignments, as those of `--set`, that make the sleeping scene: `by` must cover the whole body, and
    /// what acts on `model` must act on `by` (`"support.0.model=block"`).
    #[serde(default)]
    pub asleep: Vec<String>,
    /// What wakes it.
    pub criterion: WakeCriterion,
    /// Where element centres are looked at. Default: all of `by`.
    pub near: Option<Near>,
    /// Steps between two looks.
    #[serde(default = "ten")]
    pub every: usize,
}

fn ten() -> usize {
    10
}

/// Exactly one of the two.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("strain stress"))]
pub struct WakeCriterion {
    /// Largest principal strain of `by` at its element centres, tension positive \[–\].
    pub strain: Option<f64>,
    /// Largest principal stress, likewise \[Pa\].
    pub stress: Option<f64>,
}

/// A part of space.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
pub enum Near {
    /// A closed box along the axes.
    Box {
        /// Lowest corner \[m\].
        low: [f64; 3],
        /// Highest corner \[m\].
        high: [f64; 3],
    },
}

choice!(Near, "{ box = { low, high } }");

//! `[wake]`: a model that sleeps until the strain or stress of the model in its place reaches a limit.

use super::choice::choice;
use super::schema;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[wake]`: a model that sleeps at first, and the model in its place.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Wake {
    /// Name of the model that sleeps, of any kind.
    pub model: String,
    /// Name of the model that fills the region until then, `fem` or `cnem`.
    pub by: String,
    /// Assignments, written as for `--set`, that turn the scene into the sleeping scene: `by` must cover the
    /// whole body, and loads and supports of `model` must act on `by` (`"support.0.model=block"`).
    #[serde(default)]
    pub asleep: Vec<String>,
    /// Limit at which the model wakes.
    pub criterion: WakeCriterion,
    /// Region in which element centres are checked. Default: all of `by`.
    pub near: Option<Near>,
    /// Steps between two checks.
    #[serde(default = "ten_steps")]
    #[schemars(range(min = 1))]
    pub every: usize,
}

fn ten_steps() -> usize {
    10
}

/// Limit at which the model wakes; exactly one of `strain` and `stress`.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("strain stress"))]
#[non_exhaustive]
pub struct WakeCriterion {
    /// Largest principal strain of `by` at its element centres, tension positive \[–\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub strain: Option<f64>,
    /// Largest principal stress of `by` at its element centres, tension positive \[Pa\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub stress: Option<f64>,
}

/// A region.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self", rename_all = "snake_case")]
#[non_exhaustive]
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

//! `[wake]`: a model that sleeps until the one that stands in for it is strained enough.

use super::choice::choice;
use serde::Deserialize;

/// `[wake]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wake {
    /// The model that sleeps.
    pub model: String,
    /// The model that carries its region until then.
    pub by: String,
    /// Assignments, as those of `--set`, that make the sleeping scene.
    #[serde(default)]
    pub asleep: Vec<String>,
    /// What wakes it.
    pub criterion: WakeCriterion,
    /// Where it is looked at; all of the carrier by default.
    pub near: Option<Near>,
    /// Steps between two looks.
    #[serde(default = "ten")]
    pub every: usize,
}

fn ten() -> usize {
    10
}

/// Exactly one of the two.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WakeCriterion {
    /// Largest principal strain, tension positive \[–\].
    pub strain: Option<f64>,
    /// Largest principal stress, tension positive \[Pa\].
    pub stress: Option<f64>,
}

/// A part of space.
#[derive(Debug, Clone, Copy, Deserialize)]
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

//! `[static]`: equilibria instead of a run in time.

use super::schema;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[static]`: the scene at rest in successive load steps, instead of `[time]`. Loads and motions have the
/// values of the load step's time. Linear models under forces that depend on time alone are solved directly;
/// everything else (contact, bonds that break, large rotations) is relaxed.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("times file steps"))]
#[non_exhaustive]
pub struct Static {
    /// Times of the load steps \[s\], rising; exactly one of `times`, `file` and `steps`.
    #[schemars(length(min = 1))]
    pub times: Option<Vec<f64>>,
    /// File with comma-separated values whose first column has the times; a first row of words is taken as
    /// headings.
    pub file: Option<String>,
    /// Number of equal load steps up to `end`.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub steps: Option<usize>,
    /// Time of the last load step, for `steps` \[s\].
    #[serde(default = "one_second")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub end: f64,
    /// Relative residual at which relaxation ends: largest unbalanced force over the largest internal force
    /// since the load step before; the unbalanced forces of a model must also sum up to less than ten times
    /// this share of its loads and reactions.
    #[serde(default = "tolerance")]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub tolerance: f64,
    /// Largest number of relaxation steps in a load step.
    #[serde(default = "iterations")]
    #[schemars(range(min = 1))]
    pub iterations: usize,
    /// Relaxation steps over which supports and loads move to their values of the load step. More steps are
    /// gentler to bonds that can break.
    #[serde(default = "ramp")]
    pub ramp: usize,
}

impl Default for Static {
    fn default() -> Self {
        Self {
            times: None,
            file: None,
            steps: None,
            end: one_second(),
            tolerance: tolerance(),
            iterations: iterations(),
            ramp: ramp(),
        }
    }
}

fn one_second() -> f64 {
    1.0
}

fn tolerance() -> f64 {
    1e-6
}

fn iterations() -> usize {
    200_000
}

fn ramp() -> usize {
    500
}

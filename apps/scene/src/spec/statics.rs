//! `[static]`: equilibria in place of a run in time.

use super::schema;
use schemars::JsonSchema;
use serde::Deserialize;

/// `[static]`: the scene at rest, load step after load step, in place of `[time]`. Loads and motions are
/// taken at the time of the load step. Models that are linear, under forces that depend on time alone, are
/// solved directly; whatever else there is (contact, bonds that break, large rotations) is relaxed.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("times file steps"))]
pub struct Static {
    /// Times of the load steps \[s\], rising; exactly one of `times`, `file` and `steps`.
    pub times: Option<Vec<f64>>,
    /// File with comma-separated values whose first column has the times; a first row of words is a headline.
    pub file: Option<String>,
    /// Number of equal load steps up to `end`.
    pub steps: Option<usize>,
    /// Time of the last of the `steps` \[s\].
    #[serde(default = "one")]
    pub end: f64,
    /// Residual of relaxation that counts as equilibrium: largest unbalanced force over the largest
    /// internal force since the load step before.
    #[serde(default = "tolerance")]
    pub tolerance: f64,
    /// Most steps of relaxation in a load step.
    #[serde(default = "iterations")]
    pub iterations: usize,
    /// Steps of relaxation over which supports and loads go to those of the load step. More are gentler to
    /// bonds that can break.
    #[serde(default = "ramp")]
    pub ramp: usize,
}

fn one() -> f64 {
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

//! The sweep file: what its TOML says, before it is turned into runs. `docs/sweep.md` is its reference.

use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A sweep file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SweepFile {
    /// One line for the report.
    pub title: Option<String>,
    /// Base scene, relative to the sweep file.
    pub scene: PathBuf,
    /// Assignments for every run of the base scene.
    #[serde(default)]
    pub set: Vec<String>,
    /// How the axes are combined.
    #[serde(default)]
    pub design: Design,
    /// How often each run is made; the least time counts.
    #[serde(default = "one")]
    pub repeat: usize,
    /// Worker threads of every run.
    pub threads: Option<usize>,
    /// Errors \[–\] the conclusion speaks of.
    #[serde(default = "targets")]
    pub targets: Vec<f64>,
    /// Which error decides.
    #[serde(default)]
    pub judge: Judge,
    /// Which time decides.
    #[serde(default)]
    pub cost: Cost,
    /// What is varied.
    #[serde(default)]
    pub axis: BTreeMap<String, Axis>,
    /// Further runs beside the varied ones.
    #[serde(default)]
    pub run: BTreeMap<String, NamedRun>,
    /// What runs are held against.
    pub reference: Option<Reference>,
    /// Where errors are taken.
    #[serde(default)]
    pub errors: Window,
    /// Energy that comes back through probes.
    #[serde(default)]
    pub reflected: BTreeMap<String, Reflected>,
    /// Scalars of every run that are compared with the reference's.
    #[serde(default)]
    pub measure: BTreeMap<String, Measure>,
    /// Whether `suggest` foretells error and time of every varied run.
    #[serde(default)]
    pub suggest: bool,
    /// The axis whose error and time are drawn over its value.
    pub hook: Option<Hook>,
}

fn one() -> usize {
    1
}

fn targets() -> Vec<f64> {
    vec![0.05, 0.02, 0.01]
}

/// How axes are combined.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Design {
    /// Every value of every axis with every value of all others.
    #[default]
    Product,
    /// The base values, and each axis varied alone.
    OneAtATime,
}

/// Which error decides.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Judge {
    /// Of displacements.
    Displacement,
    /// Of velocities.
    Velocity,
    /// The larger of the two: velocities forgive less.
    #[default]
    Both,
}

impl Judge {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Displacement => "displacement error",
            Self::Velocity => "velocity error",
            Self::Both => "larger of displacement and velocity error",
        }
    }
}

/// Which time decides.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cost {
    /// Set-up and stepping: what a user waits for, output apart.
    #[default]
    Total,
    /// Stepping alone: what counts in long runs.
    Stepping,
}

impl Cost {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Total => "set-up and stepping",
            Self::Stepping => "stepping",
        }
    }
}

/// `[axis.NAME]`: values put into assignments, or named levels.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Values; a list among them fills `{0}`, `{1}`, …
    #[serde(default)]
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
    /// Assignments with `{}` for the value.
    #[serde(default)]
    pub set: Vec<String>,
    /// Named lists of assignments, in place of values.
    #[serde(default)]
    pub levels: Vec<Level>,
    /// Value or name of the level that others are varied about; the first by default.
    #[schemars(with = "Option<serde_json::Value>")]
    pub base: Option<toml::Value>,
}

/// A named level of an axis.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// Name.
    pub name: String,
    /// Assignments; none leaves the scene as it is.
    #[serde(default)]
    pub set: Vec<String>,
}

/// What a named run is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, serde::Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// The fine model everywhere.
    AllFine,
    /// The coarse model everywhere.
    AllCoarse,
}

/// `[run.NAME]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedRun {
    /// Its scene; the base scene (with its assignments) by default.
    pub scene: Option<PathBuf>,
    /// Values, one run each, named `NAME=VALUE`.
    #[serde(default)]
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
    /// Assignments.
    #[serde(default)]
    pub set: Vec<String>,
    /// What it is.
    pub mark: Option<Mark>,
}

/// What runs are held against.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Reference {
    /// Label of a run.
    Run(String),
    /// A curve for each probe.
    Curves(BTreeMap<String, CurveTable>),
}

/// A reference curve of one probe.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum CurveTable {
    /// Columns of a file with comma-separated values.
    Csv {
        /// File, relative to the sweep file.
        file: PathBuf,
        /// Header of the column of times \[s\].
        time: String,
        /// Header of the column of values.
        value: String,
    },
    /// `A cos²(π (at − centre − speed t)/width)` within its width, or its time derivative for a velocity
    /// probe.
    Wave {
        /// Where \[m\].
        at: f64,
        /// Centre at time zero \[m\].
        centre: f64,
        /// Width \[m\].
        width: f64,
        /// Amplitude \[m\].
        amplitude: f64,
        /// Speed \[m/s\].
        speed: f64,
    },
    /// Bar clamped at 0 whose other end is pulled from t = 0 on.
    BarStep {
        /// Where \[m\].
        at: f64,
        /// Length of the bar \[m\].
        length: f64,
        /// Wave speed \[m/s\].
        speed: f64,
        /// Velocity behind the first front, `F/(ρ c S)` \[m/s\].
        particle_speed: f64,
    },
}

/// Where errors are taken.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Window {
    /// Start \[s\].
    pub from: Option<f64>,
    /// End \[s\].
    pub to: Option<f64>,
    /// Names of probes; all that both have by default.
    pub probes: Option<Vec<String>>,
}

/// `[reflected.NAME]`: what comes back through a probe relative to what went in.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reflected {
    /// Probe.
    pub probe: String,
    /// End of the incident signal \[s\].
    pub after: f64,
    /// End of what comes back \[s\]; the end of the run by default.
    pub until: Option<f64>,
    /// Whether what the reference shows there is taken off first.
    #[serde(default)]
    pub minus_reference: bool,
}

/// `[measure.NAME]`: a number of `summary.json`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measure {
    /// JSON pointer to it, such as `/probes/tip/max`.
    pub pointer: Option<String>,
    /// Name of a fact of an effect, such as `broken bonds`; summed over the effects that have it.
    pub fact: Option<String>,
    /// What it is multiplied with.
    #[serde(default = "unit_factor")]
    pub factor: f64,
    /// Unit of the product.
    #[serde(default)]
    pub unit: String,
}

fn unit_factor() -> f64 {
    1.0
}

/// `[hook]`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hook {
    /// Axis with positive numbers.
    pub axis: String,
    /// Name and unit of the axis in the picture.
    pub name: Option<String>,
    /// Value at which theory expects the least time.
    pub expected: Option<f64>,
}

//! The sweep file as read from TOML, before it is turned into runs. `docs/sweep.md` is its reference.

use crate::spec::schema;
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
    /// Combination of the axes.
    #[serde(default)]
    pub design: Design,
    /// Number of times that each run is made; the shortest time counts.
    #[serde(default = "single_run")]
    #[schemars(range(min = 1))]
    pub repeat: usize,
    /// Worker threads of every run.
    #[schemars(range(min = 1))]
    pub threads: Option<usize>,
    /// Errors \[–\] for which the conclusion names the cheapest run.
    #[serde(default = "targets")]
    #[schemars(extend("items" = { "type": "number", "exclusiveMinimum": 0 }))]
    pub targets: Vec<f64>,
    /// Error by which runs are compared.
    #[serde(default)]
    pub judge: Judge,
    /// Time by which runs are compared.
    #[serde(default)]
    pub cost: Cost,
    /// Settings that are varied, by name.
    #[serde(default)]
    pub axis: BTreeMap<String, Axis>,
    /// Named runs besides those along the axes.
    #[serde(default)]
    pub run: BTreeMap<String, NamedRun>,
    /// Results with which runs are compared.
    pub reference: Option<Reference>,
    /// Times and probes for the errors.
    #[serde(default)]
    pub errors: Window,
    /// Energy that is reflected past probes.
    #[serde(default)]
    pub reflected: BTreeMap<String, Reflected>,
    /// Scalars of every run that are compared with those of the reference.
    #[serde(default)]
    pub measure: BTreeMap<String, Measure>,
    /// True to let `suggest` predict error and time of every run along the axes.
    #[serde(default)]
    pub suggest: bool,
    /// Axis over which error and time are plotted.
    pub hook: Option<Hook>,
}

fn single_run() -> usize {
    1
}

fn targets() -> Vec<f64> {
    vec![0.05, 0.02, 0.01]
}

/// Combinations of the axes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Design {
    /// Combines every value of every axis with every value of all others.
    #[default]
    Product,
    /// Varies one axis at a time; all others keep their base values.
    OneAtATime,
}

/// Errors by which runs can be compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Judge {
    /// Displacement error.
    Displacement,
    /// Velocity error.
    Velocity,
    /// The larger of the two; the velocity error is the stricter measure.
    #[default]
    Both,
}

impl Judge {
    /// Returns the name in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Displacement => "displacement error",
            Self::Velocity => "velocity error",
            Self::Both => "larger of displacement and velocity error",
        }
    }
}

/// Times by which runs can be compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cost {
    /// Set-up, steps and output: the time that a user waits.
    #[default]
    Total,
    /// Stepping only, which dominates long runs.
    Stepping,
}

impl Cost {
    /// Returns the name in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Total => "set-up, steps and output",
            Self::Stepping => "stepping",
        }
    }
}

/// `[axis.NAME]`: values put into assignments, or named levels.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("values levels"))]
#[schemars(extend("dependencies" = { "values": ["set"] }))]
pub struct Axis {
    /// Values; the entries of a value that is a list fill `{0}`, `{1}`, …
    #[serde(default)]
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
    /// Assignments with `{}` for the value.
    #[serde(default)]
    pub set: Vec<String>,
    /// Named lists of assignments, instead of values.
    #[serde(default)]
    pub levels: Vec<Level>,
    /// Value, or name of the level, that this axis has while others are varied; the first by default.
    #[schemars(with = "Option<serde_json::Value>")]
    pub base: Option<toml::Value>,
}

/// A named level of an axis.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// Name.
    pub name: String,
    /// Assignments; an empty list leaves the scene as it is.
    #[serde(default)]
    pub set: Vec<String>,
}

/// Role of a named run in the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, serde::Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// The fine model everywhere.
    AllFine,
    /// The coarse model everywhere.
    AllCoarse,
}

/// `[run.NAME]`: a run, or one per value, besides those along the axes.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedRun {
    /// Scene; by default the base scene with its assignments.
    pub scene: Option<PathBuf>,
    /// Values, one run each, named `NAME=VALUE`.
    #[serde(default)]
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
    /// Assignments.
    #[serde(default)]
    pub set: Vec<String>,
    /// All-fine or all-coarse.
    pub mark: Option<Mark>,
}

/// Results with which runs are compared.
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
        /// Position \[m\].
        at: f64,
        /// Centre at time zero \[m\].
        centre: f64,
        /// Width \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        width: f64,
        /// Amplitude \[m\].
        amplitude: f64,
        /// Speed \[m/s\].
        speed: f64,
    },
    /// Bar clamped at 0 whose other end is pulled from t = 0 on.
    BarStep {
        /// Position \[m\].
        at: f64,
        /// Length of the bar \[m\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        length: f64,
        /// Wave speed \[m/s\].
        #[schemars(extend("exclusiveMinimum" = 0))]
        speed: f64,
        /// Velocity behind the first front, `F/(ρ c S)` \[m/s\].
        particle_speed: f64,
    },
}

/// Times and probes for the errors.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Window {
    /// Start \[s\].
    pub from: Option<f64>,
    /// End \[s\].
    pub to: Option<f64>,
    /// Names of probes; by default all that both runs have.
    pub probes: Option<Vec<String>>,
}

/// `[reflected.NAME]`: reflected over incident energy at a probe.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reflected {
    /// Name of the probe.
    pub probe: String,
    /// End of the incident signal \[s\].
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub after: f64,
    /// End of the reflected signal \[s\]; the end of the run by default.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub until: Option<f64>,
    /// True to subtract the reference from the reflected signal first.
    #[serde(default)]
    pub minus_reference: bool,
}

/// `[measure.NAME]`: a number of `summary.json`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = schema::exactly_one("pointer fact"))]
pub struct Measure {
    /// JSON pointer to the number, such as `/probes/tip/max`.
    #[schemars(extend("pattern" = "^/"))]
    pub pointer: Option<String>,
    /// Name of a fact of an effect, such as `broken bonds`; summed over the effects that have it.
    pub fact: Option<String>,
    /// Factor on the number.
    #[serde(default = "unit_factor")]
    #[schemars(extend("not" = { "const": 0 }))]
    pub factor: f64,
    /// Unit of the product.
    #[serde(default)]
    pub unit: String,
}

impl Default for Measure {
    fn default() -> Self {
        Self {
            pointer: None,
            fact: None,
            factor: unit_factor(),
            unit: String::new(),
        }
    }
}

fn unit_factor() -> f64 {
    1.0
}

/// `[hook]`: a plot of error and time over the value of an axis.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hook {
    /// Name of an axis whose values are positive numbers.
    pub axis: String,
    /// Name and unit of the axis in the plot.
    pub name: Option<String>,
    /// Value at which theory predicts the shortest time.
    pub expected: Option<f64>,
}

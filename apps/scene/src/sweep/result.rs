//! What is known of every run, and what follows from all of them.

use super::conclude;
use super::curve::{self, Curve, Errors, Probes};
use super::plan::Member;
use super::spec::{Cost, Hook, Judge, Mark, Measure, Reference, SweepFile};
use crate::error::{Result, write};
use crate::output::json;
use crate::suggest::Prediction;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// One entry of `runs` in `sweep.json`.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Run {
    /// Name, also of its folder in `runs/`.
    pub label: String,
    /// All-fine, all-coarse, or neither.
    pub mark: Option<Mark>,
    /// Whether it is one of the varied runs.
    pub swept: bool,
    /// "complete", "failed" or "missing".
    pub status: &'static str,
    /// Whether it was taken from an earlier call.
    pub reused: bool,
    /// What went wrong.
    pub error: Option<String>,
    /// Values by axis, as text.
    pub parameters: BTreeMap<String, String>,
    /// Assignments.
    pub set: Vec<String>,
    /// Unknowns of all models.
    pub unknowns: Option<u64>,
    /// Steps made.
    pub steps: Option<u64>,
    /// Step \[s\].
    pub dt: Option<f64>,
    /// Wall time.
    pub seconds: Seconds,
    /// Peak of the process's memory, where the system tells.
    pub peak_bytes: Option<u64>,
    /// Relative errors.
    pub errors: Errors,
    /// The error that decides \[–\].
    pub error_judged: Option<f64>,
    /// The time that decides \[s\].
    pub cost: Option<f64>,
    /// Energy that came back over energy that went in \[–\].
    pub reflected_energy: BTreeMap<String, f64>,
    /// Scalars of the sweep file by name.
    pub measures: BTreeMap<String, Measured>,
    /// What `suggest` predicted.
    pub predicted: Option<Prediction>,
    /// Largest unexplained drift of the invariant \[–\].
    pub h_drift: Option<f64>,
    /// Largest condition number of the interfaces.
    pub condition: Option<f64>,
    /// Whether no other run is both faster and more accurate.
    pub pareto: bool,
}

/// A scalar of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Measured {
    /// Its value, in the unit of the sweep file; none if the run has no such number.
    pub value: Option<f64>,
    /// Relative deviation from the reference run's \[–\].
    pub deviation: Option<f64>,
}

/// The number a measure asks for.
fn measured(summary: &Value, m: &Measure) -> Option<f64> {
    let found = match (&m.pointer, &m.fact) {
        (Some(p), _) => summary.pointer(p).and_then(Value::as_f64),
        (_, Some(f)) => {
            let effects = summary["effect_ledger"].as_array().into_iter().flatten();
            effects
                .filter_map(|e| e["facts"][f].as_f64())
                .reduce(|a, b| a + b)
        }
        _ => None,
    };
    found.map(|x| x * m.factor)
}

/// Wall times of a run \[s\].
#[derive(Debug, Clone, Default, Serialize)]
pub struct Seconds {
    /// Reading, meshing, factoring.
    pub setup: Option<f64>,
    /// Steps.
    pub stepping: Option<f64>,
    /// Probes, frames.
    pub output: Option<f64>,
    /// One step, by phase.
    pub per_step: BTreeMap<String, f64>,
}

impl Run {
    /// What is known before the run.
    pub fn planned(m: &Member) -> Self {
        Self {
            label: m.label.clone(),
            mark: m.mark,
            swept: m.swept,
            status: "missing",
            parameters: m.parameters.clone(),
            set: m.set.clone(),
            ..Self::default()
        }
    }

    /// Takes what its summary says.
    pub fn take(&mut self, summary: &Value, m: &Member, file: &SweepFile) {
        let scalar = |(name, m): (&String, &Measure)| {
            let value = measured(summary, m);
            let deviation = None;
            (name.clone(), Measured { value, deviation })
        };
        self.measures = file.measure.iter().map(scalar).collect();
        let number = |p: &str| summary.pointer(p).and_then(Value::as_f64);
        let list = |p: &str| summary.pointer(p).and_then(Value::as_array).cloned();
        self.status = "complete";
        let models = list("/models").unwrap_or_default();
        self.unknowns = Some(models.iter().filter_map(|m| m["unknowns"].as_u64()).sum());
        self.steps = summary["steps"].as_u64();
        self.dt = number("/dt");
        self.peak_bytes = summary["peak_bytes"].as_u64();
        self.h_drift = number("/energy/h_drift_max");
        self.condition = list("/interface")
            .unwrap_or_default()
            .iter()
            .filter_map(|i| i["condition"].as_f64())
            .reduce(f64::max);
        self.seconds.setup = number("/wall_seconds/setup");
        self.seconds.stepping = number("/wall_seconds/stepping");
        self.seconds.output = number("/wall_seconds/output");
        let steps = self.steps.unwrap_or(0).max(1) as f64;
        let phases = summary.pointer("/wall_seconds/phases").and_then(Value::as_object);
        for (name, seconds) in phases.into_iter().flatten() {
            let share = seconds.as_f64().unwrap_or_default() / steps;
            *self.seconds.per_step.entry(phase(name, m)).or_default() += share;
        }
    }

    /// Takes errors and what comes back.
    pub fn compare(&mut self, probes: &Probes, reference: &BTreeMap<String, Curve>, file: &SweepFile) {
        self.errors = curve::errors(probes, reference, &file.errors);
        let back = |(name, t): (&String, _)| Some((name.clone(), curve::reflected(probes, reference, t)?));
        self.reflected_energy = file.reflected.iter().filter_map(back).collect();
        let Errors {
            displacement,
            velocity,
            ..
        } = self.errors;
        self.error_judged = match file.judge {
            Judge::Displacement => displacement,
            Judge::Velocity => velocity,
            // The larger of what there is: `None` is below every number.
            Judge::Both => [displacement, velocity].into_iter().flatten().reduce(f64::max),
        };
        self.cost = match (file.cost, self.seconds.setup, self.seconds.stepping) {
            (Cost::Total, Some(a), Some(b)) => Some(a + b),
            (Cost::Stepping, _, b) => b,
            _ => None,
        };
    }

    /// Time and error, if both are known.
    pub fn point(&self) -> Option<[f64; 2]> {
        Some([self.cost?, self.error_judged?])
    }

    /// Time of all steps spent in a phase \[s\].
    pub fn phase_seconds(&self, name: &str) -> Option<f64> {
        Some(self.seconds.per_step.get(name)? * self.steps? as f64)
    }
}

/// Phases of a step as the report names them.
pub const PHASES: [&str; 7] = [
    "forces fine",
    "forces coarse",
    "forces",
    "interface",
    "effects",
    "ledger",
    "output",
];

/// Name in the report of a phase of a summary.
fn phase(name: &str, m: &Member) -> String {
    let (head, model) = name.split_once('/').unwrap_or((name, ""));
    match head {
        "predict" => match m.roles.get(model).copied().flatten() {
            Some(role) if m.mark.is_none() => format!("forces {role}"),
            _ => "forces".to_owned(),
        },
        "effect" | "effects" => "effects".to_owned(),
        "observe" => "output".to_owned(),
        _ => head.to_owned(),
    }
}

/// Holds the scalars of all runs against those of the reference run, which is the first.
pub(super) fn compare_measures(runs: &mut [Run]) {
    let reference = runs.first().map(|r| r.measures.clone()).unwrap_or_default();
    for (name, m) in runs.iter_mut().flat_map(|r| &mut r.measures) {
        let base = reference
            .get(name)
            .and_then(|b| b.value)
            .filter(|b| b.abs() > 0.0);
        m.deviation = m.value.zip(base).map(|(x, b)| (x - b) / b.abs());
    }
}

/// Marks the runs that no other beats in both time and error.
pub(super) fn mark_pareto(runs: &mut [Run]) {
    let points: Vec<Option<[f64; 2]>> = runs.iter().map(Run::point).collect();
    for (k, r) in runs.iter_mut().enumerate() {
        r.pareto = points[k].is_some_and(|p| {
            let beaten = |q: &[f64; 2]| q[0] <= p[0] && q[1] <= p[1] && (q[0] < p[0] || q[1] < p[1]);
            p[1] > 0.0 && !points.iter().flatten().filter(|q| q[1] > 0.0).any(beaten)
        });
    }
}

/// Least time the fine model alone takes in a coupled run \[s\]: what no choice of the coarse side goes
/// below.
pub(super) fn floor(runs: &[Run]) -> Option<f64> {
    let coupled = runs.iter().filter(|r| r.mark.is_none());
    let fine = coupled.filter_map(|r| r.phase_seconds("forces fine"));
    fine.reduce(f64::min)
}

/// `sweep.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Sweep {
    /// Headline.
    pub title: String,
    /// "complete", "failed" if any run did, or "interrupted".
    pub status: &'static str,
    /// Version of this program.
    pub version: &'static str,
    /// Which error decides.
    pub judge: &'static str,
    /// Which time decides.
    pub cost: &'static str,
    /// What runs were held against.
    pub reference: Option<String>,
    /// Units of the scalars by name; empty ones left out.
    pub units: BTreeMap<String, String>,
    /// Runs of each member, of which the least time was taken.
    pub repeat: usize,
    /// Axes.
    pub axes: Vec<String>,
    /// Time of the fine model alone \[s\].
    pub floor_seconds: Option<f64>,
    /// In plain words.
    pub conclusion: Vec<String>,
    /// Runs.
    pub runs: Vec<Run>,
}

impl Sweep {
    /// Writes `sweep.json` into a folder; returns its text.
    ///
    /// # Errors
    /// [`crate::Error::Write`].
    pub fn write(&self, folder: &Path) -> Result<String> {
        let (path, text) = (folder.join("sweep.json"), json("writing the sweep", self)?);
        std::fs::write(&path, &text).map_err(write(&path))?;
        Ok(text)
    }

    /// Gathers what the runs gave.
    pub(super) fn new(file: &SweepFile, runs: Vec<Run>, status: &'static str) -> Self {
        let reference = file.reference.as_ref().map(|r| match r {
            Reference::Run(name) => format!("run {name}"),
            Reference::Curves(c) => {
                let names: Vec<&str> = c.keys().map(String::as_str).collect();
                format!("curves of {}", names.join(", "))
            }
        });
        let title = file.title.clone();
        Self {
            title: title.unwrap_or_else(|| "Accuracy against time".into()),
            status,
            version: env!("CARGO_PKG_VERSION"),
            judge: file.judge.words(),
            cost: file.cost.words(),
            reference,
            repeat: file.repeat,
            axes: file.axis.keys().cloned().collect(),
            units: file
                .measure
                .iter()
                .filter(|(_, m)| !m.unit.is_empty())
                .map(|(n, m)| (n.clone(), m.unit.clone()))
                .collect(),
            floor_seconds: floor(&runs),
            conclusion: conclude::words(&runs, file),
            runs,
        }
    }
}

/// One row of the hook: value, errors, time, time of the fine model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HookRow {
    /// Value of the axis.
    pub value: f64,
    /// Of displacements \[–\].
    pub displacement: Option<f64>,
    /// Of velocities \[–\].
    pub velocity: Option<f64>,
    /// Time that decides \[s\].
    pub cost: f64,
    /// Time of the fine model \[s\].
    pub fine: Option<f64>,
}

/// The runs along the hook's axis, others at the values of the first of them, by rising value.
pub fn hook_rows(runs: &[Run], hook: &Hook) -> Vec<HookRow> {
    let others = |r: &Run| {
        let mut p = r.parameters.clone();
        p.remove(&hook.axis);
        p
    };
    let swept = || runs.iter().filter(|r| r.swept && r.cost.is_some());
    let Some(first) = swept().next().map(others) else {
        return Vec::new();
    };
    let row = |r: &Run| {
        Some(HookRow {
            value: r.parameters.get(&hook.axis)?.parse().ok().filter(|v| *v > 0.0)?,
            displacement: r.errors.displacement,
            velocity: r.errors.velocity,
            cost: r.cost?,
            fine: r.phase_seconds("forces fine"),
        })
    };
    let mut rows: Vec<HookRow> = swept().filter(|r| others(r) == first).filter_map(row).collect();
    rows.sort_by(|a, b| a.value.total_cmp(&b.value));
    rows
}

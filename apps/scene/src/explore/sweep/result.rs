//! Results of the runs of a sweep, and their comparison.

use super::conclude;
use super::curve::{self, Curve, Errors, Probes};
use super::plan::Member;
use crate::error::{Result, write};
use crate::explore::suggest::Prediction;
use crate::output::json;
use crate::spec::sweep::{Cost, Hook, Judge, Mark, Measure, Reference, SweepFile};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// One entry of `runs` in `sweep.json`.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Run {
    /// Name of the run and of its folder in `runs/`.
    pub label: String,
    /// All-fine, all-coarse, or neither.
    pub mark: Option<Mark>,
    /// True for a run along the axes.
    pub swept: bool,
    /// "complete", "failed" or "missing".
    pub status: &'static str,
    /// True if the result of an earlier call was reused.
    pub reused: bool,
    /// Error of a failed run.
    pub error: Option<String>,
    /// Values by axis, as text.
    pub parameters: BTreeMap<String, String>,
    /// Assignments.
    pub set: Vec<String>,
    /// Number of unknowns of all models.
    pub unknowns: Option<u64>,
    /// Steps made.
    pub steps: Option<u64>,
    /// Step \[s\].
    pub dt: Option<f64>,
    /// Wall time.
    pub seconds: Seconds,
    /// Peak memory of the process \[bytes\], if the system reports it.
    pub peak_bytes: Option<u64>,
    /// Relative errors.
    pub errors: Errors,
    /// Error by which runs are compared \[–\].
    pub error_judged: Option<f64>,
    /// Time by which runs are compared \[s\].
    pub cost: Option<f64>,
    /// Reflected over incident energy \[–\].
    pub reflected_energy: BTreeMap<String, f64>,
    /// Scalars of the sweep file by name.
    pub measures: BTreeMap<String, Measured>,
    /// Prediction of `suggest`.
    pub predicted: Option<Prediction>,
    /// Largest drift of the discrete invariant, relative to the energy in play \[–\].
    pub h_drift: Option<f64>,
    /// Largest condition number of the interfaces.
    pub condition: Option<f64>,
    /// True if no other run is both faster and more accurate.
    pub pareto: bool,
}

/// A scalar of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Measured {
    /// Value in the unit of the sweep file; `None` if the run has no such number.
    pub value: Option<f64>,
    /// Relative deviation from the value of the reference run \[–\].
    pub deviation: Option<f64>,
}

/// Returns the number that a measure names.
fn measured(summary: &Value, m: &Measure) -> Option<f64> {
    let number = match (&m.pointer, &m.fact) {
        (Some(p), _) => summary.pointer(p).and_then(Value::as_f64),
        (_, Some(f)) => {
            let effects = summary["effect_ledger"].as_array().into_iter().flatten();
            effects
                .filter_map(|e| e["facts"][f].as_f64())
                .reduce(|a, b| a + b)
        }
        _ => None,
    };
    number.map(|x| x * m.factor)
}

/// Wall times of a run \[s\].
#[derive(Debug, Clone, Default, Serialize)]
pub struct Seconds {
    /// The whole run: set-up, steps and output.
    pub total: Option<f64>,
    /// Reading, meshing, factoring.
    pub setup: Option<f64>,
    /// All steps.
    pub stepping: Option<f64>,
    /// Probes, frames.
    pub output: Option<f64>,
    /// One step, by phase.
    pub per_step: BTreeMap<String, f64>,
}

impl Run {
    /// Creates the entry of a run that has not been made.
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

    /// Takes the results from the summary of the run.
    pub fn take(&mut self, summary: &Value, m: &Member, file: &SweepFile) {
        let scalar = |(name, m): (&String, &Measure)| {
            let value = measured(summary, m);
            // `compare_measures` sets it, once the reference is known.
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
        self.seconds.total = number("/wall_seconds/total");
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

    /// Computes errors, reflected energies and cost.
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
            // The larger of the known errors.
            Judge::Both => [displacement, velocity].into_iter().flatten().reduce(f64::max),
        };
        self.cost = match file.cost {
            Cost::Total => self.seconds.total,
            Cost::Stepping => self.seconds.stepping,
        };
    }

    /// Returns time and error if both are known.
    pub fn point(&self) -> Option<[f64; 2]> {
        Some([self.cost?, self.error_judged?])
    }

    /// Time of all steps spent in a phase \[s\].
    pub fn phase_seconds(&self, name: &str) -> Option<f64> {
        Some(self.seconds.per_step.get(name)? * self.steps? as f64)
    }
}

/// Phases of a step by their names in the report.
pub const PHASES: [&str; 7] = [
    "forces fine",
    "forces coarse",
    "forces",
    "interface",
    "effects",
    "ledger",
    "output",
];

/// Returns the report's name of a phase of the summary.
fn phase(name: &str, m: &Member) -> String {
    let (head, model) = name.split_once('/').unwrap_or((name, ""));
    match head {
        "predict" => match m.roles.get(model).copied().flatten() {
            // In a run of one model alone, the role says nothing.
            Some(role) if m.mark.is_none() => format!("forces {role}"),
            _ => "forces".to_owned(),
        },
        "effect" | "effects" => "effects".to_owned(),
        "observe" => "output".to_owned(),
        _ => head.to_owned(),
    }
}

/// Compares the scalars of all runs with those of the reference run, which is the first.
pub(super) fn compare_measures(runs: &mut [Run]) {
    let reference = runs.first().map(|r| r.measures.clone()).unwrap_or_default();
    for (name, m) in runs.iter_mut().flat_map(|r| &mut r.measures) {
        // A deviation from zero has no scale.
        let base = reference
            .get(name)
            .and_then(|b| b.value)
            .filter(|b| b.abs() > 0.0);
        m.deviation = m.value.zip(base).map(|(x, b)| (x - b) / b.abs());
    }
}

/// Marks the runs that no other run beats in both time and error.
pub(super) fn mark_pareto(runs: &mut [Run]) {
    let points: Vec<Option<[f64; 2]>> = runs.iter().map(Run::point).collect();
    for (k, r) in runs.iter_mut().enumerate() {
        r.pareto = points[k].is_some_and(|p| {
            let beaten = |q: &[f64; 2]| q[0] <= p[0] && q[1] <= p[1] && (q[0] < p[0] || q[1] < p[1]);
            // The reference has no error and would beat every other run.
            p[1] > 0.0 && !points.iter().flatten().filter(|q| q[1] > 0.0).any(beaten)
        });
    }
}

/// Shortest time of the fine model in a coupled run \[s\].
pub(super) fn floor(runs: &[Run]) -> Option<f64> {
    let coupled = runs.iter().filter(|r| r.mark.is_none());
    let fine = coupled.filter_map(|r| r.phase_seconds("forces fine"));
    // No choice of the coarse model makes a run faster.
    fine.reduce(f64::min)
}

/// `sweep.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Sweep {
    /// Title of the report.
    pub title: String,
    /// "complete", "failed" if any run failed, or "interrupted".
    pub status: &'static str,
    /// Version of this program.
    pub version: &'static str,
    /// Name of the error by which runs are compared.
    pub judge: &'static str,
    /// Name of the time by which runs are compared.
    pub cost: &'static str,
    /// Name of the reference.
    pub reference: Option<String>,
    /// Units of the scalars, by name; only those that have a unit.
    pub units: BTreeMap<String, String>,
    /// Number of repetitions of each run, of which the shortest time counts.
    pub repeat: usize,
    /// Names of the axes.
    pub axes: Vec<String>,
    /// Shortest time of the fine model in a coupled run \[s\].
    pub floor_seconds: Option<f64>,
    /// Conclusion in plain sentences.
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

    /// Gathers the results of the runs.
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

/// One row of the plot over the hook's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HookRow {
    /// Value of the axis.
    pub value: f64,
    /// Error of the displacements \[–\].
    pub displacement: Option<f64>,
    /// Error of the velocities \[–\].
    pub velocity: Option<f64>,
    /// Time by which runs are compared \[s\].
    pub cost: f64,
    /// Time of the fine model \[s\].
    pub fine: Option<f64>,
}

/// Returns the runs along the hook's axis by increasing value. All other axes have the values of the first
/// run.
pub fn hook_rows(runs: &[Run], hook: &Hook) -> Vec<HookRow> {
    let other_axes = |r: &Run| {
        let mut p = r.parameters.clone();
        p.remove(&hook.axis);
        p
    };
    let swept = || runs.iter().filter(|r| r.swept && r.cost.is_some());
    let Some(first) = swept().next().map(other_axes) else {
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
    let mut rows: Vec<HookRow> = swept()
        .filter(|r| other_axes(r) == first)
        .filter_map(row)
        .collect();
    rows.sort_by(|a, b| a.value.total_cmp(&b.value));
    rows
}

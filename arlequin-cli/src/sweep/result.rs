//! What is known of every run, and what follows from all of them.

use super::curve::{self, Curve, Errors, Probes};
use super::plan::Member;
use super::spec::{Cost, Judge, Mark, Measure, SweepFile};
use crate::error::Result;
use crate::suggest::Foretold;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// One entry of `runs` in `sweep.json`.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Run {
    /// Name, also of its folder in `runs/`.
    pub(crate) label: String,
    /// All-fine, all-coarse, or neither.
    pub(crate) mark: Option<Mark>,
    /// Whether it is one of the varied runs.
    pub(crate) swept: bool,
    /// "complete", "failed" or "missing".
    pub(crate) status: &'static str,
    /// Whether it was taken from an earlier call.
    pub(crate) reused: bool,
    /// What went wrong.
    pub(crate) error: Option<String>,
    /// Values by axis, as text.
    pub(crate) parameters: BTreeMap<String, String>,
    /// Assignments.
    pub(crate) set: Vec<String>,
    /// Unknowns of all models.
    pub(crate) unknowns: Option<u64>,
    /// Steps made.
    pub(crate) steps: Option<u64>,
    /// Step \[s\].
    pub(crate) dt: Option<f64>,
    /// Wall time.
    pub(crate) seconds: Seconds,
    /// Peak of the process's memory, where the system tells.
    pub(crate) peak_bytes: Option<u64>,
    /// Relative errors.
    pub(crate) errors: Errors,
    /// The error that decides \[–\].
    pub(crate) error_judged: Option<f64>,
    /// The time that decides \[s\].
    pub(crate) cost: Option<f64>,
    /// Energy that came back over energy that went in \[–\].
    pub(crate) reflected_energy: BTreeMap<String, f64>,
    /// Scalars of the sweep file by name.
    pub(crate) measures: BTreeMap<String, Measured>,
    /// What `suggest` foretold.
    pub(crate) predicted: Option<Foretold>,
    /// Largest unexplained drift of the invariant \[–\].
    pub(crate) h_drift: Option<f64>,
    /// Largest condition number of the interfaces.
    pub(crate) condition: Option<f64>,
    /// Whether no other run is both faster and more accurate.
    pub(crate) pareto: bool,
}

/// A scalar of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Measured {
    /// Its value, in the unit of the sweep file; none if the run has no such number.
    pub(crate) value: Option<f64>,
    /// Relative deviation from the reference run's \[–\].
    pub(crate) deviation: Option<f64>,
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
pub(crate) struct Seconds {
    /// Reading, meshing, factoring.
    pub(crate) setup: Option<f64>,
    /// Steps.
    pub(crate) stepping: Option<f64>,
    /// Probes, frames.
    pub(crate) output: Option<f64>,
    /// One step, by phase.
    pub(crate) per_step: BTreeMap<String, f64>,
}

impl Run {
    /// What is known before the run.
    pub(crate) fn planned(m: &Member) -> Self {
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
    pub(crate) fn take(&mut self, summary: &Value, m: &Member, file: &SweepFile) {
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
    pub(crate) fn compare(&mut self, probes: &Probes, reference: &BTreeMap<String, Curve>, file: &SweepFile) {
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
    pub(crate) fn point(&self) -> Option<[f64; 2]> {
        Some([self.cost?, self.error_judged?])
    }

    /// Time of all steps spent in a phase \[s\].
    pub(crate) fn phase_seconds(&self, name: &str) -> Option<f64> {
        Some(self.seconds.per_step.get(name)? * self.steps? as f64)
    }
}

/// Phases of a step as the report names them.
pub(crate) const PHASES: [&str; 7] = [
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
pub(crate) fn compare_measures(runs: &mut [Run]) {
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
pub(crate) fn mark_pareto(runs: &mut [Run]) {
    let points: Vec<Option<[f64; 2]>> = runs.iter().map(Run::point).collect();
    for (k, r) in runs.iter_mut().enumerate() {
        r.pareto = points[k].is_some_and(|p| {
            let beaten = |q: &[f64; 2]| q[0] <= p[0] && q[1] <= p[1] && (q[0] < p[0] || q[1] < p[1]);
            p[1] > 0.0 && !points.iter().flatten().filter(|q| q[1] > 0.0).any(beaten)
        });
    }
}

/// Least time the fine model alone takes in a coupled run \[s\]: what no choice of the coarse side goes below.
pub(crate) fn floor(runs: &[Run]) -> Option<f64> {
    let coupled = runs.iter().filter(|r| r.mark.is_none());
    let fine = coupled.filter_map(|r| r.phase_seconds("forces fine"));
    fine.reduce(f64::min)
}

/// `sweep.json`.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Sweep {
    /// Headline.
    pub(crate) title: String,
    /// "complete", "failed" if any run did, or "interrupted".
    pub(crate) status: &'static str,
    /// Version of this program.
    pub(crate) version: &'static str,
    /// Which error decides.
    pub(crate) judge: &'static str,
    /// Which time decides.
    pub(crate) cost: &'static str,
    /// What runs were held against.
    pub(crate) reference: Option<String>,
    /// Units of the scalars by name; empty ones left out.
    pub(crate) units: BTreeMap<String, String>,
    /// Runs of each member, of which the least time was taken.
    pub(crate) repeat: usize,
    /// Axes.
    pub(crate) axes: Vec<String>,
    /// Time of the fine model alone \[s\].
    pub(crate) floor_seconds: Option<f64>,
    /// In plain words.
    pub(crate) conclusion: Vec<String>,
    /// Runs.
    pub(crate) runs: Vec<Run>,
}

/// Writes `sweep.csv`: one row per run.
pub(crate) fn csv(path: &Path, s: &Sweep) -> Result<()> {
    let mut parameters: Vec<&String> = s.runs.iter().flat_map(|r| r.parameters.keys()).collect();
    parameters.sort();
    parameters.dedup();
    let back: Vec<&String> = s
        .runs
        .iter()
        .find(|r| !r.reflected_energy.is_empty())
        .map(|r| r.reflected_energy.keys().collect())
        .unwrap_or_default();
    let mut head: Vec<String> = ["label", "mark", "status"].map(str::to_owned).into();
    head.extend(parameters.iter().map(|p| format!("parameter {p}")));
    let fixed = [
        "unknowns",
        "steps",
        "dt [s]",
        "set-up [s]",
        "stepping [s]",
        "output [s]",
    ];
    head.extend(fixed.map(str::to_owned));
    head.extend(PHASES.map(|p| format!("{p} per step [s]")));
    let fixed = ["peak [bytes]", "displacement error [-]", "velocity error [-]"];
    head.extend(fixed.map(str::to_owned));
    head.extend(back.iter().map(|b| format!("reflected energy {b} [-]")));
    let scalars: Vec<&String> = s
        .runs
        .first()
        .map_or_else(Vec::new, |r| r.measures.keys().collect());
    let units = |m: &&String| s.units.get(*m).map_or("-", String::as_str);
    head.extend(scalars.iter().map(|m| format!("{m} [{}]", units(m))));
    let foretold = s.runs.iter().any(|r| r.predicted.is_some());
    let fixed = [
        "predicted displacement error [-]",
        "predicted velocity error [-]",
        "predicted time [s]",
    ];
    head.extend(fixed.iter().filter(|_| foretold).map(|f| (*f).to_owned()));
    head.extend(["H drift [-]", "condition [-]", "pareto"].map(str::to_owned));
    let number = |x: Option<f64>| x.map(|x| format!("{x:e}")).unwrap_or_default();
    let count = |x: Option<u64>| x.map(|x| x.to_string()).unwrap_or_default();
    let mut text = head.join(",") + "\n";
    for r in &s.runs {
        let mark = match r.mark {
            Some(Mark::AllFine) => "all-fine",
            Some(Mark::AllCoarse) => "all-coarse",
            None => "",
        };
        let mut row = vec![quoted(&r.label), mark.into(), r.status.into()];
        let own = |p: &&String| quoted(r.parameters.get(*p).map_or("", String::as_str));
        row.extend(parameters.iter().map(own));
        row.extend([count(r.unknowns), count(r.steps), number(r.dt)]);
        row.extend([r.seconds.setup, r.seconds.stepping, r.seconds.output].map(number));
        row.extend(PHASES.map(|p| number(r.seconds.per_step.get(p).copied())));
        row.extend([
            count(r.peak_bytes),
            number(r.errors.displacement),
            number(r.errors.velocity),
        ]);
        row.extend(back.iter().map(|b| number(r.reflected_energy.get(*b).copied())));
        let scalar = |m: &&String| number(r.measures.get(*m).and_then(|m| m.value));
        row.extend(scalars.iter().map(scalar));
        if foretold {
            let p = r.predicted;
            row.extend(
                [
                    p.map(|p| p.displacement),
                    p.map(|p| p.velocity),
                    p.map(|p| p.seconds),
                ]
                .map(number),
            );
        }
        row.extend([number(r.h_drift), number(r.condition), r.pareto.to_string()]);
        text += &(row.join(",") + "\n");
    }
    std::fs::write(path, text).map_err(crate::error::write(path))
}

/// A cell that may contain commas.
fn quoted(text: &str) -> String {
    if text.contains([',', '"']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

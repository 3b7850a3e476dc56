//! Runs a scene as given and with each effect switched off, and reports what each effect changes and costs.
//!
//! Results are the same in every run, times are not. Each variant therefore runs several times, in turns, and
//! its shortest time counts.

use crate::error::{Error, Result, core, key, value};
use crate::run::PhaseClock;
use crate::scene::Scene;
use crate::setup::{self, Built, LoweredScene, Readings};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Number of instants at which the state is checked for missing effects.
const LOOKS: usize = 20;

/// Result of the comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Path of the scene as given.
    pub scene: String,
    /// Number of runs of each variant.
    pub repeat: usize,
    /// Shortest wall time of the steps of the scene as given \[s\].
    pub seconds: f64,
    /// One entry per effect.
    pub effects: Vec<Change>,
    /// Effects that are off although states of the run as given called for them.
    pub missing: Vec<String>,
}

/// Comparison of the run without one effect with the run as given.
#[derive(Debug, Clone, Serialize)]
pub struct Change {
    /// Key of the effect in the scene, and its kind.
    pub effect: String,
    /// Largest change of each probe, divided by its largest value in the run as given \[–\].
    pub probes: BTreeMap<String, f64>,
    /// Shortest wall time of the steps without the effect \[s\].
    pub seconds: f64,
    /// Share of the time that the effect costs, `1 − seconds/seconds as given`; includes its influence on the
    /// time step.
    pub share: f64,
    /// Error that ended the run without the effect early, if any.
    pub failed: Option<String>,
    /// Effects that states of the run without the effect called for.
    pub missing: Vec<String>,
}

/// A run without output.
struct Trace {
    times: Vec<f64>,
    probes: Vec<(String, Vec<f64>)>,
    seconds: f64,
    missing: BTreeMap<(String, &'static str), String>,
    failed: Option<Error>,
}

/// Compares the scene with its variants; each variant runs `repeat` times.
///
/// # Errors
/// A scene without probes, `repeat` of zero, or a failure of the run as given.
pub fn compare(scene: &Scene, repeat: usize) -> Result<Comparison> {
    scene.spec().refuse_following("effects")?;
    let folder = scene.folder();
    if repeat == 0 {
        return Err(value("--repeat", 0, "must be at least 1"));
    }
    if scene.spec().probe.is_empty() {
        let rule = "is empty; effects are judged by what they change there, so name at least one probe";
        return Err(key("probe", rule));
    }
    let mut reference = trace(scene.spec(), folder)?;
    if let Some(e) = reference.failed {
        return Err(e);
    }
    let variants = variants(scene.spec());
    let mut traces = Vec::new();
    for (_, scene) in &variants {
        traces.push(trace(scene, folder)?);
    }
    // In turns, so that a slow phase of the machine hits all variants alike.
    for _ in 1..repeat {
        reference.seconds = reference.seconds.min(trace(scene.spec(), folder)?.seconds);
        for ((_, scene), t) in variants.iter().zip(&mut traces) {
            t.seconds = t.seconds.min(trace(scene, folder)?.seconds);
        }
    }
    let mut changes = Vec::new();
    for ((name, _), without) in variants.into_iter().zip(traces) {
        changes.push(Change {
            effect: name,
            probes: reference
                .probes
                .iter()
                .zip(&without.probes)
                .map(|(a, b)| (a.0.clone(), change(&reference.times, &a.1, &without.times, &b.1)))
                .collect(),
            seconds: without.seconds,
            share: 1.0 - without.seconds / reference.seconds,
            failed: without.failed.map(|e| e.to_string()),
            missing: messages(without.missing),
        });
    }
    Ok(Comparison {
        scene: scene.source().path.display().to_string(),
        repeat,
        seconds: reference.seconds,
        effects: changes,
        missing: messages(reference.missing),
    })
}

fn messages(findings: BTreeMap<(String, &'static str), String>) -> Vec<String> {
    let text = |((model, _), m): ((String, &str), String)| format!("model '{model}': {m}");
    findings.into_iter().map(text).collect()
}

/// Copies of the scene, each with one of the enabled effects switched off.
fn variants(scene: &LoweredScene) -> Vec<(String, LoweredScene)> {
    let mut out = Vec::new();
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        let mut without = scene.clone();
        without.effect[k].enabled = false;
        out.push((format!("effect[{k}].{}", e.kind.key()), without));
    }
    for (name, _) in scene.model.iter().filter(|(_, m)| m.dem.finite_rotations) {
        let mut without = scene.clone();
        if let Some(m) = without.model.get_mut(name) {
            m.dem.finite_rotations = false;
        }
        out.push((format!("model.{name}.dem.finite_rotations"), without));
    }
    for (name, i) in &scene.interface {
        if i.absorber.is_some() {
            let mut without = scene.clone();
            if let Some(i) = without.interface.get_mut(name) {
                i.absorber = None;
            }
            out.push((format!("interface.{name}.absorber"), without));
        }
    }
    out
}

fn trace(scene: &LoweredScene, folder: &Path) -> Result<Trace> {
    steps(setup::build(scene, folder)?)
}

fn steps(built: Built) -> Result<Trace> {
    let Built {
        mut run,
        probes,
        steps,
        without_contact,
        ..
    } = built;
    let mut clock = PhaseClock::new();
    let mut out = Trace {
        times: Vec::with_capacity(steps),
        probes: probes.iter().map(|p| (p.name.clone(), Vec::new())).collect(),
        seconds: 0.0,
        missing: BTreeMap::new(),
        failed: None,
    };
    let every = steps.div_ceil(LOOKS).max(1);
    for step in 1..=steps {
        let stepped = run.advance(&mut clock);
        clock.enter(Some(arlequin::core::Phase::Observe));
        if let Err(e) = stepped {
            out.failed = Some(core("time")(e));
            break;
        }
        out.times.push(run.time());
        let mut readings = Readings::default();
        for (reader, (_, values)) in probes.iter().zip(&mut out.probes) {
            values.push(reader.read(&mut run, &mut readings)?);
        }
        if step % every == 0 || step == steps {
            for (model, f) in run.watch().into_iter().chain(without_contact.watch(&run)) {
                out.missing.insert((model, f.effect), f.message);
            }
        }
    }
    clock.enter(None);
    out.seconds = clock.split()[0];
    Ok(out)
}

/// Largest difference over the time both series cover, divided by the largest value of the first series.
fn change(times: &[f64], values: &[f64], other_times: &[f64], other_values: &[f64]) -> f64 {
    let top = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let end = other_times.last().copied().unwrap_or_default();
    // Variants may have other time steps, and may have ended early.
    let difference = times
        .iter()
        .zip(values)
        .take_while(|(t, _)| **t <= end)
        .filter_map(|(t, v)| Some((v - interpolated(other_times, other_values, *t)?).abs()))
        .fold(0.0_f64, f64::max);
    if top > 0.0 { difference / top } else { difference }
}

/// Interpolates linearly at time `t`; `None` outside of the recorded times.
fn interpolated(times: &[f64], values: &[f64], t: f64) -> Option<f64> {
    let k = times.partition_point(|x| *x < t);
    if k == 0 {
        return times.first().filter(|x| **x <= t).map(|_| values[0]);
    }
    let (a, b) = (times.get(k - 1)?, times.get(k)?);
    Some(values[k - 1] + (values[k] - values[k - 1]) * (t - a) / (b - a))
}

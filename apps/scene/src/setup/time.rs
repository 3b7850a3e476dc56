//! Length of a run, its time step, the own steps of its models, and functions of time.

use super::formula;
use crate::error::{Result, core, key, value};
use crate::setup::{LoweredModel, LoweredScene};
use crate::spec::{Motion, OwnStepTable, Scheme, StepChoice, TimeShape};
use arlequin::core::{OwnStep, TimeFunction, TimeStep};

/// Number of steps that no run can complete.
const MANY_STEPS: f64 = 1e13;

/// Time step of the run. With `time.steps`, the number of steps counts those of the finest model, unless own
/// steps are given.
pub(super) fn step(scene: &LoweredScene) -> TimeStep<f64> {
    match scene.time.step {
        StepChoice::Fraction(f) if scene.time.steps.is_some() => TimeStep::Fraction(f),
        StepChoice::Fraction(f) => TimeStep::Chosen(f),
        StepChoice::Seconds(s) => TimeStep::Seconds(s),
    }
}

/// Own steps of a model within a macro step.
pub(super) fn own_step(scene: &LoweredScene, m: usize) -> OwnStep<f64> {
    let table = scene.model.values().nth(m).and_then(|t| t.step);
    match table.unwrap_or_default() {
        OwnStepTable {
            scheme: Some(Scheme::Implicit),
            ..
        } => OwnStep::Implicit,
        OwnStepTable { ratio: Some(n), .. } => OwnStep::Ratio(n),
        OwnStepTable {
            fraction: Some(f), ..
        } => OwnStep::Fraction(f),
        _ => OwnStep::Same,
    }
}

/// Refuses an invalid table of own steps.
pub(super) fn check_own(name: &str, model: &LoweredModel, is_linear: bool) -> Result<()> {
    let Some(table) = model.step else { return Ok(()) };
    let path = format!("model.{name}.step");
    let rule = "needs exactly one of ratio, fraction, scheme = \"implicit\"";
    match (table.ratio, table.fraction, table.scheme) {
        (Some(0), ..) => {
            let rule = "must be at least 1: own steps of the model in a step of the run";
            Err(value(format!("{path}.ratio"), 0, rule))
        }
        (None, Some(f), scheme) if scheme != Some(Scheme::Implicit) && !(f > 0.0 && f <= 1.0) => {
            let rule = "must lie above 0 and not above 1, in units of the model's critical step; take 0.5";
            Err(value(format!("{path}.fraction"), f, rule))
        }
        (None, None, Some(Scheme::Implicit)) if !is_linear => {
            let rule =
                "is for linear solids: bonds may break and particles turn and touch; give particles a ratio";
            Err(value(format!("{path}.scheme"), "implicit", rule))
        }
        (Some(_), None, None | Some(Scheme::Explicit))
        | (None, Some(_), None | Some(Scheme::Explicit))
        | (None, None, Some(Scheme::Implicit)) => Ok(()),
        _ => Err(key(path, rule)),
    }
}

/// Number of whole steps up to the end; a step that ends there up to round-off is the last one.
pub(super) fn steps(scene: &LoweredScene, dt: f64) -> Result<usize> {
    let end = match (scene.time.steps, scene.time.end) {
        (Some(n), _) => return Ok(n),
        (None, end) => end.unwrap_or_default(),
    };
    // Round-off of the quotient must not add a step.
    let steps = (end / dt * (1.0 - 1e-12)).ceil();
    if steps > MANY_STEPS {
        let rule =
            format!("is {steps:.1e} steps of {dt:e} s away, more than {MANY_STEPS:e}; choose an earlier end");
        return Err(value("time.end", end, &rule));
    }
    Ok((steps as usize).max(1))
}

/// Number of steps between two frames: as given, otherwise for about twenty frames in all.
pub(super) fn frames(scene: &LoweredScene, steps: usize, dt: f64) -> usize {
    let every = match (scene.output.every, scene.output.interval) {
        (Some(n), _) => n,
        (None, Some(seconds)) => (seconds / dt).round() as usize,
        // `[static]` scenes write every load step.
        (None, None) if scene.statics.is_some() => 1,
        (None, None) => steps.div_ceil(20),
    };
    every.max(1)
}

/// Refuses invalid ends and steps.
pub(super) fn check(scene: &LoweredScene) -> Result<()> {
    match (scene.time.end, scene.time.steps) {
        (None, None) if scene.statics.is_some() => {}
        (Some(t), None) if t <= 0.0 => return Err(value("time.end", t, "must be positive [s]")),
        (None, Some(0)) => return Err(value("time.steps", 0, "must be at least 1")),
        (Some(_), None) | (None, Some(_)) => {}
        _ => {
            return Err(key(
                "time",
                "needs exactly one of end [s], steps; a scene at rest has [static] in its place",
            ));
        }
    }
    match scene.time.step {
        StepChoice::Fraction(f) if !(f > 0.0 && f < 1.0) => {
            let rule = "must lie above 0 and below 1, in units of the critical step; take 0.9";
            Err(value("time.step.fraction", f, rule))
        }
        StepChoice::Seconds(s) if s <= 0.0 => Err(value("time.step.seconds", s, "must be positive [s]")),
        _ => Ok(()),
    }
}

pub(super) fn time_function(path: &str, shape: &TimeShape) -> Result<TimeFunction<f64>> {
    let function = match shape {
        TimeShape::Step => TimeFunction::Step,
        TimeShape::Ramp { duration } => TimeFunction::Ramp { duration: *duration },
        TimeShape::Pulse { duration } => TimeFunction::SmoothPulse { duration: *duration },
        TimeShape::Table(rows) => TimeFunction::Table(rows.clone()),
        TimeShape::Expression(text) => TimeFunction::Formula(formula::formula(path, text)?),
        TimeShape::File(name) => return Err(value(format!("{path}.file"), name, "was not read")),
    };
    function.validate().map_err(core(path))?;
    Ok(function)
}

/// Amplitude and time function of a prescribed motion; a speed is integrated in time.
pub(super) fn motion(path: &str, m: &Motion) -> Result<(f64, TimeFunction<f64>)> {
    let time = time_function(&format!("{path}.time"), &m.time)?;
    match (m.amplitude, m.speed) {
        (Some(amplitude), None) => Ok((amplitude, time)),
        (None, Some(speed)) => Ok((speed, TimeFunction::Integral(Box::new(time)))),
        _ => Err(key(path, "needs exactly one of amplitude [m], speed [m/s]")),
    }
}

//! Load steps of `[static]` scenes.

use super::formula;
use crate::error::{Result, key, value};
use crate::spec::{EffectKind, SceneSpec, Static};
use arlequin::core::Relaxation;
use std::path::Path;

/// Largest number of load steps.
const MANY: usize = 1_000_000;

/// Load steps of a `[static]` scene.
#[derive(Debug, Clone)]
pub struct LoadSteps {
    /// Times of the load steps \[s\].
    pub times: Vec<f64>,
    /// Parameters of the relaxation, used if there is no direct solution.
    pub relaxation: Relaxation<f64>,
}

/// Load steps of a scene; `None` without `[static]`.
pub(super) fn load_steps(scene: &SceneSpec, folder: &Path) -> Result<Option<LoadSteps>> {
    let Some(s) = &scene.statics else { return Ok(None) };
    check(scene, s)?;
    let times = match (&s.times, &s.file, s.steps) {
        (Some(times), None, None) => times.clone(),
        (None, Some(name), None) => formula::times("static", folder, name)?,
        (None, None, Some(n)) => (1..=n).map(|k| s.end * k as f64 / n as f64).collect(),
        _ => return Err(key("static", "needs exactly one of times [s], file, steps")),
    };
    if times.is_empty() || times.windows(2).any(|w| w[0] >= w[1]) {
        return Err(key(
            "static.times",
            "needs at least one time, each above the one before [s]",
        ));
    }
    let relaxation = Relaxation {
        tolerance: s.tolerance,
        most: s.iterations,
        ramp: s.ramp,
    };
    Ok(Some(LoadSteps { times, relaxation }))
}

fn check(scene: &SceneSpec, s: &Static) -> Result<()> {
    if scene.time.end.is_some() || scene.time.steps.is_some() {
        return Err(key(
            "time",
            "is replaced by [static]: remove end and steps, or [static]",
        ));
    }
    if scene.wake.is_some() {
        return Err(key(
            "wake",
            "is for scenes that run in time; remove it or [static]",
        ));
    }
    match s.steps {
        Some(0) => return Err(value("static.steps", 0, "must be at least 1")),
        Some(n) if n > MANY => return Err(value("static.steps", n, &format!("must be at most {MANY}"))),
        _ => {}
    }
    if s.end <= 0.0 {
        return Err(value("static.end", s.end, "must be positive [s]"));
    }
    if !(s.tolerance > 0.0 && s.tolerance < 1.0) {
        return Err(value(
            "static.tolerance",
            s.tolerance,
            "must lie above 0 and below 1; take 1e-6",
        ));
    }
    if s.iterations <= s.ramp {
        let rule = format!("must exceed static.ramp = {}, over which loads change", s.ramp);
        return Err(value("static.iterations", s.iterations, &rule));
    }
    let moving = |i: &&crate::spec::Initial| i.velocity.is_some() || i.spin.is_some() || i.wave.is_some();
    if let Some(k) = scene.initial.iter().position(|i| moving(&i)) {
        let rule = "moves a scene that is at rest with [static]; remove velocity, spin and wave";
        return Err(key(format!("initial[{k}]"), rule));
    }
    let prestressed = |e: &crate::spec::Effect| e.enabled && matches!(e.kind, EffectKind::Prestress(_));
    if let Some(k) = scene.effect.iter().position(prestressed) {
        let rule = "is of the shape at the start of a run in time; remove it or [static]";
        return Err(key(format!("effect[{k}].prestress"), rule));
    }
    Ok(())
}

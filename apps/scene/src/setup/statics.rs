//! Load steps of `[static]` scenes.

use super::formula;
use super::kinds::kind;
use crate::error::{Result, key, value};
use crate::setup::{LoweredModel, LoweredScene};
use crate::spec::{Effect, EffectKind, Static};
use arlequin::core::Relaxation;
use std::path::Path;

/// Largest number of load steps.
const MANY: usize = 1_000_000;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Load steps of a `[static]` scene.
#[derive(Debug, Clone)]
pub struct LoadSteps {
    /// Times of the load steps \[s\].
    pub times: Vec<f64>,
    /// Parameters of the relaxation, used if there is no direct solution.
    pub relaxation: Relaxation<f64>,
}

/// Load steps of a scene; `None` without `[static]`.
pub(super) fn load_steps(scene: &LoweredScene, folder: &Path) -> Result<Option<LoadSteps>> {
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

fn check(scene: &LoweredScene, s: &Static) -> Result<()> {
    if scene.time.end.is_some() || scene.time.steps.is_some() {
        return Err(key(
            "time",
            "is replaced by [static]: remove end and steps, or [static]",
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
    let prestressed = |e: &Effect| e.enabled && matches!(e.kind, EffectKind::Prestress(_));
    if let Some(k) = scene.effect.iter().position(prestressed) {
        let rule = "is of the shape at the start of a run in time; remove it or [static]";
        return Err(key(format!("effect[{k}].prestress"), rule));
    }
    Ok(())
}

/// Refuses models at rest that no support holds in a direction: nothing would resist their rigid motion.
/// Supports at points or lines, which leave turns free, are judged with the nodes of the models.
pub(super) fn check_held(scene: &LoweredScene) -> Result<()> {
    if scene.statics.is_none() || !is_linear(scene) {
        return Ok(());
    }
    for group in tied(scene) {
        let is_line = |name: &str| scene.model[name].shape.is_line();
        let axes = if group.iter().all(|n| is_line(n)) { 1 } else { 3 };
        let supports = || scene.support.iter().filter(|s| group.contains(&s.model.as_str()));
        let holds = |c: usize| {
            let mut components = supports().map(|s| s.components.as_deref());
            components.any(|list| list.is_none_or(|list| list.iter().any(|a| a.index() == c)))
        };
        let free = |c: &usize| !holds(*c);
        let moves: Vec<usize> = (0..axes).filter(free).collect();
        let turns: Vec<usize> = (0..axes)
            .filter(|c| axes == 3 && (0..3).all(|o| o == *c || free(&o)))
            .collect();
        if moves.is_empty() {
            continue;
        }
        let list = |axes: &[usize]| axes.iter().map(|c| AXES[*c]).collect::<Vec<&str>>().join(" and ");
        let turn = match turns.is_empty() {
            true => String::new(),
            false => format!(" and turn about {}", list(&turns)),
        };
        let rule = format!(
            "'{}' can move along {}{turn}: no support holds it in these directions; add supports",
            group.join("' and '"),
            list(&moves)
        );
        return Err(key("static", rule));
    }
    Ok(())
}

/// Returns whether nothing in a scene makes the load steps other than linear, so that they are solved
/// directly.
fn is_linear(scene: &LoweredScene) -> bool {
    let linear = |e: &Effect| !e.enabled || !e.kind.bearer().touches() && e.between.is_none();
    let plain = |m: &LoweredModel| !m.dem.finite_rotations && !kind(m.kind).is_remote();
    scene.effect.iter().all(linear) && scene.model.values().all(plain)
}

/// Names of the models, in groups that interfaces tie together.
fn tied(scene: &LoweredScene) -> Vec<Vec<&str>> {
    let mut groups: Vec<Vec<&str>> = scene.model.keys().map(|n| vec![&**n]).collect();
    for i in scene.interface.values() {
        let sides = [&*i.coarse, &*i.fine];
        let (joined, mut others): (Vec<_>, Vec<_>) = groups
            .into_iter()
            .partition(|g: &Vec<&str>| sides.iter().any(|s| g.contains(s)));
        others.push(joined.concat());
        groups = others;
    }
    groups
}

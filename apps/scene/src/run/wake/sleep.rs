//! The sleeping scene.

use crate::error::{Result, key, unknown, value};
use crate::scene::Scene;
use crate::setup::{LoweredModel, LoweredScene, acts, effect_models};
use crate::spec::{Effect, EffectKind, Near, Scheme, StepChoice, Wake};

/// Applies the assignments of `[wake]`, and removes the sleeping model with its interfaces, probes and
/// effects.
pub(super) fn scene(awake: &Scene, wake: &Wake) -> Result<Scene> {
    check(awake.spec(), wake)?;
    let own_keys = format!("model.{}.", wake.model);
    for (k, a) in wake.asleep.iter().enumerate() {
        let path = a.split('=').next().unwrap_or_default().trim();
        if path == "wake" || path.starts_with("wake.") || path.starts_with(&own_keys) {
            let rule = "changes nothing while the model sleeps; remove it";
            return Err(value(format!("wake.asleep[{k}]"), a, rule));
        }
    }
    let mut changed = awake.clone();
    for (k, a) in wake.asleep.iter().enumerate() {
        let set = changed.assign(std::slice::from_ref(a));
        changed = set.map_err(|e| value(format!("wake.asleep[{k}]"), a, &e.to_string()))?;
    }
    let mut scene = changed.spec().clone();
    check_acting(&scene, wake)?;
    let (sleeper, full) = (&wake.model, scene.clone());
    scene.model.remove(sleeper);
    scene
        .interface
        .retain(|_, i| i.coarse != *sleeper && i.fine != *sleeper);
    scene.probe.retain(|_, p| p.model.as_ref() != Some(sleeper));
    for i in &mut scene.initial {
        if let Some(names) = &mut i.models {
            names.retain(|n| n != sleeper);
        }
    }
    scene.effect.clear();
    for (k, e) in full.effect.iter().enumerate() {
        if let Some(e) = effect(k, e, &full, wake)? {
            scene.effect.push(e);
        }
    }
    // After the effects, because `acts` searches those that are left.
    let probes = std::mem::take(&mut scene.probe);
    let is_left = |target: &Option<String>| target.as_ref().is_none_or(|n| acts(n, &scene));
    scene.probe = probes.into_iter().filter(|(_, p)| is_left(&p.of)).collect();
    let known = |name: &String| scene.probe.contains_key(name);
    scene.curve.retain(|_, c| known(&c.x) && known(&c.y));
    scene.wake = None;
    check_step(&scene, wake)?;
    Ok(awake.with_spec(scene))
}

/// Refuses a step given as a fraction if the sleeping scene has only implicit models, which have no critical
/// step.
fn check_step(asleep: &LoweredScene, wake: &Wake) -> Result<()> {
    let implicit = |m: &LoweredModel| m.step.is_some_and(|s| s.scheme == Some(Scheme::Implicit));
    if !matches!(asleep.time.step, StepChoice::Fraction(_)) || !asleep.model.values().all(implicit) {
        return Ok(());
    }
    let rule = format!(
        "leaves nothing to choose a step by while '{}' sleeps: an implicit model has no critical step; give time.step.seconds, or \
         let '{}' step explicitly",
        wake.model, wake.by
    );
    Err(value(format!("model.{}.step.scheme", wake.by), "implicit", &rule))
}

fn check(scene: &LoweredScene, wake: &Wake) -> Result<()> {
    for (what, name) in [("model", &wake.model), ("by", &wake.by)] {
        if !scene.model.contains_key(name) {
            return Err(unknown(format!("wake.{what}"), name, "model", scene.model.keys()));
        }
    }
    if wake.model == wake.by {
        let rule = "sleeps and cannot carry itself; name the model that stands in for it";
        return Err(value("wake.by", &wake.by, rule));
    }
    if wake.every == 0 {
        return Err(value("wake.every", 0, "must be at least 1 step"));
    }
    let limits = [
        ("strain", wake.criterion.strain, "-"),
        ("stress", wake.criterion.stress, "Pa"),
    ];
    for (name, limit, unit) in limits {
        if let Some(x) = limit.filter(|x| *x <= 0.0) {
            let rule = format!("must be positive [{unit}]; tension counts as positive");
            return Err(value(format!("wake.criterion.{name}"), x, &rule));
        }
    }
    if limits.iter().filter(|l| l.1.is_some()).count() != 1 {
        return Err(key(
            "wake.criterion",
            "needs exactly one of strain [-], stress [Pa]",
        ));
    }
    if let Some(Near::Box { low, high }) = &wake.near
        && let Some(c) = (0..3).find(|&c| high[c] < low[c])
    {
        let rule = format!("must not be below low[{c}] = {} m", low[c]);
        return Err(value(format!("wake.near.box.high[{c}]"), high[c], &rule));
    }
    if scene.time.end.is_none() {
        let rule = "is needed by [wake] in place of time.steps: the step changes as the model wakes";
        return Err(key("time.end", rule));
    }
    Ok(())
}

/// Refuses loads, supports, initial states and body forces of the sleeping model, which would be lost.
fn check_acting(scene: &LoweredScene, wake: &Wake) -> Result<()> {
    let (sleeper, by) = (&wake.model, &wake.by);
    let lost = |list: &str, k: usize, change: String| {
        let rule = format!(
            "acts on '{sleeper}' and would be lost while it sleeps; let it act on '{by}' until then: add \
             \"{list}.{k}.{change}\" to wake.asleep"
        );
        Err(key(format!("{list}[{k}]"), rule))
    };
    let model = || format!("model={by}");
    if let Some(k) = scene.load.iter().position(|l| l.model == *sleeper) {
        return lost("load", k, model());
    }
    if let Some(k) = scene.support.iter().position(|s| s.model == *sleeper) {
        return lost("support", k, model());
    }
    let only = |names: &Option<Vec<String>>| {
        names
            .as_ref()
            .is_some_and(|n| n.contains(sleeper) && !n.contains(by))
    };
    if let Some(k) = scene.initial.iter().position(|i| only(&i.models)) {
        return lost("initial", k, format!("models=['{by}']"));
    }
    let forced = |e: &Effect| e.enabled && matches!(e.kind, EffectKind::BodyForce(_)) && only(&e.models);
    if let Some(k) = scene.effect.iter().position(forced) {
        return lost("effect", k, format!("models=['{by}']"));
    }
    Ok(())
}

/// Returns effect `k` of the sleeping scene; `None` if it acts on no other model.
fn effect(k: usize, e: &Effect, scene: &LoweredScene, wake: &Wake) -> Result<Option<Effect>> {
    let (path, sleeper) = (format!("effect[{k}]"), &wake.model);
    if e.enabled && matches!(e.kind, EffectKind::Prestress(_)) {
        let rule = "holds the shape at the start, which is another one after [wake]; remove one of the two";
        return Err(key(format!("{path}.prestress"), rule));
    }
    let sleeper_index = scene.model.keys().position(|n| n == sleeper);
    if e.enabled && e.between.is_some() {
        let rule = "is a contact between two models, which [wake] does not hand over; remove one";
        return Err(key(format!("{path}.between"), rule));
    }
    let other_models = effect_models(k, e, scene)?
        .into_iter()
        .filter(|m| Some(*m) != sleeper_index);
    if e.enabled && matches!(e.kind, EffectKind::Obstacle(_)) {
        let rule = "would touch nothing while the model sleeps, and [wake] does not hand its motion over; remove one";
        return Err(key(format!("{path}.obstacle"), rule));
    }
    if let (true, Some(m)) = (
        e.kind.bearer().touches() && e.enabled,
        other_models.clone().next(),
    ) {
        let name = scene.model.keys().nth(m).map_or("", String::as_str);
        let rule = format!(
            "acts on '{name}', whose broken bonds and contacts [wake] does not hand over; name '{sleeper}' alone in \
             {path}.models"
        );
        return Err(key(path, rule));
    }
    if other_models.count() == 0 {
        return Ok(None);
    }
    let mut asleep_effect = e.clone();
    if let Some(names) = &mut asleep_effect.models {
        names.retain(|n| n != sleeper);
    }
    Ok(Some(asleep_effect))
}

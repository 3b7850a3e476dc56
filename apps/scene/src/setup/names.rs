//! Names in a scene, and the models that they refer to.

use super::kind::Feature;
use super::kinds::kind;
use super::lower::following;
use crate::error::{Result, key, unknown, value};
use crate::setup::{LoweredInterface, LoweredModel, LoweredScene};
use crate::spec::{Bearer, Effect, EffectKind, RoleKind};

/// Name of the body's own model.
pub(crate) const BODY: &str = "body";

/// Numbers of the models that a model name in the scene refers to: the body's own model includes its zones.
pub(super) fn parts(scene: &LoweredScene, m: usize) -> Vec<usize> {
    let place = |name: &String| scene.model.keys().position(|n| n == name);
    let whole = scene.body.is_some() && place(&BODY.to_owned()) == Some(m);
    let zones = scene.zone.keys().filter(|_| whole).filter_map(place);
    std::iter::once(m).chain(zones).collect()
}

/// Numbers of the models that carry a load on model `m`. A zone that moves stays off loads, so that the
/// body's elements carry them alone.
pub(super) fn loaded_parts(scene: &LoweredScene, m: usize) -> Vec<usize> {
    match following(scene) {
        Some(_) => vec![m],
        None => parts(scene, m),
    }
}

/// Expands the body in a list of models to the body and its zones, except zones that `elsewhere` lists by
/// name.
pub(super) fn with_parts(
    scene: &LoweredScene,
    named: Vec<usize>,
    elsewhere: impl Fn(&str) -> bool,
) -> Vec<usize> {
    let name = |m: usize| scene.model.keys().nth(m).map_or("", String::as_str);
    let mut out = named.clone();
    for z in named.iter().flat_map(|m| parts(scene, *m)) {
        if !out.contains(&z) && !elsewhere(name(z)) {
            out.push(z);
        }
    }
    out
}

/// Returns the number of the model with this name.
pub fn model_index(path: &str, name: &str, scene: &LoweredScene) -> Result<usize> {
    let number = scene.model.keys().position(|k| k == name);
    number.ok_or_else(|| unknown(path, name, "model", scene.model.keys()))
}

pub(super) fn model_indices(
    path: &str,
    names: Option<&[String]>,
    scene: &LoweredScene,
) -> Result<Vec<usize>> {
    let Some(names) = names else {
        return Ok((0..scene.model.len()).collect());
    };
    let index = |(k, n): (usize, &String)| model_index(&format!("{path}.models[{k}]"), n, scene);
    names.iter().enumerate().map(index).collect()
}

/// Numbers of the coarse and the fine model of an interface.
pub(super) fn sides_of(name: &str, table: &LoweredInterface, scene: &LoweredScene) -> Result<[usize; 2]> {
    let path = format!("interface.{name}");
    let mut out = [0; 2];
    let sides = [(&table.coarse, RoleKind::Coarse), (&table.fine, RoleKind::Fine)];
    for (slot, (model, role)) in out.iter_mut().zip(sides) {
        *slot = model_index(&format!("{path}.{}", role.name()), model, scene)?;
    }
    if out[0] == out[1] {
        let rule = format!(
            "is coarse and fine side at once ('{}'); name two models",
            table.fine
        );
        return Err(key(format!("{path}.fine"), rule));
    }
    for (model, role) in sides {
        let table = &scene.model[model];
        let between = table.role.is_none() && is_between(model, scene);
        if between
            && role == RoleKind::Coarse
            && let Some(rule) = kind(table.kind).refusal(Feature::CoarseSide)
        {
            return Err(value(format!("{path}.coarse"), model, rule));
        }
        if !between && table.role != Some(role) {
            let rule = if is_between(model, scene) {
                format!(
                    "interface '{name}' needs it to be {} and another the opposite; leave role out",
                    role.name()
                )
            } else {
                format!("interface '{name}' needs role = \"{}\" here", role.name())
            };
            return Err(key(format!("model.{model}.role"), rule));
        }
    }
    Ok(out)
}

/// Returns whether a model is coarse in one interface and fine in another.
fn is_between(model: &str, scene: &LoweredScene) -> bool {
    let mut interfaces = scene.interface.values();
    interfaces.clone().any(|i| i.coarse == model) && interfaces.any(|i| i.fine == model)
}

/// Effects on each model, with their numbers in the scene.
pub(super) fn effects_by_model(scene: &LoweredScene) -> Result<Vec<Vec<(usize, &Effect)>>> {
    let mut out = vec![Vec::new(); scene.model.len()];
    for (k, e) in scene.effect.iter().enumerate() {
        for m in effect_models(k, e, scene)? {
            out[m].push((k, e));
        }
    }
    Ok(out)
}

/// Numbers of the two models that effect `k` acts between; `None` if it acts on single models.
pub(super) fn contact_sides(k: usize, e: &Effect, scene: &LoweredScene) -> Result<Option<[usize; 2]>> {
    let Some(names) = &e.between else {
        return Ok(None);
    };
    let path = format!("effect[{k}].between");
    let EffectKind::Contact(_) = e.kind else {
        let rule = format!(
            "is for contact; {} acts on single models, name them in models",
            e.kind.key()
        );
        return Err(key(path, rule));
    };
    if e.models.is_some() {
        return Err(key(path, "excludes models; remove one of the two"));
    }
    let [a, b] = &names[..] else {
        let rule = format!("names {} models; name two", names.len());
        return Err(key(path, rule));
    };
    let mut out = [0; 2];
    for (n, (slot, name)) in out.iter_mut().zip([a, b]).enumerate() {
        *slot = model_index(&format!("{path}[{n}]"), name, scene)?;
        let table = &scene.model[name];
        if !kind(table.kind).has_spheres() && !is_solid(table) {
            let rule = format!("contact needs {SURFACES}, which model '{name}' is not");
            return Err(key(format!("{path}[{n}]"), rule));
        }
    }
    if a == b {
        let rule = format!("names '{a}' twice; contact within one model is models = [\"{a}\"]");
        return Err(key(path, rule));
    }
    Ok(Some(out))
}

/// Models that have particles or a surface.
const SURFACES: &str = "kind = \"dem\", or a solid of kind = \"fem\" or \"cnem\"";

/// Returns whether a model is a solid of finite or natural elements.
fn is_solid(table: &LoweredModel) -> bool {
    kind(table.kind).elements().is_some() && !table.shape.is_line()
}

/// Requirement of bulk viscosity, and the alternative for a line model.
pub(super) const SOLID: &str = "a solid of kind = \"fem\" or \"cnem\" (a line can have stiffness_damping)";

/// Numbers of the models that an effect acts on: the named ones, or all that can have it.
pub fn effect_models(k: usize, e: &Effect, scene: &LoweredScene) -> Result<Vec<usize>> {
    let path = format!("effect[{k}]");
    if contact_sides(k, e, scene)?.is_some() {
        return Ok(Vec::new());
    }
    let (what, bearer) = (e.kind.key(), e.kind.bearer());
    let tables: Vec<&LoweredModel> = scene.model.values().collect();
    let has_spheres = |m: &usize| kind(tables[*m].kind).has_spheres();
    let is_solid = |m: &usize| is_solid(tables[*m]);
    let fits = |m: &usize| match bearer {
        Bearer::Any => true,
        Bearer::Solids => is_solid(m),
        Bearer::Particles => has_spheres(m),
        // Solids are named, unless the scene has nothing else that could touch.
        Bearer::Surfaces if e.models.is_none() && (0..tables.len()).any(|m| has_spheres(&m)) => {
            has_spheres(m)
        }
        Bearer::Surfaces => has_spheres(m) || is_solid(m),
    };
    let models = model_indices(&path, e.models.as_deref(), scene)?;
    if let (Some(names), Some(misfit)) = (&e.models, models.iter().position(|m| !fits(m))) {
        let requirement = match bearer {
            Bearer::Particles => "kind = \"dem\"",
            Bearer::Surfaces => SURFACES,
            _ => SOLID,
        };
        let rule = format!(
            "{what} needs {requirement}, which model '{}' is not",
            names[misfit]
        );
        return Err(key(format!("{path}.models[{misfit}]"), rule));
    }
    // Gravity on a body also acts on its zones, and an obstacle touches them; damping may be meant for one
    // model only.
    let models = match (&e.kind, &e.models) {
        (EffectKind::Obstacle(_), Some(_)) => with_parts(scene, models, |_| false),
        (EffectKind::BodyForce(_), Some(_)) => with_parts(scene, models, |name| {
            let forces = scene
                .effect
                .iter()
                .filter(|o| matches!(o.kind, EffectKind::BodyForce(_)));
            forces
                .filter_map(|o| o.models.as_ref())
                .flatten()
                .any(|n| n == name)
        }),
        _ => models,
    };
    let fitting: Vec<usize> = models.into_iter().filter(fits).collect();
    if fitting.is_empty() {
        let rule = format!("no model of the scene can have {what}; remove it");
        return Err(key(path, rule));
    }
    Ok(fitting)
}

/// Refuses a name that would break the header of output tables.
pub(super) fn headline(path: &str, name: Option<&str>) -> Result<()> {
    match name {
        Some(n) if n.trim().is_empty() || n.contains(|c: char| ",;\"".contains(c) || c.is_control()) => {
            let rule = "stands at the head of tables with commas; take letters, digits, spaces, - and _";
            Err(value(format!("{path}.name"), format_args!("{n:?}"), rule))
        }
        _ => Ok(()),
    }
}

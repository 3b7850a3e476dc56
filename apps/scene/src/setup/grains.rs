//! Features that only particles have: bonds that break, contact, obstacles.

use super::body::Grains;
use super::body::RigidBodies;
use super::fracture;
use super::packing::PackingLine;
use super::skin::Skin;
use crate::error::{Result, dem, key, value};
use crate::setup::LoweredModel;
use crate::spec::{self, Effect, EffectKind, LooseKind};
use arlequin::core::effect;
use arlequin::dem_beam::{Contact, ContactBody, ContactLaw, DemModel, Obstacle};
use std::collections::BTreeMap;
use std::sync::atomic::AtomicUsize;

/// Adds the strengths of the bonds to the model and builds the effects that depend on particles.
pub(super) fn build(
    model: DemModel,
    (key, table): (&str, &LoweredModel),
    effects: &[(usize, &Effect)],
    rigid: Option<&RigidBodies>,
    mut packing: PackingLine,
    skin: Skin,
) -> Result<(DemModel, Grains)> {
    let young = table.known_material(key)?.young;
    let (model, breaking) = fracture::apply(model, (key, table), effects, &mut packing)?;
    let mut built: BTreeMap<usize, Box<dyn effect::EffectSpec<f64>>> = BTreeMap::new();
    for (k, e) in effects.iter().filter(|(_, e)| e.enabled) {
        if let EffectKind::Contact(c) = &e.kind {
            let path = format!("effect[{k}].contact");
            let contact = Contact::new(&model, law(young, c)).map_err(dem(&path))?;
            built.insert(*k, Box::new(contact));
        }
        if let EffectKind::Obstacle(o) = &e.kind {
            let Some(body) = rigid.and_then(|r| r.get(k)) else {
                continue;
            };
            let obstacle = Obstacle::of_body(&model, body, law(young, &o.contact));
            let obstacle = obstacle.map_err(dem(format!("effect[{k}].obstacle")))?;
            built.insert(*k, Box::new(obstacle));
        }
    }
    let body = ContactBody::from_model(&model);
    Ok((
        model,
        Grains {
            effects: built,
            breaks: breaking.log,
            brittle: breaking.brittle,
            body,
            packing,
            points: AtomicUsize::new(0),
            skin,
        },
    ))
}

/// Contact law for a material with Young's modulus `young` \[Pa\].
pub(super) fn law(young: f64, c: &spec::Contact) -> ContactLaw {
    let base = ContactLaw::elastic(c.modulus.unwrap_or(young));
    ContactLaw {
        // Grains of brittle materials rebound with about half of their speed.
        restitution: c.restitution.unwrap_or(0.5),
        friction: c.friction.unwrap_or(base.friction),
        shear_ratio: c.shear_ratio.unwrap_or(base.shear_ratio),
        rolling: c.rolling.unwrap_or(base.rolling),
        skin: c.skin.unwrap_or(base.skin),
        ..base
    }
}

/// Refuses loose grains without contact: they would pass through all bodies.
pub(super) fn check_loose(path: &str, table: &LoweredModel, effects: &[(usize, &Effect)]) -> Result<()> {
    let touches = |e: &Effect| e.enabled && matches!(e.kind, EffectKind::Contact(_));
    if table.dem.loose == LooseKind::Drop || effects.iter().any(|(_, e)| touches(e)) {
        return Ok(());
    }
    let rule = "loose grains need contact, or they pass through everything; add an effect contact to the model, or take \
                \"drop\"";
    Err(value(format!("{path}.dem.loose"), "keep", rule))
}

/// Refuses a second contact or fracture effect on one model.
pub(super) fn check_single(model: &str, effects: &[(usize, &Effect)]) -> Result<()> {
    for single in ["fracture", "contact"] {
        let mut effects_of_kind = effects
            .iter()
            .filter(|(_, e)| e.enabled && e.kind.key() == single);
        if let Some((k, _)) = effects_of_kind.nth(1) {
            let rule = format!("model '{model}' has two; keep one");
            return Err(key(format!("effect[{k}].{single}"), rule));
        }
    }
    Ok(())
}

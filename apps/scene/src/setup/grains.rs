//! Features that only particles have: bonds that break, contact, obstacles.

use super::body::Grains;
use super::fracture;
use super::packing::PackingLine;
use super::skin::Skin;
use super::time::time_function;
use crate::error::{Result, dem, key, value};
use crate::setup::LoweredModel;
use crate::spec::{self, Effect, EffectKind, LooseKind, ObstacleShape};
use arlequin::core::effect;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::{Contact, ContactBody, ContactLaw, DemModel, Motion, Obstacle, RigidShape};
use std::collections::BTreeMap;

/// Adds the strengths of the bonds to the model and builds the effects that depend on particles.
pub(super) fn build(
    model: DemModel,
    (key, table): (&str, &LoweredModel),
    effects: &[(usize, &Effect)],
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
            built.insert(*k, Box::new(obstacle(*k, o, &model, young, effects)?));
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

/// Shape and motion of an obstacle.
///
/// # Errors
/// Keys that exclude each other; invalid shapes.
pub(crate) fn obstacle_parts(k: usize, o: &spec::Obstacle) -> Result<(RigidShape, Motion)> {
    let path = format!("effect[{k}].obstacle");
    let point = |x: [f64; 3]| Point3::from(Vector3::from(x));
    let shape = match o.shape {
        ObstacleShape::Plane { point: p, normal } => RigidShape::Plane {
            point: point(p),
            normal: Vector3::from(normal),
        },
        ObstacleShape::Sphere { centre, radius } => RigidShape::Sphere {
            centre: point(centre),
            radius,
        },
        ObstacleShape::Cylinder {
            point: p,
            axis,
            radius,
        } => RigidShape::Cylinder {
            point: point(p),
            axis: Vector3::from(axis),
            radius,
        },
    };
    let velocity = o.velocity.map(Vector3::from);
    let motion = match (o.mass, velocity, &o.displacement) {
        (Some(mass), v, None) => Motion::Free {
            mass,
            velocity: v.unwrap_or_default(),
            inertia: o.inertia,
        },
        (None, Some(v), None) => Motion::Velocity(v),
        (None, None, Some(d)) => Motion::Prescribed {
            amplitude: Vector3::from(d.amplitude),
            time: time_function(&format!("{path}.displacement.time"), &d.time)?,
        },
        (None, None, None) => Motion::Fixed,
        _ => {
            let rule = "displacement excludes velocity and mass; remove one side";
            return Err(key(path, rule));
        }
    };
    if o.contact.skin.is_some() || o.contact.rolling.is_some() {
        return Err(key(
            format!("{path}.contact"),
            "an obstacle knows no skin and no rolling; remove them",
        ));
    }
    if o.inertia.is_some() && o.mass.is_none() {
        let rule = "only a free obstacle has one; give its mass as well, or remove it";
        return Err(key(format!("{path}.inertia"), rule));
    }
    let free_ball = matches!((&o.shape, o.mass), (ObstacleShape::Sphere { .. }, Some(_)));
    if o.spin.is_some() && !free_ball {
        let rule = "only a free sphere turns; give it a mass, or remove spin";
        return Err(key(format!("{path}.spin"), rule));
    }
    let shape = shape.checked().map_err(dem(format!("{path}.shape")))?;
    Ok((shape, motion))
}

/// Builds an obstacle with its spin; body forces on the particles accelerate the obstacle too.
fn obstacle(
    k: usize,
    o: &spec::Obstacle,
    model: &DemModel,
    young: f64,
    effects: &[(usize, &Effect)],
) -> Result<Obstacle> {
    let path = format!("effect[{k}].obstacle");
    let (shape, motion) = obstacle_parts(k, o)?;
    let name = o.ledger_name(k);
    let law = law(young, &o.contact);
    let mut obstacle = Obstacle::new(&name, model, shape, motion, law).map_err(dem(&path))?;
    if let Some(spin) = o.spin {
        obstacle = obstacle
            .with_spin(Vector3::from(spin))
            .map_err(dem(format!("{path}.spin")))?;
    }
    for (n, e) in effects.iter().filter(|(_, e)| e.enabled) {
        if let EffectKind::BodyForce(b) = &e.kind {
            let time = time_function(&format!("effect[{n}].body_force.time"), &b.time)?;
            obstacle = obstacle.with_acceleration(Vector3::from(b.acceleration), time);
        }
    }
    Ok(obstacle)
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

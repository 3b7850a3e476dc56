//! Rigid bodies that models touch: their shapes and motions, and the models that share one.

use super::body::{Body, RigidBodies, material};
use super::cloud::corners;
use super::drive::Chosen;
use super::files;
use super::grains::law;
use super::names::effect_models;
use super::time::time_function;
use crate::error::{Result, core, key, value};
use crate::setup::LoweredScene;
use crate::spec::{self, EffectKind, ObstacleShape};
use arlequin::core::contact::{Motion, RigidBody, RigidShape, SharedBody, Solid, SurfaceObstacle};
use arlequin::core::nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

/// Makes the paths of the files of obstacles relative to the current folder.
pub(crate) fn locate_files(scene: &mut LoweredScene, folder: &Path) {
    for e in &mut scene.effect {
        if let EffectKind::Obstacle(o) = &mut e.kind
            && let ObstacleShape::Solid { file, .. } = &mut o.shape
        {
            *file = folder.join(&*file);
        }
    }
}

/// Shape and motion of an obstacle.
///
/// # Errors
/// Keys that exclude each other; invalid shapes.
pub(crate) fn obstacle_parts(k: usize, o: &spec::Obstacle) -> Result<(RigidShape, Motion)> {
    let path = format!("effect[{k}].obstacle");
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
    if o.spring.is_some() && o.mass.is_none() {
        let rule = "holds a free obstacle only; give its mass as well, or remove it";
        return Err(key(format!("{path}.spring"), rule));
    }
    let shape_path = format!("{path}.shape");
    let shape = shape(&shape_path, &o.shape)?
        .checked()
        .map_err(core(shape_path))?;
    Ok((shape, motion))
}

/// Reads the file of a solid; other shapes have all numbers in the scene.
fn shape(path: &str, shape: &ObstacleShape) -> Result<RigidShape> {
    let point = |x: [f64; 3]| Point3::from(Vector3::from(x));
    Ok(match *shape {
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
        ObstacleShape::Cone {
            tip,
            axis,
            height,
            radius,
        } => RigidShape::Cone {
            tip: point(tip),
            axis: Vector3::from(axis),
            height,
            radius,
        },
        ObstacleShape::Box { centre, size, turn } => RigidShape::cuboid(
            point(centre),
            Vector3::from(size),
            turn.map(Vector3::from).unwrap_or_default(),
        ),
        ObstacleShape::Solid {
            ref file,
            scale,
            shift,
        } => {
            let path = format!("{path}.solid");
            let scale = scale.unwrap_or(1.0);
            if !scale.is_finite() || scale <= 0.0 {
                return Err(value(format!("{path}.scale"), scale, "must be positive [m]"));
            }
            let path = format!("{path}.file");
            let surface = files::surface(&path, file, scale)?;
            let shift = shift.map(Vector3::from).unwrap_or_default();
            let triangles = corners(&surface).into_iter().map(|t| t.map(|x| x + shift));
            RigidShape::Solid(Arc::new(Solid::new(triangles.collect()).map_err(core(path))?))
        }
    })
}

/// Makes the rigid bodies of a scene, for each model those that it touches. Models that touch the same free
/// body share it; a driven body needs no common state.
pub(super) fn rigid_bodies(scene: &LoweredScene) -> Result<Vec<RigidBodies>> {
    let mut out = vec![RigidBodies::new(); scene.model.len()];
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        let EffectKind::Obstacle(o) = &e.kind else {
            continue;
        };
        let models = effect_models(k, e, scene)?;
        let mut shared = None;
        for &m in &models {
            let body = match (&shared, o.mass) {
                (Some(body), Some(_)) => SharedBody::clone(body),
                _ => SharedBody::new(rigid_body(k, o, &models, scene)?),
            };
            shared = Some(body.clone());
            out[m].insert(k, body);
        }
    }
    Ok(out)
}

/// Models whose steps must have one length, because they share a free rigid body.
pub(super) fn in_step(scene: &LoweredScene) -> Result<BTreeSet<usize>> {
    let mut out = BTreeSet::new();
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        if matches!(&e.kind, EffectKind::Obstacle(o) if o.mass.is_some()) {
            let models = effect_models(k, e, scene)?;
            if models.len() > 1 {
                out.extend(models);
            }
        }
    }
    Ok(out)
}

/// Makes a rigid body with its spin; body forces on the models accelerate it too.
fn rigid_body(k: usize, o: &spec::Obstacle, models: &[usize], scene: &LoweredScene) -> Result<RigidBody> {
    let path = format!("effect[{k}].obstacle");
    let (shape, motion) = obstacle_parts(k, o)?;
    let body = RigidBody::new(&o.ledger_name(k), shape, motion);
    let mut body = body.map_err(core(&*path))?;
    if let Some(stiffness) = o.spring {
        body.set_spring(stiffness)
            .map_err(core(format!("{path}.spring")))?;
    }
    if let Some(spin) = o.spin {
        body.set_spin(Vector3::from(spin))
            .map_err(core(format!("{path}.spin")))?;
    }
    for (n, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        if let EffectKind::BodyForce(b) = &e.kind {
            let pulled = effect_models(n, e, scene)?;
            let shares = models.iter().filter(|m| pulled.contains(m)).count();
            if o.mass.is_some() && shares > 0 && shares < models.len() {
                let rule = format!(
                    "must name all models that the free obstacle '{}' touches, or none: it falls once, with all of them",
                    o.ledger_name(k)
                );
                return Err(key(format!("effect[{n}].models"), rule));
            }
            if shares > 0 {
                let time = time_function(&format!("effect[{n}].body_force.time"), &b.time)?;
                body.add_acceleration(Vector3::from(b.acceleration), time);
            }
        }
    }
    Ok(body)
}

/// Builds the contact of a body of elements with an obstacle.
pub(super) fn on_surface(path: &str, o: &spec::Obstacle, rigid: &SharedBody, body: &Body) -> Result<Chosen> {
    let law = law(material(path, body)?.young(), &o.contact);
    let contact = SurfaceObstacle::new(&*body.model, rigid, law);
    Ok(Box::new(contact.map_err(core(path))?))
}

//! Supports, loads, effects and initial states.

use super::interface::BuiltInterface;
use super::kinds::{Body, bar_speeds, material};
use super::{load, shared, support, zone};
use crate::error::{Result, core, key, unknown, value};
use crate::spec::{
    Axis, Bearer, Effect, EffectKind, Field, Initial, ModelKind, ModelTable, Motion, Obstacle, SceneSpec,
    Spin, TimeShape, Wave,
};
use arlequin::core::effect::{
    self, BodyForce, BulkViscosity, LocalDamping, MassDamping, Prestress, StiffnessDamping,
};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Elastic, PrescribedMotion, Subdomain, TimeFunction};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;

/// An effect that is not yet attached to a model.
pub(super) type Chosen = Box<dyn effect::EffectSpec<f64>>;

/// Returns the number of the model with this name.
pub fn model_index(path: &str, name: &str, scene: &SceneSpec) -> Result<usize> {
    let number = scene.model.keys().position(|k| k == name);
    number.ok_or_else(|| unknown(path, name, "model", scene.model.keys()))
}

/// Name of the rigid body of effect `k` in the ledger.
pub(crate) fn obstacle_name(k: usize, o: &Obstacle) -> String {
    o.name.clone().unwrap_or_else(|| format!("obstacle-{}", k + 1))
}

pub(super) fn model_indices(path: &str, names: Option<&[String]>, scene: &SceneSpec) -> Result<Vec<usize>> {
    let Some(names) = names else {
        return Ok((0..scene.model.len()).collect());
    };
    let index = |(k, n): (usize, &String)| model_index(&format!("{path}.models[{k}]"), n, scene);
    names.iter().enumerate().map(index).collect()
}

pub(super) fn time_function(path: &str, shape: &TimeShape) -> Result<TimeFunction<f64>> {
    let function = match shape {
        TimeShape::Step => TimeFunction::Step,
        TimeShape::Ramp { duration } => TimeFunction::Ramp { duration: *duration },
        TimeShape::Pulse { duration } => TimeFunction::SmoothPulse { duration: *duration },
        TimeShape::Table(rows) => TimeFunction::Table(rows.clone()),
        TimeShape::Expression(text) => TimeFunction::Formula(super::formula::formula(path, text)?),
        TimeShape::File(name) => return Err(value(format!("{path}.file"), name, "was not read")),
    };
    function.validate().map_err(core(path))?;
    Ok(function)
}

/// Supports and effects to be attached to subdomains, by the number of the model.
#[derive(Default)]
pub(super) struct Attachments {
    supports: BTreeMap<usize, Vec<PrescribedMotion<f64>>>,
    effects: BTreeMap<usize, Vec<Chosen>>,
    /// Effects that must act after all others (local damping).
    last: BTreeMap<usize, Vec<Chosen>>,
}

impl Attachments {
    /// Builds supports, loads and effects of a scene.
    pub(super) fn from_scene(
        scene: &SceneSpec,
        bodies: &mut [Body],
        joints: &[BuiltInterface],
        folder: &Path,
    ) -> Result<Self> {
        let mut out = Self::default();
        for (m, motion) in support::motions(scene, bodies, folder)? {
            out.supports.entry(m).or_default().push(motion);
        }
        for (k, l) in scene.load.iter().enumerate() {
            let path = format!("load[{k}]");
            let m = model_index(&format!("{path}.model"), &l.model, scene)?;
            let name = load::name(k, l);
            if zone::parts(scene, m).len() == 1 {
                out.add(m, Box::new(load::on_body(&path, &name, l, &bodies[m])?));
                continue;
            }
            for (m, load_part) in shared::loads(k, m, scene, bodies, joints, folder)? {
                out.add(m, Box::new(load_part));
            }
        }
        for (k, e) in scene.effect.iter().enumerate() {
            for m in effect_models(k, e, scene)? {
                let Some(built) = on_body(k, e, &mut bodies[m])? else {
                    continue;
                };
                // Local damping is a share of all other forces, so it must be evaluated last.
                if let EffectKind::LocalDamping(_) = e.kind {
                    out.last.entry(m).or_default().push(built);
                } else {
                    out.add(m, built);
                }
            }
        }
        Ok(out)
    }

    /// Adds an effect to model `m`.
    pub(super) fn add(&mut self, m: usize, effect: Chosen) {
        self.effects.entry(m).or_default().push(effect);
    }

    /// Attaches supports and effects of model `m` to its subdomain.
    pub(super) fn attach(&mut self, m: usize, mut subdomain: Subdomain<f64>) -> Subdomain<f64> {
        for s in self.supports.remove(&m).unwrap_or_default() {
            subdomain = subdomain.with_support(s);
        }
        for list in [&mut self.effects, &mut self.last] {
            for e in list.remove(&m).unwrap_or_default() {
                subdomain = subdomain.with_effect(e);
            }
        }
        subdomain
    }
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

/// Builds an effect that does not depend on the body; `None` for the other kinds.
pub(super) fn simple_effect(k: usize, e: &Effect) -> Result<Option<Chosen>> {
    let located = |name: &str| core(format!("effect[{k}].{}.{name}", e.kind.key()));
    Ok(Some(match &e.kind {
        EffectKind::BodyForce(b) => {
            let force = BodyForce::new(Vector3::from(b.acceleration));
            let time = time_function(&format!("effect[{k}].body_force.time"), &b.time)?;
            let force = force.and_then(|b| b.over_time(time));
            Box::new(force.map_err(core(format!("effect[{k}]")))?)
        }
        EffectKind::MassDamping(d) => Box::new(MassDamping::new(d.rate).map_err(located("rate"))?),
        EffectKind::StiffnessDamping(d) => Box::new(StiffnessDamping::new(d.time).map_err(located("time"))?),
        EffectKind::LocalDamping(d) => Box::new(LocalDamping::new(d.share).map_err(located("share"))?),
        EffectKind::Prestress(_) => Box::new(Prestress),
        EffectKind::BulkViscosity(_)
        | EffectKind::Fracture(_)
        | EffectKind::Contact(_)
        | EffectKind::Obstacle(_) => return Ok(None),
    }))
}

/// Builds effect `k` for a body; `None` if the effect is off or part of the model (fracture).
fn on_body(k: usize, e: &Effect, body: &mut Body) -> Result<Option<Chosen>> {
    if !e.enabled {
        return Ok(None);
    }
    if let Some(simple) = simple_effect(k, e)? {
        return Ok(Some(simple));
    }
    let path = format!("effect[{k}].{}", e.kind.key());
    match &e.kind {
        EffectKind::BulkViscosity(b) => {
            if body.model.layout().components != 3 {
                let rule = format!("needs {SOLID}, which model '{}' is not", body.model.name());
                return Err(key(path, rule));
            }
            let impedance = |m: &Elastic<f64>| (m.p_wave_modulus() * m.density()).sqrt();
            let main = impedance(material(&path, body)?);
            let viscosity = BulkViscosity::new(body.field.clone(), b.coefficient, main);
            let mut viscosity = viscosity.map_err(core(format!("{path}.coefficient")))?;
            if let Some((materials, n)) = body.materials.as_ref().and_then(|m| Some((m, m.elements()?))) {
                viscosity = viscosity.with_impedances((0..n).map(|e| impedance(materials.at(e))).collect());
            }
            Ok(Some(Box::new(viscosity)))
        }
        EffectKind::Fracture(_) => Ok(None),
        _ => match body.grains.as_mut().and_then(|g| g.effects.remove(&k)) {
            None => Err(key(path, "is made for no model; remove it")),
            effect => Ok(effect),
        },
    }
}

/// Requirement of bulk viscosity, and the alternative for a line model.
const SOLID: &str = "a solid of kind = \"fem\" or \"cnem\" (a line can have stiffness_damping)";

/// Numbers of the models that an effect acts on: the named ones, or all that can have it.
pub fn effect_models(k: usize, e: &Effect, scene: &SceneSpec) -> Result<Vec<usize>> {
    let path = format!("effect[{k}]");
    if super::between::sides(k, e, scene)?.is_some() {
        return Ok(Vec::new());
    }
    let (what, bearer) = (e.kind.key(), e.kind.bearer());
    let tables: Vec<&ModelTable> = scene.model.values().collect();
    let fits = |m: &usize| match bearer {
        Bearer::Any => true,
        Bearer::Solids => tables[*m].has_volume(),
        Bearer::Particles => tables[*m].kind == ModelKind::Dem,
    };
    let models = model_indices(&path, e.models.as_deref(), scene)?;
    if let (Some(names), Some(misfit)) = (&e.models, models.iter().position(|m| !fits(m))) {
        let requirement = match bearer {
            Bearer::Particles => "kind = \"dem\"",
            _ => SOLID,
        };
        let rule = format!(
            "{what} needs {requirement}, which model '{}' is not",
            names[misfit]
        );
        return Err(key(format!("{path}.models[{misfit}]"), rule));
    }
    // Gravity on a body also acts on its zones; damping may be meant for one model only.
    let models = match (&e.kind, &e.models) {
        (EffectKind::BodyForce(_), Some(_)) => zone::with_parts(scene, models, |name| {
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

/// Initial displacements and velocities of model `m`.
pub(super) fn initial(scene: &SceneSpec, m: usize, body: &Body) -> Result<[Vec<f64>; 2]> {
    let layout = body.model.layout();
    let (mut q, mut v) = (vec![0.0; layout.dofs()], vec![0.0; layout.dofs()]);
    for (k, i) in scene.initial.iter().enumerate() {
        let path = format!("initial[{k}]");
        check_initial(&path, i)?;
        let named = model_indices(&path, i.models.as_deref(), scene)?;
        let elsewhere = |name: &str| {
            let named_models = scene.initial.iter().filter_map(|o| o.models.as_ref());
            named_models.flatten().any(|n| n == name)
        };
        if !zone::with_parts(scene, named, elsewhere).contains(&m) {
            continue;
        }
        if let Some(s) = &i.spin {
            spin(&path, s, body, &mut v)?;
        }
        let speeds = match &i.wave {
            Some(w) if w.speed.is_none() => bar_speeds(&path, body)?,
            _ => Vec::new(),
        };
        for (n, x) in body.model.nodes().iter().enumerate() {
            let dofs = n * layout.components..(n + 1) * layout.components;
            let add = |target: &mut [f64], value: Vector3<f64>| {
                for (t, c) in target[dofs.clone()].iter_mut().zip(value.iter()) {
                    *t += c;
                }
            };
            if let Some(f) = &i.displacement {
                add(&mut q, field_at(f, x));
            }
            if let Some(f) = &i.velocity {
                add(&mut v, field_at(f, x));
            }
            if let Some(w) = &i.wave {
                let speed = w.speed.or_else(|| speeds.get(n).copied()).unwrap_or_default();
                let (u, du) = wave_at(w, x, speed);
                add(&mut q, u);
                add(&mut v, du);
            }
        }
    }
    Ok([q, v])
}

/// Adds the velocities of a rigid rotation, and the angular velocities of nodes that can rotate.
fn spin(path: &str, s: &Spin, body: &Body, v: &mut [f64]) -> Result<()> {
    let layout = body.model.layout();
    if layout.components != 3 {
        return Err(key(
            format!("{path}.spin"),
            "a model that moves along x only cannot turn; list the others in models",
        ));
    }
    let (rate, centre) = (Vector3::from(s.rate), Point3::from(s.centre));
    for (v, x) in v.chunks_exact_mut(3).zip(body.model.nodes()) {
        let turn = rate.cross(&(x - centre));
        v.iter_mut().zip(turn.iter()).for_each(|(v, t)| *v += t);
    }
    if layout.turns() {
        for (k, v) in v[layout.translations()..].iter_mut().enumerate() {
            *v += rate[k % 3];
        }
    }
    Ok(())
}

pub(super) fn check_initial(path: &str, i: &Initial) -> Result<()> {
    if i.displacement.is_none() && i.velocity.is_none() && i.spin.is_none() && i.wave.is_none() {
        return Err(key(path, "needs displacement, velocity, spin or wave"));
    }
    match &i.wave {
        Some(w) if w.width <= 0.0 => Err(value(
            format!("{path}.wave.width"),
            w.width,
            "must be positive [m]",
        )),
        _ => Ok(()),
    }
}

fn along(axis: Axis, length: f64) -> Vector3<f64> {
    let mut v = Vector3::zeros();
    v[axis.index()] = length;
    v
}

fn field_at(field: &Field, x: &Point3<f64>) -> Vector3<f64> {
    match field {
        Field::Uniform(v) => Vector3::from(*v),
        Field::Polynomial(p) => {
            let s = x[p.along.index()];
            along(
                p.component,
                p.coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c),
            )
        }
    }
}

/// Displacement and velocity of the travelling wave `A cos²(π (x − centre)/width)`, with `u̇ = −c u'`.
fn wave_at(w: &Wave, x: &Point3<f64>, speed: f64) -> (Vector3<f64>, Vector3<f64>) {
    let s = (x[w.along.index()] - w.centre) / w.width;
    if s.abs() >= 0.5 {
        return (Vector3::zeros(), Vector3::zeros());
    }
    let u = w.amplitude * (PI * s).cos().powi(2);
    let slope = -w.amplitude * PI / w.width * (2.0 * PI * s).sin();
    (along(w.component, u), along(w.component, -speed * slope))
}

//! Supports, loads, effects and initial states.

use super::body::RigidBodies;
use super::body::{Body, bar_speeds, material};
use super::interface::BuiltInterface;
use super::kinds::kind;
use super::names::{SOLID, effect_models, headline, loaded_parts, model_index, model_indices, with_parts};
use super::obstacle;
use super::time::time_function;
use super::{fracture, grains, load, shared, support};
use crate::error::{Result, core, key, value};
use crate::setup::LoweredScene;
use crate::spec::{Axis, Effect, EffectKind, Field, Initial, Spin, Wave};
use arlequin::core::effect::{
    self, BodyForce, BulkViscosity, LocalDamping, MassDamping, Prestress, StiffnessDamping,
};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Elastic, PrescribedMotion, Subdomain, invalid};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::path::Path;

/// Angle \[rad\] up to which bodies with small displacements may turn: strains are then off by half a per
/// cent at most.
const SMALL_TURN: f64 = 0.1;
/// Angle \[rad\] up to which such a body may turn with particles of finite rotations, which feel a strain of
/// half its square: 1e-4, a tenth of the strain at which brittle bodies break.
const TIED_TURN: f64 = 0.0142;

/// An effect that is not yet attached to a model.
pub(super) type Chosen = Box<dyn effect::EffectSpec<f64>>;

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
        scene: &LoweredScene,
        bodies: &mut [Body],
        rigid: &[RigidBodies],
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
            if loaded_parts(scene, m).len() == 1 {
                out.add(m, load::build(&path, &name, l, &bodies[m])?);
                continue;
            }
            for (m, load_part) in shared::loads(k, m, scene, bodies, joints, folder)? {
                out.add(m, Box::new(load_part));
            }
        }
        for (k, e) in scene.effect.iter().enumerate() {
            for m in effect_models(k, e, scene)? {
                let Some(built) = on_body(k, e, &mut bodies[m], &rigid[m])? else {
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

/// Checks the numbers of effect `k` before anything is built.
pub(super) fn check(k: usize, e: &Effect, scene: &LoweredScene) -> Result<()> {
    let path = format!("effect[{k}].{}", e.kind.key());
    match &e.kind {
        EffectKind::Fracture(f) => fracture::check(k, e, f, scene),
        // Any modulus: only the other numbers are checked.
        EffectKind::Contact(c) => grains::law(1.0, c).check().map_err(core(path)),
        EffectKind::Obstacle(o) => {
            headline(&path, o.name.as_deref())?;
            obstacle::obstacle_parts(k, o)?;
            let law = grains::law(1.0, &o.contact);
            law.check().map_err(core(format!("{path}.contact")))
        }
        EffectKind::BulkViscosity(b) if b.coefficient < 0.0 => {
            let rule = "must not be negative [-]; the usual one is 0.06";
            let wrong = invalid("bulk viscosity coefficient", b.coefficient, rule);
            Err(core(format!("{path}.coefficient"))(wrong))
        }
        EffectKind::BodyForce(_)
        | EffectKind::MassDamping(_)
        | EffectKind::StiffnessDamping(_)
        | EffectKind::LocalDamping(_)
        | EffectKind::BulkViscosity(_)
        | EffectKind::Prestress(_) => simple_effect(k, e).map(|_| ()),
    }
}

/// Builds an effect that does not depend on the body; `None` for the other kinds.
fn simple_effect(k: usize, e: &Effect) -> Result<Option<Chosen>> {
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

/// Builds the effects of model `m` anew for a change of weights, in the order in which [`Attachments`] has
/// them: those before an absorber, and those after all others. `None` for contacts and obstacles, which stay.
pub(super) fn effects_anew(scene: &LoweredScene, m: usize) -> Result<[Vec<Option<Chosen>>; 2]> {
    let mut out = [Vec::new(), Vec::new()];
    for (k, e) in scene.effect.iter().enumerate().filter(|(_, e)| e.enabled) {
        if !effect_models(k, e, scene)?.contains(&m) {
            continue;
        }
        match e.kind {
            EffectKind::Contact(_) | EffectKind::Obstacle(_) => out[0].push(None),
            EffectKind::LocalDamping(_) => out[1].extend(simple_effect(k, e)?.map(Some)),
            _ => out[0].extend(simple_effect(k, e)?.map(Some)),
        }
    }
    Ok(out)
}

/// Builds effect `k` for a body; `None` if the effect is off or part of the model (fracture).
fn on_body(k: usize, e: &Effect, body: &mut Body, rigid: &RigidBodies) -> Result<Option<Chosen>> {
    if !e.enabled {
        return Ok(None);
    }
    let path = format!("effect[{k}].{}", e.kind.key());
    match &e.kind {
        EffectKind::BodyForce(_)
        | EffectKind::MassDamping(_)
        | EffectKind::StiffnessDamping(_)
        | EffectKind::LocalDamping(_)
        | EffectKind::Prestress(_) => simple_effect(k, e),
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
        EffectKind::Obstacle(o) if body.grains.is_none() => {
            let contact = rigid.get(&k).map(|r| obstacle::on_surface(&path, o, r, body));
            contact.transpose()
        }
        EffectKind::Contact(_) | EffectKind::Obstacle(_) => {
            match body.grains.as_mut().and_then(|g| g.effects.remove(&k)) {
                None => Err(key(path, "is made for no model; remove it")),
                effect => Ok(effect),
            }
        }
    }
}

/// Returns the models that an entry of `[[initial]]` moves.
fn moved_models(scene: &LoweredScene, path: &str, i: &Initial) -> Result<BTreeSet<usize>> {
    let named = model_indices(path, i.models.as_deref(), scene)?;
    let elsewhere = |name: &str| {
        let named_models = scene.initial.iter().filter_map(|o| o.models.as_ref());
        named_models.flatten().any(|n| n == name)
    };
    Ok(with_parts(scene, named, elsewhere).into_iter().collect())
}

/// Warns of spins that turn a model further than its small displacements allow, in a run up to time `last`
/// \[s\].
pub(super) fn wide_turns(scene: &LoweredScene, last: f64) -> Vec<String> {
    // The spins of a model add up.
    let mut spins: BTreeMap<usize, (Vector3<f64>, Vec<String>)> = BTreeMap::new();
    for (k, i) in scene.initial.iter().enumerate() {
        let Some(s) = &i.spin else { continue };
        for m in moved_models(scene, &format!("initial[{k}]"), i).unwrap_or_default() {
            let (rate, keys) = spins.entry(m).or_default();
            *rate += Vector3::from(s.rate);
            keys.push(format!("initial[{k}].spin"));
        }
    }
    let mut out = Vec::new();
    for (m, (rate, keys)) in spins {
        let turn = rate.norm() * last;
        let Some((name, table)) = scene.model.iter().nth(m) else {
            continue;
        };
        // Only the program behind a link knows how far its law holds.
        if kind(table.kind).is_remote() {
            continue;
        }
        let verb = if keys.len() == 1 { "turns" } else { "turn" };
        let begin = format!(
            "model '{name}': {} {verb} it by {turn:.3} rad, and",
            keys.join(" and ")
        );
        let remedy = match kind(table.kind).has_spheres() {
            true if table.dem.finite_rotations => continue,
            true => "set dem.finite_rotations = true",
            false => "take kind = \"dem\" with dem.finite_rotations = true, or a shorter run",
        };
        if turn > SMALL_TURN {
            out.push(format!(
                "{begin} its law holds up to {SMALL_TURN} rad: beyond, it knows no centrifugal load and its points leave along \
                 straight lines; {remedy}"
            ));
        } else if let Some(other) = tied_with_finite_rotations(scene, name).filter(|_| turn > TIED_TURN) {
            out.push(format!(
                "{begin} its linear law lets it grow by {:.2} % as it turns; '{other}' with dem.finite_rotations is strained by \
                 that: leave dem.finite_rotations out, or take a shorter run",
                50.0 * turn * turn
            ));
        }
    }
    out
}

/// Returns a model with finite rotations that an interface ties to this one.
fn tied_with_finite_rotations<'a>(scene: &'a LoweredScene, name: &str) -> Option<&'a str> {
    let pairs = scene
        .interface
        .values()
        .flat_map(|i| [(&i.coarse, &i.fine), (&i.fine, &i.coarse)]);
    let mut partners = pairs
        .filter(|(model, _)| *model == name)
        .map(|(_, partner)| partner);
    let turns_freely = |partner: &&String| scene.model.get(*partner).is_some_and(|m| m.dem.finite_rotations);
    partners.find(turns_freely).map(String::as_str)
}

/// Initial displacements and velocities of model `m`.
pub(super) fn initial(scene: &LoweredScene, m: usize, body: &Body) -> Result<[Vec<f64>; 2]> {
    let layout = body.model.layout();
    let (mut q, mut v) = (vec![0.0; layout.dofs()], vec![0.0; layout.dofs()]);
    for (k, i) in scene.initial.iter().enumerate() {
        let path = format!("initial[{k}]");
        check_initial(&path, i)?;
        // After the check: an entry that moves no model is checked as well.
        if !moved_models(scene, &path, i)?.contains(&m) {
            continue;
        }
        if let Some(s) = &i.spin {
            spin(&path, s, body, &mut v)?;
        }
        // Speeds are worked out only for a wave that gives none.
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
    // Nodes turn with the body: without their spins, bonds would be bent from the first step on.
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
                // Horner's rule, from the highest power down.
                p.coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c),
            )
        }
    }
}

/// Displacement and velocity of the travelling wave `A cos²(π (x − centre)/width)`, with `u̇ = −c u'`.
fn wave_at(w: &Wave, x: &Point3<f64>, speed: f64) -> (Vector3<f64>, Vector3<f64>) {
    let s = (x[w.along.index()] - w.centre) / w.width;
    // The formula repeats itself outside of its one period, and the wave does not.
    if s.abs() >= 0.5 {
        return (Vector3::zeros(), Vector3::zeros());
    }
    let u = w.amplitude * (PI * s).cos().powi(2);
    let slope = -w.amplitude * PI / w.width * (2.0 * PI * s).sin();
    (along(w.component, u), along(w.component, -speed * slope))
}

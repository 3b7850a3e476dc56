//! Set-up: builds a run that is ready to step from the tables of a scene.

mod between;
mod body;
mod bounds;
mod built;
mod clock;
mod cloud;
mod drive;
mod faces;
mod files;
pub mod filling;
mod formula;
pub(crate) mod fracture;
mod grains;
mod holdings;
mod interface;
mod kind;
mod kinds;
mod load;
pub(crate) mod lower;
mod lowered;
mod materials;
mod mediator;
mod mesh;
mod names;
mod notch;
mod obstacle;
mod origin;
pub mod packing;
mod particle_warnings;
mod partners;
mod places;
mod plausible;
mod precheck;
mod probe;
mod profile;
mod rigid;
mod select;
mod shapes;
mod shared;
mod skin;
mod slit;
mod spread;
mod statics;
mod support;
mod time;
mod totals;
mod weights;
pub mod zone;

pub use between::ParticlesWithoutContact;
pub use body::Body;
pub use bounds::Bounds;
pub use built::{Built, ModelInfo};
pub use clock::PhaseTime;
pub(crate) use files::text;
pub(crate) use fracture::stops_at_overlap;
pub(crate) use interface::{BuiltInterface, stations};
pub(crate) use kind::Feature;
pub(crate) use kinds::kind;
pub(crate) use kinds::link_of;
pub use lowered::{BodyShape, LoweredInterface, LoweredModel, LoweredScene, OverlapSource};
pub use mesh::Grid;
pub(crate) use names::BODY;
pub use names::{effect_models, model_index};
pub use notch::{Knife, cut, knives};
pub(crate) use obstacle::{locate_files, obstacle_parts};
pub use probe::{ProbeReader, Readings};
pub use rigid::RigidPicture;
pub use statics::LoadSteps;
pub use zone::{Bar, Moving, Share};

use crate::error::{Result, core, key, value};
use crate::ranks::{RankLine, Ranks};
use crate::spec::{Effect, Support};
use arlequin::core::{Coupled, Guard, OwnStep, Partition, Parts, SetupPhase, Subdomain, Weighting};
use body::RigidBodies;
use clock::SetupClock;
use drive::Attachments;
use kind::Order;
use std::path::Path;

/// Builds the run that a scene describes.
///
/// # Errors
/// Mistakes in the scene: the key, its value, the limit and the remedy.
pub fn build(scene: &LoweredScene, folder: &Path) -> Result<Built> {
    build_from(scene, folder, &Ranks::default(), &mut |_, _, _| ())
}

/// Checks what can be checked from the scene alone, without building anything.
pub fn check(scene: &LoweredScene, folder: &Path) -> Result<()> {
    let scene = &formula::with_tables(scene, folder)?;
    statics::load_steps(scene, folder)?;
    check_numbers(scene)?;
    check_names(scene)?;
    precheck::models(scene, folder)?;
    let (scene, _) = zone::with_probes_in_zones(scene, folder)?;
    precheck::scene(&scene, folder).map(|_| ())
}

/// Builds a run on one or several ranks, among which bodies are partitioned;
/// `announce` is that of [`crate::Scene::prepare_with`].
pub(crate) fn build_from(
    scene: &LoweredScene,
    folder: &Path,
    ranks: &Ranks,
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<Built> {
    let mut clock = SetupClock::new(announce);
    let scene = &formula::with_tables(scene, folder)?;
    let load_steps = statics::load_steps(scene, folder)?;
    check_numbers(scene)?;
    check_names(scene)?;
    zone::check_ranks(scene, ranks)?;
    precheck::models(scene, folder)?;
    let (scene, split_probes) = &zone::with_probes_in_zones(scene, folder)?;
    let checked = precheck::scene(scene, folder)?;
    let rigid_bodies = obstacle::rigid_bodies(scene)?;
    let mut bodies = bodies_of(scene, &checked.effects, &rigid_bodies, folder, &mut clock)?;
    clock.begin("mediators, probes and effects".to_owned());
    let interfaces = checked.interfaces.iter().map(|plan| plan.build(&bodies));
    let mut interfaces = interfaces.collect::<Result<Vec<_>>>()?;
    let probes = scene.probe.iter();
    let probes = probes.map(|(n, p)| ProbeReader::new(n, p, scene, &bodies, &interfaces));
    let probes: Vec<ProbeReader> = probes.collect::<Result<_>>()?;
    let attachments = Attachments::from_scene(scene, &mut bodies, &rigid_bodies, &interfaces, folder)?;
    let pairs = between::pairs(scene, &bodies)?;
    let without_contact = ParticlesWithoutContact::from_scene(scene, &bodies)?;
    let (bounds, mut warnings) = bounds_of(scene, &bodies, &interfaces);
    warnings.extend(probes.iter().filter_map(|p| p.warning(&bodies)));
    warnings.extend(split_probes.iter().cloned());
    warnings.extend(zone::closed_notches(scene, folder)?);
    warnings.extend(checked.narrow.clone());
    let zones = zone::lines(scene, &bodies);
    let forces = totals::collect(scene, &bodies)?;
    let models = bodies.iter().map(ModelInfo::from_body).collect();
    let rigid = rigid::pictures(scene, &bodies)?;
    let mediators = interfaces.iter().map(|j| j.grid.clone()).collect();
    let moving = Moving::from_scene(scene, &interfaces, &mut bodies, folder)?;
    let states = bodies.iter().enumerate();
    let states = states.map(|(m, body)| drive::initial(scene, m, body));
    let states: Vec<State> = states.collect::<Result<_>>()?;
    // Decided from the bodies, which the subdomains take over below.
    let mut holdings = holdings::holdings(scene, &bodies, ranks.count());
    let subdomains = subdomains_of(scene, bodies, states, &mut interfaces, attachments)?;
    let last_load = load_steps.as_ref().and_then(|s| s.times.last().copied());
    let parts = Parts {
        start: 0.0,
        end: last_load.or(scene.time.end),
        subdomains: shared_out(subdomains, &holdings, ranks),
        interfaces: interfaces.into_iter().map(|j| j.spec).collect(),
        pairs,
    };
    let mut run = coupled(scene, parts, &mut clock)?;
    let steps = step_count(scene, load_steps.as_ref(), &mut run)?;
    for (line, s) in holdings.iter_mut().zip(run.subdomains()) {
        line.add_imbalance(s);
    }
    warnings.extend(warnings_when_coupled(scene, &forces, &run));
    let mut built = Built {
        load_steps,
        models,
        mediators,
        rigid,
        probes,
        steps,
        frame_every: time::frames(scene, steps, run.dt()),
        without_contact,
        warnings,
        bounds,
        zones,
        moving,
        holdings,
        run,
        phases: Vec::new(),
    };
    clock.begin("plausibility of the scene".to_owned());
    // Last: the judgement needs steps, frames and models as they will run.
    let odd = plausible::warnings(scene, &built);
    built.warnings.extend(odd);
    built.phases = clock.finish();
    Ok(built)
}

/// Number of steps of a run. Refuses bodies of a scene at rest that are free to move.
fn step_count(scene: &LoweredScene, load_steps: Option<&LoadSteps>, run: &mut Coupled<f64>) -> Result<usize> {
    match load_steps {
        Some(s) => {
            run.check_rest().map_err(core("static"))?;
            Ok(s.times.len())
        }
        None => time::steps(scene, run.dt()),
    }
}

/// Builds the models of a scene and its interfaces, uncoupled, without supports, loads and initial states.
///
/// # Errors
/// Errors of [`build`].
pub(crate) fn parts(
    scene: &LoweredScene,
    folder: &Path,
    announce: &mut dyn FnMut(&str, usize, usize),
) -> Result<(Vec<Body>, Vec<BuiltInterface>)> {
    let mut clock = SetupClock::new(announce);
    check_names(scene)?;
    precheck::models(scene, folder)?;
    let checked = precheck::scene(scene, folder)?;
    let bodies = bodies_of(
        scene,
        &checked.effects,
        &obstacle::rigid_bodies(scene)?,
        folder,
        &mut clock,
    )?;
    let interfaces = interfaces_of(scene, folder, &bodies)?;
    Ok((bodies, interfaces))
}

/// Builds the interfaces of a scene between bodies that exist.
///
/// # Errors
/// Errors of [`build`].
pub(crate) fn interfaces_of(
    scene: &LoweredScene,
    folder: &Path,
    bodies: &[Body],
) -> Result<Vec<BuiltInterface>> {
    let plans = scene.interface.iter();
    let plans = plans.map(|(name, table)| interface::Plan::new(name, table, scene, folder)?.build(bodies));
    plans.collect()
}

/// Marks the models that are distributed over the ranks.
fn shared_out(subdomains: Vec<Subdomain<f64>>, holdings: &[RankLine], ranks: &Ranks) -> Vec<Subdomain<f64>> {
    let Some(c) = ranks.communicator() else {
        return subdomains;
    };
    let shared = |(s, line): (Subdomain<f64>, &RankLine)| if line.parts { s.shared(c.clone()) } else { s };
    subdomains.into_iter().zip(holdings).map(shared).collect()
}

/// Couples the models; errors get the key of what the core worked on.
fn coupled(scene: &LoweredScene, parts: Parts<f64>, clock: &mut SetupClock<'_>) -> Result<Coupled<f64>> {
    let names = [
        scene.model.keys().cloned().collect(),
        scene.interface.keys().cloned().collect(),
    ];
    // The phase in which the core stops tells which object an error is about.
    let mut last_phase = SetupPhase::Start;
    let mut announce_phase = |phase| {
        last_phase = phase;
        clock.begin(clock::name(phase, &names));
    };
    let run = Coupled::announced(parts, time::step(scene), Some(guard(scene)), &mut announce_phase);
    run.map_err(|e| origin::in_phase(scene, last_phase, e))
}

/// Warnings that the coupled models show: those of interfaces, and about loads that no model carries.
fn warnings_when_coupled(scene: &LoweredScene, forces: &[totals::Total], run: &Coupled<f64>) -> Vec<String> {
    let mut out = Vec::new();
    for i in run.interfaces().iter().map(|i| i.report()) {
        out.extend(i.warnings.iter().map(|w| format!("interface '{}': {w}", i.name)));
    }
    out.extend(totals::warnings(scene, forces, run));
    out
}

/// Bounds of a plausible motion of each model, and the warnings about bodies and interfaces.
fn bounds_of(scene: &LoweredScene, bodies: &[Body], interfaces: &[BuiltInterface]) -> (Bounds, Vec<String>) {
    let mut bounds = Bounds::default();
    let mut warnings = Vec::new();
    for (m, body) in bodies.iter().enumerate() {
        let name = body.model.name();
        warnings.extend(body.warnings.iter().map(|w| format!("model '{name}': {w}")));
        let small = !may_leave(scene, m);
        bounds.add(body.model.nodes(), &body.shape, body.material.as_ref(), small);
    }
    for j in interfaces {
        let name = &j.spec.name;
        warnings.extend(j.advice.iter().map(|a| format!("interface '{name}': {a}")));
    }
    (bounds, warnings)
}

fn bodies_of(
    scene: &LoweredScene,
    effects: &[Vec<(usize, &Effect)>],
    rigid: &[RigidBodies],
    folder: &Path,
    clock: &mut SetupClock<'_>,
) -> Result<Vec<Body>> {
    let mut out: Vec<Option<Body>> = scene.model.iter().map(|_| None).collect();
    // A packing may take minutes, so mistakes in the other models are reported first.
    for packed in [false, true] {
        for (m, (name, table)) in scene.model.iter().enumerate() {
            if kind(table.kind).has_spheres() != packed {
                continue;
            }
            // Supports of a body also act on its zones.
            let holds = |s: &Support| s.model == **name || scene.zone.contains_key(name) && s.model == BODY;
            let numbered = scene.support.iter().enumerate();
            let supports: Vec<_> = numbered.filter(|(_, s)| holds(s)).collect();
            let order = Order {
                name,
                key: &format!("model.{name}"),
                table,
                folder,
                effects: &effects[m],
                rigid: Some(&rigid[m]),
                supports: &supports,
            };
            out[m] = Some(kinds::build(&order, clock)?);
        }
        if !packed {
            places::check_meshes(scene, &out, folder)?;
        }
    }
    Ok(out.into_iter().flatten().collect())
}

/// Initial displacements and velocities of a model.
type State = [Vec<f64>; 2];

fn subdomains_of(
    scene: &LoweredScene,
    bodies: Vec<Body>,
    states: Vec<State>,
    interfaces: &mut [BuiltInterface],
    mut attachments: Attachments,
) -> Result<Vec<Subdomain<f64>>> {
    // Absorbers are effects of the fine model, so they are added before effects are attached.
    for j in &mut *interfaces {
        if let Some(a) = j.absorber.take() {
            attachments.add(j.spec.fine, Box::new(a));
        }
    }
    let sleeps = lower::following(scene).is_some();
    let in_step = obstacle::in_step(scene)?;
    let subdomain_from = |(m, (body, state)): (usize, (Body, State))| {
        let mut own_step = time::own_step(scene, m);
        if matches!(own_step, OwnStep::Same) && in_step.contains(&m) {
            own_step = OwnStep::Ratio(1);
        }
        let built = subdomain(m, (body, state), interfaces, &mut attachments)?.with_step(own_step);
        Ok(if sleeps { built.with_sleep() } else { built })
    };
    bodies
        .into_iter()
        .zip(states)
        .enumerate()
        .map(subdomain_from)
        .collect()
}

/// Returns whether parts of a model may rotate or move away: particles with finite rotations, contact or
/// bonds that break.
fn may_leave(scene: &LoweredScene, m: usize) -> bool {
    let loose = scene
        .effect
        .iter()
        .any(|e| e.enabled && e.kind.bearer().touches());
    let table = scene.model.values().nth(m).filter(|t| kind(t.kind).has_spheres());
    table.is_some_and(|t| loose || t.dem.finite_rotations)
}

fn guard(scene: &LoweredScene) -> Guard<f64> {
    let nodal = scene
        .interface
        .values()
        .any(|i| i.weight.weighting == Weighting::Nodal);
    // Nodal weights do not conserve the energy, so the guard has to allow for growth.
    let weighting = if nodal {
        Weighting::Nodal
    } else {
        Weighting::Energy
    };
    Guard {
        interval: scene.output.energy_every,
        ..Guard::for_weighting(weighting)
    }
}

fn check_numbers(scene: &LoweredScene) -> Result<()> {
    time::check(scene)?;
    let output = &scene.output;
    let counts = [
        ("every", output.every.unwrap_or(1)),
        ("probe_every", output.probe_every),
        ("checkpoint_every", output.checkpoint_every.unwrap_or(1)),
        ("energy_every", output.energy_every),
    ];
    if let Some((name, _)) = counts.iter().find(|(_, n)| *n == 0) {
        return Err(value(format!("output.{name}"), 0, "must be at least 1 step"));
    }
    match (output.interval, output.every) {
        (Some(_), Some(_)) => Err(key("output", "every and interval exclude each other; remove one")),
        (Some(t), _) if t <= 0.0 => Err(value("output.interval", t, "must be positive [s]")),
        _ => Ok(()),
    }
}

/// Refuses names that cannot be part of file names and column titles.
fn check_names(scene: &LoweredScene) -> Result<()> {
    let tables = [
        ("model", scene.model.keys().collect::<Vec<_>>()),
        ("interface", scene.interface.keys().collect()),
        ("probe", scene.probe.keys().collect()),
        ("curve", scene.curve.keys().collect()),
    ];
    for (table, names) in tables {
        for name in names {
            let good = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            if name.is_empty() || !name.chars().all(good) {
                let rule =
                    "has a name with other signs than a-z, A-Z, 0-9, - and _; it also names files: rename it";
                return Err(key(format!("{table}.{name}"), rule));
            }
        }
    }
    Ok(())
}

fn subdomain(
    m: usize,
    (body, [q, v]): (Body, [Vec<f64>; 2]),
    joints: &[BuiltInterface],
    attachments: &mut Attachments,
) -> Result<Subdomain<f64>> {
    let path = format!("model.{}", body.model.name());
    let weights = weights::model_weights(m, joints)?;
    // One unchecked interface frees the models on both of its sides.
    let free = |j: &&BuiltInterface| {
        j.partition == Partition::Unchecked && [j.spec.coarse, j.spec.fine].contains(&m)
    };
    let partition = joints
        .iter()
        .find(free)
        .map_or(Partition::Checked, |j| j.partition);
    let subdomain = match body.solver {
        Some(solver) => {
            let participant = Subdomain::participant(solver, body.field, weights);
            participant.map_err(core(&*path))?
        }
        None => Subdomain::new(body.model, body.field, weights),
    };
    let subdomain = subdomain.with_partition(partition);
    let subdomain = attachments.attach(m, subdomain);
    subdomain.with_initial(q, v).map_err(core("initial"))
}

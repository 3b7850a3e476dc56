//! Checks of the whole scene before anything is meshed, packed or factorised.

use super::drive::{self, model_index};
use super::kinds;
use super::{
    between, crack, effects_by_model, exerted, grains, interface, link, load, mediator, places, probe,
    select, sides_of,
};
use crate::error::{Result, core, dem, key, unknown, value};
use crate::spec::{
    Axis, Effect, EffectKind, Interface, ModelKind, ModelTable, ProfileKind, SceneSpec, Selection, Shape,
};
use arlequin::core::invalid;
use arlequin::core::nalgebra::Point3;
use std::path::Path;

/// Group names of boxes, balls and cylinders.
const BOX: [&str; 6] = ["x-min", "x-max", "y-min", "y-max", "z-min", "z-max"];
const BALL: [&str; 1] = ["surface"];
const CYLINDER: [&str; 3] = ["x-min", "x-max", "side"];

/// Checks all tables of a scene.
pub(super) fn scene(scene: &SceneSpec, folder: &Path) -> Result<()> {
    if scene.model.is_empty() {
        return Err(key("model", "a scene needs at least one model"));
    }
    for (name, table) in &scene.model {
        spacing(&format!("model.{name}.spacing"), table)?;
        kinds::check(name, table, folder)?;
        super::time::check_own(name, table)?;
    }
    link::check_scene(scene)?;
    for (name, table) in &scene.interface {
        let [c, f] = sides_of(name, table, scene)?;
        let models: Vec<&ModelTable> = scene.model.values().collect();
        interface(name, table, [models[c], models[f]], folder)?;
    }
    let effects = effects_by_model(scene)?;
    for ((name, table), effects) in scene.model.iter().zip(&effects) {
        if table.kind == ModelKind::Dem {
            grains::check_loose(&format!("model.{name}"), table, effects)?;
            grains::check_single(name, effects)?;
        }
    }
    between::touching(scene)?;
    for (k, e) in scene.effect.iter().enumerate() {
        effect(k, e)?;
    }
    acting(scene)?;
    watched(scene)?;
    places::check_fillings(scene, folder)
}

/// Refuses a spacing larger than the body: the body would silently become one element.
fn spacing(path: &str, table: &ModelTable) -> Result<()> {
    let (Some(h), Some([low, high])) = (table.spacing, ends(&table.shape)) else {
        return Ok(());
    };
    let longest = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
    if h <= longest || longest <= 0.0 {
        return Ok(());
    }
    let rule = format!("exceeds the body's longest side of {longest} m; choose a fraction of that");
    Err(value(path, h, &rule))
}

/// Checks supports, loads and initial states.
fn acting(scene: &SceneSpec) -> Result<()> {
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        let table = model(&path, &s.model, scene)?;
        selection(&format!("{path}.where"), &s.at, table)?;
        for (n, c) in s.components.iter().flatten().enumerate() {
            along(&format!("{path}.components[{n}]"), *c, &s.model, table, "[\"x\"]")?;
        }
        if let Some(m) = &s.motion {
            drive::motion(&format!("{path}.motion"), m)?;
        }
    }
    for (k, l) in scene.load.iter().enumerate() {
        let path = format!("load[{k}]");
        headline(&path, l.name.as_deref())?;
        let table = model(&path, &l.model, scene)?;
        selection(&format!("{path}.where"), &l.at, table)?;
        load::check(&path, l)?;
        load::check_surface(&path, l, table)?;
        drive::time_function(&format!("{path}.time"), &l.time)?;
    }
    for (k, i) in scene.initial.iter().enumerate() {
        let path = format!("initial[{k}]");
        drive::check_initial(&path, i)?;
        drive::model_indices(&path, i.models.as_deref(), scene)?;
    }
    Ok(())
}

/// Refuses a name that would break the header of output tables.
fn headline(path: &str, name: Option<&str>) -> Result<()> {
    match name {
        Some(n) if n.trim().is_empty() || n.contains(|c: char| ",;\"".contains(c) || c.is_control()) => {
            let rule = "stands at the head of tables with commas; take letters, digits, spaces, - and _";
            Err(value(format!("{path}.name"), format_args!("{n:?}"), rule))
        }
        _ => Ok(()),
    }
}

/// Checks probes and curves.
fn watched(scene: &SceneSpec) -> Result<()> {
    for (name, p) in &scene.probe {
        let path = format!("probe.{name}");
        if let Some(exerted_name) = &p.of {
            exerted::check(&path, exerted_name, p, scene)?;
            continue;
        }
        let model_name = probe::model(&path, p)?;
        let table = model(&path, model_name, scene)?;
        probe::check(&path, p)?;
        if let Some(c) = &p.crack {
            crack::check(&path, p, c, scene)?;
            continue;
        }
        if !p.quantity.is_recovered() {
            let axis = probe::axis(&path, p)?;
            along(&format!("{path}.component"), axis, model_name, table, "\"x\"")?;
        }
        if let Some(s) = &p.over {
            selection(&format!("{path}.where"), s, table)?;
        }
        if let (Some(x), Some(ends)) = (&p.at, ends(&table.shape)) {
            probe::inside(&path, model_name, &Point3::from(*x), ends)?;
        }
    }
    for (name, c) in &scene.curve {
        for (axis, probe) in [("x", &c.x), ("y", &c.y)] {
            if !scene.probe.contains_key(probe) {
                let path = format!("curve.{name}.{axis}");
                return Err(unknown(path, probe, "probe", scene.probe.keys()));
            }
        }
    }
    Ok(())
}

fn model<'a>(path: &str, name: &str, scene: &'a SceneSpec) -> Result<&'a ModelTable> {
    model_index(&format!("{path}.model"), name, scene)?;
    Ok(&scene.model[name])
}

/// Refuses a direction in which a line model cannot move.
fn along(path: &str, axis: Axis, name: &str, table: &ModelTable, remedy: &str) -> Result<()> {
    if matches!(table.shape, Shape::Bar { .. }) && axis != Axis::X {
        return Err(key(
            path,
            format!("model '{name}' moves along x only; use {remedy}"),
        ));
    }
    Ok(())
}

/// Refuses a group that a generated shape does not have, and a box whose high corner is below its low corner.
fn selection(path: &str, selection: &Selection, table: &ModelTable) -> Result<()> {
    let name = match selection {
        Selection::Box(low, high) => return select::check_box(path, low, high),
        Selection::Group(name) => name,
    };
    let groups: &[&str] = match (&table.shape, table.kind) {
        (Shape::File(_) | Shape::Piece(_) | Shape::Linked, _) => return Ok(()),
        (Shape::Ball { .. }, ModelKind::Dem) => &BALL[..0],
        (Shape::Ball { .. }, _) => &BALL,
        (Shape::Box { .. }, _) => &BOX,
        (Shape::Cylinder { .. }, ModelKind::Dem) | (Shape::Bar { .. }, _) => &CYLINDER[..2],
        (Shape::Cylinder { .. }, _) => &CYLINDER,
    };
    if groups.contains(&name.as_str()) {
        return Ok(());
    }
    let mut groups: Vec<String> = groups.iter().map(|n| (*n).to_owned()).collect();
    groups.sort();
    Err(unknown(path, name, "group of the model", groups.iter()))
}

/// Lowest and highest corner of a shape; `None` if a file, a zone or a link determines them.
fn ends(shape: &Shape) -> Option<[[f64; 3]; 2]> {
    Some(match *shape {
        Shape::Box { low, high, .. } => [low, high],
        Shape::Cylinder { from, length, radius } => {
            let [x, y, z] = from;
            [[x, y - radius, z - radius], [x + length, y + radius, z + radius]]
        }
        Shape::Bar { from, to, .. } => [[from, 0.0, 0.0], [to, 0.0, 0.0]],
        Shape::Ball { centre, radius } => [centre.map(|c| c - radius), centre.map(|c| c + radius)],
        Shape::File(_) | Shape::Piece(_) | Shape::Linked => return None,
    })
}

/// Corners of the bounding box of a shape.
fn corners(shape: &Shape) -> Option<Vec<Point3<f64>>> {
    let ends = ends(shape)?;
    let corner = |k: usize| Point3::new(ends[k & 1][0], ends[(k >> 1) & 1][1], ends[(k >> 2) & 1][2]);
    Some((0..8).map(corner).collect())
}

fn interface(name: &str, table: &Interface, models: [&ModelTable; 2], folder: &Path) -> Result<()> {
    let path = format!("interface.{name}");
    let overlap = interface::overlap(&format!("{path}.overlap"), &table.overlap, folder)?;
    if let (Some(coarse), Some(fine)) = (corners(&models[0].shape), corners(&models[1].shape)) {
        let names = [&table.coarse, &table.fine];
        interface::check_place(&path, &table.overlap, &*overlap, names, [&coarse, &fine])?;
        interface::check_sense(&path, &table.overlap, names, [&coarse, &fine])?;
    }
    // The mediator-compatible profile needs the mediator's stations, which are not known yet: the cubic one
    // takes its place.
    let mut weight = table.weight.clone();
    let known_profile = |p: ProfileKind| match p {
        ProfileKind::MediatorCompatible => ProfileKind::Cubic,
        p => p,
    };
    weight.profile = Some(known_profile(weight.kind()));
    for profile_table in [&mut weight.alpha, &mut weight.beta, &mut weight.gamma]
        .into_iter()
        .flatten()
    {
        profile_table.profile = known_profile(profile_table.profile);
    }
    // Built for their errors only; the spacing of the mediator is not known yet, any positive one will do.
    interface::weights(&path, &weight, &overlap, &[], [false; 2])?;
    interface::junction(&path, table, 1.0)?;
    if let Some(a) = &table.absorber
        && a.rate.is_some() == a.rate_factor.is_some()
    {
        let rule = "needs exactly one of rate [1/s], rate_factor [-]";
        return Err(key(format!("{path}.absorber"), rule));
    }
    let key_path = format!("{path}.mediator");
    // The shape of a link is known only after it has connected.
    if table.mediator.shape.is_none() && models.iter().any(|m| m.kind == ModelKind::Link) {
        return Ok(());
    }
    let shape = mediator::mediator_shape(&key_path, table, models.map(|m| &m.shape))?;
    mediator::mediator(&key_path, table, &shape, 1.0, folder).check()
}

/// Checks the numbers of an effect, independent of the models it acts on.
fn effect(k: usize, e: &Effect) -> Result<()> {
    let path = format!("effect[{k}].{}", e.kind.key());
    match &e.kind {
        EffectKind::Fracture(f) => grains::fracture(&path, f).map(|_| ()),
        // Any modulus: only the other numbers are checked.
        EffectKind::Contact(c) => grains::law(1.0, c).check().map_err(dem(path)),
        EffectKind::Obstacle(o) => {
            headline(&path, o.name.as_deref())?;
            grains::obstacle_parts(k, o)?;
            let law = grains::law(1.0, &o.contact);
            law.check().map_err(dem(format!("{path}.contact")))
        }
        EffectKind::BulkViscosity(b) if b.coefficient < 0.0 => {
            let rule = "must not be negative [-]; the usual one is 0.06";
            let wrong = invalid("bulk viscosity coefficient", b.coefficient, rule);
            Err(core(format!("{path}.coefficient"))(wrong))
        }
        _ => drive::simple_effect(k, e).map(|_| ()),
    }
}

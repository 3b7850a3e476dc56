//! Checks of the whole scene before anything is meshed, packed or factorised.

use super::interface::Plan;
use super::kind::Order;
use super::kinds::{self, kind};
use super::names::{effects_by_model, headline, model_index, model_indices, parts};
use super::shapes::ends;
use super::{between, drive, load, places, probe, select, statics, time, zone};
use crate::error::{Result, key, unknown, value};
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::{Axis, Effect, Quantity, Reading, Selection};
use arlequin::core::nalgebra::Point3;
use std::path::Path;

/// Requests that the checks of a scene prepare for its set-up.
pub(super) struct Checked<'a> {
    /// Effects on each model, with their numbers in the scene.
    pub effects: Vec<Vec<(usize, &'a Effect)>>,
    /// Interfaces, for the models that are built next.
    pub interfaces: Vec<Plan<'a>>,
    /// Warning about a narrow first overlap of a zone that begins empty.
    pub narrow: Option<String>,
}

/// Checks the tables of the models, each by itself.
pub(super) fn models(scene: &LoweredScene, folder: &Path) -> Result<()> {
    if scene.model.is_empty() {
        return Err(key("model", "a scene needs at least one model"));
    }
    for (name, table) in &scene.model {
        let key = format!("model.{name}");
        spacing(&format!("{key}.spacing"), table)?;
        kinds::check(&order(name, &key, table, folder))?;
    }
    Ok(())
}

/// Checks all other tables of a scene, whose models are checked.
pub(super) fn scene<'a>(scene: &'a LoweredScene, folder: &'a Path) -> Result<Checked<'a>> {
    let interfaces = scene.interface.iter();
    let interfaces = interfaces.map(|(name, table)| Plan::new(name, table, scene, folder));
    let interfaces = interfaces.collect::<Result<_>>()?;
    let effects = effects_by_model(scene)?;
    for ((name, table), effects) in scene.model.iter().zip(&effects) {
        let key = format!("model.{name}");
        let order = Order {
            effects,
            ..order(name, &key, table, folder)
        };
        kind(table.kind).check_in(scene, &order)?;
    }
    between::touching(scene)?;
    for (k, e) in scene.effect.iter().enumerate() {
        drive::check(k, e, scene)?;
    }
    acting(scene)?;
    watched(scene)?;
    statics::check_held(scene)?;
    zone::check_anchors(scene, folder)?;
    let narrow = zone::first_overlap(scene, folder)?;
    places::check_fillings(scene, folder)?;
    Ok(Checked {
        effects,
        interfaces,
        narrow,
    })
}

fn order<'a>(name: &'a str, key: &'a str, table: &'a LoweredModel, folder: &'a Path) -> Order<'a> {
    Order {
        name,
        key,
        table,
        folder,
        effects: &[],
        rigid: None,
        supports: &[],
    }
}

/// Refuses a spacing larger than the body: the body would silently become one element.
fn spacing(path: &str, table: &LoweredModel) -> Result<()> {
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
fn acting(scene: &LoweredScene) -> Result<()> {
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        let table = model(&path, &s.model, scene)?;
        selection(&format!("{path}.where"), &s.at, table)?;
        for (n, c) in s.components.iter().flatten().enumerate() {
            along(&format!("{path}.components[{n}]"), *c, &s.model, table, "[\"x\"]")?;
        }
        // A line moves along x alone, and only the program behind a link knows its components.
        let one_way = table.shape.is_line() || matches!(table.shape, BodyShape::Remote);
        if s.motion.is_some() && s.components.is_none() && !one_way {
            let rule = "is missing: a motion moves every component that it names by the same amount; name them, such as [\"x\"], \
                        and hold others by a support of their own";
            return Err(key(format!("{path}.components"), rule));
        }
        if let Some(m) = &s.motion {
            time::motion(&format!("{path}.motion"), m)?;
        }
    }
    for (k, l) in scene.load.iter().enumerate() {
        let path = format!("load[{k}]");
        headline(&path, l.name.as_deref())?;
        let table = model(&path, &l.model, scene)?;
        selection(&format!("{path}.where"), &l.at, table)?;
        load::check(&path, l)?;
        load::check_surface(&path, l, table)?;
        let m = model_index(&format!("{path}.model"), &l.model, scene)?;
        let shared = parts(scene, m).len() > 1;
        load::check_follow(&path, l, table, shared)?;
        time::time_function(&format!("{path}.time"), &l.time)?;
    }
    for (k, i) in scene.initial.iter().enumerate() {
        let path = format!("initial[{k}]");
        drive::check_initial(&path, i)?;
        model_indices(&path, i.models.as_deref(), scene)?;
    }
    Ok(())
}

/// Checks probes and curves.
fn watched(scene: &LoweredScene) -> Result<()> {
    for (name, p) in &scene.probe {
        let path = format!("probe.{name}");
        // A probe of a force names what exerts it and needs no place.
        if let Some(exerted_name) = &p.of {
            probe::check_exerted(&path, exerted_name, p, scene)?;
            continue;
        }
        let model_name = probe::model(&path, p)?;
        let table = model(&path, model_name, scene)?;
        probe::check(&path, p)?;
        let spheres = kind(table.kind).has_spheres();
        if let (Some(_), true) = (&p.crack, spheres) {
            let rule = format!(
                "model '{model_name}' cannot tell the energy that a crack releases: particles have no stresses over a volume; \
                 look at a solid of finite or natural elements"
            );
            return Err(key(format!("{path}.crack"), rule));
        }
        if p.quantity == Quantity::Strain && spheres {
            let rule = format!("model '{model_name}' knows stresses only; take \"stress\"");
            return Err(key(format!("{path}.quantity"), rule));
        }
        if let Some(c) = &p.crack {
            probe::check_crack(&path, p, c, scene)?;
            continue;
        }
        if p.quantity.reading() != Reading::Tensor {
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

fn model<'a>(path: &str, name: &str, scene: &'a LoweredScene) -> Result<&'a LoweredModel> {
    model_index(&format!("{path}.model"), name, scene)?;
    Ok(&scene.model[name])
}

/// Refuses a direction in which a line model cannot move.
fn along(path: &str, axis: Axis, name: &str, table: &LoweredModel, remedy: &str) -> Result<()> {
    if table.shape.is_line() && axis != Axis::X {
        return Err(key(
            path,
            format!("model '{name}' moves along x only; use {remedy}"),
        ));
    }
    Ok(())
}

/// Refuses a group that a generated shape does not have, and a box whose high corner is below its low corner.
fn selection(path: &str, selection: &Selection, table: &LoweredModel) -> Result<()> {
    let name = match selection {
        Selection::Box(low, high) => return select::check_box(path, low, high),
        Selection::Group(name) => name,
    };
    let Some(groups) = kind(table.kind).groups(&table.shape) else {
        return Ok(());
    };
    if groups.contains(&name.as_str()) {
        return Ok(());
    }
    let mut groups: Vec<String> = groups.iter().map(|n| (*n).to_owned()).collect();
    // Sorted for the message.
    groups.sort();
    Err(unknown(path, name, "group of the model", groups.iter()))
}

//! Checks of places that a scene names, before anything is packed: a packing may take minutes.

use super::body::Body;
use super::filling::Filling;
use super::kinds::kind;
use super::{load, names, probe, select, shared};
use crate::error::{Result, unknown, value};
use crate::spec::{ModelTable, SceneSpec, Selection, Shape};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::packing::Container;
use arlequin::dem_beam::packing::size::mean_diameter;
use std::path::Path;

/// Smallest distance of a centre from a wall, as a share of the mean radius.
const DEPTH: f64 = 0.5;

/// Refuses probes, supports and loads that select nothing in the models built so far; models of particles are
/// not built yet.
///
/// # Errors
/// The key, and the extent of its model.
pub(super) fn check_meshes(scene: &SceneSpec, bodies: &[Option<Body>], folder: &Path) -> Result<()> {
    let built = |path: &str, name: &str| {
        let m = names::model_index(&format!("{path}.model"), name, scene)?;
        Ok(bodies[m].as_ref().map(|body| (m, body)))
    };
    for (name, p) in &scene.probe {
        let (path, Some(model_name), Some(point)) = (format!("probe.{name}"), &p.model, &p.at) else {
            continue;
        };
        let Some((_, body)) = built(&path, model_name)? else {
            continue;
        };
        if let Err(e) = probe::placed(&path, model_name, point, body) {
            return Err(in_zone(&path, model_name, point, body, folder)?.unwrap_or(e));
        }
    }
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        match built(&path, &s.model)? {
            Some((m, body)) if names::parts(scene, m).len() == 1 => {
                select::nodes(&format!("{path}.where"), body, &s.at)?;
            }
            _ => {}
        }
    }
    for (k, l) in scene.load.iter().enumerate() {
        let path = format!("load[{k}]");
        let Some((m, body)) = built(&path, &l.model)? else {
            continue;
        };
        match names::parts(scene, m).len() {
            1 => load::on_body(&path, &load::name(k, l), l, body).map(|_| ())?,
            _ => shared::surface(k, scene, body, folder).map(|_| ())?,
        }
    }
    Ok(())
}

/// Error for a point that lies not in a body's own model but in one of its zones; `None` otherwise.
fn in_zone(
    path: &str,
    model_name: &str,
    point: &[f64; 3],
    body: &Body,
    folder: &Path,
) -> Result<Option<crate::Error>> {
    let Shape::Piece(piece) = &body.shape else {
        return Ok(None);
    };
    let zone = piece.zone_at(&Point3::from(*point), folder)?;
    Ok(zone.filter(|zone| *zone != model_name).map(|zone| {
        let rule = format!(
            "is the body outside its zones, and {point:?} m lies in zone '{zone}'; give model = \"{zone}\", or move the probe out of it"
        );
        value(format!("{path}.model"), model_name, &rule)
    }))
}

/// Refuses groups and points that the shapes of particles do not have, judged by the scene and its files
/// alone.
///
/// # Errors
/// The key, and the known groups or the reason.
pub(super) fn check_fillings(scene: &SceneSpec, folder: &Path) -> Result<()> {
    for (name, table) in &scene.model {
        if !kind(table.kind).has_spheres() {
            continue;
        }
        let supports = scene.support.iter().enumerate();
        let supports = supports.map(|(k, s)| (format!("support[{k}]"), &s.model, Some(&s.at), None));
        let loads = scene.load.iter().enumerate();
        let loads = loads.map(|(k, l)| (format!("load[{k}]"), &l.model, Some(&l.at), None));
        let probes = scene.probe.iter().filter_map(|(n, p)| {
            let place = p.at.as_ref();
            Some((format!("probe.{n}"), p.model.as_ref()?, p.over.as_ref(), place))
        });
        let selections = supports.chain(loads).chain(probes);
        let on_model: Vec<_> = selections.filter(|(_, model, ..)| *model == name).collect();
        if on_model.is_empty() {
            continue;
        }
        let filling = match table.shape {
            Shape::Piece(_) => None,
            _ => Some(Filling::from_table(&format!("model.{name}"), table, folder)?),
        };
        for (path, _, over, point) in on_model {
            if let (Some(Selection::Group(group)), Some(filling), Shape::File(_)) =
                (over, &filling, &table.shape)
                && !filling.faces.contains_key(group)
            {
                let path = format!("{path}.where");
                return Err(unknown(path, group, "group of the model", filling.faces.keys()));
            }
            if let Some(point) = point {
                check_point(&path, name, point, (table, filling.as_ref()), folder)?;
            }
        }
    }
    Ok(())
}

/// Refuses a point at which the particles that will fill a shape cannot have a displacement.
fn check_point(
    path: &str,
    name: &str,
    point: &[f64; 3],
    (table, filling): (&ModelTable, Option<&Filling>),
    folder: &Path,
) -> Result<()> {
    let path = format!("{path}.at");
    let outside = || {
        let rule = format!("lies outside model '{name}'; move the probe into it, or name another model");
        Err(value(&path, format_args!("{point:?} m"), &rule))
    };
    let Some(filling) = filling else {
        let Shape::Piece(piece) = &table.shape else {
            return Ok(());
        };
        return match piece.holds(&Point3::from(*point), folder)? {
            true => Ok(()),
            false => outside(),
        };
    };
    let x = Vector3::from(*point) - filling.shift;
    let radius = radius_of(table, &filling.container);
    match &filling.container {
        shape @ (Container::Box { .. } | Container::Cylinder { .. }) => match shape.gap(&x, radius) {
            depth if depth < 0.0 => outside(),
            depth if depth < DEPTH * radius => {
                let rule = format!(
                    "is {depth:.3e} m below the surface of model '{name}', whose field ends at the centres of its spheres, {radius:.3e} m \
                     below the surface; move the probe in by a diameter"
                );
                Err(value(&path, format_args!("{point:?} m"), &rule))
            }
            _ => Ok(()),
        },
        shape if shape.contains(&x) => Ok(()),
        _ => outside(),
    }
}

/// Mean radius of the spheres that a table requests \[m\]; zero if it reads spheres from a file.
fn radius_of(table: &ModelTable, container: &Container) -> f64 {
    let diameter = match (table.spacing, table.dem.count) {
        (Some(h), _) => h,
        (None, Some(n)) => mean_diameter(container.volume(), n as f64),
        (None, None) => 0.0,
    };
    0.5 * diameter
}

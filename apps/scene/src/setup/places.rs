//! Checks of places that a scene names, before anything is packed: a packing may take minutes.

use super::body::Body;
use super::filling::Filling;
use super::kinds::kind;
use super::shapes::corners;
use super::skin::Skin;
use super::{load, names, probe, select, shared, support};
use crate::error::{Result, key, unknown, value};
use crate::setup::{BodyShape, LoweredModel, LoweredScene};
use crate::spec::{Load, Selection, Support};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::packing::Container;
use arlequin::dem_beam::packing::size::mean_diameter;
use std::collections::BTreeMap;
use std::path::Path;

/// Smallest distance of a centre from a wall, as a share of the mean radius.
const DEPTH: f64 = 0.5;

/// Refuses probes, supports and loads that select nothing in the models built so far; models of particles are
/// not built yet.
///
/// # Errors
/// The key, and the extent of its model.
pub(super) fn check_meshes(scene: &LoweredScene, bodies: &[Option<Body>], folder: &Path) -> Result<()> {
    let built = |path: &str, name: &str| {
        let m = names::model_index(&format!("{path}.model"), name, scene)?;
        Ok(bodies[m].as_ref().map(|body| (m, body)))
    };
    for (name, p) in &scene.probe {
        let (path, Some(model_name)) = (format!("probe.{name}"), &p.model) else {
            continue;
        };
        if let Some(numbered) = built(&path, model_name)? {
            probe::check_built(&path, p, numbered)?;
        }
    }
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        match built(&path, &s.model)? {
            Some((m, body)) if names::parts(scene, m).len() == 1 => {
                select::nodes(&format!("{path}.where"), body, &s.at)?;
            }
            Some((_, body)) => held_somewhere(&path, s, body, folder)?,
            None => {}
        }
    }
    support::check_built(scene, bodies)?;
    for (k, l) in scene.load.iter().enumerate() {
        let path = format!("load[{k}]");
        let Some((m, body)) = built(&path, &l.model)? else {
            continue;
        };
        match names::loaded_parts(scene, m).len() {
            1 => load::build(&path, &load::name(k, l), l, body).map(|_| ())?,
            _ => shared::surface(k, scene, body, folder).map(|_| ())?,
        }
    }
    Ok(())
}

/// Refuses a support on a body with zones that selects neither a part of the body's mesh nor a place where
/// spheres of a zone could be.
fn held_somewhere(path: &str, s: &Support, body: &Body, folder: &Path) -> Result<()> {
    let BodyShape::Piece(piece) = &body.shape else {
        return Ok(());
    };
    let (whole, path) = (piece.whole(folder)?, format!("{path}.where"));
    match &s.at {
        Selection::Group(name) if !whole.groups().contains_key(name) => {
            let groups = select::named(whole.groups());
            Err(unknown(path, name, "group of the body", groups))
        }
        Selection::Group(_) => Ok(()),
        Selection::Box(..) => meets(&path, &s.at, "body", corners(whole.nodes())),
    }
}

/// Refuses a box that does not meet a model between two corners.
fn meets(path: &str, selection: &Selection, name: &str, ends: [Vector3<f64>; 2]) -> Result<()> {
    let Selection::Box(low, high) = selection else {
        return Ok(());
    };
    let slack = select::slack((ends[1] - ends[0]).norm());
    if (0..3).all(|c| low[c] <= ends[1][c] + slack && high[c] >= ends[0][c] - slack) {
        return Ok(());
    }
    let [from, to] = ends.map(|x| format!("{:?}", x.as_slice()));
    let rule = format!(
        "{selection} lies outside model '{name}', which reaches from {from} to {to} m; move it, enlarge it or check the units (m)"
    );
    Err(key(path, rule))
}

/// Refuses groups, boxes and points that the shapes of particles do not have, judged by the scene and its
/// files alone.
///
/// # Errors
/// The key, and the known groups or the reason.
pub(super) fn check_fillings(scene: &LoweredScene, folder: &Path) -> Result<()> {
    for (name, table) in &scene.model {
        // `check_meshes` looks at the nodes of all other models.
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
        // A model that nothing names needs no container; building one may mean to read a file.
        if on_model.is_empty() {
            continue;
        }
        let (filling, place) = place_of(name, table, folder)?;
        for (path, _, over, point) in on_model {
            if let Some(over) = over {
                place.check(&format!("{path}.where"), name, over)?;
            }
            if let Some(point) = point {
                check_point(&path, name, point, (table, filling.as_ref()), folder)?;
            }
        }
        if let Some(filling) = &filling {
            check_tractions(scene, (name, table), filling)?;
        }
    }
    Ok(())
}

/// Refuses tractions and pressures that hold no part of the surface of particles.
fn check_tractions(
    scene: &LoweredScene,
    (name, table): (&String, &LoweredModel),
    filling: &Filling,
) -> Result<()> {
    let on_surface = |l: &Load| l.model == *name && (l.traction.is_some() || l.pressure.is_some());
    for (k, l) in scene.load.iter().enumerate().filter(|(_, l)| on_surface(l)) {
        let diameter = 2.0 * radius_of(table, &filling.container);
        let skin = Skin::new(&table.shape, filling);
        skin.select(&format!("load[{k}].where"), name, &l.at, diameter)?;
    }
    Ok(())
}

/// Place of particles as far as it is known before they are packed.
struct Ground {
    /// Groups of a file or of a zone; `None` if the kind of the model knows the groups of its shape.
    groups: Option<BTreeMap<String, ()>>,
    /// Lowest and highest corner \[m\].
    ends: [Vector3<f64>; 2],
}

impl Ground {
    fn check(&self, path: &str, name: &str, over: &Selection) -> Result<()> {
        match (over, &self.groups) {
            (Selection::Group(group), Some(groups)) if !groups.contains_key(group) => {
                Err(unknown(path, group, "group of the model", select::named(groups)))
            }
            _ => meets(path, over, name, self.ends),
        }
    }
}

/// Container of the particles of a model that is no zone, and the place of the particles.
fn place_of(name: &str, table: &LoweredModel, folder: &Path) -> Result<(Option<Filling>, Ground)> {
    let named = |groups: &mut dyn Iterator<Item = &String>| groups.map(|g| (g.clone(), ())).collect();
    if let BodyShape::Piece(piece) | BodyShape::Reservoir(piece) = &table.shape {
        let (triangles, mesh) = piece.surface(folder)?;
        let groups = Some(named(&mut triangles.groups.keys()));
        let ends = corners(mesh.nodes());
        return Ok((None, Ground { groups, ends }));
    }
    let filling = Filling::from_table(&format!("model.{name}"), table, folder)?;
    let groups = table.shape.is_file().then(|| named(&mut filling.faces.keys()));
    let ends = filling.ends();
    Ok((Some(filling), Ground { groups, ends }))
}

/// Refuses a point at which the particles that will fill a shape cannot have a displacement.
fn check_point(
    path: &str,
    name: &str,
    point: &[f64; 3],
    (table, filling): (&LoweredModel, Option<&Filling>),
    folder: &Path,
) -> Result<()> {
    let path = format!("{path}.at");
    let outside = || {
        let rule = format!("lies outside model '{name}'; move the probe into it, or name another model");
        Err(value(&path, format_args!("{point:?} m"), &rule))
    };
    let Some(filling) = filling else {
        let (BodyShape::Piece(piece) | BodyShape::Reservoir(piece)) = &table.shape else {
            return Ok(());
        };
        return match piece.holds(&Point3::from(*point), folder)? {
            true => Ok(()),
            false => outside(),
        };
    };
    // Containers have a frame of their own.
    let x = Vector3::from(*point) - filling.shift;
    let radius = radius_of(table, &filling.container);
    match &filling.container {
        shape @ (Container::Box { .. } | Container::Cylinder { .. }) => match shape.gap(&x, radius) {
            depth if depth < 0.0 => outside(),
            // The packing is not made yet: half a mean radius leaves room for spheres smaller than the mean.
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
fn radius_of(table: &LoweredModel, container: &Container) -> f64 {
    let diameter = match (table.spacing, table.dem.count) {
        (Some(h), _) => h,
        (None, Some(n)) => mean_diameter(container.volume(), n as f64),
        (None, None) => 0.0,
    };
    0.5 * diameter
}

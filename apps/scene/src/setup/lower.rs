//! Lowers `[body]` and `[zone.NAME]` to models and interfaces.

use super::kind::Feature;
use super::kinds::kind;
use super::lowered::{BodyShape, LoweredInterface, LoweredModel, LoweredScene, OverlapSource};
use super::mesh::Elements;
use super::names::BODY;
use super::zone::{self, Cut, Mark, Piece, Use, Zone, check_region};
use crate::error::{Error, Result, key, value};
use crate::spec::{
    EffectKind, FollowTable, Interface, MediatorTable, Method, ModelTable, ProfileKind, RoleKind, SceneSpec,
    Selection, WeightTable, ZoneTable,
};
use arlequin::core::Weighting;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Adds models and interfaces for the body and its zones. The tables `body` and `zone` remain, for keys in
/// messages.
///
/// # Errors
/// A model other than a link that lacks a required key; mistakes in the tables of the body and its zones.
pub(crate) fn lowered(mut scene: SceneSpec) -> Result<LoweredScene> {
    let body = scene.body.take();
    let body = body.map(|table| with_source(BODY, table)).transpose()?;
    let models = std::mem::take(&mut scene.model).into_iter();
    let models = models.map(|(name, table)| {
        let table = with_source(&format!("model.{name}"), table)?;
        Ok((name, table))
    });
    let interfaces = std::mem::take(&mut scene.interface).into_iter();
    let interfaces = interfaces.map(|(name, table)| {
        let overlap = OverlapSource::Given(table.overlap.clone());
        let mut table = table.with_overlap(overlap);
        // Two methods are settings of the interface.
        match table.method {
            Method::Nodal => table.weight.weighting = Weighting::Nodal,
            Method::Lumped => table.lumped = true,
            _ => {}
        }
        (name, table)
    });
    let (models, interfaces) = (models.collect::<Result<_>>()?, interfaces.collect());
    let scene = scene.with_tables(body, models, interfaces);
    match (scene.body.clone(), scene.zone.keys().next()) {
        (Some(body), _) => with_zones(scene, body),
        (None, None) => Ok(scene),
        (None, Some(name)) => Err(key(
            format!("zone.{name}"),
            "a zone is a part of [body], which is not there; add it, or write [model.NAME] and [interface.NAME]",
        )),
    }
}

/// Returns a table with the source of its shape; refuses one that lacks a required key.
fn with_source(path: &str, table: ModelTable) -> Result<LoweredModel> {
    let is_remote = kind(table.kind).is_remote();
    let shape = match table.shape.clone() {
        Some(shape) => BodyShape::Given(shape),
        None if is_remote => BodyShape::Remote,
        None => return Err(key(path, "missing field `shape`")),
    };
    if !is_remote {
        table.known_material(path)?;
    }
    Ok(table.with_shape(shape))
}

/// Adds the models and interfaces of the body and its zones.
fn with_zones(mut scene: LoweredScene, body: LoweredModel) -> Result<LoweredScene> {
    let elements = check_body(&body, !scene.zone.is_empty())?;
    let names = std::iter::once(BODY).chain(scene.zone.keys().map(String::as_str));
    for name in names {
        for (table, taken) in [
            ("model", scene.model.contains_key(name)),
            ("interface", scene.interface.contains_key(name)),
        ] {
            if taken {
                let rule = "has the name of the body or of a zone, which are models and interfaces too; choose another";
                return Err(key(format!("{table}.{name}"), rule));
            }
        }
    }
    let Some(elements) = elements else {
        scene.model.insert(BODY.to_owned(), body);
        return Ok(scene);
    };
    for (name, zone) in &scene.zone {
        if name == BODY {
            let rule = "is the name of the body's own model, which is the other side of the zone; give the zone another name";
            return Err(key(format!("zone.{name}"), rule));
        }
        check_zone(name, zone)?;
    }
    let zone = |(name, table): (&String, &ZoneTable)| Zone {
        name: name.clone(),
        has_spheres: kind(table.kind).has_spheres(),
        table: table.clone(),
    };
    let zones = scene.zone.iter().map(zone).collect();
    let cut = Arc::new(Cut::new(body.clone(), elements, zones, marks(&scene)));
    let piece = |purpose: Use| Piece::new(cut.clone(), purpose);
    if let Some((name, zone)) = following(&scene).map(|(n, z, _)| (n.to_owned(), z.clone())) {
        zone::check(&scene)?;
        // Either model sleeps where its weight is zero.
        let spheres = model(&zone, &body, piece(Use::Zone(0)));
        let spheres = match zone.follow.0.as_ref().is_some_and(|f| f.within.is_some()) {
            true => LoweredModel {
                shape: BodyShape::Reservoir(piece(Use::Reservoir)),
                ..spheres
            },
            false => LoweredModel {
                shape: body.shape.clone(),
                scale: body.scale,
                volume: body.volume.clone(),
                ..spheres
            },
        };
        // The zone grows before a bond of its overlap would have to break. What breaks there all the same is
        // the work of a change: spheres at the outer border hang on one or two bonds.
        for e in &mut scene.effect {
            if let EffectKind::Fracture(f) = &mut e.kind {
                f.spare_overlap = true;
            }
        }
        let between = interface(&name, &zone, piece(Use::Between(0)));
        scene.model.insert(name.clone(), spheres);
        scene.interface.insert(name, between);
        let role = Some(RoleKind::Coarse);
        scene.model.insert(BODY.to_owned(), LoweredModel { role, ..body });
        return Ok(scene);
    }
    for (k, (name, zone)) in scene.zone.iter().enumerate() {
        let model = model(zone, &body, piece(Use::Zone(k)));
        scene.model.insert(name.clone(), model);
        let interface = interface(name, zone, piece(Use::Between(k)));
        scene.interface.insert(name.clone(), interface);
    }
    let remainder = LoweredModel {
        role: Some(RoleKind::Coarse),
        shape: BodyShape::Piece(piece(Use::Body)),
        spacing: None,
        divisions: None,
        scale: 1.0,
        volume: None,
        ..body
    };
    scene.model.insert(BODY.to_owned(), remainder);
    Ok(scene)
}

/// Returns the zone that goes where it is needed, with its name and limits.
pub(crate) fn following(scene: &LoweredScene) -> Option<(&str, &ZoneTable, &FollowTable)> {
    let mut zones = scene.zone.iter();
    zones.find_map(|(name, z)| z.follow.0.as_ref().map(|f| (name.as_str(), z, f)))
}

impl LoweredScene {
    /// Refuses a zone that follows, for commands that do not move it.
    ///
    /// # Errors
    /// A scene with such a zone.
    pub(crate) fn refuse_following(&self, command: &str) -> Result<()> {
        following(self).map_or(Ok(()), |(name, ..)| {
            let rule =
                format!("'arlequin {command}' does not move zones; remove follow, and give the zone a shape");
            Err(key(format!("zone.{name}.follow"), rule))
        })
    }
}

/// Boxes in which loads and supports act on the body.
fn marks(scene: &LoweredScene) -> Vec<Mark> {
    let loads = scene.load.iter().map(|l| (&l.model, &l.at)).enumerate();
    let supports = scene.support.iter().map(|s| (&s.model, &s.at)).enumerate();
    let loads = loads.map(|(k, place)| (format!("load[{k}]"), place));
    let places = loads.chain(supports.map(|(k, place)| (format!("support[{k}]"), place)));
    let boxes = places.filter_map(|(key, (model, selection))| match selection {
        Selection::Box(low, high) if model == BODY => Some(Mark {
            key,
            low: *low,
            high: *high,
        }),
        _ => None,
    });
    boxes.collect()
}

/// Replaces the key of a generated model or interface in an error by the key that the scene has.
pub(crate) fn written(scene: &LoweredScene, error: Error) -> Error {
    if scene.body.is_none() {
        return error;
    }
    error.at_key(|key| {
        let mut parts = key.splitn(3, '.');
        let (table, name) = (parts.next()?, parts.next()?);
        let subkey = parts.next();
        let place = match table {
            "model" if name == BODY => BODY.to_owned(),
            "model" | "interface" if scene.zone.contains_key(name) => format!("zone.{name}"),
            _ => return None,
        };
        Some(subkey.map_or(place.clone(), |subkey| format!("{place}.{subkey}")))
    })
}

/// Checks the table of the body; returns its elements if it has zones.
fn check_body(body: &LoweredModel, zones: bool) -> Result<Option<Elements>> {
    if body.role.is_some() {
        let rule = "a body has none: it is the coarse side of its zones; remove it";
        return Err(key("body.role", rule));
    }
    if !zones {
        return Ok(None);
    }
    let kind = kind(body.kind);
    let Some(elements) = kind.elements() else {
        let rule = "zones are cut out of a continuum; take \"fem\" or \"cnem\" for the body";
        return Err(value("body.kind", kind.name(), rule));
    };
    if !body.crack.is_empty() {
        let rule =
            "a body with zones has none; write [model.NAME] and [interface.NAME], or a mesh file with a slit";
        return Err(key("body.crack", rule));
    }
    if body.shape.is_line() {
        let rule = "zones are cut out of solids; couple two bars by [model.NAME] and [interface.NAME]";
        return Err(value("body.shape", "bar", rule));
    }
    Ok(Some(elements))
}

fn check_zone(name: &str, zone: &ZoneTable) -> Result<()> {
    let path = format!("zone.{name}");
    let kind = kind(zone.kind);
    if let Some(rule) = kind.refusal(Feature::Zone) {
        return Err(value(format!("{path}.kind"), kind.name(), rule));
    }
    for (key, x) in [
        ("overlap.width", Some(zone.overlap.width)),
        ("scale", zone.scale),
        ("mediator.spacing", zone.mediator.spacing),
    ] {
        if let Some(x) = x.filter(|x| *x <= 0.0) {
            return Err(value(format!("{path}.{key}"), x, "must be positive [m]"));
        }
    }
    if zone.absorber.as_ref().is_some_and(|a| a.spacing.is_some()) {
        let rule = "the space between a zone and the body is made of the body's elements; remove spacing";
        return Err(key(format!("{path}.absorber.spacing"), rule));
    }
    match (&zone.shape, &zone.follow.0) {
        (Some(shape), _) => check_region(&format!("{path}.shape"), shape),
        (None, Some(_)) => Ok(()),
        (None, None) => Err(key(
            path,
            "missing field `shape`; only a zone that follows can begin without one (follow = true)",
        )),
    }
}

fn model(zone: &ZoneTable, body: &LoweredModel, piece: Piece) -> LoweredModel {
    LoweredModel {
        kind: zone.kind,
        role: Some(RoleKind::Fine),
        shape: BodyShape::Piece(piece),
        spacing: zone.spacing,
        divisions: None,
        scale: 1.0,
        volume: None,
        crack: Vec::new(),
        material: zone.material.or(body.material),
        materials: match zone.material {
            None => body.materials.clone(),
            Some(_) => BTreeMap::new(),
        },
        step: zone.step,
        fem: zone.fem,
        cnem: zone.cnem,
        dem: zone.dem.clone(),
        command: None,
        address: None,
        timeout: None,
        start_timeout: None,
    }
}

fn interface(name: &str, zone: &ZoneTable, piece: Piece) -> LoweredInterface {
    Interface {
        coarse: BODY.to_owned(),
        fine: name.to_owned(),
        overlap: OverlapSource::Zone(piece),
        method: Method::default(),
        weight: WeightTable {
            // No weight is compatible with borders of arbitrary form; the linear one has the smallest error
            // (decision 0041).
            profile: zone.weight.profile.or(Some(ProfileKind::Linear)),
            ..zone.weight.clone()
        },
        mediator: MediatorTable {
            spacing: zone.mediator.spacing,
            ..MediatorTable::default()
        },
        junction: zone.junction,
        sampling: zone.sampling,
        solver: zone.solver,
        lumped: false,
        partition: zone.partition,
        pin: None,
        absorber: zone.absorber.clone(),
    }
}

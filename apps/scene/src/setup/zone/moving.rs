//! A zone that goes where it is needed (`zone.NAME.follow`): the body's elements and the spheres are there
//! everywhere, and weights say which of both a place belongs to. This module has the division of the body at
//! any time and builds what a change of weights needs; the run decides when (`run::follow`).

use super::Piece;
use super::divide::{Owner, centroid};
use super::{Bar, check_region, response};
use crate::error::{Error, Result, key, value};
use crate::ranks::Ranks;
use crate::setup::body::Body;
use crate::setup::faces::Faces;
use crate::setup::interface::{BuiltInterface, junction};
use crate::setup::kind::Feature;
use crate::setup::kinds::kind;
use crate::setup::lower::following;
use crate::setup::mesh::Grid;
use crate::setup::names::BODY;
use crate::setup::partners::Partners;
use crate::setup::support;
use crate::setup::weights::model_weights;
use crate::setup::{BodyShape, LoweredInterface, LoweredScene, OverlapSource, drive, load};
use crate::spec::{CriterionKind, EffectKind, FollowTable, Initial, ZoneTable};
use arlequin::core::effect::Load;
use arlequin::core::geometry::{BoxTree, bounds_of};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Changed, InterfaceOptions, InterfaceSpec, JunctionKind, Mediator, Response, Rezoning, Sampling, Weighting,
};
use arlequin::fem_ref::{FemField, Mesh};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Least number of spheres per node of the body with which an absorber works in overlaps of any shape.
const SPHERES: f64 = 1.5;

/// Models that an element of the body belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// The body's elements alone; spheres sleep.
    Body,
    /// The spheres alone; the body's elements sleep.
    Zone,
    /// Both, in the overlap.
    Both,
}

/// A zone that moves, where it is now.
#[derive(Debug, Clone)]
pub struct Moving {
    /// Name of the zone.
    pub name: String,
    /// Limits at which it grows.
    pub limits: FollowTable,
    table: LoweredInterface,
    piece: Piece,
    partners: Partners,
    scene: LoweredScene,
    folder: PathBuf,
    /// Loads on the body's elements.
    loads: Arc<Vec<Load<f64>>>,
    /// Responses of the spheres to strains of the body.
    pub(crate) responses: Arc<Vec<Response>>,
    /// Number of the zone's interface in the run, and all other interfaces in their order.
    number: usize,
    others: Arc<Vec<Standing>>,
}

/// An interface between models whose weights stay.
struct Standing {
    name: String,
    models: [usize; 2],
    mediator: Arc<dyn Mediator<f64>>,
    options: InterfaceOptions<f64>,
    table: LoweredInterface,
}

impl std::fmt::Debug for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Standing")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Standing {
    fn new(built: &BuiltInterface, scene: &LoweredScene) -> Self {
        let spec = &built.spec;
        Self {
            name: spec.name.clone(),
            models: [spec.coarse, spec.fine],
            mediator: spec.mediator.clone(),
            options: spec.options,
            table: scene.interface[&spec.name].clone(),
        }
    }

    fn spec(&self) -> Result<InterfaceSpec<f64>> {
        let path = format!("interface.{}", self.name);
        Ok(InterfaceSpec {
            name: self.name.clone(),
            coarse: self.models[0],
            fine: self.models[1],
            mediator: self.mediator.clone(),
            junction: junction(&path, &self.table, self.mediator.spacing())?,
            options: self.options,
        })
    }
}

/// Refuses a zone that moves on several ranks, before anything is built.
pub(in crate::setup) fn check_ranks(scene: &LoweredScene, ranks: &Ranks) -> Result<()> {
    match following(scene) {
        Some((name, ..)) if ranks.count() > 1 => {
            let rule = "weights cannot change on several ranks; run the scene on one, or remove follow";
            Err(key(format!("zone.{name}.follow"), rule))
        }
        _ => Ok(()),
    }
}

/// Refuses what a zone that moves cannot have, before anything is built.
pub(in crate::setup) fn check(scene: &LoweredScene) -> Result<()> {
    let Some((name, zone, limits)) = following(scene) else {
        return Ok(());
    };
    let path = format!("zone.{name}.follow");
    if !(limits.wake > 0.0 && limits.wake <= 1.0) {
        let rule = "must be above 0 and at most 1 [-]; 0.4 is usual";
        return Err(value(format!("{path}.wake"), limits.wake, rule));
    }
    if let Some(release) = limits.release.filter(|r| !(*r > 0.0 && *r < limits.wake)) {
        let rule = format!(
            "must be above 0 and below wake = {} [-]; half of it is usual",
            limits.wake
        );
        return Err(value(format!("{path}.release"), release, &rule));
    }
    if let Some(shape) = &limits.within {
        check_region(&format!("{path}.within"), shape)?;
    }
    for (name, count) in [("margin", limits.margin), ("every", limits.every.unwrap_or(1))] {
        if count == 0 {
            return Err(value(format!("{path}.{name}"), 0, "must be at least 1"));
        }
    }
    let refuse = |rule: &str| Err(key(path.clone(), rule));
    if !kind(zone.kind).has_spheres() {
        return refuse("only spheres break: take kind = \"dem\" for the zone, or remove follow");
    }
    let of_body = scene
        .body
        .as_ref()
        .and_then(|b| kind(b.kind).refusal(Feature::Sleep));
    if let Some(rule) = of_body {
        return refuse(rule);
    }
    if scene.zone.len() > 1 {
        return refuse(
            "a zone that moves must be the only one; make one zone of all (shape.union), or remove follow",
        );
    }
    let moves = |model: &String| model == BODY || model == name;
    let mut others = scene.interface.iter().filter(|(other, _)| *other != name);
    if let Some((other, _)) = others.find(|(_, i)| moves(&i.coarse) || moves(&i.fine)) {
        let rule = format!(
            "interface '{other}' ties one of its models to a third, whose weights do not move along; remove it, or follow"
        );
        return refuse(&rule);
    }
    if scene.statics.is_some() {
        return refuse("has no meaning with [static]; remove one of them");
    }
    if zone.shape.is_none() {
        check_empty(scene, name, zone)?;
    }
    check_elements_and_spheres(scene, name, zone)?;
    if zone.dem.loose == crate::spec::LooseKind::Keep {
        return refuse(
            "loose grains have no bond that could be loaded, and would sleep; take dem.loose = \"drop\"",
        );
    }
    check_contacts(scene, name)?;
    check_effects(scene, &path, limits)
}

/// Refuses contacts between two models that would act only until zone `name` comes, or between the body and
/// what takes its place.
fn check_contacts(scene: &LoweredScene, name: &str) -> Result<()> {
    let effects = scene.effect.iter().enumerate().filter(|(_, e)| e.enabled);
    let contacts: Vec<(usize, [&str; 2])> = effects
        .filter_map(|(k, e)| match &e.between.as_deref()? {
            [a, b] => Some((k, [a.as_str(), b])),
            _ => None,
        })
        .collect();
    for (k, [a, b]) in &contacts {
        let partner = match [*a, *b] {
            [BODY, other] | [other, BODY] => other,
            _ => continue,
        };
        let refuse = |rule: String| Err(key(format!("effect[{k}].between"), rule));
        if partner == name {
            return refuse(format!(
                "zone '{name}' takes the place of the body, and both overlap; remove it"
            ));
        }
        let of_spheres = [[name, partner], [partner, name]];
        if !contacts.iter().any(|c| of_spheres.contains(&c.1)) {
            return refuse(format!(
                "ends where the spheres of zone '{name}' take the place of the body's elements; add an effect contact with between \
                 = [\"{name}\", \"{partner}\"]"
            ));
        }
    }
    Ok(())
}

/// Refuses effects that a zone that moves cannot have; `path` is the key of `limits`.
fn check_effects(scene: &LoweredScene, path: &str, limits: &FollowTable) -> Result<()> {
    let refuse = |rule: &str| Err(key(path, rule));
    let mut breaks = false;
    for e in scene.effect.iter().filter(|e| e.enabled) {
        match &e.kind {
            EffectKind::Fracture(f) if f.criterion == Some(CriterionKind::Hydrostatic) => {
                return refuse("the criterion hydrostatic has strengths of particles; take one of bonds");
            }
            EffectKind::Fracture(_) => breaks = true,
            EffectKind::BodyForce(_)
            | EffectKind::MassDamping(_)
            | EffectKind::StiffnessDamping(_)
            | EffectKind::LocalDamping(_)
            | EffectKind::Prestress(_) => {}
            EffectKind::Contact(_) | EffectKind::Obstacle(_) if limits.release.is_some() => {
                let rule = format!(
                    "spheres that touch must not fall asleep; remove release, or the effect {}",
                    e.kind.key()
                );
                return Err(key(format!("{path}.release"), rule));
            }
            EffectKind::Contact(_) | EffectKind::Obstacle(_) => {}
            EffectKind::BulkViscosity(_) => {
                return refuse(
                    "the scene has bulk_viscosity, which elements that sleep cannot have; remove it, or follow",
                );
            }
        }
    }
    if !breaks {
        return refuse("nothing breaks, and strengths decide where the zone goes; add an effect fracture");
    }
    Ok(())
}

/// Refuses a zone whose spheres would not be the body in place of its elements.
fn check_elements_and_spheres(scene: &LoweredScene, name: &str, zone: &ZoneTable) -> Result<()> {
    let of_body = scene.body.as_ref().and_then(|b| b.material);
    if zone.material.is_some() && zone.material != of_body {
        return Err(key(
            format!("zone.{name}.material"),
            "elements of the body become spheres where the zone goes: it has the body's material; remove it, or follow",
        ));
    }
    if zone.weight.weighting == Weighting::Nodal {
        return Err(key(
            format!("zone.{name}.weight.weighting"),
            "weights at nodes conserve no energy that a change could be accounted for; take \"energy\", or remove follow",
        ));
    }
    Ok(())
}

/// Refuses what a zone that begins empty cannot have: it would fail at its first change.
fn check_empty(scene: &LoweredScene, name: &str, zone: &ZoneTable) -> Result<()> {
    let refuse = |key_path: &str, rule: &str| Err(key(format!("zone.{name}.{key_path}"), rule));
    if zone.junction.kind != JunctionKind::L2 {
        return refuse(
            "junction",
            "a zone that begins empty has the junction l2; remove it, or give shape",
        );
    }
    if zone.sampling.is_some_and(|s| s != Sampling::Particles) {
        return refuse(
            "sampling",
            "spheres are summed over; remove it, or take \"particles\"",
        );
    }
    if let Some(value) = zone.weight.constants().find(|v| !(*v > 0.0 && *v < 1.0)) {
        let rule =
            format!("a constant weight of {value} leaves all to one model; take a profile that varies");
        return refuse("weight", &rule);
    }
    if zone.mediator.spacing.is_some() {
        return refuse(
            "mediator.spacing",
            "a zone that begins empty has the body's elements as its mediator; remove it, or give shape",
        );
    }
    let on_zone = |i: &Initial| i.models.iter().flatten().any(|m| m == name);
    match scene.initial.iter().position(on_zone) {
        Some(k) => Err(key(
            format!("initial[{k}].models"),
            format!(
                "zone '{name}' begins empty, and its spheres start from the body's state; give that, to \"{BODY}\""
            ),
        )),
        None => Ok(()),
    }
}

/// Unknowns of the spheres within a diameter of the border of a reservoir. The packing is cut there: in a
/// strain of the body they have the body's field.
fn near_border(spheres: &Body, border: &Faces) -> Vec<usize> {
    let layout = spheres.model.layout();
    let nodes = spheres.model.nodes().iter().enumerate();
    let near = nodes.filter(|(_, x)| !border.is_empty() && border.distance(x) < spheres.spacing);
    let unknowns = near.flat_map(|(k, _)| {
        let turns = layout.translations() + layout.rotations * k;
        let moves = layout.components * k;
        (moves..moves + layout.components).chain(turns..turns + layout.rotations)
    });
    unknowns.collect()
}

impl Moving {
    /// Prepares the zone of a scene that goes where it is needed, if there is one.
    pub(in crate::setup) fn from_scene(
        scene: &LoweredScene,
        built: &[BuiltInterface],
        bodies: &mut [Body],
        folder: &Path,
    ) -> Result<Option<Self>> {
        let Some((name, _, limits)) = following(scene) else {
            return Ok(None);
        };
        let table = &scene.interface[name];
        let number = built.iter().position(|b| b.spec.name == name);
        let (Some(number), OverlapSource::Zone(piece)) = (number, &table.overlap) else {
            return Ok(None);
        };
        let own = &built[number];
        let others = built.iter().filter(|b| b.spec.name != name);
        let others = others.map(|b| Standing::new(b, scene)).collect();
        let [coarse, fine] = own.partners.models;
        let (border, nodes) = piece.reservoir(folder)?;
        let spheres = bodies[fine].model.nodes().len();
        if own.partners.has_absorber() && (spheres as f64) < SPHERES * nodes as f64 {
            let rule = format!(
                "gives {spheres} spheres where the body has {nodes} nodes, fewer than {SPHERES} for each node: the absorber of a later \
                 overlap could not tell their motion from that of the body; take smaller spheres or larger elements"
            );
            return Err(key(format!("zone.{name}.spacing"), rule));
        }
        let speed = bodies[coarse].material.as_ref().map_or(0.0, |m| m.bar_speed());
        let rate = speed / bodies[coarse].spacing;
        let motions = support::motions(scene, bodies, folder)?;
        let of_spheres = motions.iter().filter(|(m, _)| *m == fine);
        let mut held: Vec<usize> = of_spheres.flat_map(|(_, motion)| motion.dofs.clone()).collect();
        held.extend(near_border(&bodies[fine], &border));
        let responses = response::responses(&mut *bodies[fine].model, rate, &held)?;
        let on_body = scene.load.iter().enumerate().filter(|(_, l)| l.model == BODY);
        let loads = on_body.map(|(k, l)| {
            let path = format!("load[{k}]");
            load::fixed(&path, &load::name(k, l), l, &bodies[coarse])
        });
        let loads = loads.collect::<Result<_>>()?;
        Ok(Some(Self {
            loads: Arc::new(loads),
            responses: Arc::new(responses),
            number,
            others: Arc::new(others),
            name: name.to_owned(),
            limits: limits.clone(),
            table: table.clone(),
            piece: piece.clone(),
            partners: own.partners.clone(),
            scene: scene.clone(),
            folder: folder.to_owned(),
        }))
    }

    /// Numbers of the body's model and of the spheres.
    pub(crate) fn models(&self) -> [usize; 2] {
        self.partners.models
    }

    /// Elements of the body.
    ///
    /// # Errors
    /// A body that cannot be meshed or divided.
    pub(crate) fn mesh(&self) -> Result<&Mesh<f64>> {
        self.piece.whole(&self.folder)
    }

    /// Field of the body's elements.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn field(&self) -> Result<&FemField<f64>> {
        Ok(&self.piece.cut.division(&self.folder)?.field)
    }

    /// Models that each element belongs to.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn shares(&self) -> Result<Vec<Share>> {
        let owners = self.piece.cut.division(&self.folder)?.owners.iter();
        let share = |owner: &Owner| match owner {
            Owner::Body => Share::Body,
            Owner::Zone(_) => Share::Zone,
            Owner::Both(_) => Share::Both,
        };
        Ok(owners.map(share).collect())
    }

    /// For each element of the body: true if spheres fill it.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn filled(&self) -> Result<Vec<bool>> {
        let division = self.piece.cut.division(&self.folder)?;
        Ok(match division.reservoir.is_empty() {
            true => vec![true; division.owners.len()],
            false => division.reservoir.to_vec(),
        })
    }

    /// For each element of the body: the reason for which the zone must leave it to the body.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn barred(&self) -> Result<Vec<Option<Bar>>> {
        self.piece.barred(&self.scene, &self.folder)
    }

    /// Returns the probes whose model sleeps at their place, each with this model.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn probes_asleep(&self) -> Result<Vec<(&str, &str)>> {
        let mut out = Vec::new();
        for (name, probe) in &self.scene.probe {
            let sleeps = match probe.model.as_deref() {
                Some(BODY) => {
                    let [whole, part] = self.piece.zones_of_probe(probe, &self.folder)?;
                    whole.or(part).is_some()
                }
                Some(model) if model == self.name => self.piece.is_beyond(probe, &self.folder)?,
                _ => false,
            };
            if sleeps {
                out.push((&**name, probe.model.as_deref().unwrap_or(BODY)));
            }
        }
        Ok(out)
    }

    /// Returns the warning for a zone that cannot go where bonds are loaded.
    pub(crate) fn warning(&self, bar: Bar) -> String {
        bar.warning(&self.name, &self.scene)
    }

    /// Returns the number of the element at a point; of points outside of all elements, that of the nearest
    /// centre.
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn element_at(&self, x: &Point3<f64>) -> Result<usize> {
        if let Some(e) = self.field()?.element_at(x) {
            return Ok(e);
        }
        let centres = self.centres()?;
        let distance = |e: &usize| (centres[*e] - x).norm_squared();
        let nearest = (0..centres.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.ok_or_else(|| key("body", "has no element"))
    }

    /// Centres of the elements \[m\].
    ///
    /// # Errors
    /// See [`Self::mesh`].
    pub(crate) fn centres(&self) -> Result<Vec<Point3<f64>>> {
        let mesh = self.mesh()?;
        Ok((0..mesh.element_count()).map(|e| centroid(mesh, e)).collect())
    }

    /// Returns the zone after it has moved to the elements of `core`, and to those that these and their
    /// overlap would part from the body; `barred` elements stay with the body.
    ///
    /// # Errors
    /// An overlap that is thinner than an element, or has no border to the body.
    pub(crate) fn moved(&self, core: &[bool], barred: &[Option<Bar>]) -> Result<Self> {
        let piece = self.piece.moved(core, barred, &self.folder)?;
        let table = LoweredInterface {
            overlap: OverlapSource::Zone(piece.clone()),
            ..self.table.clone()
        };
        Ok(Self {
            table,
            piece,
            ..self.clone()
        })
    }

    /// Returns where the weights of this zone may differ from those of the zone `before`.
    fn changed_since(&self, before: &Self) -> Result<Arc<Changed<f64>>> {
        let [old, new] = [before, self].map(|m| m.piece.cut.division(&m.folder));
        let (old, new) = (old?, new?);
        let mesh = new.field.mesh();
        let differs = |e: &usize| {
            let moved = |k: &u32| {
                let [a, b] = [old, new].map(|d| d.zones[0].positions[*k as usize]);
                a.to_bits() != b.to_bits()
            };
            old.owners[*e] != new.owners[*e]
                || matches!(new.owners[*e], Owner::Both(_)) && mesh.element(*e).iter().any(moved)
        };
        let box_of = |e: usize| {
            let corners = mesh.element(e).iter();
            bounds_of(corners.map(|k| &mesh.nodes()[*k as usize]))
        };
        let elements = (0..mesh.element_count()).filter(differs);
        let tree = BoxTree::new(elements.map(box_of).collect());
        let (field, margin) = (new.field.clone(), Vector3::repeat(mesh.spacing()));
        Ok(Arc::new(move |[low, high]: &[Point3<f64>; 2]| {
            let meets = |bounds: &[Point3<f64>; 2]| tree.any(bounds, &mut |_| true);
            if !meets(&[low - margin, high + margin]) {
                return false;
            }
            // A point outside of the body has the position of an element beside it.
            let corner = |k: usize| {
                let end = |c: usize| if k >> c & 1 == 0 { low[c] } else { high[c] };
                Point3::new(end(0), end(1), end(2))
            };
            let sticks_out = || (0..8).any(|k| field.element_at(&corner(k)).is_none());
            meets(&[*low, *high]) || sticks_out()
        }))
    }

    /// Returns the change of weights that brings a run from the zone `before` to this one, and for output the
    /// number of the zone's interface with its new mediator.
    ///
    /// # Errors
    /// See [`Self::moved`].
    pub(crate) fn rezoning(&self, before: &Self) -> Result<(Rezoning<f64>, (usize, Grid))> {
        let overlap = self.piece.overlap(&self.folder)?;
        let shape = BodyShape::Piece(self.piece.clone());
        let place = (&self.table, self.folder.as_path());
        let mut built = self.partners.clone().tie(&self.name, place, (&overlap, &shape))?;
        let mut absorber = built.absorber.take();
        let joints = [built];
        let mut weights = Vec::new();
        for m in self.models() {
            weights.push((m, model_weights(m, &joints)?));
        }
        let [built] = joints;
        let specs = self.others.iter().map(Standing::spec);
        let mut specs = specs.collect::<Result<Vec<_>>>()?;
        specs.insert(self.number, built.spec);
        let mut change = Rezoning::new(specs).with_responses(self.models()[1], self.responses.clone());
        if self.table.weight.is_local() {
            change = change.with_changes(self.changed_since(before)?);
        }
        for (m, w) in weights {
            change = change.with_weights(m, w);
            if m == self.models()[0] {
                for load in &*self.loads {
                    change = change.with_effect(m, Box::new(load.clone()));
                }
            }
            let add = |change: Rezoning<f64>, effects: Vec<_>| {
                effects.into_iter().fold(change, |change, effect| match effect {
                    Some(effect) => change.with_effect(m, effect),
                    None => change.with_kept_effect(m),
                })
            };
            let [first, last] = drive::effects_anew(&self.scene, m)?;
            change = add(change, first);
            if m == self.models()[1]
                && let Some(a) = absorber.take()
            {
                change = change.with_effect(m, Box::new(a));
            }
            change = add(change, last);
        }
        Ok((change, (self.number, built.grid)))
    }

    /// Key of the zone in an error of this zone.
    pub(crate) fn place_of(&self, e: Error) -> Error {
        crate::setup::lower::written(&self.scene, e)
    }
}

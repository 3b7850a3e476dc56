//! Loads on a body with zones: the load on the whole body is distributed over its models so that their sum is
//! the prescribed load.
//!
//! The prescribed load consists of the tractions on the facets of the whole body, as if it had no zones. The
//! body's own model carries them with its weight `f`, a zone's model with `1 − f` on its own facets of the
//! same surface. Spheres have no facets; those that touch the surface carry the load. The remaining
//! difference in force and moment is added on the zones as forces `a (α + θ × (x − c))`, the smallest ones
//! with the given resultant.

use super::body::Body;
use super::faces::{Faces, corners_of};
use super::interface::BuiltInterface;
use super::load;
use super::profile::{self, Patch};
use super::spread::{Carriers, Resultant, Traction, Wrench, make_up};
use super::{names, select, weights};
use crate::error::{Result, core, fem, key, unknown};
use crate::setup::{BodyShape, LoweredScene};
use crate::spec::Selection;
use arlequin::core::Weight;
use arlequin::core::effect::{self, SurfaceFacet};
use arlequin::core::nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Largest distance of a facet's centre from the surface, in node spacings: faces of hexahedra may be warped.
const SKIN: f64 = 0.1;
/// Share of a load below which a zone carries nothing.
const NO_PART: f64 = 1e-9;

/// The nodes of one model that carry a load.
struct Part {
    model: usize,
    carriers: Carriers,
}

impl Part {
    fn new(model: usize) -> Self {
        Self {
            model,
            carriers: Carriers::default(),
        }
    }

    /// Adds tractions on facets, multiplied by a share at the centres of the facets.
    fn carry(&mut self, body: &Body, facets: &[SurfaceFacet<f64>], field: &Traction, share: &Share<'_>) {
        for f in facets {
            let (t, w) = (field(f), share(&f.centre));
            for (n, a) in f.nodes.iter().zip(&f.shares) {
                self.carriers.add(*n, body.model.nodes()[*n], a * w, t * (a * w));
            }
        }
    }
}

type Share<'a> = dyn Fn(&Point3<f64>) -> f64 + 'a;

/// A load on a body with zones.
struct Shared<'a> {
    path: &'a str,
    /// Group of the body and its zones that is the loaded surface.
    group: &'a str,
    bodies: &'a [Body],
    folder: &'a Path,
    /// Number of the body's own model.
    body: usize,
    /// Number of each zone, with the weight of the body's own model in the zone's overlap.
    zones: &'a [(usize, Arc<dyn Weight<f64>>)],
    /// Loaded surface as triangles. Models of natural elements select the facets of a group by their corners
    /// only; in a thin body this would include facets on a cut.
    skin: &'a Faces,
    field: Traction,
    /// True if the load has a profile.
    profiled: bool,
    /// Prescribed force and moment.
    prescribed: Resultant,
}

/// Distributes load `k` of the scene on the model `body`, which has zones, over its models.
pub(super) fn loads(
    k: usize,
    body: usize,
    scene: &LoweredScene,
    bodies: &[Body],
    joints: &[BuiltInterface],
    folder: &Path,
) -> Result<Vec<(usize, effect::Load<f64>)>> {
    let (path, l) = (format!("load[{k}]"), &scene.load[k]);
    let mut out: BTreeMap<usize, effect::Load<f64>> = BTreeMap::new();
    let (group, mut facets, skin) = surface(k, scene, &bodies[body], folder)?;
    if let (BodyShape::Piece(piece), Some(_)) = (&bodies[body].shape, &l.profile) {
        let nodes = piece.whole(folder)?.nodes();
        profile::check_samples(&path, l, &Patch::from_facets(&facets, nodes), profile::GAUSS)?;
        facets = profile::split(&facets, nodes, profile::GAUSS);
    }
    let zones = names::parts(scene, body);
    let zones = zones[1..].iter().filter_map(|z| {
        let joint = joints
            .iter()
            .find(|j| j.spec.fine == *z && j.spec.coarse == body)?;
        Some((*z, joint.weights.external.clone()))
    });
    let zones: Vec<_> = zones.collect();
    for (sample, time) in profile::samples(&path, l)? {
        let field = load::traction(&path, &sample, &facets)?;
        let shared = Shared {
            path: &path,
            group: &group,
            bodies,
            folder,
            body,
            zones: &zones,
            skin: &skin,
            prescribed: Resultant::of_facets(&facets, &field),
            field,
            profiled: l.profile.is_some(),
        };
        // `factor` differs from one only in an overlap with a model that is no zone.
        for part in shared.distribute()? {
            if part.model != body {
                not_twice(k, &part, scene, &bodies[part.model])?;
            }
            let factor = shared.load_factor(part.model, joints)?;
            let forces = part.carriers.0.iter().flat_map(|(n, c)| {
                let f = c.force * factor(&c.point);
                (0..3).map(move |axis| (3 * n + axis, f[axis]))
            });
            let load = effect::Load::shared(&load::name(k, l), forces.collect(), time.clone());
            let load = load.map_err(core(&*path))?;
            let sum = match out.remove(&part.model) {
                Some(sum) => sum.plus(load),
                None => load,
            };
            out.insert(part.model, sum);
        }
    }
    Ok(out.into_iter().collect())
}

/// Refuses a load on a zone where a load on the body already acts: the zone would be loaded twice.
fn not_twice(k: usize, part: &Part, scene: &LoweredScene, body: &Body) -> Result<()> {
    let (zone, whole) = (body.model.name(), &scene.load[k].model);
    for (o, other_load) in scene.load.iter().enumerate().filter(|(_, o)| o.model == zone) {
        let key_path = format!("load[{o}].where");
        let nodes = match select::facets(&key_path, body, &other_load.at)? {
            Some(facets) => facets.into_iter().flat_map(|f| f.nodes).collect(),
            None => select::nodes(&key_path, body, &other_load.at)?,
        };
        if nodes.iter().any(|n| part.carriers.0.contains_key(n)) {
            let rule = format!(
                "is on '{zone}' where load[{k}] on '{whole}' acts already: a load on the body is shared with its zones; remove this \
                 one, or give it to '{whole}' as well if both are meant"
            );
            return Err(key(format!("load[{o}].model"), rule));
        }
    }
    Ok(())
}

impl<'a> Shared<'a> {
    /// Facets of a model on the loaded surface.
    fn facets_of(&self, body: &Body) -> Vec<SurfaceFacet<f64>> {
        let facets = body.surfaces.get(self.group).into_iter().flatten();
        // The distance leaves out facets on a cut, of which only the corners lie on the surface.
        let reach = SKIN * body.spacing;
        let facets = facets.filter(|f| self.skin.distance(&f.centre) <= reach);
        let facets: Vec<_> = facets.cloned().collect();
        match self.profiled {
            true => profile::split(&facets, body.model.nodes(), profile::AT_NODES),
            false => facets,
        }
    }

    /// Distributes the load over the models; the sum is the prescribed load.
    fn distribute(&self) -> Result<Vec<Part>> {
        let mut body_part = Part::new(self.body);
        let body = &self.bodies[self.body];
        let coarse = |x: &Point3<f64>| 1.0 - self.zones.iter().map(|(_, f)| 1.0 - f.value(x)).sum::<f64>();
        body_part.carry(body, &self.facets_of(body), &self.field, &coarse);
        let mut zones = Vec::new();
        for (z, f) in self.zones {
            let fine = |x: &Point3<f64>| 1.0 - f.value(x);
            let body = &self.bodies[*z];
            let part = match (&body.shape, body.grains.is_some()) {
                (BodyShape::Piece(piece), true) => {
                    let facets = piece.facets(self.group, self.folder)?;
                    self.on_spheres(*z, &facets, &fine)?
                }
                _ => {
                    let mut part = Part::new(*z);
                    part.carry(body, &self.facets_of(body), &self.field, &fine);
                    part
                }
            };
            zones.push(part);
        }
        let exerted = zones
            .iter()
            .chain([&body_part])
            .map(|p| p.carriers.exert(self.prescribed.wrench.about));
        // Facets of zones may differ from those of the body, so a difference in force and moment remains.
        let missing = exerted.fold(self.prescribed.wrench, |wrench, part| wrench.minus(&part));
        self.make_up(&mut zones, missing)?;
        zones.push(body_part);
        // A load without a force would only add an empty line to the ledger.
        zones.retain(|p| !p.carriers.0.is_empty());
        Ok(zones)
    }

    /// Forces on the spheres of a zone. Each sphere that touches the surface carries the traction of the
    /// nearest facet on an area in proportion to its section; the resultant is corrected to that of the
    /// facets.
    fn on_spheres(&self, zone: usize, facets: &[SurfaceFacet<f64>], share: &Share<'_>) -> Result<Part> {
        let mut part = Part::new(zone);
        let mut target = Wrench::zero(self.prescribed.wrench.about);
        for f in facets {
            target.add(&f.centre, &((self.field)(f) * (f.area() * share(&f.centre))));
        }
        let carried: f64 = facets.iter().map(|f| f.area() * share(&f.centre)).sum();
        let whole: f64 = facets.iter().map(SurfaceFacet::area).sum();
        // Round-off of the weights is no reason to ask for spheres at this surface.
        if carried <= NO_PART * whole {
            return Ok(part);
        }
        let body = &self.bodies[zone];
        let touching = body.groups.get(self.group).map_or(&[][..], Vec::as_slice);
        // By section and share: the sum of the areas is then that of the facets.
        let section = |n: usize| body.grid.radii[n].powi(2) * share(&body.model.nodes()[n]);
        let sum: f64 = touching.iter().map(|n| section(*n)).sum();
        for &n in touching {
            let x = body.model.nodes()[n];
            let distance = |f: &&SurfaceFacet<f64>| (f.centre - x).norm_squared();
            // The nearest centre is accurate enough, since the resultant is corrected below.
            let near = facets.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let area = carried * section(n) / sum;
            part.carriers.add(
                n,
                x,
                area,
                near.map_or(Vector3::zeros(), |f| (self.field)(f) * area),
            );
        }
        let missing = target.minus(&part.carriers.exert(target.about));
        self.make_up(std::slice::from_mut(&mut part), missing)?;
        Ok(part)
    }

    /// Adds forces on the nodes of the parts, in proportion to area, with the missing resultant.
    fn make_up(&self, parts: &mut [Part], missing: Wrench) -> Result<()> {
        let carriers = parts.iter_mut().flat_map(|p| p.carriers.0.values_mut());
        let remainder = make_up(&mut carriers.collect::<Vec<_>>(), self.profiled, missing);
        let who = "the zones of the body have too few spheres or nodes at this surface to carry their share; take smaller \
                   spheres, or keep the zone and its overlap away from it";
        self.prescribed.enough(self.path, who, &remainder)
    }

    /// Returns the factor by which interfaces with models other than zones reduce the load on a model, as a
    /// function of the point. The scene must give those models their share of the load.
    fn load_factor(&self, model: usize, joints: &[BuiltInterface]) -> Result<Box<Share<'a>>> {
        let zones: Vec<_> = self.zones.iter().map(|z| z.1.clone()).collect();
        let own_weight = zones.iter().zip(self.zones).find(|(_, z)| z.0 == model);
        let own_weight = own_weight.map(|(f, _)| f.clone());
        let actual = weights::model_weights(model, joints)?.external;
        Ok(Box::new(move |x| {
            let share = match &own_weight {
                Some(f) => 1.0 - f.value(x),
                None => 1.0 - zones.iter().map(|f| 1.0 - f.value(x)).sum::<f64>(),
            };
            // Where the model carries nothing of the load, the factor does not matter and would be 0/0.
            if share > NO_PART {
                actual.value(x) / share
            } else {
                1.0
            }
        }))
    }
}

/// Loaded surface of load `k` on a body with zones: name of its group, facets of the whole body, and these as
/// triangles.
pub(super) fn surface(
    k: usize,
    scene: &LoweredScene,
    body: &Body,
    folder: &Path,
) -> Result<(String, Vec<SurfaceFacet<f64>>, Faces)> {
    let (path, selection) = (format!("load[{k}]"), &scene.load[k].at);
    let group = match selection {
        Selection::Group(name) => name.clone(),
        Selection::Box(..) => path.clone(),
    };
    let BodyShape::Piece(piece) = &body.shape else {
        return Err(key(path, "is on a body without zones"));
    };
    let whole = piece.whole(folder)?;
    let path = format!("{path}.where");
    match (whole.groups().get(&group), selection) {
        (Some(g), _) if !g.facets.is_empty() => {
            let skin = Faces::new(corners_of(whole, &g.facets));
            let facets = whole.surface(&group).map_err(fem(path))?;
            Ok((group, facets, skin))
        }
        (Some(_), Selection::Group(_)) | (_, Selection::Box(..)) => {
            let rule =
                format!("{selection} holds no surface facet of the body; choose a surface or a larger box");
            Err(key(path, rule))
        }
        (None, _) => {
            let groups = whole.groups().iter().filter(|(_, g)| !g.facets.is_empty());
            let groups: BTreeMap<_, _> = groups.map(|(n, _)| (n.clone(), ())).collect();
            Err(unknown(
                path,
                &group,
                "surface of the body",
                select::named(&groups),
            ))
        }
    }
}

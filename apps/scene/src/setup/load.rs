//! Loads: tractions on the surface of a model, or forces on the nodes of a model without a surface.

use super::body::Body;
use super::drive::Chosen;
use super::faces::Faces;
use super::kinds::kind;
use super::profile::{self, Patch};
use super::select;
use super::skin::{self, Skin};
use super::spread::{Carrier, Carriers, Resultant, Traction, distribute, make_up, polar, turn};
use super::time::time_function;
use crate::error::{Error, Result, core, key};
use crate::setup::LoweredModel;
use crate::spec::Load;
use arlequin::core::TimeFunction;
use arlequin::core::effect::{self, SurfaceFacet};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::dem_beam::TOUCH;

/// Longest edge of the facets of spheres under a profile, in mean diameters.
const PROFILE: f64 = 0.5;

/// Relative difference between the area of a loaded surface and that of its faces that counts as none; faces
/// of hexahedra may be warped.
const SAME_AREA: f64 = 1e-3;

/// Name of load `k` in the ledger.
pub(super) fn name(k: usize, l: &Load) -> String {
    l.name.clone().unwrap_or_else(|| format!("load-{}", k + 1))
}

/// Refuses a load that does not have exactly one of traction, force, pressure, torque, and a profile that
/// cannot be read.
pub(super) fn check(path: &str, l: &Load) -> Result<()> {
    let choices = [
        l.traction.is_some(),
        l.force.is_some(),
        l.pressure.is_some(),
        l.torque.is_some(),
    ];
    if choices.iter().filter(|g| **g).count() != 1 {
        return Err(key(
            path,
            "needs exactly one of traction, force, pressure, torque",
        ));
    }
    profile::check(path, l)?;
    if l.follow && (l.pressure.is_none() || l.profile.is_some()) {
        let rule =
            "lets a uniform pressure turn with the surface; give a pressure without profile, or remove it";
        return Err(key(format!("{path}.follow"), rule));
    }
    Ok(())
}

/// Refuses tractions on a model without a surface, and torques on a chain, which cannot turn.
pub(super) fn check_surface(path: &str, l: &Load, table: &LoweredModel) -> Result<()> {
    if kind(table.kind).carries(l) {
        return Ok(());
    }
    Err(no_surface(path, &l.model))
}

fn no_surface(path: &str, model: &str) -> Error {
    key(path, format!("model '{model}' has no surface; give a force [N]"))
}

/// Builds a load on one model, fixed or following.
pub(super) fn build(path: &str, name: &str, l: &Load, body: &Body) -> Result<Chosen> {
    check(path, l)?;
    match l.pressure {
        Some(p) if l.follow => following(path, name, p, l, body),
        _ => Ok(Box::new(fixed(path, name, l, body)?)),
    }
}

/// Refuses a load that follows on particles, and on a body that has it in common with its zones.
pub(super) fn check_follow(path: &str, l: &Load, table: &LoweredModel, shared: bool) -> Result<()> {
    let rule = match (shared, kind(table.kind).has_spheres()) {
        _ if !l.follow => return Ok(()),
        (true, _) => "acts on a model of its own, not on a body with zones; name a model, or remove it",
        (_, true) => "needs the surface of a solid of finite or natural elements, not particles; remove it",
        _ => return Ok(()),
    };
    Err(key(format!("{path}.follow"), rule))
}

/// Builds a load on one model that keeps the surface as it is at rest.
pub(super) fn fixed(path: &str, name: &str, l: &Load, body: &Body) -> Result<effect::Load<f64>> {
    let nodes = body.model.nodes();
    let mut facets = select::facets(&format!("{path}.where"), body, &l.at)?;
    if let (Some(facets), Some(_)) = (&mut facets, &l.profile) {
        let surface = Patch::from_facets(facets, nodes);
        profile::check_samples(path, l, &surface, profile::AT_NODES)?;
        *facets = profile::split(facets, nodes, profile::AT_NODES);
    } else if let (Some(skin), Some(_)) = (on_surface_of_spheres(l, body), &l.profile) {
        let patch = |t: &[Point3<f64>; 3]| Patch {
            centre: skin::facet(t).centre,
            corners: t.to_vec(),
            area: skin::facet(t).area(),
        };
        let triangles = surface_of_spheres(path, l, body, skin)?;
        let surface: Vec<Patch> = triangles.iter().map(patch).collect();
        profile::check_samples(path, l, &surface, profile::AT_CENTRES)?;
    }
    let build = |(l, time): (Load, TimeFunction<f64>)| {
        let Some(facets) = &facets else {
            return match on_surface_of_spheres(&l, body) {
                Some(skin) => load_on_spheres(path, name, &l, (body, skin), time),
                None => load_on_nodes(path, name, &l, body, time),
            };
        };
        let field = traction(path, &l, facets)?;
        effect::Load::traction(name, facets.clone(), &*field, time).map_err(core(path))
    };
    let mut samples = profile::samples(path, l)?.into_iter();
    let Some(first) = samples.next() else {
        return Err(key(path, "has no sample of its profile; report this"));
    };
    samples.try_fold(build(first)?, |sum, next| Ok(sum.plus(build(next)?)))
}

/// Builds a pressure that turns with the surface. It acts on the faces whose nodes are those of selected
/// facets.
fn following(path: &str, name: &str, pressure: f64, l: &Load, body: &Body) -> Result<Chosen> {
    let time = time_function(&format!("{path}.time"), &l.time)?;
    let facets = select::facets(&format!("{path}.where"), body, &l.at)?;
    let (Some(facets), Some(surface)) = (facets, body.model.views().surface) else {
        let rule = format!(
            "needs the surface of a solid of finite or natural elements, which model '{}' is not; remove it",
            body.model.name()
        );
        return Err(key(format!("{path}.follow"), rule));
    };
    let mut held = vec![Vec::new(); body.model.nodes().len()];
    for (k, f) in facets.iter().enumerate() {
        f.nodes.iter().for_each(|n| held[*n].push(k));
    }
    let is_held = |face: &[u32; 4]| {
        let [first, others @ ..] = face.map(|n| &held[n as usize]);
        first.iter().any(|k| others.iter().all(|o| o.contains(k)))
    };
    let faces: Vec<[u32; 4]> = surface.faces().into_iter().filter(is_held).collect();
    let nodes = body.model.nodes();
    let area = |[a, b, c, d]: &[u32; 4]| {
        let [a, b, c, d] = [a, b, c, d].map(|n| nodes[*n as usize]);
        0.5 * ((b - a).cross(&(c - a)) + (c - a).cross(&(d - a))).norm()
    };
    let (loaded, whole): (f64, f64) = (
        faces.iter().map(area).sum(),
        facets.iter().map(SurfaceFacet::area).sum(),
    );
    if (loaded / whole - 1.0).abs() > SAME_AREA {
        let rule = format!(
            "needs a surface of whole faces: those in it have {loaded:.6e} m², the surface has {whole:.6e} m²; move its border"
        );
        return Err(key(format!("{path}.where"), rule));
    }
    let pressure = effect::FollowingPressure::new(name, faces, pressure, time);
    Ok(Box::new(pressure.map_err(core(path))?))
}

/// Traction of a load on the given facets \[Pa\].
///
/// # Errors
/// Those of its profile, and of [`torque`].
pub(super) fn traction(path: &str, l: &Load, facets: &[SurfaceFacet<f64>]) -> Result<Traction> {
    let area: f64 = facets.iter().map(SurfaceFacet::area).sum();
    let field: Traction = if let Some(t) = l.traction {
        Box::new(move |_| Vector3::from(t))
    } else if let Some(f) = l.force {
        Box::new(move |_| Vector3::from(f) / area)
    } else if let Some(p) = l.pressure {
        Box::new(move |f| -f.normal * p)
    } else {
        torque(path, Vector3::from(l.torque.unwrap_or_default()), facets)?
    };
    profile::multiply(path, l, field, facets)
}

/// Returns the centre `c` and the vector `θ` with which forces `a θ × (x − c)` at points `x` have a given
/// moment and no resultant.
///
/// # Errors
/// A zero moment, or points that cannot carry it.
fn turning(
    path: &str,
    moment: Vector3<f64>,
    places: impl Iterator<Item = (Point3<f64>, f64)> + Clone,
) -> Result<(Point3<f64>, Vector3<f64>)> {
    let (centre, polar) = polar(places);
    let turn = turn(&polar, &moment);
    // The pseudo-inverse drops components of the moment that the points cannot carry: refuse these.
    if turn.norm() > 0.0 && (polar * turn - moment).norm() <= 1e-9 * moment.norm() {
        return Ok((centre, turn));
    }
    Err(key(
        format!("{path}.torque"),
        "needs a moment other than zero, and several facets or nodes around its axis",
    ))
}

/// Tractions `θ × (x − c)` about the centroid with the given moment \[Pa\].
fn torque(path: &str, moment: Vector3<f64>, facets: &[SurfaceFacet<f64>]) -> Result<Traction> {
    let (centre, turn) = turning(path, moment, facets.iter().map(|f| (f.centre, f.area())))?;
    Ok(Box::new(move |f| turn.cross(&(f.centre - centre))))
}

/// Returns the surface of a model of particles if it carries the load; a force or torque acts by mass.
pub(super) fn on_surface_of_spheres<'a>(l: &Load, body: &'a Body) -> Option<&'a Skin> {
    let grains = body.grains.as_ref()?;
    (l.traction.is_some() || l.pressure.is_some()).then_some(&grains.skin)
}

/// Distributes a traction or pressure over the spheres at the surface.
fn load_on_spheres(
    path: &str,
    name: &str,
    l: &Load,
    (body, skin): (&Body, &Skin),
    time: TimeFunction<f64>,
) -> Result<effect::Load<f64>> {
    let carriers = carriers(path, l, body, skin)?;
    let forces = carriers.0.iter();
    let forces = forces.flat_map(|(n, c)| (0..3).map(move |axis| (3 * n + axis, c.force[axis])));
    effect::Load::on_dofs(name, forces.collect(), time).map_err(core(path))
}

/// Returns the loaded surface of a model of particles in triangles.
fn surface_of_spheres(path: &str, l: &Load, body: &Body, skin: &Skin) -> Result<Vec<[Point3<f64>; 3]>> {
    let triangles = skin.select(&format!("{path}.where"), body.model.name(), &l.at, body.spacing)?;
    // Facets have one traction each.
    Ok(match l.profile {
        Some(_) => skin::refined(triangles, PROFILE * body.spacing),
        None => triangles,
    })
}

/// Returns the spheres that carry a traction or pressure.
///
/// # Errors
/// A selection without surface or without spheres; spheres that are too few to carry the moment.
pub(super) fn carriers(path: &str, l: &Load, body: &Body, skin: &Skin) -> Result<Carriers> {
    let (name, key_path) = (body.model.name(), format!("{path}.where"));
    let triangles = surface_of_spheres(path, l, body, skin)?;
    let facets: Vec<SurfaceFacet<f64>> = triangles.iter().map(skin::facet).collect();
    let field = traction(path, l, &facets)?;
    let prescribed = Resultant::of_facets(&facets, &field);
    let radii = &body.grid.radii;
    let gap = TOUCH * 0.5 * body.spacing;
    let (faces, points) = (Faces::new(triangles), body.model.nodes());
    let [low, high] = faces.bounds();
    let reach = |k: usize| radii[k] + gap;
    let is_near =
        |k: &usize| (0..3).all(|c| points[*k][c] + reach(*k) > low[c] && points[*k][c] - reach(*k) < high[c]);
    let near = (0..points.len()).filter(is_near);
    let touching: Vec<(usize, usize)> = near
        .map(|k| (k, faces.nearest(&points[k])))
        .filter(|(k, (_, distance))| *distance < reach(*k))
        .map(|(k, (triangle, _))| (k, triangle))
        .collect();
    if touching.is_empty() {
        let rule = format!(
            "no sphere of model '{name}' touches {}; choose a larger surface, or smaller spheres",
            l.at
        );
        return Err(key(key_path, rule));
    }
    let mut out = distribute(&touching, (points, radii), &facets, &field);
    let missing = prescribed.wrench.minus(&out.exert(prescribed.wrench.about));
    let mut all: Vec<&mut Carrier> = out.0.values_mut().collect();
    let remainder = make_up(&mut all, l.profile.is_some(), missing);
    let who = format!(
        "too few spheres of model '{name}' touch {} to carry its moment; choose a larger surface, or smaller spheres",
        l.at
    );
    prescribed.enough(path, &who, &remainder)?;
    Ok(out)
}

/// Distributes a force over the nodes of a model without a surface, in proportion to mass; a torque becomes
/// forces `m_i θ × (x_i − c)`.
fn load_on_nodes(
    path: &str,
    name: &str,
    l: &Load,
    body: &Body,
    time: TimeFunction<f64>,
) -> Result<effect::Load<f64>> {
    let nodes = select::nodes(&format!("{path}.where"), body, &l.at)?;
    let layout = body.model.layout();
    let count = layout.components;
    let mut inertia = vec![0.0; layout.dofs()];
    let uniform = arlequin::core::Uniform(1.0);
    body.model
        .lumped_inertia(&uniform, &mut inertia)
        .map_err(core(path))?;
    let total: f64 = nodes.iter().map(|n| inertia[n * count]).sum();
    let share = |n: usize| inertia[n * count] / total;
    let field: Box<dyn Fn(usize) -> Vector3<f64>> = match (l.force, l.torque) {
        (Some(f), _) => Box::new(move |_| Vector3::from(f)),
        (None, Some(m)) if count == 3 => {
            let points = body.model.nodes();
            let places = nodes.iter().map(|n| (points[*n], share(*n)));
            let (centre, turn) = turning(path, Vector3::from(m), places)?;
            Box::new(move |n| turn.cross(&(points[n] - centre)))
        }
        _ => return Err(no_surface(path, body.model.name())),
    };
    let forces = nodes.iter().flat_map(|&n| {
        let f = field(n) * share(n);
        (0..count).map(move |c| (n * count + c, f[c]))
    });
    effect::Load::on_dofs(name, forces.collect(), time).map_err(core(path))
}

//! Loads on surfaces in an overlap: each model carries them with its weight, so that the sum can be less than
//! the prescribed load.
//!
//! A total force or moment is distributed over the surface of each model separately. A traction or pressure
//! has a value at each point; in an overlap it is complete only if a second load gives the share of the other
//! model.

use super::body::Body;
use super::names::{loaded_parts, model_index};
use super::{load, profile, select, skin};
use crate::error::{Result, core};
use crate::setup::LoweredScene;
use crate::spec::Load;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Uniform, Weight};

/// Largest relative deviation of a load that is tolerated.
const SAME: f64 = 0.01;
/// Largest share of a surface without spheres that is tolerated.
const BARE: f64 = 0.05;

/// Points at which a load acts, with their shares of the load; the shares sum to one.
#[derive(Debug)]
pub(super) struct Total {
    load: usize,
    model: usize,
    parts: Vec<(Point3<f64>, f64)>,
    /// Largest distance \[m\] from one of `parts` at which a point still counts as loaded.
    reach: f64,
    /// Area of the loaded surface \[m²\].
    area: f64,
    /// Share of the loaded surface of particles that no sphere touches any more.
    bare: f64,
}

/// Loads of a scene, except those on a body with zones, which are distributed exactly over its models.
pub(super) fn collect(scene: &LoweredScene, bodies: &[Body]) -> Result<Vec<Total>> {
    let mut out = Vec::new();
    for (k, l) in scene.load.iter().enumerate() {
        let path = format!("load[{k}]");
        let model = model_index(&format!("{path}.model"), &l.model, scene)?;
        if loaded_parts(scene, model).len() > 1 {
            continue;
        }
        let body = &bodies[model];
        let key_path = format!("{path}.where");
        let mut bare = 0.0;
        let mut parts: Vec<_> = match select::facets(&key_path, body, &l.at)? {
            Some(facets) => facets.iter().map(|f| (f.centre, f.area())).collect(),
            None => match load::on_surface_of_spheres(l, body) {
                Some(skin) => {
                    // The carriers of all samples are the same.
                    let (sample, _) = &profile::samples(&path, l)?[0];
                    let carriers = load::carriers(&path, sample, body, skin)?.0;
                    let points: Vec<_> = carriers.values().map(|c| c.point).collect();
                    let triangles = skin.select(&key_path, &l.model, &l.at, body.spacing)?;
                    bare = skin::bare_share(triangles, &points, body.spacing);
                    carriers.values().map(|c| (c.point, c.area)).collect()
                }
                None => {
                    let layout = body.model.layout();
                    let mut masses = vec![0.0; layout.dofs()];
                    let weighed = body.model.lumped_inertia(&Uniform(1.0), &mut masses);
                    weighed.map_err(core(path))?;
                    let nodes = select::nodes(&key_path, body, &l.at)?;
                    let part = |n: &usize| (body.model.nodes()[*n], masses[n * layout.components]);
                    nodes.iter().map(part).collect()
                }
            },
        };
        let area = parts.iter().map(|p| p.1).sum();
        if let Some(moment) = l.torque {
            levers(Vector3::from(moment), &mut parts);
        }
        let sum: f64 = parts.iter().map(|p| p.1).sum();
        parts.iter_mut().for_each(|p| p.1 /= sum);
        out.push(Total {
            load: k,
            model,
            parts,
            reach: body.spacing,
            area,
            bare,
        });
    }
    Ok(out)
}

/// Multiplies the share of each point by the square of its lever arm, as a moment is distributed.
fn levers(moment: Vector3<f64>, parts: &mut [(Point3<f64>, f64)]) {
    let sum: f64 = parts.iter().map(|p| p.1).sum();
    let middle = parts.iter().fold(Vector3::zeros(), |s, (x, a)| s + x.coords * *a) / sum;
    let axis = moment.try_normalize(0.0).unwrap_or_default();
    for (x, part) in parts {
        *part *= axis.cross(&(x.coords - middle)).norm_squared();
    }
}

/// Warns about loads whose sum over the models differs from the prescribed value. Loads with equal
/// numbers and the same name (or none) are parts of one load.
pub(super) fn warnings(scene: &LoweredScene, totals: &[Total], run: &Coupled<f64>) -> Vec<String> {
    let bits = |v: [f64; 3]| v.map(f64::to_bits);
    let key = |t: &Total| {
        let l = &scene.load[t.load];
        let pressure = l.pressure.map(f64::to_bits);
        let numbers = [l.force, l.torque, l.traction].map(|v| v.map(bits));
        (l.name.clone(), pressure, numbers, l.profile.clone())
    };
    let mut out: Vec<String> = totals.iter().filter_map(bare).collect();
    for (k, first) in totals.iter().enumerate() {
        if totals[..k].iter().any(|t| key(t) == key(first)) {
            continue;
        }
        let halves: Vec<&Total> = totals[k..].iter().filter(|t| key(t) == key(first)).collect();
        let l = &scene.load[first.load];
        let finding = if l.force.is_some() || l.torque.is_some() {
            total(l, &halves, run)
        } else {
            surface(&halves, run)
        };
        let remedy = if scene.zone.contains_key(&l.model) {
            "; give it to the model 'body', which shares it with its zones"
        } else {
            ""
        };
        let name = load::name(first.load, l);
        out.extend(
            finding.map(|(what, why)| format!("load[{}]: of {what} of '{name}' {why}{remedy}", first.load)),
        );
    }
    out
}

/// Message about a traction or pressure on a surface of which notches took the spheres.
fn bare(t: &Total) -> Option<String> {
    (t.bare > BARE).then(|| {
        format!(
            "load[{}]: {:.0} % of its surface has no sphere; the spheres beside carry that part as well: give where.box, a box around \
             the part that is there",
            t.load,
            100.0 * t.bare
        )
    })
}

fn weight<'a>(t: &Total, run: &'a Coupled<f64>) -> &'a dyn Weight<f64> {
    &*run.subdomains()[t.model].weights().external
}

/// Message about a force or moment whose sum differs from the prescribed one.
fn total(l: &Load, halves: &[&Total], run: &Coupled<f64>) -> Option<(String, String)> {
    let share = |t: &&Total| {
        t.parts
            .iter()
            .map(|(x, part)| part * weight(t, run).value(x))
            .sum::<f64>()
    };
    let shares: Vec<f64> = halves.iter().map(share).collect();
    let acts: f64 = shares.iter().sum();
    // Outside of overlaps every load acts completely, even several of one name.
    if !((acts - 1.0).abs() > SAME && shares.iter().any(|s| (s - 1.0).abs() > SAME)) {
        return None;
    }
    let (size, unit) = match (l.force, l.torque) {
        (Some(f), _) => (Vector3::from(f).norm(), "N"),
        (_, t) => (Vector3::from(t.unwrap_or_default()).norm(), "N m"),
    };
    let why = format!(
        "{:.4e} {unit} act: its surface lies in an overlap, wholly or in part, where every model spreads it over its own surface and \
         counts it with its weight; give a traction [Pa] in all models that are there, or a surface that has no part in the overlap",
        acts * size
    );
    Some((format!("the {size:.4e} {unit}"), why))
}

/// Message about a traction or pressure with a share that no model carries.
fn surface(halves: &[&Total], run: &Coupled<f64>) -> Option<(String, String)> {
    let (mut acts, mut lost) = (0.0, 0.0);
    for t in halves {
        for (x, part) in &t.parts {
            let weight_here = weight(t, run).value(x);
            let partners = halves.iter().filter(|o| o.model != t.model);
            let covers = |o: &&&Total| o.parts.iter().any(|p| (p.0 - x).norm() <= o.reach);
            let missing = if weight_here < 1.0 - SAME {
                let partners = partners.filter(covers).map(|o| weight(o, run).value(x));
                1.0 - weight_here - partners.sum::<f64>()
            } else {
                0.0
            };
            acts += t.area * part * weight_here;
            lost += t.area * part * missing.max(0.0);
        }
    }
    let share = lost / (acts + lost);
    let why = format!(
        "{:.1} % is lost: its surface lies in an overlap, wholly or in part, where a model carries it with its weight alone; give the \
         same to the other model there as well, or a surface that has no part in the overlap",
        100.0 * share
    );
    (share > SAME).then(|| ("the traction".to_owned(), why))
}

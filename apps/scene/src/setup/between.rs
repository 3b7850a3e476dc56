//! Contact between two models, and the check for models of particles that overlap without contact.

use super::body::{Body, material};
use super::grains;
use super::kinds::kind;
use super::names::{contact_sides, sides_of};
use crate::error::{Result, core, dem, key};
use crate::setup::LoweredScene;
use crate::spec::EffectKind;
use arlequin::core::Coupled;
use arlequin::core::contact::{Exterior, SurfaceContact};
use arlequin::core::effect::{Finding, PairEffectSpec, PairSpec};
use arlequin::dem_beam::{ContactBetween, ContactBody};
use std::collections::BTreeSet;

/// Overlap over the sum of radii above which two particles need contact; the same value as within a model.
const TOLERATED_OVERLAP: f64 = 0.01;

fn ordered([a, b]: [usize; 2]) -> [usize; 2] {
    [a.min(b), a.max(b)]
}

/// Enabled contacts between models: number of the effect, numbers of the models.
pub(super) fn touching(scene: &LoweredScene) -> Result<Vec<(usize, [usize; 2])>> {
    let mut out = Vec::new();
    let mut pairs_seen = BTreeSet::new();
    for (k, e) in scene.effect.iter().enumerate() {
        let Some(pair) = contact_sides(k, e, scene)?.filter(|_| e.enabled) else {
            continue;
        };
        let flat = |m: usize| {
            scene
                .model
                .values()
                .nth(m)
                .is_some_and(|t| !kind(t.kind).has_spheres())
        };
        let rolls = matches!(&e.kind, EffectKind::Contact(c) if c.rolling.is_some_and(|r| r > 0.0));
        if rolls && pair.into_iter().any(flat) {
            let rule = "is between particles only, as a facet takes no moment; remove it";
            return Err(key(format!("effect[{k}].contact.rolling"), rule));
        }
        if !pairs_seen.insert(ordered(pair)) {
            let rule = "names a pair of models that has contact already; keep one";
            return Err(key(format!("effect[{k}].between"), rule));
        }
        out.push((k, pair));
    }
    Ok(out)
}

fn body(bodies: &[Body], m: usize) -> Option<&ContactBody> {
    bodies[m].grains.as_ref().map(|g| &g.body)
}

/// Builds the contacts between two models of a scene.
pub(super) fn pairs(scene: &LoweredScene, bodies: &[Body]) -> Result<Vec<PairSpec<f64>>> {
    let mut out = Vec::new();
    for (k, [a, b]) in touching(scene)? {
        let EffectKind::Contact(contact) = &scene.effect[k].kind else {
            continue;
        };
        let path = format!("effect[{k}].contact");
        let [e, f] = [material(&path, &bodies[a])?, material(&path, &bodies[b])?].map(|m| m.young());
        // The contact stiffness of two different materials is that of two springs in series.
        let law = grains::law(2.0 * e * f / (e + f), contact);
        let effect: Box<dyn PairEffectSpec<f64>> = match (body(bodies, a), body(bodies, b)) {
            (Some(first), Some(second)) => {
                let contact = ContactBetween::new(first.clone(), second.clone(), law);
                Box::new(contact.map_err(dem(path))?)
            }
            _ => {
                let [first, second] = [exterior(&path, &bodies[a])?, exterior(&path, &bodies[b])?];
                Box::new(SurfaceContact::new(&first, &second, law).map_err(core(path))?)
            }
        };
        out.push(PairSpec {
            sides: [a, b],
            effect,
        });
    }
    Ok(out)
}

/// Spheres or surface of a body.
fn exterior(path: &str, body: &Body) -> Result<Exterior> {
    let spheres = body.grains.as_ref().map(|g| g.body.exterior());
    spheres
        .or_else(|| Exterior::surface(&*body.model))
        .ok_or_else(|| {
            let rule = format!(
                "needs the surface of model '{}', which has none; remove it",
                body.model.name()
            );
            key(path, rule)
        })
}

/// Pairs of particle models that have neither contact nor an interface: their particles can pass through each
/// other.
#[derive(Debug, Default)]
pub struct ParticlesWithoutContact(Vec<([usize; 2], [ContactBody; 2])>);

impl ParticlesWithoutContact {
    /// Finds these pairs in a scene.
    pub(super) fn from_scene(scene: &LoweredScene, bodies: &[Body]) -> Result<Self> {
        let mut connected: BTreeSet<[usize; 2]> =
            touching(scene)?.into_iter().map(|(_, p)| ordered(p)).collect();
        for (name, i) in &scene.interface {
            connected.insert(ordered(sides_of(name, i, scene)?));
        }
        let mut out = Vec::new();
        for b in 0..bodies.len() {
            for a in (0..b).filter(|a| !connected.contains(&[*a, b])) {
                if let (Some(first), Some(second)) = (body(bodies, a), body(bodies, b)) {
                    out.push(([a, b], [first.clone(), second.clone()]));
                }
            }
        }
        Ok(Self(out))
    }

    /// Pairs whose particles overlap now: name of the first model, and the finding.
    pub fn watch(&self, run: &Coupled<f64>) -> Vec<(String, Finding)> {
        let mut out = Vec::new();
        for (sides, [a, b]) in &self.0 {
            let displaced = sides.map(|m| &run.subdomains()[m].state().q[..]);
            if let Some((count, worst)) = a.overlaps(b, displaced, TOLERATED_OVERLAP) {
                let [first_name, second_name] = [a.name(), b.name()];
                let message = format!(
                    "{count} of its particles and those of '{second_name}' overlap, by up to {:.1} % of their radii; switch on \
                     contact with between = [\"{first_name}\", \"{second_name}\"]",
                    100.0 * worst
                );
                let finding = Finding {
                    effect: "contact",
                    message,
                };
                out.push((first_name.to_owned(), finding));
            }
        }
        out
    }
}

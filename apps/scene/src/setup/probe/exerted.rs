//! Forces and moments that supports, loads, rigid bodies and other effects exert on the models; probes read
//! them.

use super::rules::axis;
use crate::error::{Result, core, key, unknown, value};
use crate::setup::body::Body;
use crate::setup::names::{contact_sides, effect_models, loaded_parts, model_index, parts};
use crate::setup::{LoweredScene, load, obstacle_parts, select};
use crate::spec::{EffectKind, Probe, Quantity, Selection};
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, Resultant};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Supports and effects of one name, whose force a probe reads.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Exerted {
    name: String,
    about: Point3<f64>,
    /// Support by number of the model, and number among the supports of that model.
    supports: Vec<(usize, usize)>,
    /// Numbers of the models that effects of this name act on.
    models: Vec<usize>,
}

/// Forces at one instant; each is computed once, however many probes read it.
#[derive(Debug, Default)]
pub struct Readings<'a> {
    reactions: BTreeMap<usize, Vec<f64>>,
    resultants: Vec<(&'a Exerted, Resultant<f64>)>,
}

impl<'a> Readings<'a> {
    /// Force and moment on the models about the point of the probe.
    pub(super) fn resultant(&mut self, what: &'a Exerted, run: &mut Coupled<f64>) -> Result<Resultant<f64>> {
        if let Some((_, resultant)) = self.resultants.iter().find(|(w, _)| *w == what) {
            return Ok(*resultant);
        }
        let error_key = || format!("the force of '{}'", what.name);
        let mut sum = Resultant::zero();
        for &(m, support) in &what.supports {
            let reactions = match self.reactions.entry(m) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(empty) => empty.insert(run.reactions(m).map_err(core(error_key()))?),
            };
            let part = run.support_resultant(m, support, reactions, &what.about);
            sum += part.map_err(core(error_key()))?;
        }
        for &m in &what.models {
            let part = run.effect_resultant(m, &what.name, &what.about);
            sum += part.map_err(core(error_key()))?;
        }
        self.resultants.push((what, sum));
        Ok(sum)
    }
}

/// Supports and effects that have a given name, before anything is built.
#[derive(Default)]
struct Bearers<'a> {
    supports: Vec<(usize, usize)>,
    models: Vec<usize>,
    /// Models, and the nodes of each that are supported or loaded.
    parts: Vec<(usize, &'a Selection)>,
    /// Centre of the rigid body, if it is one \[m\].
    centre: Option<[f64; 3]>,
    /// True if an effect of the name acts on whole models.
    everywhere: bool,
    /// True if there is an effect of the name, enabled or not.
    effect: bool,
}

/// Name of support `k`.
fn support_name(k: usize, scene: &LoweredScene) -> String {
    let given_name = scene.support[k].name.clone();
    given_name.unwrap_or_else(|| format!("support-{}", k + 1))
}

/// Names of all supports, loads and effects, sorted.
fn names(scene: &LoweredScene) -> Vec<String> {
    let supports = (0..scene.support.len()).map(|k| support_name(k, scene));
    let loads = scene.load.iter().enumerate().map(|(k, l)| load::name(k, l));
    let effects = scene.effect.iter().enumerate();
    let effects = effects.filter_map(|(k, e)| e.ledger_name(k));
    let mut sorted: Vec<String> = supports.chain(loads).chain(effects).collect();
    sorted.sort();
    sorted.dedup();
    sorted
}

/// Collects supports and effects of the name `of`.
///
/// # Errors
/// An unknown name, or a name of both a support and something else.
fn bearers<'a>(path: &str, name: &str, scene: &'a LoweredScene) -> Result<Bearers<'a>> {
    let mut out = Bearers::default();
    let mut counts = BTreeMap::<usize, usize>::new();
    for (k, s) in scene.support.iter().enumerate() {
        let m = model_index(&format!("support[{k}].model"), &s.model, scene)?;
        for m in parts(scene, m) {
            // A support is addressed by its number among the supports of its model.
            let number = counts.entry(m).or_default();
            if support_name(k, scene) == name {
                out.supports.push((m, *number));
                out.parts.push((m, &s.at));
            }
            *number += 1;
        }
    }
    for (k, l) in scene.load.iter().enumerate() {
        if load::name(k, l) == name {
            let m = model_index(&format!("load[{k}].model"), &l.model, scene)?;
            for m in loaded_parts(scene, m) {
                out.models.push(m);
                out.parts.push((m, &l.at));
            }
        }
    }
    for (k, e) in scene.effect.iter().enumerate() {
        if e.ledger_name(k).as_deref() != Some(name) {
            continue;
        }
        out.effect = true;
        if let EffectKind::Obstacle(o) = &e.kind {
            out.centre = Some(obstacle_parts(k, o)?.0.middle().coords.into());
        } else {
            out.everywhere = true;
        }
        if e.enabled {
            match contact_sides(k, e, scene)? {
                Some(sides) => out.models.extend(sides),
                None => out.models.extend(effect_models(k, e, scene)?),
            }
        }
    }
    out.models.sort_unstable();
    out.models.dedup();
    let known = names(scene);
    if out.supports.is_empty() && out.models.is_empty() && !out.effect {
        let what = "support, load, rigid body or effect";
        return Err(unknown(format!("{path}.of"), name, what, known.iter()));
    }
    if !out.supports.is_empty() && (out.effect || !out.models.is_empty()) {
        let rule = "is the name of a support and of something else; give them different names";
        return Err(value(format!("{path}.of"), name, rule));
    }
    Ok(out)
}

/// Checks a probe of forces before anything is built.
pub(in crate::setup) fn check(path: &str, name: &str, probe: &Probe, scene: &LoweredScene) -> Result<()> {
    if probe.at.is_some() || probe.over.is_some() || probe.crack.is_some() {
        return Err(key(path, "of is a place by itself; remove at, where and crack"));
    }
    if !matches!(probe.quantity, Quantity::Force | Quantity::Moment) {
        let rule = "is read with quantity = \"force\" or \"moment\"; choose one";
        return Err(value(format!("{path}.of"), name, rule));
    }
    axis(path, probe)?;
    let mut bearers = bearers(path, name, scene)?;
    restrict(path, probe, scene, &mut bearers)?;
    let mut pairs = scene
        .effect
        .iter()
        .enumerate()
        .filter(|(_, e)| e.between.is_some());
    if probe.model.is_none() && pairs.any(|(k, e)| e.ledger_name(k).as_deref() == Some(name)) {
        let rule = "adds up to nothing over both models; name the one on which the force is meant";
        return Err(key(format!("{path}.model"), rule));
    }
    if probe.quantity == Quantity::Moment && probe.about.is_none() && bearers.everywhere {
        let rule = format!("is needed: '{name}' has no centre of its own to take the moment about [m]");
        return Err(key(format!("{path}.about"), rule));
    }
    Ok(())
}

/// Keeps only what acts on the model of the probe, if it names one.
fn restrict(path: &str, probe: &Probe, scene: &LoweredScene, bearers: &mut Bearers<'_>) -> Result<()> {
    let Some(name) = &probe.model else { return Ok(()) };
    let m = model_index(&format!("{path}.model"), name, scene)?;
    if bearers.supports.is_empty() && bearers.models.is_empty() {
        return Ok(());
    }
    bearers.supports.retain(|s| s.0 == m);
    bearers.models.retain(|s| *s == m);
    bearers.parts.retain(|p| p.0 == m);
    if bearers.supports.is_empty() && bearers.models.is_empty() {
        let exerted = probe.of.as_deref().unwrap_or_default();
        let rule = format!("'{exerted}' does not act on this model; remove it for all that it acts on");
        return Err(value(format!("{path}.model"), name, &rule));
    }
    Ok(())
}

impl Exerted {
    /// Prepares the force of a probe.
    pub(super) fn new(
        path: &str,
        name: &str,
        probe: &Probe,
        scene: &LoweredScene,
        bodies: &[Body],
    ) -> Result<Self> {
        check(path, name, probe, scene)?;
        let mut bearers = bearers(path, name, scene)?;
        restrict(path, probe, scene, &mut bearers)?;
        let about = match probe.about.or(bearers.centre) {
            Some(point) => Point3::from(point),
            None if probe.quantity == Quantity::Moment => centroid(path, &bearers.parts, bodies)?,
            // A force has no point of reference, and a loaded surface of spheres may hold no centre.
            None => Point3::origin(),
        };
        Ok(Self {
            name: name.to_owned(),
            about,
            supports: bearers.supports,
            models: bearers.models,
        })
    }
}

/// Mean position of the supported or loaded nodes \[m\]; the origin if there are none.
fn centroid(path: &str, parts: &[(usize, &Selection)], bodies: &[Body]) -> Result<Point3<f64>> {
    let (mut sum, mut count) = (Point3::origin().coords, 0);
    let mut nowhere = None;
    for (m, selection) in parts {
        let body = &bodies[*m];
        // A body or a single zone may have no node in the selection, but not all of them.
        let nodes = select::nodes(&format!("{path}.of"), body, selection);
        for n in nodes.unwrap_or_else(|e| {
            nowhere = Some(e);
            Vec::new()
        }) {
            sum += body.model.nodes()[n].coords;
            count += 1;
        }
    }
    if let (0, Some(e)) = (count, nowhere) {
        return Err(e);
    }
    Ok(Point3::from(sum / f64::from(count.max(1))))
}

//! Supports: the nodes that they hold in a body and its zones, and which of two supports holds a component
//! that both select.

use super::body::Body;
use super::{names, select, time};
use crate::error::{Result, key, unknown};
use crate::setup::{BodyShape, LoweredScene};
use crate::spec::{Axis, Selection, Support};
use arlequin::core::PrescribedMotion;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Nodes of one model that a support holds.
pub(super) struct Held {
    /// Number of the support in the scene.
    support: usize,
    /// Number of the model.
    model: usize,
    nodes: Vec<usize>,
    /// True if the model is a zone of the body that the support names.
    of_zone: bool,
}

/// Nodes that supports hold, in the order of the supports. For a support on a body with zones, those of the
/// body's own model come first, then those of each zone.
fn held_nodes(scene: &LoweredScene, bodies: &[Body], folder: &Path) -> Result<Vec<Held>> {
    let mut out = Vec::new();
    for (support, s) in scene.support.iter().enumerate() {
        let path = format!("support[{support}]");
        let m = names::model_index(&format!("{path}.model"), &s.model, scene)?;
        let path = format!("{path}.where");
        let parts = names::parts(scene, m);
        if let [model] = parts[..] {
            out.push(Held {
                support,
                model,
                nodes: select::nodes(&path, &bodies[model], &s.at)?,
                of_zone: false,
            });
            continue;
        }
        let found_nodes = parts
            .iter()
            .map(|p| nodes_of_part(support, s, &bodies[*p]))
            .collect::<Vec<_>>();
        if found_nodes.iter().all(Vec::is_empty) {
            return Err(nothing(&path, &s.at, parts.iter().map(|p| &bodies[*p])));
        }
        for (model, nodes) in parts.into_iter().zip(found_nodes) {
            check_spheres(&path, s, &bodies[model], &nodes, folder)?;
            out.push(Held {
                support,
                model,
                nodes,
                of_zone: model != m,
            });
        }
    }
    Ok(out)
}

/// Refuses supports that contradict each other in the models built so far.
pub(super) fn check_built(scene: &LoweredScene, bodies: &[Option<Body>]) -> Result<()> {
    let mut out = Vec::new();
    for (support, s) in scene.support.iter().enumerate() {
        let m = names::model_index(&format!("support[{support}].model"), &s.model, scene)?;
        for model in names::parts(scene, m) {
            if let Some(body) = &bodies[model] {
                out.push(Held {
                    support,
                    model,
                    nodes: nodes_of_part(support, s, body),
                    of_zone: model != m,
                });
            }
        }
    }
    check(scene, |m| bodies.get(m)?.as_ref(), &out)
}

/// Nodes of the body, or of one of its zones, that a support on the body holds. Spheres are also held if they
/// touch the surface inside a box.
fn nodes_of_part(support: usize, s: &Support, body: &Body) -> Vec<usize> {
    let group = |name: &str| body.groups.get(name).cloned().unwrap_or_default();
    match &s.at {
        Selection::Group(name) => group(name),
        Selection::Box(low, high) => {
            let mut nodes = select::nodes_in_box(body, low, high);
            if body.grains.is_some() {
                nodes.extend(group(&format!("support[{support}]")));
                nodes.sort_unstable();
                nodes.dedup();
            }
            nodes
        }
    }
}

fn nothing<'a>(path: &str, selection: &Selection, parts: impl Iterator<Item = &'a Body>) -> crate::Error {
    let Selection::Group(name) = selection else {
        let rule =
            format!("{selection} holds no node of the body or its zones; enlarge it or check the units (m)");
        return key(path, rule);
    };
    let groups: BTreeSet<&String> = parts.flat_map(|b| select::named(&b.groups)).collect();
    unknown(path, name, "group of the body", groups.into_iter())
}

/// Refuses a support on the body that selects nodes where only spheres of a zone exist, but none of these
/// spheres.
fn check_spheres(path: &str, s: &Support, body: &Body, nodes: &[usize], folder: &Path) -> Result<()> {
    let (BodyShape::Piece(piece), true, true) = (&body.shape, body.grains.is_some(), nodes.is_empty()) else {
        return Ok(());
    };
    let (whole, alone) = (piece.whole(folder)?, piece.alone(folder)?);
    let lost = match &s.at {
        Selection::Group(name) => {
            let group = whole.groups().get(name);
            group.is_some_and(|g| g.nodes.iter().any(|k| alone[*k as usize]))
        }
        Selection::Box(low, high) => {
            let slack = select::slack(whole.spacing());
            let mut nodes = whole.nodes().iter().zip(&alone);
            nodes.any(|(x, alone)| *alone && select::inside(low, high, x, slack))
        }
    };
    if !lost {
        return Ok(());
    }
    let rule = format!(
        "{} is held where the body is the spheres of zone '{}', and no sphere is in it or touches a face in it; name a face, or a \
         box with the centres of spheres",
        s.at,
        body.model.name()
    );
    Err(key(path, rule))
}

/// Motions that supports prescribe, each with the number of its model, in the order of the supports.
/// Components that a support of a zone holds are removed from the body's supports in that zone.
pub(super) fn motions(
    scene: &LoweredScene,
    bodies: &[Body],
    folder: &Path,
) -> Result<Vec<(usize, PrescribedMotion<f64>)>> {
    let holdings = held_nodes(scene, bodies, folder)?;
    check(scene, |m| bodies.get(m), &holdings)?;
    let mut own_dofs: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    let mut out = Vec::with_capacity(holdings.len());
    for h in &holdings {
        let path = format!("support[{}]", h.support);
        let motion = motion_of(&path, &scene.support[h.support], &bodies[h.model], &h.nodes)?;
        if !h.of_zone {
            own_dofs.entry(h.model).or_default().extend(&motion.dofs);
        }
        out.push((h.model, motion));
    }
    for (h, (m, motion)) in holdings.iter().zip(&mut out) {
        if let (true, Some(own_dofs)) = (h.of_zone, own_dofs.get(m)) {
            motion.dofs.retain(|d| !own_dofs.contains(d));
        }
    }
    // A component that two supports hold at rest is left to the first.
    let mut at_rest: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for (h, (m, motion)) in holdings.iter().zip(&mut out) {
        if is_at_rest(scene, h) {
            let fixed = at_rest.entry(*m).or_default();
            motion.dofs.retain(|d| fixed.insert(*d));
        }
    }
    Ok(out)
}

/// Returns whether a support holds its nodes at rest.
fn is_at_rest(scene: &LoweredScene, held: &Held) -> bool {
    scene.support[held.support].motion.is_none()
}

/// Motion that a support prescribes to nodes of a model.
fn motion_of(path: &str, s: &Support, body: &Body, nodes: &[usize]) -> Result<PrescribedMotion<f64>> {
    let count = body.model.layout().components;
    let components: Vec<usize> = match &s.components {
        None => (0..count).collect(),
        Some(c) => c.iter().map(|c| c.index()).collect(),
    };
    if let Some(k) = components.iter().position(|&c| c >= count) {
        let rule = format!("model '{}' moves along x only; use [\"x\"]", body.model.name());
        return Err(key(format!("{path}.components[{k}]"), rule));
    }
    if components.is_empty() {
        let rule = "is empty; name at least one, or remove it for all";
        return Err(key(format!("{path}.components"), rule));
    }
    let mut dofs: Vec<usize> = nodes
        .iter()
        .flat_map(|n| components.iter().map(move |c| n * count + c))
        .collect();
    let layout = body.model.layout();
    if s.components.is_none() && s.motion.is_none() && layout.turns() {
        // A clamp also holds rotations.
        let first = layout.translations();
        dofs.extend(nodes.iter().flat_map(|n| (0..3).map(move |c| first + 3 * n + c)));
    }
    Ok(match &s.motion {
        None => PrescribedMotion::fixed(dofs),
        Some(m) => {
            let (amplitude, time) = time::motion(&format!("{path}.motion"), m)?;
            PrescribedMotion {
                dofs,
                amplitude,
                time,
            }
        }
    })
}

/// Refuses a component of a node that two supports prescribe, unless both hold it at rest: the user must
/// choose one.
fn check<'b>(
    scene: &LoweredScene,
    body_of: impl Fn(usize) -> Option<&'b Body>,
    holdings: &[Held],
) -> Result<()> {
    let mut holders: BTreeMap<(usize, usize, usize), &Held> = BTreeMap::new();
    for h in holdings {
        let (s, Some(body)) = (&scene.support[h.support], body_of(h.model)) else {
            continue;
        };
        let count = body.model.layout().components;
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let axes = s.components.as_deref().unwrap_or(&axes[..count]);
        let (mut first, mut further) = (None, 0);
        for n in &h.nodes {
            for axis in axes {
                match holders.insert((h.model, *n, axis.index()), h) {
                    // The zone's own support takes precedence, see `motions`.
                    Some(before) if before.of_zone != h.of_zone => {}
                    Some(before) if is_at_rest(scene, before) && is_at_rest(scene, h) => {}
                    None => {}
                    Some(before) if first.is_none() => first = Some((before.support, *n, axis.index())),
                    Some(_) => further += 1,
                }
            }
        }
        if let Some((other, n, c)) = first {
            let (x, axis) = (&body.model.nodes()[n], ["x", "y", "z"][c]);
            let rule = format!(
                "holds {axis} of the node of '{}' at ({:.4e}, {:.4e}, {:.4e}) m, as support[{other}] does, and {further} more components of \
                 nodes likewise; leave \"{axis}\" out of the components of one of them, or choose its nodes with a box that leaves \
                 out what both have",
                body.model.name(),
                x.x,
                x.y,
                x.z
            );
            return Err(key(format!("support[{}].where", h.support), rule));
        }
    }
    Ok(())
}

//! Supports near a zone that moves.
//!
//! A support of the body also holds the spheres that touch its face, at the displacement of the face. They
//! lie up to a radius inside the body, where the body's own field is already another one. Tied to this
//! field, the rows of spheres beside them would be bent. A zone that moves therefore stays off supports: at
//! least one element of the body remains between its overlap and any node that is held.

use super::Piece;
use crate::error::{Result, key};
use crate::setup::lower::following;
use crate::setup::names::BODY;
use crate::setup::{LoweredScene, OverlapSource, select};
use crate::spec::{Selection, Support};
use arlequin::fem_ref::Mesh;
use std::path::Path;

/// Refuses supports that the zone of a scene cannot have if it moves, and a zone that begins at one.
pub(in crate::setup) fn check_supports(scene: &LoweredScene, folder: &Path) -> Result<()> {
    let Some((name, ..)) = following(scene) else {
        return Ok(());
    };
    let OverlapSource::Zone(piece) = &scene.interface[name].overlap else {
        return Ok(());
    };
    let mesh = piece.whole(folder)?;
    for (k, s) in scene.support.iter().enumerate() {
        let path = format!("support[{k}]");
        if s.model == name {
            let rule = format!("zone '{name}' moves, and a support cannot; let it hold model = \"{BODY}\"");
            return Err(key(format!("{path}.model"), rule));
        }
        if s.model == BODY && held_nodes(mesh, k, s).is_empty() {
            let rule = format!(
                "{} holds no node of the body's elements, which zone '{name}' needs while its spheres sleep; enlarge it",
                s.at
            );
            return Err(key(format!("{path}.where"), rule));
        }
    }
    let barred = piece.barred(scene, folder)?;
    let begins = piece.elements_alone(folder)?;
    match begins.iter().zip(&barred).find_map(|(own, b)| b.filter(|_| *own)) {
        None => Ok(()),
        Some(k) => {
            let rule = format!(
                "the zone begins so near to {} that its overlap reaches what this holds, where spheres at a face and the body's \
                 field at their depth differ; take a smaller shape, a narrower overlap, or a larger body",
                label(scene, k)
            );
            Err(key(format!("zone.{name}.follow"), rule))
        }
    }
}

/// Name of a support in messages.
pub(super) fn label(scene: &LoweredScene, k: usize) -> String {
    match &scene.support[k].name {
        Some(name) => format!("support '{name}'"),
        None => format!("support[{k}]"),
    }
}

/// Nodes of the body's elements that support `k` holds.
fn held_nodes(mesh: &Mesh<f64>, k: usize, s: &Support) -> Vec<usize> {
    let group = |name: &str| {
        let group = mesh.groups().get(name);
        group.map_or_else(Vec::new, |g| g.nodes.iter().map(|k| *k as usize).collect())
    };
    match &s.at {
        Selection::Group(name) => group(name),
        Selection::Box(low, high) => {
            let slack = select::slack(mesh.spacing());
            let nodes = mesh.nodes().iter().enumerate();
            let inside = nodes.filter(|(_, x)| select::inside(low, high, x, slack));
            let mut out: Vec<usize> = inside.map(|(k, _)| k).collect();
            out.extend(group(&format!("support[{k}]")));
            out
        }
    }
}

impl Piece {
    /// For each element of the body: the support for which the zone must leave it to the body.
    pub(super) fn barred(&self, scene: &LoweredScene, folder: &Path) -> Result<Vec<Option<usize>>> {
        let mesh = self.whole(folder)?;
        let mut of_nodes = vec![None; mesh.nodes().len()];
        for (k, s) in scene.support.iter().enumerate().filter(|(_, s)| s.model == BODY) {
            for node in held_nodes(mesh, k, s) {
                of_nodes[node] = of_nodes[node].or(Some(k));
            }
        }
        let width = self.cut.zones[self.number()].table.overlap.width;
        // A width of whole elements up to round-off needs no further element.
        let layers = (width / mesh.spacing() - 1e-6).ceil().max(0.0) as usize;
        let mut out = vec![None; mesh.element_count()];
        // Elements that hold a node of the support, then as many layers around them as the overlap has.
        for _ in 0..=layers {
            for (e, barred) in out.iter_mut().enumerate().filter(|(_, b)| b.is_none()) {
                *barred = mesh.element(e).iter().find_map(|k| of_nodes[*k as usize]);
            }
            for (e, barred) in out.iter().enumerate().filter(|(_, b)| b.is_some()) {
                for k in mesh.element(e) {
                    let node = &mut of_nodes[*k as usize];
                    *node = node.or(*barred);
                }
            }
        }
        Ok(out)
    }
}

//! Where a zone that moves may not go: near supports and loads, and beyond the spheres of `follow.within`.
//!
//! A support of the body also holds the spheres that touch its face, at the displacement of the face. They
//! lie up to a radius inside the body, where the body's own field is already another one. Tied to this
//! field, the rows of spheres beside them would be bent. A load acts on the body's elements alone, so that
//! it need not be shared anew in each change. A zone that moves therefore stays off both: at least one
//! element of the body remains between its overlap and any node that is held or loaded.

use super::divide::centroid;
use super::{Piece, Width};
use crate::error::{Result, key};
use crate::setup::lower::following;
use crate::setup::names::BODY;
use crate::setup::{LoweredScene, OverlapSource, select};
use crate::spec::Selection;
use arlequin::fem_ref::Mesh;
use std::path::Path;

/// A support or a load of the body.
struct Anchor<'a> {
    /// Key of its table.
    path: String,
    /// True for a load, which acts on facets.
    is_load: bool,
    /// Its name in messages.
    label: String,
    model: &'a str,
    place: &'a Selection,
}

/// Supports of a scene, then its loads.
fn anchors(scene: &LoweredScene) -> Vec<Anchor<'_>> {
    let anchor = |is_load, k: usize, name: &Option<String>, model, place| {
        let kind = if is_load { "load" } else { "support" };
        let path = format!("{kind}[{k}]");
        let label = name.as_ref().map(|name| format!("{kind} '{name}'"));
        Anchor {
            label: label.unwrap_or_else(|| path.clone()),
            path,
            is_load,
            model,
            place,
        }
    };
    let (supports, loads) = (scene.support.iter().enumerate(), scene.load.iter().enumerate());
    let supports = supports.map(|(k, s)| anchor(false, k, &s.name, &s.model, &s.at));
    let loads = loads.map(|(k, l)| anchor(true, k, &l.name, &l.model, &l.at));
    supports.chain(loads).collect()
}

/// Refuses supports and loads that the zone of a scene cannot have if it moves, and a zone that begins at
/// one.
pub(in crate::setup) fn check_anchors(scene: &LoweredScene, folder: &Path) -> Result<()> {
    let Some((name, ..)) = following(scene) else {
        return Ok(());
    };
    let OverlapSource::Zone(piece) = &scene.interface[name].overlap else {
        return Ok(());
    };
    let mesh = piece.whole(folder)?;
    for a in anchors(scene) {
        if a.model == name {
            let rule = format!(
                "zone '{name}' moves, and neither a support nor a load can; take model = \"{BODY}\" for it"
            );
            return Err(key(format!("{}.model", a.path), rule));
        }
        if a.model == BODY && a.nodes(mesh).is_empty() {
            let rule = format!(
                "{} has no node of the body's elements, which zone '{name}' needs while its spheres sleep; enlarge it",
                a.place
            );
            return Err(key(format!("{}.where", a.path), rule));
        }
    }
    let barred = piece.barred(scene, folder)?;
    let begins = piece.elements_alone(folder)?;
    let path = format!("zone.{name}.follow");
    match begins.iter().zip(&barred).find_map(|(own, b)| b.filter(|_| *own)) {
        None => Ok(()),
        Some(Bar::Anchor(k)) => {
            let rule = format!(
                "the zone begins so near to {} that its overlap reaches the nodes of this; take a smaller shape, a narrower overlap, \
                 or a larger body",
                anchors(scene).swap_remove(k).label
            );
            Err(key(path, rule))
        }
        Some(Bar::Border) => {
            let rule = "the zone of shape and its overlap must lie inside of it; take a larger region, or a smaller shape";
            Err(key(format!("{path}.within"), rule))
        }
    }
}

/// Tries the first overlap of a zone that begins empty, around one of the body's elements. Returns a warning
/// if it is narrow.
///
/// # Errors
/// A zone that could come nowhere; a body that cannot be meshed.
pub(in crate::setup) fn first_overlap(scene: &LoweredScene, folder: &Path) -> Result<Option<String>> {
    let Some((name, zone, _)) = following(scene) else {
        return Ok(None);
    };
    let OverlapSource::Zone(piece) = &scene.interface[name].overlap else {
        return Ok(None);
    };
    if zone.shape.is_some() {
        return Ok(None);
    }
    let mesh = piece.whole(folder)?;
    let barred = piece.barred(scene, folder)?;
    let mut free: Vec<usize> = (0..barred.len()).filter(|e| barred[*e].is_none()).collect();
    let mut error = None;
    for axis in 0..3 {
        // Around an element at an end of the body, an overlap leaves most of the body free.
        let place = |e: &usize| centroid(mesh, *e)[axis];
        free.sort_by(|a, b| place(a).total_cmp(&place(b)));
        for e in free.first().into_iter().chain(free.last()) {
            let mut core = vec![false; barred.len()];
            core[*e] = true;
            match piece.moved(&core, &barred, folder) {
                Ok(moved) => return Ok(moved.width().and_then(|w| narrow(name, &w))),
                Err(e) => error = Some(e),
            }
        }
    }
    Err(error.unwrap_or_else(|| {
        let rule = "supports, loads or the border of follow.within are near to all elements: the zone could come nowhere; take a \
                    narrower overlap, or a larger body";
        key(format!("zone.{name}.overlap.width"), rule)
    }))
}

/// Returns a warning if an overlap is less than three elements wide, up to half of one.
fn narrow(name: &str, width: &Width) -> Option<String> {
    let elements = width.mean / width.spacing;
    (elements < 2.5).then(|| {
        format!(
            "zone '{name}': its overlap of {:.3e} m is {elements:.1} elements of '{BODY}' across, which reflects waves; give \
             overlap.width = {:.2e}",
            width.mean,
            3.0 * width.spacing
        )
    })
}

/// Reason for which a zone that moves leaves an element to the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bar {
    /// A support or load is near, with this number among those of the scene.
    Anchor(usize),
    /// The border of `follow.within` is near.
    Border,
}

impl Bar {
    /// Returns the warning for a zone that would have to reach such an element.
    pub(super) fn warning(self, zone: &str, scene: &LoweredScene) -> String {
        match self {
            Self::Anchor(k) => format!(
                "zone '{zone}' would have to reach {}, where spheres at a face and the body's field at their depth differ: it stays an \
                 element and an overlap's width off, and what breaks there breaks in the overlap or not at all; take a larger body",
                anchors(scene).swap_remove(k).label
            ),
            Self::Border => format!(
                "zone '{zone}' would have to leave follow.within, where there are no spheres: it stays an overlap's width inside, and \
                 what breaks beyond breaks in the overlap or not at all; take a larger region"
            ),
        }
    }
}

impl Anchor<'_> {
    /// Nodes of the body's elements that it holds or loads.
    fn nodes(&self, mesh: &Mesh<f64>) -> Vec<usize> {
        let group = |name: &str| {
            let group = mesh.groups().get(name);
            group.map_or_else(Vec::new, |g| g.nodes.iter().map(|k| *k as usize).collect())
        };
        match self.place {
            Selection::Group(name) => group(name),
            // The facets in the box are a group of their own.
            Selection::Box(..) if self.is_load => group(&self.path),
            Selection::Box(low, high) => {
                let slack = select::slack(mesh.spacing());
                let nodes = mesh.nodes().iter().enumerate();
                let inside = nodes.filter(|(_, x)| select::inside(low, high, x, slack));
                let mut out: Vec<usize> = inside.map(|(k, _)| k).collect();
                out.extend(group(&self.path));
                out
            }
        }
    }
}

impl Piece {
    /// For each element of the body: the reason for which the zone must leave it to the body.
    pub(super) fn barred(&self, scene: &LoweredScene, folder: &Path) -> Result<Vec<Option<Bar>>> {
        let mesh = self.whole(folder)?;
        let mut of_nodes = vec![None; mesh.nodes().len()];
        for (k, a) in anchors(scene).iter().enumerate().filter(|(_, a)| a.model == BODY) {
            for node in a.nodes(mesh) {
                of_nodes[node] = of_nodes[node].or(Some(Bar::Anchor(k)));
            }
        }
        let width = self.cut.zones[self.number()].table.overlap.width;
        // A width of whole elements up to round-off needs no further element.
        let layers = (width / mesh.spacing() - 1e-6).ceil().max(0.0) as usize;
        // One element stays between the overlap and what is held or loaded.
        let mut out = spread(mesh, of_nodes, layers + 1);
        let reservoir = &self.cut.division(folder)?.reservoir;
        let mut of_nodes = vec![None; mesh.nodes().len()];
        for e in (0..reservoir.len()).filter(|e| !reservoir[*e]) {
            // There are no spheres, however near a support or a load is.
            out[e] = Some(Bar::Border);
            mesh.element(e)
                .iter()
                .for_each(|k| of_nodes[*k as usize] = Some(Bar::Border));
        }
        let near_border = spread(mesh, of_nodes, layers);
        out.iter_mut().zip(near_border).for_each(|(a, b)| *a = a.or(b));
        Ok(out)
    }
}

/// Hands marks of nodes on to the elements around them, over a number of layers of elements.
fn spread(mesh: &Mesh<f64>, mut of_nodes: Vec<Option<Bar>>, layers: usize) -> Vec<Option<Bar>> {
    let mut out = vec![None; mesh.element_count()];
    for _ in 0..layers {
        for (e, mark) in out.iter_mut().enumerate().filter(|(_, b)| b.is_none()) {
            *mark = mesh.element(e).iter().find_map(|k| of_nodes[*k as usize]);
        }
        for (e, mark) in out.iter().enumerate().filter(|(_, b)| b.is_some()) {
            for k in mesh.element(e) {
                let node = &mut of_nodes[*k as usize];
                *node = node.or(*mark);
            }
        }
    }
    out
}

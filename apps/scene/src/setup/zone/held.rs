//! Where a zone that moves may not go: near supports and loads, and beyond the spheres of `follow.within`.
//!
//! A support of the body also holds the spheres that touch its face, at the displacement of the face. They
//! lie up to a radius inside the body, where the body's own field is already another one. Tied to this
//! field, the rows of spheres beside them would be bent. A load acts on the body's elements alone, so that
//! it need not be shared anew in each change. A zone that moves therefore stays off both: at least one
//! element of the body remains between its overlap and any node that is held or loaded.

use super::divide::{ON_BORDER, centroid};
use super::{Piece, Width};
use crate::error::{Result, key};
use crate::setup::lower::following;
use crate::setup::names::BODY;
use crate::setup::{LoweredScene, OverlapSource, select};
use crate::spec::Selection;
use arlequin::core::geometry::{BoxTree, bounds_of};
use arlequin::core::nalgebra::Vector3;
use arlequin::fem_ref::Mesh;
use rayon::prelude::*;
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
        let has_mark = |e: usize| mesh.element(e).iter().find_map(|k| of_nodes[*k as usize]);
        let marked: Vec<_> = (0..mesh.element_count()).map(has_mark).collect();
        // One element stays between the overlap and what is held or loaded.
        let mut out = bar_around(mesh, &marked, width);
        // There are no spheres outside of `follow.within`, however near a support or a load is.
        let reservoir = self.cut.division(folder)?.reservoir.iter();
        let outside: Vec<_> = reservoir
            .map(|has_spheres| (!has_spheres).then_some(Bar::Border))
            .collect();
        let near_border = bar_around(mesh, &outside, width);
        for ((bar, outside), near) in out.iter_mut().zip(outside).zip(near_border) {
            *bar = outside.or(*bar).or(near);
        }
        Ok(out)
    }
}

/// Returns for each element the nearest mark of another one that an overlap of this width \[m\] around it
/// would take; none if the overlap would take no marked element.
fn bar_around(mesh: &Mesh<f64>, marked: &[Option<Bar>], width: f64) -> Vec<Option<Bar>> {
    // An overlap takes an element if a corner of it or its middle is closer than the width.
    let mut points = Vec::new();
    for (e, mark) in marked.iter().enumerate() {
        let Some(mark) = *mark else { continue };
        let corners = mesh.element(e).iter().map(|k| mesh.nodes()[*k as usize]);
        points.extend(corners.chain([centroid(mesh, e)]).map(|x| (x, mark)));
    }
    let tree = BoxTree::new(points.iter().map(|(x, _)| [*x, *x]).collect());
    let reach = Vector3::repeat(width);
    let bar = |e: usize| {
        let [low, high] = bounds_of(mesh.element(e).iter().map(|k| &mesh.nodes()[*k as usize]));
        let (mut nearest, mut out) = (width - ON_BORDER * mesh.spacing(), None);
        tree.any(&[low - reach, high + reach], &mut |k| {
            let (x, mark) = points[k];
            let gap = (low - x).sup(&(x - high)).sup(&Vector3::zeros()).norm();
            if gap < nearest {
                (nearest, out) = (gap, Some(mark));
            }
            false
        });
        out
    };
    (0..mesh.element_count()).into_par_iter().map(bar).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::lower::lowered;
    use crate::setup::zone::divide::Owner;
    use arlequin::core::nalgebra::Point3;

    /// An element is barred if and only if the overlap around it would take an element that is held. Elements
    /// of 1 × 1 × 1.4 mm, so that a width is another number of them in each direction.
    #[test]
    fn elements_are_barred_if_their_overlap_would_take_what_is_held() {
        // With 3 mm, the overlap ends at faces of elements in two directions.
        for width in [3.0e-3, 3.3e-3] {
            check_bars(width);
        }
    }

    fn check_bars(width: f64) {
        let text = format!(
            "[body]\nkind = \"fem\"\nshape.box = {{ low = [0.0, 0.0, 0.0], high = [12e-3, 9e-3, 1.4e-3] }}\n\
                    spacing = 1e-3\nmaterial = {{ young = 7e10, poisson = 0.2, density = 2e3 }}\n\
                    [[support]]\nmodel = \"body\"\nwhere = \"x-max\"\n\
                    [[load]]\nmodel = \"body\"\nwhere.box = {{ low = [0.0, 9e-3, 0.0], high = [2e-3, 9e-3, 1.4e-3] }}\n\
                    traction = [0.0, 1e3, 0.0]\ntime = \"step\"\n\
                    [zone.crack]\nkind = \"dem\"\noverlap.width = {width:e}\nspacing = 0.5e-3\nfollow = true\n\
                    [[effect]]\nfracture = {{ gc = 8.0 }}\n[time]\nend = 1e-6\n"
        );
        let scene = lowered(toml::from_str(&text).expect("a scene")).expect("a zone");
        let OverlapSource::Zone(piece) = &scene.interface["crack"].overlap else {
            panic!("an overlap of a zone");
        };
        let folder = Path::new(".");
        let barred = piece.barred(&scene, folder).expect("a mesh");
        let (first, mesh) = (
            piece.cut.division(folder).expect("a division"),
            piece.whole(folder).expect("a mesh"),
        );
        let is_held = |e: &usize| {
            let corners = mesh.element(*e).iter().map(|k| mesh.nodes()[*k as usize]);
            let near = |x: Point3<f64>| x.x > 11.9e-3 || x.x < 2.1e-3 && x.y > 8.9e-3;
            corners.into_iter().any(near)
        };
        let held: Vec<usize> = (0..barred.len()).filter(is_held).collect();
        for (e, bar) in barred.iter().enumerate() {
            let mut core = vec![false; barred.len()];
            core[e] = true;
            let takes = match first.moved(&piece.cut, 0, &core, &[]) {
                Ok(moved) => held.iter().any(|k| moved.owners[*k] != Owner::Body),
                Err(e) => panic!("{e}"),
            };
            assert_eq!(takes, bar.is_some(), "element {e} at {}", centroid(mesh, e));
        }
        let count = |bar| barred.iter().filter(|b| **b == Some(bar)).count();
        assert!(count(Bar::Anchor(0)) > 30 && count(Bar::Anchor(1)) > 10);
    }
}

//! Division of a body: which elements belong to which zone, and the position across the overlaps.
//!
//! A zone owns the elements with a corner or the centroid in its region. Its overlap consists of the other
//! elements with a corner or the centroid closer to the region than the width. The position across the
//! overlap is `s = a/(a + b)` at the nodes, with the distances `a` from the faces of the zone's own elements
//! and `b` from those of the elements beyond the overlap; the elements interpolate it. The position is
//! therefore exactly zero and one on the borders, for borders of any form.

use super::region::Place;
use super::{Bar, Cut, Whole, Width, Zone};
use crate::error::{Result, fem, key, value};
use crate::setup::faces::{Faces, corners_of};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::fem_ref::{Facet, FemField, Mesh};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// Tolerance for nodes on a border, in element lengths; they count as outside.
pub(super) const ON_BORDER: f64 = 1e-6;

/// Rule that a region breaks in which the body has no element.
const EMPTY: &str =
    "no element of the body has a node or its middle there; make it larger or move it, or refine the body";

/// Owner of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    /// The body's own model alone.
    Body,
    /// The model of a zone alone.
    Zone(usize),
    /// Both models, in the overlap of a zone.
    Both(usize),
}

/// Overlap of one zone.
#[derive(Debug)]
pub(super) struct Across {
    /// Positions across the overlap at the nodes of the body \[–\]; zero outside.
    pub positions: Arc<Vec<f64>>,
    /// `None` for a zone without elements.
    pub width: Option<Width>,
}

/// A body with the owner of each element.
#[derive(Debug)]
pub(super) struct Division {
    pub field: Whole,
    pub owners: Arc<Vec<Owner>>,
    pub zones: Vec<Across>,
    /// For each element: true if spheres fill it for a zone that follows. Empty without `follow.within`.
    pub reservoir: Arc<Vec<bool>>,
}

impl Division {
    pub(super) fn new(mesh: Mesh<f64>, cut: &Cut, folder: &Path) -> Result<Self> {
        let reservoir = reservoir(&mesh, cut, folder)?;
        let mut owners = vec![Owner::Body; mesh.element_count()];
        let mut zones = Vec::new();
        for zone in 0..cut.zones.len() {
            let deal = match Place::new(cut, zone, &mesh, folder)? {
                Some(region) => Deal::new(&mesh, &region, cut, zone)?,
                None => Deal::around(&mesh, &vec![false; mesh.element_count()], (cut, zone), &[])?,
            };
            let across = deal.across()?;
            for (e, side) in deal.sides.iter().enumerate() {
                let owner = match side {
                    Side::Beyond => continue,
                    Side::Core => Owner::Zone(zone),
                    Side::Layer => Owner::Both(zone),
                };
                if let Owner::Zone(other_zone) | Owner::Both(other_zone) = owners[e] {
                    let rule = format!(
                        "it and its overlap reach into those of zone '{}'; move them apart, make them smaller, or make one zone \
                         of the two",
                        cut.zones[other_zone].name
                    );
                    return Err(key(deal.path("shape"), rule));
                }
                owners[e] = owner;
            }
            zones.push(across);
        }
        Ok(Self {
            field: Arc::new(FemField::new(mesh)),
            owners: Arc::new(owners),
            zones,
            reservoir: Arc::new(reservoir),
        })
    }
}

impl Division {
    /// Divides the body for a zone that has moved: it has the elements of `core`, and all elements closer to
    /// them than the width of the overlap are shared. Islands join the zone, without elements that are
    /// `barred` and those beside them.
    pub(super) fn moved(
        &self,
        cut: &Cut,
        zone: usize,
        core: &[bool],
        barred: &[Option<Bar>],
    ) -> Result<Self> {
        let deal = Deal::around(self.field.mesh(), core, (cut, zone), barred)?;
        let owner = |side: &Side| match side {
            Side::Beyond => Owner::Body,
            Side::Core => Owner::Zone(zone),
            Side::Layer => Owner::Both(zone),
        };
        Ok(Self {
            field: self.field.clone(),
            owners: Arc::new(deal.sides.iter().map(owner).collect()),
            zones: vec![deal.across()?],
            reservoir: self.reservoir.clone(),
        })
    }
}

/// Refuses a region of which a part has no element of the body; `path` is its key.
fn check_parts(path: &str, region: &Place, mesh: &Mesh<f64>) -> Result<()> {
    if let Place::Union(parts) = region {
        for (k, part) in parts.iter().enumerate() {
            check_parts(&format!("{path}.union[{k}]"), part, mesh)?;
        }
        return Ok(());
    }
    let inside = |x: &Point3<f64>| region.distance(x) < -ON_BORDER * mesh.spacing();
    let mut centres = (0..mesh.element_count()).map(|e| centroid(mesh, e));
    match mesh.nodes().iter().any(inside) || centres.any(|x| inside(&x)) {
        true => Ok(()),
        false => Err(key(path, EMPTY)),
    }
}

/// Elements that spheres fill for a zone that follows: those with a corner or the centroid in
/// `follow.within`, without those at edges where more than two faces of their surface meet.
fn reservoir(mesh: &Mesh<f64>, cut: &Cut, folder: &Path) -> Result<Vec<bool>> {
    let within = |z: &Zone| {
        let table = z.table.follow.0.as_ref()?;
        Some((
            format!("zone.{}.follow.within", z.name),
            table.within.clone()?,
            z.table.scale,
        ))
    };
    let Some((path, shape, scale)) = cut.zones.iter().find_map(within) else {
        return Ok(Vec::new());
    };
    let region = Place::from_shape((&path, &shape), scale.unwrap_or(cut.body.scale), mesh, folder)?;
    check_parts(&path, &region, mesh)?;
    let inside = |x: &Point3<f64>| region.distance(x) < -ON_BORDER * mesh.spacing();
    let at_nodes: Vec<bool> = mesh.nodes().iter().map(inside).collect();
    let holds =
        |e: usize| mesh.element(e).iter().any(|k| at_nodes[*k as usize]) || inside(&centroid(mesh, e));
    let mut out: Vec<bool> = (0..mesh.element_count()).map(holds).collect();
    while part_at_edges(mesh, &mut out, |_| true) {}
    match out.contains(&true) {
        true => Ok(out),
        // Its elements hung together at edges alone.
        false => Err(key(path, EMPTY)),
    }
}

/// Position of an element with respect to one zone: own element, overlap, or beyond.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Core,
    Layer,
    Beyond,
}

/// The elements of a body, divided for one zone.
struct Deal<'a> {
    mesh: &'a Mesh<f64>,
    name: &'a str,
    width: f64,
    /// True for a zone that has moved.
    has_moved: bool,
    sides: Vec<Side>,
}

impl<'a> Deal<'a> {
    fn new(mesh: &'a Mesh<f64>, region: &Place, cut: &'a Cut, zone: usize) -> Result<Self> {
        let Zone { name, table, .. } = &cut.zones[zone];
        let width = table.overlap.width;
        check_parts(&format!("zone.{name}.shape"), region, mesh)?;
        // Nodes placed on a border by the user lie on either side of it by round-off; they count as outside.
        let slack = ON_BORDER * mesh.spacing();
        let at_nodes: Vec<f64> = mesh.nodes().iter().map(|x| region.distance(x)).collect();
        let least = |e: usize| {
            let corners = mesh.element(e).iter().map(|&k| at_nodes[k as usize]);
            corners.fold(region.distance(&centroid(mesh, e)), f64::min)
        };
        let side = |e: usize| match least(e) {
            d if d < -slack => Side::Core,
            d if d < width - slack => Side::Layer,
            _ => Side::Beyond,
        };
        let mut deal = Self {
            mesh,
            name,
            width,
            has_moved: false,
            sides: (0..mesh.element_count()).map(side).collect(),
        };
        // Elements of the layer between elements of the core would have the position zero throughout.
        deal.fill(Side::Layer, Side::Core);
        deal.round(cut.zones[zone].has_spheres)?;
        Ok(deal)
    }

    /// Deal of a zone that has the elements of `core`, and islands.
    fn around(
        mesh: &'a Mesh<f64>,
        core: &[bool],
        (cut, zone): (&'a Cut, usize),
        barred: &[Option<Bar>],
    ) -> Result<Self> {
        let mut deal = Self::within_width(mesh, core, cut, zone)?;
        // From the start each time: a checkpoint gives the elements of the core that result from this, and
        // their overlap must be the same.
        while deal.join_islands(barred) {
            let core: Vec<bool> = deal.sides.iter().map(|s| *s == Side::Core).collect();
            deal = Self::within_width(mesh, &core, cut, zone)?;
        }
        Ok(deal)
    }

    /// Moves islands to the core: elements of the layer that no chain of neighbours in the layer ties to
    /// elements beyond it, or to `barred` ones. Positions would come to one nowhere in them, and bonds in the
    /// layer do not break. Returns whether there were any.
    fn join_islands(&mut self, barred: &[Option<Bar>]) -> bool {
        let mut tied = self.nodes_of(Side::Beyond);
        for e in (0..barred.len()).filter(|e| barred[*e].is_some()) {
            self.mesh.element(e).iter().for_each(|k| tied[*k as usize] = true);
        }
        let in_layer = |e: &usize| self.sides[*e] == Side::Layer;
        let mut islands: Vec<usize> = (0..self.sides.len()).filter(in_layer).collect();
        loop {
            let before = islands.len();
            islands.retain(|e| {
                let corners = self.mesh.element(*e);
                let is_tied = corners.iter().any(|k| tied[*k as usize]);
                if is_tied {
                    corners.iter().for_each(|k| tied[*k as usize] = true);
                }
                !is_tied
            });
            if islands.len() == before {
                break;
            }
        }
        islands.iter().for_each(|e| self.sides[*e] = Side::Core);
        !islands.is_empty()
    }

    /// Deal of a zone that has the elements of `core`: those within its width of them are the layer.
    fn within_width(mesh: &'a Mesh<f64>, core: &[bool], cut: &'a Cut, zone: usize) -> Result<Self> {
        let Zone { name, table, .. } = &cut.zones[zone];
        let width = table.overlap.width;
        let side = |own: &bool| if *own { Side::Core } else { Side::Layer };
        let mut deal = Self {
            mesh,
            name,
            width,
            has_moved: true,
            sides: core.iter().map(side).collect(),
        };
        // Before distances are taken: a checkpoint gives the elements of the core that result from this, and
        // their overlap must be the same. Once is enough, since these elements bring no nodes.
        deal.fill(Side::Layer, Side::Core);
        let border = deal.between(Side::Core);
        let [low, high] = border.bounds();
        // Most of the body is farther away than the width, and how far does not matter.
        let distance = |x: &Point3<f64>| match (0..3).any(|c| x[c] < low[c] - width || x[c] > high[c] + width)
        {
            true => f64::INFINITY,
            false => border.distance(x),
        };
        // The distance at a node serves all of its elements.
        let at_nodes: Vec<f64> = mesh.nodes().iter().map(distance).collect();
        let slack = ON_BORDER * mesh.spacing();
        for (e, side) in deal
            .sides
            .iter_mut()
            .enumerate()
            .filter(|(_, s)| **s == Side::Layer)
        {
            let corners = mesh.element(e).iter().map(|&k| at_nodes[k as usize]);
            let least = corners.fold(distance(&centroid(mesh, e)), f64::min);
            if border.is_empty() || least >= width - slack {
                *side = Side::Beyond;
            }
        }
        // Spheres fill the body, not the zone: its surface may have any form.
        deal.round(false)?;
        Ok(deal)
    }

    fn path(&self, key: &str) -> String {
        format!("zone.{}.{key}", self.name)
    }

    /// For each node: true if it belongs to an element on this side.
    fn nodes_of(&self, side: Side) -> Vec<bool> {
        let mut out = vec![false; self.mesh.nodes().len()];
        for (e, _) in self.sides.iter().enumerate().filter(|(_, s)| **s == side) {
            for &k in self.mesh.element(e) {
                out[k as usize] = true;
            }
        }
        out
    }

    /// Moves elements with all corners on elements of side `to` to that side: the position would be constant
    /// in them. Returns whether there were any.
    fn fill(&mut self, from: Side, to: Side) -> bool {
        let nodes = self.nodes_of(to);
        let mesh = self.mesh;
        let mut any = false;
        for (e, side) in self.sides.iter_mut().enumerate().filter(|(_, s)| **s == from) {
            if mesh.element(e).iter().all(|&k| nodes[k as usize]) {
                *side = to;
                any = true;
            }
        }
        any
    }

    /// Removes elements from the layer until none has all its corners on the outer border. If spheres fill
    /// the zone, also until the remaining surface has two faces at every edge.
    fn round(&mut self, filled: bool) -> Result<()> {
        loop {
            let mut changed = self.fill(Side::Layer, Side::Beyond);
            if filled {
                let mut keep: Vec<bool> = self.sides.iter().map(|s| *s != Side::Beyond).collect();
                changed |= part_at_edges(self.mesh, &mut keep, |e| self.sides[e] == Side::Layer);
                let left_out = self.sides.iter_mut().zip(keep).filter(|(_, keep)| !keep);
                left_out.for_each(|(side, _)| *side = Side::Beyond);
            }
            // In every round: an element removed from the layer may be its last one at this place.
            self.check_layer()?;
            if !changed {
                return Ok(());
            }
        }
    }

    /// Refuses a layer that is thinner than one element somewhere.
    fn check_layer(&self) -> Result<()> {
        let beyond = self.nodes_of(Side::Beyond);
        if !self.has_moved && !beyond.contains(&true) {
            return Err(key(
                self.path("shape"),
                "the zone and its overlap take the whole body; make them smaller, or give the body that model alone",
            ));
        }
        // A node of both sides would have to be at zero and at one.
        let core = self.nodes_of(Side::Core);
        match (0..core.len()).find(|&k| core[k] && beyond[k]) {
            None => Ok(()),
            Some(k) => {
                let x = &self.mesh.nodes()[k];
                let h = self.mesh.spacing();
                let rule = format!(
                    "is less than an element of the body at ({:.4e}, {:.4e}, {:.4e}) m; take three elements ({:.3e} m) or more, \
                     or refine the body's mesh",
                    x.x,
                    x.y,
                    x.z,
                    3.0 * h
                );
                Err(value(self.path("overlap.width"), self.width, &rule))
            }
        }
    }

    /// Positions across the overlap at the nodes, and its width.
    fn across(&self) -> Result<Across> {
        let mesh = self.mesh;
        let mut positions = vec![0.0; mesh.nodes().len()];
        if !self.sides.contains(&Side::Layer) {
            return Ok(Across {
                positions: Arc::new(positions),
                width: None,
            });
        }
        let of_layer = self.nodes_of(Side::Layer);
        let [inner, outer] = [Side::Core, Side::Beyond].map(|s| self.between(s));
        // The position needs the distances from both borders.
        if inner.is_empty() || outer.is_empty() {
            let rule = "the overlap does not part the body's elements; take a wider one, or another zone";
            return Err(value(self.path("overlap.width"), self.width, rule));
        }
        let (of_core, of_beyond) = (self.nodes_of(Side::Core), self.nodes_of(Side::Beyond));
        let (mut sum, mut count, mut least) = (0.0, 0.0, f64::INFINITY);
        for (k, x) in mesh.nodes().iter().enumerate().filter(|(k, _)| of_layer[*k]) {
            positions[k] = if of_core[k] {
                let gap = outer.distance(x);
                (sum, count, least) = (sum + gap, count + 1.0, gap.min(least));
                0.0
            } else if of_beyond[k] {
                1.0
            } else {
                let (a, b) = (inner.distance(x), outer.distance(x));
                a / (a + b)
            };
        }
        let layer = mesh.part(|e| self.sides[e] == Side::Layer).map_err(fem("body"))?;
        Ok(Across {
            positions: Arc::new(positions),
            width: Some(Width {
                mean: sum / count,
                least,
                spacing: layer.spacing(),
            }),
        })
    }

    /// Faces that elements of the layer share with elements of a side.
    fn between(&self, side: Side) -> Faces {
        // Two elements share a face if its corners are the same, whatever their order.
        let mut open: HashMap<[u32; 4], usize> = HashMap::new();
        let mut out = Vec::new();
        for (facet, key) in faces_of(self.mesh, |_| true) {
            let e = facet.element as usize;
            // The first of two elements waits here for the second.
            let Some(other_element) = open.insert(key, e) else {
                continue;
            };
            let pair = [self.sides[e], self.sides[other_element]];
            if pair.contains(&side) && pair.contains(&Side::Layer) {
                out.extend(corners_of(self.mesh, &[facet]));
            }
        }
        Faces::new(out)
    }
}

/// Removes elements that `may_leave` and touch an edge at which more than two faces of the surface of those
/// in `keep` meet; a closed surface has two. Returns whether there were any: others may then touch such
/// edges.
pub(super) fn part_at_edges(mesh: &Mesh<f64>, keep: &mut [bool], may_leave: impl Fn(usize) -> bool) -> bool {
    let crowded = crowded_edges(mesh, |e| keep[e]);
    let touches = |e: usize| {
        let corners = mesh.element(e);
        let mut edges = crowded.iter();
        edges.any(|edge| edge.iter().all(|k| corners.contains(k)))
    };
    let mut any = false;
    for (e, kept) in keep.iter_mut().enumerate() {
        if *kept && may_leave(e) && touches(e) {
            *kept = false;
            any = true;
        }
    }
    any
}

/// Edges at which more than two faces of the surface of the selected elements meet.
fn crowded_edges(mesh: &Mesh<f64>, keep: impl Fn(usize) -> bool) -> Vec<[u32; 2]> {
    let mut open: BTreeMap<[u32; 4], Facet> = BTreeMap::new();
    for (facet, key) in faces_of(mesh, keep) {
        // Faces that two elements share cancel; those of the surface remain.
        if open.remove(&key).is_none() {
            open.insert(key, facet);
        }
    }
    let mut uses: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for facet in open.into_values() {
        let corners = mesh.facet_nodes(facet);
        for (k, a) in corners.iter().enumerate() {
            let b = corners[(k + 1) % corners.len()];
            // Neighbouring faces run along an edge in opposite directions.
            *uses.entry([*a.min(&b), *a.max(&b)]).or_default() += 1;
        }
    }
    let crowded = uses.into_iter().filter(|(_, n)| *n > 2);
    crowded.map(|(edge, _)| edge).collect()
}

/// Faces of the selected elements, each with its ascending corner numbers; neighbours share these.
pub(super) fn faces_of(
    mesh: &Mesh<f64>,
    keep: impl Fn(usize) -> bool,
) -> impl Iterator<Item = (Facet, [u32; 4])> {
    let elements = (0..mesh.element_count()).filter(move |&e| keep(e));
    elements.flat_map(move |e| {
        (0..mesh.kind().faces().len()).map(move |face| {
            let facet = Facet {
                element: e as u32,
                face: face as u8,
            };
            let mut key = [u32::MAX; 4];
            for (slot, k) in key.iter_mut().zip(mesh.kind().faces()[face]) {
                *slot = mesh.element(e)[*k];
            }
            // Sorted, since both elements list the corners in their own order.
            key.sort_unstable();
            (facet, key)
        })
    })
}

pub(super) fn centroid(mesh: &Mesh<f64>, e: usize) -> Point3<f64> {
    let corners = mesh.element(e);
    let sum = corners
        .iter()
        .fold(Vector3::zeros(), |s, &k| s + mesh.nodes()[k as usize].coords);
    Point3::from(sum / corners.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::OverlapSource;
    use crate::setup::lower::lowered;

    /// A checkpoint has the zone's own elements alone, and its overlap must come out of these again.
    #[test]
    fn a_zone_that_is_given_its_own_elements_again_has_the_same_overlap() {
        let text = "[body]\nkind = \"fem\"\nshape.box = { low = [0.0, 0.0, 0.0], high = [16e-3, 12e-3, 2e-3] }\n\
                    spacing = 1e-3\nmaterial = { young = 7e10, poisson = 0.2, density = 2e3 }\n\
                    [zone.crack]\nkind = \"dem\"\nshape.box = { low = [-1e-3, 5e-3, -1e-3], high = [4e-3, 7e-3, 3e-3] }\n\
                    overlap.width = 2e-3\nspacing = 0.5e-3\nfollow = true\n[[effect]]\nfracture = { gc = 8.0 }\n\
                    [time]\nend = 1e-6\n";
        let scene = lowered(toml::from_str(text).expect("a scene")).expect("a zone");
        let OverlapSource::Zone(piece) = &scene.interface["crack"].overlap else {
            panic!("an overlap of a zone");
        };
        let first = piece.cut.division(Path::new(".")).expect("a division");
        let mut seed = 7_u64;
        let mut filled = 0;
        for _ in 0..40 {
            let mut core: Vec<bool> = first.owners.iter().map(|o| *o == Owner::Zone(0)).collect();
            for (e, own) in core.iter_mut().enumerate() {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                // The far third stays with the body.
                *own |= centroid(first.field.mesh(), e).x < 9e-3 && seed >> 62 == 0;
            }
            let once = first.moved(&piece.cut, 0, &core, &[]).expect("a zone");
            let own: Vec<bool> = once.owners.iter().map(|o| *o == Owner::Zone(0)).collect();
            filled += usize::from(own != core);
            let twice = once.moved(&piece.cut, 0, &own, &[]).expect("the same zone");
            assert_eq!(once.owners, twice.owners);
            let bits =
                |d: &Division| -> Vec<u64> { d.zones[0].positions.iter().map(|x| x.to_bits()).collect() };
            assert_eq!(bits(&once), bits(&twice));
        }
        assert!(filled > 20, "elements joined in {filled} cases");
    }

    /// Elements that a ring of the zone parts from the body belong to it, unless one of them must stay.
    #[test]
    fn an_island_in_the_overlap_joins_the_zone_unless_it_is_barred() {
        let text = "[body]\nkind = \"fem\"\nshape.box = { low = [0.0, 0.0, 0.0], high = [20e-3, 9e-3, 1e-3] }\n\
                    spacing = 1e-3\nmaterial = { young = 7e10, poisson = 0.2, density = 2e3 }\n\
                    [zone.crack]\nkind = \"dem\"\noverlap.width = 3e-3\nspacing = 0.5e-3\nfollow = true\n\
                    [[effect]]\nfracture = { gc = 8.0 }\n[time]\nend = 1e-6\n";
        let scene = lowered(toml::from_str(text).expect("a scene")).expect("a zone");
        let OverlapSource::Zone(piece) = &scene.interface["crack"].overlap else {
            panic!("an overlap of a zone");
        };
        let first = piece.cut.division(Path::new(".")).expect("a division");
        let mesh = first.field.mesh();
        let centres: Vec<_> = (0..mesh.element_count()).map(|e| centroid(mesh, e)).collect();
        // A ring of 5 × 5 elements around 3 × 3 others.
        let from_middle = |x: &Point3<f64>| (x.x - 4.5e-3).abs().max((x.y - 4.5e-3).abs());
        let core: Vec<bool> = centres
            .iter()
            .map(|x| (1.5e-3..2.5e-3).contains(&from_middle(x)))
            .collect();
        let zone_of = |barred: &[Option<Bar>]| {
            let moved = first.moved(&piece.cut, 0, &core, barred).expect("a zone");
            moved
                .owners
                .iter()
                .map(|o| *o == Owner::Zone(0))
                .collect::<Vec<_>>()
        };
        let whole: Vec<bool> = centres.iter().map(|x| from_middle(x) < 2.5e-3).collect();
        assert_eq!(zone_of(&[]), whole);
        let barred: Vec<Option<Bar>> = centres
            .iter()
            .map(|x| (from_middle(x) < 0.5e-3).then_some(Bar::Anchor(0)))
            .collect();
        assert_eq!(zone_of(&barred), core);
        // All but the last column: nothing is left beyond the overlap.
        let most: Vec<bool> = centres.iter().map(|x| x.x < 19e-3).collect();
        let moved = first.moved(&piece.cut, 0, &most, &[]).expect("a zone");
        assert!(moved.owners.iter().all(|o| *o == Owner::Zone(0)));
        assert!(moved.zones[0].width.is_none());
    }

    #[test]
    fn elements_that_touch_at_an_edge_alone_part() {
        use arlequin::fem_ref::{ElementKind, generate};
        let mesh = generate::block(
            ElementKind::Hex8,
            Point3::origin(),
            Point3::new(2.0, 2.0, 1.0),
            [2, 2, 1],
        );
        let mesh = mesh.expect("a block");
        let diagonal = [true, false, false, true];
        let mut keep = diagonal;
        assert!(part_at_edges(&mesh, &mut keep, |e| e == 0));
        assert_eq!(keep, [false, false, false, true]);
        assert!(!part_at_edges(&mesh, &mut keep, |_| true));
        let mut keep = diagonal;
        assert!(!part_at_edges(&mesh, &mut keep, |_| false) && keep == diagonal);
    }
}

//! The overlap of a zone: locates points by the body's elements.

use super::Whole;
use super::divide::{Division, Owner};
use crate::setup::faces::Faces;
use arlequin::core::geometry::{Cell, bounds_of};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{CellPlace, Overlap, Place};
use arlequin::fem_ref::ElementKind;
use arlequin::fem_ref::gmsh::facets_of;
use std::sync::Arc;

/// Positions closer to a border than this count as on it.
const ON_BORDER: f64 = 1e-9;
/// Share of the way to the centre of a cell at which its corners are located: on a face, either element could
/// be found.
const INWARDS: f64 = 1e-4;

/// The elements of a zone and its overlap, with the positions at the nodes.
pub(super) struct Layer {
    field: Whole,
    owners: Arc<Vec<Owner>>,
    positions: Arc<Vec<f64>>,
    zone: usize,
    /// Bounding box of the zone and its overlap \[m\], with a margin.
    bounds: [Point3<f64>; 2],
    /// The body's surface near the zone, for points slightly outside of the body; `below` has the element of
    /// each triangle.
    skin: Faces,
    below: Vec<u32>,
}

impl std::fmt::Debug for Layer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Layer around zone {} of {} elements",
            self.zone,
            self.owners.len()
        )
    }
}

impl Layer {
    pub(super) fn new(division: &Division, zone: usize) -> Self {
        let mesh = division.field.mesh();
        let in_zone = |e: usize| matches!(division.owners[e], Owner::Zone(z) | Owner::Both(z) if z == zone);
        let inside = (0..mesh.element_count()).filter(|&e| in_zone(e));
        let corners = inside
            .flat_map(|e| mesh.element(e))
            .map(|&k| &mesh.nodes()[k as usize]);
        let [low, high] = bounds_of(corners);
        // Points on the border count as inside despite round-off.
        let margin = Vector3::repeat(1e-6 * (high - low).norm());
        let bounds = [low - margin, high + margin];
        let mut below = Vec::new();
        let mut skin = Vec::new();
        for facet in mesh.boundary() {
            for t in facets_of(mesh, &[facet]) {
                let t = t.map(|k| mesh.nodes()[k as usize]);
                let [a, b] = bounds_of(t.iter());
                if (0..3).all(|c| a[c] <= bounds[1][c] && bounds[0][c] <= b[c]) {
                    skin.push(t);
                    below.push(facet.element);
                }
            }
        }
        Self {
            field: division.field.clone(),
            owners: division.owners.clone(),
            positions: division.zones[zone].positions.clone(),
            zone,
            bounds,
            skin: Faces::new(skin),
            below,
        }
    }

    /// Returns whether a point lies outside of the bounding box of the zone.
    fn is_beyond(&self, x: &Point3<f64>) -> bool {
        (0..3).any(|c| x[c] < self.bounds[0][c] || x[c] > self.bounds[1][c])
    }

    /// Number of the element at a point, and the position there. For a point outside of the body, those of
    /// the element below the nearest surface.
    fn locate(&self, x: &Point3<f64>) -> Option<(usize, f64)> {
        if let located @ Some(_) = self.field.value_at(x, &self.positions) {
            return located;
        }
        if self.skin.is_empty() {
            return None;
        }
        let e = self.below[self.skin.nearest(x).0] as usize;
        let corners = self.field.mesh().element(e);
        let sum: f64 = corners.iter().map(|&k| self.positions[k as usize]).sum();
        Some((e, sum / corners.len() as f64))
    }
}

impl Overlap<f64> for Layer {
    fn place(&self, x: &Point3<f64>) -> Place<f64> {
        let located = if self.is_beyond(x) { None } else { self.locate(x) };
        let Some((e, s)) = located else {
            return Place::Coarse;
        };
        match self.owners[e] {
            Owner::Zone(z) if z == self.zone => Place::Fine,
            Owner::Both(z) if z == self.zone => match s {
                s if s <= ON_BORDER => Place::Fine,
                s if s >= 1.0 - ON_BORDER => Place::Coarse,
                s => Place::Overlap(s),
            },
            _ => Place::Coarse,
        }
    }

    /// Positions are smooth within an element. A tetrahedron that is an element, or one of those into which a
    /// hexahedron with warped faces is cut, needs no halving. A cell across several elements or in a
    /// hexahedron, where positions are not linear, needs one. A cell across a border, as cells of natural
    /// elements may be, needs two.
    fn place_of_cell(&self, cell: &Cell<f64>) -> Option<CellPlace> {
        let [low, high] = cell.bounds();
        // Boxes, not corners: a cell may cut through an edge of the zone's box with all corners outside.
        if (0..3).any(|c| high[c] < self.bounds[0][c] || low[c] > self.bounds[1][c]) {
            return Some(CellPlace::Coarse);
        }
        let corners = cell.corners();
        let sum = corners.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
        let middle = Point3::from(sum / corners.len() as f64);
        let owner_of = |e: usize| match self.owners[e] {
            Owner::Zone(z) | Owner::Both(z) if z != self.zone => Owner::Body,
            owner => owner,
        };
        let (first, _) = self.locate(&middle)?;
        let mesh = self.field.mesh();
        let is_node = |x: &Point3<f64>| {
            mesh.element(first)
                .iter()
                .any(|k| mesh.nodes()[*k as usize] == *x)
        };
        // A tetrahedron has three corners on each of its four faces.
        let (mut one_owner, mut one_linear_element) = (true, corners.len() == 12);
        // Beside a face that is not plane, corners of an element's own cell could be found in its neighbour.
        if !corners.iter().all(is_node) {
            one_linear_element = mesh.kind() == ElementKind::Tet4;
            for x in &corners {
                let inwards = x + (middle - x) * INWARDS;
                let (e, _) = self.locate(&inwards)?;
                one_linear_element &= e == first;
                one_owner &= owner_of(e) == owner_of(first);
            }
        }
        Some(match (one_owner, owner_of(first)) {
            (false, _) => CellPlace::Halved(2),
            (_, Owner::Body) => CellPlace::Coarse,
            (_, Owner::Zone(_)) => CellPlace::Fine,
            (_, Owner::Both(_)) => CellPlace::Halved(usize::from(!one_linear_element)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arlequin::core::Interpolation;
    use arlequin::core::geometry::Cell;
    use arlequin::fem_ref::{FemField, generate};

    /// Three cubes in a row: the zone's, one of the overlap, and the body's.
    fn layer(kind: ElementKind) -> Layer {
        let high = Point3::new(3.0, 1.0, 1.0);
        let mesh = generate::block(kind, Point3::origin(), high, [3, 1, 1]).expect("a block");
        let owner = |e: usize| {
            let nodes = mesh.element(e).iter();
            let middle = nodes.map(|k| mesh.nodes()[*k as usize].x).sum::<f64>() / kind.corners() as f64;
            match middle as usize {
                0 => Owner::Zone(0),
                1 => Owner::Both(0),
                _ => Owner::Body,
            }
        };
        let owners = (0..mesh.element_count()).map(owner).collect();
        let positions = mesh.nodes().iter().map(|x| (x.x - 1.0).clamp(0.0, 1.0)).collect();
        Layer {
            field: Arc::new(FemField::new(mesh)),
            owners: Arc::new(owners),
            positions: Arc::new(positions),
            zone: 0,
            bounds: [Point3::new(-0.1, -0.1, -0.1), Point3::new(3.1, 1.1, 1.1)],
            skin: Faces::new(Vec::new()),
            below: Vec::new(),
        }
    }

    #[test]
    fn cells_are_halved_as_often_as_positions_bend_in_them() {
        for (kind, halved) in [(ElementKind::Hex8, 1), (ElementKind::Tet4, 0)] {
            let layer = layer(kind);
            for (e, cell) in layer.field.cells().iter().enumerate() {
                let place = layer.place_of_cell(cell).expect("a place");
                let expected = match layer.owners[e] {
                    Owner::Zone(_) => CellPlace::Fine,
                    Owner::Both(_) => CellPlace::Halved(halved),
                    Owner::Body => CellPlace::Coarse,
                };
                assert_eq!(place, expected, "{kind:?} {e}");
            }
            let bond = |ends: [f64; 2]| {
                let ends = ends.map(|x| Point3::new(x, 0.4, 0.3));
                layer.place_of_cell(&Cell::Segment { ends, section: 1.0 })
            };
            assert_eq!(bond([0.2, 0.7]), Some(CellPlace::Fine));
            assert_eq!(bond([1.1, 1.8]), Some(CellPlace::Halved(1)));
            assert_eq!(bond([1.7, 2.3]), Some(CellPlace::Halved(2)));
            assert_eq!(bond([2.1, 2.8]), Some(CellPlace::Coarse));
        }
    }
}

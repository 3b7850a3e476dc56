//! Voronoi cells of the nodes, cut off at the constrained faces.
//!
//! The cell of a node is the part of the domain that is closer to this node than to any other and connected
//! to it without crossing a constrained face. Copies of a node (see [`crate::crack`]) divide what is closest
//! to the node according to their lips. Cells far from the constraints are read off the circumcentres. All
//! other cells are collected tetrahedron by tetrahedron: clip the tetrahedron by the bisectors of the node,
//! then continue over the free faces of the remaining piece.
//!
//! A part of the domain whose closest node is behind a constrained face belongs to no cell by this rule.
//! Connected regions of tetrahedra with such gaps are divided again among the nodes whose cells reach the
//! region: each point goes to the closest of these nodes. Facets still match on both sides, so that the cells
//! fill the domain and close. [`Gaps`] counts what was reassigned.

mod cell;
mod gaps;

use crate::bins::{Bins, around};
use crate::clip::Polyhedron;
use crate::domain::Domain;
use crate::error::{Error, Result};
use arlequin_core::geometry::Cell;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use cell::Work;
pub use gaps::Gaps;
use gaps::Regions;

/// Relative volume of the domain that the cells may leave uncovered; round-off is below 1e-12.
const VOLUME_TOLERANCE: f64 = 1e-9;
/// Largest `|sum A| / sum |A|` of a cell that counts as closed; round-off is below 1e-12.
const AREA_TOLERANCE: f64 = 1e-9;
/// Relative difference of volumes (areas, lengths) up to which a cell counts as the convex body that its
/// facet planes bound.
const CONVEX: f64 = 1e-10;

/// Neighbour of a cell across a facet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// The cell of another node.
    Node(usize),
    /// The constrained face with this index in [`Domain::constrained_faces`].
    Face(usize),
}

/// Facet of a cell: the whole common boundary with one neighbour or with one side of a constrained face. Only
/// between two copies of one node, beyond a crack front, there is one facet per tetrahedron face between the
/// two cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Neighbour on the other side.
    pub side: Side,
    /// Area times the unit normal out of the cell \[m²\].
    pub area: Vector3<f64>,
    /// Centroid \[m\].
    pub centroid: Point3<f64>,
}

/// Voronoi cells of all nodes of a domain.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Voronoi {
    volumes: Vec<f64>,
    start: Vec<usize>,
    facets: Vec<Facet>,
    /// For each facet the tetrahedron that holds its largest part; `NONE` where no constrained face is near.
    tets: Vec<u32>,
    pub(crate) regions: Regions,
}

/// Relative errors of the cells: how well they fill the domain and how well they close.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// `|sum V - V_domain| / V_domain`.
    pub volume: f64,
    /// Largest `|sum A| / sum |A|` over the cells.
    pub area: f64,
}

impl Voronoi {
    /// Number of cells, one per node.
    pub fn len(&self) -> usize {
        self.volumes.len()
    }

    /// True if there is no cell.
    pub fn is_empty(&self) -> bool {
        self.volumes.is_empty()
    }

    /// Returns the volumes of the cells \[m³\].
    pub fn volumes(&self) -> &[f64] {
        &self.volumes
    }

    /// Returns the facets of a node's cell: neighbours first, then constrained faces, each in ascending
    /// order.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn facets(&self, node: usize) -> &[Facet] {
        &self.facets[self.start[node]..self.start[node + 1]]
    }

    /// For each facet of a node's cell the tetrahedron that holds its largest part; `NONE` where no
    /// constrained face is near.
    pub(crate) fn tets(&self, node: usize) -> &[u32] {
        &self.tets[self.start[node]..self.start[node + 1]]
    }

    /// Returns how much volume was reassigned because its closest node is behind a constrained face.
    pub fn gaps(&self) -> Gaps {
        self.regions.gaps
    }

    /// Returns `|sum A| / sum |A|` of one cell.
    fn area_defect(&self, node: usize) -> f64 {
        let sum: Vector3<f64> = self.facets(node).iter().map(|f| f.area).sum();
        let total: f64 = self.facets(node).iter().map(|f| f.area.norm()).sum();
        if total == 0.0 { 0.0 } else { sum.norm() / total }
    }

    fn check_closed(&self) -> Result<()> {
        for node in 0..self.len() {
            let defect = self.area_defect(node);
            // Not `defect > …`: a NaN must fail, too.
            let closed = defect <= AREA_TOLERANCE;
            if !closed {
                return Err(Error::CellOpen {
                    node,
                    defect,
                    tolerance: AREA_TOLERANCE,
                });
            }
        }
        Ok(())
    }

    /// Compares the sum of the volumes with the domain, and sums the area vectors of each cell.
    pub fn closure(&self, domain: &Domain) -> Closure {
        let filled: f64 = self.volumes.iter().sum();
        let area = (0..self.len()).map(|i| self.area_defect(i));
        Closure {
            volume: (filled / domain.volume() - 1.0).abs(),
            area: area.fold(0.0, f64::max),
        }
    }
}

impl Domain {
    /// Builds the Voronoi cells of all nodes, cut off at the constrained faces. The result does not depend on
    /// the number of threads.
    ///
    /// # Errors
    /// `CellsDoNotFill` if the cells leave more than round-off of the domain uncovered, `CellOpen` if the
    /// facets of a cell do not close, `TooManyNeighbours` if a body with many nodes on its surface has hardly
    /// any inside.
    pub fn voronoi(&self) -> Result<Voronoi> {
        // Before the cells: their cost grows with the number of neighbours, and a refusal must not take
        // minutes.
        self.check_neighbours()?;
        let boxes = self
            .mesh
            .faces
            .iter()
            .map(|f| around(f.v.iter().map(|&v| &self.delaunay.points[v as usize]), 0.0));
        let walls = Bins::new(boxes.collect());
        // Cells are computed independently and concatenated in node order: same bits for any number of
        // threads.
        let mut out = self.cells(|work, node| work.cell(self, &walls, node));
        // All cells are clipped again only if there are gaps.
        if out.closure(self).volume > VOLUME_TOLERANCE {
            let regions = Regions::find(self);
            out = self.cells(|work, node| work.clipped(self, &regions, node));
            out.regions = regions;
        }
        let filled = out.closure(self).volume <= VOLUME_TOLERANCE;
        if !filled {
            let filled = out.volumes.iter().sum();
            return Err(Error::CellsDoNotFill {
                filled,
                volume: self.volume(),
                tolerance: VOLUME_TOLERANCE,
            });
        }
        out.check_closed()?;
        Ok(out)
    }

    fn cells(&self, make: impl Fn(&mut Work, u32) + Sync) -> Voronoi {
        let cells: Vec<(f64, Vec<Facet>, Vec<u32>)> = (0..self.nodes().len() as u32)
            .into_par_iter()
            .map_init(Work::default, |work, node| {
                make(work, node);
                (work.volume, work.facets.clone(), work.tets.clone())
            })
            .collect();
        let mut out = Voronoi {
            volumes: Vec::with_capacity(cells.len()),
            start: vec![0],
            ..Voronoi::default()
        };
        for (volume, facets, tets) in cells {
            out.volumes.push(volume);
            out.tets.extend(tets);
            out.facets.extend(facets);
            out.start.push(out.facets.len());
        }
        out
    }

    /// Returns the convex bodies that make up a node's cell \[m\]: one body if the cell is convex, else one
    /// piece per tetrahedron.
    pub(crate) fn cell_bodies(&self, cells: &Voronoi, node: usize, work: &mut CellBodies) -> Vec<Cell<f64>> {
        let seed = self.nodes()[node];
        let to_core = |p: &Polyhedron| {
            let faces = p.loops().map(|l| l.iter().map(|x| seed + x).collect()).collect();
            Cell::Polyhedron(arlequin_core::geometry::Polyhedron { faces })
        };
        let body = &mut work.body;
        let [low, high] = around(self.nodes(), 0.0);
        // A cube larger than the whole body, so that no side of it is left when the facets have cut.
        body.set_cube((high - low).norm(), 0);
        let volume = cells.volumes()[node];
        for f in cells.facets(node) {
            let normal = f.area.normalize();
            let offset = normal.dot(&(f.centroid - seed));
            // A second facet in the same plane, as between the halves of a flat patch, cuts nothing off.
            if body.excess(&normal, offset) > CONVEX * volume.cbrt() {
                body.clip(&normal, offset, 0);
            }
        }
        let open: Vector3<f64> = body.faces().map(|f| f.1.area).sum();
        let closed = open.norm() <= CONVEX * volume.cbrt().powi(2);
        // Same volume and a closed surface: the half spaces bound the cell itself.
        if closed && (body.volume() - volume).abs() <= CONVEX * volume {
            return vec![to_core(body)];
        }
        work.work.keep = Some(Vec::new());
        work.work.clipped(self, &cells.regions, node as u32);
        let parts = work.work.keep.take().unwrap_or_default();
        // Pieces of round-off size have no volume to average over.
        let solid = parts.iter().filter(|p| p.volume() > CONVEX * volume);
        solid.map(to_core).collect()
    }
}

/// Working buffers of [`Domain::cell_bodies`].
#[derive(Debug, Default)]
pub(crate) struct CellBodies {
    body: Polyhedron,
    work: Work,
}

#[cfg(test)]
mod tests;

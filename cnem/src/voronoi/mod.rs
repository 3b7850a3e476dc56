//! Voronoi cells of the nodes, cut off at the constrained faces.
//!
//! The cell of a node is the part of the domain that is closer to it than to any other node and connected
//! to it without crossing a constrained face. Copies of a node (see [`crate::crack`]) share what is closest
//! to it by their lips. Cells far from the constraints are read off the circumcentres; the others are
//! collected tetrahedron by tetrahedron: clip it by the bisectors of the node, continue over the free faces
//! of what is left.
//!
//! A part of the domain whose closest node is behind a constrained face belongs to no cell by that rule. It
//! cannot exist where the smallest spheres around the constrained faces are empty; it is found by comparing
//! volumes. Connected regions of tetrahedra with such a part are divided anew among the nodes whose cells
//! reach the region, each point going to the closest of them. Facets still match on both sides, so that the
//! cells fill the domain and close. How much was handed over is counted in [`Gaps`]. The blocks and cracks
//! of the tests, with nodes on the faces as dense as inside, have none; a V-notch with nodes closer to its
//! flanks than those of the flanks to each other has some.

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

/// Relative volume of the domain that may be left out before it is an error; round-off is below 1e-12.
const VOLUME_TOLERANCE: f64 = 1e-9;
/// Share of its area that a cell may leave open; round-off is below 1e-12.
const AREA_TOLERANCE: f64 = 1e-9;
/// Relative difference of volumes (areas, lengths) up to which a cell is the convex body its facets bound.
const CONVEX: f64 = 1e-10;

/// What is on the other side of a facet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// The cell of another node.
    Node(usize),
    /// The constrained face with this index in [`Domain::constrained_faces`].
    Face(usize),
}

/// Facet of a cell: all of the common boundary with one neighbour or one side of a constrained face. With
/// another copy of its own node, beyond a crack front, a cell has a facet for every face of the tetrahedra
/// that lies between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// What is on the other side.
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
    /// A tetrahedron in which most of each facet lies, `NONE` where no wall is near.
    tets: Vec<u32>,
    pub(crate) regions: Regions,
}

/// How well the cells close and fill the domain, both relative.
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

    /// Volumes of the cells \[m³\].
    pub fn volumes(&self) -> &[f64] {
        &self.volumes
    }

    /// Facets of the cell of a node: neighbours first, then constrained faces, each in ascending order.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn facets(&self, node: usize) -> &[Facet] {
        &self.facets[self.start[node]..self.start[node + 1]]
    }

    /// A tetrahedron in which most of each facet of a node's cell lies, `NONE` where no wall is near.
    pub(crate) fn tets(&self, node: usize) -> &[u32] {
        &self.tets[self.start[node]..self.start[node + 1]]
    }

    /// What was handed over to other nodes because its closest node is behind a constrained face.
    pub fn gaps(&self) -> Gaps {
        self.regions.gaps
    }

    /// `|sum A| / sum |A|` of one cell.
    fn area_defect(&self, node: usize) -> f64 {
        let sum: Vector3<f64> = self.facets(node).iter().map(|f| f.area).sum();
        let total: f64 = self.facets(node).iter().map(|f| f.area.norm()).sum();
        if total == 0.0 { 0.0 } else { sum.norm() / total }
    }

    fn check_closed(&self) -> Result<()> {
        for node in 0..self.len() {
            let defect = self.area_defect(node);
            // Not `>`: a defect that is not a number is one.
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

    /// Compares volumes with the domain and adds up the area vectors.
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
    /// Voronoi cells of all nodes, cut off at the constrained faces. The result does not depend on the
    /// thread count.
    ///
    /// # Errors
    /// `CellsDoNotFill` if the cells leave more than round-off of the domain uncovered, `CellOpen` if the
    /// facets of one do not close, `TooManyNeighbours` if there are next to no nodes inside a body of many
    /// on its surface.
    pub fn voronoi(&self) -> Result<Voronoi> {
        self.check_neighbours()?;
        let boxes = self
            .mesh
            .faces
            .iter()
            .map(|f| around(f.v.iter().map(|&v| &self.delaunay.points[v as usize]), 0.0));
        let walls = Bins::new(boxes.collect());
        let mut out = self.cells(|work, node| work.cell(self, &walls, node));
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

    /// Convex bodies that make up the cell of a node \[m\]: one where the cell is convex, else a part per
    /// tetrahedron.
    pub(crate) fn cell_bodies(&self, cells: &Voronoi, node: usize, work: &mut CellBodies) -> Vec<Cell<f64>> {
        let seed = self.nodes()[node];
        let to_core = |p: &Polyhedron| {
            let faces = p.loops().map(|l| l.iter().map(|x| seed + x).collect()).collect();
            Cell::Polyhedron(arlequin_core::geometry::Polyhedron { faces })
        };
        let body = &mut work.body;
        let [low, high] = around(self.nodes(), 0.0);
        body.set_cube((high - low).norm(), 0);
        let volume = cells.volumes()[node];
        for f in cells.facets(node) {
            let normal = f.area.normalize();
            let offset = normal.dot(&(f.centroid - seed));
            // Facets of one plane bound the body once.
            if body.excess(&normal, offset) > CONVEX * volume.cbrt() {
                body.clip(&normal, offset, 0);
            }
        }
        let open: Vector3<f64> = body.faces().map(|f| f.1.area).sum();
        let closed = open.norm() <= CONVEX * volume.cbrt().powi(2);
        if closed && (body.volume() - volume).abs() <= CONVEX * volume {
            return vec![to_core(body)];
        }
        work.work.keep = Some(Vec::new());
        work.work.clipped(self, &cells.regions, node as u32);
        let parts = work.work.keep.take().unwrap_or_default();
        // Parts of round-off size have no volume left to average over.
        let solid = parts.iter().filter(|p| p.volume() > CONVEX * volume);
        solid.map(to_core).collect()
    }
}

/// Working memory of [`Domain::cell_bodies`].
#[derive(Debug, Default)]
pub(crate) struct CellBodies {
    body: Polyhedron,
    work: Work,
}

#[cfg(test)]
mod tests;

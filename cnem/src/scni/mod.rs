//! Stabilised conforming nodal integration: one smoothed gradient per Voronoi cell.
//!
//! `∇̃u_I = Σ_k b_Ik ⊗ u_k` with `b_Ik = 1/V_I Σ_q A_q N_k(x_q)` over the facets of the cell of node `I`,
//! with one point per facet at its centroid. Both sides of a facet use the same point and opposite areas, and
//! the point integrates linear fields exactly. A linear displacement field therefore gives the exact gradient
//! in every cell. The internal forces of a constant stress are those of its tractions, integrated with the
//! same points on the boundary.

mod free;
mod matrix;
mod stabilise;

pub(crate) use free::MatrixFree;
pub(crate) use matrix::stiffness;
pub use stabilise::Stabilisation;
pub(crate) use stabilise::SubCells;

use crate::domain::Domain;
use crate::error::Result;
use crate::natural::{Interpolant, Scratch};
use crate::tet::NONE;
use crate::voronoi::{Facet, Side, Voronoi};
use arlequin_core::ShapeRow;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Facet of a cell, with the shape functions at its centroid.
#[derive(Debug, Clone)]
struct Sampled {
    facet: Facet,
    nodes: Vec<usize>,
    values: Vec<f64>,
    /// True if the linear functions of a nearby tetrahedron were used.
    extrapolated: bool,
}

/// Part of the boundary that belongs to one cell: the part of one boundary or crack triangle that is closest
/// to one node.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundaryFacet {
    /// The node whose cell this facet bounds.
    pub cell: usize,
    /// The triangle that contains this facet, as an index in [`Domain::constrained_faces`].
    pub face: usize,
    /// Area times the outward unit normal \[m²\].
    pub area: Vector3<f64>,
    /// Centroid \[m\].
    pub centroid: Point3<f64>,
    /// Nodes with a shape function at the centroid.
    pub nodes: Vec<usize>,
    /// Values of these shape functions \[–\].
    pub values: Vec<f64>,
}

/// Sparse rows: the smoothed gradients `b_Ik` \[1/m\] of all cells, nodes ascending.
#[derive(Debug, Clone)]
pub(crate) struct Smoothing {
    pub(crate) volumes: Vec<f64>,
    pub(crate) starts: Vec<usize>,
    pub(crate) nodes: Vec<u32>,
    pub(crate) gradients: Vec<Vector3<f64>>,
    pub(crate) boundary: Vec<BoundaryFacet>,
    pub(crate) extrapolated: usize,
}

impl Smoothing {
    pub(crate) fn new(domain: &Domain, cells: &Voronoi, kind: Interpolant) -> Result<Self> {
        let sampled: Vec<Vec<Sampled>> = (0..cells.len())
            .into_par_iter()
            .map_init(Scratch::new, |scratch, i| sample(domain, cells, kind, i, scratch))
            .collect::<Result<_>>()?;
        // A facet between two cells is sampled once, by the cell with the smaller number; here each cell
        // lists the facets sampled by its neighbours.
        let mut received: Vec<Vec<(u32, u32)>> = vec![Vec::new(); cells.len()];
        for (i, list) in sampled.iter().enumerate() {
            for (k, s) in list.iter().enumerate() {
                if let Side::Node(j) = s.facet.side {
                    received[j].push((i as u32, k as u32));
                }
            }
        }
        let rows: Vec<Vec<(u32, Vector3<f64>)>> = (0..cells.len())
            .into_par_iter()
            .map(|i| {
                let mut row = Vec::new();
                // Opposite area, same point and values: what one cell gains over the facet the other loses.
                for &(owner, k) in &received[i] {
                    add(&mut row, &sampled[owner as usize][k as usize], -1.0);
                }
                sampled[i].iter().for_each(|s| add(&mut row, s, 1.0));
                gather(row, 1.0 / cells.volumes()[i])
            })
            .collect();
        let mut out = Self {
            volumes: cells.volumes().to_vec(),
            starts: vec![0],
            nodes: Vec::new(),
            gradients: Vec::new(),
            boundary: Vec::new(),
            extrapolated: sampled.iter().flatten().filter(|s| s.extrapolated).count(),
        };
        for row in rows {
            out.nodes.extend(row.iter().map(|e| e.0));
            out.gradients.extend(row.iter().map(|e| e.1));
            out.starts.push(out.nodes.len());
        }
        for (cell, list) in sampled.into_iter().enumerate() {
            for s in list {
                if let Side::Face(face) = s.facet.side {
                    out.boundary.push(BoundaryFacet {
                        cell,
                        face,
                        area: s.facet.area,
                        centroid: s.facet.centroid,
                        nodes: s.nodes,
                        values: s.values,
                    });
                }
            }
        }
        Ok(out)
    }

    /// Returns nodes and gradients of one cell.
    pub(crate) fn row(&self, cell: usize) -> (&[u32], &[Vector3<f64>]) {
        let range = self.starts[cell]..self.starts[cell + 1];
        (&self.nodes[range.clone()], &self.gradients[range])
    }
}

/// Returns the shape functions at the centroid of a facet, seen from the facet's tetrahedron if that is
/// known: the two lips of a crack have different values.
fn shape_on<'s>(
    domain: &Domain,
    kind: Interpolant,
    facet: &Facet,
    tet: u32,
    s: &'s mut Scratch,
) -> Result<&'s ShapeRow<f64>> {
    let x = &facet.centroid;
    if tet != NONE {
        // A facet across several tetrahedra may have its centroid outside the one with its largest part.
        let distance = domain
            .plane_distances(tet, x)
            .into_iter()
            .fold(f64::MIN, f64::max);
        if matches!(facet.side, Side::Face(_)) || distance <= domain.tolerance {
            return Ok(domain.shape_within(kind, x, tet, s, false));
        }
    }
    domain.shape(kind, x, s)
}

/// Evaluates the facets that cell `i` samples: those to nodes with higher numbers and those on the boundary.
fn sample(
    domain: &Domain,
    cells: &Voronoi,
    kind: Interpolant,
    i: usize,
    s: &mut Scratch,
) -> Result<Vec<Sampled>> {
    let facets = cells.facets(i).iter().zip(cells.tets(i));
    // A facet between two cells is evaluated once, for both.
    let owned = facets.filter(|f| !matches!(f.0.side, Side::Node(j) if j < i));
    owned
        .map(|(facet, &tet)| {
            let (nodes, values, extrapolated) = match shape_on(domain, kind, facet, tet, s) {
                Ok(row) => (row.nodes.clone(), row.values.clone(), false),
                // At a re-entrant edge the common boundary of two cells need not be convex: its centroid may
                // lie outside.
                Err(_) => {
                    let (nodes, values) = domain.linear_at_node(i, &facet.centroid)?;
                    (nodes.to_vec(), values.to_vec(), true)
                }
            };
            Ok(Sampled {
                facet: *facet,
                nodes,
                values,
                extrapolated,
            })
        })
        .collect()
}

fn add(row: &mut Vec<(u32, Vector3<f64>)>, s: &Sampled, sign: f64) {
    for (&node, &value) in s.nodes.iter().zip(&s.values) {
        // Zeros would only widen the rows.
        if value != 0.0 {
            row.push((node as u32, s.facet.area * (sign * value)));
        }
    }
}

/// Sums the entries of every node, in the order in which they were added.
fn gather(mut row: Vec<(u32, Vector3<f64>)>, scale: f64) -> Vec<(u32, Vector3<f64>)> {
    // A stable sort keeps the order in which the facets were added, and with it the bits of the sums.
    row.sort_by_key(|e| e.0);
    let mut out: Vec<(u32, Vector3<f64>)> = Vec::new();
    for (node, g) in row {
        match out.last_mut() {
            Some(last) if last.0 == node => last.1 += g,
            _ => out.push((node, g)),
        }
    }
    out.iter_mut().for_each(|e| e.1 *= scale);
    out
}

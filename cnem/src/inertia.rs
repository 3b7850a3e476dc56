//! Distribution of the cell masses to nodes.

use crate::domain::Domain;
use crate::natural::{Interpolant, Scratch};
use crate::voronoi::Voronoi;
use nalgebra::Point3;
use rayon::prelude::*;

/// Deviation of a share (below zero) or of a row sum (from one) that counts as round-off.
const ROUND_OFF: f64 = 1e-12;

/// Nodes that carry the mass `m_I = ρ V_I` of a cell. Body forces are distributed like the masses.
///
/// Measured against the three-dimensional solution of a cylinder five times as long as wide, clamped at one
/// end (see decision 0019), with 209, 629 and 1586 nodes: errors of the torsional frequencies −5.5, −2.9,
/// −1.8 % with [`Inertia::Cells`], −0.8, +0.3, +0.3 % with [`Inertia::Centroids`]. The price: a critical step
/// 4 to 7 % smaller, and twice the error of a static solution under body forces if all of the surface is
/// held; its order stays 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Inertia {
    /// The cell's own node, `M_I = m_I`. The node of a cell on the surface lies outside the cell's centroid,
    /// which makes the rotational inertia of coarse bodies too large.
    #[default]
    Cells,
    /// The nodes around the centroid `c_I` of the cell, `M_j = Σ_I m_I N_j(c_I)`. The first moments of the
    /// mass are exact, since the functions interpolate linear fields. The mass of a cell stays on its own
    /// node where the centroid lies outside the domain, next to a re-entrant edge, or where a function is
    /// negative.
    Centroids,
}

/// Sparse rows: for each cell the nodes and their shares \[–\] of the cell's mass. Every row sums to one.
#[derive(Debug, Clone)]
pub(crate) struct Spread(Vec<Vec<(u32, f64)>>);

impl Spread {
    /// Creates the distribution of [`Inertia::Centroids`].
    pub(crate) fn centroids(domain: &Domain, cells: &Voronoi, kind: Interpolant) -> Self {
        let shares = |scratch: &mut Scratch, i: usize| {
            let unspread = vec![(i as u32, 1.0)];
            // The centroid of a cell beside a re-entrant edge may lie outside: its mass stays on the node.
            let Ok(row) = domain.shape(kind, &centroid(domain, cells, i), scratch) else {
                return unspread;
            };
            let sum: f64 = row.values.iter().sum();
            // A negative share would make a negative mass possible, and with it no stable step.
            let good = row.values.iter().all(|v| *v >= -ROUND_OFF) && (sum - 1.0).abs() <= ROUND_OFF;
            if !good {
                return unspread;
            }
            let nodes = row.nodes.iter().map(|&n| n as u32);
            nodes.zip(row.values.iter().copied()).collect()
        };
        let rows = (0..cells.len()).into_par_iter();
        Self(rows.map_init(Scratch::new, shares).collect())
    }

    /// Returns `M_j = Σ_I s_Ij m_I`, summed in the order of the cells.
    pub(crate) fn gathered(&self, masses: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; masses.len()];
        for (row, m) in self.0.iter().zip(masses) {
            row.iter().for_each(|&(j, share)| out[j as usize] += share * m);
        }
        // Serial, in the order of the cells: the sum has the same bits for any number of threads.
        out
    }
}

/// Returns the centroid of a cell \[m\], from the pyramids between its node and its facets; a pyramid counts
/// as negative if the node is on the outer side of its facet.
fn centroid(domain: &Domain, cells: &Voronoi, node: usize) -> Point3<f64> {
    let x = domain.nodes()[node];
    let arms = cells.facets(node).iter().map(|f| (f.area, f.centroid - x));
    let triple_volume: f64 = arms.clone().map(|(area, arm)| area.dot(&arm)).sum();
    arms.fold(x, |c, (area, arm)| {
        // The centroid of a pyramid lies at three quarters of the way from its tip to the centroid of its
        // base.
        c + arm * (0.75 * area.dot(&arm) / triple_volume)
    })
}

//! The assembled stiffness in rows of 3 × 3 blocks.
//!
//! With `P_jk = Σ_I α_I [(V_I + W_I) b_Ij ⊗ b_Ik − b_Ij ⊗ c_Ik − c_Ij ⊗ b_Ik] + Σ_T (Σ_I∋T α_I w_T) g_Tj ⊗
//! g_Tk` (see [`super::stabilise`]) the block is `K_jk = λ P + μ Pᵀ + μ tr(P) 1`. Every row is gathered on
//! its own and in a fixed order: results have the same bits for any number of threads.

use super::{Smoothing, SubCells};
use arlequin_core::Elastic;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::blocks::BlockMatrix;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Nodes per parallel task.
pub(super) const CHUNK: usize = 64;
/// Models with fewer nodes run on the calling thread: waking other threads costs more than it saves.
pub(super) const SERIAL: usize = 512;
const NONE: u32 = u32::MAX;

/// Data from which the rows are gathered.
struct Parts<'a> {
    smoothing: &'a Smoothing,
    sub: &'a SubCells,
    /// Cell of every entry of the smoothing.
    owner: Vec<u32>,
    entries: Adjacency,
    corners: Adjacency,
    alpha: &'a [f64],
    tet_weights: Vec<f64>,
}

impl<'a> Parts<'a> {
    fn new(smoothing: &'a Smoothing, sub: &'a SubCells, alpha: &'a [f64]) -> Self {
        let n = smoothing.volumes.len();
        let mut owner = vec![0; smoothing.nodes.len()];
        for i in 0..n {
            owner[smoothing.starts[i]..smoothing.starts[i + 1]].fill(i as u32);
        }
        Self {
            smoothing,
            sub,
            owner,
            entries: Adjacency::of_slots(n, &smoothing.nodes),
            corners: Adjacency::of_slots(n, sub.tets.as_flattened()),
            alpha,
            tet_weights: tet_weights(sub, alpha),
        }
    }

    /// Returns the columns of a row, ascending, and writes their positions to `slot`.
    fn columns(&self, node: usize, slot: &mut [u32]) -> Vec<u32> {
        let mut out = Vec::new();
        // `slot` first marks a column as seen; the sorted columns then get their positions.
        let cells = self
            .entries
            .row(node)
            .iter()
            .map(|&entry| self.owner[entry as usize]);
        let in_cells = cells.flat_map(|c| self.smoothing.row(c as usize).0);
        for &k in in_cells {
            if slot[k as usize] == NONE {
                slot[k as usize] = 0;
                out.push(k);
            }
        }
        out.sort_unstable();
        out.iter()
            .enumerate()
            .for_each(|(position, &k)| slot[k as usize] = position as u32);
        out
    }

    /// Returns the columns of a row and its blocks `P_jk`.
    fn row(&self, node: usize, slot: &mut [u32]) -> (Vec<u32>, Vec<Matrix3<f64>>) {
        let columns = self.columns(node, slot);
        let mut p = vec![Matrix3::zeros(); columns.len()];
        for &entry in self.entries.row(node) {
            let cell = self.owner[entry as usize] as usize;
            let range = self.smoothing.starts[cell]..self.smoothing.starts[cell + 1];
            let (bj, cj) = (
                self.smoothing.gradients[entry as usize],
                self.sub.mixed[entry as usize],
            );
            let alpha = self.alpha[cell];
            let scale = alpha * (self.smoothing.volumes[cell] + self.sub.sums[cell]);
            for e in range {
                let (bk, ck) = (&self.smoothing.gradients[e], &self.sub.mixed[e]);
                let p = &mut p[slot[self.smoothing.nodes[e] as usize] as usize];
                for a in 0..3 {
                    for b in 0..3 {
                        p[(a, b)] += scale * (bj[a] * bk[b]) - alpha * (bj[a] * ck[b] + cj[a] * bk[b]);
                    }
                }
            }
        }
        add_tetrahedra(self.sub, &self.tet_weights, self.corners.row(node), slot, &mut p);
        // Only the used slots: there is one per node of the body.
        columns.iter().for_each(|&k| slot[k as usize] = NONE);
        (columns, p)
    }
}

/// Returns `Σ_I∋T α_I w_T` of every tetrahedron.
fn tet_weights(sub: &SubCells, alpha: &[f64]) -> Vec<f64> {
    let share = |t: &[u32; 4]| t.iter().map(|&v| alpha[v as usize]).sum::<f64>();
    sub.tets
        .iter()
        .zip(&sub.weights)
        .map(|(t, w)| w * share(t))
        .collect()
}

/// Adds the terms of the tetrahedra at a node to its row. `corners` lists the node's corners in these
/// tetrahedra.
fn add_tetrahedra(sub: &SubCells, weights: &[f64], corners: &[u32], slot: &[u32], p: &mut [Matrix3<f64>]) {
    for &place in corners {
        let (t, corner) = (place as usize / 4, place as usize % 4);
        let (g, w) = (&sub.gradients[t], weights[t]);
        for (k, gk) in sub.tets[t].iter().zip(g) {
            let p = &mut p[slot[*k as usize] as usize];
            for a in 0..3 {
                for b in 0..3 {
                    p[(a, b)] += w * (g[corner][a] * gk[b]);
                }
            }
        }
    }
}

/// Assembles the terms of the tetrahedra alone, in rows of 3 × 3 blocks.
pub(super) fn tetrahedra_stiffness(sub: &SubCells, lame: [f64; 2], alpha: &[f64]) -> BlockMatrix<f64> {
    let weights = tet_weights(sub, alpha);
    let corners = Adjacency::of_slots(alpha.len(), sub.tets.as_flattened());
    let row = |slot: &mut Vec<u32>, node: usize| {
        let corners = corners.row(node);
        let around = corners.iter().flat_map(|place| sub.tets[*place as usize / 4]);
        let mut columns: Vec<u32> = around.collect();
        columns.sort_unstable();
        columns.dedup();
        let mut p = vec![Matrix3::zeros(); columns.len()];
        (0..)
            .zip(&columns)
            .for_each(|(position, k)| slot[*k as usize] = position);
        add_tetrahedra(sub, &weights, corners, slot, &mut p);
        (columns, p.iter().map(|p| block(p, lame)).collect())
    };
    gathered(alpha.len(), &row)
}

fn block(p: &Matrix3<f64>, [lambda, mu]: [f64; 2]) -> [f64; 9] {
    let trace = mu * (p[(0, 0)] + p[(1, 1)] + p[(2, 2)]);
    // One material: `λ` and `μ` multiply the sums over cells once per block.
    let mut out = [0.0; 9];
    for a in 0..3 {
        for b in 0..3 {
            out[3 * a + b] = lambda * p[(a, b)] + mu * p[(b, a)];
        }
        out[4 * a] += trace;
    }
    out
}

/// Assembles the weighted stiffness \[N/m\] with the weight `α_I` \[–\] of every cell. Both triangles are
/// stored and are bitwise transposes of each other.
pub(crate) fn stiffness(
    smoothing: &Smoothing,
    sub: &SubCells,
    material: &Elastic<f64>,
    alpha: &[f64],
) -> BlockMatrix<f64> {
    let parts = Parts::new(smoothing, sub, alpha);
    let lame = material.lame();
    gathered(smoothing.volumes.len(), &|slot, i| {
        let (columns, p) = parts.row(i, slot);
        (columns, p.iter().map(|p| block(p, lame)).collect())
    })
}

/// Assembles a matrix of `n` rows. `row` returns the columns and blocks of a row; it may use the slots, one
/// per node, as a working buffer.
fn gathered(
    n: usize,
    row: &(impl Fn(&mut Vec<u32>, usize) -> (Vec<u32>, Vec<[f64; 9]>) + Sync),
) -> BlockMatrix<f64> {
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    // In batches, so that the rows in flight stay small beside the matrix.
    for first in (0..n).step_by(64 * CHUNK) {
        let rows: Vec<_> = (first..(first + 64 * CHUNK).min(n))
            .into_par_iter()
            .map_init(|| vec![NONE; n], row)
            .collect();
        for (row, blocks) in rows {
            columns.extend(row);
            values.extend_from_slice(blocks.as_flattened());
            starts.push(columns.len());
        }
    }
    BlockMatrix::new(3, starts, columns, values)
}

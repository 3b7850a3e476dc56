//! Assembly of the stiffness in block compressed rows.

use super::element_stiffness;
use crate::mesh::Mesh;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::blocks::BlockMatrix;
use arlequin_core::{Materials, Real};
use rayon::prelude::*;

/// Elements whose matrices are held in memory at once: about 2.4 MB in double precision.
const BATCH: usize = 512;

/// Weighted stiffness `Σ_e α_e K_e` \[N/m\] of a mesh, with one weight `α_e` \[–\] per element, in blocks of
/// 3 × 3 for solids and 1 × 1 for bars. Both triangles are stored and are bitwise transposes of each other.
pub(crate) fn stiffness<T: Real>(
    mesh: &Mesh<T>,
    materials: &Materials<T>,
    weights: &[T],
    repeated: bool,
) -> BlockMatrix<T> {
    let nodes = mesh.nodes().len();
    let incidence = Adjacency::of_slots(nodes, mesh.connectivity());
    let n = mesh.kind().corners();
    let (mut starts, mut columns) = (vec![0], Vec::new());
    let mut row: Vec<u32> = Vec::new();
    for i in 0..nodes {
        row.clear();
        for &slot in incidence.row(i) {
            row.extend(mesh.element(slot as usize / n));
        }
        row.sort_unstable();
        row.dedup();
        columns.extend_from_slice(&row);
        starts.push(columns.len());
    }
    let mut matrix = BlockMatrix::zeros(mesh.kind().components(), starts, columns);
    assemble(&mut matrix, mesh, materials, (weights, repeated), &|k| {
        Some(k as usize)
    });
    matrix
}

/// Replaces the values of a stiffness by those for the weights `α_e`. `row` returns the row of a node, or
/// `None` if this rank has no such row.
pub(crate) fn assemble<T: Real>(
    matrix: &mut BlockMatrix<T>,
    mesh: &Mesh<T>,
    materials: &Materials<T>,
    (weights, repeated): (&[T], bool),
    row: &(dyn Fn(u32) -> Option<usize> + Sync),
) {
    // On a rank with part of the body, only its elements are integrated.
    let has_row = |e: &usize| mesh.element(*e).iter().any(|k| row(*k).is_some());
    matrix.clear();
    let mut batch = Vec::with_capacity(BATCH);
    // In batches: matrices of all elements at once would take more memory than the result.
    for first in (0..mesh.element_count()).step_by(BATCH) {
        let range = first..(first + BATCH).min(mesh.element_count());
        range
            .clone()
            .into_par_iter()
            .map(|e| has_row(&e).then(|| element_stiffness(mesh, materials, e, repeated)))
            .collect_into_vec(&mut batch);
        // Added in the order of the elements: the sums have the same bits for any number of threads.
        for (e, k) in range.zip(&batch) {
            let nodes = mesh.element(e);
            for (i, k) in nodes.iter().zip(k.iter().flatten()) {
                let Some(i) = row(*i) else { continue };
                for (j, block) in nodes.iter().zip(k) {
                    matrix.add(i, *j, block, weights[e]);
                }
            }
        }
    }
    matrix.share_rows();
}

//! The internal forces `−K q`, in two forms that agree to round-off.
//!
//! [`BlockMatrix`] stores the assembled stiffness by rows of 3 × 3 blocks; [`ElementLoop`] stores shape gradients at
//! Gauss points and never forms a matrix. Both gather what belongs to one node in one place, in a fixed order, so
//! results have the same bits for any number of threads. The model uses the first; `benches/forces.rs` says why.

mod blocks;
mod elements;

pub use arlequin_core::blocks::BlockMatrix;
pub use blocks::{assemble, stiffness};
pub use elements::ElementLoop;

use crate::element::{self, ElementKind, MAX_CORNERS};
use crate::mesh::Mesh;
use arlequin_core::Real;
use arlequin_core::material::Elastic;
use nalgebra::Matrix3;

/// Nodes per parallel task.
pub(crate) const CHUNK: usize = 512;

/// Models with fewer nodes run on the calling thread: waking others costs more than it saves.
pub(crate) const SERIAL: usize = 2048;

/// Stiffness blocks of one element, `K_ij = ∫ λ g_i g_jᵀ + μ g_j g_iᵀ + μ (g_i · g_j) I dV` \[N/m\];
/// for bars `E ∫ g_i g_j dV` in the first entry.
pub(crate) fn element_stiffness<T: Real>(
    mesh: &Mesh<T>,
    material: &Elastic<T>,
    e: usize,
) -> [[Matrix3<T>; MAX_CORNERS]; MAX_CORNERS] {
    let n = mesh.kind().corners();
    let mut k = [[Matrix3::zeros(); MAX_CORNERS]; MAX_CORNERS];
    let [lambda, mu] = material.lame();
    element::for_each_gauss(mesh.kind(), &mesh.corners(e), mesh.section(), &mut |p| {
        let g = &p.gradients;
        for i in 0..n {
            for j in i..n {
                if mesh.kind() == ElementKind::Bar2 {
                    k[i][j][(0, 0)] += material.young() * g[i].x * g[j].x * p.weight;
                    continue;
                }
                let (l, m) = (lambda * p.weight, mu * p.weight);
                let mut block = g[i] * (g[j] * l).transpose() + g[j] * (g[i] * m).transpose();
                let trace = g[i].dot(&g[j]) * m;
                (0..3).for_each(|a| block[(a, a)] += trace);
                k[i][j] += block;
            }
        }
    });
    for (i, j) in (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))) {
        let upper = k[j][i];
        // The diagonal block is symmetric up to round-off only.
        k[i][j] = if i == j {
            (upper + upper.transpose()) * T::of(0.5)
        } else {
            upper.transpose()
        };
    }
    k
}

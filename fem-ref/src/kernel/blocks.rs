//! Assembled stiffness in block compressed rows.

use super::{CHUNK, Incidence, SERIAL, element_stiffness};
use crate::mesh::Mesh;
use arlequin_core::Real;
use arlequin_core::material::Elastic;
use rayon::prelude::*;
use sprs::CsMat;
use std::ops::Range;

/// Weighted stiffness `Σ_e α_e K_e` \[N/m\] in rows of square blocks: 3 × 3 for solids, 1 × 1 for bars. Both
/// triangles are stored and are bitwise transposes of each other.
#[derive(Debug, Clone)]
pub struct BlockMatrix<T> {
    components: usize,
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T: Real> BlockMatrix<T> {
    /// The matrix of a mesh with the weight `α_e` \[–\] of every element.
    pub fn new(mesh: &Mesh<T>, material: &Elastic<T>, weights: &[T]) -> Self {
        let nodes = mesh.nodes().len();
        let incidence = Incidence::new(nodes, mesh.connectivity());
        let n = mesh.kind().corners();
        let (mut starts, mut columns) = (vec![0], Vec::new());
        let mut row: Vec<u32> = Vec::new();
        for i in 0..nodes {
            row.clear();
            for &slot in incidence.of(i) {
                row.extend(mesh.element(slot as usize / n));
            }
            row.sort_unstable();
            row.dedup();
            columns.extend_from_slice(&row);
            starts.push(columns.len());
        }
        let components = mesh.kind().components();
        let mut matrix = Self {
            components,
            values: vec![T::zero(); columns.len() * components * components],
            starts,
            columns,
        };
        matrix.assemble(mesh, material, weights);
        matrix
    }

    /// Replaces the values by those of other weights `α_e`.
    pub fn assemble(&mut self, mesh: &Mesh<T>, material: &Elastic<T>, weights: &[T]) {
        self.values.fill(T::zero());
        let mut batch = Vec::with_capacity(CHUNK);
        for first in (0..mesh.element_count()).step_by(CHUNK) {
            let range = first..(first + CHUNK).min(mesh.element_count());
            range
                .clone()
                .into_par_iter()
                .map(|e| element_stiffness(mesh, material, e))
                .collect_into_vec(&mut batch);
            for (e, k) in range.zip(&batch) {
                let nodes = mesh.element(e);
                for (i, k) in nodes.iter().zip(k) {
                    for (j, block) in nodes.iter().zip(k) {
                        self.add(*i as usize, *j, block, weights[e]);
                    }
                }
            }
        }
    }

    fn add(&mut self, i: usize, j: u32, block: &nalgebra::Matrix3<T>, weight: T) {
        let row = &self.columns[self.starts[i]..self.starts[i + 1]];
        let (c, at) = (self.components, self.starts[i] + row.partition_point(|&k| k < j));
        let values = &mut self.values[at * c * c..(at + 1) * c * c];
        for a in 0..c {
            for b in 0..c {
                values[a * c + b] += block[(a, b)] * weight;
            }
        }
    }

    /// Subtracts `D K q` from `f` \[N\], with an optional factor `D` per node. Allocates nothing.
    pub fn subtract_product(&self, q: &[T], factors: Option<&[T]>, f: &mut [T]) {
        match self.components {
            1 => self.rows::<1>(q, factors, f),
            _ => self.rows::<3>(q, factors, f),
        }
    }

    fn rows<const C: usize>(&self, q: &[T], factors: Option<&[T]>, f: &mut [T]) {
        let q = q.as_chunks::<C>().0;
        let work = |chunk: usize, f: &mut [T]| {
            for (k, out) in f.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                let i = chunk * CHUNK + k;
                let y = self.row::<C>(i, q);
                let d = factors.map_or(T::one(), |d| d[i]);
                for (o, y) in out.iter_mut().zip(y) {
                    *o -= y * d;
                }
            }
        };
        if q.len() < SERIAL {
            f.chunks_mut(CHUNK * C).enumerate().for_each(|(k, f)| work(k, f));
        } else {
            f.par_chunks_mut(CHUNK * C)
                .enumerate()
                .for_each(|(k, f)| work(k, f));
        }
    }

    /// Block row `i` of `K q`.
    #[inline]
    fn row<const C: usize>(&self, i: usize, q: &[[T; C]]) -> [T; C] {
        let range = self.starts[i]..self.starts[i + 1];
        // Nested arrays of a generic size cannot be sliced flat, so a block is C rows of C values.
        let values = self.values[range.start * C * C..range.end * C * C]
            .as_chunks::<C>()
            .0;
        let mut y = [T::zero(); C];
        for (j, block) in self.columns[range].iter().zip(values.chunks_exact(C)) {
            let x = &q[*j as usize];
            for (y, a) in y.iter_mut().zip(block) {
                let mut s = T::zero();
                for (a, x) in a.iter().zip(x) {
                    s += *a * *x;
                }
                *y += s;
            }
        }
        y
    }

    /// `½ qᵀ D K q` \[J\], summed over a fixed tree: the same bits for any number of threads. Allocates nothing.
    pub fn energy(&self, q: &[T], factors: Option<&[T]>) -> T {
        let sum = match self.components {
            1 => self.energy_of::<1>(0..q.len(), q.as_chunks().0, factors),
            _ => self.energy_of::<3>(0..q.len() / 3, q.as_chunks().0, factors),
        };
        sum * T::of(0.5)
    }

    fn energy_of<const C: usize>(&self, rows: Range<usize>, q: &[[T; C]], factors: Option<&[T]>) -> T {
        if rows.len() <= CHUNK {
            return rows.fold(T::zero(), |sum, i| {
                let y = self.row::<C>(i, q);
                let dot = y.iter().zip(&q[i]).fold(T::zero(), |s, (a, b)| s + *a * *b);
                sum + dot * factors.map_or(T::one(), |d| d[i])
            });
        }
        let middle = rows.start + rows.len() / 2;
        let (low, high) = (rows.start..middle, middle..rows.end);
        let (a, b) = if rows.len() < SERIAL {
            (
                self.energy_of::<C>(low, q, factors),
                self.energy_of::<C>(high, q, factors),
            )
        } else {
            rayon::join(
                || self.energy_of::<C>(low, q, factors),
                || self.energy_of::<C>(high, q, factors),
            )
        };
        a + b
    }

    /// The same matrix in scalar compressed rows.
    pub fn to_csr(&self) -> CsMat<T> {
        let c = self.components;
        let rows = self.starts.len() - 1;
        let mut starts = Vec::with_capacity(rows * c + 1);
        let mut columns = Vec::with_capacity(self.values.len());
        let mut values = Vec::with_capacity(self.values.len());
        starts.push(0);
        for i in 0..rows {
            for a in 0..c {
                for at in self.starts[i]..self.starts[i + 1] {
                    for b in 0..c {
                        columns.push(self.columns[at] as usize * c + b);
                        values.push(self.values[at * c * c + a * c + b]);
                    }
                }
                starts.push(columns.len());
            }
        }
        CsMat::new((rows * c, rows * c), starts, columns, values)
    }

    /// Number of stored values.
    pub fn stored(&self) -> usize {
        self.values.len()
    }
}

//! Internal forces without a stiffness matrix, from the smoothed gradients themselves.
//!
//! With `G_I = ∇̃u_I`, `H_T = ∇u_T` and the weights of [`super::stabilise`] the forces are
//! `f_j = Σ_I S_I b_Ij + Σ_T R_T g_Tj`, where `S_I = α_I [(V_I + W_I) σ(G_I) − Σ_T∋I w_T σ(H_T)]` and
//! `R_T = w_T Σ_I∈T α_I [σ(H_T) − σ(G_I)]`. Four passes, each of which writes every value once and from its own list in
//! a fixed order: stresses of the tetrahedra, of the cells, their differences, and the gathering at the nodes through
//! the transposed rows of `b`. Results have the same bits for any number of threads.
//!
//! Why not a matrix: it is read from memory once per call, the gradients are a fraction of it. Measured on 9027 nodes with
//! Laplace functions, one call on one thread (`benches/forces.rs`): 4.9 ms, 1.8 ms without stabilisation, against 12.9 ms
//! for the product with 3 × 3 blocks; with two threads 2.5, 0.9 and 6.8 ms.

use super::matrix::{CHUNK, SERIAL};
use super::{Smoothing, SubCells};
use arlequin_core::Elastic;
use arlequin_core::adjacency::Adjacency;
use rayon::prelude::*;
use std::ops::Range;

/// A symmetric tensor: xx, yy, zz, yz, xz, xy.
type Sym = [f64; 6];

/// Sparse rows of vectors.
type Rows = Adjacency<(u32, [f64; 3])>;

/// The smoothed gradients by cell, without the zeros that the stabilisation added to the pattern.
fn by_cell(smoothing: &Smoothing) -> Rows {
    Rows::from_rows((0..smoothing.volumes.len()).map(|cell| {
        let (nodes, gradients) = smoothing.row(cell);
        let row = nodes.iter().zip(gradients).map(|(&k, g)| (k, [g.x, g.y, g.z]));
        row.filter(|e| e.1.iter().any(|g| g.abs() > 0.0))
    }))
}

/// The same entries by node, cells ascending.
fn by_node(cells: &Rows) -> Rows {
    let entry = |cell: usize| cells.row(cell).iter().map(move |&(k, g)| (k, (cell as u32, g)));
    Rows::new(cells.len(), (0..cells.len()).flat_map(entry))
}

/// Values computed by every call.
#[derive(Debug, Clone, Default)]
struct Buffers {
    /// `w_T σ(H_T)`, then `R_T` \[N·m\].
    tets: Vec<Sym>,
    /// `S_I` and `α_I σ(G_I)`.
    cells: Vec<[Sym; 2]>,
}

/// The internal forces of the weighted body, computed from gradients.
#[derive(Debug, Clone)]
pub(crate) struct MatrixFree {
    rows: Rows,
    columns: Rows,
    corners: Adjacency,
    lame: [f64; 2],
    alpha: Vec<f64>,
    buffers: Buffers,
}

#[inline]
fn stress(g: &[f64; 9], [lambda, mu]: [f64; 2]) -> Sym {
    let (trace, two) = (lambda * (g[0] + g[4] + g[8]), 2.0 * mu);
    [
        trace + two * g[0],
        trace + two * g[4],
        trace + two * g[8],
        mu * (g[5] + g[7]),
        mu * (g[2] + g[6]),
        mu * (g[1] + g[3]),
    ]
}

#[inline]
fn add_outer(sum: &mut [f64; 9], u: &[f64; 3], b: [f64; 3]) {
    for r in 0..3 {
        for c in 0..3 {
            sum[3 * r + c] += u[r] * b[c];
        }
    }
}

#[inline]
fn add_traction(f: &mut [f64; 3], s: &Sym, b: [f64; 3]) {
    f[0] += s[0] * b[0] + s[5] * b[1] + s[4] * b[2];
    f[1] += s[5] * b[0] + s[1] * b[1] + s[3] * b[2];
    f[2] += s[4] * b[0] + s[3] * b[1] + s[2] * b[2];
}

/// `σ(g) : g`.
fn product(g: &[f64; 9], lame: [f64; 2]) -> f64 {
    let s = stress(g, lame);
    let shear = s[3] * (g[5] + g[7]) + s[4] * (g[2] + g[6]) + s[5] * (g[1] + g[3]);
    s[0] * g[0] + s[1] * g[4] + s[2] * g[8] + shear
}

/// Gradient of a tetrahedron.
#[inline]
fn linear(sub: &SubCells, t: usize, q: &[[f64; 3]]) -> [f64; 9] {
    let mut out = [0.0; 9];
    for (&k, g) in sub.tets[t].iter().zip(&sub.gradients[t]) {
        add_outer(&mut out, &q[k as usize], [g.x, g.y, g.z]);
    }
    out
}

/// Calls `work` for every item, on all threads when there are many. Allocates nothing.
fn each<T: Send>(items: &mut [T], nodes: usize, work: impl Fn(usize, &mut T) + Sync) {
    let chunk = |c: usize, items: &mut [T]| {
        for (k, item) in items.iter_mut().enumerate() {
            work(c * CHUNK + k, item);
        }
    };
    if nodes < SERIAL {
        chunk(0, items);
    } else {
        items
            .par_chunks_mut(CHUNK)
            .enumerate()
            .for_each(|(c, items)| chunk(c, items));
    }
}

impl MatrixFree {
    /// Forces with the weight `α_I` \[–\] of every cell.
    pub(crate) fn new(
        smoothing: &Smoothing,
        sub: &SubCells,
        material: &Elastic<f64>,
        alpha: Vec<f64>,
    ) -> Self {
        let rows = by_cell(smoothing);
        Self {
            columns: by_node(&rows),
            rows,
            corners: Adjacency::of_slots(alpha.len(), sub.tets.as_flattened()),
            lame: material.lame(),
            buffers: Buffers {
                tets: vec![Sym::default(); sub.tets.len()],
                cells: vec![[Sym::default(); 2]; alpha.len()],
            },
            alpha,
        }
    }

    /// Changes the weights \[–\] of the cells.
    pub(crate) fn set_weights(&mut self, alpha: Vec<f64>) {
        self.alpha = alpha;
    }

    /// The weights \[–\] of the cells.
    pub(crate) fn weights(&self) -> &[f64] {
        &self.alpha
    }

    /// Subtracts `K q` from `f` \[N\]. Allocates nothing.
    pub(crate) fn subtract_product(
        &mut self,
        smoothing: &Smoothing,
        sub: &SubCells,
        q: &[f64],
        f: &mut [f64],
    ) {
        let (q, lame, alpha) = (q.as_chunks::<3>().0, self.lame, &self.alpha);
        let n = q.len();
        let Buffers { tets, cells } = &mut self.buffers;
        each(tets, n, |t, s| {
            *s = stress(&linear(sub, t, q), lame).map(|v| v * sub.weights[t]);
        });
        each(cells, n, |i, out| {
            let s = stress(&gradient(&self.rows, i, q), lame);
            let mut sum = s.map(|v| v * (smoothing.volumes[i] + sub.sums[i]));
            for &at in self.corners.row(i) {
                let t = &tets[at as usize / 4];
                (0..6).for_each(|c| sum[c] -= t[c]);
            }
            *out = [sum.map(|v| v * alpha[i]), s.map(|v| v * alpha[i])];
        });
        each(tets, n, |t, s| {
            let (mut share, mut mean) = (0.0, Sym::default());
            for &i in &sub.tets[t] {
                share += alpha[i as usize];
                (0..6).for_each(|c| mean[c] += cells[i as usize][1][c]);
            }
            (0..6).for_each(|c| s[c] = share * s[c] - sub.weights[t] * mean[c]);
        });
        each(f.as_chunks_mut::<3>().0, n, |j, f| {
            let mut y = [0.0; 3];
            for &(i, b) in self.columns.row(j) {
                add_traction(&mut y, &cells[i as usize][0], b);
            }
            for &at in self.corners.row(j) {
                let (t, corner) = (at as usize / 4, at as usize % 4);
                let g = &sub.gradients[t][corner];
                add_traction(&mut y, &tets[t], [g.x, g.y, g.z]);
            }
            (0..3).for_each(|a| f[a] -= y[a]);
        });
    }

    /// `½ qᵀ K q` \[J\], summed over a fixed tree: the same bits for any number of threads. Allocates nothing.
    pub(crate) fn energy(&self, smoothing: &Smoothing, sub: &SubCells, q: &[f64]) -> f64 {
        let q = q.as_chunks::<3>().0;
        0.5 * tree(0..q.len(), &|i| self.cell_energy(smoothing, sub, q, i))
    }

    /// `α_I [V_I σ(G_I) : G_I + Σ_T∋I w_T σ(G_I − H_T) : (G_I − H_T)]`.
    fn cell_energy(&self, smoothing: &Smoothing, sub: &SubCells, q: &[[f64; 3]], i: usize) -> f64 {
        let g = gradient(&self.rows, i, q);
        let mut sum = smoothing.volumes[i] * product(&g, self.lame);
        for &at in self.corners.row(i) {
            let t = at as usize / 4;
            let mut h = linear(sub, t, q);
            (0..9).for_each(|c| h[c] = g[c] - h[c]);
            sum += sub.weights[t] * product(&h, self.lame);
        }
        sum * self.alpha[i]
    }
}

/// Smoothed gradient of a cell.
#[inline]
fn gradient(rows: &Rows, cell: usize, q: &[[f64; 3]]) -> [f64; 9] {
    let mut out = [0.0; 9];
    for &(k, b) in rows.row(cell) {
        add_outer(&mut out, &q[k as usize], b);
    }
    out
}

/// Sums over a fixed tree.
fn tree(range: Range<usize>, value: &(impl Fn(usize) -> f64 + Sync)) -> f64 {
    if range.len() <= CHUNK {
        return range.map(value).sum();
    }
    let middle = range.start + range.len() / 2;
    let (low, high) = (range.start..middle, middle..range.end);
    let (a, b) = if range.len() < SERIAL {
        (tree(low, value), tree(high, value))
    } else {
        rayon::join(|| tree(low, value), || tree(high, value))
    };
    a + b
}

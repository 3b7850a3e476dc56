//! Sparse matrices summed row by row from dense blocks, in a fixed order.
//!
//! A task (a cell of the mediator, or some particles) sums its products in one dense block over its nodes and
//! hands over the rows. Rows are merged in the order of the tasks.

use crate::Real;
use crate::adjacency::Adjacency;
use crate::field::ShapeRow;
use crate::junction::{Junction, ShapeFunction};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use sprs::CsMat;

/// Number of entries that wait before they are merged into their rows.
const PENDING: usize = 1 << 22;

/// Entries that a task adds to one row: columns ascending, each once.
pub(super) struct Part<T> {
    row: u32,
    entries: Vec<(u32, T)>,
}

/// Local numbers of the nodes of a task, in the order in which the task first met them.
struct Slots {
    /// For each node: the task that met it last, and its local number there.
    known: Vec<(u32, u32)>,
    task: u32,
    nodes: Vec<u32>,
}

impl Slots {
    fn new(count: usize) -> Self {
        Self {
            known: vec![(0, 0); count],
            task: 1,
            nodes: Vec::new(),
        }
    }

    fn slot(&mut self, node: usize) -> usize {
        let known = &mut self.known[node];
        if known.0 != self.task {
            *known = (self.task, self.nodes.len() as u32);
            self.nodes.push(node as u32);
        }
        known.1 as usize
    }

    fn clear(&mut self) {
        self.nodes.clear();
        // A new task number forgets all nodes at once, without clearing the table.
        self.task = self.task.wrapping_add(1);
        if self.task == 0 {
            self.known.fill((0, 0));
            self.task = 1;
        }
    }
}

/// Products of one task as a dense matrix over its nodes. A row grows with the number of columns that the
/// task has met.
pub(super) struct Block<T> {
    /// Components that the block of two nodes mixes: 1 or all.
    size: usize,
    rows: Slots,
    cols: Slots,
    values: Vec<Vec<T>>,
    /// Nodes of the present samples and the sum over these samples. Samples of one cell intersection share
    /// nodes.
    last: [Vec<usize>; 2],
    piece: Vec<T>,
}

impl<T: Real> Block<T> {
    /// Makes an empty block for matrices between `nodes` rows and columns of nodes, with `size` components
    /// each.
    pub(super) fn new(nodes: [usize; 2], size: usize) -> Self {
        Self {
            size,
            rows: Slots::new(nodes[0]),
            cols: Slots::new(nodes[1]),
            values: Vec::new(),
            last: [Vec::new(), Vec::new()],
            piece: Vec::new(),
        }
    }

    /// Adds `measure · ⟨N_i, N_j⟩` at a point.
    pub(super) fn add(
        &mut self,
        junction: &dyn Junction<T>,
        (x, measure): (&Point3<T>, T),
        rows: &ShapeRow<T>,
        cols: &ShapeRow<T>,
    ) {
        if self.last[0] != rows.nodes || self.last[1] != cols.nodes {
            self.flush();
            self.last[0].extend_from_slice(&rows.nodes);
            self.last[1].extend_from_slice(&cols.nodes);
            let entries = rows.nodes.len() * cols.nodes.len() * self.size * self.size;
            self.piece.resize(entries, T::zero());
        }
        // One number per pair of nodes suffices only where components do not mix.
        match junction.coefficients(x).filter(|_| self.size == 1) {
            Some(factors) => add_scalar(&mut self.piece, factors.map(|f| f * measure), rows, cols),
            None => self.add_blocks(junction, (x, measure), rows, cols),
        }
    }

    fn add_blocks(
        &mut self,
        junction: &dyn Junction<T>,
        (x, measure): (&Point3<T>, T),
        rows: &ShapeRow<T>,
        cols: &ShapeRow<T>,
    ) {
        let size = self.size;
        let mut blocks = self.piece.chunks_exact_mut(size * size);
        for i in 0..rows.nodes.len() {
            let row = shape(rows, i);
            for (j, out) in (0..cols.nodes.len()).zip(&mut blocks) {
                let product = junction.block(x, &row, &shape(cols, j)) * measure;
                for (k, out) in out.iter_mut().enumerate() {
                    *out += product[(k / size, k % size)];
                }
            }
        }
    }

    /// Adds the sum over the present samples to the dense block.
    fn flush(&mut self) {
        let block_size = self.size * self.size;
        let [rows, cols] = &self.last;
        if !cols.is_empty() {
            for (&node, sums) in rows.iter().zip(self.piece.chunks_exact(cols.len() * block_size)) {
                let row = self.rows.slot(node);
                if self.values.len() <= row {
                    self.values.push(Vec::new());
                }
                let values = &mut self.values[row];
                for (&node, sums) in cols.iter().zip(sums.chunks_exact(block_size)) {
                    let first = self.cols.slot(node) * block_size;
                    if values.len() < first + block_size {
                        values.resize(first + block_size, T::zero());
                    }
                    values[first..first + block_size]
                        .iter_mut()
                        .zip(sums)
                        .for_each(|(v, s)| *v += *s);
                }
            }
        }
        self.last.iter_mut().for_each(Vec::clear);
        self.piece.clear();
    }

    /// Returns the rows added since the last call, and clears the block.
    pub(super) fn take(&mut self) -> Vec<Part<T>> {
        self.flush();
        let size = self.size;
        let mut order: Vec<usize> = (0..self.cols.nodes.len()).collect();
        // Columns were met in the order of the samples; sorted, rows can be merged without further sorting.
        order.sort_unstable_by_key(|k| self.cols.nodes[*k]);
        let mut parts = Vec::with_capacity(self.rows.nodes.len() * size);
        for (node, values) in self.rows.nodes.iter().zip(&mut self.values) {
            for a in 0..size {
                let entry = |k: usize, b: usize| values.get((k * size + a) * size + b).copied();
                let entries = order.iter().flat_map(|&k| {
                    let column = self.cols.nodes[k] * size as u32;
                    (0..size).filter_map(move |b| Some((column + b as u32, entry(k, b)?)))
                });
                parts.push(Part {
                    row: node * size as u32 + a as u32,
                    entries: entries.filter(|e| e.1 != T::zero()).collect(),
                });
            }
            // Kept with its memory for the next task.
            values.clear();
        }
        self.rows.clear();
        self.cols.clear();
        parts
    }
}

/// Adds `f₀ N_i N_j + f₁ ∇N_i·∇N_j` to every entry `ij`.
fn add_scalar<T: Real>(out: &mut [T], [f0, f1]: [T; 2], rows: &ShapeRow<T>, cols: &ShapeRow<T>) {
    let width = cols.nodes.len();
    if width == 0 {
        return;
    }
    for (out, value) in out.chunks_exact_mut(width).zip(&rows.values) {
        let scaled = f0 * *value;
        for (out, value) in out.iter_mut().zip(&cols.values) {
            *out += scaled * *value;
        }
    }
    if f1 == T::zero() {
        return;
    }
    for (out, slope) in out.chunks_exact_mut(width).zip(&rows.gradients) {
        let scaled = slope * f1;
        for (out, slope) in out.iter_mut().zip(&cols.gradients) {
            *out += scaled.dot(slope);
        }
    }
}

fn shape<T: Real>(row: &ShapeRow<T>, k: usize) -> ShapeFunction<T> {
    let gradient = row.gradients.get(k).copied().unwrap_or_else(Vector3::zeros);
    ShapeFunction {
        value: row.values[k],
        gradient,
    }
}

/// Sparse matrix that grows by the rows of one task after another.
pub(super) struct Rows<T> {
    rows: Vec<Vec<(u32, T)>>,
    pending: Vec<Part<T>>,
    entries: usize,
}

impl<T: Real> Rows<T> {
    pub(super) fn new(count: usize) -> Self {
        Self {
            rows: (0..count).map(|_| Vec::new()).collect(),
            pending: Vec::new(),
            entries: 0,
        }
    }

    /// Adds the rows of the next task.
    pub(super) fn add(&mut self, parts: Vec<Part<T>>) {
        self.entries += parts.iter().map(|p| p.entries.len()).sum::<usize>();
        self.pending.extend(parts);
        // Merging in batches bounds the memory of entries that wait.
        if self.entries > PENDING {
            self.merge();
        }
    }

    fn merge(&mut self) {
        let parts = std::mem::take(&mut self.pending);
        self.entries = 0;
        let owners: Vec<u32> = parts.iter().map(|p| p.row).collect();
        let of_row = Adjacency::of_slots(self.rows.len(), &owners);
        self.rows.par_iter_mut().enumerate().for_each(|(i, row)| {
            let parts_of_row = of_row.row(i);
            if parts_of_row.is_empty() {
                return;
            }
            for &k in parts_of_row {
                row.extend_from_slice(&parts[k as usize].entries);
            }
            // Only the few entries of a row are sorted. The sort is stable: entries of one column stay in the
            // order of tasks, and so do their sums, for any number of threads.
            row.sort_by_key(|e| e.0);
            row.dedup_by(|next, sum| {
                let is_same_column = next.0 == sum.0;
                if is_same_column {
                    sum.1 += next.1;
                }
                is_same_column
            });
        });
    }

    pub(super) fn into_matrix(mut self, cols: usize) -> CsMat<T> {
        self.merge();
        let size = (self.rows.len(), cols);
        let mut starts = Vec::with_capacity(self.rows.len() + 1);
        let count = self.rows.iter().map(Vec::len).sum();
        let (mut columns, mut values) = (Vec::with_capacity(count), Vec::with_capacity(count));
        starts.push(0);
        for row in std::mem::take(&mut self.rows) {
            // Zeros arise where entries cancel; in every step they would only cost time.
            for (j, v) in row.into_iter().filter(|e| e.1 != T::zero()) {
                columns.push(j as usize);
                values.push(v);
            }
            starts.push(columns.len());
        }
        CsMat::new(size, starts, columns, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::junction::{H1Strain, L2};

    fn row(nodes: &[usize], values: &[f64]) -> ShapeRow<f64> {
        let gradients = values
            .iter()
            .map(|v| Vector3::new(*v, 1.0 - v, 0.5 * v))
            .collect();
        ShapeRow {
            nodes: nodes.to_vec(),
            values: values.to_vec(),
            gradients,
        }
    }

    /// Samples with changing nodes, split into tasks in any way, give the plain sum of the junction's blocks.
    #[test]
    fn blocks_and_rows_give_the_sum_of_all_products() {
        let junctions: [(&dyn Junction<f64>, usize); 2] =
            [(&L2, 1), (&H1Strain::new(0.5).expect("length"), 3)];
        let samples: Vec<_> = (0..12)
            .map(|k: usize| {
                let (a, b) = (k / 2 % 3, k / 3 % 4);
                let v = 0.1 * k as f64;
                let cols = row(&[b, (b + 3) % 5, (b + 1) % 5], &[0.2, v, 0.8 - v]);
                (row(&[a + 1, a], &[v, 1.0 - v]), cols, 0.3 + v)
            })
            .collect();
        let x = Point3::origin();
        for (junction, size) in junctions {
            let mut expected = nalgebra::DMatrix::<f64>::zeros(4 * size, 5 * size);
            for (rows, cols, w) in &samples {
                for i in 0..2 {
                    for j in 0..3 {
                        let block = junction.block(&x, &shape(rows, i), &shape(cols, j));
                        for a in 0..size {
                            for b in 0..size {
                                expected[(rows.nodes[i] * size + a, cols.nodes[j] * size + b)] +=
                                    w * block[(a, b)];
                            }
                        }
                    }
                }
            }
            for per_task in [1, 5, 12] {
                let mut block = Block::new([4, 5], size);
                let mut sum = Rows::new(4 * size);
                for task in samples.chunks(per_task) {
                    for (rows, cols, w) in task {
                        block.add(junction, (&x, *w), rows, cols);
                    }
                    sum.add(block.take());
                    sum.merge();
                }
                let matrix = sum.into_matrix(5 * size);
                for i in 0..4 * size {
                    for j in 0..5 * size {
                        let v = matrix.get(i, j).copied().unwrap_or(0.0);
                        assert!((v - expected[(i, j)]).abs() < 1e-14, "{i} {j}");
                    }
                }
            }
        }
    }
}

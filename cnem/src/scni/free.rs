//! Internal forces from the smoothed gradients themselves, and a matrix for the stabilisation alone.
//!
//! With `G_I = Σ_k b_Ik ⊗ u_k`, `D_I = Σ_k c_Ik ⊗ u_k` and the weights of [`super::stabilise`] the forces are
//! `f_j = Σ_I (S_I b_Ij + Q_I c_Ij) + Σ_k K_jk u_k`, where `S_I = α_I [(V_I + W_I) σ(G_I) − σ(D_I)]`,
//! `Q_I = −α_I σ(G_I)` and `K` is the stiffness of the tetrahedra with the weights `w_T Σ_I∈T α_I`. There are
//! three passes: stresses of the cells, gathering at the nodes through the transposed rows, product with `K`.
//! Figures: decision 0032, `benches/forces.rs` of the workspace.

use super::matrix::{CHUNK, SERIAL, tetrahedra_stiffness};
use super::{Smoothing, SubCells};
use arlequin_core::Elastic;
use arlequin_core::Owned;
use arlequin_core::adjacency::Adjacency;
use arlequin_core::blocks::BlockMatrix;
use nalgebra::Vector3;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use std::ops::Range;

/// Four lanes: three components, and whatever lies behind them in memory. The fourth lane is loaded, but its
/// result is never used.
type Lanes = [f64; 4];

/// A symmetric tensor in one cache line, `xx xy xz yz zz xy yy yz`: each of its columns is three consecutive
/// numbers.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
struct Symmetric([f64; 8]);

impl Symmetric {
    /// Creates the tensor from its columns.
    #[inline(always)]
    fn new(s: [[f64; 3]; 3]) -> Self {
        let [xx, xy, xz] = s[0];
        let [_, yy, yz] = s[1];
        Self([xx, xy, xz, yz, s[2][2], xy, yy, yz])
    }
}

/// Stresses that a cell passes to its nodes: `S_I` and `Q_I`.
type Stresses = [Symmetric; 2];

/// Sum of products of symmetric tensors and vectors. The terms of the middle columns are one lane further on.
#[derive(Clone, Copy, Default)]
struct Traction {
    outer: Lanes,
    middle: Lanes,
}

impl Traction {
    #[inline(always)]
    fn add(&mut self, s: &Symmetric, b: &[f64]) {
        add(&mut self.outer, b[0], lanes(&s.0, 0));
        add(&mut self.outer, b[2], lanes(&s.0, 2));
        add(&mut self.middle, b[1], lanes(&s.0, 4));
    }

    fn sum(&self) -> [f64; 3] {
        // `middle` was loaded from entry 4, one before its column: its sums stand one lane further on.
        [0, 1, 2].map(|r: usize| self.outer[r] + self.middle[r + 1])
    }
}

/// Entry of a row: column, `b` and, where it is not zero, `c`.
type Entry = (u32, Vector3<f64>, Vector3<f64>);

/// Sparse rows of `b` and `c`. Entries with a `c` come first.
#[derive(Debug, Clone)]
struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// Three numbers per entry, and one more at the end, so that four lanes can be loaded from the last
    /// entry.
    b: Vec<f64>,
    with_c: Vec<usize>,
    c: Vec<f64>,
}

/// One row.
struct Row<'a> {
    columns: &'a [u32],
    b: &'a [f64],
    c: &'a [f64],
}

impl Rows {
    /// Creates the rows from entries in any order.
    fn new<R: Iterator<Item = Entry>>(rows: impl Iterator<Item = R>) -> Self {
        let mut out = Self {
            starts: vec![0],
            columns: Vec::new(),
            b: Vec::new(),
            with_c: vec![0],
            c: Vec::new(),
        };
        let mut row: Vec<Entry> = Vec::new();
        let is_zero = |v: &Vector3<f64>| v.iter().all(|x| x.abs() <= 0.0);
        for entries in rows {
            row.clear();
            row.extend(entries.filter(|e| !(is_zero(&e.1) && is_zero(&e.2))));
            // Entries with a `c` first, so that `c` needs no column numbers of its own.
            row.sort_by_key(|e| (is_zero(&e.2), e.0));
            for (column, b, c) in &row {
                out.columns.push(*column);
                out.b.extend(b.iter());
                if !is_zero(c) {
                    out.c.extend(c.iter());
                }
            }
            out.starts.push(out.columns.len());
            out.with_c.push(out.c.len() / 3);
        }
        // Padding: four lanes are loaded from the last entry too.
        out.b.push(0.0);
        out.c.push(0.0);
        out
    }

    /// Creates the rows of the gradients by cell.
    fn by_cell(smoothing: &Smoothing, sub: &SubCells) -> Self {
        Self::new((0..smoothing.volumes.len()).map(|cell| {
            let range = smoothing.starts[cell]..smoothing.starts[cell + 1];
            let (nodes, b) = smoothing.row(cell);
            let pairs = b.iter().zip(&sub.mixed[range]);
            nodes.iter().zip(pairs).map(|(k, (b, c))| (*k, *b, *c))
        }))
    }

    /// Creates the rows of the gradients by node (the transpose of [`Self::by_cell`]).
    fn by_node(smoothing: &Smoothing, sub: &SubCells) -> Self {
        let cells = smoothing.volumes.len();
        let slots = Adjacency::of_slots(cells, &smoothing.nodes);
        // Slots ascend with the cells: a search replaces a list as long as the entries.
        let cell_of = |slot: usize| smoothing.starts.partition_point(|s| *s <= slot) - 1;
        Self::new((0..cells).map(|node| {
            slots.row(node).iter().map(|&slot| {
                let slot = slot as usize;
                (cell_of(slot) as u32, smoothing.gradients[slot], sub.mixed[slot])
            })
        }))
    }

    /// Returns some of the rows, with renumbered columns.
    fn select(&self, rows: &[u32], column: impl Fn(&u32) -> u32) -> Self {
        let mut out = Self::new(std::iter::empty::<std::iter::Empty<Entry>>());
        (out.b, out.c) = (Vec::new(), Vec::new());
        for i in rows {
            let row = self.row(*i as usize);
            out.columns.extend(row.columns.iter().map(&column));
            // Without the extra number at the end, which belongs to the next row.
            out.b.extend(&row.b[..row.b.len() - 1]);
            out.c.extend(&row.c[..row.c.len() - 1]);
            out.starts.push(out.columns.len());
            out.with_c.push(out.c.len() / 3);
        }
        out.b.push(0.0);
        out.c.push(0.0);
        out
    }

    #[inline(always)]
    fn row(&self, i: usize) -> Row<'_> {
        let (b, c) = (
            self.starts[i]..self.starts[i + 1],
            self.with_c[i]..self.with_c[i + 1],
        );
        Row {
            columns: &self.columns[b.clone()],
            b: &self.b[3 * b.start..3 * b.end + 1],
            c: &self.c[3 * c.start..3 * c.end + 1],
        }
    }
}

#[inline(always)]
fn lanes(values: &[f64], start: usize) -> Lanes {
    let s = &values[start..start + 4];
    [s[0], s[1], s[2], s[3]]
}

#[inline(always)]
fn add(sum: &mut Lanes, factor: f64, v: Lanes) {
    for (sum, v) in sum.iter_mut().zip(v) {
        *sum += factor * v;
    }
}

/// Returns `G` and `D` of a cell, by rows.
#[inline(always)]
fn gradients(row: &Row<'_>, q: &[[f64; 3]]) -> [[Lanes; 3]; 2] {
    let [mut g, mut d] = [[[0.0; 4]; 3]; 2];
    let with_c = row.c.len() / 3;
    for (k, &node) in row.columns.iter().enumerate() {
        let u = &q[node as usize];
        let b = lanes(row.b, 3 * k);
        (0..3).for_each(|r| add(&mut g[r], u[r], b));
        // Entries with a `c` come first, so a count replaces a second list of columns.
        if k < with_c {
            let c = lanes(row.c, 3 * k);
            (0..3).for_each(|r| add(&mut d[r], u[r], c));
        }
    }
    [g, d]
}

/// Returns the columns of the stress of a displacement gradient.
#[inline(always)]
fn stress(g: &[Lanes; 3], [lambda, mu]: [f64; 2]) -> [[f64; 3]; 3] {
    let trace = lambda * (g[0][0] + g[1][1] + g[2][2]);
    let mut out = [[0.0; 3]; 3];
    for (c, out) in out.iter_mut().enumerate() {
        for (r, out) in out.iter_mut().enumerate() {
            // Twice the symmetric part times `mu`: the strain itself is never formed.
            *out = mu * (g[r][c] + g[c][r]);
        }
        out[c] += trace;
    }
    out
}

/// Returns `a : g`.
#[inline(always)]
fn product(a: &[[f64; 3]; 3], g: &[Lanes; 3]) -> f64 {
    (0..3).fold(0.0, |s, r| (0..3).fold(s, |s, c| s + a[c][r] * g[r][c]))
}

/// Internal forces of the weighted body, computed from gradients without an assembled matrix of the cells.
#[derive(Debug, Clone)]
pub(crate) struct MatrixFree {
    rows: Rows,
    columns: Rows,
    /// `V_I + W_I` \[m³\].
    volumes: Vec<f64>,
    lame: [f64; 2],
    alpha: Vec<f64>,
    /// Stiffness of the tetrahedra; `None` without stabilisation.
    tets: Option<BlockMatrix<f64>>,
    /// For a part of a body: positions of the owned nodes' cells in the list of cells.
    owned_cells: Option<Vec<u32>>,
    /// Stresses of the cells, computed anew by every evaluation.
    cells: Vec<Stresses>,
}

/// Task that computes the stresses of consecutive cells.
struct Cells<'a> {
    forces: &'a MatrixFree,
    q: &'a [[f64; 3]],
    first: usize,
    out: &'a mut [Stresses],
}

// Everything that `call` uses is `inline(always)`: `pulp` compiles for the vector unit only what is inlined.
impl NullaryFnOnce for Cells<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (i, out) in (self.first..).zip(self.out) {
            let [g, d] = gradients(&self.forces.rows.row(i), self.q);
            let (s, t) = (stress(&g, self.forces.lame), stress(&d, self.forces.lame));
            let (volume, alpha) = (self.forces.volumes[i], self.forces.alpha[i]);
            let weighted = |f: &dyn Fn(usize, usize) -> f64| {
                Symmetric::new([0, 1, 2].map(|c| [0, 1, 2].map(|r| alpha * f(c, r))))
            };
            *out = [
                weighted(&|c, r| volume * s[c][r] - t[c][r]),
                weighted(&|c, r| -s[c][r]),
            ];
        }
    }
}

/// Task that subtracts the forces on consecutive nodes from `f`.
struct Nodes<'a> {
    columns: &'a Rows,
    cells: &'a [Stresses],
    first: usize,
    f: &'a mut [[f64; 3]],
}

impl NullaryFnOnce for Nodes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (j, f) in (self.first..).zip(self.f) {
            let row = self.columns.row(j);
            let with_c = row.c.len() / 3;
            let mut y = Traction::default();
            for (k, &cell) in row.columns.iter().enumerate() {
                let [s, q] = &self.cells[cell as usize];
                y.add(s, &row.b[3 * k..3 * k + 3]);
                if k < with_c {
                    y.add(q, &row.c[3 * k..3 * k + 3]);
                }
            }
            f.iter_mut().zip(y.sum()).for_each(|(f, y)| *f -= y);
        }
    }
}

/// Task that computes twice the energy of consecutive cells, without the terms of the tetrahedra.
struct Energies<'a> {
    forces: &'a MatrixFree,
    q: &'a [[f64; 3]],
    range: Range<usize>,
}

impl NullaryFnOnce for Energies<'_> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let mut sum = 0.0;
        for i in self.range {
            let [g, d] = gradients(&self.forces.rows.row(i), self.q);
            let s = stress(&g, self.forces.lame);
            sum += self.forces.alpha[i] * (self.forces.volumes[i] * product(&s, &g) - 2.0 * product(&s, &d));
        }
        sum
    }
}

/// Calls `work` for chunks of the items, on all threads if there are many items. Allocates nothing.
fn in_chunks<T: Send>(items: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    // Waking threads costs more than a small body's forces.
    if items.len() < SERIAL {
        return work(0, items);
    }
    items
        .par_chunks_mut(CHUNK)
        .enumerate()
        .for_each(|(c, items)| work(c * CHUNK, items));
}

impl MatrixFree {
    /// Creates the force evaluation with the weight `α_I` \[–\] of every cell.
    pub(crate) fn new(
        smoothing: &Smoothing,
        sub: &SubCells,
        material: &Elastic<f64>,
        alpha: Vec<f64>,
    ) -> Self {
        let volumes = smoothing.volumes.iter().zip(&sub.sums).map(|(v, w)| v + w);
        let mut out = Self {
            rows: Rows::by_cell(smoothing, sub),
            columns: Rows::by_node(smoothing, sub),
            volumes: volumes.collect(),
            lame: material.lame(),
            // Allocated once: an evaluation writes every entry before it reads any.
            cells: vec![Stresses::default(); alpha.len()],
            alpha: Vec::new(),
            tets: None,
            owned_cells: None,
        };
        out.set_weights(sub, alpha);
        out
    }

    /// Sets the weights \[–\] of the cells.
    pub(crate) fn set_weights(&mut self, sub: &SubCells, alpha: Vec<f64>) {
        // Not in one matrix with the cells: these connect nodes to the neighbours of their neighbours,
        // tetrahedra to neighbours only, so that its rows would be five times as long. Not one by one: a node
        // has 24 tetrahedra and would read the data of each, but has only 15 neighbours.
        self.tets = (!sub.tets.is_empty()).then(|| tetrahedra_stiffness(sub, self.lame, &alpha));
        self.alpha = alpha;
    }

    /// Returns the weights \[–\] of the cells.
    pub(crate) fn weights(&self) -> &[f64] {
        &self.alpha
    }

    /// Number of row entries from which the forces on a node are gathered: its measure of work.
    pub(crate) fn entries(&self, node: usize) -> usize {
        let row = |rows: &Rows| rows.starts[node + 1] - rows.starts[node];
        let tets = self.tets.as_ref().map_or(0, |t| t.columns(node).len());
        row(&self.rows) + row(&self.columns) + tets
    }

    /// Returns the cells that some nodes gather from, and the nodes' own cells, ascending.
    pub(crate) fn cells_of(&self, nodes: &[u32]) -> Vec<u32> {
        let gathered = |i: &u32| self.columns.row(*i as usize).columns;
        let mut out: Vec<u32> = nodes.iter().flat_map(gathered).chain(nodes).copied().collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// Returns the nodes with a shape function on a cell, and the cell's own node.
    pub(crate) fn nodes_of_cell(&self, cell: u32) -> impl Iterator<Item = u32> {
        let row = self.rows.row(cell as usize).columns;
        row.iter().copied().chain([cell])
    }

    /// Returns the nodes that share a tetrahedron with `node`, itself included.
    pub(crate) fn tetrahedra_of(&self, node: u32) -> &[u32] {
        self.tets.as_ref().map_or(&[], |t| t.columns(node as usize))
    }

    /// Returns the data needed for the forces on the owned nodes `owned`, computed from `cells` and from
    /// displacements of the nodes `needed`; all three lists are ascending.
    pub(crate) fn part(&self, owned: &[u32], cells: &[u32], needed: &[u32]) -> Self {
        let place = |list: &[u32], k: &u32| list.partition_point(|n| n < k) as u32;
        let pick = |x: &[f64]| cells.iter().map(|c| x[*c as usize]).collect();
        Self {
            rows: self.rows.select(cells, |k| place(needed, k)),
            columns: self.columns.select(owned, |k| place(cells, k)),
            volumes: pick(&self.volumes),
            lame: self.lame,
            alpha: pick(&self.alpha),
            tets: self.tets.as_ref().map(|t| select_rows(t, owned, needed)),
            owned_cells: Some(owned.iter().map(|k| place(cells, k)).collect()),
            cells: vec![Stresses::default(); cells.len()],
        }
    }

    /// Sets the weights \[–\] of a part, see [`Self::part`]. `alpha` are the weights of all cells of the
    /// body.
    pub(crate) fn set_part_weights(
        &mut self,
        sub: &SubCells,
        alpha: &[f64],
        [owned, cells, needed]: [&[u32]; 3],
    ) {
        let tets = (!sub.tets.is_empty()).then(|| tetrahedra_stiffness(sub, self.lame, alpha));
        self.tets = tets.map(|t| select_rows(&t, owned, needed));
        self.alpha = cells.iter().map(|c| alpha[*c as usize]).collect();
    }

    /// Subtracts the internal forces \[N\] at displacements `q` from `f`. Allocates nothing.
    pub(crate) fn subtract_product(&mut self, q: &[f64], f: &mut [f64]) {
        // All stresses before any force: a node gathers from the cells of its neighbours as well.
        self.stress(q);
        self.gather(q, f);
    }

    /// Computes the stresses of the cells.
    fn stress(&mut self, q: &[f64]) {
        let (arch, q) = (Arch::new(), q.as_chunks::<3>().0);
        // Taken out, so that tasks can write stresses while they read the rest of `self`.
        let mut cells = std::mem::take(&mut self.cells);
        let forces = &*self;
        in_chunks(&mut cells, |first, out| {
            arch.dispatch(Cells {
                forces,
                q,
                first,
                out,
            });
        });
        self.cells = cells;
    }

    /// Subtracts the forces of the cell stresses and of the tetrahedra from `f`.
    fn gather(&self, q: &[f64], f: &mut [f64]) {
        // Every value is written once, from its own list in a fixed order, so that results have the same bits
        // for any number of threads.
        let arch = Arch::new();
        in_chunks(f.as_chunks_mut::<3>().0, |first, f| {
            arch.dispatch(Nodes {
                columns: &self.columns,
                cells: &self.cells,
                first,
                f,
            });
        });
        if let Some(tets) = &self.tets {
            tets.subtract_product(q, f);
        }
    }

    /// Returns `½ qᵀ K q` \[J\], summed exactly over units of nodes: the same bits for any number of threads.
    /// Allocates nothing. `local` are the displacements of the owned nodes, `q` those of the nodes `needed`.
    /// Collective for a partitioned body.
    pub(crate) fn energy(&self, owned: &Owned, local: &[f64], q: &[f64]) -> f64 {
        let arch = Arch::new();
        let nodes = q.as_chunks::<3>().0;
        let part = |unit: Range<usize>| {
            // The cells of a unit are consecutive.
            let first = self
                .owned_cells
                .as_ref()
                .map_or(unit.start, |cells| cells[unit.start] as usize);
            let (forces, q, range) = (self, nodes, first..first + unit.len());
            [arch.dispatch(Energies { forces, q, range })]
        };
        let [cells] = owned.sum(&part);
        let tets = self.tets.as_ref();
        0.5 * cells + tets.map_or(0.0, |t| t.energy_over_ranks(owned, local, q))
    }
}

/// Returns the rows of the owned nodes from the stiffness of the tetrahedra, for displacements of the nodes
/// `needed`.
fn select_rows(tets: &BlockMatrix<f64>, owned: &[u32], needed: &[u32]) -> BlockMatrix<f64> {
    let rows = owned.iter().map(|k| *k as usize);
    tets.some_rows(rows, needed.len(), |k| needed.partition_point(|n| *n < k) as u32)
}

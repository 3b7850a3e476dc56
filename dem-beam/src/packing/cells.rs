//! Fixed-radius neighbour search: particles sorted into cells, compressed rows.
//!
//! Everything is in the order of the particle numbers, so the lists are the same whatever the
//! number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Particles per unit of parallel work.
pub(crate) const CHUNK: usize = 512;

/// A sphere as the hot loops want it: `x, y, z, r`.
pub(crate) type Sphere = [f64; 4];

/// Cells of equal size with the particles in each.
#[derive(Debug, Default)]
pub(crate) struct CellList {
    low: Vector3<f64>,
    inverse: f64,
    dims: [usize; 3],
    start: Vec<u32>,
    order: Vec<u32>,
}

impl CellList {
    /// Sorts `spheres` into cells at least `size` wide.
    pub(crate) fn build(&mut self, spheres: &[Sphere], size: f64) {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for s in spheres {
            let x = Vector3::new(s[0], s[1], s[2]);
            low = low.inf(&x);
            high = high.sup(&x);
        }
        let extent = high - low;
        // Never many more cells than particles, however small `size` is.
        let fair = (extent.map(|e| e.max(size)).product() / (4 * spheres.len()) as f64).cbrt();
        let size = size.max(fair);
        self.low = low;
        self.inverse = 1.0 / size;
        self.dims = [0, 1, 2].map(|a| (extent[a] / size) as usize + 1);
        let cells = self.dims.iter().product::<usize>();
        self.start.clear();
        self.start.resize(cells + 1, 0);
        for s in spheres {
            let c = self.index(self.cell(s));
            self.start[c + 1] += 1;
        }
        for c in 0..cells {
            self.start[c + 1] += self.start[c];
        }
        self.order.resize(spheres.len(), 0);
        let mut next = self.start.clone();
        for (i, s) in spheres.iter().enumerate() {
            let c = self.index(self.cell(s));
            self.order[next[c] as usize] = i as u32;
            next[c] += 1;
        }
    }

    #[inline]
    fn cell(&self, s: &Sphere) -> [usize; 3] {
        [0, 1, 2].map(|a| {
            let c = (s[a] - self.low[a]) * self.inverse;
            (c.max(0.0) as usize).min(self.dims[a] - 1)
        })
    }

    #[inline]
    fn index(&self, c: [usize; 3]) -> usize {
        (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]
    }

    /// Calls `near` with every particle of the 27 cells around sphere `s`.
    #[inline]
    pub(crate) fn around(&self, s: &Sphere, mut near: impl FnMut(u32)) {
        let c = self.cell(s);
        let range = |a: usize| c[a].saturating_sub(1)..=(c[a] + 1).min(self.dims[a] - 1);
        let (k0, k1) = (*range(2).start(), *range(2).end());
        for i in range(0) {
            for j in range(1) {
                // Cells along the last axis are contiguous.
                let a = self.start[self.index([i, j, k0])] as usize;
                let b = self.start[self.index([i, j, k1]) + 1] as usize;
                for &n in &self.order[a..b] {
                    near(n);
                }
            }
        }
    }
}

/// Neighbours of [`CHUNK`] consecutive particles, compressed rows.
#[derive(Debug, Default, Clone)]
pub(crate) struct ListChunk {
    pub(crate) start: Vec<u32>,
    pub(crate) neighbours: Vec<u32>,
}

/// For each particle all others closer than `r_i + r_j + skin` (both directions stored), the
/// touching ones first: the branch "do they touch" is then foreseen by the processor, which
/// halves the time of a force evaluation.
pub(crate) fn verlet_list(cells: &mut CellList, spheres: &[Sphere], skin: f64, out: &mut Vec<ListChunk>) {
    let largest = spheres.iter().fold(0.0_f64, |m, s| m.max(s[3]));
    cells.build(spheres, 2.0 * largest + skin);
    let cells = &*cells;
    out.resize(spheres.len().div_ceil(CHUNK), ListChunk::default());
    out.par_iter_mut().enumerate().for_each(|(c, chunk)| {
        chunk.start.clear();
        chunk.neighbours.clear();
        chunk.start.push(0);
        let first = c * CHUNK;
        let mut apart: Vec<u32> = Vec::with_capacity(64);
        for i in first..(first + CHUNK).min(spheres.len()) {
            let s = spheres[i];
            let list = &mut chunk.neighbours;
            apart.clear();
            cells.around(&s, |j| {
                let t = spheres[j as usize];
                let d = [t[0] - s[0], t[1] - s[1], t[2] - s[2]];
                let reach = s[3] + t[3] + skin;
                let dd = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                if dd < reach * reach && j as usize != i {
                    let touch = s[3] + t[3];
                    if dd < touch * touch {
                        list.push(j);
                    } else {
                        apart.push(j);
                    }
                }
            });
            list.extend_from_slice(&apart);
            chunk.start.push(chunk.neighbours.len() as u32);
        }
    });
}

//! Fixed-radius neighbour search: particles sorted into cells, compressed rows.
//!
//! Lists follow the order of the particle numbers, so that they do not depend on the number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Number of particles per parallel task.
pub(crate) const CHUNK: usize = 512;

/// A sphere as the hot loops read it: `x, y, z, r` \[m\].
pub(crate) type Sphere = [f64; 4];

/// Returns the mean radius of spheres.
pub(crate) fn mean_radius(spheres: &[Sphere]) -> f64 {
    spheres.iter().map(|s| s[3]).sum::<f64>() / spheres.len() as f64
}

/// Returns spheres of given centres and radii.
pub(crate) fn spheres(positions: &[Vector3<f64>], radii: &[f64]) -> Vec<Sphere> {
    let zipped = positions.iter().zip(radii);
    zipped.map(|(x, r)| [x.x, x.y, x.z, *r]).collect()
}

/// Returns the centre of a sphere.
pub(crate) fn centre(s: &Sphere) -> Vector3<f64> {
    Vector3::new(s[0], s[1], s[2])
}

/// Returns the difference `d` of two points, shifted by periods to that between nearest periodic images.
#[inline]
pub(crate) fn image(mut d: [f64; 3], period: &[f64; 3]) -> [f64; 3] {
    for a in 0..3 {
        let half = 0.5 * period[a];
        // Positions leave the box by a little only, so that one shift is enough.
        if d[a] > half {
            d[a] -= period[a];
        } else if d[a] < -half {
            d[a] += period[a];
        }
    }
    d
}

/// Cells of equal size and the particles in each.
#[derive(Debug, Default)]
pub(crate) struct CellList {
    /// Edges of the periodic box at the origin \[m\]; `None` without a period.
    period: Option<[f64; 3]>,
    low: Vector3<f64>,
    inverse: [f64; 3],
    dims: [usize; 3],
    start: Vec<u32>,
    order: Vec<u32>,
    /// The particles in the order of the cells.
    sorted: Vec<Sphere>,
}

impl CellList {
    /// Returns empty cells of a body, or of a periodic box, which needs at least three cells along each edge.
    pub(crate) fn new(period: Option<[f64; 3]>) -> Self {
        Self {
            period,
            ..Self::default()
        }
    }

    /// Sorts `spheres` into cells at least `size` wide.
    pub(crate) fn build(&mut self, spheres: &[Sphere], size: f64) {
        let (low, extent) = self.extent(spheres);
        // Bounds the number of cells by some four per particle, however small `size` is.
        let fair = (extent.map(|e| e.max(size)).product() / (4 * spheres.len()) as f64).cbrt();
        let size = size.max(fair);
        self.low = low;
        if self.period.is_some() {
            self.dims = [0, 1, 2].map(|a| ((extent[a] / size) as usize).max(1));
            self.inverse = [0, 1, 2].map(|a| self.dims[a] as f64 / extent[a]);
        } else {
            self.dims = [0, 1, 2].map(|a| (extent[a] / size) as usize + 1);
            self.inverse = [1.0 / size; 3];
        }
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
        // Counting sort: within a cell, particles keep the order of their numbers.
        let mut next = self.start.clone();
        for (i, s) in spheres.iter().enumerate() {
            let c = self.index(self.cell(s));
            self.order[next[c] as usize] = i as u32;
            next[c] += 1;
        }
        self.sorted.clear();
        self.sorted
            .extend(self.order.iter().map(|&i| spheres[i as usize]));
    }

    /// Returns the lowest corner and the edges of the box that the cells cover.
    fn extent(&self, spheres: &[Sphere]) -> (Vector3<f64>, Vector3<f64>) {
        if let Some(period) = self.period {
            return (Vector3::zeros(), Vector3::from(period));
        }
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for s in spheres {
            let x = centre(s);
            low = low.inf(&x);
            high = high.sup(&x);
        }
        (low, high - low)
    }

    #[inline]
    fn cell(&self, s: &Sphere) -> [usize; 3] {
        [0, 1, 2].map(|a| {
            let x = s[a] - self.low[a];
            let x = self.period.map_or(x, |p| x.rem_euclid(p[a]));
            let c = x * self.inverse[a];
            (c.max(0.0) as usize).min(self.dims[a] - 1)
        })
    }

    #[inline]
    fn index(&self, c: [usize; 3]) -> usize {
        (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]
    }

    /// Calls `visit` with every particle of the 27 cells around sphere `s`.
    #[inline]
    pub(crate) fn around(&self, s: &Sphere, mut visit: impl FnMut(u32)) {
        self.rows_around(s, |numbers, _| numbers.iter().for_each(|&n| visit(n)));
    }

    /// Calls `visit` with the numbers and the spheres of every row of the 27 cells around sphere `s`.
    #[inline]
    fn rows_around(&self, s: &Sphere, mut visit: impl FnMut(&[u32], &[Sphere])) {
        let c = self.cell(s);
        let mut row = |first: usize, last: usize| {
            let range = self.start[first] as usize..self.start[last + 1] as usize;
            visit(&self.order[range.clone()], &self.sorted[range]);
        };
        if self.period.is_some() {
            // With fewer than three cells along an edge, a cell would be visited twice.
            let turn = |a: usize, k: usize| (c[a] + self.dims[a] + k - 1) % self.dims[a];
            for k in 0..27 {
                let cell = self.index([turn(0, k / 9), turn(1, k / 3 % 3), turn(2, k % 3)]);
                row(cell, cell);
            }
            return;
        }
        let range = |a: usize| c[a].saturating_sub(1)..=(c[a] + 1).min(self.dims[a] - 1);
        let (k0, k1) = (*range(2).start(), *range(2).end());
        for i in range(0) {
            for j in range(1) {
                // Cells along the last axis are contiguous.
                row(self.index([i, j, k0]), self.index([i, j, k1]));
            }
        }
    }
}

/// Neighbours of [`CHUNK`] consecutive particles, in compressed rows.
#[derive(Debug, Default, Clone)]
pub(crate) struct ListChunk {
    pub(crate) start: Vec<u32>,
    pub(crate) neighbours: Vec<u32>,
}

/// Lists for each particle all others closer than `r_i + r_j + skin` (both directions stored), the touching
/// ones first. The processor then predicts the branch "do they touch" well, which halves the time of a force
/// evaluation.
pub(crate) fn verlet_list(cells: &mut CellList, spheres: &[Sphere], skin: f64, out: &mut Vec<ListChunk>) {
    let largest = spheres.iter().fold(0.0_f64, |m, s| m.max(s[3]));
    cells.build(spheres, 2.0 * largest + skin);
    out.resize(spheres.len().div_ceil(CHUNK), ListChunk::default());
    let cells = &*cells;
    out.par_iter_mut()
        .enumerate()
        .for_each(|(c, chunk)| match &cells.period {
            None => list_chunk((cells, spheres), c * CHUNK, skin, |d| d, chunk),
            Some(p) => list_chunk((cells, spheres), c * CHUNK, skin, |d| image(d, p), chunk),
        });
}

/// Lists the neighbours of up to [`CHUNK`] spheres from number `first` on; `image` turns a difference of
/// centres into that to the nearest periodic image.
fn list_chunk(
    (cells, spheres): (&CellList, &[Sphere]),
    first: usize,
    skin: f64,
    image: impl Fn([f64; 3]) -> [f64; 3],
    chunk: &mut ListChunk,
) {
    let squared = |s: &Sphere, t: &Sphere| {
        let d = image([t[0] - s[0], t[1] - s[1], t[2] - s[2]]);
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    };
    let ListChunk { start, neighbours } = chunk;
    start.clear();
    neighbours.clear();
    start.push(0);
    let (mut near, mut apart) = (Vec::new(), Vec::new());
    for (i, s) in spheres.iter().enumerate().skip(first).take(CHUNK) {
        let mut count = 0;
        cells.rows_around(s, |numbers, others| {
            near.resize(near.len().max(count + numbers.len()), 0);
            for (&j, t) in numbers.iter().zip(others) {
                let reach = s[3] + t[3] + skin;
                // Every number is stored, and kept if it counts: branches here would often go the wrong way.
                near[count] = j;
                count += usize::from(squared(s, t) < reach * reach);
            }
        });
        apart.clear();
        for &j in near[..count].iter().filter(|j| **j as usize != i) {
            let t = &spheres[j as usize];
            let touch = s[3] + t[3];
            if squared(s, t) < touch * touch {
                neighbours.push(j);
            } else {
                apart.push(j);
            }
        }
        neighbours.extend_from_slice(&apart);
        start.push(neighbours.len() as u32);
    }
}

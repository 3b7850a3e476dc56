//! Triangles near each cell of a uniform grid.

use super::{Surface, winding};
use arlequin_core::geometry::closest_on_triangle;
use nalgebra::Vector3;

/// Triangles near each cell of a uniform grid over the bounding box, with a layer of cells around it.
#[derive(Debug, Clone, Default)]
pub(super) struct Grid {
    pub(super) size: f64,
    dims: [usize; 3],
    pub(super) reach: f64,
    /// Corner of the bounding box with the smallest coordinates \[m\].
    low: Vector3<f64>,
    start: Vec<u32>,
    /// Distance from the middle of the cell \[m\] and number of each triangle, nearest first.
    triangles: Vec<(f64, u32)>,
    /// For cells without a near triangle: true if they are inside.
    pub(super) inside: Vec<bool>,
}

/// Triangles that a query at a point looks at.
pub(super) struct Near<'a> {
    /// Number of the cell of the point.
    pub(super) cell: usize,
    /// Middle of the cell \[m\].
    pub(super) middle: Vector3<f64>,
    /// Distance of the point from the middle \[m\].
    pub(super) off: f64,
    /// Distance from the middle of the cell \[m\] and number of each triangle, nearest first.
    pub(super) triangles: &'a [(f64, u32)],
}

impl Grid {
    /// Returns the triangles near a point.
    #[inline]
    pub(super) fn near(&self, x: &Vector3<f64>) -> Near<'_> {
        let place = self.place(x);
        let cell = self.index(place);
        let middle = Vector3::from(place.map(|i| i as f64 - 0.5)) * self.size + self.low;
        Near {
            cell,
            middle,
            off: (x - middle).norm(),
            triangles: &self.triangles[self.start[cell] as usize..self.start[cell + 1] as usize],
        }
    }

    /// Returns the cell of a point; points outside of the box fall in the layer around it.
    fn place(&self, x: &Vector3<f64>) -> [usize; 3] {
        [0, 1, 2].map(|a| {
            let c = ((x[a] - self.low[a]) / self.size).floor() + 1.0;
            (c.max(0.0) as usize).min(self.dims[a] - 1)
        })
    }

    fn index(&self, c: [usize; 3]) -> usize {
        (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]
    }

    /// Returns the numbers and middles of all cells of a range, ends included.
    fn cells_between(&self, low: [usize; 3], high: [usize; 3]) -> Vec<(usize, Vector3<f64>)> {
        let mut out = Vec::new();
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
                    let c = Vector3::new(i as f64, j as f64, k as f64).add_scalar(-0.5);
                    out.push((self.index([i, j, k]), self.low + c * self.size));
                }
            }
        }
        out
    }
}

impl Surface {
    /// Rebuilds the grid so that [`Self::nearest`] finds every point up to `reach` \[m\].
    pub(crate) fn prepare(&mut self, reach: f64) {
        let extent = self.bounds.1 - self.bounds.0;
        // The bound on the cell size limits the memory of the grid. The reach is never below it: a point
        // without a face within reach then lies on the same side as the middle of its cell.
        let size = reach.max(extent.max() / 128.0);
        let reach = size;
        // One layer of cells around the box, because centres of spheres may leave it by a little.
        let dims = [0, 1, 2].map(|a| (extent[a] / size).ceil() as usize + 2);
        let cells = dims[0] * dims[1] * dims[2];
        let mut per_cell: Vec<Vec<(f64, u32)>> = vec![Vec::new(); cells];
        let mut grid = Grid {
            size,
            dims,
            reach,
            low: self.bounds.0,
            ..Grid::default()
        };
        for (t, tri) in self.triangles.iter().enumerate() {
            let c = self.corners(tri);
            let low = grid.place(&(c[0].inf(&c[1]).inf(&c[2]).add_scalar(-reach)));
            let high = grid.place(&(c[0].sup(&c[1]).sup(&c[2]).add_scalar(reach)));
            for (i, middle) in grid.cells_between(low, high) {
                // The farthest point of a cell is half a diagonal (0.8660 sizes) from its middle.
                let distance = (closest_on_triangle(&middle, &c) - middle).norm();
                if distance <= reach + 0.8661 * size {
                    per_cell[i].push((distance, t as u32));
                }
            }
        }
        grid.start.reserve(cells + 1);
        grid.start.push(0);
        for n in &mut per_cell {
            n.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            grid.triangles.extend_from_slice(n);
            grid.start.push(grid.triangles.len() as u32);
        }
        grid.inside = vec![false; cells];
        for (i, middle) in grid.cells_between([0; 3], dims.map(|d| d - 1)) {
            if !per_cell[i].is_empty() {
                continue;
            }
            // No surface passes between two neighbouring cells without a near triangle.
            let place = [i / (dims[1] * dims[2]), i / dims[2] % dims[1], i % dims[2]];
            let steps = [dims[1] * dims[2], dims[2], 1];
            let before = (0..3).filter(|&a| place[a] > 0).map(|a| i - steps[a]);
            grid.inside[i] = match before.into_iter().find(|&b| per_cell[b].is_empty()) {
                Some(b) => grid.inside[b],
                None => self.winding(&middle) > 0.5,
            };
        }
        *self.grid = grid;
    }

    pub(super) fn winding(&self, x: &Vector3<f64>) -> f64 {
        winding(x, self.triangles.iter().map(|t| self.corners(t)))
    }
}

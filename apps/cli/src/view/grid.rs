//! Grid of a frame as it is drawn: faces between cells, and lines.

use super::frames::Frame;
use crate::error::{Result, value};
use arlequin::dem_beam::vtu::{Array, Section};
use std::collections::HashMap;
use std::path::Path;

/// Cell number of a face's outer side, where there is no cell.
pub(super) const OUTSIDE: u32 = u32::MAX;

/// A grid as it is drawn. Points and cells have the numbers of the file.
#[derive(Debug, Default)]
pub(super) struct Grid {
    /// Reference positions of the points, three coordinates each \[m\].
    pub(super) points: Vec<f64>,
    /// Four corners (the last two are equal for a triangle), then the cells on both sides.
    pub(super) faces: Vec<[u32; 6]>,
    /// Both ends of each line, then the number of its cell.
    pub(super) lines: Vec<[u32; 3]>,
    /// Corners of all solid and plane cells in a row. `ends` holds where each cell's corners end; other
    /// kinds of cells have no corners here.
    pub(super) corners: Vec<u32>,
    pub(super) ends: Vec<u32>,
    /// Number of cells of kinds that are not drawn.
    pub(super) unknown: usize,
}

/// Returns the faces of a VTK cell type that is drawn, as local corner numbers in outward order.
fn faces_of(kind: u8) -> Option<&'static [[usize; 4]]> {
    match kind {
        // VTK numbers: 5 triangle, 9 quadrilateral, 10 tetrahedron, 12 hexahedron, 13 wedge, 14 pyramid.
        5 => Some(&[[0, 1, 2, 2]]),
        9 => Some(&[[0, 1, 2, 3]]),
        10 => Some(&[[0, 2, 1, 1], [0, 1, 3, 3], [1, 2, 3, 3], [0, 3, 2, 2]]),
        12 => Some(&[
            [0, 3, 2, 1],
            [4, 5, 6, 7],
            [0, 1, 5, 4],
            [1, 2, 6, 5],
            [2, 3, 7, 6],
            [3, 0, 4, 7],
        ]),
        13 => Some(&[
            [0, 1, 2, 2],
            [3, 5, 4, 4],
            [0, 3, 4, 1],
            [1, 4, 5, 2],
            [2, 5, 3, 0],
        ]),
        14 => Some(&[
            [0, 3, 2, 1],
            [0, 1, 4, 4],
            [1, 2, 4, 4],
            [2, 3, 4, 4],
            [3, 0, 4, 4],
        ]),
        _ => None,
    }
}

impl Grid {
    /// Reads the grid of a frame.
    pub(super) fn read_from(frame: &mut Frame, path: &Path) -> Result<Self> {
        let need = |array: Option<Array>, name: &str| {
            let rule = format!("has no array '{name}'; make the run again");
            array.ok_or_else(|| value("DIR", path.display(), &rule))
        };
        let points = need(frame.positions(), "")?;
        let points = frame.numbers(&points)?;
        let mut read = |name: &str| {
            let array = need(frame.find(Section::Cells, name), name)?;
            frame.numbers(&array)
        };
        let corners: Vec<u32> = read("connectivity")?.into_iter().map(|x| x as u32).collect();
        let ends: Vec<u32> = read("offsets")?.into_iter().map(|x| x as u32).collect();
        let kinds: Vec<u8> = read("types")?.into_iter().map(|x| x as u8).collect();
        let count = points.len() / 3;
        let rising =
            ends.windows(2).all(|w| w[0] <= w[1]) && ends.last().is_none_or(|e| *e as usize <= corners.len());
        if !rising || kinds.len() != ends.len() || corners.iter().any(|c| *c as usize >= count) {
            return Err(value(
                "DIR",
                path.display(),
                "has cells with corners that are not there; make the run again",
            ));
        }
        Ok(Self::new(points, &corners, &ends, &kinds))
    }

    fn new(points: Vec<f64>, corners: &[u32], ends: &[u32], kinds: &[u8]) -> Self {
        let mut grid = Self {
            points,
            ..Self::default()
        };
        // A face that two cells have lies between them: the second cell finds the first one's face here.
        let mut between: HashMap<[u32; 4], usize> = HashMap::new();
        let mut start = 0;
        for (cell, (end, kind)) in ends.iter().zip(kinds).enumerate() {
            let cell_corners = &corners[start..*end as usize];
            start = *end as usize;
            match (faces_of(*kind), kind) {
                (Some(faces), _)
                    if cell_corners.len() > faces.iter().flatten().copied().max().unwrap_or(0) =>
                {
                    for face in faces {
                        // Sorted corners make the key independent of the direction in which a cell lists
                        // the face.
                        let nodes = face.map(|k| cell_corners[k]);
                        let mut key = nodes;
                        // Cells may repeat different corners of the same triangle.
                        if nodes[3] == nodes[2] {
                            key[3] = OUTSIDE;
                        }
                        key.sort_unstable();
                        if let Some(k) = between.remove(&key) {
                            grid.faces[k][5] = cell as u32;
                        } else {
                            between.insert(key, grid.faces.len());
                            grid.faces
                                .push([nodes[0], nodes[1], nodes[2], nodes[3], cell as u32, OUTSIDE]);
                        }
                    }
                    grid.corners.extend(cell_corners);
                }
                (_, 3) if cell_corners.len() == 2 => {
                    grid.lines.push([cell_corners[0], cell_corners[1], cell as u32]);
                }
                (_, 1) => {}
                _ => grid.unknown += 1,
            }
            grid.ends.push(grid.corners.len() as u32);
        }
        grid
    }

    /// Returns the corners of a cell.
    pub(super) fn cell(&self, k: usize) -> &[u32] {
        let start = if k == 0 { 0 } else { self.ends[k - 1] as usize };
        &self.corners[start..self.ends[k] as usize]
    }

    /// Returns the centres of all cells \[m\]; zero for cells without faces.
    pub(super) fn centres(&self) -> Vec<f64> {
        let centre = |k: usize| {
            let corners = self.cell(k);
            let sum = |c: usize| {
                corners
                    .iter()
                    .map(|i| self.points[3 * *i as usize + c])
                    .sum::<f64>()
            };
            std::array::from_fn::<_, 3, _>(|c| sum(c) / corners.len().max(1) as f64)
        };
        (0..self.ends.len()).flat_map(centre).collect()
    }

    /// Averages cell values at the points: the mean over all cells with that point as a corner.
    pub(super) fn at_points(&self, values: &[f64], components: usize) -> Vec<f64> {
        let count = self.points.len() / 3;
        let (mut sums, mut shares) = (vec![0.0_f64; count * components], vec![0.0_f64; count]);
        for k in 0..self.ends.len() {
            for i in self.cell(k) {
                shares[*i as usize] += 1.0;
                for c in 0..components {
                    sums[*i as usize * components + c] += values[k * components + c];
                }
            }
        }
        for (sum, share) in sums.chunks_exact_mut(components).zip(&shares) {
            sum.iter_mut().for_each(|s| *s /= share.max(1.0));
        }
        sums
    }

    /// Removes the faces between cells, so that only the surface remains.
    pub(super) fn hollow(&mut self) {
        self.faces.retain(|f| f[5] == OUTSIDE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_cubes_share_one_face_and_close_outward() {
        let points = (0..12)
            .flat_map(|k| [f64::from(k % 3), f64::from(k / 3 % 2), f64::from(k / 6)])
            .collect();
        let cubes = [0, 1, 4, 3, 6, 7, 10, 9, 1, 2, 5, 4, 7, 8, 11, 10];
        let grid = Grid::new(points, &cubes, &[8, 16], &[12, 12]);
        assert_eq!(grid.faces.len(), 11);
        assert_eq!(grid.faces.iter().filter(|f| f[5] == 1).count(), 1);
        assert_eq!(grid.centres(), [0.5, 0.5, 0.5, 1.5, 0.5, 0.5]);
        // Volume by the divergence theorem: a third of the sum of x · n over the outer faces.
        let point = |i: u32| std::array::from_fn::<_, 3, _>(|c| grid.points[3 * i as usize + c]);
        let det = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        let outer = grid.faces.iter().filter(|f| f[5] == OUTSIDE);
        let volume: f64 = outer
            .map(|f| {
                (det(point(f[0]), point(f[1]), point(f[2])) + det(point(f[0]), point(f[2]), point(f[3])))
                    / 6.0
            })
            .sum();
        assert!((volume - 2.0).abs() < 1e-12, "{volume}");
        assert_eq!(grid.at_points(&[1.0, 3.0], 1)[..3], [1.0, 2.0, 3.0]);
    }

    #[test]
    fn two_tetrahedra_share_one_face() {
        let points = vec![0.0; 15];
        // The second cell lists the common face 1, 2, 3 in every order.
        for second in [[1, 2, 3, 4], [4, 3, 2, 1], [2, 4, 3, 1], [3, 1, 4, 2]] {
            let corners = [[0, 1, 2, 3], second].concat();
            let grid = Grid::new(points.clone(), &corners, &[4, 8], &[10, 10]);
            let inner = grid.faces.iter().filter(|f| f[5] != OUTSIDE).count();
            assert_eq!((grid.faces.len(), inner), (7, 1), "{second:?}");
        }
    }

    #[test]
    fn a_tetrahedron_closes_outward() {
        let points = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let grid = Grid::new(points, &[0, 1, 2, 3, 0, 1], &[4, 6], &[10, 3]);
        assert_eq!((grid.faces.len(), grid.lines.as_slice()), (4, &[[0, 1, 1]][..]));
    }
}

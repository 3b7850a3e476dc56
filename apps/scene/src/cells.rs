//! Displacement gradients and materials at the centres of a model's cells.

use crate::error::{Result, core};
use crate::setup::ModelInfo;
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin::core::{Elastic, ShapeRow};

/// Shape-function gradients at the centre of one cell.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    /// Material at the centre.
    pub(crate) material: Elastic<f64>,
    /// Nodes and gradients of their shape functions \[1/m\].
    row: Vec<(usize, Vector3<f64>)>,
}

impl Cell {
    /// Numbers of the nodes that the gradient reads.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = u32> {
        self.row.iter().map(|(node, _)| *node as u32)
    }

    /// Replaces each node number `n` by `number(n)`.
    pub(crate) fn renumber(&mut self, number: &impl Fn(u32) -> usize) {
        self.row
            .iter_mut()
            .for_each(|(node, _)| *node = number(*node as u32));
    }

    /// Gradient `∂u_c/∂x_k` (row `c`, column `k`) of a nodal field with `count` components.
    pub(crate) fn gradient(&self, values: &[f64], count: usize) -> Matrix3<f64> {
        let mut h = Matrix3::zeros();
        for (node, g) in &self.row {
            for c in 0..count {
                for k in 0..3 {
                    h[(c, k)] += values[node * count + c] * g[k];
                }
            }
        }
        h
    }
}

/// Returns all cells of a model.
///
/// # Errors
/// A model without materials or without shape-function gradients; the error names `key`.
pub(crate) fn cells(key: &str, d: &ModelInfo) -> Result<Vec<Cell>> {
    selected(key, d, 0..d.grid.cells())
}

/// Returns the cells with the numbers `which`; errors as in [`cells`].
pub(crate) fn selected(key: &str, d: &ModelInfo, which: impl Iterator<Item = usize>) -> Result<Vec<Cell>> {
    let Some(materials) = &d.materials else {
        return Err(crate::error::key(
            key,
            "needs a material, and a link does not tell its own",
        ));
    };
    let mut row = ShapeRow::default();
    let cell_at = |k: usize| {
        let cell = &d.grid.connectivity[k * d.grid.corners..][..d.grid.corners];
        let sum = cell
            .iter()
            .fold(Vector3::zeros(), |s, &k| s + d.grid.points[k as usize].coords);
        let centre = Point3::from(sum / cell.len() as f64);
        d.field.shape_at(&centre, true, &mut row).map_err(core(key))?;
        let row = row.nodes.iter().copied().zip(row.gradients.iter().copied());
        Ok(Cell {
            material: *materials.at(k),
            row: row.collect(),
        })
    };
    which.map(cell_at).collect()
}

//! Helpers for tests of partitioned continua.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(dead_code, reason = "not every target uses all of it")]

use crate::support::{Results, global};
use arlequin_core::geometry::Cell;
use arlequin_core::nalgebra::Point3;
use arlequin_core::{Model, Recovery, Weight};

/// Weight that falls from 1 to 0.2 along the body; its mean over a cell is that of the corners.
#[derive(Debug)]
pub(crate) struct Falling;

impl Weight<f64> for Falling {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * (x.x / 6e-3).clamp(0.0, 1.0)
    }
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let corners = cell.corners();
        corners.iter().map(|x| self.value(x)).sum::<f64>() / corners.len() as f64
    }
}

/// Returns a number for every unknown, by its number in the whole body.
pub(crate) fn unknowns(model: &dyn Model<f64>, size: f64) -> Vec<f64> {
    let layout = model.layout();
    let c = layout.components;
    let number = |k: usize| size * (1.7 * (global(model, k / c) * c + k % c) as f64).sin();
    (0..layout.dofs()).map(number).collect()
}

/// Returns the bits of numbers with the number of their node in the whole body.
pub(crate) fn bits(model: &dyn Model<f64>, vectors: &[&[f64]]) -> Vec<(usize, Vec<u64>)> {
    let n = model.layout().nodes;
    let node_bits = |i: usize| {
        let numbers = vectors.iter().flat_map(|x| {
            let per_node = x.len() / n;
            &x[per_node * i..per_node * (i + 1)]
        });
        (global(model, i), numbers.map(|x| x.to_bits()).collect())
    };
    (0..n).map(node_bits).collect()
}

/// Returns masses, forces and stresses by node, and energies and critical steps; with the model's weights and
/// with others.
pub(crate) fn evaluated<M: Model<f64> + Recovery<f64>>(mut model: M) -> Results {
    let (n, count) = (model.layout().dofs(), model.layout().nodes);
    let (mut vectors, mut sums) = (Vec::<Vec<f64>>::new(), Vec::new());
    let q = unknowns(&model, 1e-6);
    for weight in [None, Some(&Falling)] {
        if let Some(w) = weight {
            model.set_internal_weight(w).unwrap();
        }
        let [mut inertia, mut forces, mut forces_of_step] = [(); 3].map(|()| vec![0.0; n]);
        model.lumped_inertia(&Falling, &mut inertia).unwrap();
        let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
        sums.push(model.critical_step(&inverse).unwrap());
        sums.push(model.advance_with_energy(&q, &mut forces_of_step).unwrap());
        model.add_internal_forces(&inverse, &mut forces).unwrap();
        sums.push(model.internal_energy(&q));
        vectors.extend([inertia, forces, forces_of_step]);
    }
    let mut recovered = Vec::new();
    let all_nodes: Vec<usize> = (0..count).collect();
    model.recover(&q, &all_nodes, &mut recovered).unwrap();
    vectors.push(recovered.iter().flat_map(|r| r.stress.0).collect());
    vectors.push(recovered.iter().flat_map(|r| r.strain.unwrap().0).collect());
    let vectors: Vec<&[f64]> = vectors.iter().map(|x| &x[..]).collect();
    (bits(&model, &vectors), sums)
}

//! Helpers for tests of partitioned continua.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(dead_code, reason = "not every target uses all of it")]

use crate::support::{Told, global};
use arlequin_core::geometry::Cell;
use arlequin_core::nalgebra::Point3;
use arlequin_core::{Model, Recovery, Weight};

/// Weight that falls from 1 to 0.2 along the body; its mean over a cell is that of the corners.
#[derive(Debug)]
pub(crate) struct Falling;

impl Weight<f64> for Falling {
    fn at(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * (x.x / 6e-3).clamp(0.0, 1.0)
    }
    fn mean(&self, cell: &Cell<f64>) -> f64 {
        let corners = cell.corners();
        corners.iter().map(|x| self.at(x)).sum::<f64>() / corners.len() as f64
    }
}

/// Returns a number for every unknown, by its number in the whole body.
pub(crate) fn unknowns(model: &dyn Model<f64>, size: f64) -> Vec<f64> {
    let layout = model.layout();
    let c = layout.components;
    let of = |k: usize| size * (1.7 * (global(model, k / c) * c + k % c) as f64).sin();
    (0..layout.dofs()).map(of).collect()
}

/// Returns the bits of numbers with the number of their node in the whole body.
pub(crate) fn bits(model: &dyn Model<f64>, all: &[&[f64]]) -> Vec<(usize, Vec<u64>)> {
    let n = model.layout().nodes;
    let of = |i: usize| {
        let numbers = all.iter().flat_map(|x| {
            let each = x.len() / n;
            &x[each * i..each * (i + 1)]
        });
        (global(model, i), numbers.map(|x| x.to_bits()).collect())
    };
    (0..n).map(of).collect()
}

/// Returns masses, forces and stresses by node, and energies and critical steps; with the model's weights and
/// with others.
pub(crate) fn evaluated<M: Model<f64> + Recovery<f64>>(mut model: M) -> Told {
    let (n, count) = (model.layout().dofs(), model.layout().nodes);
    let (mut told, mut sums) = (Vec::<Vec<f64>>::new(), Vec::new());
    let q = unknowns(&model, 1e-6);
    for weight in [None, Some(&Falling)] {
        if let Some(w) = weight {
            model.set_internal_weight(w).unwrap();
        }
        let [mut inertia, mut tried, mut reached] = [(); 3].map(|()| vec![0.0; n]);
        model.lumped_inertia(&Falling, &mut inertia).unwrap();
        let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
        sums.push(model.critical_step(&inverse).unwrap());
        sums.push(model.advance_with_energy(&q, &mut reached).unwrap());
        model.add_internal_forces(&inverse, &mut tried).unwrap();
        sums.push(model.internal_energy(&q));
        told.extend([inertia, tried, reached]);
    }
    let mut found = Vec::new();
    let all: Vec<usize> = (0..count).collect();
    model.recover(&q, &all, &mut found).unwrap();
    told.push(found.iter().flat_map(|r| r.stress.0).collect());
    told.push(found.iter().flat_map(|r| r.strain.unwrap().0).collect());
    let told: Vec<&[f64]> = told.iter().map(|x| &x[..]).collect();
    (bits(&model, &told), sums)
}

//! Watches the carrier until the criterion is met.

use crate::cells::{self, Cell};
use crate::error::{Result, key, value};
use crate::run::checkpoint::Stage;
use crate::setup::{self, ModelInfo};
use crate::spec::{ModelKind, Near, Wake};
use arlequin::core::nalgebra::{Matrix3, Point3};
use arlequin::core::{Coupled, Elastic};

/// The criterion, and the cells in which it is evaluated.
#[derive(Debug)]
pub(super) struct Watch {
    carrier: usize,
    cells: Vec<Cell>,
    stress: bool,
    limit: f64,
    every: usize,
    /// Largest value so far, and its place \[m\].
    pub highest: (f64, Point3<f64>),
}

impl Watch {
    /// Prepares the watch over model `carrier` of the sleeping scene.
    pub(super) fn new(wake: &Wake, carrier: usize, kind: ModelKind, info: &ModelInfo) -> Result<Self> {
        if setup::kind(kind).elements().is_none() {
            let rule = "has no elements in which a strain could be looked at; use kind = \"fem\" or \"cnem\"";
            return Err(value("wake.by", &wake.by, rule));
        }
        let near = |c: &Cell| match &wake.near {
            None => true,
            Some(Near::Box { low, high }) => (0..3).all(|k| c.centre[k] >= low[k] && c.centre[k] <= high[k]),
        };
        let cells: Vec<Cell> = cells::cells("wake.by", info)?.into_iter().filter(near).collect();
        let Some(first) = cells.first() else {
            let rule = format!(
                "holds no element centre of '{}'; enlarge it or check the units (m)",
                wake.by
            );
            return Err(key("wake.near", rule));
        };
        let c = wake.criterion;
        Ok(Self {
            carrier,
            stress: c.stress.is_some(),
            limit: c.stress.or(c.strain).unwrap_or(f64::INFINITY),
            every: wake.every,
            highest: (f64::NEG_INFINITY, first.centre),
            cells,
        })
    }

    /// Returns the quantity of the criterion, with its unit.
    pub(super) fn criterion(&self) -> &'static str {
        if self.stress { "stress [Pa]" } else { "strain [-]" }
    }

    /// Returns the limit.
    pub(super) fn limit(&self) -> f64 {
        self.limit
    }

    /// Returns the progress for a checkpoint.
    pub(super) fn stage(&self) -> Stage {
        Stage::Asleep {
            highest: self.highest.0,
            place: self.highest.1.coords.into(),
        }
    }

    /// Evaluates the criterion every `every` steps. Returns whether it is met.
    pub(super) fn look(&mut self, run: &Coupled<f64>) -> bool {
        if !run.steps().is_multiple_of(self.every) {
            return false;
        }
        let s = &run.subdomains()[self.carrier];
        let count = s.model().layout().components;
        for cell in &self.cells {
            let value = self.value(&cell.gradient(&s.state().q, count), count, &cell.material);
            if value > self.highest.0 {
                self.highest = (value, cell.centre);
            }
        }
        self.highest.0 >= self.limit
    }

    /// Returns the largest principal strain, or the largest principal stress `λ tr ε + 2 μ ε`. In a bar, that
    /// is the axial one.
    fn value(&self, h: &Matrix3<f64>, count: usize, material: &Elastic<f64>) -> f64 {
        if count == 1 {
            return h[(0, 0)] * if self.stress { material.young() } else { 1.0 };
        }
        let strain = (h + h.transpose()) * 0.5;
        let top = strain.symmetric_eigenvalues().max();
        if self.stress {
            let [lambda, mu] = material.lame();
            lambda * strain.trace() + 2.0 * mu * top
        } else {
            top
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(stress: bool) -> Watch {
        Watch {
            carrier: 0,
            cells: Vec::new(),
            stress,
            limit: 1.0,
            every: 1,
            highest: (f64::NEG_INFINITY, Point3::origin()),
        }
    }

    /// The largest principal stress: `E ε` if the sides are free to contract, `(λ + 2μ) ε` if not, `3 K ε`
    /// for a dilatation, `2 μ ε` for a shear.
    #[test]
    fn the_largest_principal_stress_is_that_of_hooke() {
        let e = 1e-3;
        // λ = μ = 2/5.
        let material = Elastic::new(1.0, 0.25, 1.0).expect("material");
        let diagonal = |x: f64, y: f64, z: f64| Matrix3::from_diagonal(&[x, y, z].into());
        let shear = Matrix3::new(0.0, 2.0 * e, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (gradient, stress, strain) in [
            (diagonal(e, -0.25 * e, -0.25 * e), e, e),
            (diagonal(e, 0.0, 0.0), 1.2 * e, e),
            (diagonal(e, e, e), 2.0 * e, e),
            (shear, 0.8 * e, e),
        ] {
            for (wanted, expected) in [(true, stress), (false, strain)] {
                let found = watch(wanted).value(&gradient, 3, &material);
                assert!(
                    (found - expected).abs() < 1e-12 * e,
                    "{gradient}: {found}, not {expected}"
                );
            }
        }
        // A bar has no lateral contraction.
        assert!((watch(true).value(&diagonal(e, 0.0, 0.0), 1, &material) - e).abs() < 1e-18);
    }
}

//! The patch test that every model must pass before use: internal forces of linear displacement fields.
//!
//! A field `u = t + g (x − x̄)` has the gradient `g` in every cell, hence one stress `σ`. The facets between
//! cells cancel. The force on node `j` is therefore the traction `σ Σ_q N_j(x_q) A_q` of the boundary facets,
//! and zero at inner nodes. Any difference is the error of the integration. It is compared with
//! `(|λ| + 2μ) |g| Σ_I V_I |b_Ij|`, the forces of the surrounding cells on the node before they cancel.
//! Energies are no substitute: an energy is quadratic in the error and a sum over the whole body.

use super::CnemModel;
use crate::error::{Error, Result};
use nalgebra::{Matrix3, Point3, Vector3};

/// Largest unbalanced force at a node, relative to the cell forces around the node before they cancel \[–\].
/// It refuses 20 of 360 bodies with coordinates of 4 to 15 digits; they leave up to 9e-5 (decision 0018).
pub(super) const FORCE_TOLERANCE: f64 = 1e-8;

/// Names and displacement gradients of the test fields: a rotation, and a strain whose components are all
/// non-zero.
fn fields() -> [(&'static str, Matrix3<f64>); 2] {
    let turn = Vector3::new(0.48, -0.6, 0.64).cross_matrix();
    let strain = Matrix3::new(0.5, 0.2, -0.3, 0.2, -0.4, 0.25, -0.3, 0.25, 0.3);
    [("a rigid motion", turn), ("a constant strain", strain)]
}

impl CnemModel {
    /// Returns an error if a linear field leaves internal forces that the boundary tractions do not balance.
    pub(super) fn check_linear_fields(&mut self) -> Result<()> {
        for (field, gradient) in fields() {
            let (defect, node) = self.largest_force_defect(&gradient);
            // Not `defect > …`: a NaN must fail the test, too.
            let right = defect <= FORCE_TOLERANCE;
            if !right {
                return Err(Error::WrongForces {
                    model: self.name.clone(),
                    field,
                    node,
                    point: self.domain().nodes()[node].into(),
                    defect,
                    tolerance: FORCE_TOLERANCE,
                });
            }
        }
        Ok(())
    }

    /// Returns the largest unbalanced force of the linear field with this gradient, relative to the cell
    /// forces around the node, and that node.
    fn largest_force_defect(&mut self, gradient: &Matrix3<f64>) -> (f64, usize) {
        let [lambda, mu] = self.material.lame();
        // The stress of the gradient by Hooke's law, not by the model's own code, which is under test.
        let stress =
            Matrix3::identity() * (lambda * gradient.trace()) + (gradient + gradient.transpose()) * mu;
        let mut forces = self.linear_field_forces(gradient);
        for facet in &self.smoothing.boundary {
            let traction = stress * facet.area;
            for (node, value) in facet.nodes.iter().zip(&facet.values) {
                let force = &mut forces.as_chunks_mut::<3>().0[*node];
                // Internal forces are subtracted from zero, so boundary tractions must cancel them.
                (0..3).for_each(|k| force[k] += traction[k] * value);
            }
        }
        let mut scales = vec![0.0; self.cells.len()];
        for (cell, volume) in self.smoothing.volumes.iter().enumerate() {
            let (nodes, b) = self.smoothing.row(cell);
            for (node, b) in nodes.iter().zip(b) {
                // Cell forces before they cancel: a force that is zero by equilibrium is no measure.
                scales[*node as usize] += volume * b.norm();
            }
        }
        let size = (lambda.abs() + 2.0 * mu) * gradient.norm();
        let forces = forces.as_chunks::<3>().0.iter();
        let parts = forces
            .zip(scales)
            .map(|(f, s)| Vector3::from(*f).norm() / (size * s));
        // A NaN counts as the largest defect, so that no comparison hides it.
        let not_less = |x: f64, y: f64| x.is_nan() || x >= y;
        parts
            .zip(0..)
            .fold((0.0, 0), |x, y| if not_less(x.0, y.0) { x } else { y })
    }

    /// Returns the internal forces \[N\] of `u = t + g (x − x̄)`.
    fn linear_field_forces(&mut self, gradient: &Matrix3<f64>) -> Vec<f64> {
        let field = self.field.clone();
        let nodes = field.domain().nodes();
        let [low, high] = crate::bins::around(nodes, 0.0);
        let middle: Point3<f64> = nalgebra::center(&low, &high);
        // The translation is as large as the displacements of the body, so that every node moves: gradients
        // whose sum is not zero would give it a force.
        let shift = Vector3::repeat((high - low).norm() * gradient.norm());
        let displacement = |x: &Point3<f64>| <[f64; 3]>::from(shift + gradient * (x - middle));
        let u: Vec<f64> = nodes.iter().flat_map(displacement).collect();
        let mut forces = vec![0.0; u.len()];
        self.forces.subtract_product(&u, &mut forces);
        forces
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraint::Surface;
    use crate::domain::Domain;
    use crate::scni::{MatrixFree, Smoothing};
    use crate::{Elastic, Options};

    fn cube() -> CnemModel {
        let grid = crate::natural::tests::grid(4, 0.2, 1);
        let domain = Domain::new(&grid, &Surface::convex_hull()).expect("grid");
        let material = Elastic::new(1.0, 0.3, 1.0).expect("material");
        CnemModel::new("cube", domain, material, Options::default()).expect("model")
    }

    /// Gradients are NaN, 1e-6 too large in one whole cell, or 1e-6 too large at one node of a cell, whose
    /// gradients then do not sum to zero. The energies of linear fields change by less than 1e-7.
    #[test]
    fn models_with_forces_under_linear_fields_are_refused() {
        let broken = |change: &dyn Fn(&mut Smoothing)| {
            let mut model = cube();
            change(&mut model.smoothing);
            let ones = vec![1.0; model.cells.len()];
            model.forces = MatrixFree::new(&model.smoothing, &model.sub, &model.material, ones);
            model.check_linear_fields().err()
        };
        let error = broken(&|s| s.gradients[7].y = f64::NAN);
        assert!(
            matches!(error, Some(Error::WrongForces { defect, .. }) if defect.is_nan()),
            "{error:?}"
        );
        let error = broken(&|s| {
            let cell = s.starts[21]..s.starts[22];
            s.gradients[cell].iter_mut().for_each(|g| *g *= 1.0 + 1e-6);
        });
        assert!(
            matches!(error, Some(Error::WrongForces { field: "a constant strain", defect, .. }) if defect < 1e-6),
            "{error:?}"
        );
        let error = broken(&|s| {
            let largest = |a: &usize, b: &usize| s.gradients[*a].norm().total_cmp(&s.gradients[*b].norm());
            let entry = (s.starts[21]..s.starts[22]).max_by(largest).expect("row");
            s.gradients[entry] *= 1.0 + 1e-6;
        });
        assert!(
            matches!(
                error,
                Some(Error::WrongForces {
                    field: "a rigid motion",
                    ..
                })
            ),
            "{error:?}"
        );
        assert_eq!(broken(&|_| {}), None);
    }
}

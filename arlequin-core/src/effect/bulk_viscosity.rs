//! Linear bulk viscosity.

use super::{Effect, EffectSpec, ForceLaw, Host, Instant, StepDemand};
use crate::error::not_negative;
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::{Cell, Sample};
use crate::model::Arms;
use crate::spectrum;
use crate::{Error, Real, Result};
use nalgebra::Vector3;
use std::sync::Arc;

/// A cell under bulk viscosity: its nodes with `∇N_i` at its centre, and the factor `b ρ c L V w`.
#[derive(Debug, Clone)]
struct ViscousCell<T: Real> {
    gradients: Vec<(usize, Vector3<T>)>,
    factor: T,
}

impl<T: Real> ViscousCell<T> {
    fn add(&self, v: &[T], f: &mut [T]) {
        let rate = self.gradients.iter().fold(T::zero(), |s, (k, g)| {
            s + (0..3).fold(T::zero(), |s, c| s + g[c] * v[3 * k + c])
        });
        let pressure = self.factor * rate;
        for (k, g) in &self.gradients {
            (0..3).for_each(|c| f[3 * k + c] -= pressure * g[c]);
        }
    }
}

/// Linear bulk viscosity: a pressure `−b ρ c L div v` in every cell, `L` the cube root of its volume, which
/// spreads a shock over some cells. `b = 0.06` is usual; it damps the fastest dilatational mode by about
/// `b` of critical.
pub struct BulkViscosity<T: Real> {
    field: Arc<dyn Interpolation<T>>,
    coefficient: T,
    impedance: T,
    /// Impedance of every cell, if they differ; otherwise empty.
    impedances: Vec<T>,
}

impl<T: Real> std::fmt::Debug for BulkViscosity<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BulkViscosity")
            .field("coefficient", &self.coefficient)
            .field("impedance", &self.impedance)
            .finish_non_exhaustive()
    }
}

impl<T: Real> BulkViscosity<T> {
    /// Viscosity with the coefficient `b` and the impedance `ρ c` \[kg/(m² s)\] of dilatational waves, on
    /// the cells of the model's own field.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] unless both are finite and not negative.
    pub fn new(field: Arc<dyn Interpolation<T>>, coefficient: T, impedance: T) -> Result<Self> {
        Ok(Self {
            field,
            coefficient: not_negative("bulk viscosity coefficient", coefficient)?,
            impedance: not_negative("impedance", impedance)?,
            impedances: Vec::new(),
        })
    }

    /// Sets the impedance of every cell, for a body of several materials.
    #[must_use]
    pub fn with_impedances(mut self, of_cells: Vec<T>) -> Self {
        self.impedances = of_cells;
        self
    }

    fn cell(&self, number: usize, cell: &Cell<T>, host: &Host<'_, T>) -> Result<ViscousCell<T>> {
        let mut samples: Vec<Sample<T>> = Vec::new();
        // One point per tetrahedron is exact for the volume and the centroid.
        cell.quadrature(1, &mut samples);
        let volume: T = samples.iter().map(|s| s.measure).sum();
        let sum = samples
            .iter()
            .fold(Vector3::zeros(), |s, p| s + p.point.coords * p.measure);
        let centre = nalgebra::Point3::from(sum / volume);
        let mut row = ShapeRow::default();
        self.field.shape_in(number, &centre, true, &mut row)?;
        let length = volume.powf(T::of(1.0 / 3.0));
        // The mean over the cell, as the stiffness has it.
        let weight = host.weights.internal.mean(cell);
        let impedance = self.impedances.get(number).unwrap_or(&self.impedance);
        Ok(ViscousCell {
            gradients: row
                .nodes
                .iter()
                .copied()
                .zip(row.gradients.iter().copied())
                .collect(),
            factor: self.coefficient * *impedance * length * volume * weight,
        })
    }
}

impl<T: Real> EffectSpec<T> for BulkViscosity<T> {
    fn attach(self: Box<Self>, host: &Host<'_, T>) -> Result<Box<dyn Effect<T>>> {
        let cells = self.field.cells();
        if cells.is_empty() || host.model.layout().components != 3 {
            return Err(Error::Unsupported {
                model: host.model.name().into(),
                what: "carry bulk viscosity: it has no volume cells; use stiffness damping".into(),
            });
        }
        if !self.impedances.is_empty() && self.impedances.len() != cells.len() {
            return Err(Error::SizeMismatch {
                what: format!("impedances of the cells of '{}'", host.model.name()),
                expected: cells.len(),
                found: self.impedances.len(),
            });
        }
        for z in &self.impedances {
            not_negative("impedance", *z)?;
        }
        let cells: Vec<ViscousCell<T>> = cells
            .iter()
            .enumerate()
            .map(|(k, c)| self.cell(k, c, host))
            .collect::<Result<_>>()?;
        let dofs = host.inertia.len();
        // 1 % more, for the error of the iteration.
        let top_rate = T::of(1.01)
            * spectrum::largest_eigenvalue(host.inverse_inertia, &mut |v, f| {
                cells.iter().for_each(|c| c.add(v, f));
                Ok(())
            })?;
        let law = move |instant: &Instant<'_, T>, f: &mut [T], own_forces: &mut [T]| {
            own_forces.fill(T::zero());
            cells.iter().for_each(|c| c.add(instant.v_half, own_forces));
            f.iter_mut().zip(own_forces).for_each(|(f, g)| *f += *g);
        };
        Ok(Box::new(ForceLaw {
            demand: StepDemand::damping(top_rate),
            arms: Some(Arms::Reference),
            shared: true,
            ..ForceLaw::dissipating("bulk-viscosity", dofs, law)
        }))
    }
}

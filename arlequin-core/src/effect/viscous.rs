//! Damping of strain rates: stiffness-proportional damping and linear bulk viscosity.

use super::{Demand, Effect, Instant, Site, dot};
use crate::error::invalid;
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::{Cell, Sample};
use crate::momentum::Arms;
use crate::spectrum;
use crate::{Error, Real, Result};
use nalgebra::Vector3;
use std::sync::Arc;

/// The stiffness part of Rayleigh damping, `F = −c K v` with a time `c` \[s\]; the mass part is
/// [`super::MassDamping`].
///
/// Computed as `c (f_{n+1} − f_n)/Δt` from the internal forces themselves: costs no further evaluation, holds for any
/// model, and follows bonds that break. Damps a mode of frequency `ω` by the ratio `c ω/2`.
#[derive(Debug, Clone)]
pub struct StiffnessDamping<T: Real> {
    time: T,
    force: Vec<T>,
}

impl<T: Real> StiffnessDamping<T> {
    /// Damping with the time `c` \[s\].
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] if it is negative or not finite.
    pub fn new(time: T) -> Result<Self> {
        if time.is_finite() && time >= T::zero() {
            Ok(Self {
                time,
                force: Vec::new(),
            })
        } else {
            let rule = "must be finite and not negative [s]";
            Err(invalid("stiffness damping time", time, rule))
        }
    }
}

impl<T: Real> Effect<T> for StiffnessDamping<T> {
    fn name(&self) -> &str {
        "stiffness-damping"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        self.force = vec![T::zero(); site.inertia.len()];
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        if at.dt <= T::zero() {
            return Ok(());
        }
        let factor = self.time / at.dt;
        let change = at.internal.iter().zip(at.internal_before);
        for ((f, g), (now, before)) in f.iter_mut().zip(&mut self.force).zip(change) {
            *g = factor * (*now - *before);
            *f += *g;
        }
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }

    fn demand(&self) -> Demand<T> {
        Demand {
            viscosity: self.time,
            ..Demand::none()
        }
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Reference)
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

/// A cell under bulk viscosity: its nodes and `∇N_i` at its centre, and `b ρ c L V w`.
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

/// Linear bulk viscosity: a pressure `−b ρ c L div v` in every cell, `L` the cube root of its volume, which spreads a
/// shock over some cells. `b = 0.06` is usual; it damps the fastest dilatational mode by about `b` of critical.
pub struct BulkViscosity<T: Real> {
    field: Arc<dyn Interpolation<T>>,
    coefficient: T,
    impedance: T,
    cells: Vec<ViscousCell<T>>,
    force: Vec<T>,
    top_rate: T,
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
    /// Viscosity with the coefficient `b` and the impedance `ρ c` \[kg/(m² s)\] of dilatational waves, on the cells of
    /// the model's own field.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] unless both are finite and not negative.
    pub fn new(field: Arc<dyn Interpolation<T>>, coefficient: T, impedance: T) -> Result<Self> {
        for (name, x) in [
            ("bulk viscosity coefficient", coefficient),
            ("impedance", impedance),
        ] {
            if !(x.is_finite() && x >= T::zero()) {
                return Err(invalid(name, x, "must be finite and not negative"));
            }
        }
        Ok(Self {
            field,
            coefficient,
            impedance,
            cells: Vec::new(),
            force: Vec::new(),
            top_rate: T::zero(),
        })
    }

    fn cell(&self, number: usize, cell: &Cell<T>, site: &Site<'_, T>) -> Result<ViscousCell<T>> {
        let mut samples: Vec<Sample<T>> = Vec::new();
        cell.quadrature(1, &mut samples);
        let volume: T = samples.iter().map(|s| s.measure).sum();
        let sum = samples
            .iter()
            .fold(Vector3::zeros(), |s, p| s + p.point.coords * p.measure);
        let centre = nalgebra::Point3::from(sum / volume);
        let mut row = ShapeRow::default();
        self.field.shape_in(number, &centre, true, &mut row)?;
        let length = volume.powf(T::of(1.0 / 3.0));
        let weight = site.weights.internal.mean(cell);
        Ok(ViscousCell {
            gradients: row
                .nodes
                .iter()
                .copied()
                .zip(row.gradients.iter().copied())
                .collect(),
            factor: self.coefficient * self.impedance * length * volume * weight,
        })
    }
}

impl<T: Real> Effect<T> for BulkViscosity<T> {
    fn name(&self) -> &str {
        "bulk-viscosity"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        let cells = self.field.cells();
        if cells.is_empty() || site.model.layout().components != 3 {
            return Err(Error::Unsupported {
                model: site.model.name().into(),
                what: "carry bulk viscosity: it has no volume cells; use stiffness damping".into(),
            });
        }
        self.cells = cells
            .iter()
            .enumerate()
            .map(|(k, c)| self.cell(k, c, site))
            .collect::<Result<_>>()?;
        let dofs = site.inertia.len();
        self.force = vec![T::zero(); dofs];
        // 1 % for what the iteration leaves out.
        self.top_rate = T::of(1.01)
            * spectrum::largest_eigenvalue(dofs, site.inverse_inertia, &mut |v, f| {
                self.cells.iter().for_each(|c| c.add(v, f));
                Ok(())
            })?;
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        self.force.fill(T::zero());
        self.cells.iter().for_each(|c| c.add(at.v_half, &mut self.force));
        f.iter_mut().zip(&self.force).for_each(|(f, g)| *f += *g);
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }

    fn demand(&self) -> Demand<T> {
        Demand::damping(self.top_rate)
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Reference)
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

/// Local damping: every unknown feels `−share |F| sgn(v)`, `F` being all other forces on it but the multipliers.
/// Brings a body to rest without holding its steady motion back. Must be the last effect of its subdomain.
#[derive(Debug, Clone)]
pub struct LocalDamping<T: Real> {
    share: T,
    force: Vec<T>,
}

impl<T: Real> LocalDamping<T> {
    /// Damping by the share given, 0.1 to 0.8 in use.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] unless it is at least 0 and below 1.
    pub fn new(share: T) -> Result<Self> {
        if share >= T::zero() && share < T::one() {
            Ok(Self {
                share,
                force: Vec::new(),
            })
        } else {
            let rule = "must be at least 0 and below 1; take 0.2";
            Err(invalid("local damping share", share, rule))
        }
    }
}

impl<T: Real> Effect<T> for LocalDamping<T> {
    fn name(&self) -> &str {
        "local-damping"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        self.force = vec![T::zero(); site.inertia.len()];
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        for ((f, g), v) in f.iter_mut().zip(&mut self.force).zip(at.v_half) {
            let size = self.share * f.abs();
            *g = if *v > T::zero() {
                -size
            } else if *v < T::zero() {
                size
            } else {
                T::zero()
            };
            *f += *g;
        }
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }

    fn demand(&self) -> Demand<T> {
        Demand {
            gain: T::one() + self.share,
            ..Demand::none()
        }
    }

    fn supplied(&self) -> Option<T> {
        Some(T::zero())
    }
}

//! Prestress: what the internal forces are at the start counts as equilibrium.

use super::{Effect, Instant, Site, dot};
use crate::momentum::Arms;
use crate::snapshot::Record;
use crate::{Real, Result};

/// Subtracts the internal forces of the initial displacements for ever, `F = −F_int(q_0)`: the body starts in
/// equilibrium in the shape it is given, and its stiffness acts on what it moves from there.
///
/// A dead load as far as energy is concerned: its work is from outside.
#[derive(Debug, Clone, Default)]
pub struct Prestress<T: Real> {
    force: Vec<T>,
}

impl<T: Real> Prestress<T> {
    /// Prestress by the initial displacements of its subdomain.
    #[must_use]
    pub fn new() -> Self {
        Self { force: Vec::new() }
    }
}

impl<T: Real> Effect<T> for Prestress<T> {
    fn name(&self) -> &str {
        "prestress"
    }

    fn attach(&mut self, site: &Site<'_, T>) -> Result<()> {
        self.force = vec![T::zero(); site.inertia.len()];
        Ok(())
    }

    fn add_forces(&mut self, at: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        if at.dt <= T::zero() {
            for (g, now) in self.force.iter_mut().zip(at.internal) {
                *g = -*now;
            }
        }
        f.iter_mut().zip(&self.force).for_each(|(f, g)| *f += *g);
        Ok(())
    }

    fn power(&self, v: &[T]) -> T {
        dot(&self.force, v)
    }

    fn arms(&self) -> Option<Arms> {
        Some(Arms::Reference)
    }

    /// The subtracted forces.
    fn save(&self) -> Record<T> {
        Record {
            numbers: self.force.clone(),
            integers: Vec::new(),
        }
    }

    fn restore(&mut self, from: &Record<T>) -> Result<()> {
        from.expect("prestress", self.force.len(), 0)?;
        self.force.copy_from_slice(&from.numbers);
        Ok(())
    }
}

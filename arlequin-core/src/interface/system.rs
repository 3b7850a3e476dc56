//! One system of multipliers: of an interface, or of several that act on the same nodes.

use super::Coupling;
use super::operator::{Operator, Wanted};
use super::transfer::{self, Transfer};
use crate::scalar::dot;
use crate::{Real, Result, parallel};

/// The operator of multipliers that are solved for together, and what the last solution did.
#[derive(Debug)]
pub(super) struct System<T: Real> {
    pub(super) operator: Operator<T>,
    /// `b = B v` before the last kick.
    jump: Vec<T>,
    /// `μᵀB v` after it.
    left: T,
}

impl<T: Real> System<T> {
    pub(super) fn new(
        wanted: Wanted<'_, T>,
        coupling: &[Coupling<T>],
        inverse: &[&[T]],
        components: usize,
    ) -> Result<Self> {
        let size = coupling.first().map_or(0, |c| c.matrix.rows() * c.shared);
        Ok(Self {
            operator: Operator::new(wanted, coupling, inverse, components)?,
            jump: vec![T::zero(); size],
            left: T::zero(),
        })
    }

    /// Solves `S μ = B x` for the numbers that `load` puts into the sides, and keeps `scale μ` and, in the sides, what it
    /// changes, `∓ scale M⁻¹ Bᵀ μ`.
    pub(super) fn find(
        &mut self,
        sides: &mut [Transfer<T>],
        load: &(impl Fn(&mut [Transfer<T>]) + Sync),
        scale: T,
        impulse: &mut [T],
    ) {
        if parallel::pays(sides.iter().map(Transfer::nonzeros).sum()) {
            // One entry into the pool for all passes: each would cost a wake-up otherwise.
            rayon::scope(|_| self.find_here(sides, load, scale, impulse));
        } else {
            self.find_here(sides, load, scale, impulse);
        }
    }

    fn find_here(
        &mut self,
        sides: &mut [Transfer<T>],
        load: &impl Fn(&mut [Transfer<T>]),
        scale: T,
        impulse: &mut [T],
    ) {
        load(sides);
        transfer::local_jump(sides, impulse);
        self.jump.copy_from_slice(impulse);
        self.operator.solve(impulse, sides);
        impulse.iter_mut().for_each(|m| *m *= scale);
        sides.iter_mut().for_each(|s| s.spread(impulse));
        // μᵀ(b − S μ), as B v = b − S μ after the kick.
        let spent: T = sides.iter().map(Transfer::twice_kinetic).sum();
        self.left = dot(&self.jump, impulse) - spent;
    }

    /// `μᵀB v` with the velocities that the last kick left: zero but for round-off where the multipliers are solved for
    /// exactly or by Galerkin's condition.
    pub(super) fn left(&self) -> T {
        self.left
    }
}

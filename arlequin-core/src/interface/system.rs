//! Solution of one system of multipliers: of one interface, or of several that act on the same nodes.

use super::Coupling;
use super::dots::Dots;
use super::operator::{Operator, Wanted};
use super::parts::Parts;
use super::sides::Sides;
use super::transfer::Transfer;
use crate::{Real, Result, parallel};

/// Operator of multipliers that are solved for together, and the results of the last solve.
#[derive(Debug)]
pub(super) struct System<T: Real> {
    pub(super) operator: Operator<T>,
    /// `b = B v` before the last kick, for the multipliers that this rank solves for.
    jump: Vec<T>,
    shared: usize,
    dots: Dots,
    /// `μ` of the multipliers that this rank owns; `None` if every rank solves for all.
    own_impulse: Option<Vec<T>>,
    /// `μᵀB v` after the last kick.
    residual_work: T,
}

impl<T: Real> System<T> {
    pub(super) fn new(
        wanted: Wanted<'_, T>,
        coupling: &[Coupling<T>],
        inverse: &[&[T]],
        components: usize,
    ) -> Result<Self> {
        let [rows, shared] = coupling.first().map_or([0, 1], |c| [c.matrix.rows(), c.shared]);
        Ok(Self {
            operator: Operator::new(wanted, coupling, inverse, components)?,
            jump: vec![T::zero(); rows * shared],
            shared,
            dots: Dots::new(rows),
            own_impulse: None,
            residual_work: T::zero(),
        })
    }

    /// Restricts the solution to this rank's multipliers if the solver can do so.
    pub(super) fn partition_among(&mut self, parts: &Parts<T>) {
        if self.operator.partition_among(parts) {
            let zeros = vec![T::zero(); self.shared * parts.owned().len()];
            (self.jump, self.own_impulse) = (zeros.clone(), Some(zeros));
            self.dots = Dots::in_parts(parts);
        }
    }

    /// Solves `S μ = B x` for the unknowns that `load` puts into the sides. Keeps `scale μ` in `impulse` and
    /// the changes `∓ scale M⁻¹ Bᵀ μ` in the sides. Collective if a model is partitioned.
    pub(super) fn find(
        &mut self,
        sides: &mut Sides<T>,
        load: &(impl Fn(&mut [Transfer<T>]) + Sync),
        scale: T,
        impulse: &mut [T],
    ) {
        if parallel::pays(sides.iter().map(Transfer::nonzeros).sum()) {
            // One entry into the thread pool for all passes: each entry costs a wake-up.
            rayon::scope(|_| self.solve_and_spread(sides, load, scale, impulse));
        } else {
            self.solve_and_spread(sides, load, scale, impulse);
        }
    }

    fn solve_and_spread(
        &mut self,
        sides: &mut Sides<T>,
        load: &impl Fn(&mut [Transfer<T>]),
        scale: T,
        impulse: &mut [T],
    ) {
        load(sides);
        if let Some(own_impulse) = &mut self.own_impulse {
            sides.owned_jump(own_impulse);
            self.jump.copy_from_slice(own_impulse);
            self.operator.solve(own_impulse, sides);
            own_impulse.iter_mut().for_each(|m| *m *= scale);
            sides.publish(own_impulse, impulse);
        } else {
            sides.jump(None, impulse);
            self.jump.copy_from_slice(impulse);
            self.operator.solve(impulse, sides);
            impulse.iter_mut().for_each(|m| *m *= scale);
        }
        sides.spread(impulse);
        // μᵀ(b − S μ), since B v = b − S μ after the kick.
        let own_impulse = self.own_impulse.as_deref().unwrap_or(impulse);
        self.residual_work = self.dots.total(self.shared, &self.jump, own_impulse) - sides.twice_kinetic();
    }

    /// Returns `μᵀB v` with the velocities after the last kick. It is zero but for round-off if the
    /// multipliers are solved for exactly or fulfil Galerkin's condition.
    pub(super) fn residual_work(&self) -> T {
        self.residual_work
    }
}

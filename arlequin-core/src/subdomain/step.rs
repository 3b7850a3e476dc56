//! Part of the step that velocity Verlet makes: positions, forces, uncorrected velocities.

use super::account::Energies;
use super::{Stepper, Subdomain};
use crate::effect::Instant;
use crate::model::{DofLayout, Evolution, State};
use crate::parallel::Pieces;
use crate::phase::Phase;
use crate::{Real, Result, parallel};
use std::ops::Range;

/// Callback that is called before each phase of a step.
pub(crate) type Announce<'a> = dyn FnMut(Phase) + Send + 'a;

/// Instant at the end of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StepEnd<T> {
    /// Time \[s\].
    pub(crate) time: T,
    /// Length of the step that led to the instant \[s\]; zero at the start of a run.
    pub(crate) since: T,
    /// Length of the own steps of the subdomain \[s\]; zero if time stands still.
    pub(crate) dt: T,
    /// Own steps since the start of the run; zero at a start.
    pub(crate) number: usize,
}

/// Forces beside the internal ones; they decide when the subdomain is accelerated.
#[derive(Debug)]
enum Loads<T> {
    /// No other forces.
    Absent,
    /// All forces, internal ones included, of a subdomain with effects of its own; only where these act.
    Own(Vec<T>),
    /// All forces of a subdomain to which pair effects add theirs before it is accelerated.
    Paired(Vec<T>),
}

/// Forces of this instant and of the one before.
#[derive(Debug)]
pub(super) struct Forces<T> {
    internal: Vec<T>,
    internal_before: Vec<T>,
    /// Displacements one own step earlier, where they are kept.
    q_before: Vec<T>,
    loads: Loads<T>,
    /// All unknowns, and those whose nodes do not all sleep.
    pieces: [Pieces; 2],
    /// The parts of `pieces` on which effects act.
    acted_on: [Pieces; 2],
    /// The other parts of `pieces`.
    left_alone: [Pieces; 2],
    /// Steps until both arrays of a pair have what sleeping nodes keep.
    unsettled: u8,
    /// False between a restored state and its first step, when forces are not those of the present state.
    known: bool,
    /// True if the model makes its steps itself; the arrays are then empty.
    released: bool,
}

impl<T: Real> Forces<T> {
    pub(super) fn zero(dofs: usize) -> Self {
        Self {
            internal: vec![T::zero(); dofs],
            internal_before: vec![T::zero(); dofs],
            q_before: vec![T::zero(); dofs],
            loads: Loads::Absent,
            pieces: [Pieces::whole(dofs), Pieces::whole(dofs)],
            acted_on: [Pieces::whole(dofs), Pieces::whole(dofs)],
            left_alone: Default::default(),
            unsettled: 2,
            known: false,
            released: false,
        }
    }

    /// Leaves units of nodes out of the passes if all of them sleep; `inertia` is zero where nodes sleep.
    pub(super) fn leave_out(&mut self, layout: &DofLayout, inertia: &[T]) {
        self.pieces[1] = Pieces::with_mass(layout, inertia);
        self.unsettled = 2;
    }

    /// Sets the nodes to whose displacements effects add forces; with `None` effects may act anywhere.
    fn expect_at(&mut self, layout: &DofLayout, nodes: Option<Vec<bool>>) {
        self.acted_on = self.pieces.clone();
        self.left_alone = Default::default();
        let Some(nodes) = nodes.filter(|_| !self.is_paired()) else {
            return;
        };
        let d = layout.components;
        let is_acted_on = |piece: &Range<usize>| {
            piece.end <= layout.translations() && nodes[piece.start / d..piece.end / d].contains(&true)
        };
        for (k, pieces) in self.pieces.iter().enumerate() {
            let [acted_on, left_alone] = [true, false].map(|which| {
                Pieces::select(layout, &|piece| {
                    pieces.contains(piece.start) && is_acted_on(&piece) == which
                })
            });
            (self.acted_on[k], self.left_alone[k]) = (acted_on, left_alone);
        }
    }

    /// Lets effects act anywhere, until the next start tells where they act.
    pub(super) fn expect_anywhere(&mut self) {
        self.acted_on = self.pieces.clone();
        self.left_alone = Default::default();
    }

    /// Passes over all unknowns again, whose values have been set from outside.
    pub(super) fn unsettle(&mut self) {
        self.unsettled = 2;
    }

    /// Unknowns that a step passes over. Arrays change places from step to step, so after a start two steps
    /// pass over all unknowns; what sleeps then has its values in both arrays.
    fn pieces(&self) -> &Pieces {
        &self.pieces[usize::from(self.unsettled == 0)]
    }

    /// Returns whether the model makes its steps itself. Empty arrays would not tell, since a rank without
    /// nodes has them too.
    pub(super) fn are_released(&self) -> bool {
        self.released
    }

    /// Returns whether the forces are those of the present state.
    pub(super) fn known(&self) -> bool {
        self.known
    }

    /// Allocates forces beside the internal ones: for effects of the subdomain (`has_effects`) and for pair
    /// effects (`paired`).
    pub(super) fn expect_loads(&mut self, has_effects: bool, paired: bool) {
        let zeros = || vec![T::zero(); self.internal.len()];
        self.loads = match (has_effects, paired) {
            (_, true) => Loads::Paired(zeros()),
            (true, false) => Loads::Own(zeros()),
            (false, false) => Loads::Absent,
        };
    }

    /// Weighted internal forces \[N, N m\].
    pub(super) fn internal(&self) -> &[T] {
        &self.internal
    }

    /// Internal forces, to be evaluated anew.
    pub(super) fn internal_mut(&mut self) -> &mut [T] {
        &mut self.internal
    }

    /// Sets the internal forces of a restored state; the others are unknown until the next step.
    pub(super) fn restore(&mut self, internal: &[T]) {
        self.known = false;
        self.unsettle();
        if self.internal.len() == internal.len() {
            self.internal.copy_from_slice(internal);
        }
    }

    /// Sets the internal forces of another state, as if it had stood still in it.
    pub(super) fn settle(&mut self, internal: Vec<T>) {
        self.internal_before.clone_from(&internal);
        self.q_before.resize(internal.len(), T::zero());
        self.internal = internal;
        self.known = true;
        self.released = false;
        self.unsettle();
    }

    /// Sets all forces of another state, where there are others than internal ones.
    pub(super) fn settle_loads(&mut self, forces: &[T]) {
        if let Loads::Own(total) | Loads::Paired(total) = &mut self.loads {
            total.copy_from_slice(forces);
        }
    }

    /// Allocates the arrays again that [`Self::release`] freed.
    pub(super) fn reclaim(&mut self, dofs: usize) {
        if self.released {
            self.settle(vec![T::zero(); dofs]);
        }
    }

    /// Returns whether internal forces are the only ones.
    pub(super) fn are_internal(&self) -> bool {
        matches!(self.loads, Loads::Absent)
    }

    /// Frees all arrays, for a model that makes its steps itself.
    pub(super) fn release(&mut self) {
        self.internal = Vec::new();
        self.internal_before = Vec::new();
        self.q_before = Vec::new();
        self.released = true;
    }

    /// Displacements and internal forces one own step earlier.
    pub(super) fn before(&self) -> [&[T]; 2] {
        [&self.q_before, &self.internal_before]
    }

    /// All forces on an unknown, internal ones included.
    pub(super) fn total_at(&self, unknown: usize) -> T {
        match &self.loads {
            Loads::Own(total) | Loads::Paired(total) if self.acted_on().contains(unknown) => total[unknown],
            _ => self.internal[unknown],
        }
    }

    /// Writes all forces, internal ones included.
    pub(super) fn write_total(&self, out: &mut [T]) {
        out.copy_from_slice(&self.internal);
        if let Loads::Own(total) | Loads::Paired(total) = &self.loads {
            let ranges = self.acted_on().ranges().iter();
            ranges.for_each(|r| out[r.clone()].copy_from_slice(&total[r.clone()]));
        }
    }

    fn acted_on(&self) -> &Pieces {
        &self.acted_on[usize::from(self.unsettled == 0)]
    }

    fn is_paired(&self) -> bool {
        matches!(self.loads, Loads::Paired(_))
    }

    /// Sets all forces to the internal ones, where effects act.
    fn reset_total(&mut self) {
        let pieces = &self.acted_on[usize::from(self.unsettled == 0)];
        if let Loads::Own(total) | Loads::Paired(total) = &mut self.loads {
            pieces.run([total], [&self.internal], &|[total], [internal]| {
                total.copy_from_slice(internal);
            });
        }
    }

    /// Returns the instant as effects see it, and the forces to which they add; an empty slice if there are
    /// no effects.
    fn instant<'a>(&'a mut self, step_end: StepEnd<T>, state: &'a State<T>) -> (Instant<'a, T>, &'a mut [T]) {
        let instant = Instant {
            time: step_end.time,
            q: &state.q,
            v_half: &state.v,
            dt: step_end.since,
            number: step_end.number,
            internal: &self.internal,
            internal_before: &self.internal_before,
        };
        let total: &mut [T] = match &mut self.loads {
            Loads::Absent => &mut [],
            Loads::Own(total) | Loads::Paired(total) => total,
        };
        (instant, total)
    }
}

impl<T: Real> Subdomain<T> {
    /// Returns whether pair effects act on this subdomain, which is then accelerated after them.
    pub(crate) fn is_paired(&self) -> bool {
        self.forces.is_paired()
    }

    /// Adds the forces of effects to the internal forces, which are known by now. `number` is that of this
    /// subdomain.
    fn evaluate(&mut self, step_end: StepEnd<T>, number: usize, announce: &mut Announce<'_>) -> Result<()> {
        // On a rank without nodes effects are evaluated all the same, since they communicate with other
        // ranks.
        if self.forces.are_internal() {
            return Ok(());
        }
        self.forces.reset_total();
        let (instant, total) = self.forces.instant(step_end, &self.state);
        for (k, e) in self.effects.iter_mut().enumerate() {
            announce(Phase::Effect(number, k));
            e.add_forces(&instant, total)?;
        }
        announce(Phase::Predict(number));
        Ok(())
    }

    /// Returns the instant and the forces to which pair effects add theirs.
    pub(crate) fn loaded_at(&mut self, step_end: StepEnd<T>) -> (Instant<'_, T>, &mut [T]) {
        self.forces.instant(step_end, &self.state)
    }

    /// Adds the forces of the effects at an instant that the caller chooses.
    pub(crate) fn add_effects(&mut self, instant: &Instant<'_, T>, f: &mut [T]) -> Result<()> {
        self.effects
            .iter_mut()
            .try_for_each(|e| e.effect.add_forces(instant, f))
    }

    /// Computes `a` from all forces, adds `Δt/2 a` to `v`, and sets prescribed velocities and accelerations.
    pub(crate) fn accelerate(&mut self, step_end: StepEnd<T>) {
        let half = step_end.since * T::of(0.5);
        let State { v, a, .. } = &mut self.state;
        let (forces, w) = (&self.forces, &self.inverse_inertia);
        match &forces.loads {
            Loads::Absent => parallel::accelerate(forces.pieces(), half, [v, a], &forces.internal, w),
            Loads::Own(total) | Loads::Paired(total) => {
                let left_alone = &forces.left_alone[usize::from(forces.unsettled == 0)];
                parallel::accelerate(left_alone, half, [&mut *v, &mut *a], &forces.internal, w);
                parallel::accelerate(forces.acted_on(), half, [&mut *v, &mut *a], total, w);
            }
        }
        for motion in &self.supports {
            // Prescribed unknowns take no part in the acceleration: their inverse inertia is zero.
            let (_, velocity, acceleration) = motion.kinematics(step_end.time, step_end.dt);
            for &d in &motion.dofs {
                a[d] = acceleration;
                v[d] = velocity;
            }
        }
    }

    /// Sets prescribed displacements and velocities at time `t` \[s\].
    pub(crate) fn set_prescribed(&mut self, t: T) {
        let dt = self.pace.dt;
        for motion in &self.supports {
            let (q, v, _) = motion.kinematics(t, dt);
            for &d in &motion.dofs {
                self.state.q[d] = q;
                self.state.v[d] = v;
            }
        }
    }

    /// Returns the instant at which a run starts.
    pub(crate) fn at_start(&self, time: T) -> StepEnd<T> {
        StepEnd {
            time,
            since: T::zero(),
            dt: self.pace.dt,
            number: 0,
        }
    }

    /// Computes forces and accelerations of the start, after [`Self::set_prescribed`].
    pub(crate) fn start(&mut self, time: T) -> Result<()> {
        // A model that makes its steps itself has no force arrays, also if it keeps its weights in a change.
        self.forces.reclaim(self.inertia.len());
        self.forces.known = true;
        let layout = self.model.layout();
        if self.sleeps {
            self.forces.leave_out(&layout, &self.inertia);
        }
        let nodes = self
            .effects
            .iter()
            .try_fold(vec![false; layout.nodes], |mut all, e| {
                e.effect.nodes()?.iter().for_each(|k| all[*k as usize] = true);
                Some(all)
            });
        self.forces.expect_at(&layout, nodes);
        if self.is_external() {
            self.external_start();
            return Ok(());
        }
        let start = self.at_start(time);
        self.forces.internal.fill(T::zero());
        self.model.advance(&self.state.q, &mut self.forces.internal)?;
        self.evaluate(start, 0, &mut |_| {})?;
        if !self.is_paired() {
            self.accelerate(start);
        }
        Ok(())
    }

    /// Makes an own step up to the velocities and accelerations that the instant would have without
    /// multipliers. Where pair effects act, it stops at the forces, and [`Self::accelerate`] follows the pair
    /// effects.
    ///
    /// Takes two passes over the unknowns beside the model's: before its forces and after them. `number` is
    /// that of this subdomain, for `announce`; `keep` is true if displacements of the step before are kept
    /// for [`Self::invariant`].
    pub(crate) fn predict(
        &mut self,
        number: usize,
        step_end: StepEnd<T>,
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        self.forces.known = true;
        match self.stepper {
            Stepper::Verlet => {}
            Stepper::Average(_) => return self.average_step(step_end),
            Stepper::External(_) => return self.external_step(step_end),
        }
        if parallel::pays(self.inertia.len()) {
            // One entry into the pool for all passes: each would cost a wake-up otherwise.
            rayon::scope(|_| self.passes(number, step_end, keep, announce))
        } else {
            self.passes(number, step_end, keep, announce)
        }
    }

    fn passes(
        &mut self,
        number: usize,
        step_end: StepEnd<T>,
        keep: bool,
        announce: &mut Announce<'_>,
    ) -> Result<()> {
        if self.stride(step_end, keep)? {
            return Ok(());
        }
        let evolves = self.model.evolving().is_some();
        let forces = &mut self.forces;
        // The kick zeroes the array of forces before last, and the new forces go there.
        std::mem::swap(&mut forces.internal, &mut forces.internal_before);
        let keeps = keep || evolves;
        if keeps {
            std::mem::swap(&mut self.state.q, &mut forces.q_before);
        }
        let State { q, v, a } = &mut self.state;
        if keeps {
            let pieces = &forces.pieces[usize::from(forces.unsettled == 0)];
            let targets = [&mut q[..], v, &mut forces.internal];
            parallel::kick_and_drift_from(pieces, step_end.since, &forces.q_before, targets, a);
        } else {
            // One array less to read where nobody needs the old displacements. Without a change of places the
            // other array does not follow.
            forces.unsettled = 2;
            let targets = [&mut q[..], v, &mut forces.internal];
            parallel::kick_and_drift(&forces.pieces[0], step_end.since, targets, a);
        }
        for motion in &self.supports {
            // Before forces are evaluated: the drift has moved prescribed unknowns by their velocity only.
            let now = motion.position(step_end.time);
            motion.dofs.iter().for_each(|&d| q[d] = now);
        }
        // The energy after the last step is that before this one.
        self.energies.before = self.energies.now.take();
        if keep {
            self.energies.now = Some(self.model.advance_with_energy(q, &mut forces.internal)?);
        } else {
            self.model.advance(q, &mut forces.internal)?;
        }
        if evolves {
            announce(Phase::Evolve(number));
            self.evolve(step_end.time)?;
            announce(Phase::Predict(number));
        }
        self.evaluate(step_end, number, announce)?;
        if !self.is_paired() {
            self.accelerate(step_end);
        }
        self.forces.unsettled = self.forces.unsettled.saturating_sub(1);
        Ok(())
    }

    /// Lets the model change itself; energy that leaves it is a negative work.
    fn evolve(&mut self, time: T) -> Result<()> {
        if let (Some(model), Some(line)) = (self.model.evolving(), &mut self.evolved) {
            let released = model.evolve(Evolution {
                time,
                q_before: &self.forces.q_before,
                q: &self.state.q,
                f_before: &mut self.forces.internal_before,
                f: &mut self.forces.internal,
            })?;
            line.release(released);
            if released != T::zero() {
                // The known energies are those of the model before its change.
                self.energies = Energies::unknown();
            }
        }
        Ok(())
    }
}

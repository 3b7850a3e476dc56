//! Ledger of a subdomain: works of its effects, energies, the discrete invariant.

use super::{Stepper, Subdomain};
use crate::effect::EffectLine;
use crate::phase::Phase;
use crate::{Exact, Facts, Real, parallel};
use nalgebra::Vector3;
use std::ops::Range;

/// Energy that left a model which changes itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evolved<T> {
    /// Name of the effect that took the energy.
    effect: &'static str,
    /// Work of that effect \[J\], negative.
    pub(super) work: T,
}

impl<T: Real> Evolved<T> {
    pub(super) fn new(effect: &'static str) -> Self {
        let work = T::zero();
        Self { effect, work }
    }

    /// Records energy \[J\] that leaves the model.
    pub(super) fn release(&mut self, energy: T) {
        self.work -= energy;
    }
}

/// Energies of the last step \[J\], where they are known without another evaluation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Energies<T> {
    /// Internal energy before the step.
    pub(super) before: Option<T>,
    /// Internal energy after the step.
    pub(super) now: Option<T>,
    /// `½ v₊ᵀMv₊ + ¼ Δqᵀ(f_{n+1} − f_n)`.
    pub(super) moving: Option<T>,
}

impl<T> Energies<T> {
    pub(super) fn unknown() -> Self {
        Self {
            before: None,
            now: None,
            moving: None,
        }
    }
}

impl<T: Real> Subdomain<T> {
    /// Returns the invariant of the own step just made, `½ v₊ᵀMv₊ + ½(U_n + U_{n+1}) + ¼ Δqᵀ(f_{n+1} − f_n)`
    /// with `v₊ = Δq/Δt`. For a linear model this is `½ v₊ᵀMv₊ + ½ q_nᵀKq_{n+1}`. The second number,
    /// `U_{n+1} − U_n + ½ Δqᵀ(f_n + f_{n+1})`, is the change of the invariant that a law makes in the step if
    /// it is not linear; zero for the implicit scheme and for external solvers. Needs the displacements that
    /// [`Self::predict`] keeps.
    pub(crate) fn invariant(&mut self) -> [T; 2] {
        match self.stepper {
            Stepper::Verlet => {}
            Stepper::Average(_) => return [self.average_invariant(), T::zero()],
            Stepper::External(_) => return [self.external_invariant(), T::zero()],
        }
        let [q_before, force_before] = self.forces.before();
        let mut energy = |q: &[T]| self.model.energy_from_forces(q);
        let before = self.energies.before.unwrap_or_else(|| energy(q_before));
        let now = self.energies.now.unwrap_or_else(|| energy(&self.state.q));
        let potential = T::of(0.5) * (before + now);
        // A model that makes its steps itself has summed `moving` on the way.
        let [moving, pushed] = match self.energies.moving.take() {
            Some(moving) => [moving, self.pushed_by_model(moving)],
            None => self.moving_energy(q_before, force_before),
        };
        self.energies.now = Some(now);
        [potential + moving, now - before + pushed]
    }

    /// Returns `½ v₊ᵀMv₊ + ¼ Δqᵀ(f_{n+1} − f_n)` and `½ Δqᵀ(f_n + f_{n+1})`.
    fn moving_energy(&self, q_before: &[T], force_before: &[T]) -> [T; 2] {
        let (dt, half, quarter) = (self.pace.dt, T::of(0.5), T::of(0.25));
        let (q, force, inertia) = (&self.state.q, self.forces.internal(), &self.inertia);
        let part = |range: Range<usize>| {
            range.fold([T::zero(); 2], |[sum, pushed], i| {
                let dq = q[i] - q_before[i];
                let v = dq / dt;
                let term = half * inertia[i] * v * v + quarter * dq * (force[i] - force_before[i]);
                [sum + term, pushed + half * dq * (force[i] + force_before[i])]
            })
        };
        self.sums(&part)
    }

    /// Returns `½ Δqᵀ(f_n + f_{n+1})` of a step that the model made itself. Its forces are not stored: they
    /// follow from the accelerations and from `moving`.
    fn pushed_by_model(&self, moving: T) -> T {
        let (dt, half) = (self.pace.dt, T::of(0.5));
        let (v, a, inertia) = (&self.state.v, &self.state.a, &self.inertia);
        let part = |range: Range<usize>| {
            range.fold([T::zero(); 2], |[kinetic, power], i| {
                let middle = v[i] - half * dt * a[i];
                let momentum = inertia[i] * middle;
                [kinetic + half * momentum * middle, power + momentum * a[i]]
            })
        };
        let [kinetic, power] = self.sums(&part);
        dt * power - T::of(2.0) * (moving - kinetic)
    }

    /// Sums over all unknowns of all ranks; `part` sums over a range of this rank's unknowns. The bits do not
    /// depend on the number of threads and ranks.
    fn sum(&self, part: &(dyn Fn(Range<usize>) -> T + Sync)) -> T {
        let [sum] = self.sums(&|range| [part(range)]);
        sum
    }

    /// Sums several numbers at once, like [`Self::sum`].
    pub(super) fn sums<const N: usize>(&self, part: &(dyn Fn(Range<usize>) -> [T; N] + Sync)) -> [T; N] {
        let layout = self.model.layout();
        let (d, r, first) = (layout.components, layout.rotations, layout.translations());
        let of_nodes = |n: Range<usize>| {
            // Translations and rotations of a node belong to one unit of summation, whatever rank has it.
            let turning = part(first + r * n.start..first + r * n.end);
            let moving = part(d * n.start..d * n.end);
            std::array::from_fn(|k| moving[k] + turning[k])
        };
        self.owned().sum(&of_nodes)
    }

    /// Returns `Σ m q²` of the displacements without rotations \[kg m²\], over all ranks.
    pub(crate) fn displaced(&self) -> T {
        let (d, m, q) = (self.model.layout().components, &self.inertia, &self.state.q);
        let of_nodes = |n: Range<usize>| {
            let range = d * n.start..d * n.end;
            [parallel::weighted_squares(&m[range.clone()], &q[range])]
        };
        let [sum] = self.owned().sum(&of_nodes);
        sum
    }

    /// Returns `Σ m |x − x̄|²` over the unknowns \[kg m²\], with the mean position `x̄` of the nodes, over
    /// all ranks. Collective.
    pub(crate) fn spread(&self) -> T {
        let (layout, nodes, m) = (self.model.layout(), self.model.nodes(), &self.inertia);
        let places = |range: Range<usize>| {
            range.fold([T::zero(); 4], |[x, y, z, n], k| {
                [x + nodes[k].x, y + nodes[k].y, z + nodes[k].z, n + T::one()]
            })
        };
        let [x, y, z, n] = self.owned().sum(&places);
        let middle = Vector3::new(x, y, z) / n.max(T::one());
        let squares = |range: Range<usize>| {
            let of_node = |k: usize| {
                let mass: T = m[layout.components * k..][..layout.components]
                    .iter()
                    .copied()
                    .sum();
                mass * (nodes[k].coords - middle).norm_squared()
            };
            [range.map(of_node).sum()]
        };
        let [sum] = self.owned().sum(&squares);
        sum
    }

    /// Internal energy at the whole step \[J\], over all ranks. For an external solver it follows from the
    /// invariant when the ledger was last evaluated.
    pub fn internal_energy(&self) -> T {
        if self.is_external() {
            return self.drawn_energy();
        }
        self.model().internal_energy(&self.state.q)
    }

    /// Kinetic energy at the whole step \[J\], over all ranks. Collective.
    pub fn kinetic_energy(&self) -> T {
        let (m, v) = (&self.inertia, &self.state.v);
        T::of(0.5) * self.sum(&|range| parallel::weighted_squares(&m[range.clone()], &v[range]))
    }

    /// Internal energy \[J\] of the last [`Self::invariant`].
    pub(crate) fn drawn_energy(&self) -> T {
        self.energies.now.unwrap_or_else(T::zero)
    }

    /// Adds the works of effects over an own step; returns the work of the moving supports \[J\], without
    /// that of coupling forces on them.
    pub(crate) fn account(&mut self) -> T {
        // Implicit steps record their works while they are made; external solvers keep theirs.
        if !matches!(self.stepper, Stepper::Verlet) {
            return T::zero();
        }
        if self.effects.is_empty() && self.moving().next().is_none() {
            return T::zero();
        }
        // Powers of all effects, then of the supports: one all-reduce serves all of them.
        let mut powers = std::mem::take(&mut self.powers);
        // The buffer stays with the subdomain, so that steps do not allocate.
        powers.clear();
        let layout = self.model.layout();
        for e in &self.effects {
            let mut power = Exact::zero();
            if !e.effect.add_power(&layout, &self.state.v, &mut power) {
                power.add(e.effect.power(&self.state.v).as_f64());
            }
            powers.push(power);
        }
        powers.push(self.support_power());
        self.owned().all_reduce(&mut powers);
        let mut works = powers.iter().map(|p| self.pace.dt * T::of(p.value()));
        self.effects
            .iter_mut()
            .zip(&mut works)
            .for_each(|(e, w)| e.add(w));
        let support = works.next().unwrap_or_else(T::zero);
        self.powers = powers;
        support
    }

    /// Power of the moving supports on this rank \[W\], without that of coupling forces on them.
    fn support_power(&self) -> Exact {
        let mut sum = Exact::zero();
        for d in self.moving().flat_map(|m| m.dofs.iter().copied()) {
            // The support supplies what inertia needs beyond all other forces.
            let reaction = self.inertia[d] * self.state.a[d] - self.forces.total_at(d);
            sum.add((reaction * self.state.v[d]).as_f64());
        }
        sum
    }

    /// Work of the moving supports \[J\] in an implicit step, which finds it while the step is made.
    pub(crate) fn work_within(&self) -> T {
        match &self.stepper {
            Stepper::Average(average) => average.support,
            _ => T::zero(),
        }
    }

    /// Works since the start \[J\]: of every effect, then of the model's changes to itself.
    pub(crate) fn works(&self) -> impl Iterator<Item = T> {
        let evolved = self.evolved.iter().map(|e| e.work);
        self.effects.iter().map(|e| e.work()).chain(evolved)
    }

    /// Energy \[J\] that the effects have created, above round-off only if their laws are at fault.
    pub(crate) fn created(&self) -> T {
        self.effects.iter().map(|e| e.created()).sum()
    }

    /// Lists the effects with their works: those of the model first, then those that were added. `number` is
    /// that of this subdomain.
    pub(crate) fn effect_lines(&self, number: usize) -> Vec<EffectLine<T>> {
        let name = |effect: &str| format!("{}/{effect}", self.model().name());
        let of_model = self.model().views().effects.iter().map(|effect| {
            let taken = self.evolved.filter(|e| e.effect == *effect);
            EffectLine {
                name: name(effect),
                phase: taken.map(|_| Phase::Evolve(number)),
                work: taken.map(|e| e.work),
                pending: T::zero(),
                stored: T::zero(),
                supplied: taken.map(|_| T::zero()),
                facts: taken
                    .and_then(|_| self.model().views().facts)
                    .map_or_else(Vec::new, Facts::facts),
            }
        });
        let added = self.effects.iter().enumerate();
        let added = added.map(|(k, e)| e.line(name(e.effect.name()), Phase::Effect(number, k)));
        of_model.chain(added).collect()
    }

    /// Returns whether all velocities are finite, on all ranks. Collective.
    pub(crate) fn is_finite(&self) -> bool {
        let local = if self.state.v.iter().all(|v| v.is_finite()) {
            T::zero()
        } else {
            T::one()
        };
        self.owned().largest(local) <= T::zero()
    }
}

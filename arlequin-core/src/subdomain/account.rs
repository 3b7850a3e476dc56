//! What a subdomain is held to: works of its effects, energies, the discrete invariant.

use super::{Stepper, Subdomain};
use crate::effect::EffectLine;
use crate::phase::Phase;
use crate::ranks::Exact;
use crate::{Real, parallel, ranks};
use nalgebra::Vector3;
use std::ops::Range;

/// What left a model that evolves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evolved<T> {
    /// The effect that took it.
    effect: &'static str,
    /// Its work \[J\], negative.
    pub(super) work: T,
}

impl<T: Real> Evolved<T> {
    pub(super) fn new(effect: &'static str) -> Self {
        let work = T::zero();
        Self { effect, work }
    }

    /// Energy \[J\] leaves the model.
    pub(super) fn release(&mut self, energy: T) {
        self.work -= energy;
    }
}

/// Energies of the last step \[J\], as far as they were found on the way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Energies<T> {
    /// Internal energy before it, and after.
    pub(super) before: Option<T>,
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
    /// Invariant of the own step just made: `½ v₊ᵀMv₊ + ½(U_n + U_{n+1}) + ¼ Δqᵀ(f_{n+1} − f_n)`, `v₊ =
    /// Δq/Δt`. For a linear model this is `½ v₊ᵀMv₊ + ½ q_nᵀKq_{n+1}`. Beside it `U_{n+1} − U_n + ½ Δqᵀ(f_n
    /// + f_{n+1})`, by which the step changes the invariant of a law that is not linear; zero of what is
    /// linear by construction and of solvers with steps of their own. Needs what [`Self::predict`] keeps
    /// for it.
    pub(crate) fn invariant(&mut self) -> [T; 2] {
        match self.stepper {
            Stepper::Verlet => {}
            Stepper::Average(_) => return [self.average_invariant(), T::zero()],
            Stepper::Guest(_) => return [self.guest_invariant(), T::zero()],
        }
        let [q_before, force_before] = self.forces.before();
        let energy = |q: &[T]| self.model.internal_energy(q);
        let before = self.energies.before.unwrap_or_else(|| energy(q_before));
        let now = self.energies.now.unwrap_or_else(|| energy(&self.state.q));
        let potential = T::of(0.5) * (before + now);
        let [moving, pushed] = match self.energies.moving.take() {
            Some(moving) => [moving, self.pushed_by_model(moving)],
            None => self.moving_energy(q_before, force_before),
        };
        self.energies.now = Some(now);
        [potential + moving, now - before + pushed]
    }

    /// `½ v₊ᵀMv₊ + ¼ Δqᵀ(f_{n+1} − f_n)` and `½ Δqᵀ(f_n + f_{n+1})`.
    fn moving_energy(&self, q_before: &[T], force_before: &[T]) -> [T; 2] {
        let (dt, half, quarter) = (self.pace.dt, T::of(0.5), T::of(0.25));
        let (q, force, inertia) = (&self.state.q, self.forces.internal(), &self.inertia);
        let part = |range: Range<usize>| {
            range.fold([T::zero(); 2], |[sum, pushed], i| {
                let dq = q[i] - q_before[i];
                let v = dq / dt;
                let one = half * inertia[i] * v * v + quarter * dq * (force[i] - force_before[i]);
                [sum + one, pushed + half * dq * (force[i] + force_before[i])]
            })
        };
        self.sums(&part)
    }

    /// `½ Δqᵀ(f_n + f_{n+1})` of a step that the model made itself, whose forces are in the accelerations
    /// and in `moving`.
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

    /// Sums over all unknowns, on all ranks; `part` sums over a range of those here. The same bits for any
    /// number of threads and ranks.
    fn sum(&self, part: &(dyn Fn(Range<usize>) -> T + Sync)) -> T {
        let [sum] = self.sums(&|range| [part(range)]);
        sum
    }

    /// [`Self::sum`] of several numbers at once.
    fn sums<const N: usize>(&self, part: &(dyn Fn(Range<usize>) -> [T; N] + Sync)) -> [T; N] {
        let layout = self.model.layout();
        let (d, r, first) = (layout.components, layout.rotations, layout.translations());
        let of_nodes = |n: Range<usize>| {
            let turning = part(first + r * n.start..first + r * n.end);
            let moving = part(d * n.start..d * n.end);
            std::array::from_fn(|k| moving[k] + turning[k])
        };
        ranks::sum(layout.nodes, self.portion(), &of_nodes)
    }

    /// `Σ m x²` of the displacements alone.
    pub(crate) fn displaced(&self) -> T {
        let (d, m, q) = (self.model.layout().components, &self.inertia, &self.state.q);
        let of_nodes = |n: Range<usize>| {
            let range = d * n.start..d * n.end;
            [parallel::weighted_squares(&m[range.clone()], &q[range])]
        };
        let [sum] = ranks::sum(self.model.layout().nodes, self.portion(), &of_nodes);
        sum
    }

    /// `Σ m |x − x̄|²` over the unknowns \[kg m²\], with the mean place `x̄` of the nodes; on all ranks,
    /// all of which must ask.
    pub(crate) fn spread(&self) -> T {
        let (layout, nodes, m) = (self.model.layout(), self.model.nodes(), &self.inertia);
        let places = |range: Range<usize>| {
            range.fold([T::zero(); 4], |[x, y, z, n], k| {
                [x + nodes[k].x, y + nodes[k].y, z + nodes[k].z, n + T::one()]
            })
        };
        let [x, y, z, n] = ranks::sum(layout.nodes, self.portion(), &places);
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
        let [sum] = ranks::sum(layout.nodes, self.portion(), &squares);
        sum
    }

    /// Internal energy at the whole step \[J\], on all ranks; of a whole solver, what its invariant said
    /// when the ledger was last drawn.
    pub fn internal_energy(&self) -> T {
        if self.is_guest() {
            return self.drawn_energy();
        }
        self.model().internal_energy(&self.state.q)
    }

    /// Kinetic energy at the whole step \[J\], on all ranks: all of them must ask.
    pub fn kinetic_energy(&self) -> T {
        let (m, v) = (&self.inertia, &self.state.v);
        T::of(0.5) * self.sum(&|range| parallel::weighted_squares(&m[range.clone()], &v[range]))
    }

    /// Internal energy \[J\] found by the last [`Self::invariant`].
    pub(crate) fn drawn_energy(&self) -> T {
        self.energies.now.unwrap_or_else(T::zero)
    }

    /// Adds the work of effects over an own step; returns that of the moving supports, but for coupling
    /// forces on them.
    pub(crate) fn account(&mut self) -> T {
        if !matches!(self.stepper, Stepper::Verlet) {
            return T::zero();
        }
        if self.effects.is_empty() && self.moving().next().is_none() {
            return T::zero();
        }
        // Of every effect, then of the supports.
        let mut powers = std::mem::take(&mut self.powers);
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
        if let Some(portion) = self.portion() {
            portion.totals(&mut powers);
        }
        let mut works = powers.iter().map(|p| self.pace.dt * T::of(p.value()));
        self.effects
            .iter_mut()
            .zip(&mut works)
            .for_each(|(e, w)| e.add(w));
        let support = works.next().unwrap_or_else(T::zero);
        self.powers = powers;
        support
    }

    /// Power of the moving supports here \[W\], but for coupling forces on them.
    fn support_power(&self) -> Exact {
        let (mut sum, total) = (Exact::zero(), self.forces.total());
        for d in self.moving().flat_map(|m| m.dofs.iter().copied()) {
            let reaction = self.inertia[d] * self.state.a[d] - total[d];
            sum.add((reaction * self.state.v[d]).as_f64());
        }
        sum
    }

    /// Work of the moving supports in a step whose works are known as it is made, and not at its end.
    pub(crate) fn work_within(&self) -> T {
        match &self.stepper {
            Stepper::Average(average) => average.support,
            _ => T::zero(),
        }
    }

    /// Works since the start \[J\]: of every effect, then of what left the model.
    pub(crate) fn works(&self) -> impl Iterator<Item = T> {
        let evolved = self.evolved.iter().map(|e| e.work);
        self.effects.iter().map(|e| e.work()).chain(evolved)
    }

    /// Energy \[J\] that its effects have created, above zero only where their laws are at fault.
    pub(crate) fn created(&self) -> T {
        self.effects.iter().map(|e| e.created()).sum()
    }

    /// What its effects did: those of the model first.
    pub(crate) fn effect_lines(&self, own: usize) -> Vec<EffectLine<T>> {
        let name = |effect: &str| format!("{}/{effect}", self.model().name());
        let of_model = self.model().effects().iter().map(|effect| {
            let taken = self.evolved.filter(|e| e.effect == *effect);
            EffectLine {
                name: name(effect),
                phase: taken.map(|_| Phase::Evolve(own)),
                work: taken.map(|e| e.work),
                pending: T::zero(),
                stored: T::zero(),
                supplied: taken.map(|_| T::zero()),
                facts: taken.map_or_else(Vec::new, |_| self.model().facts()),
            }
        });
        let added = self.effects.iter().enumerate();
        let added = added.map(|(k, e)| e.line(name(e.effect.name()), Phase::Effect(own, k)));
        of_model.chain(added).collect()
    }

    /// Whether velocities are numbers, on all ranks: all of them must ask.
    pub(crate) fn is_finite(&self) -> bool {
        let own = if self.state.v.iter().all(|v| v.is_finite()) {
            T::zero()
        } else {
            T::one()
        };
        ranks::largest(self.portion(), own) <= T::zero()
    }
}

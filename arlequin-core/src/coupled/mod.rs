//! The coupled run: several subdomains, several interfaces, and reflections between them.
//!
//! ```text
//! every subdomain m      own steps Δt_m = ΔT/m of velocity Verlet with its own forces, from v⁺ to v⁻
//! every interface        v⁺ = (I − 2P) v⁻,   P = M⁻¹BᵀS⁻¹B,   S = B M⁻¹ Bᵀ;   at the instant v = (I − P) v⁻
//! ```
//!
//! A reflection keeps `½vᵀMv` of both sides together and moves nothing, so that the sum of the invariants that subdomains keep
//! on their own is kept for any own steps ([`crate::ledger`]). With one own step for all it is RATTLE for linear velocity
//! constraints. It filters nothing.

mod apart;
mod free;
pub(crate) mod ledger;
pub(crate) mod momentum;
mod motions;
pub(crate) mod observer;
mod one_sided;
mod own_steps;
mod pace;
mod pairs;
mod partition;
mod portions;
mod reaction;
mod reflection;
mod settle;
mod setup;
pub mod snapshot;
mod start;
pub(crate) mod statics;
mod tie;

pub use crate::subdomain::Partition;
pub use partition::PartitionReport;
pub use settle::{Relaxation, Settled};
pub use setup::{Guard, Parts, Plan, TimeStep};

use crate::interface::Interface;
use crate::interface::joint::Joint;
use crate::phase::Phase;
use crate::subdomain::Subdomain;
use crate::{Error, Real, Result, parallel, ranks};
use ledger::{DisplacementJump, EnergySample, Ledger, WorkLine};
use observer::{Observer, StepReport};
use own_steps::{Held, Lockstep};
use pairs::Pair;
use sprs::CsMat;
use std::ops::ControlFlow;

/// Share of the energy in play that effects may create. Sound laws create none but for round-off and for what forces
/// unknown to them do within a step (multipliers): decision 0011 has the figures.
const CREATED: f64 = 1e-3;

/// Last digits of energies that are none, and of the motion they set off.
const ROUND_OFF: f64 = 16.0;

/// A ready coupled run.
#[derive(Debug)]
pub struct Coupled<T: Real> {
    pub(crate) subdomains: Vec<Subdomain<T>>,
    pub(crate) interfaces: Vec<Interface<T>>,
    /// Those that share nodes, solved for together.
    joints: Vec<Joint<T>>,
    /// What their multipliers do to moving supports.
    held: Vec<Held<T>>,
    /// Their nodes under multipliers.
    overlaps: Vec<apart::Overlap<T>>,
    /// Subdomains that step together.
    lockstep: Vec<Lockstep>,
    /// Effects between two subdomains.
    pub(crate) pairs: Vec<Pair<T>>,
    pub(crate) critical: Vec<T>,
    pub(crate) dt: T,
    pub(crate) time: T,
    pub(crate) start_time: T,
    pub(crate) step: usize,
    pub(crate) guard: Guard<T>,
    pub(crate) ledger: Ledger<T>,
    pub(crate) start_loss: T,
    /// Energy that last digits of displacements and places may be worth \[J\]: it is none.
    pub(crate) rounded: T,
    pub(crate) partition: Vec<PartitionReport>,
    pub(crate) work: Vec<T>,
    /// The static system that was solved last, and its factor.
    factored: Option<statics::Factored<T>>,
}

impl<T: Real> Coupled<T> {
    /// Subdomains in the order they were given.
    pub fn subdomains(&self) -> &[Subdomain<T>] {
        &self.subdomains
    }
    /// Interfaces in the order they were given.
    pub fn interfaces(&self) -> &[Interface<T>] {
        &self.interfaces
    }
    /// Step of the run \[s\]: the time between two reflections.
    pub fn dt(&self) -> T {
        self.dt
    }
    /// Current time \[s\].
    pub fn time(&self) -> T {
        self.time
    }
    /// Steps made so far.
    pub fn steps(&self) -> usize {
        self.step
    }
    /// Critical step of every subdomain \[s\].
    pub fn critical_steps(&self) -> &[T] {
        &self.critical
    }
    /// Kinetic energy that the projection of an inconsistent initial velocity removed \[J\].
    pub fn start_loss(&self) -> T {
        self.start_loss
    }
    /// What the check found that weights sum to one, by groups of models that are tied to each other.
    pub fn partition(&self) -> &[PartitionReport] {
        &self.partition
    }
    /// `S = B_C M_C⁻¹ B_Cᵀ + B_D M_D⁻¹ B_Dᵀ` of one interface, symmetric, rows and columns in the order of
    /// [`Interface::multipliers`]; `A = Δt/2 S`. Assembled anew at every call; `None` if there is no such interface, or
    /// where a model of it is in parts.
    pub fn multiplier_operator(&self, interface: usize) -> Option<CsMat<T>> {
        let i = self
            .interfaces
            .get(interface)
            .filter(|i| !i.coupling.in_parts())?;
        let inverse = i.sides.map(|s| self.subdomains[s].inverse_inertia());
        Some(i.operator_matrix(inverse))
    }
    /// Largest relative drift of the energy balance so far.
    pub fn drift(&self) -> T {
        self.ledger.top_drift
    }
    /// Largest share of the energy in play that effects have created so far, of those that must not
    /// ([`Coupled::created`]), at the steps where the ledger was drawn.
    pub fn top_created(&self) -> T {
        self.ledger.top_created
    }
    /// Largest relative constraint residual so far.
    pub fn constraint_residual(&self) -> T {
        self.ledger.top_residual
    }
    /// Largest jump of displacements so far across every interface, at the steps where the ledger was drawn.
    pub fn displacement_jumps(&self) -> &[DisplacementJump<T>] {
        &self.ledger.jumps
    }
    /// Last sample of the ledger.
    pub fn last_energy(&self) -> Option<&EnergySample<T>> {
        self.ledger.last.as_ref()
    }
    /// Kinetic plus internal energy of all subdomains at the whole step \[J\].
    pub fn energy(&self) -> T {
        self.subdomains
            .iter()
            .map(|s| s.kinetic_energy() + s.internal_energy())
            .sum()
    }
    /// Linear and angular momentum of all subdomains about the origin, each with the arms of its model; see
    /// [`Coupled::bodies`] for what is kept.
    pub fn momentum(&self) -> [nalgebra::Vector3<T>; 2] {
        let zero = nalgebra::Vector3::zeros();
        self.subdomains
            .iter()
            .map(Subdomain::momentum)
            .fold([zero, zero], |a, b| [a[0] + b[0], a[1] + b[1]])
    }

    /// The works of the ledger: every effect, the moving supports, the constraint.
    pub fn works(&self) -> Vec<WorkLine<T>> {
        let mut lines: Vec<_> = self
            .effects()
            .into_iter()
            .filter_map(|e| {
                let work = e.work?;
                Some(WorkLine { name: e.name, work })
            })
            .collect();
        if self
            .subdomains
            .iter()
            .any(|s| s.supports().iter().any(|m| m.amplitude != T::zero()))
        {
            lines.push(WorkLine {
                name: "supports".into(),
                work: self.ledger.supports,
            });
        }
        if !self.interfaces.is_empty() {
            lines.push(WorkLine {
                name: "constraint".into(),
                work: self.ledger.constraint,
            });
        }
        lines
    }

    /// Largest jump of velocity \[m/s\] and of displacement \[m\] across one interface.
    pub fn jumps(&mut self, interface: usize) -> [T; 2] {
        let i = &mut self.interfaces[interface];
        let [c, d] = i.sides;
        let (a, b) = (self.subdomains[c].state(), self.subdomains[d].state());
        let velocity = i.jump([&a.v, &b.v], &mut self.work);
        let displacement = i.jump([&a.q, &b.q], &mut self.work);
        [velocity, displacement]
    }

    /// Makes one step: the second half of the last reflection, the own steps of every subdomain, the first half of the next.
    ///
    /// # Errors
    /// Errors of models and effects, [`Error::Diverged`], [`Error::EnergyGrowth`].
    pub fn advance(&mut self, observer: &mut dyn Observer<T>) -> Result<StepReport<T>> {
        // Works are drawn up every step; the invariant costs two energy evaluations and is drawn every few.
        let draw = self.ledger.start.is_none() || (self.step + 1).is_multiple_of(self.guard.interval);
        observer.phase(Phase::Interface);
        self.kick_again();
        self.own_steps_of_all(draw, &mut |phase| observer.phase(phase))?;
        let invariant: Option<T> = draw.then(|| self.subdomains.iter_mut().map(Subdomain::invariant).sum());
        observer.phase(Phase::Interface);
        self.reflect()?;
        self.step += 1;
        self.time = self.instant(0);
        portions::heard(&self.subdomains)?;
        observer.phase(Phase::Ledger);
        // The invariant of this step is the one before the forces of the new instant did any work.
        let energy = invariant.map(|h| self.balance(h)).transpose()?;
        self.account();
        if draw {
            self.check_created()?;
        }
        Ok(StepReport {
            step: self.step,
            time: self.time,
            energy,
        })
    }

    /// Makes steps until the count is reached or the observer breaks; returns the number made.
    ///
    /// # Errors
    /// Those of [`Self::advance`] and of the observer.
    pub fn run(&mut self, steps: usize, observer: &mut dyn Observer<T>) -> Result<usize> {
        for made in 0..steps {
            let report = self.advance(observer)?;
            observer.phase(Phase::Observe);
            if let ControlFlow::Break(()) = observer.observe(self, &report)? {
                return Ok(made + 1);
            }
        }
        Ok(steps)
    }

    /// Adds the works of this instant, `Δt F_n·v_n`, with corrected velocities.
    fn account(&mut self) {
        for s in &mut self.subdomains {
            self.ledger.supports += s.account();
        }
        for p in &mut self.pairs {
            p.account(&self.subdomains);
        }
        for (i, held) in self.interfaces.iter().zip(&self.held) {
            let [c, d] = i.sides;
            let (a, b) = (self.subdomains[c].state(), self.subdomains[d].state());
            if i.is_alone() {
                self.ledger.constraint -= self.dt * i.power();
            }
            self.ledger.supports -= self.dt * held.power(i.multipliers(), [&a.v, &b.v]);
        }
        for j in &self.joints {
            self.ledger.constraint -= self.dt * j.power();
        }
    }

    /// Refuses effects that made energy from nothing.
    fn check_created(&mut self) -> Result<()> {
        let created = self.created();
        let (_, volume) = self.total_work();
        let reference = self.ledger.start.unwrap_or_default().abs().max(volume);
        if reference > T::zero() {
            let relative = created / reference;
            self.ledger.top_created = self.ledger.top_created.max(relative);
        }
        let share = self.guard.growth.min(T::of(CREATED));
        let bound = share * reference + self.rounded;
        if created <= bound || reference <= T::zero() {
            return Ok(());
        }
        Err(Error::EnergyGrowth {
            step: self.step,
            time: self.time.as_f64(),
            excess: created.as_f64(),
            bound: bound.as_f64(),
            percent: 100.0 * share.as_f64(),
        })
    }

    fn total_work(&self) -> (T, T) {
        let works = self
            .subdomains
            .iter()
            .flat_map(Subdomain::works)
            .chain(self.pairs.iter().map(|p| p.line.work()));
        let mut all = works.chain([self.ledger.supports, self.ledger.constraint]);
        all.by_ref()
            .fold((T::zero(), T::zero()), |(s, a), w| (s + w, a + w.abs()))
    }

    /// The error for a quantity that is no longer finite: of the first model with such a state, or with such an energy.
    fn diverged(&self, what: &'static str) -> Error {
        if let Err(e) = portions::heard(&self.subdomains) {
            return e;
        }
        let energy = |s: &Subdomain<T>| s.kinetic_energy() + s.drawn_energy();
        let all = || self.subdomains.iter();
        let found = all().find(|s| !s.is_finite());
        let found = found.or_else(|| all().find(|s| !energy(s).is_finite()));
        Error::Diverged {
            step: self.step,
            time: self.time.as_f64(),
            what,
            model: found.map_or_else(String::new, |s| s.model().name().to_owned()),
        }
    }

    fn balance(&mut self, invariant: T) -> Result<EnergySample<T>> {
        // Of a velocity that is not finite the energy is not either.
        let kinetic: T = self.subdomains.iter().map(Subdomain::kinetic_energy).sum();
        if !kinetic.is_finite() {
            return Err(self.diverged("velocity"));
        }
        portions::agree(&self.subdomains, invariant, self.step)?;
        let residual = self.gaps();
        let (work, volume) = self.total_work();
        // Only a model that changed itself in the first step has done work before the first drawing.
        let start = *self.ledger.start.get_or_insert(invariant - work);
        let drift = invariant - start - work;
        let scale = self.ledger.scale.max(start.abs());
        let scale = scale.max(invariant.abs()).max(volume);
        self.ledger.scale = scale;
        let relative = if scale > T::zero() {
            drift / scale
        } else {
            T::zero()
        };
        self.ledger.top_drift = self.ledger.top_drift.max(relative.abs());
        self.ledger.top_residual = self.ledger.top_residual.max(residual);
        let sample = EnergySample {
            step: self.step,
            time: self.time,
            kinetic,
            internal: self.subdomains.iter().map(|s| s.drawn_energy()).sum(),
            invariant,
            work,
            drift,
            relative_drift: relative,
            momentum_drift: self.momentum_drift(),
            constraint_residual: residual,
        };
        if !drift.is_finite() {
            return Err(self.diverged("energy"));
        }
        // Growth is measured against what was put in, not against the (growing) energy itself.
        self.bounded(drift, start.abs().max(volume))?;
        self.ledger.last = Some(sample.clone());
        Ok(sample)
    }

    /// Looks at the jumps of all interfaces; that of velocities over the largest speed so far.
    fn gaps(&mut self) -> T {
        let speed = |s: &Subdomain<T>| {
            let own = parallel::largest(&s.state().v[..s.model().layout().translations()]);
            ranks::largest(s.portion(), own)
        };
        let speeds = self.subdomains.iter().map(speed);
        let top = speeds.fold(self.ledger.top_velocity, |a, b| a.max(b));
        self.ledger.top_velocity = top;
        let mut residual = T::zero();
        for k in 0..self.interfaces.len() {
            let [velocity, displacement] = self.jumps(k);
            residual = residual.max(velocity);
            let sides = self.interfaces[k].sides().map(|s| &self.subdomains[s]);
            let own = sides.map(Subdomain::own_steps);
            let steps = self.step * own[0].max(own[1]);
            self.overlaps[k].look(sides, displacement, steps, &mut self.ledger.jumps[k]);
        }
        if top > T::zero() { residual / top } else { residual }
    }

    /// Largest of all bodies, of linear and of angular momentum.
    fn momentum_drift(&mut self) -> [T; 2] {
        let finest = self.subdomains.iter().map(Subdomain::own_steps).max();
        let finest = T::of(finest.unwrap_or(1) as f64);
        let rate = T::of(self.step as f64) * finest * finest / self.dt;
        let mut drift = [T::zero(); 2];
        for b in &mut self.ledger.bodies {
            let one = b.balance(&self.subdomains, rate);
            (0..2).for_each(|k| drift[k] = drift[k].max(one[k]));
        }
        drift
    }

    /// Whether the energy has grown no more than the guard allows.
    fn bounded(&self, drift: T, reference: T) -> Result<()> {
        let bound = self.guard.growth * reference + self.rounded;
        if reference > T::zero() && drift > bound {
            return Err(Error::EnergyGrowth {
                step: self.step,
                time: self.time.as_f64(),
                excess: drift.as_f64(),
                bound: bound.as_f64(),
                percent: 100.0 * self.guard.growth.as_f64(),
            });
        }
        Ok(())
    }
}

/// Two different subdomains at once.
pub(crate) fn pair<T: Real>(all: &mut [Subdomain<T>], a: usize, b: usize) -> [&mut Subdomain<T>; 2] {
    let (low, high) = (a.min(b), a.max(b));
    let (head, tail) = all.split_at_mut(high);
    if a < b {
        [&mut head[low], &mut tail[0]]
    } else {
        [&mut tail[0], &mut head[low]]
    }
}

//! The coupled run: several subdomains, several interfaces, and reflections between them.
//!
//! ```text
//! every subdomain m      own steps Δt_m = ΔT/m of velocity Verlet with its own forces, from v⁺ to v⁻
//! every interface        v⁺ = (I − 2P) v⁻,   P = M⁻¹BᵀS⁻¹B,   S = B M⁻¹ Bᵀ;   at the instant v = (I − P) v⁻
//! ```
//!
//! A reflection keeps the kinetic energy `½vᵀMv` of both sides together and changes no displacement. Each
//! subdomain keeps an invariant over its own steps, so the sum of all invariants is kept for any own steps
//! ([`crate::ledger`]). With one own step for every subdomain the scheme is RATTLE for linear velocity
//! constraints. It filters nothing.

mod apart;
mod balance;
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
mod relax;
mod rezone;
mod settle;
mod setup;
pub mod snapshot;
mod start;
pub(crate) mod statics;
mod tie;
pub(crate) mod warning;

pub use crate::subdomain::Partition;
pub use partition::PartitionReport;
pub use rezone::{Response, Rezoned, Rezoning};
pub use settle::{Relaxation, Settled};
pub use setup::{Guard, Parts, Plan, TimeStep};

#[cfg(doc)]
use crate::Error;
use crate::interface::Interface;
use crate::interface::joint::Joint;
use crate::phase::Phase;
use crate::subdomain::Subdomain;
use crate::{Real, Result};
use ledger::{DisplacementJump, EnergySample, Ledger, WorkLine};
use observer::{Observer, StepReport};
use own_steps::{Held, Lockstep};
use pairs::Pair;
use sprs::CsMat;
use std::ops::ControlFlow;
use warning::Warning;

/// Multiple of the estimated round-off of an energy below which the energy counts as zero.
const ROUND_OFF: f64 = 16.0;

/// A ready coupled run.
#[derive(Debug)]
pub struct Coupled<T: Real> {
    pub(crate) subdomains: Vec<Subdomain<T>>,
    pub(crate) interfaces: Vec<Interface<T>>,
    /// Groups of interfaces that share nodes, each solved as one system.
    joints: Vec<Joint<T>>,
    /// Coupling of each interface to moving supports.
    held: Vec<Held<T>>,
    /// Nodes of each interface that multipliers act on.
    overlaps: Vec<apart::Overlap<T>>,
    /// Groups of subdomains that step together.
    lockstep: Vec<Lockstep>,
    /// Pair effects: they act between two subdomains.
    pub(crate) pairs: Vec<Pair<T>>,
    pub(crate) critical: Vec<T>,
    /// For each critical step: whether it is a lower bound.
    pub(crate) bounded: Vec<bool>,
    pub(crate) dt: T,
    pub(crate) time: T,
    pub(crate) start_time: T,
    pub(crate) step: usize,
    pub(crate) guard: Guard<T>,
    pub(crate) ledger: Ledger<T>,
    pub(crate) start_loss: T,
    /// Energies below this are round-off \[J\].
    pub(crate) rounded: T,
    pub(crate) partition: Vec<PartitionReport>,
    pub(crate) work: Vec<T>,
    /// True if steps are compared with critical steps ([`TimeStep::Unchecked`]).
    is_checked: bool,
    /// Changes of weights so far.
    conversions: rezone::Conversions<T>,
    /// Warnings so far; an observer has received the first `warnings_sent` of them.
    warnings: Vec<Warning>,
    warnings_sent: usize,
    /// Matrix and factor of the last static solution.
    factored: Option<statics::Factored<T>>,
    /// True once a direct solution was singular: the next load steps are relaxed too.
    relaxes: bool,
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
    /// Macro step (step of the run) \[s\]: the time between two reflections.
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
    /// Critical step of each subdomain \[s\]; a lower bound of it where the step was given in seconds and
    /// does not exceed the bound ([`Plan::bounded`]).
    pub fn critical_steps(&self) -> &[T] {
        &self.critical
    }
    /// Kinetic energy that the projection of an inconsistent initial velocity removed \[J\].
    pub fn start_loss(&self) -> T {
        self.start_loss
    }
    /// Reports of the check that weights sum to one, one for each group of models that are tied to each
    /// other.
    pub fn partition(&self) -> &[PartitionReport] {
        &self.partition
    }
    /// Operator `S = B_C M_C⁻¹ B_Cᵀ + B_D M_D⁻¹ B_Dᵀ` of one interface, symmetric, with rows and columns in
    /// the order of [`Interface::multipliers`]. The multipliers solve `A λ = B v⁻` with `A = ΔT/2 S`. Each
    /// call assembles it anew. `None` if the interface does not exist or one of its models is partitioned.
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
    /// Largest energy that effects have created so far though they must not ([`Coupled::created`]), relative
    /// to the energy in play, at the steps where the ledger was evaluated.
    pub fn top_created(&self) -> T {
        self.ledger.top_created
    }
    /// Largest relative constraint residual so far.
    pub fn constraint_residual(&self) -> T {
        self.ledger.top_residual
    }
    /// Largest displacement jump so far across each interface, at the steps where the ledger was evaluated.
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
    /// Linear \[kg m/s\] and angular momentum \[kg m²/s\] of all subdomains about the origin, each with the
    /// arms of its model. [`Coupled::bodies`] says which momenta are kept.
    pub fn momentum(&self) -> [nalgebra::Vector3<T>; 2] {
        let zero = nalgebra::Vector3::zeros();
        self.subdomains
            .iter()
            .map(Subdomain::momentum)
            .fold([zero, zero], |a, b| [a[0] + b[0], a[1] + b[1]])
    }

    /// Works of the ledger: one line for each effect, one for the moving supports, one for the constraint.
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
        // A table of the works has one column from the start.
        let may_change = self.subdomains.iter().any(Subdomain::has_sleep);
        let none = may_change.then(T::zero);
        if let Some(work) = self.conversions.work().or(none) {
            let name = "rezoning".into();
            lines.push(WorkLine { name, work });
        }
        lines
    }

    /// Largest velocity jump \[m/s\] and displacement jump \[m\] across one interface.
    pub fn jumps(&mut self, interface: usize) -> [T; 2] {
        let i = &mut self.interfaces[interface];
        let [c, d] = i.sides;
        let (a, b) = (self.subdomains[c].state(), self.subdomains[d].state());
        let velocity = i.jump([&a.v, &b.v], &mut self.work);
        let displacement = i.jump([&a.q, &b.q], &mut self.work);
        [velocity, displacement]
    }

    /// Makes one macro step: the second half of the last reflection, the own steps of every subdomain, the
    /// first half of the next reflection.
    ///
    /// # Errors
    /// Errors of models and effects, [`Error::Diverged`], [`Error::EnergyGrowth`], [`Error::EnergyLoss`],
    /// [`Error::MultipliersUnsolved`], [`Error::ImpulseMissed`].
    pub fn advance(&mut self, observer: &mut dyn Observer<T>) -> Result<StepReport<T>> {
        // Works are summed in every step. The invariant costs two energy evaluations, so it is evaluated
        // every few steps, and in the first one, which sets the reference.
        let draw = self.ledger.start.is_none() || (self.step + 1).is_multiple_of(self.guard.interval);
        self.send_warnings(observer);
        observer.phase(Phase::Interface);
        self.apply_second_half();
        self.own_steps_of_all(draw, &mut |phase| observer.phase(phase))?;
        let drawn = draw.then(|| self.draw_invariants());
        observer.phase(Phase::Interface);
        self.reflect()?;
        self.step += 1;
        self.time = self.instant(0);
        // After a failed exchange sums are NaN: report the exchange before a check finds the NaN.
        portions::check_communication(&self.subdomains)?;
        observer.phase(Phase::Ledger);
        self.check_multipliers()?;
        // The invariant was taken before the forces of the new instant did work, so the balance comes before
        // `account`.
        let energy = drawn.map(|d| self.balance(d)).transpose()?;
        self.account();
        if draw {
            self.check_created()?;
            self.check_impulses()?;
        }
        self.send_warnings(observer);
        Ok(StepReport {
            step: self.step,
            time: self.time,
            energy,
        })
    }

    /// Makes macro steps until the count is reached or the observer breaks; returns the number of steps made.
    ///
    /// # Errors
    /// Errors of [`Self::advance`] and of the observer.
    pub fn run(&mut self, steps: usize, observer: &mut dyn Observer<T>) -> Result<usize> {
        for done in 0..steps {
            let report = self.advance(observer)?;
            observer.phase(Phase::Observe);
            if let ControlFlow::Break(()) = observer.observe(self, &report)? {
                return Ok(done + 1);
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
            // Interfaces in a joint have one power together, below.
            if i.is_alone() {
                self.ledger.constraint -= self.dt * i.power();
            }
            // Multipliers push on moving supports too, and the supports do the opposite work.
            self.ledger.supports -= self.dt * held.power(i.multipliers(), [&a.v, &b.v]);
        }
        for j in &self.joints {
            self.ledger.constraint -= self.dt * j.power();
        }
    }
}

/// Returns two different subdomains, both mutable, in the order of the arguments.
pub(crate) fn pair<T: Real>(subdomains: &mut [Subdomain<T>], a: usize, b: usize) -> [&mut Subdomain<T>; 2] {
    let (low, high) = (a.min(b), a.max(b));
    let (head, tail) = subdomains.split_at_mut(high);
    if a < b {
        [&mut head[low], &mut tail[0]]
    } else {
        [&mut tail[0], &mut head[low]]
    }
}

//! The coupled run: several subdomains, several interfaces, and reflections between them.
//!
//! ```text
//! every subdomain m      own steps Δt_m = ΔT/m of velocity Verlet with its own forces, from v⁺ to v⁻
//! every interface        v⁺ = (I − 2P) v⁻,   P = M⁻¹BᵀS⁻¹B,   S = B M⁻¹ Bᵀ;   at the instant v = (I − P) v⁻
//! ```
//!
//! A reflection keeps `½vᵀMv` of both sides together and moves nothing, so that the sum of the invariants
//! that subdomains keep on their own is kept for any own steps ([`crate::ledger`]). With one own step for
//! all it is RATTLE for linear velocity constraints. It filters nothing.

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
mod settle;
mod setup;
pub mod snapshot;
mod start;
pub(crate) mod statics;
mod tie;
pub(crate) mod warning;

pub use crate::subdomain::Partition;
pub use partition::PartitionReport;
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
    /// What a user should know, and how much of it an observer has heard.
    warnings: Vec<Warning>,
    told: usize,
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
    /// [`Interface::multipliers`]; `A = Δt/2 S`. Assembled anew at every call; `None` if there is no such
    /// interface, or where a model of it is in parts.
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

    /// Makes one step: the second half of the last reflection, the own steps of every subdomain, the first
    /// half of the next.
    ///
    /// # Errors
    /// Errors of models and effects, [`Error::Diverged`], [`Error::EnergyGrowth`], [`Error::EnergyLoss`],
    /// [`Error::MultipliersUnsolved`], [`Error::ImpulseMissed`].
    pub fn advance(&mut self, observer: &mut dyn Observer<T>) -> Result<StepReport<T>> {
        // Works are drawn up every step; the invariant costs two energy evaluations and is drawn every few.
        let draw = self.ledger.start.is_none() || (self.step + 1).is_multiple_of(self.guard.interval);
        self.tell_warnings(observer);
        observer.phase(Phase::Interface);
        self.kick_again();
        self.own_steps_of_all(draw, &mut |phase| observer.phase(phase))?;
        let drawn = draw.then(|| self.draw_invariants());
        observer.phase(Phase::Interface);
        self.reflect()?;
        self.step += 1;
        self.time = self.instant(0);
        portions::heard(&self.subdomains)?;
        observer.phase(Phase::Ledger);
        self.check_multipliers()?;
        // The invariant of this step is the one before the forces of the new instant did any work.
        let energy = drawn.map(|d| self.balance(d)).transpose()?;
        self.account();
        if draw {
            self.check_created()?;
            self.check_impulses()?;
        }
        self.tell_warnings(observer);
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

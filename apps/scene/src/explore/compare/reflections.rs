//! The stepping of most methods: own steps of each model between reflections at the constraint.

use super::method::{Coupling, State};
use super::sparse::{add, constraint, product, transposed};
use super::system::{Motion, System};
use super::tie::Tie;
use crate::error::Result;
use arlequin::core::sprs::CsMat;

/// Own step of the finest model over its critical step, as runs have it.
const SHARE: f64 = 0.9;
/// Most own steps within a step of a run.
pub(super) const MOST_OWN: usize = 4;

/// Step of the run \[s\] and own steps of the fine model within it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    pub(super) step: f64,
    pub(super) own: usize,
    /// Critical step of the finest model \[s\].
    pub(super) critical: f64,
}

impl Pace {
    fn new(critical: f64, own: usize) -> Self {
        Self {
            step: SHARE * critical * own as f64,
            own,
            critical,
        }
    }

    /// One step for all unknowns of a system.
    pub(super) fn common(system: &System) -> Result<Self> {
        Ok(Self::new(system.critical(0..system.size())?, 1))
    }

    /// Own steps as a run chooses them: at most `most` of the fine model, within half of the coarse critical
    /// step.
    pub(super) fn split(system: &System, most: usize) -> Result<Self> {
        let [coarse, fine] = system.sides().map(|side| system.critical(side));
        let (coarse, fine) = (coarse?, fine?);
        let critical = coarse.min(fine);
        let own = (0.5 * coarse / (SHARE * critical)) as usize;
        Ok(Self::new(critical, own.clamp(1, most)))
    }

    /// Own step of the fine model \[s\].
    pub(super) fn own_step(&self) -> f64 {
        self.step / self.own as f64
    }
}

/// Velocity Verlet of both models with reflections `v ← v − 2 W Gᵀ R G v` between macro steps.
#[derive(Debug)]
pub(super) struct Reflections {
    pub(super) system: System,
    pub(super) tie: Tie,
    /// True if multipliers correct velocities only.
    pub(super) once: bool,
    /// True if an equilibrium minimises an energy: the stiffness is symmetric.
    pub(super) symmetric: bool,
    /// `T`, if the system is that of `p` in `T p`.
    pub(super) lift: Option<CsMat<f64>>,
    /// Half of the last reflection.
    pub(super) kick: Vec<f64>,
    pub(super) state: State,
}

impl Reflections {
    /// Makes the stepping of a system with a constraint.
    pub(super) fn new(system: System, tie: Tie, pace: Pace) -> Self {
        Self {
            state: State::new(system.clone(), pace),
            kick: vec![0.0; system.size()],
            once: false,
            symmetric: true,
            lift: None,
            system,
            tie,
        }
    }

    /// Makes the stepping of a system without a constraint.
    pub(super) fn free(system: System) -> Result<Self> {
        let tie = Tie::exact(CsMat::zero((0, system.size())), &system.inverse)?;
        let pace = Pace::common(&system)?;
        Ok(Self::new(system, tie, pace))
    }

    /// Makes the stepping of `Tᵀ K T` with masses `Tᵀ m`, `q = T p`: some unknowns follow others.
    pub(super) fn following(whole: System, followers: &CsMat<f64>) -> Result<Self> {
        let lift: CsMat<f64> = &constraint(followers) + &CsMat::<f64>::eye(whole.size());
        let back = transposed(&lift);
        let stiffness = &(&back * &whole.stiffness) * &lift;
        let mass = product(&back, &whole.mass);
        let top = mass.iter().fold(0.0_f64, |a, b| a.max(*b));
        // A node that nothing follows has neither mass nor stiffness.
        let full = mass.iter().map(|m| if *m > 1e-12 * top { *m } else { top });
        let full: Vec<f64> = full.collect();
        let system = System::new((whole.places.clone(), whole.split), mass, &full, stiffness);
        let free = Self::free(system)?;
        Ok(Self {
            state: State::new(whole, free.state.pace),
            lift: Some(lift),
            ..free
        })
    }

    /// Reflects velocities at the constraint, and moves the unknowns that follow others.
    fn reflect(&mut self) {
        let now = &mut self.state.now;
        if self.tie.rows.rows() > 0 {
            self.kick = self.tie.kick(&now.v, &self.system.inverse);
            add(&mut now.v, -1.0, &self.kick);
        }
        if let Some(lift) = &self.lift {
            (now.q, now.v) = (product(lift, &now.q), product(lift, &now.v));
        }
    }
}

impl Coupling for Reflections {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let inverse = &self.system.inverse;
        let weighted = |(x, w): (&f64, &f64)| if *w > 0.0 { *x } else { 0.0 };
        let [mut q, v]: [Vec<f64>; 2] = [q, v].map(|x| x.iter().zip(inverse).map(weighted).collect());
        self.tie.project(&mut q, inverse);
        self.state.now = Motion::new(q, v);
        self.reflect();
        self.system.accelerate(&mut self.state.now, 0..self.system.size());
        // The start is consistent: the first half reflection takes the jump of the accelerations.
        if !self.once {
            let jump = self.tie.kick(&self.state.now.a, &self.system.inverse);
            self.kick = jump.iter().map(|k| k * (0.5 * self.state.pace.step)).collect();
        }
    }

    fn advance(&mut self) {
        let (all, [coarse, fine]) = (0..self.system.size(), self.system.sides());
        let (now, Pace { step, own, .. }) = (&mut self.state.now, self.state.pace);
        if !self.once {
            add(&mut now.v, -1.0, &self.kick);
        }
        if own == 1 {
            self.system.step(now, all, step);
        } else {
            self.system.step(now, coarse, step);
            let dt = self.state.pace.own_step();
            (0..own).for_each(|_| self.system.step(now, fine.clone(), dt));
        }
        self.reflect();
    }

    fn state(&self) -> &State {
        &self.state
    }

    /// `Σ ½ v₊ᵀMv₊ + ½ qᵀ(K − ¼Δt²KM⁻¹K)q` over the models, with the velocities after a reflection.
    fn energy(&self) -> f64 {
        let Motion { q, v, a } = &self.state.now;
        let steps = [self.state.pace.step, self.state.pace.own_step()];
        let term = |i: usize| {
            let dt = steps[usize::from(i >= self.system.split)];
            let after = v[i] - if self.once { 0.0 } else { self.kick[i] };
            0.5 * self.system.mass[i] * (after * after - q[i] * a[i] - 0.25 * dt * dt * a[i] * a[i])
        };
        self.system.weighted().map(term).sum()
    }

    fn work(&self) -> f64 {
        self.system.work(self.state.pace.own) + self.tie.work()
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        if !self.symmetric {
            return Ok(None);
        }
        let q = self.system.equilibrium(q.to_vec(), held, &self.tie.rows)?;
        Ok(Some(self.lift.iter().fold(q, |q, lift| product(lift, &q))))
    }
}

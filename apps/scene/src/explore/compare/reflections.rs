//! The stepping of most methods: own steps of each model between reflections at the constraint.

use super::method::Coupling;
use super::sparse::product;
use super::system::{Lift, Motion, System};
use super::tie::Tie;
use crate::error::Result;

/// Own step of the finest model over its critical step, as runs have it.
pub(super) const SHARE: f64 = 0.9;
/// Most own steps within a step of the run.
const MOST_OWN: usize = 4;

/// Step of the run \[s\] and own steps of the fine model within it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    pub(super) step: f64,
    pub(super) own: usize,
    /// Critical step of the finest model \[s\].
    pub(super) critical: f64,
}

impl Pace {
    /// One step for all unknowns of a system.
    pub(super) fn common(system: &System) -> Result<Self> {
        let critical = system.critical(0..system.size())?;
        Ok(Self {
            step: SHARE * critical,
            own: 1,
            critical,
        })
    }

    /// Own steps as a run chooses them: at most four of the fine model, within half of the coarse critical
    /// step.
    pub(super) fn split(system: &System) -> Result<Self> {
        Self::at_most(MOST_OWN, system)
    }

    /// At most `most` own steps of the fine model within half of the coarse critical step.
    pub(super) fn at_most(most: usize, system: &System) -> Result<Self> {
        let split = system.places.split;
        let coarse = system.critical(0..split)?;
        let fine = system.critical(split..system.size())?;
        let critical = coarse.min(fine);
        let own = ((0.5 * coarse / (SHARE * critical)) as usize).clamp(1, most);
        Ok(Self {
            step: SHARE * critical * own as f64,
            own,
            critical,
        })
    }
}

/// Velocity Verlet of both models with reflections `v ← v − 2 W Gᵀ R G v` between macro steps.
#[derive(Debug)]
pub(super) struct Reflections {
    system: System,
    tie: Option<Tie>,
    /// True if multipliers correct velocities only.
    once: bool,
    lift: Option<Lift>,
    pace: Pace,
    now: Motion,
    /// Half of the last reflection.
    kick: Vec<f64>,
    /// True if the stiffness is symmetric, so that an equilibrium minimises an energy.
    symmetric: bool,
}

impl Reflections {
    /// Makes the stepping of a system with a constraint.
    pub(super) fn new(system: System, tie: Option<Tie>, pace: Pace) -> Self {
        Self {
            now: Motion::default(),
            kick: vec![0.0; system.size()],
            once: false,
            symmetric: true,
            lift: None,
            system,
            tie,
            pace,
        }
    }

    /// Makes the stepping of the free unknowns of a system, which the others follow.
    pub(super) fn of_free(lift: Lift) -> Result<Self> {
        let system = lift.reduced();
        let pace = Pace::common(&system)?;
        Ok(Self {
            lift: Some(lift),
            ..Self::new(system, None, pace)
        })
    }

    /// Lets multipliers correct velocities only.
    pub(super) fn once(mut self) -> Self {
        self.once = true;
        self
    }

    /// Declares that forces derive from no energy.
    pub(super) fn without_energy(mut self) -> Self {
        self.symmetric = false;
        self
    }

    fn reflect(&mut self) {
        if let Some(t) = &self.tie {
            self.kick = t.kick(&self.now.v, &self.system.inverse);
            subtract(&mut self.now.v, &self.kick);
        }
    }
}

impl Coupling for Reflections {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let n = self.system.size();
        let free = |x: &[f64]| {
            let mut x = self.lift.as_ref().map_or_else(|| x.to_vec(), |l| l.free(x));
            let without_weight = x.iter_mut().zip(&self.system.inverse).filter(|(_, w)| **w == 0.0);
            without_weight.for_each(|(x, _)| *x = 0.0);
            x
        };
        let (mut q, v, a) = (free(q), free(v), vec![0.0; n]);
        if let Some(t) = &self.tie {
            t.project(&mut q, &self.system.inverse);
        }
        self.now = Motion { q, v, a };
        self.reflect();
        self.system.accelerate(&mut self.now, 0..n);
        // The start is consistent: the first half reflection takes the jump of the accelerations.
        if let Some(t) = self.tie.as_ref().filter(|_| !self.once) {
            let half = -0.5 * self.pace.step;
            self.kick = t.kick(&self.now.a, &self.system.inverse);
            self.kick.iter_mut().for_each(|k| *k *= -half);
        }
    }

    fn advance(&mut self) {
        if !self.once {
            subtract(&mut self.now.v, &self.kick);
        }
        let (n, split) = (self.system.size(), self.system.places.split);
        let Pace { step, own, .. } = self.pace;
        let sides = if own == 1 {
            vec![(0..n, 1)]
        } else {
            vec![(0..split, 1), (split..n, own)]
        };
        for (range, own) in sides {
            for _ in 0..own {
                System::drift(&mut self.now, range.clone(), step / own as f64);
                self.system.kick(&mut self.now, range.clone(), step / own as f64);
            }
        }
        self.reflect();
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    fn whole(&self) -> &System {
        self.lift.as_ref().map_or(&self.system, |l| &l.whole)
    }

    fn motion(&self) -> [Vec<f64>; 2] {
        self.now.pair().map(|x| match &self.lift {
            None => x,
            Some(l) => product(&l.rows, &x),
        })
    }

    /// `Σ ½ v₊ᵀMv₊ + ½ qᵀ(K − ¼Δt²KM⁻¹K)q` over the models, with the velocities after a reflection.
    fn energy(&self) -> f64 {
        let term = |i: usize| {
            let own = if i < self.system.places.split {
                1
            } else {
                self.pace.own
            };
            let dt = self.pace.step / own as f64;
            let after = self.now.v[i] - if self.once { 0.0 } else { self.kick[i] };
            let (q, a) = (self.now.q[i], self.now.a[i]);
            0.5 * self.system.mass[i] * (after * after - q * a - 0.25 * dt * dt * a * a)
        };
        let all = 0..self.system.size();
        all.filter(|i| self.system.inverse[*i] > 0.0).map(term).sum()
    }

    fn work(&self) -> f64 {
        self.system.work(self.pace.own) + self.tie.as_ref().map_or(0.0, Tie::work)
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        if !self.symmetric {
            return Ok(None);
        }
        let rows = self.tie.as_ref().map(|t| &t.rows);
        let Some(lift) = &self.lift else {
            return self.system.equilibrium(q.to_vec(), held, rows).map(Some);
        };
        let held: Vec<bool> = lift.kept.iter().map(|k| held[*k]).collect();
        let p = self.system.equilibrium(lift.free(q), &held, rows)?;
        Ok(Some(product(&lift.rows, &p)))
    }
}

fn subtract(x: &mut [f64], change: &[f64]) {
    x.iter_mut().zip(change).for_each(|(x, c)| *x -= c);
}

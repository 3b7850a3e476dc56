//! The stepping of most methods: own steps of each model between reflections at the constraint.

use super::method::Coupling;
use super::sparse::add_product;
use super::system::{Lift, System};
use super::tie::Tie;
use crate::error::Result;
use std::ops::Range;

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
        Self::of_at_most(MOST_OWN, system)
    }

    /// At most `most` own steps of the fine model within half of the coarse critical step.
    pub(super) fn of_at_most(most: usize, system: &System) -> Result<Self> {
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
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    /// Half of the last reflection.
    kick: Vec<f64>,
    /// True if the stiffness is symmetric, so that an equilibrium minimises an energy.
    symmetric: bool,
}

impl Reflections {
    /// Makes the stepping of a system with a constraint.
    pub(super) fn new(system: System, tie: Option<Tie>, pace: Pace) -> Self {
        let zeros = || vec![0.0; system.size()];
        Self {
            q: zeros(),
            v: zeros(),
            a: zeros(),
            kick: zeros(),
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

    fn leap(&mut self, range: Range<usize>, dt: f64, steps: usize) {
        for _ in 0..steps {
            for i in range.clone() {
                self.v[i] += 0.5 * dt * self.a[i];
                self.q[i] += dt * self.v[i];
            }
            self.accelerate(range.clone());
            for i in range.clone() {
                self.v[i] += 0.5 * dt * self.a[i];
            }
        }
    }

    fn accelerate(&mut self, range: Range<usize>) {
        self.a[range.clone()].fill(0.0);
        add_product(&self.system.stiffness, &self.q, -1.0, range.clone(), &mut self.a);
        for i in range {
            self.a[i] *= self.system.inverse[i];
        }
    }

    fn reflect(&mut self) {
        if let Some(t) = &self.tie {
            self.kick = t.kick(&self.v, &self.system.inverse);
            self.v.iter_mut().zip(&self.kick).for_each(|(v, k)| *v -= k);
        }
    }
}

impl Coupling for Reflections {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let free = |x: &[f64]| self.lift.as_ref().map_or_else(|| x.to_vec(), |l| l.free(x));
        (self.q, self.v) = (free(q), free(v));
        for i in 0..self.system.size() {
            if self.system.inverse[i] == 0.0 {
                (self.q[i], self.v[i]) = (0.0, 0.0);
            }
        }
        if let Some(t) = &self.tie {
            t.project(&mut self.q, &self.system.inverse);
        }
        self.reflect();
        self.accelerate(0..self.system.size());
        // The start is consistent: the first half reflection takes the jump of the accelerations.
        if let Some(t) = self.tie.as_ref().filter(|_| !self.once) {
            let half = -0.5 * self.pace.step;
            self.kick = t.kick(&self.a, &self.system.inverse);
            self.kick.iter_mut().for_each(|k| *k *= -half);
        }
    }

    fn advance(&mut self) {
        if !self.once {
            self.v.iter_mut().zip(&self.kick).for_each(|(v, k)| *v -= k);
        }
        let (n, split) = (self.system.size(), self.system.places.split);
        let Pace { step, own, .. } = self.pace;
        if own == 1 {
            self.leap(0..n, step, 1);
        } else {
            self.leap(0..split, step, 1);
            self.leap(split..n, step / own as f64, own);
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
        [&self.q, &self.v].map(|x| match &self.lift {
            None => x.clone(),
            Some(l) => super::sparse::product(&l.rows, x),
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
            let after = self.v[i] - if self.once { 0.0 } else { self.kick[i] };
            let a = self.a[i];
            0.5 * self.system.mass[i] * (after * after - self.q[i] * a - 0.25 * dt * dt * a * a)
        };
        let all = 0..self.system.size();
        all.filter(|i| self.system.inverse[*i] > 0.0).map(term).sum()
    }

    fn momentum(&self) -> [f64; 2] {
        self.system.momentum(&self.v)
    }

    fn work(&self) -> f64 {
        let split = self.system.places.split;
        let rows = self.system.stiffness.indptr();
        let start = rows.raw_storage();
        let (coarse, all) = (start[split], start[self.system.size()]);
        let models = coarse + self.pace.own * (all - coarse);
        models as f64 + self.tie.as_ref().map_or(0.0, Tie::work)
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
        Ok(Some(super::sparse::product(&lift.rows, &p)))
    }
}

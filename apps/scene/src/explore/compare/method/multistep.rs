//! Multipliers at own steps in place of reflections: Gravouil and Combescure (2001), Prakash and Hjelmstad
//! (2004), both with the central difference scheme for either model.

use super::Coupling;
use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Pace;
use crate::explore::compare::sparse::{congruence, product, transposed};
use crate::explore::compare::system::{Motion, System};
use crate::explore::compare::tie::{Tie, pseudo_inverse};
use arlequin::core::sprs::{CsMat, TriMat};
use std::ops::Range;

/// Most own steps within a step of the run, one more than the default has; the published figures are for
/// five and ten.
const OWN: usize = 5;

/// The two schemes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Scheme {
    /// Velocities are equal at every own step of the fine model; between steps of the run the coarse
    /// velocity is linear in time. Loses energy.
    GravouilCombescure,
    /// Velocities are equal at steps of the run; multipliers are linear in time between them.
    PrakashHjelmstad,
}

/// Two models with multipliers at own steps.
#[derive(Debug)]
pub(super) struct Multistep {
    scheme: Scheme,
    system: System,
    /// Rows with the answer `λ = R b` to a jump of velocities.
    tie: Tie,
    /// Exact projection for the start.
    start: Tie,
    pace: Pace,
    /// Accelerations include the constraint's part.
    now: Motion,
    lambda: Vec<f64>,
    /// Coarse velocity at the last step of the run without its last multiplier.
    free: Vec<f64>,
}

impl Multistep {
    /// Couples by a scheme with at most `most` own steps within a step of the run.
    pub(super) fn new(case: &mut Case, scheme: Scheme) -> Result<Self> {
        let system = case.system(&case.weights())?;
        let rows = case.coupling(&system)?;
        let pace = Pace::at_most(OWN, &system)?;
        let start = Tie::exact(rows.clone(), &system.inverse)?;
        let mut out = Self {
            lambda: vec![0.0; rows.rows()],
            free: Vec::new(),
            tie: start.clone(),
            now: Motion::default(),
            scheme,
            system,
            start,
            pace,
        };
        let operator = out.operator(&rows);
        out.tie = Tie::responding(rows, &operator, &pseudo_inverse)?;
        Ok(out)
    }

    fn fine(&self) -> Range<usize> {
        self.system.places.split..self.system.size()
    }

    fn own_step(&self) -> f64 {
        self.pace.step / self.pace.own as f64
    }

    /// Velocity jump at the instant of the constraint for each unit multiplier.
    fn operator(&self, rows: &CsMat<f64>) -> CsMat<f64> {
        let back = transposed(rows);
        let split = self.system.places.split;
        let half = [0.5 * self.pace.step, 0.5 * self.own_step()];
        let scale = |(i, w): (usize, &f64)| half[usize::from(i >= split)] * w;
        let mut scaled: Vec<f64> = self.system.inverse.iter().enumerate().map(scale).collect();
        if self.scheme == Scheme::GravouilCombescure {
            return congruence(&back, &scaled);
        }
        // The fine model's answer to a multiplier that grows from zero over the step of the run.
        scaled[split..].fill(0.0);
        let mut out = TriMat::new((rows.rows(), rows.rows()));
        let coarse = congruence(&back, &scaled);
        coarse.iter().for_each(|(v, (i, j))| out.add_triplet(i, j, *v));
        let mut unit = vec![0.0; rows.rows()];
        let zeros = vec![0.0; self.system.size()];
        let rest = Motion {
            q: zeros.clone(),
            v: zeros.clone(),
            a: zeros,
        };
        for j in 0..rows.rows() {
            unit[j] = 1.0;
            let mut m = rest.clone();
            self.ramp(&mut m, &self.start.push(&unit, &self.system.inverse), None);
            unit[j] = 0.0;
            let answer = product(rows, &m.v);
            let entries = answer.iter().enumerate().filter(|(_, x)| **x != 0.0);
            entries.for_each(|(i, x)| out.add_triplet(i, j, -*x));
        }
        out.to_csr()
    }

    /// Makes a step without the constraint.
    fn predict(&self, m: &mut Motion, range: Range<usize>, dt: f64) {
        System::drift(m, range.clone(), dt);
        self.system.kick(m, range, dt);
    }

    /// Own steps of the fine model under multipliers that end as `end` and begin as `begin`, or as zero;
    /// both as accelerations `W Gᵀ λ`.
    fn ramp(&self, m: &mut Motion, end: &[f64], begin: Option<&[f64]>) {
        let (dt, own) = (self.own_step(), self.pace.own);
        for j in 1..=own {
            self.predict(m, self.fine(), dt);
            let s = j as f64 / own as f64;
            for i in self.fine() {
                let push = s * end[i] + begin.map_or(0.0, |b| (1.0 - s) * b[i]);
                m.a[i] -= push;
                m.v[i] -= 0.5 * dt * push;
            }
        }
    }

    fn advance_gc(&mut self) {
        let (split, own) = (self.system.places.split, self.pace.own);
        let (dt, step) = (self.own_step(), self.pace.step);
        let mut now = std::mem::take(&mut self.now);
        let before = std::mem::take(&mut self.free);
        self.predict(&mut now, 0..split, step);
        let free = now.v[..split].to_vec();
        for j in 1..=own {
            self.predict(&mut now, self.fine(), dt);
            let s = j as f64 / own as f64;
            for i in 0..split {
                now.v[i] = (1.0 - s) * before[i] + s * free[i];
            }
            let lambda = self.tie.solve(&product(&self.tie.rows, &now.v));
            let push = self.tie.push(&lambda, &self.system.inverse);
            for i in self.fine() {
                now.a[i] -= push[i];
                now.v[i] -= 0.5 * dt * push[i];
            }
            if j == own {
                for i in 0..split {
                    now.a[i] -= push[i];
                    now.v[i] = free[i] - 0.5 * step * push[i];
                }
            }
        }
        (self.now, self.free) = (now, free);
    }

    fn advance_ph(&mut self) {
        let (split, step) = (self.system.places.split, self.pace.step);
        let inverse = &self.system.inverse;
        let begin = self.tie.push(&self.lambda, inverse);
        let mut now = self.now.clone();
        self.predict(&mut now, 0..split, step);
        let mut free = now.clone();
        self.ramp(&mut free, &vec![0.0; inverse.len()], Some(&begin));
        let lambda = self.tie.solve(&product(&self.tie.rows, &free.v));
        let end = self.tie.push(&lambda, inverse);
        self.ramp(&mut now, &end, Some(&begin));
        for (i, push) in end[..split].iter().enumerate() {
            now.a[i] -= push;
            now.v[i] -= 0.5 * step * push;
        }
        (self.now, self.lambda) = (now, lambda);
    }
}

impl Coupling for Multistep {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let inverse = &self.system.inverse;
        let (mut q, mut v) = (q.to_vec(), v.to_vec());
        self.start.project(&mut q, inverse);
        self.start.project(&mut v, inverse);
        let mut now = Motion {
            a: vec![0.0; q.len()],
            q,
            v,
        };
        self.system.accelerate(&mut now, 0..inverse.len());
        self.lambda = self.start.solve(&product(&self.start.rows, &now.a));
        let push = self.start.push(&self.lambda, inverse);
        now.a.iter_mut().zip(&push).for_each(|(a, p)| *a -= p);
        let coarse = now.v.iter().zip(&push).take(self.system.places.split);
        self.free = coarse.map(|(v, p)| v + 0.5 * self.pace.step * p).collect();
        self.now = now;
    }

    fn advance(&mut self) {
        match self.scheme {
            Scheme::GravouilCombescure => self.advance_gc(),
            Scheme::PrakashHjelmstad => self.advance_ph(),
        }
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    fn whole(&self) -> &System {
        &self.system
    }

    fn motion(&self) -> [Vec<f64>; 2] {
        self.now.pair()
    }

    fn work(&self) -> f64 {
        let own = self.pace.own;
        // One scheme answers at every own step, the other makes the own steps of the fine model twice.
        match self.scheme {
            Scheme::GravouilCombescure => self.system.work(own) + own as f64 * self.tie.work(),
            Scheme::PrakashHjelmstad => 2.0 * self.system.work(own) - self.system.work(0) + self.tie.work(),
        }
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        self.system
            .equilibrium(q.to_vec(), held, Some(&self.tie.rows))
            .map(Some)
    }
}

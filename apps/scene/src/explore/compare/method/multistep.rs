//! Multipliers at own steps in place of reflections: Gravouil and Combescure (2001), Prakash and Hjelmstad
//! (2004), both with the central difference scheme for either model. In the first, velocities are equal at
//! every own step of the fine model, and between steps of the run the coarse velocity is linear in time: it
//! loses energy. In the second, velocities are equal at steps of the run, and multipliers are linear in time.

use super::{Case, Coupling, Motion, Pace, Result, State, Tie, add, product, pseudo_inverse};
use arlequin::core::sprs::TriMat;

/// Most own steps within a step of the run, one more than the default has; the published figures are for
/// five and ten.
const OWN: usize = 5;

/// Two models with multipliers at own steps.
#[derive(Debug)]
pub(super) struct Multistep {
    /// True for the second scheme.
    ramped: bool,
    /// Accelerations include the constraint's part.
    state: State,
    /// Rows with the answer `λ = R b` to a jump of velocities.
    tie: Tie,
    /// Exact projection for the start.
    start: Tie,
    /// Accelerations `W Gᵀ λ` by the last multipliers.
    push: Vec<f64>,
    /// Coarse velocity at the last step of the run without its last multiplier.
    free: Vec<f64>,
}

impl Multistep {
    /// Couples by the first scheme, or by the second with multipliers that are `ramped`.
    pub(super) fn new(case: &mut Case, ramped: bool) -> Result<Self> {
        let system = case.system(&case.weights.clone())?;
        let pace = Pace::split(&system, OWN)?;
        let start = Tie::exact(case.coupling(&system)?, &system.inverse)?;
        let mut out = Self {
            push: vec![0.0; system.size()],
            free: Vec::new(),
            tie: start.clone(),
            state: State::new(system, pace),
            ramped,
            start,
        };
        out.tie = out.exact()?;
        Ok(out)
    }

    /// Multipliers after which the jump of velocities vanishes at the instant of the constraint.
    fn exact(&self) -> Result<Tie> {
        let (rows, [coarse, fine]) = (&self.start.rows, self.state.whole.sides());
        let mut operator = TriMat::new((rows.rows(), rows.rows()));
        let mut unit = vec![0.0; rows.rows()];
        let (zeros, pace) = (vec![0.0; self.state.whole.size()], self.state.pace);
        for j in 0..rows.rows() {
            unit[j] = 1.0;
            let push = self.start.push(&unit, &self.state.whole.inverse);
            unit[j] = 0.0;
            let mut m = Motion::new(zeros.clone(), zeros.clone());
            if self.ramped {
                self.ramp(&mut m, [&zeros, &push]);
            } else {
                m.brake(fine.clone(), &push, 1.0, pace.own_step());
            }
            m.brake(coarse.clone(), &push, 1.0, pace.step);
            let answer = product(rows, &m.v).into_iter().enumerate();
            let entries = answer.filter(|(_, x)| *x != 0.0);
            entries.for_each(|(i, x)| operator.add_triplet(i, j, -x));
        }
        Tie::by(rows.clone(), &operator.to_csr(), &pseudo_inverse)
    }

    /// Own steps of the fine model under multipliers that are linear in time, given at the begin and at the
    /// end as accelerations `W Gᵀ λ`.
    fn ramp(&self, m: &mut Motion, [begin, end]: [&[f64]; 2]) {
        let (dt, [_, fine]) = (self.state.pace.own_step(), self.state.whole.sides());
        for j in 1..=self.state.pace.own {
            self.state.whole.step(m, fine.clone(), dt);
            let s = j as f64 / self.state.pace.own as f64;
            m.brake(fine.clone(), end, s, dt);
            m.brake(fine.clone(), begin, 1.0 - s, dt);
        }
    }
}

impl Coupling for Multistep {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let system = &self.state.whole;
        let mut now = Motion::new(q.to_vec(), v.to_vec());
        self.start.project(&mut now.q, &system.inverse);
        self.start.project(&mut now.v, &system.inverse);
        system.accelerate(&mut now, 0..system.size());
        self.push = self.start.kick(&now.a, &system.inverse);
        add(&mut now.a, -1.0, &self.push);
        self.free = now.v[..system.split].to_vec();
        add(&mut self.free, 0.5 * self.state.pace.step, &self.push);
        self.state.now = now;
    }

    fn advance(&mut self) {
        let ([coarse, fine], Pace { step, own, .. }) = (self.state.whole.sides(), self.state.pace);
        let (mut now, dt) = (std::mem::take(&mut self.state.now), self.state.pace.own_step());
        self.state.whole.step(&mut now, coarse.clone(), step);
        if self.ramped {
            let mut free = now.clone();
            self.ramp(&mut free, [&self.push, &vec![0.0; now.v.len()]]);
            let end = self.tie.kick(&free.v, &self.state.whole.inverse);
            self.ramp(&mut now, [&self.push, &end]);
            self.push = end;
        } else {
            let after = now.v[coarse.clone()].to_vec();
            for j in 1..=own {
                let s = j as f64 / own as f64;
                self.state.whole.step(&mut now, fine.clone(), dt);
                let between = self.free.iter().zip(&after).map(|(a, b)| (1.0 - s) * a + s * b);
                now.v.iter_mut().zip(between).for_each(|(v, x)| *v = x);
                self.push = self.tie.kick(&now.v, &self.state.whole.inverse);
                now.brake(fine.clone(), &self.push, 1.0, dt);
            }
            self.free = after;
        }
        now.brake(coarse, &self.push, 1.0, step);
        self.state.now = now;
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn work(&self) -> f64 {
        let (whole, own) = (&self.state.whole, self.state.pace.own);
        // One scheme answers at every own step, the other makes the own steps of the fine model twice.
        if self.ramped {
            2.0 * whole.work(own) - whole.work(0) + self.tie.work()
        } else {
            whole.work(own) + own as f64 * self.tie.work()
        }
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        let q = self.state.whole.equilibrium(q.to_vec(), held, &self.tie.rows);
        q.map(Some)
    }
}

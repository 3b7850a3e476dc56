//! Overlapping Schwarz alternation: both models keep their full weight in the overlap. Each takes the
//! motion of the other at its border, and both repeat a step of the run from its start until these motions
//! agree.

use super::{
    COARSE, Case, Coupling, FINE, MOST_OWN, Method, Motion, Pace, Result, State, System, follows, key,
    product,
};
use arlequin::core::Weights;
use arlequin::core::sprs::CsMat;
use std::ops::Range;

/// Change of the displacements, relative to the largest one, at which the alternation ends.
const TOLERANCE: f64 = 1e-8;
/// Most alternations within a step; a bound for waves that cross the overlap within one.
const MOST: usize = 20;
/// Alternations of an equilibrium.
const MOST_AT_REST: usize = 200;

/// Two models with prescribed motions at their borders.
#[derive(Debug)]
pub(super) struct Schwarz {
    /// Models without weights, which step.
    system: System,
    /// Models with the weights of the scene, whose energies have a sum.
    state: State,
    /// Unknowns at the border of either model, which follow the other one.
    border: CsMat<f64>,
    /// Alternations in all, and steps.
    count: [usize; 2],
}

impl Schwarz {
    /// Couples by alternation.
    pub(super) fn new(case: &mut Case) -> Result<Self> {
        let shared = case.system(&case.weights.clone())?;
        let system = case.system(&[Weights::uncoupled(), Weights::uncoupled()])?;
        let pace = Pace::split(&system, MOST_OWN)?;
        Ok(Self {
            border: border(case, &system)?,
            state: State::new(shared, pace),
            count: [0; 2],
            system,
        })
    }

    /// Sets the unknowns at the border of one model by the motions of the other at the begin and the end of
    /// the step, after a share `s` of it.
    fn prescribe(&self, m: &mut Motion, range: Range<usize>, [begin, end]: [&Motion; 2], s: f64) {
        let rows = self.border.outer_iterator().enumerate();
        for (i, row) in rows.filter(|(i, row)| range.contains(i) && row.nnz() > 0) {
            let mean = |x: &[f64], y: &[f64]| {
                row.iter()
                    .fold(0.0, |sum, (j, n)| sum + n * ((1.0 - s) * x[j] + s * y[j]))
            };
            m.q[i] = mean(&begin.q, &end.q);
            m.v[i] = mean(&begin.v, &end.v);
            m.a[i] = mean(&begin.a, &end.a);
        }
    }

    /// Makes the own steps of one model within a step of the run.
    fn leap(&self, m: &mut Motion, range: Range<usize>, own: usize, data: [&Motion; 2]) {
        let dt = self.state.pace.step / own as f64;
        for j in 1..=own {
            m.drift(range.clone(), dt);
            self.prescribe(m, range.clone(), data, j as f64 / own as f64);
            self.system.accelerate(m, range.clone());
            m.kick(range.clone(), dt);
            // The forces of the model do not move its border.
            self.prescribe(m, range.clone(), data, j as f64 / own as f64);
        }
    }
}

/// Lets the last layer of nodes of either model follow the other one.
fn border(case: &Case, system: &System) -> Result<CsMat<f64>> {
    let (half, [coarse, fine]) = (0.5 * case.spacing[FINE], system.sides());
    let x = |range: &Range<usize>| system.places[range.clone()].iter().map(|p| p.x);
    let last = x(&coarse).fold(f64::NEG_INFINITY, f64::max) - half;
    let first = x(&fine).fold(f64::INFINITY, f64::min) + half;
    let into_fine = case.followers([FINE, COARSE], [last, f64::INFINITY], &|_| true);
    let into_coarse = case.followers([COARSE, FINE], [f64::NEG_INFINITY, first], &|_| true);
    let out = &into_fine + &into_coarse;
    let upper = coarse.filter(|i| system.places[*i].x >= last);
    let lower = fine.filter(|i| system.places[*i].x <= first);
    if upper.chain(lower).any(|i| !follows(&out, i)) {
        let rule = "needs the displacement of the other model at the nodes of a border, some of which are outside of it; take \
                    two models of finite elements";
        return Err(case.refusal(Method::Schwarz, rule));
    }
    Ok(out)
}

impl Coupling for Schwarz {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let mut free = Motion::new(q.to_vec(), v.to_vec());
        self.system.accelerate(&mut free, 0..q.len());
        let mut now = free.clone();
        self.prescribe(&mut now, 0..q.len(), [&free, &free], 1.0);
        (self.state.now, self.count) = (now, [0; 2]);
    }

    fn advance(&mut self) {
        let (saved, [coarse, fine]) = (self.state.now.clone(), self.system.sides());
        self.count[1] += 1;
        for _ in 0..MOST {
            self.count[0] += 1;
            let mut next = saved.clone();
            self.leap(&mut next, coarse.clone(), 1, [&saved, &self.state.now]);
            // The fine model sees the coarse step that has just been made.
            let made = next.clone();
            self.leap(&mut next, fine.clone(), self.state.pace.own, [&saved, &made]);
            let done = agree(&next.q, &self.state.now.q);
            self.state.now = next;
            if done {
                break;
            }
        }
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn work(&self) -> f64 {
        let alternation = self.system.work(self.state.pace.own) + self.border.nnz() as f64;
        alternation * self.count[0].max(1) as f64 / self.count[1].max(1) as f64
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        let (mut out, none) = (q.to_vec(), CsMat::zero((0, q.len())));
        for _ in 0..MOST_AT_REST {
            let before = out.clone();
            for range in self.system.sides() {
                let border = product(&self.border, &out);
                let prescribed = range.clone().filter(|i| follows(&self.border, *i));
                prescribed.for_each(|i| out[i] = border[i]);
                // The other model stands still.
                let fixed = |i: usize| held[i] || follows(&self.border, i) || !range.contains(&i);
                let fixed: Vec<bool> = (0..out.len()).map(fixed).collect();
                out = self.system.equilibrium(out, &fixed, &none)?;
            }
            if agree(&out, &before) {
                return Ok(Some(out));
            }
        }
        let rule = "the alternation of 'schwarz' finds no equilibrium; widen the overlap";
        Err(key("compare", rule))
    }
}

/// True if two vectors of displacements differ by less than the tolerance.
fn agree(x: &[f64], y: &[f64]) -> bool {
    let size = x.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
    x.iter().zip(y).all(|(x, y)| (x - y).abs() <= TOLERANCE * size)
}

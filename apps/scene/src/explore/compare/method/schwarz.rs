//! Overlapping Schwarz alternation: both models keep their full weight in the overlap. Each takes the
//! motion of the other at its border, and both repeat a step of the run from its start until these motions
//! agree.

use super::Coupling;
use crate::error::{Result, key};
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Pace;
use crate::explore::compare::sparse::product;
use crate::explore::compare::system::{Motion, System};
use crate::spec::Method;
use arlequin::core::ShapeRow;
use arlequin::core::sprs::{CsMat, TriMat};
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
    shared: System,
    /// Value of each prescribed unknown from those of the other model; empty rows for others.
    trace: CsMat<f64>,
    prescribed: Vec<bool>,
    pace: Pace,
    now: Motion,
    /// Alternations in all, and steps.
    count: [usize; 2],
}

impl Schwarz {
    /// Couples by alternation.
    pub(super) fn new(case: &mut Case) -> Result<Self> {
        let shared = case.system(&case.weights())?;
        let system = case.plain_system()?;
        let (d, split) = (case.components(), case.places.split);
        // The last layer of nodes of either model.
        let x = |range: Range<usize>| case.places.x[range].iter().copied();
        let [last, first] = [
            x(0..split).fold(f64::NEG_INFINITY, f64::max),
            x(split..system.size()).fold(f64::INFINITY, f64::min),
        ];
        let half = 0.5 * case.spacing[1];
        let coarse = case.border_nodes([last - half, f64::INFINITY])?;
        let fine = case.followers(false, [f64::NEG_INFINITY, first + half]);
        if coarse.is_empty() || fine.is_empty() {
            return Err(case.refusal(Method::Schwarz, "finds no nodes at a border; widen the overlap"));
        }
        let mut trace = TriMat::new((system.size(), system.size()));
        let mut prescribed = vec![false; system.size()];
        let mut follow = |target: usize, sources: usize, row: &ShapeRow<f64>| {
            for c in 0..d {
                prescribed[target + c] = true;
                for (node, value) in row.nodes.iter().zip(&row.values) {
                    trace.add_triplet(target + c, sources + node * d + c, *value);
                }
            }
        };
        coarse.iter().for_each(|(k, row)| follow(k * d, split, row));
        fine.iter().for_each(|(k, row)| follow(split + k * d, 0, row));
        let pace = Pace::split(&system)?;
        Ok(Self {
            trace: trace.to_csr(),
            now: Motion::default(),
            count: [0; 2],
            system,
            shared,
            prescribed,
            pace,
        })
    }

    fn sides(&self) -> [Range<usize>; 2] {
        let split = self.system.places.split;
        [0..split, split..self.system.size()]
    }

    /// Sets the prescribed unknowns of one model by the motions of the other at the begin and the end of the
    /// step, after a share `s` of it.
    fn prescribe(&self, m: &mut Motion, range: Range<usize>, [begin, end]: [&Motion; 2], s: f64) {
        for i in range.filter(|i| self.prescribed[*i]) {
            let row = self.trace.outer_view(i);
            let mut sums = [0.0; 3];
            for (j, w) in row.iter().flat_map(|r| r.iter()) {
                let mean = |x: &[f64], y: &[f64]| w * ((1.0 - s) * x[j] + s * y[j]);
                sums[0] += mean(&begin.q, &end.q);
                sums[1] += mean(&begin.v, &end.v);
                sums[2] += mean(&begin.a, &end.a);
            }
            [m.q[i], m.v[i], m.a[i]] = sums;
        }
    }

    /// Makes the own steps of one model within a step of the run.
    fn leap(&self, m: &mut Motion, side: usize, data: [&Motion; 2]) {
        let range = self.sides()[side].clone();
        let own = if side == 0 { 1 } else { self.pace.own };
        let dt = self.pace.step / own as f64;
        for j in 1..=own {
            System::drift(m, range.clone(), dt);
            self.prescribe(m, range.clone(), data, j as f64 / own as f64);
            self.system.kick(m, range.clone(), dt);
            // The forces of the model do not move its border.
            self.prescribe(m, range.clone(), data, j as f64 / own as f64);
        }
    }
}

impl Coupling for Schwarz {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let mut free = Motion {
            q: q.to_vec(),
            v: v.to_vec(),
            a: vec![0.0; q.len()],
        };
        self.system.accelerate(&mut free, 0..q.len());
        let mut now = free.clone();
        for range in self.sides() {
            self.prescribe(&mut now, range, [&free, &free], 1.0);
        }
        (self.now, self.count) = (now, [0; 2]);
    }

    fn advance(&mut self) {
        let saved = self.now.clone();
        let mut guess = saved.clone();
        self.count[1] += 1;
        for _ in 0..MOST {
            self.count[0] += 1;
            let mut next = saved.clone();
            self.leap(&mut next, 0, [&saved, &guess]);
            // The fine model sees the coarse step that has just been made.
            let coarse = next.clone();
            self.leap(&mut next, 1, [&saved, &coarse]);
            let done = agree(&next.q, &guess.q);
            guess = next;
            if done {
                break;
            }
        }
        self.now = guess;
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    fn whole(&self) -> &System {
        &self.shared
    }

    fn motion(&self) -> [Vec<f64>; 2] {
        self.now.pair()
    }

    fn work(&self) -> f64 {
        let alternation = self.system.work(self.pace.own) + self.trace.nnz() as f64;
        alternation * self.count[0].max(1) as f64 / self.count[1].max(1) as f64
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        let mut out = q.to_vec();
        for _ in 0..MOST_AT_REST {
            let before = out.clone();
            for range in self.sides() {
                let border = product(&self.trace, &out);
                let prescribed = range.clone().filter(|i| self.prescribed[*i]);
                prescribed.for_each(|i| out[i] = border[i]);
                // The other model stands still.
                let fixed = |i: usize| held[i] || self.prescribed[i] || !range.contains(&i);
                let fixed: Vec<bool> = (0..out.len()).map(fixed).collect();
                out = self.system.equilibrium(out, &fixed, None)?;
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

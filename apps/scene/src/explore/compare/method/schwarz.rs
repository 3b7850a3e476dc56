//! Overlapping Schwarz alternation: both models whole in the overlap, each led by the other at its border,
//! iterated over a step of the run by save and restore.

use super::Coupling;
use crate::error::{Result, key};
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::Pace;
use crate::explore::compare::sparse::{add_product, product};
use crate::explore::compare::system::System;
use arlequin::core::sprs::{CsMat, TriMat};
use arlequin::core::{Uniform, Weights};
use std::ops::Range;
use std::sync::Arc;

/// Change of the led displacements, relative to the largest one, at which the alternation ends.
const TOLERANCE: f64 = 1e-8;
/// Most alternations within a step; a bound for waves that cross the overlap within one.
const MOST: usize = 20;
/// Alternations of an equilibrium.
const MOST_AT_REST: usize = 200;

/// Displacements, velocities and accelerations.
#[derive(Debug, Clone, Default)]
struct Motion {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

/// Two models that lead each other.
#[derive(Debug)]
pub(super) struct Schwarz {
    /// Models without weights, which step.
    system: System,
    /// Models with the weights of the scene, whose energies have a sum.
    shared: System,
    /// Value of each led unknown from those of the other model; empty rows for others.
    lead: CsMat<f64>,
    led: Vec<bool>,
    pace: Pace,
    now: Motion,
    /// Alternations in all, and steps.
    count: [usize; 2],
}

impl Schwarz {
    /// Couples by alternation.
    pub(super) fn new(case: &mut Case) -> Result<Self> {
        let one = || Weights::from_weight(Arc::new(Uniform(1.0)));
        let shared = case.system(&case.weights())?;
        let system = case.system(&[one(), one()])?;
        let (d, split) = (case.components(), case.places.split);
        // The last layer of nodes of either model.
        let end = (0..split)
            .map(|i| case.places.x[i])
            .fold(f64::NEG_INFINITY, f64::max);
        let coarse = case.led_nodes([end - 0.5 * case.spacing[1], f64::INFINITY])?;
        let first = (split..system.size())
            .map(|i| case.places.x[i])
            .fold(f64::INFINITY, f64::min);
        let fine = case.followers(false, [f64::NEG_INFINITY, first + 0.5 * case.spacing[1]]);
        if coarse.is_empty() || fine.is_empty() {
            let path = format!("interface.{}.method", case.name());
            return Err(key(
                path,
                "'schwarz' finds no nodes at a border; widen the overlap",
            ));
        }
        let mut lead = TriMat::new((system.size(), system.size()));
        let mut led = vec![false; system.size()];
        let mut follow = |target: usize, sources: usize, row: &arlequin::core::ShapeRow<f64>| {
            for c in 0..d {
                led[target + c] = true;
                for (node, value) in row.nodes.iter().zip(&row.values) {
                    lead.add_triplet(target + c, sources + node * d + c, *value);
                }
            }
        };
        coarse.iter().for_each(|(k, row)| follow(k * d, split, row));
        fine.iter().for_each(|(k, row)| follow(split + k * d, 0, row));
        let pace = Pace::split(&system)?;
        Ok(Self {
            lead: lead.to_csr(),
            now: Motion::default(),
            count: [0; 2],
            system,
            shared,
            led,
            pace,
        })
    }

    fn sides(&self) -> [Range<usize>; 2] {
        let split = self.system.places.split;
        [0..split, split..self.system.size()]
    }

    /// Copies what the other model says to the led unknowns of one: `data` are motions at begin and end of
    /// the step, `s` the share of the step that has passed.
    fn follow(&self, m: &mut Motion, range: Range<usize>, [begin, end]: [&Motion; 2], s: f64) {
        let at = |x: &[f64], y: &[f64], i: usize| {
            let row = self.lead.outer_view(i);
            let entries = row.iter().flat_map(|r| r.iter());
            entries
                .map(|(j, w)| w * ((1.0 - s) * x[j] + s * y[j]))
                .sum::<f64>()
        };
        for i in range.filter(|i| self.led[*i]) {
            m.q[i] = at(&begin.q, &end.q, i);
            m.v[i] = at(&begin.v, &end.v, i);
            m.a[i] = at(&begin.a, &end.a, i);
        }
    }

    /// Makes the own steps of one model within a step of the run.
    fn leap(&self, m: &mut Motion, side: usize, data: [&Motion; 2]) {
        let range = self.sides()[side].clone();
        let own = if side == 0 { 1 } else { self.pace.own };
        let dt = self.pace.step / own as f64;
        for j in 1..=own {
            for i in range.clone() {
                m.v[i] += 0.5 * dt * m.a[i];
                m.q[i] += dt * m.v[i];
            }
            self.follow(m, range.clone(), data, j as f64 / own as f64);
            let mut force = vec![0.0; m.q.len()];
            add_product(&self.system.stiffness, &m.q, -1.0, range.clone(), &mut force);
            for i in range.clone().filter(|i| !self.led[*i]) {
                m.a[i] = force[i] * self.system.inverse[i];
                m.v[i] += 0.5 * dt * m.a[i];
            }
        }
    }
}

impl Coupling for Schwarz {
    fn reset(&mut self, q: &[f64], v: &[f64]) {
        let mut a = vec![0.0; q.len()];
        add_product(&self.system.stiffness, q, -1.0, 0..q.len(), &mut a);
        a.iter_mut().zip(&self.system.inverse).for_each(|(a, w)| *a *= w);
        let free = Motion {
            q: q.to_vec(),
            v: v.to_vec(),
            a,
        };
        let mut now = free.clone();
        for range in self.sides() {
            self.follow(&mut now, range, [&free, &free], 1.0);
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
            let (mut change, mut size) = (0.0_f64, f64::MIN_POSITIVE);
            for i in 0..next.q.len() {
                change = change.max((next.q[i] - guess.q[i]).abs());
                size = size.max(next.q[i].abs());
            }
            guess = next;
            if change <= TOLERANCE * size {
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
        [self.now.q.clone(), self.now.v.clone()]
    }

    /// Energy with the weights of the scene, by which both models share the overlap.
    fn energy(&self) -> f64 {
        self.shared.energies(&self.now.q, &self.now.v).iter().sum()
    }

    fn momentum(&self) -> [f64; 2] {
        self.shared.momentum(&self.now.v)
    }

    fn work(&self) -> f64 {
        let indptr = self.system.stiffness.indptr();
        let start = indptr.raw_storage();
        let (coarse, all) = (start[self.system.places.split], start[self.system.size()]);
        let once = (coarse + self.pace.own * (all - coarse) + self.lead.nnz()) as f64;
        once * self.count[0].max(1) as f64 / self.count[1].max(1) as f64
    }

    fn equilibrium(&self, q: &[f64], held: &[bool]) -> Result<Option<Vec<f64>>> {
        let mut out = q.to_vec();
        let size = q.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
        for _ in 0..MOST_AT_REST {
            let before = out.clone();
            for range in self.sides() {
                let says = product(&self.lead, &out);
                range
                    .clone()
                    .filter(|i| self.led[*i])
                    .for_each(|i| out[i] = says[i]);
                // The other model stands still.
                let fixed = |i: usize| held[i] || self.led[i] || !range.contains(&i);
                let fixed: Vec<bool> = (0..out.len()).map(fixed).collect();
                out = self.system.equilibrium(out, &fixed, None)?;
            }
            let change = out
                .iter()
                .zip(&before)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            if change <= TOLERANCE * size {
                return Ok(Some(out));
            }
        }
        Err(key(
            "compare",
            "the alternation of 'schwarz' finds no equilibrium; widen the overlap",
        ))
    }
}

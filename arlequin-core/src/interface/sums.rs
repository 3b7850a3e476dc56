//! Sums of junction products over sampling points: the coupling matrices.
//!
//! A sum over particles has those that lie in the mediator and have mass:
//!
//! ```text
//! B_ip = V_p N_i(x_p)   if m_p > 4 ε max m,   else 0       m_p = ρ_p V_p · mean of the weight over the bonds
//! ```
//!
//! The mediator ends where the weight does, but a particle is inside of it by its centre, and has its mass by
//! samples of the weight along its bonds. A particle at the border, all bonds of which lead out, has no mass
//! and sleeps although its centre lies in the overlap. Where faces of elements are not plane, two elements
//! may hold the same place, one in the mediator and one beyond the overlap, so that particles sleep deeper
//! inside. The velocity of a sleeping particle is nobody's, and no multiplier may act on it: the sums of both
//! sides leave it out, which keeps the momenta. If many sleep, the mediator goes beyond the weights.

use super::assembly::{OVERHANG_LIMIT, PARTICLE_COVERAGE, Sampling};
use super::rows::{Block, Part, Rows};
use super::{Coupling, InterfaceSpec, Side};
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::Sample;
use crate::mediator::Mediator;
use crate::reach::Reach;
use crate::{Error, Real, Result};
use nalgebra::Point3;
use rayon::prelude::*;

/// Cell number of a sample whose cell is not known.
pub(super) const NO_CELL: usize = usize::MAX;
/// Samples per task if the particles themselves are the samples.
const SAMPLES: usize = 128;
/// Tasks in flight. A batch is merged before the next one starts, so that dense blocks stay small beside the
/// matrices.
const BATCH: usize = 1024;
/// Largest share of the sampled measure that particles which sleep may have: particles at the border, and
/// particles in places that two elements hold.
const ASLEEP: f64 = 0.04;
/// Shape functions up to this are round-off: on a face of an element, those of the nodes that are not on it.
const ROUND_OFF: f64 = 1e-12;

/// Input of the sums, shared by all tasks.
pub(super) struct Sampler<'a, T: Real> {
    spec: &'a InterfaceSpec<T>,
    sides: &'a [Side<'a, T>; 2],
    /// Components that one coupling matrix mixes: 1 or all.
    per_node: usize,
    shared: usize,
    gradient: bool,
    beyond: Option<Beyond<'a, T>>,
}

/// Fields of the mediator and the other model, continued beyond their surfaces for particles of the overlap
/// that stick out.
struct Beyond<'a, T: Real> {
    /// Index of the side whose particles are the samples.
    particles: usize,
    mediator: Reach<'a, T, dyn Mediator<T>>,
    other: Reach<'a, T, dyn Interpolation<T> + 'a>,
}

/// Working buffers of one thread, and the sums of its present task.
pub(super) struct Worker<T: Real> {
    pub(super) samples: Vec<Sample<T>>,
    rows: ShapeRow<T>,
    cols: [ShapeRow<T>; 2],
    reach: [ShapeRow<T>; 2],
    blocks: [Block<T>; 2],
    pub(super) tally: Tally<T>,
}

/// Sampled measures \[m³\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Tally<T> {
    /// Measures of the mediator that the coarse model covers, and that both models cover.
    pub(super) covered: [T; 2],
    measure: T,
    reached: T,
    lost: T,
    /// Length, area or volume of the particles that sleep.
    asleep: T,
    /// The first particle that sleeps.
    first_asleep: Option<usize>,
}

impl<T: Real> Tally<T> {
    fn zero() -> Self {
        let zero = T::zero();
        Self {
            covered: [zero; 2],
            measure: zero,
            reached: zero,
            lost: zero,
            asleep: zero,
            first_asleep: None,
        }
    }

    fn add_sleeping(&mut self, measure: T, particle: usize) {
        self.asleep += measure;
        self.first_asleep.get_or_insert(particle);
    }

    fn add(&mut self, other: &Self) {
        (0..2).for_each(|k| self.covered[k] += other.covered[k]);
        self.measure += other.measure;
        self.reached += other.reached;
        self.lost += other.lost;
        self.asleep += other.asleep;
        self.first_asleep = self.first_asleep.or(other.first_asleep);
    }
}

/// Coupling matrices and the measures they were summed over.
pub(super) struct Summed<T> {
    pub(super) coupling: [Coupling<T>; 2],
    pub(super) covered: [T; 2],
    /// Measure that all three fields cover \[m³\].
    pub(super) measure: T,
    /// Measure that particles cover beyond a surface of the mediator or of the other model \[m³\].
    pub(super) reached: T,
}

impl<'a, T: Real> Sampler<'a, T> {
    pub(super) fn new(spec: &'a InterfaceSpec<T>, sides: &'a [Side<'a, T>; 2], components: usize) -> Self {
        let shared = spec.shared(components);
        Self {
            spec,
            sides,
            per_node: components / shared,
            shared,
            gradient: spec.junction.needs().gradients(),
            beyond: None,
        }
    }

    /// Sums over the particles of one side, which may stick out of the mediator and of the other model.
    pub(super) fn over_particles(
        mut self,
        side: usize,
        samples: &[Sample<T>],
        warnings: &mut Vec<String>,
    ) -> Result<Summed<T>> {
        self.beyond = Some(Beyond {
            particles: side,
            mediator: Reach::new(&*self.spec.mediator),
            other: Reach::new(self.sides[1 - side].field),
        });
        let tasks: Vec<&[Sample<T>]> = samples.chunks(SAMPLES).collect();
        self.sum(tasks.len(), warnings, &|worker, k| {
            self.add(worker, tasks[k], [NO_CELL; 3])
        })
    }

    /// Runs all tasks in parallel and adds up their results in the order of tasks.
    pub(super) fn sum(
        &self,
        tasks: usize,
        warnings: &mut Vec<String>,
        task: &(dyn Fn(&mut Worker<T>, usize) -> Result<()> + Sync),
    ) -> Result<Summed<T>> {
        // Results are collected by task number, so the order of addition does not depend on threads.
        type Done<T> = Result<([Vec<Part<T>>; 2], Tally<T>)>;
        let rows = self.spec.mediator.nodes().len() * self.per_node;
        let mut sums = [Rows::new(rows), Rows::new(rows)];
        let mut tally = Tally::zero();
        for first in (0..tasks).step_by(BATCH) {
            let batch = (first..(first + BATCH).min(tasks)).into_par_iter();
            let results: Vec<Done<T>> = batch
                .map_init(
                    || self.worker(),
                    |worker, k| {
                        task(worker, k)?;
                        let parts = worker.blocks.each_mut().map(Block::take);
                        Ok((parts, std::mem::replace(&mut worker.tally, Tally::zero())))
                    },
                )
                .collect();
            for result in results {
                let ([coarse, fine], task_tally) = result?;
                sums[0].add(coarse);
                sums[1].add(fine);
                tally.add(&task_tally);
            }
        }
        self.finish(sums, &tally, warnings)
    }

    fn worker(&self) -> Worker<T> {
        let row = || [ShapeRow::default(), ShapeRow::default()];
        let nodes = self.spec.mediator.nodes().len();
        let block = |m: usize| Block::new([nodes, self.sides[m].layout.nodes], self.per_node);
        Worker {
            samples: Vec::new(),
            rows: ShapeRow::default(),
            cols: row(),
            reach: row(),
            blocks: [block(0), block(1)],
            tally: Tally::zero(),
        }
    }

    /// Returns whether both models share the energy at a point, so that a particle there may stick out of the
    /// mediator and of the other model.
    fn is_shared(&self, x: &Point3<T>) -> bool {
        let Some(beyond) = &self.beyond else {
            return false;
        };
        let w = self.sides[beyond.particles].weight.value(x);
        // Weights within round-off of 0 or 1: one model is alone there.
        let floor = T::epsilon().max(T::of(1e-9));
        w > floor && w < T::one() - floor
    }

    /// Returns the particle at the present sample, which has the columns `cols`, if it sleeps, and whether
    /// the other model sleeps there.
    fn sleeps(&self, cols: &[ShapeRow<T>; 2]) -> (Option<usize>, bool) {
        let Some(beyond) = &self.beyond else {
            return (None, false);
        };
        let asleep = |m: usize| {
            let inertia = self.sides[m].sleeping?;
            asleep_in(&cols[m], inertia, self.sides[m].layout.components)
        };
        (asleep(beyond.particles), asleep(1 - beyond.particles).is_some())
    }

    /// Adds samples to the sums. `cells`: cell of the mediator, coarse and fine field in which all of them
    /// lie, or [`NO_CELL`].
    pub(super) fn add(&self, worker: &mut Worker<T>, samples: &[Sample<T>], cells: [usize; 3]) -> Result<()> {
        let gradient = self.gradient;
        for s in samples {
            let shared = self.is_shared(&s.point);
            let mut is_beyond = false;
            match evaluate(
                &*self.spec.mediator,
                cells[0],
                &s.point,
                gradient,
                &mut worker.rows,
            ) {
                Err(Error::OutsideDomain { .. }) => {
                    // Only particles of the overlap are coupled beyond the mediator's surface; all others are
                    // no sample.
                    let Some(beyond) = self.beyond.as_ref().filter(|_| shared) else {
                        continue;
                    };
                    let outcome =
                        (beyond.mediator).shape_at(&s.point, gradient, &mut worker.rows, &mut worker.reach);
                    match outcome {
                        Err(Error::OutsideDomain { .. }) => continue,
                        other => other?,
                    }
                    is_beyond = true;
                }
                other => other?,
            }
            let mut inside = true;
            for m in 0..2 {
                let field = self.sides[m].field;
                match evaluate(field, cells[m + 1], &s.point, gradient, &mut worker.cols[m]) {
                    Err(Error::OutsideDomain { .. }) => {
                        is_beyond = true;
                        let beyond = self.beyond.as_ref().filter(|b| shared && m != b.particles);
                        let outcome = beyond.map(|b| {
                            (b.other).shape_at(&s.point, gradient, &mut worker.cols[m], &mut worker.reach)
                        });
                        // Without a value of either model on this sample, both sides leave it out.
                        inside &= match outcome {
                            None | Some(Err(Error::OutsideDomain { .. })) => false,
                            Some(other) => other.map(|()| true)?,
                        };
                    }
                    Err(Error::NoGradient { .. }) => {
                        let (role, junction) = (field.kind().into(), self.spec.junction.name().into());
                        return Err(Error::NoGradient { role, junction });
                    }
                    other => other?,
                }
            }
            if !inside {
                worker.tally.lost += s.measure;
                continue;
            }
            let (sleeping, other_sleeps) = self.sleeps(&worker.cols);
            if let Some(particle) = sleeping {
                worker.tally.add_sleeping(s.measure, particle);
                continue;
            }
            // Of two warped elements, the mediator may find one of the overlap, and the other model the one
            // beside it.
            if other_sleeps && !shared {
                continue;
            }
            if is_beyond {
                worker.tally.reached += s.measure;
            } else {
                worker.tally.measure += s.measure;
            }
            for (block, cols) in worker.blocks.iter_mut().zip(&worker.cols) {
                block.add(&*self.spec.junction, (&s.point, s.measure), &worker.rows, cols);
            }
        }
        Ok(())
    }

    /// Turns the sums into coupling matrices.
    ///
    /// # Errors
    /// [`Error::OverhangingMediator`] if too much of the overlap lies outside of a model,
    /// [`Error::ZeroMass`] if too many particles in it have no mass.
    fn finish(
        &self,
        [coarse, fine]: [Rows<T>; 2],
        tally: &Tally<T>,
        warnings: &mut Vec<String>,
    ) -> Result<Summed<T>> {
        let &Tally {
            covered,
            measure,
            reached,
            lost,
            asleep,
            first_asleep,
        } = tally;
        // Particles of one model near a free surface may lie outside the hull of the other; they are not
        // tied.
        let limit = match self.spec.options.sampling {
            Sampling::Particles => PARTICLE_COVERAGE,
            _ => OVERHANG_LIMIT,
        };
        if lost > (measure + reached + lost) * T::of(limit) {
            let (outside, total) = (lost.as_f64(), (lost + reached + measure).as_f64());
            let (interface, model) = (self.spec.name.clone(), self.sides[0].name.to_owned());
            return Err(Error::OverhangingMediator {
                interface,
                model,
                outside,
                total,
            });
        }
        let total = measure + reached + asleep;
        if let (Some(node), true) = (first_asleep, asleep > total * T::of(ASLEEP)) {
            let particles = &self.sides[self.beyond.as_ref().map_or(0, |b| b.particles)];
            let x = particles.field.nodes()[node];
            return Err(Error::ZeroMass {
                model: particles.name.to_owned(),
                node,
                point: [x.x, x.y, x.z].map(|c| c.as_f64()),
                mass: 0.0,
            });
        }
        if lost > T::zero() {
            warnings.push(format!(
                "{:.2e} of the overlap lies outside one of the models (at the surface) and is left out on both sides",
                (lost / (measure + reached + lost)).as_f64()
            ));
        }
        let side = |sum: Rows<T>, m: usize| Coupling {
            matrix: sum.into_matrix(self.sides[m].layout.nodes * self.per_node),
            shared: self.shared,
        };
        Ok(Summed {
            coupling: [side(coarse, 0), side(fine, 1)],
            covered,
            measure,
            reached,
        })
    }
}

/// Returns the first node of a row that sleeps, by the `inertia` of all unknowns. On a face of an element,
/// nodes beyond it have round-off; neighbours of a particle have gradients alone.
fn asleep_in<T: Real>(row: &ShapeRow<T>, inertia: &[T], components: usize) -> Option<usize> {
    let mut read = row.nodes.iter().zip(&row.values);
    let asleep =
        read.find(|(node, n)| n.abs() > T::of(ROUND_OFF) && inertia[**node * components] <= T::zero());
    asleep.map(|(node, _)| *node)
}

fn evaluate<T: Real, F: Interpolation<T> + ?Sized>(
    field: &F,
    cell: usize,
    x: &Point3<T>,
    gradient: bool,
    row: &mut ShapeRow<T>,
) -> Result<()> {
    if cell == NO_CELL {
        field.shape_at(x, gradient, row)
    } else {
        field.shape_in(cell, x, gradient, row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_that_sleeps_counts_if_a_point_has_a_part_of_it() {
        let inertia = [1.0, 1.0, 0.0, 0.0, 2.0, 2.0];
        let row = |values: &[f64]| {
            let mut row = ShapeRow::default();
            values.iter().enumerate().for_each(|(k, n)| row.push(k, *n));
            row
        };
        assert_eq!(asleep_in(&row(&[0.5, 0.05, 0.45]), &inertia, 2), Some(1));
        // Beyond a face, as the linear continuation gives it.
        assert_eq!(asleep_in(&row(&[0.7, -0.2, 0.5]), &inertia, 2), Some(1));
        assert_eq!(asleep_in(&row(&[0.5, 1e-15, 0.5]), &inertia, 2), None);
        assert_eq!(asleep_in(&row(&[0.5, 0.0, 0.5]), &inertia, 2), None);
    }
}

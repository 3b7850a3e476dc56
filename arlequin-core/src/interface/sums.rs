//! Sums of junction products over sampling points.

use super::assembly::{OVERHANG_LIMIT, PARTICLE_COVERAGE, Sampling};
use super::{Coupling, InterfaceSpec, Side};
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::Sample;
use crate::junction::ShapeFunction;
use crate::mediator::Mediator;
use crate::reach::Reach;
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};
use sprs::{CsMat, TriMat};

/// A sample whose cell is not known.
pub(super) const NO_CELL: usize = usize::MAX;
pub(super) const UNKNOWN: [usize; 3] = [NO_CELL; 3];

/// Sums entries of a sparse matrix in a fixed order: dense blocks while row and column nodes stay the same, as they do
/// over a piece of the overlap, then entries that are merged as they grow.
pub(super) struct Accumulator<T> {
    entries: Vec<(u32, u32, T)>,
    limit: usize,
    rows: Vec<usize>,
    cols: Vec<usize>,
    block: Vec<T>,
}

impl<T: Real> Accumulator<T> {
    pub(super) fn new() -> Self {
        Self {
            entries: Vec::new(),
            limit: 1 << 20,
            rows: Vec::new(),
            cols: Vec::new(),
            block: Vec::new(),
        }
    }
    /// The block of `rows × cols` nodes with `size` components each, row major, to be added to.
    fn block(&mut self, rows: &[usize], cols: &[usize], size: usize) -> &mut [T] {
        if self.rows != rows || self.cols != cols {
            self.flush(size);
            self.rows.clear();
            self.rows.extend_from_slice(rows);
            self.cols.clear();
            self.cols.extend_from_slice(cols);
            self.block.clear();
            self.block
                .resize(rows.len() * cols.len() * size * size, T::zero());
        }
        &mut self.block
    }
    fn flush(&mut self, size: usize) {
        let width = self.cols.len() * size;
        for (i, row) in self.rows.iter().enumerate() {
            for a in 0..size {
                for (j, col) in self.cols.iter().enumerate() {
                    for b in 0..size {
                        let value = self.block[(i * size + a) * width + j * size + b];
                        self.entries
                            .push(((row * size + a) as u32, (col * size + b) as u32, value));
                    }
                }
            }
        }
        self.block.clear();
        self.rows.clear();
        if self.entries.len() > self.limit {
            self.merge();
            self.limit = (self.entries.len() * 2).max(1 << 20);
        }
    }
    fn merge(&mut self) {
        self.entries.sort_by_key(|e| (e.0, e.1));
        self.entries.dedup_by(|next, kept| {
            let same = (next.0, next.1) == (kept.0, kept.1);
            if same {
                kept.2 += next.2;
            }
            same
        });
    }
    pub(super) fn into_matrix(mut self, rows: usize, cols: usize, size: usize) -> CsMat<T> {
        self.flush(size);
        self.merge();
        let mut t = TriMat::with_capacity((rows, cols), self.entries.len());
        self.entries
            .iter()
            .filter(|e| e.2 != T::zero())
            .for_each(|e| t.add_triplet(e.0 as usize, e.1 as usize, e.2));
        t.to_csr()
    }
}

/// Sums of `⟨N_i, N_j⟩` over sampling points, for both sides at once.
pub(super) struct Sums<'a, T: Real> {
    spec: &'a InterfaceSpec<T>,
    sides: &'a [Side<'a, T>; 2],
    components: usize,
    sums: [Accumulator<T>; 2],
    measure: T,
    reached: T,
    lost: T,
    rows: ShapeRow<T>,
    cols: [ShapeRow<T>; 2],
    beyond: Option<Beyond<'a, T>>,
}

/// Mediator and the other model's field beyond their surfaces, for particles of the overlap that stick out of them.
struct Beyond<'a, T: Real> {
    /// The side whose particles sample the integrals.
    particles: usize,
    mediator: Reach<'a, T, dyn Mediator<T>>,
    other: Reach<'a, T, dyn Interpolation<T> + 'a>,
}

impl<'a, T: Real> Sums<'a, T> {
    pub(super) fn new(spec: &'a InterfaceSpec<T>, sides: &'a [Side<'a, T>; 2], components: usize) -> Self {
        Self {
            spec,
            sides,
            components,
            sums: [Accumulator::new(), Accumulator::new()],
            measure: T::zero(),
            reached: T::zero(),
            lost: T::zero(),
            rows: ShapeRow::default(),
            cols: [ShapeRow::default(), ShapeRow::default()],
            beyond: None,
        }
    }

    /// The same for sums over the particles of one side, which may stick out of mediator and other model.
    pub(super) fn over_particles(mut self, side: usize) -> Self {
        self.beyond = Some(Beyond {
            particles: side,
            mediator: Reach::new(&*self.spec.mediator),
            other: Reach::new(self.sides[1 - side].field),
        });
        self
    }

    /// Whether both models share a point: a particle there may stick out of the mediator and the coarse model.
    fn is_shared(&self, x: &Point3<T>) -> bool {
        let Some(beyond) = &self.beyond else {
            return false;
        };
        let w = self.sides[beyond.particles].weight.at(x);
        let floor = T::epsilon().max(T::of(1e-9));
        w > floor && w < T::one() - floor
    }

    /// Adds samples that lie in one cell each of mediator, coarse and fine field, where known.
    pub(super) fn add(&mut self, samples: &[Sample<T>], cells: [usize; 3]) -> Result<()> {
        let gradient = self.spec.junction.needs().gradients();
        for s in samples {
            let shared = self.is_shared(&s.point);
            let mut reached = false;
            match evaluate(&*self.spec.mediator, cells[0], &s.point, gradient, &mut self.rows) {
                Err(Error::OutsideDomain { .. }) => {
                    let Some(beyond) = self.beyond.as_mut().filter(|_| shared) else {
                        continue;
                    };
                    match beyond.mediator.shape_at(&s.point, gradient, &mut self.rows) {
                        Err(Error::OutsideDomain { .. }) => continue,
                        other => other?,
                    }
                    reached = true;
                }
                other => other?,
            }
            let mut inside = true;
            for m in 0..2 {
                match evaluate(
                    self.sides[m].field,
                    cells[m + 1],
                    &s.point,
                    gradient,
                    &mut self.cols[m],
                ) {
                    Err(Error::OutsideDomain { .. }) => {
                        reached = true;
                        let beyond = self.beyond.as_mut().filter(|b| shared && m != b.particles);
                        inside &=
                            match beyond.map(|b| b.other.shape_at(&s.point, gradient, &mut self.cols[m])) {
                                None | Some(Err(Error::OutsideDomain { .. })) => false,
                                Some(other) => other.map(|()| true)?,
                            };
                    }
                    Err(Error::NoGradient { .. }) => {
                        let (role, junction) = (
                            self.sides[m].field.kind().into(),
                            self.spec.junction.name().into(),
                        );
                        return Err(Error::NoGradient { role, junction });
                    }
                    other => other?,
                }
            }
            if !inside {
                self.lost += s.measure;
                continue;
            }
            if reached {
                self.reached += s.measure;
            } else {
                self.measure += s.measure;
            }
            for m in 0..2 {
                add_products(
                    self.spec,
                    s,
                    &self.rows,
                    &self.cols[m],
                    self.components,
                    &mut self.sums[m],
                );
            }
        }
        Ok(())
    }

    /// The coupling matrices, the measure that all three fields cover, and that of what was reached beyond.
    pub(super) fn finish(self, warnings: &mut Vec<String>) -> Result<([Coupling<T>; 2], [T; 2])> {
        let Self {
            spec,
            sides,
            components,
            sums,
            measure,
            reached,
            lost,
            ..
        } = self;
        // Particles of one model near a free surface may lie outside the hull of the other; they are not tied.
        let limit = match spec.options.sampling {
            Sampling::Particles => PARTICLE_COVERAGE,
            _ => OVERHANG_LIMIT,
        };
        if lost > (measure + reached + lost) * T::of(limit) {
            let (outside, total) = (lost.as_f64(), (lost + reached + measure).as_f64());
            let (interface, model) = (spec.name.clone(), sides[0].name.to_owned());
            return Err(Error::OverhangingMediator {
                interface,
                model,
                outside,
                total,
            });
        }
        if lost > T::zero() {
            warnings.push(format!(
                "{:.2e} of the overlap lies outside one of the models (at the surface) and is left out on both sides",
                (lost / (measure + reached + lost)).as_f64()
            ));
        }
        let shared = spec.shared(components);
        let per_node = components / shared;
        let nodes = spec.mediator.nodes().len();
        let [coarse, fine] = sums;
        let matrix = |sum: Accumulator<T>, m: usize| {
            sum.into_matrix(nodes * per_node, sides[m].layout.nodes * per_node, per_node)
        };
        let coupling = [
            Coupling {
                matrix: matrix(coarse, 0),
                shared,
            },
            Coupling {
                matrix: matrix(fine, 1),
                shared,
            },
        ];
        Ok((coupling, [measure, reached]))
    }
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

fn shape<T: Real>(row: &ShapeRow<T>, k: usize) -> ShapeFunction<T> {
    let gradient = row.gradients.get(k).copied().unwrap_or_else(Vector3::zeros);
    ShapeFunction {
        value: row.values[k],
        gradient,
    }
}

pub(super) fn add_products<T: Real>(
    spec: &InterfaceSpec<T>,
    at: &Sample<T>,
    rows: &ShapeRow<T>,
    cols: &ShapeRow<T>,
    components: usize,
    sum: &mut Accumulator<T>,
) {
    let size = components / spec.shared(components);
    let width = cols.nodes.len() * size;
    let block = sum.block(&rows.nodes, &cols.nodes, size);
    for i in 0..rows.nodes.len() {
        let si = shape(rows, i);
        for j in 0..cols.nodes.len() {
            let product = spec.junction.block(&at.point, &si, &shape(cols, j)) * at.measure;
            for a in 0..size {
                for b in 0..size {
                    block[(i * size + a) * width + j * size + b] += product[(a, b)];
                }
            }
        }
    }
}

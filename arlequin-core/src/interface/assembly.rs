//! Coupling matrices: sampling points of the junction integrals, coverage checks and the seminorm's pin.

use super::rows::{Block, Rows};
use super::sums::{NO_CELL, Sampler, Worker};
use super::{Coupling, InterfaceSpec, Side};
use crate::field::{Interpolation, ShapeRow};
use crate::geometry::{Body, BoxTree, Cell, HalfSpace, bounds_of};
use crate::junction::Needs;
use crate::named::named;
use crate::{Error, Real, Result};
use nalgebra::Point3;
use rayon::prelude::*;
use sprs::{CsMat, TriMat};

/// Sampling of the junction integrals. Both sides use the same points, so that action equals reaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    /// Quadrature on the common refinement of mediator, coarse and fine cells; exact for polynomial shape
    /// functions.
    #[default]
    Intersection,
    /// Interpolation of both velocities at the mediator nodes first (`Π u̇ − Π ḋ`), as in the literature.
    Projection,
    /// Sums over the integration points of a field that has its own (particles): the fine one if it has any,
    /// else the coarse one.
    Particles,
}

named!(Sampling, "sampling":
    Intersection = "intersection",
    Projection = "projection",
    Particles = "particles",
);

/// Largest share of the mediator outside of a model that is no error: faceted meshes of a curved surface
/// differ by that much.
pub(super) const OVERHANG_LIMIT: f64 = 0.02;
/// Relative excess of a model's coverage of the mediator that is no error: round-off.
const TWICE: f64 = 1e-6;
/// Highest degree of the quadrature.
const HIGHEST: usize = 5;
/// Relative gap or excess of particle volumes over the mediator that is no error: particles do not fill it.
pub(super) const PARTICLE_COVERAGE: f64 = 0.3;

pub(super) struct Built<T> {
    pub(super) coupling: [Coupling<T>; 2],
    pub(super) measure: T,
    pub(super) momentum_defect: T,
    pub(super) degree: Option<usize>,
    pub(super) warnings: Vec<String>,
}

/// Returns whether a model may share a place with another one: no node of it may sleep, or a node that is
/// awake has a part of the weight.
fn shares_with_another<T: Real>(side: &Side<'_, T>) -> bool {
    let Some(masses) = side.sleeping else {
        return true;
    };
    let first = |node: usize| masses[node * side.layout.components];
    let mut awake = side
        .field
        .nodes()
        .iter()
        .enumerate()
        .filter(|(k, _)| first(*k) > T::zero());
    awake.any(|(_, x)| {
        let weight = side.weight.value(x);
        weight > T::zero() && weight < T::one()
    })
}

pub(super) fn assemble<T: Real>(
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
    components: usize,
) -> Result<Built<T>> {
    // An overlap without mediator is a mistake, and has its error below.
    if spec.mediator.nodes().is_empty() && !sides.iter().all(shares_with_another) {
        return Ok(untied(spec, sides, components));
    }
    let cells = spec.mediator.cells();
    let total: T = cells.iter().map(Cell::measure).sum();
    if !total.is_finite() || total <= T::zero() {
        let model = sides[0].name.to_owned();
        return Err(Error::EmptyOverlap {
            interface: spec.name.clone(),
            model,
        });
    }
    let mut warnings = Vec::new();
    let (coupling, measure) = match spec.options.sampling {
        Sampling::Projection => (projection(spec, sides, &cells, components)?, total),
        Sampling::Intersection => {
            // Quadrature points of a refinement are no particles, and between its particles the field has no
            // value.
            if sides.iter().any(|s| s.field.samples().is_some()) {
                return Err(crate::error::invalid_option(
                    &spec.name,
                    "sampling",
                    "intersection",
                    "a particle-quadrature field exists at the particles only; use 'particles' sampling",
                ));
            }
            refined(spec, sides, &cells, total, components, &mut warnings)?
        }
        Sampling::Particles => over_particles(spec, sides, components, total, &mut warnings)?,
    };
    let mut built = Built {
        coupling,
        measure,
        momentum_defect: T::zero(),
        degree: degree(spec, sides),
        warnings,
    };
    if spec.junction.needs() != Needs::Gradients {
        built.momentum_defect = momentum_defect(&built.coupling, sides, components);
        // Both sides sum over the same points: only round-off may be left.
        let limit = T::epsilon().sqrt();
        if built.momentum_defect > limit {
            let (defect, limit) = (built.momentum_defect.as_f64(), limit.as_f64());
            return Err(Error::MomentumLeak {
                interface: spec.name.clone(),
                defect,
                limit,
            });
        }
    } else {
        pin(spec, sides, &mut built.coupling, components)?;
    }
    Ok(built)
}

/// Coupling without multipliers.
fn untied<T: Real>(spec: &InterfaceSpec<T>, sides: &[Side<'_, T>; 2], components: usize) -> Built<T> {
    let shared = spec.shared(components);
    let none = |side: &Side<'_, T>| Coupling {
        matrix: CsMat::zero((0, side.layout.nodes * components / shared)),
        shared,
    };
    Built {
        coupling: sides.each_ref().map(none),
        measure: T::zero(),
        momentum_defect: T::zero(),
        degree: None,
        warnings: Vec::new(),
    }
}

/// Sums over the particles of the side that has some, the fine one first. Returns the coupling and the
/// measure that is tied. `total` is the mediator's measure.
fn over_particles<T: Real>(
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
    components: usize,
    total: T,
    warnings: &mut Vec<String>,
) -> Result<([Coupling<T>; 2], T)> {
    let sampled_side = [1, 0]
        .into_iter()
        .find_map(|m| Some((m, sides[m].field.samples()?)));
    let Some((m, samples)) = sampled_side else {
        return Err(crate::error::invalid_option(
            &spec.name,
            "sampling",
            "particles",
            &format!(
                "neither '{}' nor '{}' has integration points of its own; use 'intersection'",
                sides[0].name, sides[1].name
            ),
        ));
    };
    let sampler = Sampler::new(spec, sides, components);
    let summed = sampler.over_particles(m, samples, warnings)?;
    let covered = summed.measure;
    check_coverage(
        spec,
        sides[m].name,
        [covered, total],
        [T::of(PARTICLE_COVERAGE); 2],
    )?;
    // What reaches beyond the mediator counts too: the particles there are tied to a continuation of the
    // field.
    Ok((summed.coupling, covered + summed.reached))
}

/// Returns the degree of the quadrature rule on each cell intersection; `None` for sums over particles.
fn degree<T: Real>(spec: &InterfaceSpec<T>, sides: &[Side<'_, T>; 2]) -> Option<usize> {
    wanted_degree(spec, sides).map(|d| d.min(HIGHEST))
}

/// Returns the degree of the products of shape functions on each cell intersection; `None` for sums over
/// particles.
fn wanted_degree<T: Real>(spec: &InterfaceSpec<T>, sides: &[Side<'_, T>; 2]) -> Option<usize> {
    let mediator = spec.mediator.degree();
    match spec.options.sampling {
        Sampling::Particles => None,
        Sampling::Projection => Some(2 * mediator),
        Sampling::Intersection => Some(mediator + sides[0].field.degree().max(sides[1].field.degree())),
    }
}

/// Compares the measure of the mediator that a model covers with the whole. `[excess, defect]`: allowed
/// relative differences.
fn check_coverage<T: Real>(
    spec: &InterfaceSpec<T>,
    model: &str,
    [covered, total]: [T; 2],
    [excess, defect]: [T; 2],
) -> Result<()> {
    let (interface, model) = (spec.name.clone(), model.to_owned());
    // No sample at all has an error of its own: a share of nothing would be reported as 100 % outside.
    if covered <= T::zero() {
        return Err(Error::EmptyOverlap { interface, model });
    }
    if covered - total > total * excess {
        let (covered, total) = (covered.as_f64(), total.as_f64());
        return Err(Error::CoveredTwice {
            interface,
            model,
            covered,
            total,
        });
    }
    if total - covered > total * defect {
        let (outside, total) = ((total - covered).as_f64(), total.as_f64());
        return Err(Error::OverhangingMediator {
            interface,
            model,
            outside,
            total,
        });
    }
    Ok(())
}

/// Cells of a field near the mediator, ready for intersections.
struct CellSet<T: Real> {
    cells: Vec<(usize, Cell<T>)>,
    planes: Vec<Vec<HalfSpace<T>>>,
    tree: BoxTree<T>,
    /// True if the field has cells.
    any: bool,
}

impl<T: Real> CellSet<T> {
    fn new(field: &dyn Interpolation<T>, within: &[Point3<T>; 2]) -> Self {
        let (any, cells) = match field.cells_within(within) {
            Some(cells) => (true, cells),
            None => (false, Vec::new()),
        };
        let planes = cells.par_iter().map(|c| c.1.half_spaces()).collect();
        let bounds = cells.par_iter().map(|c| c.1.bounds()).collect();
        Self {
            tree: BoxTree::new(bounds),
            cells,
            planes,
            any,
        }
    }

    /// Calls `visit` with each intersection of `cell` and a cell of the field, and the number of the latter.
    /// If the field has no cells: calls it once with `cell`.
    fn pieces(&self, cell: &Cell<T>, visit: &mut dyn FnMut(usize, &Cell<T>) -> Result<()>) -> Result<()> {
        if !self.any {
            return visit(NO_CELL, cell);
        }
        let bounds = cell.bounds();
        // Once per mediator cell: its corners are welded for all cells that it meets.
        let body = match cell {
            Cell::Polyhedron(p) => Some(Body::new(p)),
            Cell::Segment { .. } => None,
        };
        let mut outcome = Ok(());
        self.tree.any(&bounds, &mut |k| {
            let (number, field_cell) = &self.cells[k];
            let piece = match (&body, field_cell) {
                (Some(p), Cell::Polyhedron(_)) => nonempty(p, &self.planes[k], &bounds),
                (_, field_cell) => cell
                    .intersection(field_cell)
                    .map(|piece| with_section(cell, piece)),
            };
            if let Some(piece) = piece {
                outcome = visit(*number, &piece);
            }
            // True ends the search.
            outcome.is_err()
        });
        outcome
    }
}

/// Gives a segment the cross-section of the mediator's line.
fn with_section<T: Real>(line: &Cell<T>, mut piece: Cell<T>) -> Cell<T> {
    // The section of the model would only scale the multipliers.
    if let (
        Cell::Segment { section, .. },
        Cell::Segment {
            section: own_section, ..
        },
    ) = (line, &mut piece)
    {
        *own_section = *section;
    }
    piece
}

fn nonempty<T: Real>(p: &Body<T>, planes: &[HalfSpace<T>], [low, high]: &[Point3<T>; 2]) -> Option<Cell<T>> {
    let body = p.within(planes)?;
    // Slivers of round-off between cells that only touch are not worth a sample.
    let size = (high - low).norm();
    (body.volume() > size * size * size * T::epsilon() * T::of(16.0)).then_some(Cell::Polyhedron(body))
}

/// Sums over mediator ∩ coarse ∩ fine, one task per mediator cell.
fn refined<T: Real>(
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
    cells: &[Cell<T>],
    total: T,
    components: usize,
    warnings: &mut Vec<String>,
) -> Result<([Coupling<T>; 2], T)> {
    let ends: Vec<_> = cells.iter().flat_map(Cell::bounds).collect();
    let within = bounds_of(ends.iter());
    let sets = sides.each_ref().map(|s| CellSet::new(s.field, &within));
    let wanted = wanted_degree(spec, sides).unwrap_or(HIGHEST);
    let sampler = Sampler::new(spec, sides, components);
    let task = |worker: &mut Worker<T>, m: usize| {
        sets[0].pieces(&cells[m], &mut |c, piece| {
            // Counted before the fine cells cut the piece, so that the two sides' coverages are told apart.
            worker.tally.covered[0] += piece.measure();
            sets[1].pieces(piece, &mut |f, part| {
                // Taken out while `add` borrows the worker; its memory is used again.
                let mut samples = std::mem::take(&mut worker.samples);
                samples.clear();
                // The lean rule is not symmetric: for integrands alone that it integrates exactly.
                if wanted > HIGHEST {
                    part.quadrature(HIGHEST, &mut samples);
                } else {
                    part.lean_quadrature(wanted, &mut samples);
                }
                worker.tally.covered[1] += samples.iter().map(|s| s.measure).sum();
                let outcome = sampler.add(worker, &samples, [m, c, f]);
                worker.samples = samples;
                outcome
            })
        })
    };
    let summed = sampler.sum(cells.len(), warnings, &task)?;
    // A model that covers the mediator more than once has cells on top of each other; too little is a faceted
    // surface.
    let limits = [T::of(TWICE).max(T::epsilon().sqrt()), T::of(OVERHANG_LIMIT)];
    for (side, covered) in sides.iter().zip(summed.covered) {
        check_coverage(spec, side.name, [covered, total], limits)?;
    }
    Ok((summed.coupling, summed.measure))
}

/// Computes `B = M_O P`: Gram matrix of the mediator times the fields' values at its nodes.
fn projection<T: Real>(
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
    cells: &[Cell<T>],
    components: usize,
) -> Result<[Coupling<T>; 2]> {
    let gradient = spec.junction.needs().gradients();
    let shared = spec.shared(components);
    let per_node = components / shared;
    let nodes = spec.mediator.nodes();
    let degree = degree(spec, sides).unwrap_or(HIGHEST);
    let size = nodes.len() * per_node;
    let mut gram = Rows::new(size);
    let mut block = Block::new([nodes.len(); 2], per_node);
    let (mut row, mut samples) = (ShapeRow::default(), Vec::new());
    for cell in cells {
        samples.clear();
        cell.quadrature(degree, &mut samples);
        for s in &samples {
            spec.mediator.shape_at(&s.point, gradient, &mut row)?;
            block.add(&*spec.junction, (&s.point, s.measure), &row, &row);
        }
        gram.add(block.take());
    }
    let gram = gram.into_matrix(size);
    let side = |m: usize| -> Result<Coupling<T>> {
        let mut values = TriMat::new((size, sides[m].layout.nodes * per_node));
        let mut row = ShapeRow::default();
        for (i, x) in nodes.iter().enumerate() {
            sides[m]
                .field
                .shape_at(x, false, &mut row)
                .map_err(|e| overhang(e, spec, sides[m].name, x))?;
            for (&j, &v) in row.nodes.iter().zip(&row.values) {
                (0..per_node).for_each(|a| values.add_triplet(i * per_node + a, j * per_node + a, v));
            }
        }
        let values: CsMat<T> = values.to_csr();
        Ok(Coupling {
            matrix: &gram * &values,
            shared,
        })
    };
    Ok([side(0)?, side(1)?])
}

fn overhang<T: Real>(error: Error, spec: &InterfaceSpec<T>, model: &str, x: &Point3<T>) -> Error {
    match error {
        Error::OutsideDomain { point, .. } => Error::OutsideDomain {
            point,
            role: format!(
                "'{model}' (mediator node of interface '{}', projection sampling)",
                spec.name
            ),
        },
        _ => crate::field::outside(x, model),
    }
}

/// Returns the largest relative difference between the sides in `Σ_j B_ij` and `Σ_j B_ij x_j`: force and
/// moment of one multiplier on either model.
fn momentum_defect<T: Real>(coupling: &[Coupling<T>; 2], sides: &[Side<'_, T>; 2], components: usize) -> T {
    let per_node = components / coupling[0].shared;
    let nodes = coupling[0].matrix.rows();
    let mut moments = vec![[T::zero(); 8]; nodes];
    let (mut scale, mut reach) = (T::zero(), T::epsilon());
    for m in 0..2 {
        let sign = if m == 0 { T::one() } else { -T::one() };
        for (v, (i, j)) in coupling[m].matrix.iter() {
            // A block matrix mixes components. Translations along an axis act on the columns of its own
            // component.
            if i % per_node != j % per_node {
                continue;
            }
            // Arms from a node of the model keep their digits far from the origin.
            let x = sides[m].field.nodes()[j / per_node] - sides[0].field.nodes()[0];
            reach = reach.max(x.norm());
            moments[i][0] += sign * *v;
            (0..3).for_each(|c| moments[i][c + 1] += sign * *v * x[c]);
            // Forces of one side alone give the scale: the difference of the two is what is judged.
            moments[i][7] += if m == 0 { v.abs() } else { T::zero() };
        }
    }
    let mut worst = T::zero();
    for m in &moments {
        scale = scale.max(m[7]);
        // Moments over the longest arm are comparable with forces.
        worst = (1..4).fold(worst.max(m[0].abs()), |w, c| w.max(m[c].abs() / reach));
    }
    if scale > T::zero() {
        worst / scale
    } else {
        T::zero()
    }
}

/// Replaces the multiplier row nearest the pin by the pointwise constraint `u(x_a) = d(x_a)`: a seminorm does
/// not see constants.
fn pin<T: Real>(
    spec: &InterfaceSpec<T>,
    sides: &[Side<'_, T>; 2],
    coupling: &mut [Coupling<T>; 2],
    components: usize,
) -> Result<()> {
    let nodes = spec.mediator.nodes();
    // Without a point of the user's any will do: the pin only fixes a constant.
    let x = spec.options.pin.unwrap_or(nodes[0]);
    let distance = |k: &usize| (nodes[*k] - x).norm().as_f64();
    let nearest = (0..nodes.len())
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(0);
    let per_node = components / coupling[0].shared;
    // The pinned row gets the magnitude of its neighbours, so that the operator stays well scaled.
    let scale = coupling[0]
        .matrix
        .iter()
        .fold(T::zero(), |s, (v, _)| s.max(v.abs()));
    for (m, side) in coupling.iter_mut().enumerate() {
        let mut t = TriMat::new((side.matrix.rows(), side.matrix.cols()));
        let kept_rows = side.matrix.iter().filter(|(_, (i, _))| i / per_node != nearest);
        kept_rows.for_each(|(v, (i, j))| t.add_triplet(i, j, *v));
        let mut row = ShapeRow::default();
        sides[m]
            .field
            .shape_at(&x, false, &mut row)
            .map_err(|e| overhang(e, spec, sides[m].name, &x))?;
        for (&j, &v) in row.nodes.iter().zip(&row.values) {
            for a in 0..per_node {
                t.add_triplet(nearest * per_node + a, j * per_node + a, v * scale);
            }
        }
        side.matrix = t.to_csr();
    }
    Ok(())
}

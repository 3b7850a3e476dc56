//! Whether the models of a run share everything exactly once: the partition of unity, checked before the first step.
//!
//! Models that interfaces tie to each other form a group; every other model is a group of its own. At every node of a group,
//! and at quadrature points of every cell, the weights of the models that are there must sum to one: of the only one
//! outside of overlaps, of all inside. Near a surface, within the distance at which faceted meshes of one body differ or that
//! particles are rough, a model may count as present or as absent; what is missing there adds up and is bounded. The
//! weighted inertia of all models must be that of the space they fill together, and the mediator must fill the overlap.

use super::tie::{Tie, outside_of};
use crate::error::Share;
use crate::extent::{Cover, Extent, length};
use crate::geometry::{self, Cell, Sample};
use crate::interface::InterfaceSpec;
use crate::subdomain::{Partition, Subdomain};
use crate::weight::{Uniform, Weight, Weighting};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// What the check found for one group of models that are tied to each other.
#[derive(Debug, Clone, PartialEq)]
pub struct PartitionReport {
    /// Names of the models.
    pub models: Vec<String>,
    /// Whether they were checked.
    pub checked: bool,
    /// Measure of the space they fill together \[m³, m for lines\]; zero for a model alone.
    pub measure: f64,
    /// Part of it that more than one of them fills.
    pub shared: f64,
    /// Weight that is missing at surfaces where the models' shapes differ, relative to `shared`.
    pub missing: f64,
    /// Weighted inertia of all models, as the measure it stands for, less `measure`, relative to `shared`.
    pub excess_mass: f64,
}

/// Largest deviation of the sum of weights from one at a point: round-off of weights that are made to sum to one.
pub(super) const ROUND_OFF: f64 = 1e-6;
/// Share of the overlap that may be counted twice, that one model may fill more of than the other, or that may lie outside
/// of the mediator's reach: round-off of facets.
pub(super) const SHARE: f64 = 0.02;
/// Weight that may be missing near surfaces, relative to the overlap: half of where a square and a circle of equal area
/// differ. What one model lacks the other has too much of, so that the mass is right.
const MISSING: f64 = 0.1;
/// Bound on the deviation of the weighted inertia, relative to the overlap, beyond what is missing at surfaces: that of the
/// quadrature of curved borders.
const MASS: f64 = 0.02;
/// The same, and that on unequal shapes, where particles take part: their volumes need not fill an overlap exactly.
const PARTICLES: f64 = 0.3;
/// Share of a cell cut by another model's border that 64 of its parts leave undecided.
const UNDECIDED: f64 = 0.25;
/// Share of the way to the centre of a cell at which its corners are looked at.
const INWARDS: f64 = 1e-5;
/// Halvings of cells that the border of another model cuts: 64 parts, or 32 of a line.
const LEVELS: [usize; 2] = [2, 5];

const KINDS: [Share; 3] = [Share::Internal, Share::Kinetic, Share::External];

/// One model of a group.
struct Member<'a, T: Real> {
    subdomain: &'a Subdomain<T>,
    extent: Extent<'a, T>,
}

impl<T: Real> Member<'_, T> {
    fn name(&self) -> String {
        self.subdomain.model().name().to_owned()
    }
    fn weight(&self, kind: usize) -> &dyn Weight<T> {
        let w = self.subdomain.weights();
        match kind {
            0 => &*w.internal,
            1 => &*w.kinetic,
            _ => &*w.external,
        }
    }
}

/// A group while it is checked.
struct Group<'a, T: Real> {
    members: Vec<Member<'a, T>>,
    ties: Vec<Tie<'a, T>>,
    measure: T,
    shared: T,
    /// Measure of cells that another model's border cuts.
    cut: T,
    missing: [T; 3],
    excess: [T; 3],
    /// Where most is missing or in excess.
    worst: [(T, Point3<T>); 3],
    covers: Vec<Cover>,
    /// Weights to look at: one where all three are the same.
    kinds: usize,
    /// Kinetic weights of the members at the point that is looked at, of those that may be there.
    kinetic: Vec<T>,
    /// Largest deviation of a sum at a point, and the error that names it.
    broken: Option<(T, Error)>,
}

/// What was found for every group, and the share of every interface's overlap outside its mediator.
type Findings = (Vec<PartitionReport>, Vec<Result<f64>>);

/// Checks all groups.
pub(super) fn check<T: Real>(subdomains: &[Subdomain<T>], specs: &[InterfaceSpec<T>]) -> Result<Findings> {
    let mut outside: Vec<Result<f64>> = specs.iter().map(|_| Ok(0.0)).collect();
    let mut reports = Vec::new();
    for numbers in groups(subdomains.len(), specs) {
        let models = numbers.iter().map(|&k| subdomains[k].model().name().to_owned());
        let mut report = PartitionReport {
            models: models.collect(),
            checked: numbers
                .iter()
                .all(|&k| subdomains[k].partition() == Partition::Checked),
            measure: 0.0,
            shared: 0.0,
            missing: 0.0,
            excess_mass: 0.0,
        };
        if report.checked {
            let mut group = Group::new(&numbers, subdomains, specs);
            group.check(&mut report)?;
            for t in &group.ties {
                outside[t.number] = outside_of(t);
            }
        }
        reports.push(report);
    }
    Ok((reports, outside))
}

/// Numbers of the models that are tied to each other, directly or through others.
fn groups<T: Real>(count: usize, specs: &[InterfaceSpec<T>]) -> Vec<Vec<usize>> {
    let mut of: Vec<usize> = (0..count).collect();
    for s in specs.iter().filter(|s| s.coarse < count && s.fine < count) {
        let (a, b) = (of[s.coarse].min(of[s.fine]), of[s.coarse].max(of[s.fine]));
        of.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
    }
    let members = |g: usize| (0..count).filter(|k| of[*k] == g).collect::<Vec<_>>();
    (0..count).map(members).filter(|m| !m.is_empty()).collect()
}

impl<'a, T: Real> Group<'a, T> {
    fn new(numbers: &[usize], subdomains: &'a [Subdomain<T>], specs: &'a [InterfaceSpec<T>]) -> Self {
        let member = |&k: &usize| {
            let s = &subdomains[k];
            Member {
                extent: Extent::new(&**s.field(), s.model().particles()),
                subdomain: s,
            }
        };
        let place = |k: usize| numbers.iter().position(|n| *n == k);
        let tie = |(number, s): (usize, &'a InterfaceSpec<T>)| {
            Some(Tie::new(number, s, [place(s.coarse)?, place(s.fine)?]))
        };
        Self {
            members: numbers.iter().map(member).collect(),
            ties: specs.iter().enumerate().filter_map(tie).collect(),
            measure: T::zero(),
            shared: T::zero(),
            cut: T::zero(),
            missing: [T::zero(); 3],
            excess: [T::zero(); 3],
            worst: [(T::zero(), Point3::origin()); 3],
            covers: vec![Cover::Outside; numbers.len()],
            kinds: if numbers.iter().all(|&k| subdomains[k].weights().are_one()) {
                1
            } else {
                KINDS.len()
            },
            kinetic: vec![T::zero(); numbers.len()],
            broken: None,
        }
    }

    fn check(&mut self, report: &mut PartitionReport) -> Result<()> {
        if self.members.len() == 1 {
            return self.alone();
        }
        let mut weighted = T::zero();
        let mut known = true;
        for m in 0..self.members.len() {
            let volume = self.fill(m);
            known &= volume > T::zero();
            weighted += volume * self.share(m)?;
        }
        if let Some((_, error)) = self.broken.take() {
            return Err(error);
        }
        let [measure, shared] = [self.measure, self.shared];
        let over = if shared > T::zero() { shared } else { measure };
        report.measure = measure.as_f64();
        report.shared = shared.as_f64();
        if !known || over <= T::zero() {
            return Ok(());
        }
        let relative = |x: T| (x / over).as_f64();
        for (kind, name) in KINDS.into_iter().enumerate().take(self.kinds) {
            let (missing, excess) = (relative(self.missing[kind]), relative(self.excess[kind]));
            report.missing = report.missing.max(missing);
            if missing > MISSING || excess > SHARE {
                return Err(Error::PartitionMeasure {
                    models: report.models.join("', '"),
                    kind: name,
                    amount: if excess > missing { excess } else { -missing },
                    limit: if excess > SHARE { SHARE } else { MISSING },
                    point: numbers(&self.worst[kind].1),
                });
            }
        }
        for t in &self.ties {
            self.alike(t)?;
        }
        report.excess_mass = relative(weighted - measure);
        let particles = self.members.iter().any(|m| m.extent.is_particles());
        let limit = if particles { PARTICLES } else { MASS };
        let nodal = |m: &Member<'_, T>| m.subdomain.weights().weighting == Weighting::Nodal;
        let undecided = UNDECIDED * relative(self.cut);
        if report.excess_mass.abs() > limit + report.missing + undecided && !self.members.iter().any(nodal) {
            return Err(Error::PartitionMass {
                models: report.models.join("', '"),
                amount: report.excess_mass,
                measure: report.measure,
                limit,
            });
        }
        Ok(())
    }

    /// Where weights are shared, neither model may fill more than the other: facets of one surface even out.
    fn alike(&self, t: &Tie<'_, T>) -> Result<()> {
        let sides = t.sides.map(|k| &self.members[k]);
        let particles = sides.iter().any(|m| m.extent.is_particles());
        let limit = if particles { PARTICLES } else { SHARE };
        let more = t.only[0] - t.only[1];
        if more.abs() <= t.overlap * T::of(limit) {
            return Ok(());
        }
        let [a, b] = sides.map(Member::name);
        let [larger, smaller] = if more > T::zero() { [a, b] } else { [b, a] };
        Err(Error::UnequalShapes {
            interface: t.name.to_owned(),
            larger,
            smaller,
            amount: (more.abs() / t.overlap).as_f64(),
            limit,
        })
    }

    /// A model that nothing is tied to has all of itself: more than one counts as well as less.
    fn alone(&self) -> Result<()> {
        let member = &self.members[0];
        for x in member.subdomain.model().nodes() {
            for kind in 0..3 {
                let w = member.weight(kind).at(x);
                if (w - T::one()).abs().as_f64() > ROUND_OFF {
                    return Err(self.violation(0, x, kind));
                }
            }
        }
        Ok(())
    }

    /// Weighted inertia over the whole one.
    fn share(&self, m: usize) -> Result<T> {
        let s = self.members[m].subdomain;
        let count = s.model().layout().translations();
        let mut whole = vec![T::zero(); s.model().layout().dofs()];
        s.model().lumped_inertia(&Uniform(T::one()), &mut whole)?;
        let sum = |x: &[T]| x[..count].iter().copied().sum::<T>();
        Ok(sum(s.inertia()) / sum(&whole))
    }

    /// Visits nodes and quadrature points of a model and returns its measure.
    fn fill(&mut self, m: usize) -> T {
        let mut samples: Vec<Sample<T>> = Vec::new();
        if let Some(particles) = self.members[m].extent.particles() {
            let mut total = T::zero();
            let particles: Vec<_> = particles.into();
            for s in particles {
                self.visit(m, &s.point, s.measure, T::zero());
                total += s.measure;
            }
            return total;
        }
        if self.members[m].extent.cells().is_empty() {
            let model = self.members[m].subdomain;
            for x in model.model().nodes() {
                self.visit(m, x, T::zero(), T::zero());
            }
        }
        let mut total = T::zero();
        let cells: Vec<_> = self.members[m].extent.cells().into();
        for cell in &cells {
            let measure = cell.measure();
            total += measure;
            samples.clear();
            // Nodes as this cell sees them: on a border of the overlap weights may jump by epsilon.
            let corners = cell.corners();
            let sum = corners.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
            let centre = Point3::from(sum / T::of(corners.len() as f64));
            let own = length(cell);
            for x in &corners {
                self.visit(m, &(x + (centre - x) * T::of(INWARDS)), T::zero(), own);
            }
            if !self.near_others(m, cell) {
                self.measure += measure;
                continue;
            }
            if self.is_cut(m, cell) {
                self.cut += measure;
                let levels = LEVELS[usize::from(matches!(cell, Cell::Segment { .. }))];
                for part in geometry::parts(cell, levels) {
                    part.quadrature(1, &mut samples);
                }
            } else {
                cell.quadrature(2, &mut samples);
            }
            for s in &samples {
                self.visit(m, &s.point, s.measure, own);
            }
        }
        total
    }

    fn near_others(&self, m: usize, cell: &Cell<T>) -> bool {
        let bounds = cell.bounds();
        let mut others = self.members.iter().enumerate().filter(|(k, _)| *k != m);
        others.any(|(_, o)| o.extent.meets(&bounds))
    }

    /// Whether another model, or a mediator, fills a cell in part.
    fn is_cut(&self, m: usize, cell: &Cell<T>) -> bool {
        let corners = cell.corners();
        let partly = |inside: &dyn Fn(&Point3<T>) -> bool| {
            let first = inside(&corners[0]);
            corners.iter().any(|x| inside(x) != first)
        };
        let mut others = self.members.iter().enumerate().filter(|(k, _)| *k != m);
        others.any(|(_, o)| partly(&|x| o.extent.cover(x, T::zero()) >= Cover::Hole))
            || self
                .ties
                .iter()
                .any(|t| partly(&|x| t.extent.cover(x, T::zero()) == Cover::Inside))
    }

    /// Looks at a point of model `m` that stands for `measure` (zero for a node), in a cell of the length `own`.
    fn visit(&mut self, m: usize, x: &Point3<T>, measure: T, own: T) {
        let (one, tolerance) = (T::one(), T::of(ROUND_OFF).max(T::epsilon() * T::of(64.0)));
        for (k, o) in self.members.iter().enumerate() {
            self.covers[k] = if k == m {
                Cover::Inside
            } else {
                o.extent.cover(x, own)
            };
        }
        let present = |k: usize| self.covers[k] >= Cover::Hole;
        let count = (0..self.members.len()).filter(|k| present(*k)).count();
        let part = measure / T::of(count as f64);
        let mut lacking = false;
        for kind in 0..self.kinds {
            let (mut strict, mut likely, mut most) = (T::zero(), T::zero(), T::zero());
            for (k, o) in self.members.iter().enumerate() {
                if self.covers[k] == Cover::Outside {
                    continue;
                }
                let w = o.weight(kind).at(x);
                // The first stands for all of them where it is the only one.
                if kind < 2 {
                    self.kinetic[k] = w;
                }
                if w < -tolerance {
                    self.broken = Some((T::of(f64::MAX), self.violation(m, x, kind)));
                    return;
                }
                most += w;
                if present(k) {
                    likely += w;
                }
                if self.covers[k] == Cover::Inside {
                    strict += w;
                }
            }
            let gap = one - most;
            if gap > tolerance && self.broken.as_ref().is_none_or(|b| gap > b.0) {
                self.broken = Some((gap, self.violation(m, x, kind)));
            }
            lacking |= likely < one - tolerance;
            let zero = T::zero();
            let (missing, excess) = ((one - likely).max(zero) * part, (strict - one).max(zero) * part);
            self.missing[kind] += missing;
            self.excess[kind] += excess;
            if missing.max(excess) > self.worst[kind].0 {
                self.worst[kind] = (missing.max(excess), *x);
            }
        }
        self.measure += part;
        if count > 1 || lacking {
            self.shared += part;
        }
        if measure > T::zero() {
            self.tie(x, part, lacking);
        }
    }

    /// Accounts for a point of an overlap that a mediator should hold, or several between the same models together.
    fn tie(&mut self, x: &Point3<T>, part: T, lacking: bool) {
        let floor = T::of(ROUND_OFF);
        for k in 0..self.ties.len() {
            let sides = self.ties[k].sides;
            let [a, b] = sides.map(|s| self.covers[s] >= Cover::Hole);
            if lacking && a != b {
                self.ties[k].only[usize::from(b)] += part;
            }
            let weighs = |s: &usize| self.kinetic[*s] > floor;
            if !a || !b || !sides.iter().all(weighs) {
                continue;
            }
            let mut alike = self.ties.iter().filter(|t| t.sides == sides);
            let inside = alike
                .clone()
                .any(|t| t.extent.cover(x, T::zero()) == Cover::Inside);
            // Half an element: what is farther away has no multiplier near it.
            let near = inside || alike.any(|t| t.extent.is_within(x, t.spacing * T::of(0.5)));
            let t = &mut self.ties[k];
            t.overlap += part;
            if !inside {
                t.outside += part;
            }
            if !near {
                t.deep += part;
                t.place = *x;
            }
        }
    }

    fn violation(&self, m: usize, x: &Point3<T>, kind: usize) -> Error {
        let mut sum = T::zero();
        let mut present = Vec::new();
        for (k, o) in self.members.iter().enumerate() {
            if k == m || self.covers[k] != Cover::Outside {
                let w = o.weight(kind).at(x);
                sum += w;
                present.push(format!("'{}' {:.4}", o.name(), w.as_f64()));
            }
        }
        Error::PartitionOfUnity {
            model: self.members[m].name(),
            point: numbers(x),
            kind: KINDS[kind],
            present: present.join(" + "),
            sum: sum.as_f64(),
        }
    }
}

pub(super) fn numbers<T: Real>(x: &Point3<T>) -> [f64; 3] {
    [x.x.as_f64(), x.y.as_f64(), x.z.as_f64()]
}

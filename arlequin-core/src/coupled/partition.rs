//! Whether the models of a run share everything exactly once: the partition of unity, checked before the
//! first step.
//!
//! Models that interfaces tie to each other form a group; every other model is a group of its own. At every
//! node of a group, and at quadrature points of every cell, the weights of the models that are there must sum
//! to one: of the only one outside of overlaps, of all inside. Near a surface, within the distance at which
//! faceted meshes of one body differ or that particles are rough, a model may count as present or as absent;
//! what is missing or too much there adds up and is bounded. Means of weights must be those of their values.
//! The weighted inertia of all models must be that of the space they fill together, a packing must fill as
//! much of an overlap as the other model does, and the mediator must fill the overlap.

mod filling;
mod means;
mod points;

pub(super) use filling::Filling;

use super::tie::{Tie, outside_of};
use crate::error::Share;
use crate::extent::{Cover, Extent};
use crate::geometry::Cell;
use crate::interface::InterfaceSpec;
use crate::subdomain::{Partition, Subdomain};
use crate::weight::{Uniform, Weight, Weighting};
use crate::{Error, Real, Result};
use nalgebra::Point3;

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
    /// Weighted inertia of all models, as the measure it stands for, less `measure`, relative to `shared`:
    /// positive where the overlap has more mass than the body it stands for, negative where it has less.
    /// Inertia of a model counts as a share of its own without weights, so that densities may differ. A
    /// packing fills the volumes of its particles; where a body of cells is, these fill the space.
    pub excess_mass: f64,
}

/// Largest deviation of the sum of weights from one at a point: round-off of weights that are made to sum to
/// one.
pub(super) const ROUND_OFF: f64 = 1e-6;
/// Share of the overlap that may be counted twice, that one model may fill more of than the other, or that
/// may lie outside of the mediator's reach: round-off of facets.
pub(super) const SHARE: f64 = 0.02;
/// Weight that may be missing near surfaces, relative to the overlap: half of where a square and a circle of
/// equal area differ. What one model lacks the other has too much of, so that the mass is right.
const MISSING: f64 = 0.1;
/// Bound on the deviation of the weighted inertia, relative to the overlap, beyond what is missing at
/// surfaces: that of the quadrature of curved borders. Also what is warned of.
const MASS: f64 = 0.02;
/// The same where particles take part, beside what is left to chance among few of them.
const PARTICLES: f64 = 0.1;
/// Share of a cell cut by the borders of several models that 64 of its parts leave undecided.
const UNDECIDED: f64 = 0.25;
/// Share of an overlap outside of its mediator that is warned of: prisms inscribed in round bars leave up
/// to 8 %.
const BESIDE: f64 = 0.08;
/// Share of the way to the centre of a cell at which its corners are looked at.
const INWARDS: f64 = 1e-5;
/// Halvings of cells that a border cuts: 64 parts, or 32 of a line.
const LEVELS: [usize; 2] = [2, 5];
/// Least weight of a model that counts as there: above the round-off of one less a weight.
const FLOOR: f64 = 2e-7;

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
    /// Measure of cells that borders of several models cut, which is found by samples.
    sampled: T,
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

/// What was found of an interface: the share of its overlap outside the mediator, and what a user should
/// know.
#[derive(Default)]
pub(super) struct TieFindings {
    pub(super) outside: f64,
    pub(super) warnings: Vec<String>,
}

/// What was found for every group and every interface.
type Findings = (Vec<PartitionReport>, Vec<Result<TieFindings>>);

/// Deviation of the sum of weights from one that is round-off.
fn tolerance<T: Real>() -> T {
    T::of(ROUND_OFF).max(T::epsilon() * T::of(64.0))
}

/// Checks all groups.
pub(super) fn check<T: Real>(subdomains: &[Subdomain<T>], specs: &[InterfaceSpec<T>]) -> Result<Findings> {
    let mut found: Vec<_> = specs.iter().map(|_| Ok(TieFindings::default())).collect();
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
            for (k, t) in group.ties.iter().enumerate() {
                let mass = (k == 0).then(|| group.mass_warning(&report)).flatten();
                found[t.number] = outside_of(t).map(|outside| TieFindings {
                    outside,
                    warnings: mass.into_iter().chain(beside(t, outside)).collect(),
                });
            }
        }
        reports.push(report);
    }
    Ok((reports, found))
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
        let members: Vec<_> = numbers.iter().map(member).collect();
        let tie = |(number, s): (usize, &'a InterfaceSpec<T>)| {
            let sides = [place(s.coarse)?, place(s.fine)?];
            let rough = sides.iter().any(|k| members[*k].extent.is_particles());
            Some(Tie::new(number, s, sides, rough))
        };
        Self {
            ties: specs.iter().enumerate().filter_map(tie).collect(),
            members,
            measure: T::zero(),
            shared: T::zero(),
            sampled: T::zero(),
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
        self.check_means()?;
        let mut weighted = T::zero();
        let mut known = true;
        for m in 0..self.members.len() {
            let volume = self.fill(m);
            known &= volume > T::zero();
            weighted += self.weighted(m, volume)?;
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
        let chance = self.ties.iter().map(|t| t.filling.chance()).fold(0.0, f64::max);
        let limit = if particles { PARTICLES + chance } else { MASS };
        let nodal = |m: &Member<'_, T>| m.subdomain.weights().weighting == Weighting::Nodal;
        let undecided = UNDECIDED * relative(self.sampled);
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

    /// Says how much mass an overlap has too much or too little, where that is accepted.
    fn mass_warning(&self, report: &PartitionReport) -> Option<String> {
        let amount = report.excess_mass;
        if amount.abs() <= MASS {
            return None;
        }
        let (name, word) = (
            report.models.join("', '"),
            if amount > 0.0 { "more" } else { "less" },
        );
        let mut out = format!(
            "models '{name}': their weighted masses together are {:.1} % of the overlap's {word} than that of the space they fill (above \
             {:.0} %)",
            100.0 * amount.abs(),
            100.0 * MASS
        );
        let cubes = self
            .ties
            .iter()
            .filter_map(|t| Some((t, t.filling.worst_cube()?)));
        if let Some((t, (point, size, volumes))) = cubes.last() {
            let [a, b] = t.sides.map(|k| self.members[k].name());
            let [x, y, z] = numbers(&point);
            out += &format!(
                "; around ({x:.3e}, {y:.3e}, {z:.3e}) m, within {:.1e} m, '{a}' has {:.3e} m³ and '{b}' {:.3e} m³",
                size.as_f64(),
                volumes[0].as_f64(),
                volumes[1].as_f64()
            );
        }
        out += "; pack more evenly (more particles across, another seed), or put the overlap where the packing is denser or looser";
        Some(out)
    }

    /// Where weights are shared, neither model may fill more than the other: facets of one surface even out.
    fn alike(&self, t: &Tie<'_, T>) -> Result<()> {
        let sides = t.sides.map(|k| &self.members[k]);
        self.check_sections(t)?;
        if sides.iter().any(|m| m.extent.is_particles()) {
            return t.filling.check(t.name, sides.map(Member::name));
        }
        let more = t.only[0] - t.only[1];
        if more.abs() <= t.overlap * T::of(SHARE) {
            return Ok(());
        }
        let [a, b] = sides.map(Member::name);
        let [larger, smaller] = if more > T::zero() { [a, b] } else { [b, a] };
        Err(Error::UnequalShapes {
            interface: t.name.to_owned(),
            larger,
            smaller,
            amount: (more.abs() / t.overlap).as_f64(),
            limit: SHARE,
        })
    }

    /// Lines must have one section, or at least one mass per length: a model of points on a line may not know
    /// its section.
    fn check_sections(&self, t: &Tie<'_, T>) -> Result<()> {
        let mut lines = Vec::new();
        for k in t.sides {
            let m = &self.members[k];
            let Some(section) = m.extent.section() else {
                return Ok(());
            };
            let length: T = m.extent.cells().iter().map(Cell::measure).sum();
            lines.push((section, self.unweighted(k)?.into_iter().sum::<T>() / length));
        }
        let [(a, line_a), (b, line_b)] = lines[..] else {
            return Ok(());
        };
        let differ = |a: T, b: T| (a - b).abs() > a.min(b) * T::of(SHARE);
        if !differ(a, b) || !differ(line_a, line_b) {
            return Ok(());
        }
        let [first, second] = t.sides.map(|k| self.members[k].name());
        let [larger, smaller] = if a > b { [first, second] } else { [second, first] };
        Err(Error::UnequalShapes {
            interface: t.name.to_owned(),
            larger,
            smaller,
            amount: (a.max(b) / a.min(b)).as_f64() - 1.0,
            limit: SHARE,
        })
    }

    /// A model that nothing is tied to has all of itself: more than one counts as well as less.
    fn alone(&self) -> Result<()> {
        self.check_means()?;
        let member = &self.members[0];
        for x in member.subdomain.model().nodes() {
            for kind in 0..3 {
                let w = member.weight(kind).at(x);
                if !w.is_finite() || (w - T::one()).abs() > tolerance() {
                    return Err(self.violation(0, x, kind, Cover::Inside));
                }
            }
        }
        Ok(())
    }

    /// Inertia of the translations of a model without weights.
    fn unweighted(&self, m: usize) -> Result<Vec<T>> {
        let model = self.members[m].subdomain.model();
        let mut out = vec![T::zero(); model.layout().dofs()];
        model.lumped_inertia(&Uniform(T::one()), &mut out)?;
        out.truncate(model.layout().translations());
        Ok(out)
    }

    /// Measure that the weighted inertia of a model of some volume stands for.
    fn weighted(&self, m: usize, volume: T) -> Result<T> {
        let member = &self.members[m];
        let (whole, inertia) = (self.unweighted(m)?, member.subdomain.inertia());
        let components = member.subdomain.model().layout().components;
        let particles = member.extent.particles().unwrap_or_default();
        if particles.len() * components == whole.len() && !particles.is_empty() {
            let share = |k: usize| inertia[k * components] / whole[k * components];
            return Ok(particles
                .iter()
                .enumerate()
                .map(|(k, p)| p.measure * share(k))
                .sum());
        }
        let sum = |x: &[T]| x.iter().copied().sum::<T>();
        Ok(volume * sum(&inertia[..whole.len()]) / sum(&whole))
    }
}

/// Warns of an overlap that reaches beyond its mediator.
fn beside<T: Real>(t: &Tie<'_, T>, outside: f64) -> Option<String> {
    let [x, y, z] = numbers(&t.beside);
    (outside > BESIDE).then(|| {
        format!(
            "{:.1} % of the overlap lies outside of the mediator (above {:.0} %), such as ({x:.3e}, {y:.3e}, {z:.3e}) m: both models have \
             their share of the energy there, and only the mediator's elements beside it hold them together; let the mediator fill the \
             overlap, or end the overlap where the mediator does",
            100.0 * outside,
            100.0 * BESIDE
        )
    })
}

pub(super) fn numbers<T: Real>(x: &Point3<T>) -> [f64; 3] {
    [x.x.as_f64(), x.y.as_f64(), x.z.as_f64()]
}

//! Partition of unity: a check before the first step that the models of a run share everything exactly once.
//!
//! Models that interfaces tie to each other form a group; every other model is a group of its own. At every
//! node of a group, and at quadrature points of every cell, the weights of the models that are present must
//! sum to one. Near a surface, within the distance at which faceted meshes of one body differ or within the
//! roughness of particles, a model may count as present or as absent; the weight that is missing or in excess
//! there is summed and bounded. The mean of a weight over a cell must agree with its values.
//!
//! The weighted inertia of all models must be that of the space they fill together. A packing must fill as
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
use crate::weight::{Changed, Uniform, Weight, Weighting};
use crate::{Error, Real, Result};
use nalgebra::Point3;

/// Result of the check for one group of models that are tied to each other.
#[derive(Debug, Clone, PartialEq)]
pub struct PartitionReport {
    /// Names of the models.
    pub models: Vec<String>,
    /// True if the models were checked.
    pub checked: bool,
    /// Measure of the space that the models fill together \[m³, m for lines\]; zero for a model alone.
    pub measure: f64,
    /// Part of `measure` that more than one model fills.
    pub shared: f64,
    /// Weight missing at surfaces where the shapes of the models differ, relative to `shared`.
    pub missing: f64,
    /// Weighted inertia of all models, expressed as a measure, less `measure`, relative to `shared`. Positive
    /// if the overlap has more mass than the body, negative if it has less. The inertia of a model counts
    /// relative to its inertia without weights, so that densities may differ. A packing fills the volumes of
    /// its particles; where a body of cells is, the cells fill the space.
    pub excess_mass: f64,
}

/// Largest deviation of the sum of weights from one at a point that counts as round-off.
pub(super) const ROUND_OFF: f64 = 1e-6;
/// Largest share of the overlap that may be counted twice, that one model may fill beyond the other, or that
/// may lie beyond the reach of the mediator: differences between facets.
pub(super) const SHARE: f64 = 0.02;
/// Largest weight missing near surfaces, relative to the overlap: half of the difference between a square and
/// a circle of equal area. What one model lacks the other has in excess, so that the mass is right.
const MISSING: f64 = 0.1;
/// Largest deviation of the weighted inertia, relative to the overlap, beyond the weight missing at surfaces:
/// the error of quadrature at curved borders. Also the threshold of the warning.
const MASS: f64 = 0.02;
/// Largest deviation of the weighted inertia where particles take part, beside the chance error of few
/// particles.
const PARTICLES: f64 = 0.1;
/// Share of a cell that stays undecided if borders of several models cut it into 64 parts.
const UNDECIDED: f64 = 0.25;
/// Share of an overlap outside of its mediator above which there is a warning: prisms inscribed in round bars
/// leave up to 8 %.
const BESIDE: f64 = 0.08;
/// Distance from a corner at which its weight is read, towards the centre of the cell and relative to the
/// distance of the centre.
const INWARDS: f64 = 1e-5;
/// Halvings of a cell that a border cuts: 2 give 64 parts, and 5 give 32 parts of a line.
const LEVELS: [usize; 2] = [2, 5];
/// Least weight of a model that counts as present: above the round-off of one minus a weight.
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

/// Group of tied models during its check.
struct Group<'a, T: Real> {
    members: Vec<Member<'a, T>>,
    ties: Vec<Tie<'a, T>>,
    /// Places to look at; all if there are none.
    near: Option<&'a Changed<T>>,
    measure: T,
    shared: T,
    /// Measure of cells that borders of several models cut; it is found by samples.
    sampled: T,
    missing: [T; 3],
    excess: [T; 3],
    /// Largest weight times measure missing or in excess at a point, and the point, for each kind of weight.
    worst: [(T, Point3<T>); 3],
    covers: Vec<Cover>,
    /// Number of kinds of weight to check: one if all three are the same.
    kinds: usize,
    /// Kinetic weight of each member at the point under test; zero if the member cannot be there.
    kinetic: Vec<T>,
    /// Largest deviation of a sum of weights from one, and its error.
    broken: Option<(T, Error)>,
}

/// Findings about an interface: the share of its overlap outside of the mediator, and warnings.
#[derive(Default)]
pub(super) struct TieFindings {
    pub(super) outside: f64,
    pub(super) warnings: Vec<String>,
}

/// Reports of all groups and findings about all interfaces.
type Findings = (Vec<PartitionReport>, Vec<Result<TieFindings>>);

/// Largest deviation of a sum of weights from one that counts as round-off of `T`.
fn tolerance<T: Real>() -> T {
    T::of(ROUND_OFF).max(T::epsilon() * T::of(64.0))
}

/// Checks all groups; returns a report for each group and the findings about each interface.
pub(super) fn check<T: Real>(subdomains: &[Subdomain<T>], specs: &[InterfaceSpec<T>]) -> Result<Findings> {
    let mut findings: Vec<_> = specs.iter().map(|_| Ok(TieFindings::default())).collect();
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
            let mut group = Group::new(&numbers, subdomains, specs, None);
            group.check(&mut report)?;
            for (k, t) in group.ties.iter().enumerate() {
                // The mass is that of the group: its first interface reports it.
                let mass = (k == 0).then(|| group.mass_warning(&report)).flatten();
                findings[t.number] = outside_of(t).map(|outside| TieFindings {
                    outside,
                    warnings: mass.into_iter().chain(outside_warning(t, outside)).collect(),
                });
            }
        }
        reports.push(report);
    }
    Ok((reports, findings))
}

/// Checks the sums of the weights where these have changed. What depends on the models and the kind of their
/// weights was checked at set-up: shapes, fillings and masses, and means over cells.
pub(super) fn check_changes<T: Real>(
    subdomains: &[Subdomain<T>],
    specs: &[InterfaceSpec<T>],
    changed: &Changed<T>,
) -> Result<()> {
    for numbers in groups(subdomains.len(), specs) {
        let is_checked = |k: &usize| subdomains[*k].partition() == Partition::Checked;
        if numbers.len() < 2 || !numbers.iter().all(is_checked) {
            continue;
        }
        let mut group = Group::new(&numbers, subdomains, &[], Some(changed));
        (0..numbers.len()).for_each(|m| {
            group.fill(m);
        });
        if let Some((_, error)) = group.broken {
            return Err(error);
        }
    }
    Ok(())
}

/// Returns the numbers of the models in each group tied to each other, directly or through others.
fn groups<T: Real>(count: usize, specs: &[InterfaceSpec<T>]) -> Vec<Vec<usize>> {
    let mut group_of: Vec<usize> = (0..count).collect();
    for s in specs.iter().filter(|s| s.coarse < count && s.fine < count) {
        let (a, b) = (
            group_of[s.coarse].min(group_of[s.fine]),
            group_of[s.coarse].max(group_of[s.fine]),
        );
        // The smaller number wins, so each group ends with that of its first model.
        group_of.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
    }
    let members = |g: usize| (0..count).filter(|k| group_of[*k] == g).collect::<Vec<_>>();
    (0..count).map(members).filter(|m| !m.is_empty()).collect()
}

impl<'a, T: Real> Group<'a, T> {
    fn new(
        numbers: &[usize],
        subdomains: &'a [Subdomain<T>],
        specs: &'a [InterfaceSpec<T>],
        near: Option<&'a Changed<T>>,
    ) -> Self {
        let member = |&k: &usize| {
            let s = &subdomains[k];
            Member {
                extent: Extent::new(&**s.field(), s.model().views().particles, near),
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
            near,
            measure: T::zero(),
            shared: T::zero(),
            sampled: T::zero(),
            missing: [T::zero(); 3],
            excess: [T::zero(); 3],
            worst: [(T::zero(), Point3::origin()); 3],
            covers: vec![Cover::Outside; numbers.len()],
            // Most models have one weight for all three kinds: a third of the evaluations.
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
            return self.check_alone();
        }
        // Means before sums: a wrong mean would show up as a wrong mass, without a place.
        self.check_means()?;
        let mut weighted = T::zero();
        let mut known = true;
        for m in 0..self.members.len() {
            // A model with neither cells nor particles has no volume to compare.
            let volume = self.fill(m);
            known &= volume > T::zero();
            weighted += self.weighted(m, volume)?;
        }
        // A violation at a point names the place, so it comes before errors of sums.
        if let Some((_, error)) = self.broken.take() {
            return Err(error);
        }
        let [measure, shared] = [self.measure, self.shared];
        // Shares are relative to the overlap; models that only touch have none.
        let over = if shared > T::zero() { shared } else { measure };
        report.measure = measure.as_f64();
        report.shared = shared.as_f64();
        // Without volumes or without an overlap there is no share to judge; weights at points were judged
        // above.
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
        // After the sums of weights: unequal shapes are judged where the weights are known to fit.
        for t in &self.ties {
            self.check_shapes(t)?;
        }
        report.excess_mass = relative(weighted - measure);
        let particles = self.members.iter().any(|m| m.extent.is_particles());
        // The interface with the fewest particles decides.
        let chance = self.ties.iter().map(|t| t.filling.chance()).fold(0.0, f64::max);
        let limit = if particles { PARTICLES + chance } else { MASS };
        let nodal = |m: &Member<'_, T>| m.subdomain.weights().weighting == Weighting::Nodal;
        // Cells that several borders cut are measured by samples, whose error is bounded by their share.
        let undecided = UNDECIDED * relative(self.sampled);
        // Weights at nodes need not add up to the mass of the space.
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

    /// Returns a warning if an overlap has too much or too little mass, but no more than is accepted.
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

    /// Refuses an overlap that one model fills more than the other.
    fn check_shapes(&self, t: &Tie<'_, T>) -> Result<()> {
        let sides = t.sides.map(|k| &self.members[k]);
        // Lengths do not tell sections apart.
        self.check_sections(t)?;
        if sides.iter().any(|m| m.extent.is_particles()) {
            return t.filling.check(t.name, sides.map(Member::name));
        }
        let more = t.only[0] - t.only[1];
        // The difference, not the sum: facets of one surface lack here what they have in excess there.
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

    /// Refuses tied lines that differ both in section and in mass per length: a model of points on a line may
    /// not know its section.
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

    /// Checks a model without ties: its weights must be one at every node.
    fn check_alone(&self) -> Result<()> {
        self.check_means()?;
        let member = &self.members[0];
        for x in member.subdomain.model().nodes() {
            for kind in 0..3 {
                let w = member.weight(kind).value(x);
                // Not `> tolerance` alone: a NaN must be refused, too.
                if !w.is_finite() || (w - T::one()).abs() > tolerance() {
                    return Err(self.violation(0, x, kind, Cover::Inside));
                }
            }
        }
        Ok(())
    }

    /// Returns the inertia of the translations of a model without weights.
    fn unweighted(&self, m: usize) -> Result<Vec<T>> {
        let model = self.members[m].subdomain.model();
        let mut out = vec![T::zero(); model.layout().dofs()];
        model.lumped_inertia(&Uniform(T::one()), &mut out)?;
        out.truncate(model.layout().translations());
        Ok(out)
    }

    /// Returns the measure that the weighted inertia of a model stands for; `volume` is that of the model
    /// without weights.
    fn weighted(&self, m: usize, volume: T) -> Result<T> {
        let member = &self.members[m];
        let (whole, inertia) = (self.unweighted(m)?, member.subdomain.inertia());
        let components = member.subdomain.model().layout().components;
        // Each particle of a packing has its own weight; cells share one density.
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

/// Returns a warning if too much of an overlap lies outside of its mediator.
fn outside_warning<T: Real>(t: &Tie<'_, T>, outside: f64) -> Option<String> {
    let [x, y, z] = numbers(&t.outside_point);
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

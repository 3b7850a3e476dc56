//! Sample points of a group, and their contributions to its measures.

use super::{FLOOR, Group, INWARDS, KINDS, LEVELS, ROUND_OFF, numbers};
use crate::extent::{Cover, length};
use crate::geometry::{self, Cell, Sample, inner_bounds};
use crate::{Error, Real};
use nalgebra::{Point3, Vector3};

/// Sample point of a model.
struct Station<'a, T: Real> {
    member: usize,
    point: &'a Point3<T>,
    /// Measure that the point stands for; zero for a node.
    measure: T,
    /// Measure that the point adds to the filled space if its model is alone there.
    space: T,
    /// Length of the cell that contains the point \[m\]; zero for a particle.
    length: T,
}

impl<T: Real> Group<'_, T> {
    /// Visits nodes and quadrature points of a model and returns its measure.
    pub(super) fn fill(&mut self, m: usize) -> T {
        if let Some(particles) = self.members[m].extent.particles() {
            let particles: Vec<_> = particles.into();
            return self.fill_particles(m, &particles);
        }
        // A model without cells and particles can be checked at its nodes only.
        if self.members[m].extent.cells().is_empty() {
            let model = self.members[m].subdomain;
            for x in model.model().nodes() {
                self.visit(&Station::node(m, x, T::zero()));
            }
        }
        let mut total = T::zero();
        let mut samples: Vec<Sample<T>> = Vec::new();
        let cells: Vec<_> = self.members[m].extent.cells().into();
        let near = self.near;
        let is_near = |c: &&Cell<T>| near.is_none_or(|near| near(&inner_bounds(c)));
        for cell in cells.iter().filter(is_near) {
            let measure = cell.measure();
            total += measure;
            // Corners are read slightly inside of this cell, because weights may jump by epsilon at a border
            // of the overlap.
            let corners = cell.corners();
            let sum = corners.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
            let centre = Point3::from(sum / T::of(corners.len() as f64));
            for x in &corners {
                let inside = x + (centre - x) * T::of(INWARDS);
                self.visit(&Station::node(m, &inside, length(cell)));
            }
            // Away from all other models the corners alone are checked: most cells need no quadrature.
            if self.near_others(m, cell) {
                samples.clear();
                self.fill_cell(m, cell, &mut samples);
            } else {
                self.measure += measure;
            }
        }
        total
    }

    fn fill_particles(&mut self, m: usize, particles: &[Sample<T>]) -> T {
        for s in particles {
            self.visit(&Station {
                member: m,
                point: &s.point,
                measure: s.measure,
                space: s.measure,
                length: T::zero(),
            });
        }
        particles.iter().map(|s| s.measure).sum()
    }

    /// Visits the quadrature points of a cell that other models may fill too.
    fn fill_cell(&mut self, m: usize, cell: &Cell<T>, samples: &mut Vec<Sample<T>>) {
        let mut sampled = T::one();
        if self.is_cut(m, cell) {
            if let Some(common) = self.common(m, cell) {
                // The other model adds its half of the common space when its cells are visited.
                self.measure += cell.measure() - T::of(0.5) * common;
                sampled = T::zero();
            } else {
                self.sampled += cell.measure();
            }
            let levels = LEVELS[usize::from(matches!(cell, Cell::Segment { .. }))];
            for part in geometry::parts(cell, levels) {
                // The degree is low because the parts are many.
                part.quadrature(1, samples);
            }
        } else {
            cell.quadrature(2, samples);
        }
        for s in samples {
            self.visit(&Station {
                member: m,
                point: &s.point,
                measure: s.measure,
                space: s.measure * sampled,
                length: length(cell),
            });
        }
    }

    fn near_others(&self, m: usize, cell: &Cell<T>) -> bool {
        let bounds = cell.bounds();
        let mut other_members = self.members.iter().enumerate().filter(|(k, _)| *k != m);
        other_members.any(|(_, o)| o.extent.meets(&bounds))
    }

    /// Returns the exact measure that a cell has in common with the cells of the other models; `None` unless
    /// exactly one other model is near and has cells.
    fn common(&self, m: usize, cell: &Cell<T>) -> Option<T> {
        let bounds = cell.bounds();
        let other_members = self.members.iter().enumerate().filter(|(k, _)| *k != m);
        let mut near = other_members.filter(|(_, o)| !o.extent.is_particles() && o.extent.meets(&bounds));
        let (_, other) = near.next()?;
        (near.next().is_none() && !other.extent.cells().is_empty()).then(|| other.extent.common(cell))
    }

    /// Returns whether another model or a mediator fills a cell only in part, judged by its corners.
    fn is_cut(&self, m: usize, cell: &Cell<T>) -> bool {
        let corners = cell.corners();
        let partly = |inside: &dyn Fn(&Point3<T>) -> bool| {
            let first = inside(&corners[0]);
            corners.iter().any(|x| inside(x) != first)
        };
        let mut other_members = self.members.iter().enumerate().filter(|(k, _)| *k != m);
        other_members.any(|(_, o)| partly(&|x| o.extent.cover(x, T::zero()) >= Cover::Hole))
            || self
                .ties
                .iter()
                .any(|t| partly(&|x| t.extent.cover(x, T::zero()) == Cover::Inside))
    }

    /// Checks the sums of weights at a point and adds the point to the measures of the group.
    fn visit(&mut self, s: &Station<'_, T>) {
        // Extents are not whole elsewhere.
        if self.near.is_some_and(|near| !near(&[*s.point; 2])) {
            return;
        }
        let tolerance = super::tolerance::<T>();
        for (k, o) in self.members.iter().enumerate() {
            self.covers[k] = if k == s.member {
                Cover::Inside
            } else {
                o.extent.cover(s.point, s.length)
            };
        }
        let count = (0..self.members.len())
            .filter(|k| self.present(s.member, *k))
            .count();
        // Every model that is present visits this place, so each visit counts for a part of it.
        let part = s.measure / T::of(count as f64);
        let mut lacking = false;
        for kind in 0..self.kinds {
            // A broken weight was recorded; nothing is added for a point without a sum.
            let Some([sure, likely]) = self.sums(s, kind) else {
                return;
            };
            lacking |= likely < T::one() - tolerance;
            let zero = T::zero();
            let missing = (T::one() - likely).max(zero) * part;
            let excess = (likely.max(sure) - T::one()).max(zero) * part;
            self.missing[kind] += missing;
            self.excess[kind] += excess;
            if missing.max(excess) > self.worst[kind].0 {
                self.worst[kind] = (missing.max(excess), *s.point);
            }
        }
        self.measure += s.space * self.share_of_space(s.member);
        let floor = T::of(FLOOR);
        // Shared where a model has part of the energy, or where weight is missing that somebody should have.
        let split = (0..self.members.len()).any(|k| {
            self.present(s.member, k) && self.kinetic[k] > floor && self.kinetic[k] < T::one() - floor
        });
        if split || lacking {
            self.shared += part;
        }
        // Nodes have no measure to add.
        if s.measure > T::zero() {
            self.tie(s.point, part, lacking);
            self.account(s);
        }
    }

    /// Returns two sums of the weights at a point: over the models that are surely there, and over those that
    /// count as present. Keeps the largest violation in `broken`. `None` if a weight is negative or not
    /// finite.
    fn sums(&mut self, s: &Station<'_, T>, kind: usize) -> Option<[T; 2]> {
        let tolerance = super::tolerance::<T>();
        let (mut sure, mut likely, mut most) = (T::zero(), T::zero(), T::zero());
        for (k, o) in self.members.iter().enumerate() {
            // With one kind of weight, the first stands for the kinetic weight too.
            if kind < 2 {
                self.kinetic[k] = T::zero();
            }
            if self.covers[k] == Cover::Outside {
                continue;
            }
            let w = o.weight(kind).value(s.point);
            if kind < 2 {
                self.kinetic[k] = w;
            }
            if !w.is_finite() || w < -tolerance {
                let error = self.violation(s.member, s.point, kind, Cover::Surface);
                self.broken = Some((T::of(f64::MAX), error));
                return None;
            }
            most += w;
            if self.present(s.member, k) {
                likely += w;
            }
            if self.covers[k] == Cover::Inside {
                sure += w;
            }
        }
        // The sum is certainly too small if even all models that may be there sum to less than one, and
        // certainly too large if the models that are surely there sum to more.
        let (lack, surplus) = (T::one() - most, sure - T::one());
        let (gap, least) = if surplus > lack {
            (surplus, Cover::Inside)
        } else {
            (lack, Cover::Surface)
        };
        if gap > tolerance && self.broken.as_ref().is_none_or(|b| gap > b.0) {
            self.broken = Some((gap, self.violation(s.member, s.point, kind, least)));
        }
        Some([sure, likely])
    }

    /// Returns whether model `k` counts as present at a point of model `m`.
    fn present(&self, m: usize, k: usize) -> bool {
        // Surfaces of packings are rough, and what a packing fills is judged by the volumes of its particles.
        // So beside a packing a model counts wherever it may be.
        let rough = [m, k].iter().any(|i| self.members[*i].extent.is_particles());
        self.covers[k] >= if rough { Cover::Surface } else { Cover::Hole }
    }

    /// Returns the share of the filled space that a point of model `m` accounts for: an equal one for each
    /// model there. Where there are cells, they fill the space and particles have no share.
    fn share_of_space(&self, m: usize) -> T {
        let floor = T::of(FLOOR);
        let counted = |k: &usize| {
            let o = &self.members[*k].extent;
            let weighs = self.kinetic[*k] > floor;
            match (*k == m, o.is_particles(), self.members[m].extent.is_particles()) {
                (true, ..) => true,
                (_, true, true) => self.covers[*k] != Cover::Outside && weighs,
                (_, false, true) => {
                    self.covers[*k] == Cover::Inside || (self.covers[*k] == Cover::Surface && weighs)
                }
                (_, false, false) => self.covers[*k] == Cover::Inside,
                (_, true, false) => false,
            }
        };
        let present_models = || (0..self.members.len()).filter(counted);
        let cells = present_models()
            .filter(|k| !self.members[*k].extent.is_particles())
            .count();
        if cells > 0 && self.members[m].extent.is_particles() {
            return T::zero();
        }
        T::one() / T::of(present_models().count() as f64)
    }

    /// Adds a point to the overlap of each mediator that should hold it; several mediators between the same
    /// models count together.
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
            // Points farther than half an element from the mediator have no multiplier near them.
            let near = inside || alike.any(|t| t.extent.is_within(x, t.spacing * T::of(0.5)));
            let t = &mut self.ties[k];
            t.overlap += part;
            if !inside {
                t.outside += part;
                t.outside_point = *x;
            }
            if !near {
                t.deep += part;
                t.deep_point = *x;
            }
        }
    }

    /// Adds a point to the volumes that are compared in the overlap of a packing.
    fn account(&mut self, s: &Station<'_, T>) {
        let floor = T::of(FLOOR);
        let members = &self.members;
        for t in &mut self.ties {
            let Some(side) = t.sides.iter().position(|k| *k == s.member) else {
                continue;
            };
            if !t.filling.rough {
                continue;
            }
            let is_shared = |x: &Point3<T>| (t.sides.iter()).all(|k| members[*k].weight(1).value(x) > floor);
            let share = if s.length > T::zero() {
                T::of(f64::from(u8::from(is_shared(s.point))))
            } else {
                shared_part(s, is_shared)
            };
            if share > T::zero() {
                t.filling.add(side, s.point, s.measure * share, s.length);
            }
        }
    }

    /// Returns the error for a sum of weights at a point of model `m`, over `m` and all models whose cover is
    /// at least `least`.
    pub(super) fn violation(&self, m: usize, x: &Point3<T>, kind: usize, least: Cover) -> Error {
        let mut sum = T::zero();
        let mut present = Vec::new();
        for (k, o) in self.members.iter().enumerate() {
            if k == m || self.covers[k] >= least {
                let w = o.weight(kind).value(x);
                sum += w;
                present.push(format!("'{}' {:.6}", o.name(), w.as_f64()));
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

/// Returns the part of a particle's volume that lies in an overlap, judged at the octants of a cube of its
/// size.
fn shared_part<T: Real>(s: &Station<'_, T>, is_shared: impl Fn(&Point3<T>) -> bool) -> T {
    let quarter = T::of(0.25) * s.measure.cbrt();
    let octant = |k: usize| {
        let offset = |c: usize| if k >> c & 1 == 0 { -quarter } else { quarter };
        s.point + Vector3::new(offset(0), offset(1), offset(2))
    };
    // Thus a layer of particles on the border of the overlap counts as half.
    let count = (0..8).filter(|k| is_shared(&octant(*k))).count();
    T::of(count as f64 / 8.0)
}

impl<'a, T: Real> Station<'a, T> {
    /// Returns a sample point without measure: a node, or a corner of a cell of the given length.
    fn node(member: usize, point: &'a Point3<T>, length: T) -> Self {
        Self {
            member,
            point,
            measure: T::zero(),
            space: T::zero(),
            length,
        }
    }
}

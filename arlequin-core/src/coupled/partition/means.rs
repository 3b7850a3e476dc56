//! Check that the mean of a weight over each cell agrees with its values.

use super::{Group, INWARDS, KINDS, numbers};
use crate::geometry::{self, Cell, Sample};
use crate::weight::{Weight, Weighting};
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Largest difference of a mean that counts as quadrature error, relative to the range of the weight in the
/// cell: with the whole cell, and with the cell cut into parts. A jump may lie between two layers of points.
const QUADRATURE: [f64; 2] = [0.01, 0.25];
/// Largest number of particles of a packing from which a line to the next particle stands for a bond.
const LINES: usize = 2_000;
/// Largest jump of a weight at an end of such a line that is ignored, and is then accepted in the mean over
/// the line.
const JUMP: f64 = 1e-3;

impl<T: Real> Group<'_, T> {
    /// Refuses a weight whose mean over a cell is not that of its values.
    pub(super) fn check_means(&self) -> Result<()> {
        for m in &self.members {
            // Nodal weighting takes values at nodes and no means.
            if m.subdomain.weights().weighting == Weighting::Nodal {
                continue;
            }
            // The bonds of a packing are not known here: lines between neighbours stand for them.
            let lines = m.extent.particles().map(|p| {
                let mut lines = lines_between(p);
                lines.retain(|l| (0..self.kinds).all(|kind| is_beside_jumps(m.weight(kind), l)));
                lines
            });
            let cells = lines.as_deref().unwrap_or(m.extent.cells());
            let slack = T::of(if lines.is_some() { JUMP } else { 0.0 });
            for (kind, share) in KINDS.into_iter().enumerate().take(self.kinds) {
                for cell in cells {
                    if let Some(fault) = mean_defect(m.weight(kind), cell, slack) {
                        return Err(Error::WeightMean {
                            model: m.name(),
                            kind: share,
                            point: Box::new(numbers(&centre_of(&cell.corners()))),
                            mean: fault[0].as_f64(),
                            values: fault[1].as_f64(),
                            limit: fault[2].as_f64(),
                        });
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns lines between particles that follow each other in the list, which are near each other.
fn lines_between<T: Real>(particles: &[Sample<T>]) -> Vec<Cell<T>> {
    // Evenly through the list: a check with a bound on its cost, whatever the size of the packing.
    let stride = particles.len().div_ceil(LINES).max(1);
    let pairs = particles.windows(2).step_by(stride);
    let line = |pair: &[Sample<T>]| Cell::Segment {
        ends: [pair[0].point, pair[1].point],
        section: T::one(),
    };
    pairs.map(line).collect()
}

/// Returns whether a weight has no jump near the ends of a line.
fn is_beside_jumps<T: Real>(weight: &dyn Weight<T>, line: &Cell<T>) -> bool {
    // A step much shorter than the line, and much longer than its round-off.
    let step = crate::extent::length(line) * T::of(1e-4);
    // Along a border of the overlap a weight jumps and has no mean.
    line.corners().iter().all(|x| {
        let value = weight.value(x);
        let nearby_value = |k: usize| {
            let mut d = Vector3::zeros();
            d[k / 2] = if k.is_multiple_of(2) { step } else { -step };
            weight.value(&(x + d))
        };
        (0..6).all(|k| (nearby_value(k) - value).abs() < T::of(JUMP))
    })
}

fn centre_of<T: Real>(corners: &[Point3<T>]) -> Point3<T> {
    let sum = corners.iter().fold(Vector3::zeros(), |s, x| s + x.coords);
    Point3::from(sum / T::of(corners.len() as f64))
}

/// Returns the mean of a weight over a cell, the mean of its values there and the accepted difference, if the
/// two differ by more. `slack` is accepted beside the error of quadrature.
fn mean_defect<T: Real>(weight: &dyn Weight<T>, cell: &Cell<T>, slack: T) -> Option<[T; 3]> {
    let corners = cell.corners();
    let centre = centre_of(&corners);
    let mean = weight.mean(cell);
    let inside = corners.iter().map(|x| x + (centre - x) * T::of(INWARDS));
    let corners: Vec<T> = inside.map(|x| weight.value(&x)).collect();
    // Shortcut for almost all cells: the weight is constant in the cell.
    if corners.iter().all(|v| *v == mean) {
        return None;
    }
    let mut samples = Vec::new();
    let mut values = T::zero();
    let mut limit = T::zero();
    let finest = super::LEVELS[usize::from(matches!(cell, Cell::Segment { .. }))];
    // The whole cell suffices for most; only the others are cut into parts.
    for (levels, share) in [0, finest].into_iter().zip(QUADRATURE) {
        samples.clear();
        for part in geometry::parts(cell, levels) {
            part.quadrature(2, &mut samples);
        }
        let (mut sum, mut total) = (T::zero(), T::zero());
        let (mut low, mut high) = (corners[0], corners[0]);
        corners
            .iter()
            .for_each(|v| (low, high) = (low.min(*v), high.max(*v)));
        for s in &samples {
            let v = weight.value(&s.point);
            (low, high) = (low.min(v), high.max(v));
            sum += v * s.measure;
            total += s.measure;
        }
        values = sum / total;
        limit = super::tolerance::<T>() + slack + (high - low) * T::of(share);
        if (mean - values).abs() <= limit {
            return None;
        }
    }
    Some([mean, values, limit])
}

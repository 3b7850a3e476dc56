//! Volume of a body along an axis, so that spheres start evenly in it.

use super::container::Container;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Smallest and largest number of slabs in which a body is sampled.
const LEAST_SLABS: usize = 128;
const MOST_SLABS: usize = 16_384;
/// Points along each edge of the grid in a section, points of a section that is sampled again, and the share
/// of the grid below which it is.
const GRID: usize = 24;
const MOST_POINTS: usize = 40_000;
const FEW: f64 = 1.0 / 8.0;

/// Returns the area of a body's section across `axis` at `plane`, in points of a grid over the bounding box.
///
/// A grid coarser than the spheres may miss limbs that hold spheres, or hit them too often. A section that
/// fills little of the box is therefore sampled once more, by points of a sequence without lattice lines (the
/// additive recurrence of the plastic number), which goes on from section to section.
fn section(container: &Container, axis: usize, plane: f64, (radius, number): (f64, usize)) -> f64 {
    let (low, high) = container.bounds();
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let is_inside = |u: f64, v: f64| {
        let mut x = Vector3::zeros();
        x[axis] = plane;
        x[b] = low[b] + (high[b] - low[b]) * u;
        x[c] = low[c] + (high[c] - low[c]) * v;
        container.contains(&x)
    };
    let middle = |i: usize| (i as f64 + 0.5) / GRID as f64;
    let whole = GRID * GRID;
    let grid = (0..whole).filter(|k| is_inside(middle(k % GRID), middle(k / GRID)));
    let hits = grid.count() as f64;
    let (wide, high) = (high[b] - low[b], high[c] - low[c]);
    if hits >= FEW * whole as f64 || wide.max(high) <= GRID as f64 * radius {
        return hits;
    }
    // One to two points per section of a sphere.
    let points = ((0.5 * wide * high / (radius * radius)) as usize).clamp(whole, MOST_POINTS);
    // Multiples of powers of the plastic number fill the square evenly, and any part of the sequence does so
    // too.
    let place = |k: usize| [PLASTIC, PLASTIC * PLASTIC].map(|p| (0.5 + k as f64 / p).fract());
    let again = (number * points..(number + 1) * points)
        .map(place)
        .filter(|[u, v]| is_inside(*u, *v))
        .count();
    again as f64 * whole as f64 / points as f64
}

/// The plastic number, the real root of `x³ = x + 1`.
const PLASTIC: f64 = 1.324_717_957_244_746;

/// Cumulative volume along one axis, for sampling slabs of equal volume.
pub(super) struct Profile {
    low: f64,
    slab: f64,
    /// Width over which a sample is spread \[m\]: the section is known per slab only.
    pub(super) blur: f64,
    cumulative: Vec<f64>,
}

impl Profile {
    /// Samples the sections of a body for spheres of mean radius `radius` \[m\].
    pub(super) fn new(container: &Container, axis: usize, radius: f64) -> Self {
        let (low, high) = container.bounds();
        let extent = high[axis] - low[axis];
        if !matches!(container, Container::Surface(_) | Container::Around(_)) {
            // Boxes, and cylinders along their longest axis, have a constant section. A flat cylinder has
            // not, but it is thin and sampled along a diameter.
            return Self {
                low: low[axis],
                slab: extent,
                blur: 0.0,
                cumulative: vec![0.0, 1.0],
            };
        }
        // A limb across the axis is as thick as the planes that hit it are many: a sphere has eight of them.
        let slabs = ((4.0 * extent / radius).ceil() as usize).clamp(LEAST_SLABS, MOST_SLABS);
        let slab = extent / slabs as f64;
        let plane = |s: usize| low[axis] + slab * (s as f64 + 0.5);
        let section = |s: usize| section(container, axis, plane(s), (radius, s));
        let sections: Vec<f64> = (0..slabs).into_par_iter().map(section).collect();
        let mut cumulative = vec![0.0];
        let mut total = 0.0;
        for share in sections {
            total += share;
            cumulative.push(total);
        }
        cumulative.iter_mut().for_each(|c| *c /= total.max(1.0));
        Self {
            low: low[axis],
            slab,
            blur: slab,
            cumulative,
        }
    }

    /// Returns the coordinate below which the fraction `q` of the volume lies.
    pub(super) fn quantile(&self, q: f64) -> f64 {
        let k = self
            .cumulative
            .partition_point(|c| *c <= q)
            .clamp(1, self.cumulative.len() - 1);
        let (a, b) = (self.cumulative[k - 1], self.cumulative[k]);
        let t = if b > a { (q - a) / (b - a) } else { 0.5 };
        self.low + self.slab * (k as f64 - 1.0 + t)
    }
}

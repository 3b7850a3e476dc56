//! Volumes that a packing and the other model fill of an overlap, compared in total and cube by cube.

use super::numbers;
use crate::geometry::bounds_of;
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Largest accepted difference of the volumes, relative to the overlap, beside the chance error of few
/// particles.
const UNEQUAL: f64 = 0.1;
/// Largest accepted difference of the volumes in a cube, relative to the fuller model there.
const UNEVEN: f64 = 0.3;
/// Least number of particles per cube, and (`CELLS`) least edge of a cube in lengths of cells, for
/// well-sampled volumes.
const PARTICLES: f64 = 100.0;
const CELLS: f64 = 1.5;

/// Volumes that the two models of an interface fill of its overlap, the region where both have a weight.
pub(in crate::coupled) struct Filling<T: Real> {
    /// True if one of the models is a packing; otherwise nothing is recorded.
    pub(super) rough: bool,
    /// Side, position and volume of each sample.
    samples: Vec<(usize, Point3<T>, T)>,
    /// Number of particles of each side; zero for cells.
    particles: [usize; 2],
    longest: T,
}

impl<T: Real> Filling<T> {
    pub(in crate::coupled) fn new(rough: bool) -> Self {
        Self {
            rough,
            samples: Vec::new(),
            particles: [0; 2],
            longest: T::zero(),
        }
    }

    /// Adds a particle (`length` zero) or a part of a cell of the given length.
    pub(super) fn add(&mut self, side: usize, x: &Point3<T>, measure: T, length: T) {
        self.samples.push((side, *x, measure));
        if length > T::zero() {
            self.longest = self.longest.max(length);
        } else {
            self.particles[side] += 1;
        }
    }

    /// Returns the share of an overlap by which few particles may miss its volume by chance; zero without
    /// particles.
    pub(super) fn chance(&self) -> f64 {
        let fewest = self.particles.iter().filter(|n| **n > 0).min();
        // Counting error of the fewest particles, `1/√n`.
        fewest.map_or(0.0, |n| 1.0 / (*n as f64).sqrt())
    }

    fn volumes(&self) -> [T; 2] {
        let mut sums = [T::zero(); 2];
        self.samples.iter().for_each(|(side, _, v)| sums[*side] += *v);
        sums
    }

    /// Refuses a packing that fills more or less of the overlap than the other model, in total or in one
    /// cube.
    pub(super) fn check(&self, interface: &str, models: [String; 2]) -> Result<()> {
        if self.samples.is_empty() {
            return Ok(());
        }
        let [a, b] = self.volumes();
        // Cells fill the space exactly; of two packings either may be right.
        let space = match self.particles {
            [0, _] => a,
            [_, 0] => b,
            _ => T::of(0.5) * (a + b),
        };
        let limit = UNEQUAL + self.chance();
        let amount = ((a - b) / space).as_f64();
        let by_size = |more: T| {
            let [a, b] = models.clone();
            if more > T::zero() { (a, b) } else { (b, a) }
        };
        if amount.abs() > limit {
            let (larger, smaller) = by_size(a - b);
            return Err(Error::UnequalShapes {
                interface: interface.to_owned(),
                larger,
                smaller,
                amount: amount.abs(),
                limit,
            });
        }
        let Some((point, size, [a, b])) = self.worst_cube() else {
            return Ok(());
        };
        let amount = ((a - b).abs() / a.max(b)).as_f64();
        if amount <= UNEVEN {
            return Ok(());
        }
        let (larger, smaller) = by_size(a - b);
        Err(Error::UnevenFilling {
            interface: interface.to_owned(),
            larger,
            smaller,
            amount,
            limit: UNEVEN,
            point: Box::new(numbers(&point)),
            size: size.as_f64(),
        })
    }

    /// Returns centre and edge \[m\] of the cube in which the volumes differ most, and both volumes; `None`
    /// if there is only one cube.
    pub(super) fn worst_cube(&self) -> Option<(Point3<T>, T, [T; 2])> {
        let count: usize = self.particles.iter().sum();
        let grains = self.samples.iter().filter(|s| self.particles[s.0] > 0);
        let volume = grains.map(|s| s.2).sum::<T>() / T::of(count as f64);
        // Large enough for both: enough particles, and more than one cell.
        let least = (volume * T::of(PARTICLES))
            .cbrt()
            .max(self.longest * T::of(CELLS));
        let [low, high] = bounds_of(self.samples.iter().map(|s| &s.1));
        let numbers = (high - low).map(|l| (l / least).as_f64().floor().max(1.0));
        let counts = [0, 1, 2].map(|c| numbers[c] as usize);
        if counts == [1; 3] {
            return None;
        }
        // A direction that is shorter than a cube has one cube of full size.
        let edges = Vector3::from_fn(|c, _| ((high - low)[c] / T::of(numbers[c])).max(least));
        let mut cubes = vec![[T::zero(); 2]; counts.iter().product()];
        for (side, x, v) in &self.samples {
            spread(x - low, *v, &edges, counts, &mut |k, part| {
                cubes[k][*side] += part;
            });
        }
        // Cubes that are less than half full lie at the border of the overlap and have too few samples.
        let full = edges.iter().fold(T::of(0.5), |p, e| p * *e);
        let difference = |[a, b]: &[T; 2]| (*a - *b).abs() / a.max(*b);
        let filled = cubes.iter().enumerate().filter(|(_, [a, b])| a.max(*b) >= full);
        let worst = filled.max_by(|a, b| difference(a.1).as_f64().total_cmp(&difference(b.1).as_f64()))?;
        let place = [
            worst.0 % counts[0],
            worst.0 / counts[0] % counts[1],
            worst.0 / counts[0] / counts[1],
        ];
        let centre = Vector3::from_fn(|c, _| (T::of(place[c] as f64) + T::of(0.5)) * edges[c]);
        Some((low + centre, edges.amax(), *worst.1))
    }
}

/// Distributes the volume of a cube centred at `x` over the cubes of the grid that it meets. Parts beyond the
/// grid go to its outermost cubes.
fn spread<T: Real>(
    x: Vector3<T>,
    volume: T,
    edges: &Vector3<T>,
    counts: [usize; 3],
    give: &mut dyn FnMut(usize, T),
) {
    let half = T::of(0.5) * volume.cbrt();
    let cubes_along = |c: usize| {
        let [low, high] = [x[c] - half, x[c] + half].map(|x| (x / edges[c]).as_f64());
        let first = low.floor() as i64;
        (first..=high.floor() as i64).map(move |k| {
            let part = (high.min(k as f64 + 1.0) - low.max(k as f64)) / (high - low);
            (k.clamp(0, counts[c] as i64 - 1) as usize, part)
        })
    };
    for (i, a) in cubes_along(0) {
        for (j, b) in cubes_along(1) {
            for (k, c) in cubes_along(2) {
                give((k * counts[1] + j) * counts[0] + i, volume * T::of(a * b * c));
            }
        }
    }
}

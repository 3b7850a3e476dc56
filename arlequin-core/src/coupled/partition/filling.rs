//! What a packing fills of an overlap beside what the other model fills: by volumes, in all and cube by cube.

use super::numbers;
use crate::geometry::bounds_of;
use crate::{Error, Real, Result};
use nalgebra::{Point3, Vector3};

/// Difference that is refused, relative to the overlap, beside what is left to chance among few particles.
const UNEQUAL: f64 = 0.1;
/// The same in a cube, relative to what the fuller model has there.
const UNEVEN: f64 = 0.3;
/// Least number of particles per cube, and least edge of a cube in lengths of cells: volumes are well
/// sampled.
const PARTICLES: f64 = 100.0;
const CELLS: f64 = 1.5;

/// What either model of an interface fills of its overlap, which is where both have a weight.
pub(in crate::coupled) struct Filling<T: Real> {
    /// Whether one of them is a packing; else nothing is kept.
    pub(super) rough: bool,
    /// Sides, places and volumes.
    samples: Vec<(usize, Point3<T>, T)>,
    /// Particles of either side; zero for cells.
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

    /// Adds a particle (of no length) or a part of a cell of the length given.
    pub(super) fn add(&mut self, side: usize, x: &Point3<T>, measure: T, length: T) {
        self.samples.push((side, *x, measure));
        if length > T::zero() {
            self.longest = self.longest.max(length);
        } else {
            self.particles[side] += 1;
        }
    }

    /// Share of an overlap by which so few particles may miss it by chance; zero without particles.
    pub(super) fn chance(&self) -> f64 {
        let fewest = self.particles.iter().filter(|n| **n > 0).min();
        fewest.map_or(0.0, |n| 1.0 / (*n as f64).sqrt())
    }

    fn volumes(&self) -> [T; 2] {
        let mut sums = [T::zero(); 2];
        self.samples.iter().for_each(|(side, _, v)| sums[*side] += *v);
        sums
    }

    /// Refuses a packing that fills more or less of the overlap than the other model, in all or somewhere.
    pub(super) fn check(&self, interface: &str, models: [String; 2]) -> Result<()> {
        if self.samples.is_empty() {
            return Ok(());
        }
        let [a, b] = self.volumes();
        // Cells tell what there is to fill; of two packings either may be right.
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

    /// Centre and edge of the cube in which volumes differ most, with both; none if there is but one cube.
    pub(super) fn worst_cube(&self) -> Option<(Point3<T>, T, [T; 2])> {
        let count: usize = self.particles.iter().sum();
        let grains = self.samples.iter().filter(|s| self.particles[s.0] > 0);
        let volume = grains.map(|s| s.2).sum::<T>() / T::of(count as f64);
        let least = (volume * T::of(PARTICLES))
            .cbrt()
            .max(self.longest * T::of(CELLS));
        let [low, high] = bounds_of(self.samples.iter().map(|s| &s.1));
        let numbers = (high - low).map(|l| (l / least).as_f64().floor().max(1.0));
        let counts = [0, 1, 2].map(|c| numbers[c] as usize);
        if counts == [1; 3] {
            return None;
        }
        let edges = Vector3::from_fn(|c, _| ((high - low)[c] / T::of(numbers[c])).max(least));
        let mut cubes = vec![[T::zero(); 2]; counts.iter().product()];
        for (side, x, v) in &self.samples {
            spread(x - low, *v, &edges, counts, &mut |k, part| {
                cubes[k][*side] += part;
            });
        }
        let full = edges.iter().fold(T::of(0.5), |p, e| p * *e);
        let apart = |[a, b]: &[T; 2]| (*a - *b).abs() / a.max(*b);
        let filled = cubes.iter().enumerate().filter(|(_, [a, b])| a.max(*b) >= full);
        let worst = filled.max_by(|a, b| apart(a.1).as_f64().total_cmp(&apart(b.1).as_f64()))?;
        let place = [
            worst.0 % counts[0],
            worst.0 / counts[0] % counts[1],
            worst.0 / counts[0] / counts[1],
        ];
        let centre = Vector3::from_fn(|c, _| (T::of(place[c] as f64) + T::of(0.5)) * edges[c]);
        Some((low + centre, edges.amax(), *worst.1))
    }
}

/// Deals a volume out to the cubes that a cube of its size meets; what is beyond the outermost ones is
/// theirs.
fn spread<T: Real>(
    x: Vector3<T>,
    volume: T,
    edges: &Vector3<T>,
    counts: [usize; 3],
    give: &mut dyn FnMut(usize, T),
) {
    let half = T::of(0.5) * volume.cbrt();
    let along = |c: usize| {
        let [low, high] = [x[c] - half, x[c] + half].map(|x| (x / edges[c]).as_f64());
        let first = low.floor() as i64;
        (first..=high.floor() as i64).map(move |k| {
            let part = (high.min(k as f64 + 1.0) - low.max(k as f64)) / (high - low);
            (k.clamp(0, counts[c] as i64 - 1) as usize, part)
        })
    };
    for (i, a) in along(0) {
        for (j, b) in along(1) {
            for (k, c) in along(2) {
                give((k * counts[1] + j) * counts[0] + i, volume * T::of(a * b * c));
            }
        }
    }
}

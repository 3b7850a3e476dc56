//! Distribution of a model's units among ranks, by recursive bisection.

use super::{RankError, UNIT};
use crate::Real;
use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Unit of a model: position and work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Mean position of its nodes \[m\].
    pub centre: Point3<f64>,
    /// Cost of a step of the unit, in any measure.
    pub work: f64,
}

impl Unit {
    /// Returns the units of a model with these nodes \[m\]. `work`: cost of a range of nodes.
    #[must_use]
    pub fn from_nodes<T: Real>(nodes: &[Point3<T>], work: impl Fn(Range<usize>) -> f64) -> Vec<Self> {
        let unit = |first: usize| {
            let range = first..nodes.len().min(first + UNIT);
            let sum: Vector3<T> = nodes[range.clone()].iter().map(|x| x.coords).sum();
            Self {
                centre: Point3::from(sum.map(|c| c.as_f64() / range.len() as f64)),
                work: work(range),
            }
        };
        (0..nodes.len()).step_by(UNIT).map(unit).collect()
    }
}

/// Owner of each unit of [`UNIT`] nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Division {
    nodes: usize,
    ranks: usize,
    owners: Vec<u32>,
    /// Work of each rank.
    work: Vec<f64>,
}

impl Division {
    /// Splits the units of `nodes` nodes into parts of equal work, each time across the longest extent. The
    /// result is the same on every rank. Ranks beyond the number of units get no unit.
    ///
    /// ```
    /// use arlequin_core::nalgebra::Point3;
    /// use arlequin_core::ranks::{Division, UNIT, Unit};
    /// let unit = |k: usize| Unit { centre: Point3::new(k as f64, 0.0, 0.0), work: 1.0 };
    /// let units: Vec<Unit> = (0..6).map(unit).collect();
    /// let halves = Division::bisect(6 * UNIT, &units, 2)?;
    /// assert_eq!(halves.units_of(1), [3, 4, 5]);
    /// # Ok::<(), arlequin_core::ranks::RankError>(())
    /// ```
    ///
    /// # Errors
    /// [`RankError::TooMany`] for no ranks or more ranks than nodes; [`RankError::Length`] if the number of
    /// `units` does not fit `nodes`.
    pub fn bisect(nodes: usize, units: &[Unit], ranks: usize) -> Result<Self, RankError> {
        let count = nodes.div_ceil(UNIT);
        if ranks == 0 || ranks > nodes {
            return Err(RankError::TooMany {
                ranks,
                nodes,
                units: count,
            });
        }
        if units.len() != count {
            return Err(RankError::Length {
                rank: 0,
                peer: 0,
                expected: count,
                found: units.len(),
            });
        }
        let mut out = Self {
            nodes,
            ranks,
            owners: vec![0; count],
            work: vec![0.0; ranks],
        };
        let mut order: Vec<u32> = (0..count as u32).collect();
        out.cut(&mut order, units, 0, ranks);
        Ok(out)
    }

    /// Distributes the units `these` among `ranks` ranks from `first` on.
    fn cut(&mut self, part: &mut [u32], units: &[Unit], first: usize, ranks: usize) {
        if ranks == 1 {
            for k in part.iter() {
                self.owners[*k as usize] = first as u32;
                self.work[first] += units[*k as usize].work;
            }
            return;
        }
        let centre = |k: &u32| units[*k as usize].centre;
        let corner = |numbers: &[u32], extreme: fn(f64, f64) -> f64, start: f64| {
            let mut out = [start; 3];
            for x in numbers.iter().map(centre) {
                (0..3).for_each(|c| out[c] = extreme(out[c], x[c]));
            }
            out
        };
        let low = corner(part, f64::min, f64::INFINITY);
        let high = corner(part, f64::max, f64::NEG_INFINITY);
        let extent = |c: usize| high[c] - low[c];
        let axis = (1..3).fold(0, |best, c| if extent(c) > extent(best) { c } else { best });
        // The number of a unit breaks ties, so that every rank finds the same order.
        part.sort_unstable_by(|a, b| centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.cmp(b)));
        // For any number of ranks: each side gets work in proportion to its ranks.
        let lower_ranks = ranks / 2;
        let total: f64 = part.iter().map(|k| units[*k as usize].work).sum();
        let middle = nearest_cut(part, units, total * lower_ranks as f64 / ranks as f64);
        // Each rank gets at least one unit while there are enough.
        let enough = part.len() >= ranks;
        let middle = if enough {
            middle.clamp(lower_ranks, part.len() - (ranks - lower_ranks))
        } else {
            middle
        };
        let (a, b) = part.split_at_mut(middle);
        self.cut(a, units, first, lower_ranks);
        self.cut(b, units, first + lower_ranks, ranks - lower_ranks);
    }

    /// Returns the number of nodes of the whole model.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Returns the number of ranks.
    #[must_use]
    pub fn ranks(&self) -> usize {
        self.ranks
    }

    /// Returns the rank that owns a node.
    ///
    /// # Panics
    /// If there is no such node.
    #[must_use]
    pub fn owner(&self, node: usize) -> usize {
        self.owners[node / UNIT] as usize
    }

    /// Returns the units of a rank, ascending.
    #[must_use]
    pub fn units_of(&self, rank: usize) -> Vec<u32> {
        let owned = (0..).zip(&self.owners);
        owned
            .filter(|(_, o)| **o as usize == rank)
            .map(|(k, _)| k)
            .collect()
    }

    /// Returns the number of ranks without a unit.
    #[must_use]
    pub fn idle(&self) -> usize {
        let mut works = vec![false; self.ranks];
        self.owners.iter().for_each(|o| works[*o as usize] = true);
        works.iter().filter(|w| !**w).count()
    }

    /// Returns the largest work of a rank over the mean, minus one.
    #[must_use]
    pub fn imbalance(&self) -> f64 {
        let most = self.work.iter().fold(0.0, |a: f64, b| a.max(*b));
        let total: f64 = self.work.iter().sum();
        if total > 0.0 {
            most * self.ranks as f64 / total - 1.0
        } else {
            0.0
        }
    }
}

/// Returns how many of the first units have a total work closest to `wanted`.
fn nearest_cut(part: &[u32], units: &[Unit], wanted: f64) -> usize {
    let mut sum = 0.0;
    for (k, u) in part.iter().enumerate() {
        let next = sum + units[*u as usize].work;
        if next >= wanted {
            return if next - wanted <= wanted - sum { k + 1 } else { k };
        }
        sum = next;
    }
    part.len()
}

#[cfg(test)]
mod tests {
    use super::{Division, RankError, UNIT, Unit};
    use nalgebra::Point3;

    /// A block of units, `n` along x.
    fn block(n: [usize; 3], work: impl Fn(usize) -> f64) -> Vec<Unit> {
        let count = n[0] * n[1] * n[2];
        let point = |k: usize| Point3::new(k % n[0], k / n[0] % n[1], k / n[0] / n[1]);
        let unit = |k: usize| Unit {
            centre: point(k).map(|c| c as f64),
            work: work(k),
        };
        (0..count).map(unit).collect()
    }

    #[test]
    fn every_unit_has_one_rank_and_work_is_even() -> Result<(), RankError> {
        for ranks in [1, 2, 3, 4, 7, 8, 60] {
            let units = block([24, 5, 5], |k| 1.0 + (k % 24) as f64 / 12.0);
            let d = Division::bisect(600 * UNIT - 100, &units, ranks)?;
            let held: usize = (0..ranks).map(|r| d.units_of(r).len()).sum();
            assert_eq!((held, d.idle()), (600, 0), "{ranks} ranks");
            // Half of the dearest unit at each cut.
            let bound = 1.5 * f64::from((ranks as u32).next_power_of_two().ilog2()) * ranks as f64 / 1200.0;
            assert!(d.imbalance() <= bound, "{ranks} ranks: {}", d.imbalance());
        }
        Ok(())
    }

    #[test]
    fn cuts_go_across_the_longest_extent() -> Result<(), RankError> {
        let d = Division::bisect(64 * UNIT, &block([16, 2, 2], |_| 1.0), 4)?;
        for k in 0..64 {
            assert_eq!(d.owner(k * UNIT + 3), k % 16 / 4);
        }
        Ok(())
    }

    #[test]
    fn ranks_beyond_the_units_are_idle_and_more_than_nodes_are_refused() -> Result<(), RankError> {
        let d = Division::bisect(2 * UNIT, &block([2, 1, 1], |_| 1.0), 5)?;
        assert_eq!(d.idle(), 3);
        let refused = Division::bisect(300, &block([2, 1, 1], |_| 1.0), 301);
        let expected = RankError::TooMany {
            ranks: 301,
            nodes: 300,
            units: 2,
        };
        assert_eq!(refused, Err(expected));
        assert!(matches!(
            Division::bisect(300, &[], 0),
            Err(RankError::TooMany { ranks: 0, .. })
        ));
        assert!(matches!(
            Division::bisect(300, &block([3, 1, 1], |_| 1.0), 2),
            Err(RankError::Length { expected: 2, .. })
        ));
        Ok(())
    }
}

//! Choice of the pairs that become bonds and of the particles that stay.

use super::cells::{CHUNK, CellList, Sphere, image, verlet_list};
use crate::error::{Error, Result};
use arlequin_core::adjacency::lowest_connected;

/// Largest relative gap searched for bonds.
const REACH: f64 = 0.25;

/// Largest share of the volume that loose spheres may have to be left out: ten times the share in jammed
/// packings with 6.2 bonds per sphere.
pub const LOOSE_LIMIT: f64 = 0.02;

/// Treatment of spheres that belong to no connected part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loose {
    /// Leaves loose spheres out; the other spheres of their body take over their mass. An error above a share
    /// of the volume.
    Drop {
        /// Largest accepted share, [`LOOSE_LIMIT`] by default.
        limit: f64,
    },
    /// Keeps loose spheres as grains with the mass of their own volume. Without contact they pass through
    /// everything.
    Keep,
}

impl Default for Loose {
    fn default() -> Self {
        Self::Drop { limit: LOOSE_LIMIT }
    }
}

/// Bonds among the kept particles.
#[derive(Debug)]
pub(crate) struct Bonding {
    /// Old numbers of the kept particles, ascending.
    pub(crate) retained: Vec<u32>,
    /// Bonds in new numbers, ascending.
    pub(crate) pairs: Vec<[u32; 2]>,
    /// Largest relative gap `d/(r_i+r_j) - 1` that was bonded.
    pub(crate) tolerance: f64,
    /// Coordination number over all particles, kept or not.
    pub(crate) coordination_all: f64,
}

/// Bonds the pairs nearest to touching until the coordination number is reached. With [`Loose::Drop`] it then
/// keeps the connected parts only: the largest connected set of spheres and every other of at least [`SPAN`]
/// spheres.
pub(crate) fn bond_and_trim(
    spheres: &[Sphere],
    coordination: f64,
    period: Option<[f64; 3]>,
    loose: Loose,
) -> Result<Bonding> {
    let wanted = (0.5 * coordination * spheres.len() as f64).round() as usize;
    // A narrow search is cheaper and finds enough pairs in a jammed packing.
    let mut candidates = near_pairs(spheres, 0.08, period);
    if candidates.len() < wanted {
        candidates = near_pairs(spheres, REACH, period);
    }
    if candidates.len() < wanted || wanted == 0 {
        return Err(Error::TooFewPairs {
            wanted: coordination,
            bonds: wanted,
            pairs: candidates.len(),
            reach: REACH,
        });
    }
    // Equal gaps are ordered by particle numbers, so that the choice is unique. A selection is cheaper than
    // sorting all pairs.
    let by_gap = |a: &(f64, [u32; 2]), b: &(f64, [u32; 2])| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    let (_, widest, _) = candidates.select_nth_unstable_by(wanted - 1, by_gap);
    let tolerance = widest.0;
    candidates.truncate(wanted);
    let mut pairs: Vec<[u32; 2]> = candidates.into_iter().map(|p| p.1).collect();
    pairs.sort_unstable();
    let components = Components::new(spheres.len(), &pairs);
    let numbers = || 0..spheres.len() as u32;
    let retained: Vec<u32> = match loose {
        Loose::Keep => numbers().collect(),
        Loose::Drop { limit } => {
            let retained: Vec<u32> = numbers().filter(|&i| components.is_part(i)).collect();
            bound_loose(spheres, &retained, &components, limit, coordination)?;
            retained
        }
    };
    renumber(&mut pairs, &retained, spheres.len());
    Ok(Bonding {
        retained,
        pairs,
        tolerance,
        coordination_all: 2.0 * wanted as f64 / spheres.len() as f64,
    })
}

/// Removes pairs with an end that is not in `retained` (ascending) and renumbers the others.
pub(crate) fn renumber(pairs: &mut Vec<[u32; 2]>, retained: &[u32], count: usize) {
    let mut new_numbers = vec![u32::MAX; count];
    for (k, &i) in retained.iter().enumerate() {
        new_numbers[i as usize] = k as u32;
    }
    pairs.retain(|p| p.iter().all(|&i| new_numbers[i as usize] != u32::MAX));
    pairs
        .iter_mut()
        .for_each(|p| *p = p.map(|i| new_numbers[i as usize]));
}

/// Refuses to leave out more than the share `limit` of the volume of the spheres.
fn bound_loose(
    spheres: &[Sphere],
    retained: &[u32],
    components: &Components,
    limit: f64,
    coordination: f64,
) -> Result<()> {
    let cube = |s: &Sphere| s[3] * s[3] * s[3];
    let total: f64 = spheres.iter().map(cube).sum();
    let retained_cubes: f64 = retained.iter().map(|&i| cube(&spheres[i as usize])).sum();
    let share = 1.0 - retained_cubes / total;
    if retained.len() == spheres.len() || share <= limit {
        return Ok(());
    }
    Err(Error::LooseSpheres {
        loose: spheres.len() - retained.len(),
        spheres: spheres.len(),
        share,
        limit,
        parts: components.parts(),
        coordination,
    })
}

/// Returns all pairs with relative gap `d/(r_i+r_j) - 1` below `reach`, each with its gap.
pub(crate) fn near_pairs(spheres: &[Sphere], reach: f64, period: Option<[f64; 3]>) -> Vec<(f64, [u32; 2])> {
    let largest = spheres.iter().fold(0.0_f64, |m, s| m.max(s[3]));
    let mut list = Vec::new();
    verlet_list(
        &mut CellList::new(period),
        spheres,
        // The skin must cover `reach (r_i + r_j)` for the largest spheres.
        2.0 * largest * reach,
        &mut list,
    );
    let mut out = Vec::new();
    for (c, chunk) in list.iter().enumerate() {
        for k in 0..chunk.start.len() - 1 {
            let i = c * CHUNK + k;
            let s = spheres[i];
            for &j in &chunk.neighbours[chunk.start[k] as usize..chunk.start[k + 1] as usize] {
                let t = spheres[j as usize];
                let d = [t[0] - s[0], t[1] - s[1], t[2] - s[2]];
                let d = period.map_or(d, |p| image(d, &p));
                let gap = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / (s[3] + t[3]) - 1.0;
                if (j as usize) > i && gap < reach {
                    out.push((gap, [i as u32, j]));
                }
            }
        }
    }
    out
}

/// Smallest number of spheres of a connected part: four centres span a volume, fewer do not.
const SPAN: u32 = 4;

/// Connected sets of spheres.
#[derive(Debug)]
pub(crate) struct Components {
    /// Smallest sphere number in the set of each sphere.
    root: Vec<u32>,
    /// Number of spheres of each set, stored at its smallest sphere number.
    size: Vec<u32>,
    /// Smallest sphere number of the largest set (of the first one, if several are equal).
    largest: u32,
}

impl Components {
    pub(crate) fn new(count: usize, pairs: &[[u32; 2]]) -> Self {
        let root = lowest_connected(count, pairs.iter().copied());
        let mut size = vec![0_u32; count];
        root.iter().for_each(|&r| size[r as usize] += 1);
        let mut largest = 0;
        for (r, s) in size.iter().enumerate() {
            if *s > size[largest] {
                largest = r;
            }
        }
        Self {
            root,
            size,
            largest: largest as u32,
        }
    }

    /// Returns whether a sphere belongs to a part: to the largest set, or to another of at least [`SPAN`]
    /// spheres.
    pub(crate) fn is_part(&self, i: u32) -> bool {
        let root = self.root[i as usize];
        root == self.largest || self.size[root as usize] >= SPAN
    }

    /// Returns whether a sphere belongs to the largest set.
    pub(crate) fn is_largest(&self, i: u32) -> bool {
        self.root[i as usize] == self.largest
    }

    /// Returns the smallest sphere number in the set of a sphere.
    pub(crate) fn root(&self, i: u32) -> u32 {
        self.root[i as usize]
    }

    /// Returns the number of spheres of each part, largest first.
    pub(crate) fn parts(&self) -> Vec<usize> {
        let is_root = |i: &u32| self.root[*i as usize] == *i && self.is_part(*i);
        let roots = (0..self.root.len() as u32).filter(is_root);
        let mut out: Vec<usize> = roots.map(|i| self.size[i as usize] as usize).collect();
        out.sort_unstable_by(|a, b| b.cmp(a));
        out
    }
}

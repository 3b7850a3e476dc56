//! Which particles are near each other without being bonded.

use super::Spring;
use crate::fracture::state::Incidence;
use crate::fracture::{Break, BreakLog};
use crate::packing::cells::{CellList, Sphere};
use crate::particles::BondedParticles;
use arlequin_core::snapshot::Record;
use rayon::prelude::*;

/// Particles per unit of parallel work.
const CHUNK: usize = 512;

/// A pair that may touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) ends: [u32; 2],
    /// Distance below which it pushes (m).
    pub(crate) rest: f64,
}

/// Pairs near each other, with what their contacts remember.
#[derive(Debug)]
pub(crate) struct PairList {
    pub(crate) pairs: Vec<Candidate>,
    pub(crate) springs: Vec<Spring>,
    pub(crate) searches: usize,
    skin: f64,
    incidence: Incidence,
    /// Distance at which each broken bond broke.
    broken_at: Vec<f64>,
    built: Vec<Sphere>,
    cells: CellList,
}

fn distance(a: &Sphere, b: &Sphere) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Where two particles that were never bonded begin to push.
fn rest_of(a: &Sphere, b: &Sphere) -> f64 {
    (a[3] + b[3]).min(distance(a, b))
}

/// Bond between two particles, if there ever was one.
fn bond_between(incidence: &Incidence, i: u32, j: u32) -> Option<usize> {
    let bonds = incidence.of(i as usize);
    let k = bonds.partition_point(|e| e[0] < j);
    bonds.get(k).filter(|e| e[0] == j).map(|e| e[1] as usize)
}

impl PairList {
    /// An empty list; the first refresh fills it. `skin` (m) is by how much more than touching the pairs reach.
    pub(crate) fn new(body: &BondedParticles, skin: f64) -> Self {
        Self {
            pairs: Vec::new(),
            springs: Vec::new(),
            searches: 0,
            skin,
            incidence: Incidence::new(body.len(), body.pairs()),
            broken_at: vec![f64::INFINITY; body.pairs().len()],
            built: Vec::new(),
            cells: CellList::default(),
        }
    }

    /// What a resumed run must know. Integers: searches, pairs, whether a search was made; ends and state of each pair.
    /// Numbers: rest distance and springs of each pair, the spheres of the last search, where bonds broke.
    pub(crate) fn save(&self, out: &mut Record<f64>) {
        let searched = u64::from(!self.built.is_empty());
        out.integers
            .extend([self.searches as u64, self.pairs.len() as u64, searched]);
        for (p, s) in self.pairs.iter().zip(&self.springs) {
            out.integers
                .extend([u64::from(p.ends[0]), u64::from(p.ends[1]), u64::from(s.on)]);
            out.numbers.push(p.rest);
            out.numbers.extend(s.numbers());
        }
        out.numbers.extend(self.built.iter().flatten());
        // Infinite for whole bonds, which no finite record may hold: -1 stands for them.
        let distance = |d: &f64| if d.is_finite() { *d } else { -1.0 };
        out.numbers.extend(self.broken_at.iter().map(distance));
    }

    /// Undoes [`Self::save`]; `None` for a record of another body of `count` particles.
    pub(crate) fn restore(&mut self, count: usize, integers: &[u64], numbers: &[f64]) -> Option<()> {
        let (&[searches, pairs, searched], ends) = integers.split_first_chunk::<3>()?;
        let (pairs, built) = (
            usize::try_from(pairs).ok()?,
            if searched == 1 { count } else { 0 },
        );
        let wanted = [
            3usize.checked_mul(pairs)?,
            7usize.checked_mul(pairs)? + 4 * built + self.broken_at.len(),
        ];
        if [ends.len(), numbers.len()] != wanted {
            return None;
        }
        self.searches = searches as usize;
        self.pairs.clear();
        self.springs.clear();
        let (ends, _) = ends.as_chunks::<3>();
        let (springs, rest) = numbers.split_at(7 * pairs);
        for (&[i, j, on], &[rest, a, b, c, d, e, f]) in ends.iter().zip(springs.as_chunks::<7>().0) {
            if i.max(j) >= count as u64 {
                return None;
            }
            let ends = [i as u32, j as u32];
            self.pairs.push(Candidate { ends, rest });
            self.springs
                .push(Spring::from_numbers(on == 1, [a, b, c, d, e, f]));
        }
        let (spheres, broken) = rest.split_at(4 * built);
        self.built = spheres.as_chunks::<4>().0.to_vec();
        for (to, d) in self.broken_at.iter_mut().zip(broken) {
            *to = if *d < 0.0 { f64::INFINITY } else { *d };
        }
        Some(())
    }

    /// Lists the pair of a bond that just broke.
    pub(crate) fn add_broken(&mut self, event: &Break, rest: &[Sphere]) {
        self.broken_at[event.bond as usize] = event.distance;
        let [a, b] = event.pair.map(|i| &rest[i as usize]);
        self.pairs.push(Candidate {
            ends: event.pair,
            rest: rest_of(a, b).min(event.distance),
        });
        self.springs.push(Spring::default());
    }

    /// Searches anew if a particle has moved by half the skin since the last search.
    pub(crate) fn refresh(&mut self, now: &[Sphere], rest: &[Sphere], log: &BreakLog) {
        let half = 0.5 * self.skin;
        let far = |(a, b): (&Sphere, &Sphere)| {
            let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > half * half
        };
        if self.built.len() == now.len() && !self.built.iter().zip(now).any(far) {
            return;
        }
        self.search(now, rest, log);
    }

    fn search(&mut self, now: &[Sphere], rest: &[Sphere], log: &BreakLog) {
        self.searches += 1;
        self.built.clear();
        self.built.extend_from_slice(now);
        let largest = now.iter().fold(0.0_f64, |m, s| m.max(s[3]));
        self.cells.build(now, 2.0 * largest + self.skin);
        let mut old: Vec<(Candidate, Spring)> = self
            .pairs
            .iter()
            .copied()
            .zip(self.springs.iter().copied())
            .filter(|(_, s)| s.on)
            .collect();
        old.sort_unstable_by_key(|(c, _)| c.ends);
        let (cells, incidence, skin) = (&self.cells, &self.incidence, self.skin);
        let broken_at = &self.broken_at;
        let parts: Vec<Vec<Candidate>> = (0..now.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|c| {
                let mut part = Vec::new();
                for i in c * CHUNK..((c + 1) * CHUNK).min(now.len()) {
                    let first = part.len();
                    cells.around(&now[i], |j| {
                        let (a, b) = (&now[i], &now[j as usize]);
                        if j as usize <= i || distance(a, b) > a[3] + b[3] + skin {
                            return;
                        }
                        let mut limit = rest_of(&rest[i], &rest[j as usize]);
                        if let Some(b) = bond_between(incidence, i as u32, j) {
                            if !log.is_broken(b) {
                                return;
                            }
                            limit = limit.min(broken_at[b]);
                        }
                        part.push(Candidate {
                            ends: [i as u32, j],
                            rest: limit,
                        });
                    });
                    part[first..].sort_unstable_by_key(|c| c.ends);
                }
                part
            })
            .collect();
        self.pairs.clear();
        parts.iter().for_each(|p| self.pairs.extend_from_slice(p));
        self.springs.clear();
        self.springs.resize(self.pairs.len(), Spring::default());
        for (c, s) in old {
            let k = self.pairs.partition_point(|p| p.ends < c.ends);
            if self.pairs.get(k).is_some_and(|p| p.ends == c.ends) {
                self.springs[k] = s;
            }
        }
    }
}

/// Unbonded pairs that overlap by more than `tolerance` of their radii beyond rest: how many, and the largest overlap
/// over the sum of radii.
pub(crate) fn overlaps(
    body: &BondedParticles,
    q: &[f64],
    tolerance: f64,
    broken: impl Fn(usize) -> bool,
) -> Option<(usize, f64)> {
    let spheres = |u: Option<&[f64]>| -> Vec<Sphere> {
        let place = |(i, (x, r)): (usize, (&nalgebra::Vector3<f64>, &f64))| {
            let at = |c: usize| x[c] + u.map_or(0.0, |u| u[3 * i + c]);
            [at(0), at(1), at(2), *r]
        };
        body.positions()
            .iter()
            .zip(body.radii())
            .enumerate()
            .map(place)
            .collect()
    };
    let (rest, now) = (spheres(None), spheres(Some(q)));
    let largest = body.radii().iter().fold(0.0_f64, |m, r| m.max(*r));
    let mut cells = CellList::default();
    cells.build(&now, 2.0 * largest);
    let incidence = Incidence::new(body.len(), body.pairs());
    let (mut count, mut worst) = (0, 0.0_f64);
    for (i, a) in now.iter().enumerate() {
        cells.around(a, |j| {
            let b = &now[j as usize];
            if j as usize <= i {
                return;
            }
            let overlap = (rest_of(&rest[i], &rest[j as usize]) - distance(a, b)) / (a[3] + b[3]);
            let bonded = bond_between(&incidence, i as u32, j).is_some_and(|b| !broken(b));
            if overlap > tolerance && !bonded {
                count += 1;
                worst = worst.max(overlap);
            }
        });
    }
    (count > 0).then_some((count, worst))
}

//! Warnings about effects that a state would need and that are off. In a partitioned body all ranks find them
//! together.

use super::DemModel;
use super::poses::Reader;
use crate::contact::neighbours;
use crate::fracture::{BreakLog, locked};
use crate::packing::cells::{Sphere, spheres};
use arlequin_core::Exact;
use arlequin_core::Model;
use arlequin_core::effect::Finding;
use arlequin_core::ranks::Halo;

/// Largest rotation \[rad\] for which the small-rotation law errs by at most half a per cent of its forces.
const SMALL_ROTATION: f64 = 0.1;

/// Overlap of unbonded particles, beyond their overlap at rest and over the sum of their radii, above which a
/// warning is given.
const TOLERATED_OVERLAP: f64 = 0.01;

impl DemModel {
    pub(super) fn findings(&self, q: &[f64]) -> Vec<Finding> {
        let mut out = Vec::new();
        if !self.has_finite_rotations() {
            out.extend(self.large_rotation(q));
        }
        out.extend(self.overloaded(q));
        out.extend(self.overlapping(q));
        out.extend(self.torn_in_overlap(q));
        out
    }

    /// Returns the global sum of `count` and the global maximum of `top`, which must not be negative.
    /// Collective.
    fn on_all_ranks(&self, count: usize, top: f64) -> (usize, f64) {
        let owned = self.owned();
        let mut sum = Exact::zero();
        sum.add(count as f64);
        let [count] = owned.total([sum]);
        (count as usize, owned.largest(top))
    }

    fn large_rotation(&self, q: &[f64]) -> Option<Finding> {
        let log = locked(&self.log);
        // A particle without unbroken bonds may turn freely, because no bond feels it.
        let mut is_bonded = vec![false; self.body.len()];
        for (b, pair) in self.body.pairs().iter().enumerate() {
            if !log.is_broken_here(b) {
                pair.iter().for_each(|i| is_bonded[*i as usize] = true);
            }
        }
        let th = q[q.len() / 2..].chunks_exact(3).zip(&is_bonded);
        let angles = th
            .filter(|(_, is_bonded)| **is_bonded)
            .map(|(t, _)| (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]).sqrt());
        let (top, count) = angles.fold((0.0_f64, 0), |(top, n), a| {
            (top.max(a), n + usize::from(a > SMALL_ROTATION))
        });
        let (count, top) = self.on_all_ranks(count, top);
        (count > 0).then(|| Finding {
            effect: "finite-rotations",
            message: format!(
                "{count} particles have turned by up to {top:.3} rad, beyond {SMALL_ROTATION} rad, the range of the \
                 small-rotation law: switch finite rotations on"
            ),
        })
    }

    /// Finds bonds or particles loaded above a strength in a run without fracture.
    fn overloaded(&self, q: &[f64]) -> Option<Finding> {
        let watched = self.watched.as_ref()?;
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let (top, count) = watched.peak(&self.body, &reader);
        let (count, top) = self.on_all_ranks(count, top);
        let what = match watched.spec.criterion.is_of_particles() {
            true => "particles",
            false => "bonds",
        };
        (count > 0).then(|| Finding {
            effect: "fracture",
            message: format!(
                "{count} {what} are loaded above their strength, up to {top:.2} times: switch fracture on"
            ),
        })
    }

    fn overlapping(&self, q: &[f64]) -> Option<Finding> {
        let log = locked(&self.log);
        let overlaps = match &self.halo {
            None => neighbours::overlaps(&self.body, q, TOLERATED_OVERLAP, |b| log.is_broken(b)),
            // The run reports an error between ranks ([`arlequin_core::Owned::check_communication`]).
            Some(halo) => self.overlaps_in_parts(halo, q, &log).unwrap_or_default(),
        };
        let (count, worst) = overlaps.unwrap_or_default();
        let (count, worst) = self.on_all_ranks(count, worst);
        (count > 0).then(|| Finding {
            effect: "contact",
            message: format!(
                "{count} pairs of unbonded particles overlap, by up to {:.1} % of their radii: switch contact on",
                100.0 * worst
            ),
        })
    }

    /// Returns the number of overlaps of owned particles with particles of higher numbers on any rank, and
    /// the largest of them.
    fn overlaps_in_parts(
        &self,
        halo: &Halo,
        q: &[f64],
        log: &BreakLog,
    ) -> arlequin_core::Result<Option<(usize, f64)>> {
        let owned = self.centres().len();
        let mut at_rest = spheres(&self.body.positions()[..owned], &self.body.radii()[..owned]);
        let mut displaced = neighbours::displaced(&at_rest, q);
        let centres: Vec<[f64; 3]> = displaced.iter().map(|[x, y, z, _]| [*x, *y, *z]).collect();
        let reach = halo
            .owned()
            .largest(2.0 * at_rest.iter().fold(0.0_f64, |m, s| m.max(s[3])));
        let near_halo = Halo::near(halo.owned(), &centres, reach)?;
        let mut ghosts: Vec<[Sphere; 2]> = vec![[[0.0; 4]; 2]; near_halo.ghosts().len()];
        let read = |i: usize| {
            let states = [at_rest[i], displaced[i]];
            std::array::from_fn::<f64, 8, _>(|k| states[k / 4][k % 4])
        };
        near_halo.exchange(&mut near_halo.messages(8), read, |ghost, x| {
            ghosts[ghost] = std::array::from_fn(|k| std::array::from_fn(|c| x[4 * k + c]));
        })?;
        at_rest.extend(ghosts.iter().map(|t| t[0]));
        displaced.extend(ghosts.iter().map(|t| t[1]));
        let bonds = self.body.adjacency();
        let may_touch = |i: usize, k: usize| {
            let k = near_halo.global(k);
            let mut bonds = bonds.row(i).iter();
            // Each pair is counted once, by the owner of its smaller number.
            k > halo.global(i)
                && bonds
                    .find(|e| halo.global(e[0] as usize) == k)
                    .is_none_or(|e| log.is_broken_here(e[1] as usize))
        };
        let first = [&at_rest[..owned], &at_rest[..]];
        Ok(neighbours::count_overlaps(
            first,
            [&displaced[..owned], &displaced[..]],
            TOLERATED_OVERLAP,
            may_touch,
        ))
    }
}

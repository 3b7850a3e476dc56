//! Warnings about bonds that broke inside an overlap: multipliers go on tying their particles.

use super::DemModel;
use super::poses::Reader;
use crate::fracture::locked;
use arlequin_core::Model;
use arlequin_core::effect::Finding;

/// Number of particles that a message names before it ends in "...".
const NAMED: usize = 8;

/// Bonds of at least this weight lie outside of every overlap. It is not exactly one, because means of
/// weights are rounded.
const WHOLE: f64 = 1.0 - 1e-9;

impl DemModel {
    /// Returns whether bond `b` lies in an overlap, wholly or in part, and so carries only a share of the
    /// energy.
    pub(super) fn in_overlap(&self, b: usize) -> bool {
        self.body.weight(b) < WHOLE
    }

    /// Finds particles that lost all bonds in an overlap, and broken bonds there that opened by more than a
    /// particle radius.
    pub(super) fn torn_in_overlap(&self, q: &[f64]) -> Option<Finding> {
        let fracture = self.fracture.as_ref()?;
        let ghosts = self.receive_ghosts(q);
        let reader = Reader {
            ghosts: &ghosts,
            ..self.reader(q)
        };
        let log = locked(&self.log);
        let position = |i: usize| self.body.positions()[i] + reader.twist(i).linear;
        let gone = |i: &usize| {
            let mut bonds = fracture.adjacency.row(*i).iter();
            *i < self.centres().len() && bonds.all(|e| log.is_broken_here(e[1] as usize))
        };
        let owned = self.owned();
        let global = |i: &usize| owned.global(*i) as i64;
        let (mut broken, mut opening) = (0, 0.0_f64);
        let mut loose: Vec<i64> = Vec::new();
        for event in log.events().iter().filter(|e| e.overlap) {
            broken += 1;
            // The log has the bonds of all ranks; the owner of a bond's particles reads its opening.
            let Some(b) = fracture.local_bond(event.bond) else {
                continue;
            };
            let [i, j] = self.body.pairs()[b].map(|i| i as usize);
            let radius = 0.5 * (self.body.radii()[i] + self.body.radii()[j]);
            opening = opening.max(((position(j) - position(i)).norm() - event.distance) / radius);
            loose.extend([i, j].iter().filter(|i| gone(i)).map(global));
        }
        // The run reports an error between ranks ([`arlequin_core::Owned::check_communication`]).
        loose = owned.all_gather(loose).unwrap_or_default();
        opening = owned.largest(opening);
        loose.sort_unstable();
        loose.dedup();
        if loose.is_empty() && opening <= 1.0 {
            return None;
        }
        let names: Vec<String> = loose.iter().take(NAMED).map(ToString::to_string).collect();
        let more = if loose.len() > NAMED { ", ..." } else { "" };
        let lost = match loose.len() {
            0 => "no particle lost all of its bonds".to_owned(),
            n => format!("{n} particles have none left ({}{more})", names.join(", ")),
        };
        Some(Finding {
            effect: "overlap",
            message: format!(
                "{broken} bonds broke inside an overlap; {lost}, pieces moved apart by up to {opening:.2} radii. The \
                 multipliers go on tying all of them to the place they came from: enlarge the region of particles, so \
                 that nothing breaks in the overlap"
            ),
        })
    }
}

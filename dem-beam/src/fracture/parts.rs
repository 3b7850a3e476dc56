//! Breaking of bonds in a partitioned body.
//!
//! A bond between two ranks is stored on both. Both know its two ends with the same bits, so both come to the
//! same verdict. But each rank screens only the ends it owns ([`crate::kernel::screen`]): if a bond breaks on
//! any rank, all ranks compare the bonds between ranks one by one. All breaks are then gathered on all ranks
//! and logged in the order of the whole body.

use super::softening::{Damage, Loss};
use super::state::{FractureState, change, middle};
use super::{Break, BreakMode, Fracture, SharedLog, locked, writing};
use crate::model::poses::Reader;
use crate::numbered::Numbered;
use crate::particles::BondedParticles;
use arlequin_core::Evolution;
use arlequin_core::ranks::{Halo, Message, RankError};
use arlequin_core::snapshot::Record;
use nalgebra::Vector3;
use std::sync::Arc;

/// Words per loss in the all-gather.
const WORDS: usize = 9;

/// Numbers per ghost that are exchanged when bonds break: the state one step before, and its change over the
/// step.
const GHOST_WORDS: usize = 13;

/// Data about the whole body on one rank.
#[derive(Debug)]
pub(crate) struct Parts {
    halo: Halo,
    messages: Vec<Message>,
    /// Numbers in the whole body of this rank's bonds, ascending.
    numbers: Arc<[u32]>,
    /// Local bonds that have a ghost.
    cross: Vec<u32>,
    /// Number of bonds of the whole body.
    pub(crate) bonds: usize,
    /// Current states of the ghosts.
    pub(crate) ghosts: Vec<[f64; 7]>,
}

/// States of the ghosts one step before, and their changes over the step.
pub(super) type GhostStates = (Vec<[f64; 7]>, Vec<[f64; 6]>);

impl FractureState {
    /// State for a part of a body whose bonds are all whole, with the volumes \[m³\] of the owned particles.
    pub(crate) fn new_in_part(
        spec: Fracture,
        (body, volumes): (&BondedParticles, &[f64]),
        log: SharedLog,
        (halo, numbered): (&Halo, &Numbered),
    ) -> Self {
        writing(&log).begin(numbered.total, spec.dissipated.is_some());
        Self::for_part(spec, (body, volumes), log, (halo, numbered))
    }

    /// Restricts the state to a part of the body; broken and damaged bonds stay so.
    pub(crate) fn part(self, body: (&BondedParticles, &[f64]), numbering: (&Halo, &Numbered)) -> Self {
        let mut out = Self::for_part(self.spec, body, self.log.clone(), numbering);
        if self.is_plain() {
            out.check_plainly();
        }
        // The log has the numbers of the whole body, hence the breaks before the partition.
        let broken: Vec<u32> = {
            let log = locked(&out.log);
            let local_bonds = (0..).zip(&*numbering.1.bonds);
            local_bonds
                .filter(|(_, b)| log.is_broken(**b as usize))
                .map(|(k, _)| k)
                .collect()
        };
        out.make_unbreakable(&broken);
        out.now = broken;
        out.follow_damage();
        out
    }

    fn for_part(
        spec: Fracture,
        (body, volumes): (&BondedParticles, &[f64]),
        log: SharedLog,
        (halo, numbered): (&Halo, &Numbered),
    ) -> Self {
        let owned = volumes.len();
        let mut out = Self::with_owned(spec, body, volumes, log);
        writing(&out.log).number(&numbered.bonds);
        // Ghosts have the numbers after the owned particles.
        let foreign = |p: &[u32; 2]| p.iter().any(|i| *i as usize >= owned);
        let cross = (0..).zip(body.pairs()).filter(|(_, p)| foreign(p));
        out.parts = Some(Parts {
            cross: cross.map(|(b, _)| b).collect(),
            messages: halo.messages(GHOST_WORDS),
            numbers: numbered.bonds.clone(),
            bonds: numbered.total,
            ghosts: Vec::with_capacity(halo.ghosts().len()),
            halo: halo.clone(),
        });
        out
    }
}

impl Parts {
    /// Returns whether a bond of the whole body breaks now; `now` are breaking bonds of this rank.
    /// Collective.
    pub(super) fn any_breaks(&self, now: &[u32]) -> arlequin_core::Result<bool> {
        self.halo.owned().any(!now.is_empty())
    }

    /// Adds to the breaking bonds of this rank those that break on other ranks. Collective.
    pub(super) fn share_breaks(&self, now: &mut Vec<u32>) -> arlequin_core::Result<()> {
        let is_cross = |b: &&u32| self.cross.binary_search(b).is_ok();
        // A bond inside one rank is stored there only; the others have nothing to break.
        let sent = now.iter().filter(is_cross);
        let sent = sent.map(|b| i64::from(self.numbers[*b as usize])).collect();
        let received = self.halo.owned().all_gather(sent)?;
        let local = received.into_iter().filter_map(|b| self.local_bond(b as u32));
        now.extend(local.map(|b| b as u32));
        Ok(())
    }

    /// Local bonds that have a ghost.
    pub(super) fn cross(&self) -> &[u32] {
        &self.cross
    }

    /// Returns the losses of all ranks in the order of the whole body and in its numbers. `losses` are those
    /// of bonds whose first particle this rank owns, in local numbers. Collective.
    pub(super) fn gather_losses(&self, losses: &[Loss], time: f64) -> arlequin_core::Result<Vec<Loss>> {
        let sent = losses.iter().flat_map(|e| self.words(e)).collect();
        let mut received = self.halo.owned().all_gather(sent)?;
        let received = received.as_chunks_mut::<WORDS>().0;
        // All-gather keeps the order of ranks; the log has the order that a run on one rank gives it.
        received.sort_unstable_by_key(number);
        Ok(received.iter().map(|words| loss(words, time)).collect())
    }

    /// Exchanges the states and changes of the ghosts. Collective.
    pub(super) fn receive_ghosts(
        &mut self,
        before: &Reader<'_>,
        step: &Evolution<'_, f64>,
    ) -> Result<GhostStates, RankError> {
        let count = self.halo.ghosts().len();
        let mut out = (vec![[0.0; 7]; count], vec![[0.0; 6]; count]);
        // One message for both: each message costs its latency.
        let message = |i: usize| {
            let (state, change) = (before.state_to_send(i), change(step, i));
            std::array::from_fn(|k| if k < 7 { state[k] } else { change[k - 7] })
        };
        self.halo
            .exchange::<GHOST_WORDS>(&mut self.messages, message, |g, x| {
                out.0[g].copy_from_slice(&x[..7]);
                out.1[g].copy_from_slice(&x[7..]);
            })?;
        Ok(out)
    }

    /// Restores the log that all ranks share. The rank that owns a bond's first particle sends the bond's
    /// middle and overlap to all others. Collective.
    pub(super) fn restore(
        &self,
        log: &SharedLog,
        from: &Record<f64>,
        body: &BondedParticles,
        inside: impl Fn(usize) -> bool,
    ) -> bool {
        let broken = from.integers.get(1..).unwrap_or_default().as_chunks::<4>().0;
        let local_bond = |bond: u64| self.local_bond(u32::try_from(bond).ok()?);
        let mut sent = Vec::new();
        for [bond, ..] in broken {
            if let Some(b) =
                local_bond(*bond).filter(|b| body.pairs()[*b][0] < self.halo.owned().nodes() as u32)
            {
                let (place, pair) = (
                    middle(body, b),
                    body.pairs()[b].map(|i| u64::from(self.global(i))),
                );
                let [x, y, z] = <[f64; 3]>::from(place).map(|x| x.to_bits().cast_signed());
                let ends = (pair[0] << 32 | pair[1]).cast_signed();
                sent.extend([bond.cast_signed(), ends, i64::from(inside(b)), x, y, z]);
            }
        }
        // The run reports an error between ranks.
        let Ok(mut received) = self.halo.owned().all_gather(sent) else {
            return false;
        };
        let received = received.as_chunks_mut::<6>().0;
        received.sort_unstable_by_key(|k| k[0]);
        writing(log).restore(from, &|bond, [i, j]| {
            let k = received
                .binary_search_by_key(&bond.cast_signed(), |k| k[0])
                .ok()?;
            let [_, ends, overlap, x, y, z] = received[k];
            // A record of another body has other ends at this number.
            let known = i <= u64::from(u32::MAX) && (i << 32 | j) == ends.cast_unsigned();
            let real = |x: i64| f64::from_bits(x.cast_unsigned());
            let place = Vector3::new(real(x), real(y), real(z));
            known.then_some((place, overlap > 0))
        })
    }

    /// Local number of a bond of the whole body, if this rank has it.
    pub(super) fn local_bond(&self, bond: u32) -> Option<usize> {
        self.numbers.binary_search(&bond).ok()
    }

    /// Number in the whole body of a local particle.
    fn global(&self, particle: u32) -> u32 {
        self.halo.global(particle as usize) as u32
    }

    /// Packs a loss with numbers of the whole body into words.
    fn words(&self, Loss { event: e, damage }: &Loss) -> [i64; WORDS] {
        let two = |a: u32, b: u32| (u64::from(a) << 32 | u64::from(b)).cast_signed();
        // Numbers travel as their bits, so that all ranks log the same values.
        let bits = |x: f64| x.to_bits().cast_signed();
        let [i, j] = e.pair.map(|i| self.global(i));
        [
            two(
                self.numbers[e.bond as usize],
                2 * e.mode as u32 + u32::from(e.overlap),
            ),
            two(i, j),
            bits(e.released),
            bits(e.distance),
            bits(e.place.x),
            bits(e.place.y),
            bits(e.place.z),
            bits(damage.load),
            bits(damage.left),
        ]
    }
}

fn number(words: &[i64; WORDS]) -> u32 {
    (words[0].cast_unsigned() >> 32) as u32
}

/// Inverse of [`Parts::words`].
fn loss(words: &[i64; WORDS], time: f64) -> Loss {
    let real = |k: usize| f64::from_bits(words[k].cast_unsigned());
    let (low, pair) = (words[0].cast_unsigned() as u32, words[1].cast_unsigned());
    let event = Break {
        time,
        bond: number(words),
        pair: [(pair >> 32) as u32, pair as u32],
        released: real(2),
        distance: real(3),
        place: Vector3::new(real(4), real(5), real(6)),
        overlap: low % 2 == 1,
        // The minimum keeps a damaged word from an index out of bounds.
        mode: BreakMode::ALL[(low as usize / 2).min(BreakMode::ALL.len() - 1)],
    };
    let damage = Damage {
        load: real(7),
        left: real(8),
        released: 0.0,
    };
    Loss { event, damage }
}

//! Particles that touch, of all ranks, known to each of them.
//!
//! Contacts are taken one after the other, each on the velocity that those before it have left: chains of
//! them lead from rank to rank. There are few, so every rank takes all of them, in the order of the whole
//! body, and keeps what acts on its own particles. A step in which particles touch allocates room for them.

use super::Grains;
use crate::packing::cells::Sphere;
use arlequin_core::effect::Instant;
use arlequin_core::ranks::{Portion, RankError};

/// Words of a particle between ranks: its number, sphere at rest, displacement, share of its mass, weighted
/// mass, inverse inertia, velocities and forces.
const WORDS: usize = 28;

/// Some particles of the whole body with their state, numbered from zero in its order.
#[derive(Debug, Default)]
pub(crate) struct Company {
    /// Numbers in the whole body, ascending.
    pub(crate) ids: Vec<u32>,
    /// Place of those that are here, and their number on this rank.
    own: Vec<[usize; 2]>,
    u: Vec<f64>,
    v: Vec<f64>,
}

/// Particles with how contacts see them and the forces on them so far.
pub(crate) type Heard = (Company, Grains, Vec<f64>);

impl Company {
    /// Of particles whose state is not known yet: their numbers in the whole body, ascending.
    pub(crate) fn of(ids: Vec<u32>) -> Self {
        Self {
            ids,
            ..Self::default()
        }
    }

    /// All that any rank names, `members` of the particles here, each once. All ranks must ask.
    pub(crate) fn hear(
        portion: &Portion,
        members: &[u32],
        grains: &Grains,
        at: &Instant<'_, f64>,
        f: &[f64],
    ) -> Result<Heard, RankError> {
        let mut told = Vec::with_capacity(WORDS * members.len());
        let bits = |x: f64| x.to_bits().cast_signed();
        for i in members.iter().map(|i| *i as usize) {
            told.push(portion.global(i) as i64);
            told.extend(grains.told(i).map(bits));
            told.extend(at.q[3 * i..3 * i + 3].iter().copied().map(bits));
            for x in [at.v_half, f] {
                told.extend(grains.unknowns(i).map(|o| bits(x[o])));
            }
        }
        let mut all = portion.listed(&told)?;
        let all = all.as_chunks_mut::<WORDS>().0;
        all.sort_unstable_by_key(|w| w[0]);
        let count = all.len();
        let mut out = Self::of(all.iter().map(|w| w[0] as u32).collect());
        out.v = vec![0.0; 6 * count];
        let mut forces = vec![0.0; 6 * count];
        let mut heard = Vec::with_capacity(count);
        for (place, words) in all.iter().enumerate() {
            let x: [f64; WORDS] = words.map(|w| f64::from_bits(w.cast_unsigned()));
            heard.push(std::array::from_fn(|k| x[1 + k]));
            out.u.extend(&x[13..16]);
            for c in 0..3 {
                for (to, from) in [(3 * place + c, c), (3 * (count + place) + c, 3 + c)] {
                    out.v[to] = x[16 + from];
                    forces[to] = x[22 + from];
                }
            }
            out.own
                .extend(portion.local(words[0] as usize).map(|i| [place, i]));
        }
        let mut seen = Grains::heard(&heard);
        seen.place(&out.u);
        Ok((out, seen, forces))
    }

    /// The instant as these particles know it.
    pub(crate) fn at<'a>(&'a self, of: &Instant<'a, f64>) -> Instant<'a, f64> {
        Instant {
            q: &self.u,
            v_half: &self.v,
            internal: &[],
            internal_before: &[],
            ..*of
        }
    }

    /// Place of a particle of the whole body.
    pub(crate) fn place(&self, id: u32) -> Option<usize> {
        self.ids.binary_search(&id).ok()
    }

    /// Number on this rank of the particle at a place, if it is here.
    pub(crate) fn here(&self, place: usize) -> Option<usize> {
        let k = self.own.binary_search_by_key(&place, |o| o[0]).ok()?;
        Some(self.own[k][1])
    }

    /// Tells which of them are here, where that is not known yet.
    pub(crate) fn find(&mut self, portion: &Portion) {
        let all = self.ids.iter().enumerate();
        let here = all.filter_map(|(place, id)| Some([place, portion.local(*id as usize)?]));
        self.own = here.collect();
    }

    /// Writes their `forces`, of those that are here, to those of this rank.
    pub(crate) fn deliver(&self, forces: &[f64], f: &mut [f64]) {
        let (half, count) = (f.len() / 2, self.ids.len());
        for [place, i] in &self.own {
            for c in 0..3 {
                f[3 * i + c] = forces[3 * place + c];
                f[half + 3 * i + c] = forces[3 * (count + place) + c];
            }
        }
    }
}

/// A particle as contacts see it: sphere at rest, share of its mass, weighted mass, inverse inertia.
pub(crate) type Seen = [f64; 12];

/// The sphere of it.
pub(super) fn sphere(of: &Seen) -> Sphere {
    [of[0], of[1], of[2], of[3]]
}

//! The touching particles of all ranks, gathered on every rank.
//!
//! Contacts are taken one after the other, each on the velocity that the contacts before it have left, and
//! chains of contacts lead from rank to rank. There are few, so every rank computes all of them, in the order
//! of the whole body, and keeps the forces on the particles it owns. Memory is allocated in steps in which
//! particles touch.

use super::Grains;
use crate::packing::cells::Sphere;
use arlequin_core::effect::Instant;
use arlequin_core::{Owned, Result};

/// Numbers per particle between ranks: sphere at rest, unweighted and weighted mass, inverse inertia,
/// displacement, velocities and forces.
const NUMBERS: usize = 27;

/// Some particles of the whole body with their state, numbered from zero in the order of the whole body.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    /// Numbers in the whole body, ascending.
    pub(crate) ids: Vec<u32>,
    /// For each particle that this rank owns: its place in `ids` and its number on this rank.
    owned: Vec<[usize; 2]>,
    u: Vec<f64>,
    v: Vec<f64>,
}

/// Gathered particles, their contact data and the forces on them so far.
pub(crate) type GatheredState = (Gathered, Grains, Vec<f64>);

impl Gathered {
    /// Particles whose state is not known yet, from their numbers in the whole body in ascending order.
    pub(crate) fn from_ids(ids: Vec<u32>) -> Self {
        Self {
            ids,
            ..Self::default()
        }
    }

    /// Gathers the particles that any rank names, each once; `members` are the particles that this rank
    /// names. Collective.
    pub(crate) fn gather(
        owned: &Owned,
        members: &[u32],
        grains: &Grains,
        instant: &Instant<'_, f64>,
        f: &[f64],
    ) -> Result<GatheredState> {
        let row = |i: &u32| {
            let i = *i as usize;
            let mut x = [0.0; NUMBERS];
            x[..12].copy_from_slice(&grains.contact_data(i));
            x[12..15].copy_from_slice(&instant.q[3 * i..3 * i + 3]);
            for (k, o) in grains.unknowns(i).into_iter().enumerate() {
                (x[15 + k], x[21 + k]) = (instant.v_half[o], f[o]);
            }
            (owned.global(i), x)
        };
        // In the order of the whole body: all ranks get the same sums.
        let rows = owned.all_gather_rows(members.iter().map(row).collect())?;
        let count = rows.len();
        let mut out = Self::from_ids(rows.iter().map(|r| r.0 as u32).collect());
        out.v = vec![0.0; 6 * count];
        let mut forces = vec![0.0; 6 * count];
        let mut data = Vec::with_capacity(count);
        for (place, (number, x)) in rows.iter().enumerate() {
            data.push(std::array::from_fn(|k| x[k]));
            out.u.extend(&x[12..15]);
            for c in 0..3 {
                for (target, source) in [(3 * place + c, c), (3 * (count + place) + c, 3 + c)] {
                    out.v[target] = x[15 + source];
                    forces[target] = x[21 + source];
                }
            }
            out.owned.extend(owned.local(*number).map(|i| [place, i]));
        }
        let mut seen = Grains::from_contact_data(&data);
        seen.place(&out.u);
        Ok((out, seen, forces))
    }

    /// Returns `instant` with the displacements and velocities of the gathered particles.
    pub(crate) fn instant<'a>(&'a self, instant: &Instant<'a, f64>) -> Instant<'a, f64> {
        Instant {
            q: &self.u,
            v_half: &self.v,
            internal: &[],
            internal_before: &[],
            ..*instant
        }
    }

    /// Place of a particle of the whole body among the gathered particles.
    pub(crate) fn place(&self, id: u32) -> Option<usize> {
        self.ids.binary_search(&id).ok()
    }

    /// Number on this rank of the particle at a place, if this rank owns it.
    pub(crate) fn local(&self, place: usize) -> Option<usize> {
        let k = self.owned.binary_search_by_key(&place, |o| o[0]).ok()?;
        Some(self.owned[k][1])
    }

    /// Finds which of the particles this rank owns, for a list made by [`Self::from_ids`].
    pub(crate) fn find_owned(&mut self, owned: &Owned) {
        let ids = self.ids.iter().enumerate();
        let places = ids.filter_map(|(place, id)| Some([place, owned.local(*id as usize)?]));
        self.owned = places.collect();
    }

    /// Writes the `forces` on the gathered particles to the force array `f` of this rank.
    pub(crate) fn deliver(&self, forces: &[f64], f: &mut [f64]) {
        let (half, count) = (f.len() / 2, self.ids.len());
        for [place, i] in &self.owned {
            for c in 0..3 {
                f[3 * i + c] = forces[3 * place + c];
                f[half + 3 * i + c] = forces[3 * (count + place) + c];
            }
        }
    }
}

/// Contact data of a particle: sphere at rest, unweighted and weighted mass, inverse inertia.
pub(crate) type ContactData = [f64; 12];

/// Sphere of a particle's contact data.
pub(super) fn sphere(data: &ContactData) -> Sphere {
    [data[0], data[1], data[2], data[3]]
}

//! Ghosts for contact: particles of other ranks that may touch particles of this rank.

use super::Grains;
use crate::packing::cells::Sphere;
use arlequin_core::ranks::{Halo, Message, RankError};
use arlequin_core::{Owned, Result};

/// The owned particles, followed by the surrounding particles of other ranks.
#[derive(Debug)]
pub(super) struct Surrounding {
    near: Halo,
    messages: Vec<Message>,
    pub(super) rest_spheres: Vec<Sphere>,
    pub(super) now: Vec<Sphere>,
    /// Number in the whole body (ascending) and local number of each surrounding particle.
    places: Vec<[u32; 2]>,
}

impl Surrounding {
    /// Finds all particles within `reach` \[m\] of an owned particle. Collective.
    pub(super) fn new(owned: &Owned, grains: &Grains, reach: f64) -> Result<Self> {
        let centres: Vec<[f64; 3]> = grains.now.iter().map(|[x, y, z, _]| [*x, *y, *z]).collect();
        let near = Halo::near(owned, &centres, reach)?;
        let owned = grains.len();
        let mut rest_spheres = grains.rest_spheres.to_vec();
        rest_spheres.resize(owned + near.ghosts().len(), [0.0; 4]);
        let (local, around) = rest_spheres.split_at_mut(owned);
        near.exchange::<4>(&mut near.messages(4), |i| local[i], |ghost, s| around[ghost] = s)?;
        let places = (owned as u32..).zip(near.ghosts()).map(|(k, id)| [*id, k]);
        let mut places: Vec<[u32; 2]> = places.collect();
        places.sort_unstable();
        let mut out = Self {
            messages: near.messages(3),
            now: rest_spheres.clone(),
            near,
            rest_spheres,
            places,
        };
        out.place(&grains.now)?;
        Ok(out)
    }

    /// Updates all positions: owned particles from `now`, the others by a halo exchange. Collective.
    pub(super) fn place(&mut self, now: &[Sphere]) -> std::result::Result<(), RankError> {
        let (local, around) = self.now.split_at_mut(now.len());
        local.copy_from_slice(now);
        let centre = |i: usize| [now[i][0], now[i][1], now[i][2]];
        self.near.exchange::<3>(&mut self.messages, centre, |ghost, x| {
            around[ghost][..3].copy_from_slice(&x);
        })
    }

    /// Local number of a particle of the whole body, if it is owned or surrounding.
    pub(super) fn local(&self, id: u32) -> Option<u32> {
        if let Some(owned) = self.near.owned().local(id as usize) {
            return Some(owned as u32);
        }
        let k = self.places.binary_search_by_key(&id, |p| p[0]).ok()?;
        Some(self.places[k][1])
    }

    /// Number in the whole body of a local particle.
    pub(super) fn global(&self, local: usize) -> u32 {
        self.near.global(local) as u32
    }
}

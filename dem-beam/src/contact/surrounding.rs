//! Ghosts for contact: particles of other ranks that may touch particles of this rank.

use super::Grains;
use crate::packing::cells::Sphere;
use arlequin_core::ranks::{Halo, Message, Portion, RankError};
use std::sync::Arc;

/// The owned particles, followed by the surrounding particles of other ranks.
#[derive(Debug)]
pub(super) struct Surrounding {
    near: Halo,
    messages: Vec<Message>,
    pub(super) rest: Vec<Sphere>,
    pub(super) now: Vec<Sphere>,
    /// Number in the whole body (ascending) and local number of each surrounding particle.
    places: Vec<[u32; 2]>,
}

impl Surrounding {
    /// Finds all particles within `reach` \[m\] of an owned particle. Collective.
    pub(super) fn new(portion: &Arc<Portion>, grains: &Grains, reach: f64) -> Result<Self, RankError> {
        let centres: Vec<[f64; 3]> = grains.now.iter().map(|[x, y, z, _]| [*x, *y, *z]).collect();
        let near = Halo::near(portion.clone(), &centres, reach)?;
        let own = grains.len();
        let mut rest = grains.rest.clone();
        rest.resize(own + near.ghosts().len(), [0.0; 4]);
        let (here, around) = rest.split_at_mut(own);
        near.exchange::<4>(&mut near.messages(4), |i| here[i], |ghost, s| around[ghost] = s)?;
        let places = (own as u32..).zip(near.ghosts()).map(|(k, id)| [*id, k]);
        let mut places: Vec<[u32; 2]> = places.collect();
        places.sort_unstable();
        let mut out = Self {
            messages: near.messages(3),
            now: rest.clone(),
            near,
            rest,
            places,
        };
        out.place(&grains.now)?;
        Ok(out)
    }

    /// Updates all positions: owned particles from `now`, the others by a halo exchange. Collective.
    pub(super) fn place(&mut self, now: &[Sphere]) -> Result<(), RankError> {
        let (here, around) = self.now.split_at_mut(now.len());
        here.copy_from_slice(now);
        let centre = |i: usize| [now[i][0], now[i][1], now[i][2]];
        self.near.exchange::<3>(&mut self.messages, centre, |ghost, x| {
            around[ghost][..3].copy_from_slice(&x);
        })
    }

    /// Local number of a particle of the whole body, if it is owned or surrounding.
    pub(super) fn find(&self, id: u32) -> Option<u32> {
        let portion = self.near.portion();
        if let Some(own) = portion.local(id as usize) {
            return Some(own as u32);
        }
        let k = self.places.binary_search_by_key(&id, |p| p[0]).ok()?;
        Some(self.places[k][1])
    }

    /// Number in the whole body of a local particle.
    pub(super) fn id(&self, here: usize) -> u32 {
        let portion = self.near.portion();
        match here.checked_sub(portion.nodes()) {
            None => portion.global(here) as u32,
            Some(ghost) => self.near.ghosts()[ghost],
        }
    }
}

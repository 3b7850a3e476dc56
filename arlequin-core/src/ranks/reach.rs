//! Scatter of owned and ghost values into the node list of an evaluation.

use super::{Halo, Message, RankError};
use crate::error::invalid;
use crate::{Real, Result};

/// Where owned nodes and ghosts stand in the node list that a force evaluation reads.
#[derive(Debug, Clone)]
pub struct Reach {
    halo: Halo,
    own: Vec<u32>,
    ghosts: Vec<u32>,
}

impl Reach {
    /// Finds the places of owned nodes and ghosts. `place`: place in the list of a node of the whole model.
    #[must_use]
    pub fn new(halo: Halo, place: impl Fn(u32) -> u32) -> Self {
        let owned = halo.owned();
        let nodes = 0..owned.nodes();
        Self {
            own: nodes.map(|i| place(owned.global(i) as u32)).collect(),
            ghosts: halo.ghosts().iter().map(|k| place(*k)).collect(),
            halo,
        }
    }

    /// Returns the halo.
    #[must_use]
    pub fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Returns the places of the owned nodes.
    #[must_use]
    pub fn own(&self) -> &[u32] {
        &self.own
    }

    /// Returns the places of some owned nodes of `model`, given by their local numbers.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a number that this rank does not have.
    pub fn places(&self, model: &str, nodes: &[usize]) -> Result<Vec<usize>> {
        let place = |k: &usize| {
            let rule = || format!("the part of '{model}' here has {} nodes", self.own.len());
            let place = self.own.get(*k);
            place
                .map(|p| *p as usize)
                .ok_or_else(|| invalid("number of a node", k, &rule()))
        };
        nodes.iter().map(place).collect()
    }

    /// Writes the numbers `q` of owned nodes (`N` each) and the received numbers of ghosts to their places in
    /// `x`. `messages`: buffers for `N` numbers ([`Halo::messages`]). Allocates nothing.
    ///
    /// # Errors
    /// Errors of [`Halo::exchange`].
    pub fn spread<T: Real, const N: usize>(
        &self,
        messages: &mut [Message],
        q: &[T],
        x: &mut [T],
    ) -> Result<(), RankError> {
        let q = q.as_chunks::<N>().0;
        for (place, q) in self.own.iter().zip(q) {
            x.as_chunks_mut::<N>().0[*place as usize] = *q;
        }
        let read = |i: usize| q[i].map(|x| x.as_f64());
        let places = x.as_chunks_mut::<N>().0;
        self.halo.exchange(messages, read, |ghost, numbers| {
            places[self.ghosts[ghost] as usize] = numbers.map(T::of);
        })
    }
}

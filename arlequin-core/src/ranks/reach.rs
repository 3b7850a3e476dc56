//! Numbers of own nodes and of ghosts, written to where they stand in a list of nodes.

use super::{Halo, Message, RankError};
use crate::error::invalid;
use crate::{Real, Result};

/// The nodes that an evaluation names, in an order of its own: where the own ones and the ghosts are among
/// them.
#[derive(Debug, Clone)]
pub struct Reach {
    halo: Halo,
    own: Vec<u32>,
    ghosts: Vec<u32>,
}

impl Reach {
    /// By the `place` of a node of the whole model in the list.
    #[must_use]
    pub fn new(halo: Halo, place: impl Fn(u32) -> u32) -> Self {
        let portion = halo.portion();
        let own = 0..portion.nodes();
        Self {
            own: own.map(|i| place(portion.global(i) as u32)).collect(),
            ghosts: halo.ghosts().iter().map(|k| place(*k)).collect(),
            halo,
        }
    }

    /// The ghosts.
    #[must_use]
    pub fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Places of own nodes.
    #[must_use]
    pub fn own(&self) -> &[u32] {
        &self.own
    }

    /// Places of some own nodes of `model`.
    ///
    /// # Errors
    /// [`crate::Error::InvalidParameter`] for a node that is not here.
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

    /// Writes numbers `q` of own nodes, `N` each, and those that other ranks tell of ghosts, to their
    /// places; `messages` are those of `N` numbers ([`Halo::messages`]). Nothing is allocated.
    ///
    /// # Errors
    /// Those of [`Halo::exchange`].
    pub fn spread<T: Real, const N: usize>(
        &self,
        messages: &mut [Message],
        q: &[T],
        x: &mut [T],
    ) -> Result<(), RankError> {
        self.spread_meanwhile::<T, N>(messages, q, x, &mut |_| false)
    }

    /// The same; until ghosts are there, `meanwhile` does pieces of work with what is known of own nodes,
    /// and says whether there is more ([`Halo::tell`]).
    ///
    /// # Errors
    /// Those of [`Halo::exchange`].
    pub fn spread_meanwhile<T: Real, const N: usize>(
        &self,
        messages: &mut [Message],
        q: &[T],
        x: &mut [T],
        meanwhile: &mut dyn FnMut(&[T]) -> bool,
    ) -> Result<(), RankError> {
        let q = q.as_chunks::<N>().0;
        for (place, q) in self.own.iter().zip(q) {
            x.as_chunks_mut::<N>().0[*place as usize] = *q;
        }
        let read = |i: usize| q[i].map(|x| x.as_f64());
        self.halo.tell(messages, read, &mut || meanwhile(x))?;
        let places = x.as_chunks_mut::<N>().0;
        self.halo.told(messages, |ghost, told| {
            places[self.ghosts[ghost] as usize] = told.map(T::of);
        });
        Ok(())
    }
}

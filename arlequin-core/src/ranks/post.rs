//! Repeated exchange of numbers between ranks, from and to places of a list.

use super::{Message, Portion};
use crate::Real;
use std::ops::Range;
use std::sync::Arc;

/// Places of a list that are sent to another rank and received from it.
#[derive(Debug, Default, Clone)]
pub(crate) struct Places {
    /// Places to send.
    pub(crate) send: Vec<u32>,
    /// Places to receive.
    pub(crate) receive: Range<u32>,
}

/// Exchange for one list: its peers and message buffers.
#[derive(Debug)]
pub(crate) struct Post {
    portion: Arc<Portion>,
    peers: Vec<Places>,
    messages: Vec<Message>,
}

impl Post {
    /// Prepares the exchange of `numbers` numbers per place with each peer. Of two ranks either both name
    /// each other or neither does.
    pub(crate) fn new(
        portion: Arc<Portion>,
        numbers: usize,
        peers: impl Iterator<Item = (usize, Places)>,
    ) -> Self {
        let (ranks, peers): (Vec<_>, Vec<Places>) = peers.unzip();
        let message = |(peer, p): (usize, &Places)| {
            Message::zeros(peer, numbers * p.send.len(), numbers * p.receive.len())
        };
        Self {
            messages: ranks.into_iter().zip(&peers).map(message).collect(),
            peers,
            portion,
        }
    }

    /// Returns the part of the model to whose ranks the exchange belongs.
    pub(crate) fn portion(&self) -> &Arc<Portion> {
        &self.portion
    }

    /// Sends and receives. Returns whether communication works ([`Portion::failure`]).
    pub(crate) fn exchange<T: Real, const N: usize>(&mut self, list: &mut [[T; N]]) -> bool {
        if self.messages.is_empty() {
            return self.portion.failure().is_none();
        }
        for (peer, message) in self.peers.iter().zip(&mut self.messages) {
            let numbers = message.out.as_chunks_mut::<N>().0;
            for (slot, place) in numbers.iter_mut().zip(&peer.send) {
                *slot = list[*place as usize].map(|x| x.as_f64());
            }
        }
        let outcome = self.portion.communicator().exchange(&mut self.messages);
        if self.portion.keep(outcome).is_err() {
            return false;
        }
        for (peer, message) in self.peers.iter().zip(&self.messages) {
            let places = &mut list[peer.receive.start as usize..peer.receive.end as usize];
            for (slot, numbers) in places.iter_mut().zip(message.into.as_chunks::<N>().0) {
                *slot = numbers.map(T::of);
            }
        }
        true
    }
}

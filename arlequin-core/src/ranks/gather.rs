//! Gathering of the unknowns of some nodes on all ranks.

use super::Message;
use crate::{Owned, Real};

/// Unknowns of a partitioned model that every rank needs, such as those of an overlap.
///
/// Items are numbered like unknowns, `per_node` of them for each node. Each item holds one or more numbers.
#[derive(Debug, Clone)]
pub struct Gather {
    nodes: Owned,
    /// Place in the list and local number of each item that this rank owns.
    owned: Vec<[u32; 2]>,
    /// Other ranks, and the places of the items they own.
    peers: Vec<(usize, Vec<u32>)>,
}

impl Gather {
    /// Prepares the gathering of `items` of the whole model, in the order in which every rank receives them.
    ///
    /// # Panics
    /// For items of nodes that do not exist, or if `per_node` is zero.
    #[must_use]
    pub fn new(nodes: &Owned, per_node: usize, items: impl Iterator<Item = usize>) -> Self {
        let portion = nodes.portion();
        let mut owned = Vec::new();
        let mut peers: Vec<(usize, Vec<u32>)> = (0..nodes.ranks()).map(|r| (r, Vec::new())).collect();
        for (place, item) in (0..).zip(items) {
            let (node, k) = (item / per_node, item % per_node);
            match (nodes.local(node), portion) {
                (Some(local), _) => owned.push([place, (local * per_node + k) as u32]),
                (None, Some(p)) => peers[p.division().owner(node)].1.push(place),
                (None, None) => (),
            }
        }
        let rank = portion.map_or(0, |p| p.communicator().rank());
        // A rank that neither sends to this one nor receives from it is no peer.
        peers.retain(|(r, places)| *r != rank && !(places.is_empty() && owned.is_empty()));
        Self {
            nodes: nodes.clone(),
            owned,
            peers,
        }
    }

    /// Returns the place in the list and the local number of each item that this rank owns.
    #[must_use]
    pub fn own(&self) -> &[[u32; 2]] {
        &self.owned
    }

    /// Returns message buffers for `numbers` numbers per item, to be used again and again.
    #[must_use]
    pub fn messages(&self, numbers: usize) -> Vec<Message> {
        let message = |(peer, places): &(usize, Vec<u32>)| {
            Message::zeros(*peer, numbers * self.owned.len(), numbers * places.len())
        };
        self.peers.iter().map(message).collect()
    }

    /// Writes the numbers of all items to `out`, on every rank; `x` holds those of this rank's nodes.
    /// `messages`: buffers for `numbers` numbers per item. NaN after a failure of the transport, which
    /// [`Owned::check_communication`] remembers. Collective.
    pub fn gather<T: Real>(&self, numbers: usize, messages: &mut [Message], x: &[T], out: &mut [T]) {
        let range = |item: u32| item as usize * numbers..(item as usize + 1) * numbers;
        for [place, local] in &self.owned {
            out[range(*place)].copy_from_slice(&x[range(*local)]);
        }
        for message in &mut *messages {
            let sent = self.owned.iter().flat_map(|[_, local]| &x[range(*local)]);
            message
                .out
                .iter_mut()
                .zip(sent)
                .for_each(|(slot, x)| *slot = x.as_f64());
        }
        let Some(portion) = self.nodes.portion().filter(|_| !messages.is_empty()) else {
            return;
        };
        if portion.keep(portion.communicator().exchange(messages)).is_err() {
            out.fill(T::of(f64::NAN));
            return;
        }
        for ((_, places), message) in self.peers.iter().zip(&*messages) {
            for (place, values) in places.iter().zip(message.into.chunks_exact(numbers)) {
                out[range(*place)]
                    .iter_mut()
                    .zip(values)
                    .for_each(|(slot, x)| *slot = T::of(*x));
            }
        }
    }

    /// Returns the numbers of all items in a new vector. Collective.
    #[must_use]
    pub fn gathered<T: Real>(&self, numbers: usize, x: &[T]) -> Vec<T> {
        let items = self.owned.len() + self.peers.iter().map(|o| o.1.len()).sum::<usize>();
        let mut out = vec![T::zero(); items * numbers];
        self.gather(numbers, &mut self.messages(numbers), x, &mut out);
        out
    }
}

//! Gathering of the unknowns of some nodes on all ranks.

use super::{Message, Portion, RankError};
use crate::Real;
use std::sync::Arc;

/// Unknowns of a partitioned model that every rank needs, such as those of an overlap.
///
/// Items are numbered like unknowns, `per_node` of them for each node. Each item holds one or more numbers.
#[derive(Debug, Clone)]
pub struct Gather {
    portion: Arc<Portion>,
    /// Place in the list and local number of each item that this rank owns.
    own: Vec<[u32; 2]>,
    /// Other ranks, and the places of the items they own.
    others: Vec<(usize, Vec<u32>)>,
}

impl Gather {
    /// Prepares the gathering of `items` of the whole model, in the order in which every rank receives them.
    ///
    /// # Panics
    /// For items of nodes that do not exist, or if `per_node` is zero.
    #[must_use]
    pub fn new(portion: Arc<Portion>, per_node: usize, items: impl Iterator<Item = usize>) -> Self {
        let division = portion.division();
        let mut own = Vec::new();
        let mut others: Vec<(usize, Vec<u32>)> = (0..division.ranks()).map(|r| (r, Vec::new())).collect();
        for (place, item) in (0..).zip(items) {
            let (node, k) = (item / per_node, item % per_node);
            match portion.local(node) {
                Some(here) => own.push([place, (here * per_node + k) as u32]),
                None => others[division.owner(node)].1.push(place),
            }
        }
        let mine = portion.communicator().rank();
        // A rank that neither sends to this one nor receives from it is no peer.
        others.retain(|(r, places)| *r != mine && !(places.is_empty() && own.is_empty()));
        Self { portion, own, others }
    }

    /// Returns the place in the list and the local number of each item that this rank owns.
    #[must_use]
    pub fn own(&self) -> &[[u32; 2]] {
        &self.own
    }

    /// Returns message buffers for `numbers` numbers per item, to be used again and again.
    #[must_use]
    pub fn messages(&self, numbers: usize) -> Vec<Message> {
        let message = |(peer, places): &(usize, Vec<u32>)| {
            Message::zeros(*peer, numbers * self.own.len(), numbers * places.len())
        };
        self.others.iter().map(message).collect()
    }

    /// Writes the numbers of all items to `out`, on every rank; `x` holds those of this rank's nodes.
    /// `messages`: buffers for `numbers` numbers per item. NaN after a failure of the transport, which
    /// [`Portion::failure`] remembers. Collective.
    pub fn gather<T: Real>(&self, numbers: usize, messages: &mut [Message], x: &[T], out: &mut [T]) {
        let of = |at: u32| at as usize * numbers..(at as usize + 1) * numbers;
        for [place, here] in &self.own {
            out[of(*place)].copy_from_slice(&x[of(*here)]);
        }
        for message in &mut *messages {
            let told = self.own.iter().flat_map(|[_, here]| &x[of(*here)]);
            message
                .out
                .iter_mut()
                .zip(told)
                .for_each(|(to, x)| *to = x.as_f64());
        }
        if messages.is_empty() {
            return;
        }
        let told: Result<(), RankError> = self.portion.communicator().exchange(messages, &mut || false);
        if self.portion.keep(told).is_err() {
            out.fill(T::of(f64::NAN));
            return;
        }
        for ((_, places), message) in self.others.iter().zip(&*messages) {
            for (place, told) in places.iter().zip(message.into.chunks_exact(numbers)) {
                out[of(*place)]
                    .iter_mut()
                    .zip(told)
                    .for_each(|(to, x)| *to = T::of(*x));
            }
        }
    }

    /// Returns the numbers of all items in a new vector. Collective.
    #[must_use]
    pub fn gathered<T: Real>(&self, numbers: usize, x: &[T]) -> Vec<T> {
        let items = self.own.len() + self.others.iter().map(|o| o.1.len()).sum::<usize>();
        let mut out = vec![T::zero(); items * numbers];
        self.gather(numbers, &mut self.messages(numbers), x, &mut out);
        out
    }
}

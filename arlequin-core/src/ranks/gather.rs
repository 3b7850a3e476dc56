//! Numbers of some nodes, told to all ranks by those that hold them.

use super::{Message, Portion, RankError};
use crate::Real;
use std::sync::Arc;

/// Unknowns of nodes of a model in parts that every rank wants to know, such as those of an overlap.
///
/// Items are numbered as unknowns are: `per_node` of them belong to each node, and each has so many numbers.
#[derive(Debug, Clone)]
pub struct Gather {
    portion: Arc<Portion>,
    /// Place in the list and number here of every own item.
    own: Vec<[u32; 2]>,
    /// Other ranks, and the places of what they hold.
    others: Vec<(usize, Vec<u32>)>,
}

impl Gather {
    /// Of items of the whole model, in the order in which every rank wants them.
    ///
    /// # Panics
    /// For items of nodes that are not there, or without any item per node.
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
        // Who holds nothing, and is told nothing, is no peer.
        others.retain(|(r, places)| *r != mine && !(places.is_empty() && own.is_empty()));
        Self { portion, own, others }
    }

    /// Place in the list, and number on this rank, of every item that is here.
    #[must_use]
    pub fn own(&self) -> &[[u32; 2]] {
        &self.own
    }

    /// Messages of so many numbers per item, to be used again and again.
    #[must_use]
    pub fn messages(&self, numbers: usize) -> Vec<Message> {
        let message = |(peer, places): &(usize, Vec<u32>)| {
            Message::zeros(*peer, numbers * self.own.len(), numbers * places.len())
        };
        self.others.iter().map(message).collect()
    }

    /// Writes the numbers of all items, from `x` where they are here; `messages` are those of so many
    /// `numbers` per item. All ranks must ask. Not numbers once ranks do not hear of each other any more,
    /// which [`Portion::failure`] remembers.
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

    /// The same into numbers of its own.
    #[must_use]
    pub fn gathered<T: Real>(&self, numbers: usize, x: &[T]) -> Vec<T> {
        let items = self.own.len() + self.others.iter().map(|o| o.1.len()).sum::<usize>();
        let mut out = vec![T::zero(); items * numbers];
        self.gather(numbers, &mut self.messages(numbers), x, &mut out);
        out
    }
}

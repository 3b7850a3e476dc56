//! All of a model in parts, on one rank: for output.

use super::{Message, Portion, RankError};
use crate::Real;

impl Portion {
    /// Numbers of all nodes in the order of the whole model, so many each, on rank 0; none on the others. `x` are those of
    /// the nodes here. All ranks must ask.
    ///
    /// # Errors
    /// Those of the transport, which [`Self::failure`] remembers.
    pub fn collect<T: Real>(&self, numbers: usize, x: &[T]) -> Result<Option<Vec<T>>, RankError> {
        let (division, mine) = (self.division(), self.communicator().rank());
        let all = || 0..division.nodes();
        if mine > 0 {
            let out: Vec<f64> = x.iter().map(|x| x.as_f64()).collect();
            if !out.is_empty() {
                let message = Message {
                    peer: 0,
                    out,
                    into: Vec::new(),
                };
                self.keep(self.communicator().exchange(&mut [message], &mut || ()))?;
            }
            return Ok(None);
        }
        let mut held = vec![0; division.ranks()];
        all().for_each(|node| held[division.owner(node)] += numbers);
        let others = held.iter().enumerate().filter(|(r, n)| *r > 0 && **n > 0);
        let message = |(peer, n): (usize, &usize)| Message {
            peer,
            out: Vec::new(),
            into: vec![0.0; *n],
        };
        let mut messages: Vec<Message> = others.map(message).collect();
        self.keep(self.communicator().exchange(&mut messages, &mut || ()))?;
        let mut parts: Vec<&[f64]> = vec![&[]; division.ranks()];
        messages.iter().for_each(|m| parts[m.peer] = &m.into);
        let mut own = x;
        let mut whole = Vec::with_capacity(numbers * division.nodes());
        // Ranks have their nodes in the order of the model.
        for node in all() {
            let owner = division.owner(node);
            if owner == 0 {
                let (first, rest) = own.split_at(numbers);
                whole.extend_from_slice(first);
                own = rest;
            } else {
                let (first, rest) = parts[owner].split_at(numbers);
                whole.extend(first.iter().map(|x| T::of(*x)));
                parts[owner] = rest;
            }
        }
        Ok(Some(whole))
    }
}

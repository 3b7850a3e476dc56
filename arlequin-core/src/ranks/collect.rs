//! Gathering of a whole partitioned model on rank 0, for output.

use super::{Message, Portion, RankError, Reduction};
use crate::Real;

impl Portion {
    /// Returns the lists of all ranks, one after another in the order of ranks, on rank 0; `None` on other
    /// ranks. Collective.
    ///
    /// # Errors
    /// Errors of the transport, which [`Self::failure`] remembers.
    pub(crate) fn gather_lists(&self, list: &[f64]) -> Result<Option<Vec<f64>>, RankError> {
        let (rank, ranks) = (self.communicator().rank(), self.communicator().ranks());
        let mut counts = vec![0; ranks];
        counts[rank] = list.len() as i64;
        self.keep(self.communicator().reduce(&mut counts, Reduction::Sum))?;
        let message = |peer: usize, out: Vec<f64>, count: i64| Message {
            peer,
            out,
            into: vec![0.0; count as usize],
        };
        let mut messages: Vec<Message> = match rank {
            0 => (1..ranks)
                .zip(&counts[1..])
                .map(|(r, n)| message(r, Vec::new(), *n))
                .collect(),
            _ => vec![message(0, list.to_vec(), 0)],
        };
        messages.retain(|m| !(m.out.is_empty() && m.into.is_empty()));
        self.keep(self.communicator().exchange(&mut messages))?;
        let received = messages.iter().flat_map(|m| &m.into);
        Ok((rank == 0).then(|| list.iter().chain(received).copied().collect()))
    }

    /// Returns the numbers of all nodes in the order of the whole model (`numbers` each) on rank 0; `None` on
    /// other ranks. `x`: numbers of this rank's nodes. Collective.
    ///
    /// # Errors
    /// Errors of the transport, which [`Self::failure`] remembers.
    pub(crate) fn collect<T: Real>(&self, numbers: usize, x: &[T]) -> Result<Option<Vec<T>>, RankError> {
        let (division, rank) = (self.division(), self.communicator().rank());
        let all_nodes = || 0..division.nodes();
        if rank > 0 {
            let out: Vec<f64> = x.iter().map(|x| x.as_f64()).collect();
            // Rank 0 expects no message from a rank without nodes.
            if !out.is_empty() {
                let message = Message {
                    peer: 0,
                    out,
                    into: Vec::new(),
                };
                self.keep(self.communicator().exchange(&mut [message]))?;
            }
            return Ok(None);
        }
        let mut held = vec![0; division.ranks()];
        all_nodes().for_each(|node| held[division.owner(node)] += numbers);
        let senders = held.iter().enumerate().filter(|(r, n)| *r > 0 && **n > 0);
        let message = |(peer, n): (usize, &usize)| Message {
            peer,
            out: Vec::new(),
            into: vec![0.0; *n],
        };
        let mut messages: Vec<Message> = senders.map(message).collect();
        self.keep(self.communicator().exchange(&mut messages))?;
        let mut parts: Vec<&[f64]> = vec![&[]; division.ranks()];
        messages.iter().for_each(|m| parts[m.peer] = &m.into);
        let mut local = x;
        let mut global = Vec::with_capacity(numbers * division.nodes());
        // Each rank has its nodes in the order of the model.
        for node in all_nodes() {
            let owner = division.owner(node);
            if owner == 0 {
                let (first, tail) = local.split_at(numbers);
                global.extend_from_slice(first);
                local = tail;
            } else {
                let (first, tail) = parts[owner].split_at(numbers);
                global.extend(first.iter().map(|x| T::of(*x)));
                parts[owner] = tail;
            }
        }
        Ok(Some(global))
    }
}

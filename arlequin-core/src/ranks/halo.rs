//! Ghosts: nodes of other ranks that are linked with nodes of this rank.

use super::{Message, RankError};
use crate::Owned;
use std::ops::Range;

/// Nodes exchanged with one other rank.
#[derive(Debug, Clone)]
pub(super) struct Peer {
    pub(super) rank: usize,
    /// Local numbers of the owned nodes that the other rank needs.
    pub(super) send: Vec<u32>,
    /// Range of the ghosts that the other rank owns, among all ghosts.
    pub(super) receive: Range<usize>,
}

/// Ghosts of a rank, sorted by owner and then by number.
///
/// Both owners know of a link between them, so that each rank finds the nodes to send without a request.
#[derive(Debug, Clone)]
pub struct Halo {
    pub(super) owned: Owned,
    pub(super) peers: Vec<Peer>,
    pub(super) ghosts: Vec<u32>,
}

impl Halo {
    /// Finds the ghosts of this rank from links between nodes of the whole model. A rank has to be given at
    /// least all links with an end that it owns. A whole model has no ghosts.
    ///
    /// # Panics
    /// If a link names a node that does not exist.
    #[must_use]
    pub fn of_links(owned: &Owned, links: impl Iterator<Item = [u32; 2]>) -> Self {
        let Some(portion) = owned.portion() else {
            return Self::none(owned);
        };
        let own_rank = portion.communicator().rank();
        let owner = |node: u32| portion.division().owner(node as usize);
        // Pairs of a rank and a node: ghosts that this rank needs, and owned nodes that the other one needs.
        let (mut theirs, mut ours) = (Vec::new(), Vec::new());
        for [i, j] in links {
            for [end, other_end] in [[i, j], [j, i]] {
                let rank = owner(other_end);
                if owner(end) == own_rank && rank != own_rank {
                    theirs.push((rank as u32, other_end));
                    ours.push((rank as u32, end));
                }
            }
        }
        for list in [&mut theirs, &mut ours] {
            list.sort_unstable();
            list.dedup();
        }
        let mut peers = Vec::new();
        let mut ghosts = 0..0;
        let same_rank = |a: &(u32, u32), b: &(u32, u32)| a.0 == b.0;
        // A link has two ends, so that both lists name the same ranks.
        for (sent, received) in ours.chunk_by(same_rank).zip(theirs.chunk_by(same_rank)) {
            ghosts = ghosts.end..ghosts.end + received.len();
            let local = |node: u32| portion.local(node as usize).unwrap_or_default() as u32;
            peers.push(Peer {
                rank: sent[0].0 as usize,
                send: sent.iter().map(|(_, node)| local(*node)).collect(),
                receive: ghosts.clone(),
            });
        }
        Self {
            peers,
            ghosts: theirs.into_iter().map(|t| t.1).collect(),
            owned: owned.clone(),
        }
    }

    /// Returns the halo of a whole model.
    pub(super) fn none(owned: &Owned) -> Self {
        Self {
            owned: owned.clone(),
            peers: Vec::new(),
            ghosts: Vec::new(),
        }
    }

    /// Returns the nodes that this rank owns.
    #[must_use]
    pub fn owned(&self) -> &Owned {
        &self.owned
    }

    /// Returns the number in the whole model of a local node: owned nodes come first, then ghosts.
    ///
    /// # Panics
    /// If this rank has no such node.
    #[must_use]
    pub fn global(&self, node: usize) -> usize {
        match node.checked_sub(self.owned.nodes()) {
            None => self.owned.global(node),
            Some(ghost) => self.ghosts[ghost] as usize,
        }
    }

    /// Returns the numbers of the ghosts in the whole model.
    #[must_use]
    pub fn ghosts(&self) -> &[u32] {
        &self.ghosts
    }

    /// Returns the number of nodes sent, over all messages.
    #[must_use]
    pub fn sent(&self) -> usize {
        self.peers.iter().map(|p| p.send.len()).sum()
    }

    /// Returns the number of ranks that this one exchanges messages with.
    #[must_use]
    pub fn peers(&self) -> usize {
        self.peers.len()
    }

    /// Returns message buffers for `numbers` numbers per node, to be used again and again.
    #[must_use]
    pub fn messages(&self, numbers: usize) -> Vec<Message> {
        let message = |p: &Peer| Message::zeros(p.rank, numbers * p.send.len(), numbers * p.receive.len());
        self.peers.iter().map(message).collect()
    }

    /// Sends the numbers that `read` returns for owned nodes, waits for those of ghosts and passes them to
    /// `write` (halo exchange). `messages`: buffers for `N` numbers per node. Allocates nothing.
    ///
    /// # Errors
    /// Errors of the transport, which [`Owned::check_communication`] remembers; ghosts are then unknown.
    pub fn exchange<const N: usize>(
        &self,
        messages: &mut [Message],
        read: impl Fn(usize) -> [f64; N],
        mut write: impl FnMut(usize, [f64; N]),
    ) -> Result<(), RankError> {
        for (peer, message) in self.peers.iter().zip(&mut *messages) {
            let places = message.out.as_chunks_mut::<N>().0;
            for (slot, node) in places.iter_mut().zip(&peer.send) {
                *slot = read(*node as usize);
            }
        }
        if let Some(portion) = self.owned.portion() {
            portion.keep(portion.communicator().exchange(messages))?;
        }
        for (peer, message) in self.peers.iter().zip(messages) {
            let numbers = message.into.as_chunks::<N>().0;
            for (ghost, x) in peer.receive.clone().zip(numbers) {
                write(ghost, *x);
            }
        }
        Ok(())
    }
}

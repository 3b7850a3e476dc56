//! Nodes of other ranks that the nodes of this one are linked with.

use super::{Message, Portion, RankError, UNIT};
use std::ops::Range;
use std::sync::Arc;

/// What a rank tells one other.
#[derive(Debug, Clone)]
pub(super) struct Peer {
    pub(super) rank: usize,
    /// Own nodes that it needs.
    pub(super) send: Vec<u32>,
    /// Those of its nodes that are needed here, among all such.
    pub(super) receive: Range<usize>,
}

/// Ghosts: nodes of other ranks that are linked with own ones, by rank and then by number.
///
/// Both ends of a link know of it, so that each rank finds what the other will ask for without asking.
#[derive(Debug, Clone)]
pub struct Halo {
    pub(super) portion: Arc<Portion>,
    pub(super) peers: Vec<Peer>,
    pub(super) ghosts: Vec<u32>,
}

impl Halo {
    /// The ghosts of this rank's nodes for links between nodes of the whole model, each given at least
    /// where one of its ends is.
    ///
    /// # Panics
    /// For links of nodes that are not there.
    #[must_use]
    pub fn of_links(portion: Arc<Portion>, links: impl Iterator<Item = [u32; 2]>) -> Self {
        let mine = portion.communicator().rank();
        let owner = |node: u32| portion.division().owner(node as usize);
        // Rank, node that is needed: there, and here.
        let (mut theirs, mut ours) = (Vec::new(), Vec::new());
        for [i, j] in links {
            for [here, there] in [[i, j], [j, i]] {
                let rank = owner(there);
                if owner(here) == mine && rank != mine {
                    theirs.push((rank as u32, there));
                    ours.push((rank as u32, here));
                }
            }
        }
        for all in [&mut theirs, &mut ours] {
            all.sort_unstable();
            all.dedup();
        }
        let mut peers = Vec::new();
        let mut ghosts = 0..0;
        let same = |a: &(u32, u32), b: &(u32, u32)| a.0 == b.0;
        // A link has two ends: both lists name the same ranks.
        for (of, from) in ours.chunk_by(same).zip(theirs.chunk_by(same)) {
            ghosts = ghosts.end..ghosts.end + from.len();
            let local = |node: u32| portion.local(node as usize).unwrap_or_default() as u32;
            peers.push(Peer {
                rank: of[0].0 as usize,
                send: of.iter().map(|(_, node)| local(*node)).collect(),
                receive: ghosts.clone(),
            });
        }
        Self {
            peers,
            ghosts: theirs.into_iter().map(|t| t.1).collect(),
            portion,
        }
    }

    /// The portion whose ghosts they are.
    #[must_use]
    pub fn portion(&self) -> &Arc<Portion> {
        &self.portion
    }

    /// Numbers of the ghosts in the whole model.
    #[must_use]
    pub fn ghosts(&self) -> &[u32] {
        &self.ghosts
    }

    /// Own nodes that are sent, one message after the other.
    #[must_use]
    pub fn sent(&self) -> usize {
        self.peers.iter().map(|p| p.send.len()).sum()
    }

    /// Which units here have a node that is linked with a ghost; all others can be worked on before ghosts
    /// are known.
    #[must_use]
    pub fn borders(&self) -> Vec<bool> {
        let mut out = vec![false; self.portion.nodes().div_ceil(UNIT)];
        // Links have two ends: what is linked with a ghost is told to its rank.
        let linked = self.peers.iter().flat_map(|p| &p.send);
        linked.for_each(|node| out[*node as usize / UNIT] = true);
        out
    }

    /// Ranks that it hears of.
    #[must_use]
    pub fn peers(&self) -> usize {
        self.peers.len()
    }

    /// Messages of so many numbers per node, to be used again and again.
    #[must_use]
    pub fn messages(&self, numbers: usize) -> Vec<Message> {
        let message = |p: &Peer| Message::zeros(p.rank, numbers * p.send.len(), numbers * p.receive.len());
        self.peers.iter().map(message).collect()
    }

    /// Tells others of own nodes by `read`, and hands what they tell of ghosts to `write`; `messages` are
    /// those of `N` numbers. Nothing is allocated.
    ///
    /// # Errors
    /// Those of the transport, which [`Portion::failure`] remembers.
    pub fn exchange<const N: usize>(
        &self,
        messages: &mut [Message],
        read: impl Fn(usize) -> [f64; N],
        write: impl FnMut(usize, [f64; N]),
    ) -> Result<(), RankError> {
        self.tell(messages, read, &mut || false)?;
        self.told(messages, write);
        Ok(())
    }

    /// The first half of [`Self::exchange`]: tells, and waits for what others tell. Until that is there,
    /// `meanwhile` does pieces of work that needs no ghosts, and says whether there is more; all of it is
    /// done in the end.
    ///
    /// # Errors
    /// Those of [`Self::exchange`]; no ghosts are then known.
    pub fn tell<const N: usize>(
        &self,
        messages: &mut [Message],
        read: impl Fn(usize) -> [f64; N],
        meanwhile: &mut dyn FnMut() -> bool,
    ) -> Result<(), RankError> {
        for (peer, message) in self.peers.iter().zip(&mut *messages) {
            let places = message.out.as_chunks_mut::<N>().0;
            for (to, node) in places.iter_mut().zip(&peer.send) {
                *to = read(*node as usize);
            }
        }
        let mut more = true;
        let mut work = || {
            more = more && meanwhile();
            more
        };
        let communicator = self.portion.communicator();
        self.portion.keep(communicator.exchange(messages, &mut work))?;
        // Whatever a transport does: unfinished work would be a wrong answer without a word.
        while work() {}
        Ok(())
    }

    /// The second half of [`Self::exchange`]: hands what others told of ghosts to `write`.
    pub fn told<const N: usize>(&self, messages: &[Message], mut write: impl FnMut(usize, [f64; N])) {
        for (peer, message) in self.peers.iter().zip(messages) {
            let told = message.into.as_chunks::<N>().0;
            for (ghost, x) in peer.receive.clone().zip(told) {
                write(ghost, *x);
            }
        }
    }
}

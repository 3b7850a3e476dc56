//! Runs on several ranks: processes, or threads in tests, each of which owns and steps a part of a model.
//!
//! Nodes are partitioned in units of [`UNIT`] consecutive nodes ([`Division`]). A rank has a [`Portion`]:
//! whole units, in the order of the model, so that results per node have the bits of the whole model. Values
//! of nodes that other ranks own arrive by a halo exchange ([`Halo`]). Sums are formed per unit in the order
//! of its nodes, and over units exactly ([`crate::Exact`]). They depend neither on the distribution of units
//! nor on the order in which messages arrive. A model returns the nodes that a rank owns by
//! [`crate::Model::owned`]; a model that is not partitioned is the same on every rank.
//!
//! The core uses a transport only through [`Communicator`].

mod collect;
mod division;
mod gather;
mod halo;
mod near;
mod portion;
mod post;
mod reach;

pub use division::{Division, Unit};
pub use gather::Gather;
pub use halo::Halo;
pub use portion::Portion;
pub(crate) use post::{Places, Post};
pub use reach::Reach;

pub use crate::owned::UNIT;

/// Numbers for another rank, and a buffer for the numbers that it sends back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Message {
    /// The other rank.
    pub peer: usize,
    /// Numbers to send.
    pub out: Vec<f64>,
    /// Buffer of the numbers to receive; its length is the number expected.
    pub into: Vec<f64>,
}

impl Message {
    /// Returns a message of zeros with buffers of `out` numbers to send and `into` numbers to receive.
    #[must_use]
    pub fn zeros(peer: usize, out: usize, into: usize) -> Self {
        Self {
            peer,
            out: vec![0.0; out],
            into: vec![0.0; into],
        }
    }
}

/// Way in which integers of several ranks are combined. The order of ranks does not matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// Their sum.
    Sum,
    /// The largest.
    Largest,
}

/// Transport between ranks. [`Communicator::reduce`] is collective: all ranks call it in the same order. No
/// call waits for ever.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// Returns the number of this rank, from zero.
    fn rank(&self) -> usize;

    /// Returns the number of ranks.
    fn ranks(&self) -> usize;

    /// Sends all messages and waits for those of the peers; every peer makes the matching call.
    ///
    /// # Errors
    /// [`RankError`] for a peer that is silent, lost or gave up, or that sends a message of another length.
    fn exchange(&self, messages: &mut [Message]) -> Result<(), RankError>;

    /// Replaces `words` by their reduction over all ranks, entry by entry (all-reduce). Collective.
    ///
    /// # Errors
    /// Errors of [`Self::exchange`].
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError>;

    /// Informs all other ranks that this one stops, and why, so that they do not wait for it.
    fn abandon(&self, why: &str);
}

/// Error of communication between ranks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RankError {
    /// A rank that does not answer.
    #[error(
        "rank {rank} has waited {seconds} s for {peer} ({what}): it hangs, or works much longer; look at what that rank said last, \
         or allow a longer wait"
    )]
    Silent {
        /// The rank that waited.
        rank: usize,
        /// Rank or ranks that it waited for.
        peer: String,
        /// Operation that it waited for.
        what: &'static str,
        /// Duration of the wait \[s\].
        seconds: f64,
    },
    /// A rank that stopped with an error.
    #[error("rank {rank} stops because rank {by} gave up: {why}")]
    GaveUp {
        /// This rank.
        rank: usize,
        /// The rank that gave up.
        by: usize,
        /// Its error message.
        why: String,
    },
    /// A rank that ended without a message.
    #[error("rank {rank} stops because rank {peer} is gone: it was ended, or ran out of memory")]
    Lost {
        /// This rank.
        rank: usize,
        /// The rank that ended.
        peer: usize,
    },
    /// A message of unexpected length.
    #[error(
        "rank {rank} expects {expected} numbers from rank {peer} and gets {found}: the two have different models or do not make the \
         same steps; give every rank the same input"
    )]
    Length {
        /// This rank.
        rank: usize,
        /// The rank that sent it.
        peer: usize,
        /// Numbers expected.
        expected: usize,
        /// Numbers received.
        found: usize,
    },
    /// Different input on different ranks.
    #[error("rank {rank}: ranks differ in {what}; give every rank the same input and the same program")]
    Differ {
        /// This rank.
        rank: usize,
        /// Description of the input that differs.
        what: String,
    },
    /// More ranks than nodes, or no rank.
    #[error("{ranks} ranks for {nodes} nodes: take at most {units}, one per {UNIT} nodes")]
    TooMany {
        /// Number of ranks.
        ranks: usize,
        /// Number of nodes.
        nodes: usize,
        /// Number of units: the most ranks that can have work.
        units: usize,
    },
    /// Failure of the transport.
    #[error("rank {rank}: {what}")]
    Transport {
        /// This rank.
        rank: usize,
        /// Message of the transport.
        what: String,
    },
}

/// Checks that all ranks have the same digest of their input. Collective.
///
/// # Errors
/// [`RankError::Differ`] on every rank, with `what` in its message, if they differ; errors of
/// [`Communicator::reduce`].
pub fn agree(communicator: &dyn Communicator, what: &str, digest: u64) -> Result<(), RankError> {
    let digest = digest.cast_signed();
    let mut words = [digest, !digest];
    communicator.reduce(&mut words, Reduction::Largest)?;
    // `!x` falls as `x` rises, so that the second word is the smallest digest, inverted.
    if words[0] == !words[1] {
        return Ok(());
    }
    Err(RankError::Differ {
        rank: communicator.rank(),
        what: what.to_owned(),
    })
}

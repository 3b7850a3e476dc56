//! One run on several ranks: processes, or threads in tests, each of which holds a part of a model and
//! steps it.
//!
//! Nodes are shared out in units of [`UNIT`] consecutive ones ([`Division`]). A rank has a [`Portion`]: its
//! units, whole, in the order of the model, so that whatever is found per node has the bits of the whole
//! model. What nodes of other ranks must tell comes through a [`Halo`]. Sums are formed per unit in the
//! order of its nodes, and over units exactly ([`Exact`]): they do not depend on who holds which unit, nor
//! on the order in which ranks are heard. A model that is a portion says so ([`crate::Model::portion`]);
//! one that is not is the same on every rank.
//!
//! The core knows a transport by [`Communicator`] alone.

mod collect;
mod cuts;
mod division;
mod exact;
mod gather;
mod halo;
mod near;
mod portion;
mod post;
mod reach;

pub(crate) use cuts::Cuts;
pub use division::{Division, Unit};
pub use exact::{Exact, WORDS};
pub use gather::Gather;
pub use halo::Halo;
pub(crate) use portion::largest;
pub use portion::{Portion, add_products, sum};
pub(crate) use post::{Places, Post};
pub use reach::Reach;

/// Nodes in a unit: what a rank holds at least, and what sums are formed over first.
pub const UNIT: usize = 256;

/// What one rank sends to another and gets in return.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Message {
    /// The other rank.
    pub peer: usize,
    /// What it is sent.
    pub out: Vec<f64>,
    /// Room for what it sends: as many numbers as come.
    pub into: Vec<f64>,
}

impl Message {
    /// Of zeros, so many to and from a rank.
    #[must_use]
    pub fn zeros(peer: usize, out: usize, into: usize) -> Self {
        Self {
            peer,
            out: vec![0.0; out],
            into: vec![0.0; into],
        }
    }
}

/// How integers of several ranks are put together; no order of ranks changes the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// Added up.
    Sum,
    /// The largest.
    Largest,
}

/// How ranks hear of each other. All calls but [`Communicator::exchange`] are made by all ranks, in the
/// same order; none waits for ever.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// Number of this rank, from zero.
    fn rank(&self) -> usize;

    /// How many there are.
    fn ranks(&self) -> usize;

    /// Sends and receives all messages, whose peers do the same. While they are on their way `meanwhile`
    /// does a piece of other work and says whether there is more of it: it is called until there is none,
    /// and messages are looked after in between.
    ///
    /// # Errors
    /// A peer that is silent, lost or gave up; a message of another length.
    fn exchange(
        &self,
        messages: &mut [Message],
        meanwhile: &mut dyn FnMut() -> bool,
    ) -> Result<(), RankError>;

    /// Puts the words of all ranks together, entry by entry; all get the result.
    ///
    /// # Errors
    /// Those of [`Self::exchange`].
    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError>;

    /// Tells all others that this rank goes on no more, and why: they must not wait for it.
    fn abandon(&self, why: &str);
}

/// What can go wrong between ranks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RankError {
    /// Another rank does not answer.
    #[error(
        "rank {rank} has waited {seconds} s for {peer} ({what}): it hangs, or works much longer; look at what that rank said last, \
         or allow a longer wait"
    )]
    Silent {
        /// The rank that waited.
        rank: usize,
        /// For whom.
        peer: String,
        /// For what.
        what: &'static str,
        /// How long \[s\].
        seconds: f64,
    },
    /// Another rank met an error.
    #[error("rank {rank} stops because rank {by} gave up: {why}")]
    GaveUp {
        /// This rank.
        rank: usize,
        /// The one that gave up.
        by: usize,
        /// Its error.
        why: String,
    },
    /// Another rank ended without a word.
    #[error("rank {rank} stops because rank {peer} is gone: it was ended, or ran out of memory")]
    Lost {
        /// This rank.
        rank: usize,
        /// The one that is gone.
        peer: usize,
    },
    /// Two ranks do not speak of the same.
    #[error(
        "rank {rank} expects {expected} numbers from rank {peer} and gets {found}: the two have different models or do not make the \
         same steps; give every rank the same input"
    )]
    Length {
        /// This rank.
        rank: usize,
        /// The other one.
        peer: usize,
        /// Numbers expected.
        expected: usize,
        /// Numbers that came.
        found: usize,
    },
    /// Ranks were given different input.
    #[error("rank {rank}: ranks differ in {what}; give every rank the same input and the same program")]
    Differ {
        /// This rank.
        rank: usize,
        /// In what.
        what: String,
    },
    /// There is not even a node for every rank.
    #[error("{ranks} ranks for {nodes} nodes: take at most {units}, one per {UNIT} nodes")]
    TooMany {
        /// Ranks.
        ranks: usize,
        /// Nodes.
        nodes: usize,
        /// Units: ranks that can have work.
        units: usize,
    },
    /// The transport failed.
    #[error("rank {rank}: {what}")]
    Transport {
        /// This rank.
        rank: usize,
        /// What it said.
        what: String,
    },
}

/// Whether all ranks say the same number: a digest of their input.
///
/// # Errors
/// [`RankError::Differ`] on every rank, with `what` differs; those of [`Communicator::reduce`].
pub fn agree(communicator: &dyn Communicator, what: &str, digest: u64) -> Result<(), RankError> {
    let digest = digest.cast_signed();
    let mut words = [digest, !digest];
    communicator.reduce(&mut words, Reduction::Largest)?;
    // `!x` falls as `x` rises: the second is the smallest of all.
    if words[0] == !words[1] {
        return Ok(());
    }
    Err(RankError::Differ {
        rank: communicator.rank(),
        what: what.to_owned(),
    })
}

//! What can go wrong between two processes: each error names the other side, the value, the limit and a way
//! out.

use crate::wire::Kind;
use std::time::Duration;

/// An error of a link.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An address that is none, or none that a link may have.
    #[error("address '{address}': {rule}")]
    Address {
        /// As it was given.
        address: String,
        /// What it must be.
        rule: String,
    },
    /// The operating system refused something.
    #[error("{what}: {reason}")]
    System {
        /// What was tried.
        what: String,
        /// Its answer.
        reason: String,
    },
    /// A command that does not run, or ended before its time.
    #[error("command '{command}' {what}; try it by hand")]
    Command {
        /// The command.
        command: String,
        /// What became of it.
        what: String,
    },
    /// Nobody came, or no answer.
    #[error(
        "{peer}: {waited} was due within {:.1} s and did not come; see what it does, or allow it more by timeout (by start_timeout to connect)", limit.as_secs_f64()
    )]
    Silent {
        /// The other side.
        peer: String,
        /// What was waited for.
        waited: String,
        /// For how long.
        limit: Duration,
    },
    /// The user ended the run, by Ctrl-C or SIGTERM, while it waited.
    #[error("interrupted while {peer} was waited for: {waited} was due")]
    Interrupted {
        /// The other side.
        peer: String,
        /// What was waited for.
        waited: String,
    },
    /// The other side is gone.
    #[error("{peer} closed the link where {expected} was due; see its own messages for the reason")]
    Closed {
        /// The other side.
        peer: String,
        /// What was due.
        expected: String,
    },
    /// Not this protocol at all.
    #[error("{peer} does not speak this protocol: a message begins with {found:?}, not with \"ARLQ\"")]
    Stranger {
        /// The other side.
        peer: String,
        /// First four bytes.
        found: [u8; 4],
    },
    /// Another version of it.
    #[error(
        "{peer} speaks version {found} of the protocol, this side version {own}; take the client that came with this version"
    )]
    Version {
        /// The other side.
        peer: String,
        /// Its version.
        found: u16,
        /// That of this side.
        own: u16,
    },
    /// A message that is not due.
    #[error("{peer} sent {found} where {expected} was due")]
    Unexpected {
        /// The other side.
        peer: String,
        /// What it sent.
        found: String,
        /// What was due.
        expected: String,
    },
    /// A message of another length than it must have.
    #[error("{peer} sent {kind} of {found} bytes, {rule}")]
    Length {
        /// The other side.
        peer: String,
        /// Which message.
        kind: Kind,
        /// Its length.
        found: u64,
        /// What it must be.
        rule: String,
    },
    /// A message whose content makes no sense.
    #[error("{peer} sent {kind} in which {rule}")]
    Content {
        /// The other side.
        peer: String,
        /// Which message.
        kind: Kind,
        /// What is wrong with it.
        rule: String,
    },
    /// The other side says that it failed.
    #[error("{peer} failed: {text}")]
    Failed {
        /// The other side.
        peer: String,
        /// Its words.
        text: String,
    },
    /// It changes velocities by something else than impulse over the inertia that it told.
    #[error(
        "{peer} changed the velocity of unknown {unknown} by {found:e} under an impulse that makes {wanted:e} of the inertia \
         {inertia:e} which it told; let it tell the mass that it moves"
    )]
    Mass {
        /// The other side.
        peer: String,
        /// Which unknown.
        unknown: usize,
        /// Its inertia \[kg, kg m²\].
        inertia: f64,
        /// Change of its velocity.
        found: f64,
        /// What the change should be.
        wanted: f64,
    },
    /// Its inertia under weights is more than without.
    #[error(
        "{peer} has inertia {found:e} at unknown {unknown} under its weights, more than {whole:e} without; weights are at most one"
    )]
    Heavier {
        /// The other side.
        peer: String,
        /// Which unknown.
        unknown: usize,
        /// Inertia with weights \[kg, kg m²\].
        found: f64,
        /// Without.
        whole: f64,
    },
    /// A link that was used again after an error.
    #[error("the link to {peer} is broken since an earlier error: {earlier}")]
    Broken {
        /// The other side.
        peer: String,
        /// That error.
        earlier: String,
    },
}

/// Result of the operations of a link.
pub type Result<V, E = Error> = std::result::Result<V, E>;

//! Errors of a link. Each names the other side, the value, the limit and a remedy.

use crate::wire::Kind;
use std::time::Duration;

/// An error of a link.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An address that cannot be read, or that a link must not use.
    #[error("address '{address}': {rule}")]
    Address {
        /// Address as given.
        address: String,
        /// Rule that the address must satisfy.
        rule: String,
    },
    /// The operating system refused an operation.
    #[error("{what}: {reason}")]
    System {
        /// Operation that was tried.
        what: String,
        /// Reason that the system gave.
        reason: String,
    },
    /// A command that cannot be started, or that ended too early.
    #[error("command '{command}' {what}; try it by hand")]
    Command {
        /// The command.
        command: String,
        /// Description of the event, worded to follow the command.
        what: String,
    },
    /// No connection, or no answer, within the time limit.
    #[error(
        "{peer}: {waited} was due within {:.1} s and did not come; see what it does, or allow it more by timeout (by start_timeout to connect)", limit.as_secs_f64()
    )]
    Silent {
        /// The other side.
        peer: String,
        /// Connection or message that was expected.
        waited: String,
        /// Time limit.
        limit: Duration,
    },
    /// The user ended the run, by Ctrl-C or SIGTERM, while it waited.
    #[error("interrupted while {peer} was waited for: {waited} was due")]
    Interrupted {
        /// The other side.
        peer: String,
        /// Connection or message that was expected.
        waited: String,
    },
    /// The other side has closed the link.
    #[error("{peer} closed the link where {expected} was due; see its own messages for the reason")]
    Closed {
        /// The other side.
        peer: String,
        /// Message that was expected.
        expected: String,
    },
    /// The other side speaks another protocol.
    #[error("{peer} does not speak this protocol: a message begins with {found:?}, not with \"ARLQ\"")]
    Stranger {
        /// The other side.
        peer: String,
        /// First four bytes.
        found: [u8; 4],
    },
    /// The other side speaks another version of the protocol.
    #[error(
        "{peer} speaks version {found} of the protocol, this side version {own}; take the client that came with this version"
    )]
    Version {
        /// The other side.
        peer: String,
        /// Version of the other side.
        found: u16,
        /// Version of this side.
        own: u16,
    },
    /// A message of a kind that was not expected.
    #[error("{peer} sent {found} where {expected} was due")]
    Unexpected {
        /// The other side.
        peer: String,
        /// Kind of the message received.
        found: String,
        /// Kind of message that was expected.
        expected: String,
    },
    /// A message of the wrong length.
    #[error("{peer} sent {kind} of {found} bytes, {rule}")]
    Length {
        /// The other side.
        peer: String,
        /// Kind of the message.
        kind: Kind,
        /// Length of the message \[bytes\].
        found: u64,
        /// Rule that the length must satisfy.
        rule: String,
    },
    /// A message whose content breaks a rule.
    #[error("{peer} sent {kind} in which {rule}")]
    Content {
        /// The other side.
        peer: String,
        /// Kind of the message.
        kind: Kind,
        /// Rule that the content breaks, in words.
        rule: String,
    },
    /// The other side reports a failure.
    #[error("{peer} failed: {text}")]
    Failed {
        /// The other side.
        peer: String,
        /// Reason that the other side gave.
        text: String,
    },
    /// The solver changes a velocity by something other than impulse over the inertia it has sent.
    #[error(
        "{peer} changed the velocity of unknown {unknown} by {found:e} under an impulse that makes {wanted:e} of the inertia \
         {inertia:e} which it told; let it tell the mass that it moves"
    )]
    Mass {
        /// The other side.
        peer: String,
        /// Index of the unknown.
        unknown: usize,
        /// Inertia of the unknown \[kg, kg m²\].
        inertia: f64,
        /// Change of velocity that was found.
        found: f64,
        /// Change of velocity that was expected.
        wanted: f64,
    },
    /// The solver's inertia with weights exceeds its inertia without weights.
    #[error(
        "{peer} has inertia {found:e} at unknown {unknown} under its weights, more than {whole:e} without; weights are at most one"
    )]
    Heavier {
        /// The other side.
        peer: String,
        /// Index of the unknown.
        unknown: usize,
        /// Inertia with weights \[kg, kg m²\].
        found: f64,
        /// Inertia without weights \[kg, kg m²\].
        whole: f64,
    },
    /// A link was used again after an error.
    #[error("the link to {peer} is broken since an earlier error: {earlier}")]
    Broken {
        /// The other side.
        peer: String,
        /// The earlier error.
        earlier: String,
    },
}

/// Result of an operation on a link.
pub type Result<V, E = Error> = std::result::Result<V, E>;

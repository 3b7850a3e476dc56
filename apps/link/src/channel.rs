//! Complete messages over a stream, with limits on their length and on the time they take.

use crate::address::Stream;
use crate::error::{Error, Result};
use crate::message::read_failure;
use crate::wire::{Content, HEADER, Header, Kind, Message, SMALL};
use arlequin_core::interrupt;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// Largest step by which the buffer grows \[bytes\]. A peer that announces much and sends little so costs
/// little memory.
const PIECE: usize = 1 << 20;
/// Time between two checks for Ctrl-C.
const GLANCE: Duration = Duration::from_millis(50);
/// Time the other side has for its answer after Ctrl-C: an answer lets the run end at a whole step.
const GRACE: Duration = Duration::from_secs(1);

/// A channel that sends and receives complete messages.
#[derive(Debug)]
pub(crate) struct Channel {
    stream: Stream,
    /// Name of the other side, for error messages.
    pub(crate) peer: String,
    /// Time that one message may take; `None` for no limit.
    timeout: Option<Duration>,
    /// Longest message accepted \[bytes\].
    limit: u64,
    /// Longest message that the other side accepts \[bytes\].
    pub(crate) peer_limit: u64,
    /// The message being written.
    pub(crate) out: Message,
    /// Content read last; the buffer never shrinks.
    buffer: Vec<u8>,
    /// Time at which Ctrl-C was noticed.
    interrupted: Option<Instant>,
}

impl Channel {
    pub(crate) fn new(stream: Stream, peer: String, timeout: Option<Duration>, limit: u64) -> Self {
        Self {
            stream,
            peer,
            timeout,
            limit,
            peer_limit: SMALL,
            out: Message::default(),
            buffer: Vec::new(),
            interrupted: None,
        }
    }

    /// Returns the deadline of a message that begins now.
    fn until(&self) -> Option<Instant> {
        self.timeout.map(|t| Instant::now() + t)
    }

    /// Returns how long to wait now: until the deadline, but at most until the next check for Ctrl-C. `None`
    /// if there is no deadline.
    ///
    /// # Errors
    /// [`Error::Silent`] if no time is left; [`Error::Interrupted`].
    fn time_left(&mut self, until: Option<Instant>, waited: &str) -> Result<Option<Duration>> {
        let Some(until) = until else { return Ok(None) };
        let now = Instant::now();
        let remaining = until.saturating_duration_since(now);
        if remaining.is_zero() {
            return Err(self.silent(waited));
        }
        // The first moment is kept: the grace period counts from there.
        self.interrupted = interrupt::is_requested().then(|| self.interrupted.unwrap_or(now));
        if self.interrupted.is_some_and(|since| now - since >= GRACE) {
            return Err(Error::Interrupted {
                peer: self.peer.clone(),
                waited: waited.to_owned(),
            });
        }
        Ok(Some(remaining.min(GLANCE)))
    }

    fn silent(&self, waited: &str) -> Error {
        Error::Silent {
            peer: self.peer.clone(),
            waited: waited.to_owned(),
            limit: self.timeout.unwrap_or_default(),
        }
    }

    fn failed(&self, e: &std::io::Error, what: &str) -> Error {
        // All of these mean that the other side is gone, whatever the system calls it.
        match e.kind() {
            ErrorKind::BrokenPipe
            | ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::UnexpectedEof => Error::Closed {
                peer: self.peer.clone(),
                expected: what.to_owned(),
            },
            _ => Error::System {
                what: format!("the link to {} ({what})", self.peer),
                reason: e.to_string(),
            },
        }
    }

    /// Sends the message in [`Self::out`].
    pub(crate) fn send(&mut self) -> Result<()> {
        let (kind, length) = (self.out.kind(), self.out.length());
        if length > self.peer_limit {
            return Err(Error::Length {
                peer: "this side".into(),
                kind,
                found: length,
                rule: format!("and {} takes {}", self.peer, self.peer_limit),
            });
        }
        let until = self.until();
        // Taken out, since writing borrows the channel; it comes back with its buffer.
        let mut message = std::mem::take(&mut self.out);
        let outcome = self.write(message.finish(), until, kind);
        self.out = message;
        outcome
    }

    fn write(&mut self, mut bytes: &[u8], until: Option<Instant>, kind: Kind) -> Result<()> {
        let what = || format!("the reading of {kind}");
        while !bytes.is_empty() {
            if let Some(remaining) = self.time_left(until, &what())? {
                let set = self.stream.write_within(remaining);
                set.map_err(|e| self.failed(&e, &what()))?;
            }
            match self.stream.write(bytes) {
                Ok(0) => return Err(self.failed(&ErrorKind::BrokenPipe.into(), &what())),
                Ok(n) => bytes = &bytes[n..],
                Err(e) if passing(&e) => {}
                Err(e) => return Err(self.failed(&e, &what())),
            }
        }
        Ok(())
    }

    /// Reads until `buffer[..to]` is full.
    fn fill(&mut self, end: usize, until: Option<Instant>, what: &str) -> Result<()> {
        let mut filled = 0;
        while filled < end {
            let room = end.min(filled + PIECE);
            if self.buffer.len() < room {
                self.buffer.resize(room, 0);
            }
            if let Some(remaining) = self.time_left(until, what)? {
                let set = self.stream.read_within(remaining);
                set.map_err(|e| self.failed(&e, what))?;
            }
            match self.stream.read(&mut self.buffer[filled..room]) {
                Ok(0) => return Err(self.failed(&ErrorKind::UnexpectedEof.into(), what)),
                Ok(n) => filled += n,
                Err(e) if passing(&e) => {}
                Err(e) => return Err(self.failed(&e, what)),
            }
        }
        Ok(())
    }

    /// Receives a message of one of the kinds `due`; error messages name the first of them. `lengths` are the
    /// lengths \[bytes\] that it may have. [`Kind::Failed`] is returned as the error it reports, and
    /// [`Kind::Working`] restarts the wait. [`Self::content`] reads the message.
    pub(crate) fn receive(&mut self, due: &[Kind], lengths: std::ops::RangeInclusive<u64>) -> Result<Header> {
        let expected = due.first().map_or(String::new(), Kind::to_string);
        loop {
            // Each wait begins anew: `Working` may come any number of times.
            let until = self.until();
            self.fill(HEADER, until, &expected)?;
            let mut bytes = [0; HEADER];
            bytes.copy_from_slice(&self.buffer[..HEADER]);
            let header = Header::read(&bytes, &self.peer)?;
            let is_due = due.contains(&header.kind);
            let lengths = match header.kind {
                Kind::Working => 0..=0,
                // A text: its length in four bytes, and at most `SMALL` bytes.
                Kind::Failed => 4..=SMALL + 4,
                // Both limits: that of this side and that of this kind.
                _ if is_due => *lengths.start()..=self.limit.min(*lengths.end()),
                found => {
                    return Err(Error::Unexpected {
                        peer: self.peer.clone(),
                        found: found.to_string(),
                        expected,
                    });
                }
            };
            // Before anything of the content is read, let alone stored.
            if !lengths.contains(&header.length) {
                let rule = match (lengths.start(), lengths.end()) {
                    (a, b) if a == b => format!("and {a} are due"),
                    (_, b) if header.length > *b => format!("and {b} is the limit"),
                    (a, _) => format!("and {a} are due at least"),
                };
                return Err(Error::Length {
                    peer: self.peer.clone(),
                    kind: header.kind,
                    found: header.length,
                    rule,
                });
            }
            self.fill(header.length as usize, until, &header.kind.to_string())?;
            match header.kind {
                Kind::Working => {}
                Kind::Failed if !is_due => return Err(read_failure(self.content(header), &self.peer)?),
                _ => return Ok(header),
            }
        }
    }

    /// Returns the content of the message received last.
    pub(crate) fn content(&self, header: Header) -> Content<'_> {
        Content::new(&self.peer, header.kind, &self.buffer[..header.length as usize])
    }
}

/// Returns whether to try again. A read that timed out is tried again; [`Channel::time_left`] then ends the
/// wait.
fn passing(e: &std::io::Error) -> bool {
    matches!(
        e.kind(),
        ErrorKind::Interrupted | ErrorKind::WouldBlock | ErrorKind::TimedOut
    )
}

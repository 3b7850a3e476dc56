//! Bytes of the protocol: headers, numbers and texts, little-endian. docs/link.md describes the meaning of
//! every byte.

use crate::error::{Error, Result};

/// Version of the protocol. Both sides must have the same version.
pub const VERSION: u16 = 1;
/// First bytes of every message.
pub const MAGIC: [u8; 4] = *b"ARLQ";
/// Length of a header \[bytes\]: magic, version, kind, length of the content.
pub const HEADER: usize = 16;
/// Longest message accepted by default \[bytes\].
pub const LIMIT: u64 = 1 << 30;
/// Longest message of fixed size or text \[bytes\]: any message but those with numbers per node.
pub(crate) const SMALL: u64 = 1 << 16;
/// Longest name \[bytes\].
pub(crate) const NAME: usize = 1024;

/// Kinds of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Kind {
    /// The run greets, and names the longest message it accepts.
    Hello = 1,
    /// The run requests the inertia under its weights.
    Weigh = 2,
    /// The run answers [`Self::Ask`].
    Shares = 3,
    /// The run requests a step.
    Advance = 4,
    /// The run sends an impulse for every unknown.
    Impulse = 5,
    /// The run requests the state.
    Tell = 6,
    /// The run requests the solver's memory, for a checkpoint.
    Save = 7,
    /// The run sends a saved memory to go back to.
    Restore = 8,
    /// The run has ended.
    End = 9,
    /// Description of the solver: name, nodes, shape functions, inertia, critical step.
    Description = 65,
    /// The solver requests weights at points, or their means over cells.
    Ask = 66,
    /// Critical step, and inertia of every unknown, under the weights.
    Inertia = 67,
    /// Velocities, displacements, accelerations, invariant, as requested.
    State = 68,
    /// The solver's memory.
    Record = 69,
    /// Confirmation without content.
    Done = 70,
    /// The solver needs more time: the time limit starts again.
    Working = 71,
    /// The request has failed; the reason in words.
    Failed = 72,
}

impl Kind {
    /// All kinds with their names.
    const NAMES: [(Self, &'static str); 17] = [
        (Self::Hello, "hello"),
        (Self::Weigh, "weigh"),
        (Self::Shares, "shares"),
        (Self::Advance, "advance"),
        (Self::Impulse, "impulse"),
        (Self::Tell, "tell"),
        (Self::Save, "save"),
        (Self::Restore, "restore"),
        (Self::End, "end"),
        (Self::Description, "description"),
        (Self::Ask, "ask"),
        (Self::Inertia, "inertia"),
        (Self::State, "state"),
        (Self::Record, "record"),
        (Self::Done, "done"),
        (Self::Working, "working"),
        (Self::Failed, "failed"),
    ];

    /// Returns the kind with a number.
    pub fn of(number: u16) -> Option<Self> {
        Self::NAMES.iter().map(|k| k.0).find(|k| *k as u16 == number)
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = Self::NAMES.iter().find(|k| k.0 == *self).map_or("?", |k| k.1);
        write!(f, "'{name}'")
    }
}

/// Header of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Kind of the message.
    pub kind: Kind,
    /// Length of the content \[bytes\].
    pub length: u64,
}

impl Header {
    /// Returns the bytes of the header.
    pub fn bytes(&self) -> [u8; HEADER] {
        let mut out = [0; HEADER];
        out[..4].copy_from_slice(&MAGIC);
        out[4..6].copy_from_slice(&VERSION.to_le_bytes());
        out[6..8].copy_from_slice(&(self.kind as u16).to_le_bytes());
        out[8..].copy_from_slice(&self.length.to_le_bytes());
        out
    }

    /// Reads a header sent by `peer`.
    ///
    /// # Errors
    /// [`Error::Stranger`], [`Error::Version`]; [`Error::Unexpected`] for an unknown kind.
    pub fn read(bytes: &[u8; HEADER], peer: &str) -> Result<Self> {
        let [a, b, c, d, v, w, k, l, length @ ..] = *bytes;
        let (peer, found) = (peer.to_owned(), [a, b, c, d]);
        // Before the version: bytes of another protocol have none.
        if found != MAGIC {
            return Err(Error::Stranger { peer, found });
        }
        let version = u16::from_le_bytes([v, w]);
        if version != VERSION {
            let (found, own) = (version, VERSION);
            return Err(Error::Version { peer, found, own });
        }
        let number = u16::from_le_bytes([k, l]);
        let length = u64::from_le_bytes(length);
        match Kind::of(number) {
            Some(kind) => Ok(Self { kind, length }),
            None => Err(Error::Unexpected {
                peer,
                found: format!("a message of the unknown kind {number}"),
                expected: "one of version 1".into(),
            }),
        }
    }
}

/// A message being written: header and content in one buffer, which is reused for the next message.
#[derive(Debug)]
pub struct Message {
    kind: Kind,
    bytes: Vec<u8>,
}

impl Default for Message {
    fn default() -> Self {
        let kind = Kind::Done;
        let bytes = Vec::new();
        Self { kind, bytes }
    }
}

impl Message {
    /// Begins a message.
    pub fn begin(&mut self, kind: Kind) -> &mut Self {
        self.kind = kind;
        self.bytes.clear();
        self.bytes.resize(HEADER, 0);
        self
    }

    /// Appends bytes unchanged.
    pub fn raw(&mut self, bytes: &[u8]) -> &mut Self {
        self.bytes.extend_from_slice(bytes);
        self
    }

    /// Appends a 32-bit integer.
    pub fn u32(&mut self, x: u32) -> &mut Self {
        self.raw(&x.to_le_bytes())
    }

    /// Appends a 64-bit integer.
    pub fn u64(&mut self, x: u64) -> &mut Self {
        self.raw(&x.to_le_bytes())
    }

    /// Appends a number.
    pub fn f64(&mut self, x: f64) -> &mut Self {
        self.raw(&x.to_le_bytes())
    }

    /// Appends numbers, without their count.
    pub fn numbers(&mut self, x: &[f64]) -> &mut Self {
        let start = self.bytes.len();
        self.bytes.resize(start + 8 * x.len(), 0);
        // Room is made once, and numbers are written in place: most messages are arrays.
        let (slots, _) = self.bytes[start..].as_chunks_mut::<8>();
        slots.iter_mut().zip(x).for_each(|(b, x)| *b = x.to_le_bytes());
        self
    }

    /// Appends a text: its length in bytes, then its bytes in UTF-8. A text longer than `limit` bytes is cut.
    pub fn text(&mut self, text: &str, limit: usize) -> &mut Self {
        let mut end = text.len().min(limit);
        // Cut between characters: the other side refuses what is not UTF-8.
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        self.u32(end as u32).raw(&text.as_bytes()[..end])
    }

    /// Returns the length of the content \[bytes\].
    pub fn length(&self) -> u64 {
        (self.bytes.len() - HEADER) as u64
    }

    /// Returns the kind of the message.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Completes the header and returns the whole message.
    pub fn finish(&mut self) -> &[u8] {
        let header = Header {
            kind: self.kind,
            length: self.length(),
        };
        self.bytes[..HEADER].copy_from_slice(&header.bytes());
        &self.bytes
    }
}

/// Content of a received message, read from front to end.
#[derive(Debug)]
pub struct Content<'a> {
    peer: &'a str,
    kind: Kind,
    length: u64,
    unread: &'a [u8],
}

impl<'a> Content<'a> {
    /// Wraps the bytes that followed a header.
    pub fn new(peer: &'a str, kind: Kind, bytes: &'a [u8]) -> Self {
        Self {
            peer,
            kind,
            length: bytes.len() as u64,
            unread: bytes,
        }
    }

    /// Creates the error that something in this message breaks a rule.
    pub fn wrong(&self, rule: impl Into<String>) -> Error {
        Error::Content {
            peer: self.peer.to_owned(),
            kind: self.kind,
            rule: rule.into(),
        }
    }

    fn length(&self, rule: String) -> Error {
        Error::Length {
            peer: self.peer.to_owned(),
            kind: self.kind,
            found: self.length,
            rule,
        }
    }

    /// Reads the next bytes.
    ///
    /// # Errors
    /// [`Error::Length`] if there are fewer bytes.
    pub fn raw(&mut self, count: usize) -> Result<&'a [u8]> {
        let Some((head, unread)) = self.unread.split_at_checked(count) else {
            let rule = format!("{count} more were due behind the first {}", self.read());
            return Err(self.length(rule));
        };
        self.unread = unread;
        Ok(head)
    }

    fn read(&self) -> u64 {
        self.length - self.unread.len() as u64
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.raw(N)?);
        Ok(out)
    }

    /// Reads the next byte.
    ///
    /// # Errors
    /// [`Error::Length`] at the end.
    pub fn u8(&mut self) -> Result<u8> {
        self.array::<1>().map(|[b]| b)
    }

    /// Reads the next 32-bit integer.
    ///
    /// # Errors
    /// [`Error::Length`] at the end.
    pub fn u32(&mut self) -> Result<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// Reads the next 64-bit integer.
    ///
    /// # Errors
    /// [`Error::Length`] at the end.
    pub fn u64(&mut self) -> Result<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Reads the next number.
    ///
    /// # Errors
    /// [`Error::Length`] at the end.
    pub fn f64(&mut self) -> Result<f64> {
        self.array().map(f64::from_le_bytes)
    }

    /// Reads the next number, which must be finite.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Content`] naming `what`.
    pub fn finite(&mut self, what: &str) -> Result<f64> {
        let x = self.f64()?;
        if x.is_finite() {
            return Ok(x);
        }
        Err(self.wrong(format!("{what} is {x}, not a finite number")))
    }

    /// Reads a count of items of `size` bytes each. The rest of the message must have room for them, so that
    /// the count may be used to allocate memory.
    ///
    /// # Errors
    /// [`Error::Content`] naming `what`.
    pub fn count(&mut self, what: &str, size: usize) -> Result<usize> {
        let count = self.u64()?;
        // The bytes that are there bound what may be allocated.
        let room = self.unread.len() / size.max(1);
        match usize::try_from(count) {
            Ok(count) if count <= room => Ok(count),
            _ => Err(self.wrong(format!("{count} {what} are announced, with room for {room}"))),
        }
    }

    /// Fills `out` with the next numbers, which must be finite.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Content`] naming `what` and the first number that is not finite.
    pub fn numbers(&mut self, what: &str, out: &mut [f64]) -> Result<()> {
        let bytes = self.raw(8 * out.len())?;
        let (chunks, _) = bytes.as_chunks::<8>();
        // Tested once after the loop: the search for the entry costs time only if there is an error.
        let mut finite = true;
        for (x, b) in out.iter_mut().zip(chunks) {
            *x = f64::from_le_bytes(*b);
            finite &= x.is_finite();
        }
        if finite {
            return Ok(());
        }
        let entry = out.iter().position(|x| !x.is_finite()).unwrap_or_default();
        Err(self.wrong(format!(
            "{what}: entry {entry} is {}, not a finite number",
            out[entry]
        )))
    }

    /// Reads the next `count` numbers, which must be finite. The length of the message is checked before
    /// memory is allocated.
    ///
    /// # Errors
    /// The errors of [`Self::numbers`].
    pub fn vector(&mut self, what: &str, count: usize) -> Result<Vec<f64>> {
        if count > self.unread.len() / 8 {
            let rule = format!(
                "{count} numbers ({what}) were due behind the first {}",
                self.read()
            );
            return Err(self.length(rule));
        }
        let mut out = vec![0.0; count];
        self.numbers(what, &mut out)?;
        Ok(out)
    }

    /// Reads the next `count` 32-bit integers.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn integers(&mut self, count: usize) -> Result<Vec<u32>> {
        // The product of a wrong count must not wrap round to a small one.
        let bytes = self.raw(count.saturating_mul(4))?;
        let (chunks, _) = bytes.as_chunks::<4>();
        Ok(chunks.iter().map(|b| u32::from_le_bytes(*b)).collect())
    }

    /// Reads the next `count` 64-bit integers.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn long_integers(&mut self, count: usize) -> Result<Vec<u64>> {
        let bytes = self.raw(count.saturating_mul(8))?;
        let (chunks, _) = bytes.as_chunks::<8>();
        Ok(chunks.iter().map(|b| u64::from_le_bytes(*b)).collect())
    }

    /// Reads the next text. Control characters become blanks.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Content`] for a text that is too long or not UTF-8.
    pub fn text(&mut self, what: &str, limit: usize) -> Result<String> {
        let count = self.u32()? as usize;
        if count > limit {
            return Err(self.wrong(format!("{what} has {count} bytes, more than {limit}")));
        }
        match std::str::from_utf8(self.raw(count)?) {
            // No message from outside may move the cursor of a terminal.
            Ok(text) => Ok(text
                .chars()
                .map(|c| if c.is_control() { ' ' } else { c })
                .collect()),
            Err(_) => Err(self.wrong(format!("{what} is not UTF-8"))),
        }
    }

    /// Checks that the whole message was read.
    ///
    /// # Errors
    /// [`Error::Length`] if bytes are left.
    pub fn end(self) -> Result<()> {
        if self.unread.is_empty() {
            return Ok(());
        }
        let rule = format!("{} were due", self.read());
        Err(self.length(rule))
    }
}

//! Errors of scenes: each names a key of the scene, its value, the limit and a remedy.

use std::path::{Path, PathBuf};

/// Errors between reading a scene and its results.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("cannot read '{}': {source}; check the path", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file that should be text is not.
    #[error(
        "'{}' line {line}: byte 0x{byte:02X} is no UTF-8 text; save the file as UTF-8 (Latin-1 has such bytes), or name a text file",
        path.display()
    )]
    NotText {
        /// Path of the file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// First byte that is no text.
        byte: u8,
    },
    /// A file or folder cannot be written.
    #[error("cannot write '{}': {source}; check permissions and space, or choose another --out", path.display())]
    Write {
        /// Path of the file or folder.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The text is not valid TOML, or is no scene.
    #[error("{message}")]
    Syntax {
        /// Message of the parser.
        message: String,
        /// Bytes of the scene file that the message refers to; `None` if unknown.
        span: Option<std::ops::Range<usize>>,
    },
    /// A change of a value ([`Scene::set`](crate::Scene::set), `--set`) that the scene cannot take.
    #[error("cannot {}: {message}", change(key, value))]
    Set {
        /// Key path as given.
        key: String,
        /// Value as given; empty to remove the key.
        value: String,
        /// Reason and remedy.
        message: String,
    },
    /// A value outside of its limits.
    #[error("{key} = {value}: {rule}")]
    Value {
        /// Path of the key.
        key: String,
        /// Value of the key.
        value: String,
        /// Limit and remedy.
        rule: String,
    },
    /// A missing key, or a key that must not be given.
    #[error("{key}: {rule}")]
    Key {
        /// Path of the key.
        key: String,
        /// Rule that is broken, and remedy.
        rule: String,
    },
    /// A name that the scene does not define.
    #[error("{key} = '{name}': there is no {what} of this name; known: {known}")]
    UnknownName {
        /// Path of the key.
        key: String,
        /// The name.
        name: String,
        /// Kind of the thing that is named, such as "model".
        what: &'static str,
        /// Known names, and a guess of the intended one.
        known: String,
    },
    /// Error of the core.
    #[error("{key}: {source}")]
    Core {
        /// Path of the key that causes the error.
        key: String,
        /// Error of the core.
        source: arlequin::core::Error,
    },
    /// Error of the finite elements.
    #[error("{key}: {source}")]
    Fem {
        /// Path of the key that causes the error.
        key: String,
        /// Error of the finite elements.
        source: arlequin::fem_ref::Error,
    },
    /// Error of the particles.
    #[error("{key}: {source}")]
    Dem {
        /// Path of the key that causes the error.
        key: String,
        /// Error of the particles.
        source: arlequin::dem_beam::Error,
    },
    /// Error of the natural elements.
    #[error("{key}: {source}")]
    Cnem {
        /// Path of the key that causes the error.
        key: String,
        /// Error of the natural elements.
        source: arlequin::cnem::Error,
    },
    /// The output folder exists already.
    #[error("output folder '{}' exists; choose another with --out, or replace it with --force", path.display())]
    Exists {
        /// Output folder.
        path: PathBuf,
    },
    /// The folder holds an unfinished run that can be resumed.
    #[error("'{}' holds an unfinished run; go on with 'arlequin resume {}', or start anew with --force", unfinished.display(), target.display())]
    Unfinished {
        /// Folder of the unfinished run.
        unfinished: PathBuf,
        /// Output folder that the run creates when it ends.
        target: PathBuf,
    },
    /// Another run writes into the same folder.
    #[error("another run is writing to '{}'; wait until it has ended, or choose another --out", folder.display())]
    Busy {
        /// Output folder.
        folder: PathBuf,
    },
    /// A run failed after its first step; its results so far are kept.
    #[error("{source}; {what} in '{}'", place.display())]
    Kept {
        /// Error that ended the run.
        source: Box<Self>,
        /// Kept results, worded as the beginning of a sentence.
        what: String,
        /// Folder of the kept results.
        place: PathBuf,
    },
    /// A checkpoint cannot be used.
    #[error("'{}' {reason}", path.display())]
    Checkpoint {
        /// Path of the checkpoint.
        path: PathBuf,
        /// Reason and remedy.
        reason: String,
    },
    /// A result is not a finite number.
    #[error("{what} is not a finite number at t = {time:e} s; reduce the step or check loads and supports")]
    NotFinite {
        /// Name of the result.
        what: String,
        /// Time \[s\].
        time: f64,
    },
    /// Error of the system, such as threads or the signal handler.
    #[error("{what}: {message}")]
    System {
        /// Attempted action.
        what: &'static str,
        /// Message of the system.
        message: String,
    },
    /// An error of this rank that was announced to all ranks, so that every rank stops.
    #[error("{0}")]
    Agreed(Box<Self>),
    /// Another rank has an error and reports it.
    #[error("rank {rank} has an error, which it says")]
    Elsewhere {
        /// Number of the failed rank.
        rank: usize,
        /// True if the input is to blame.
        input: bool,
    },
    /// An observer, or the display of results, failed.
    #[error("{0}")]
    Observer(Box<dyn std::error::Error + Send + Sync>),
}

/// Number of signs up to which a number is written without an exponent.
const PLAIN: usize = 8;

/// Result with an [`Error`] of this crate.
pub type Result<V, E = Error> = std::result::Result<V, E>;

/// Matches all errors that name a key of the scene.
macro_rules! keyed {
    ($key:ident) => {
        Self::Set { $key, .. }
            | Self::Value { $key, .. }
            | Self::Key { $key, .. }
            | Self::UnknownName { $key, .. }
            | Self::Core { $key, .. }
            | Self::Fem { $key, .. }
            | Self::Dem { $key, .. }
            | Self::Cnem { $key, .. }
    };
}

impl Error {
    /// Returns the key path that the error names, and the bytes of the scene file if the parser knows them.
    pub fn place(&self) -> (Option<&str>, Option<std::ops::Range<usize>>) {
        match self {
            Self::Syntax { span, .. } => (None, span.clone()),
            keyed!(key) => (Some(key), None),
            Self::Kept { source, .. } | Self::Agreed(source) => source.place(),
            _ => (None, None),
        }
    }

    /// Replaces the key of the error by `replacement(key)`, if that is `Some`.
    #[must_use]
    pub(crate) fn at_key(mut self, replacement: impl FnOnce(&str) -> Option<String>) -> Self {
        if let keyed!(key) = &mut self
            && let Some(new) = replacement(key)
        {
            *key = new;
        }
        self
    }

    /// Wraps the error with a note on what is kept at `place`.
    #[must_use]
    pub fn kept(self, what: impl Into<String>, place: &Path) -> Self {
        Self::Kept {
            source: Box::new(self),
            what: what.into(),
            place: place.to_owned(),
        }
    }

    /// Returns whether the communication between ranks has failed.
    pub fn is_of_ranks(&self) -> bool {
        let source = |e: &arlequin::core::Error| matches!(e, arlequin::core::Error::Rank(_));
        match self {
            Self::Core { source: e, .. } => source(e),
            Self::Kept { source, .. } => source.is_of_ranks(),
            _ => false,
        }
    }

    /// Returns whether every rank of a run has or knows of this error: errors of global sums, and errors that
    /// ranks announced to each other.
    pub fn is_everywhere(&self) -> bool {
        use arlequin::core::Error as Core;
        use arlequin::core::ranks::RankError;
        match self {
            Self::Core { source, .. } => matches!(
                source,
                Core::Diverged { .. }
                    | Core::EnergyGrowth { .. }
                    | Core::EnergyLoss { .. }
                    | Core::MultipliersUnsolved { .. }
                    | Core::Rank(RankError::Differ { .. })
            ),
            Self::Kept { source, .. } => source.is_everywhere(),
            // Every rank evaluates probes and frames, so every rank sees the same NaN.
            Self::Agreed(_) | Self::Elsewhere { .. } | Self::NotFinite { .. } => true,
            _ => false,
        }
    }

    /// Returns whether the input is to blame (exit code 2) and not the run (exit code 1).
    pub fn is_input(&self) -> bool {
        use arlequin::core::Error as Core;
        use arlequin::core::ranks::RankError;
        match self {
            Self::Agreed(source) => return source.is_input(),
            Self::Elsewhere { input, .. } => return *input,
            _ => {}
        }
        // Ranks were started with different input.
        if let Self::Core { source, .. } = self
            && matches!(source, Core::Rank(RankError::Differ { .. }))
        {
            return true;
        }
        let run = matches!(
            self,
            Self::Write { .. }
                | Self::NotFinite { .. }
                | Self::System { .. }
                | Self::Observer(_)
                | Self::Kept { .. }
                | Self::Core {
                    source: Core::Diverged { .. }
                        | Core::EnergyGrowth { .. }
                        | Core::EnergyLoss { .. }
                        | Core::MultipliersUnsolved { .. }
                        | Core::ImpulseMissed { .. }
                        | Core::NotSettled { .. }
                        | Core::Rank(_),
                    ..
                }
        );
        !run
    }
}

/// Shorthand for [`Error::Value`].
pub fn value(key: impl Into<String>, value: impl std::fmt::Display, rule: &str) -> Error {
    Error::Value {
        key: key.into(),
        value: short(value.to_string()),
        rule: rule.to_owned(),
    }
}

/// Words for a change of a value that failed.
fn change(key: &str, value: &str) -> String {
    match value {
        "" => format!("remove {key}"),
        _ => format!("set {key} = {value}"),
    }
}

/// Writes a number with an exponent if that is shorter: 1e300 has 301 digits otherwise.
fn short(text: String) -> String {
    match text.parse::<f64>().map(|x| format!("{x:e}")) {
        Ok(exponential) if exponential.len() < text.len() && text.len() > PLAIN => exponential,
        _ => text,
    }
}

/// Shorthand for [`Error::Key`].
pub fn key(key: impl Into<String>, rule: impl Into<String>) -> Error {
    Error::Key {
        key: key.into(),
        rule: rule.into(),
    }
}

/// Shorthand for [`Error::UnknownName`].
pub fn unknown<'a>(
    key: impl Into<String>,
    name: &str,
    what: &'static str,
    names: impl Iterator<Item = &'a String>,
) -> Error {
    let names: Vec<&str> = names.map(String::as_str).collect();
    Error::UnknownName {
        key: key.into(),
        name: name.to_owned(),
        what,
        known: if names.is_empty() {
            "none".into()
        } else {
            names.join(", ") + &meant(name, names.iter().copied())
        },
    }
}

/// Returns `"; did you mean 'x'?"` with the known word nearest to `word`; empty if none is near.
pub fn meant<'a>(word: &str, words: impl Iterator<Item = &'a str>) -> String {
    // A swap of two letters counts once; about a third of the letters may be wrong.
    let far = 1 + word.chars().count() / 3;
    let near = words.map(|k| (strsim::osa_distance(word, k), k));
    match near.min_by_key(|n| n.0) {
        Some((d, k)) if d > 0 && d <= far.min(k.len().saturating_sub(1)) => format!("; did you mean '{k}'?"),
        _ => String::new(),
    }
}

/// Adds the key to an error of the core.
pub fn core(key: impl Into<String>) -> impl FnOnce(arlequin::core::Error) -> Error {
    let key = key.into();
    move |source| Error::Core { key, source }
}

/// Adds the key to an error of the finite elements.
pub fn fem(key: impl Into<String>) -> impl FnOnce(arlequin::fem_ref::Error) -> Error {
    let key = key.into();
    move |source| Error::Fem { key, source }
}

/// Adds the key to an error of the particles.
pub fn dem(key: impl Into<String>) -> impl FnOnce(arlequin::dem_beam::Error) -> Error {
    let key = key.into();
    move |source| match source {
        arlequin::dem_beam::Error::Core(source) => Error::Core { key, source },
        source => Error::Dem { key, source },
    }
}

/// Adds the key to an error of the natural elements.
pub fn cnem(key: impl Into<String>) -> impl FnOnce(arlequin::cnem::Error) -> Error {
    let key = key.into();
    move |source| match source {
        arlequin::cnem::Error::Core(source) => Error::Core { key, source },
        source => Error::Cnem { key, source },
    }
}

/// Adds the path to an error of writing.
pub fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Error + '_ {
    move |source| Error::Write {
        path: path.to_owned(),
        source,
    }
}

//! Errors of scenes: each names a key of the scene, its value, the limit and a way out.

use std::path::{Path, PathBuf};

/// What can go wrong between a scene and its results.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read.
    #[error("cannot read '{}': {source}; check the path", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("cannot write '{}': {source}; check permissions and space, or choose another --out", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The text is not TOML, or not a scene.
    #[error("{message}")]
    Syntax {
        /// The parser's words.
        message: String,
        /// Bytes of the scene file it speaks of; none if it is not known.
        span: Option<std::ops::Range<usize>>,
    },
    /// A change that does not fit the scene.
    #[error("cannot set {key} = {value}: {message}")]
    Set {
        /// Path as given.
        key: String,
        /// Value as given.
        value: String,
        /// What is wrong, and the way out.
        message: String,
    },
    /// A value that makes no sense.
    #[error("{key} = {value}: {rule}")]
    Value {
        /// Path of the key.
        key: String,
        /// Its value.
        value: String,
        /// Limit and remedy.
        rule: String,
    },
    /// A key that is needed and not there, or there and not wanted.
    #[error("{key}: {rule}")]
    Key {
        /// Path of the key.
        key: String,
        /// What is needed.
        rule: String,
    },
    /// A name that nothing bears.
    #[error("{key} = '{name}': there is no {what} of this name; known: {known}")]
    UnknownName {
        /// Path of the key.
        key: String,
        /// The name.
        name: String,
        /// What should bear it.
        what: &'static str,
        /// What there is, and what was probably meant.
        known: String,
    },
    /// The core refuses.
    #[error("{key}: {source}")]
    Core {
        /// Path of the key it comes from.
        key: String,
        /// Its error.
        source: arlequin::core::Error,
    },
    /// The finite elements refuse.
    #[error("{key}: {source}")]
    Fem {
        /// Path of the key it comes from.
        key: String,
        /// Their error.
        source: arlequin::fem_ref::Error,
    },
    /// The particles refuse.
    #[error("{key}: {source}")]
    Dem {
        /// Path of the key it comes from.
        key: String,
        /// Their error.
        source: arlequin::dem_beam::Error,
    },
    /// The natural elements refuse.
    #[error("{key}: {source}")]
    Cnem {
        /// Path of the key it comes from.
        key: String,
        /// Their error.
        source: arlequin::cnem::Error,
    },
    /// Results would be overwritten.
    #[error("output folder '{}' exists; choose another with --out, or replace it with --force", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// A run was killed here and can go on.
    #[error("'{}' holds an unfinished run; go on with 'arlequin resume {}', or start anew with --force", unfinished.display(), target.display())]
    Unfinished {
        /// The unfinished folder.
        unfinished: PathBuf,
        /// What it will become.
        target: PathBuf,
    },
    /// Another run writes to the same place.
    #[error("another run is writing to '{}'; wait until it has ended, or choose another --out", folder.display())]
    Busy {
        /// Its folder.
        folder: PathBuf,
    },
    /// A run failed after its first step, and what it had is kept.
    #[error("{source}; {what} in '{}'", place.display())]
    Kept {
        /// What ended it.
        source: Box<Self>,
        /// What is kept, as the beginning of a sentence.
        what: String,
        /// Where.
        place: PathBuf,
    },
    /// A checkpoint cannot be used.
    #[error("'{}' {reason}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Why, and the way out.
        reason: String,
    },
    /// A result is not a finite number.
    #[error("{what} is not a finite number at t = {time:e} s; reduce the step or check loads and supports")]
    NotFinite {
        /// Which result.
        what: String,
        /// Time \[s\].
        time: f64,
    },
    /// Anything of the system: threads, signal handler.
    #[error("{what}: {message}")]
    System {
        /// What was tried.
        what: &'static str,
        /// The system's words.
        message: String,
    },
    /// An error of this rank that all ranks know of, and none goes on.
    #[error("{0}")]
    Agreed(Box<Self>),
    /// Another rank of the run has an error, and says it.
    #[error("rank {rank} has an error, which it says")]
    Elsewhere {
        /// That rank.
        rank: usize,
        /// Whether the input is to blame.
        input: bool,
    },
    /// What watches a run, or shows its results, failed at its own work.
    #[error("{0}")]
    Observer(Box<dyn std::error::Error + Send + Sync>),
}

/// Result of what scenes do.
pub type Result<V, E = Error> = std::result::Result<V, E>;

/// Errors that speak of a key of the scene.
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
    /// Path of the key the error speaks of, and bytes of the scene file where the parser knows them.
    pub fn place(&self) -> (Option<&str>, Option<std::ops::Range<usize>>) {
        match self {
            Self::Syntax { span, .. } => (None, span.clone()),
            keyed!(key) => (Some(key), None),
            Self::Kept { source, .. } | Self::Agreed(source) => source.place(),
            _ => (None, None),
        }
    }

    /// The same of the key that `other` gives for its own, if any.
    #[must_use]
    pub(crate) fn at_key(mut self, other: impl FnOnce(&str) -> Option<String>) -> Self {
        if let keyed!(key) = &mut self
            && let Some(new) = other(key)
        {
            *key = new;
        }
        self
    }

    /// The same, and what is kept where.
    #[must_use]
    pub fn kept(self, what: impl Into<String>, place: &Path) -> Self {
        Self::Kept {
            source: Box::new(self),
            what: what.into(),
            place: place.to_owned(),
        }
    }

    /// Whether ranks do not hear of each other any more.
    pub fn is_of_ranks(&self) -> bool {
        let source = |e: &arlequin::core::Error| matches!(e, arlequin::core::Error::Rank(_));
        match self {
            Self::Core { source: e, .. } => source(e),
            Self::Kept { source, .. } => source.is_of_ranks(),
            _ => false,
        }
    }

    /// Whether every rank of a run knows of the error: that of sums over all of them, or one that they have
    /// told each other.
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
            // Probes and frames are looked at on all ranks.
            Self::Agreed(_) | Self::Elsewhere { .. } | Self::NotFinite { .. } => true,
            _ => false,
        }
    }

    /// Whether the input is to blame (exit code 2) rather than the run (1).
    pub fn is_input(&self) -> bool {
        use arlequin::core::Error as Core;
        use arlequin::core::ranks::RankError;
        match self {
            Self::Agreed(source) => return source.is_input(),
            Self::Elsewhere { input, .. } => return *input,
            _ => {}
        }
        // Ranks with different input.
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
        value: value.to_string(),
        rule: rule.to_owned(),
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
    known: impl Iterator<Item = &'a String>,
) -> Error {
    let known: Vec<&str> = known.map(String::as_str).collect();
    Error::UnknownName {
        key: key.into(),
        name: name.to_owned(),
        what,
        known: if known.is_empty() {
            "none".into()
        } else {
            known.join(", ") + &meant(name, known.iter().copied())
        },
    }
}

/// `"; did you mean 'x'?"` with the known word that is nearest to the one given, or nothing if none is near.
pub fn meant<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> String {
    // A swap counts once; a third of the letters may be wrong.
    let far = 1 + word.chars().count() / 3;
    let near = known.map(|k| (strsim::osa_distance(word, k), k));
    match near.min_by_key(|n| n.0) {
        Some((d, k)) if d > 0 && d <= far.min(k.len().saturating_sub(1)) => format!("; did you mean '{k}'?"),
        _ => String::new(),
    }
}

/// Puts the key in front of an error of the core.
pub fn core(key: impl Into<String>) -> impl FnOnce(arlequin::core::Error) -> Error {
    let key = key.into();
    move |source| Error::Core { key, source }
}

/// Puts the key in front of an error of the finite elements.
pub fn fem(key: impl Into<String>) -> impl FnOnce(arlequin::fem_ref::Error) -> Error {
    let key = key.into();
    move |source| Error::Fem { key, source }
}

/// Puts the key in front of an error of the particles.
pub fn dem(key: impl Into<String>) -> impl FnOnce(arlequin::dem_beam::Error) -> Error {
    let key = key.into();
    move |source| match source {
        arlequin::dem_beam::Error::Core(source) => Error::Core { key, source },
        source => Error::Dem { key, source },
    }
}

/// Puts the key in front of an error of the natural elements.
pub fn cnem(key: impl Into<String>) -> impl FnOnce(arlequin::cnem::Error) -> Error {
    let key = key.into();
    move |source| match source {
        arlequin::cnem::Error::Core(source) => Error::Core { key, source },
        source => Error::Cnem { key, source },
    }
}

/// Names the file in an input or output error.
pub fn write(path: &Path) -> impl FnOnce(std::io::Error) -> Error + '_ {
    move |source| Error::Write {
        path: path.to_owned(),
        source,
    }
}

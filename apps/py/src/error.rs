//! Converts errors of the crates to exceptions of `arlequin.errors`, whose codes are the names of the
//! errors in Rust.

use arlequin::{cnem, core, dem_beam, fem_ref};
use arlequin_scene::Source;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use std::any::Any;
use std::fmt::Debug;

/// An error before it becomes a Python exception.
#[derive(Debug)]
pub(crate) enum Fault {
    /// An error in Rust.
    Native {
        /// Code of the exception.
        kind: String,
        /// Message.
        message: String,
        /// Key of the scene that the error concerns.
        key: Option<String>,
        /// Line of the scene file, from 1.
        line: Option<usize>,
    },
    /// An exception in Python.
    Python(PyErr),
}

/// An exception of a model written in Python while it passes through the core.
#[derive(Debug)]
pub(crate) struct Raised(PyErr);

impl std::fmt::Display for Raised {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl std::error::Error for Raised {}

/// Wraps the exception of the model `name` in an error of the core.
pub(crate) fn raised(name: &str, e: PyErr) -> core::Error {
    core::Error::of_model(name, Raised(e))
}

/// Returns the name of an error's variant: the first word of its derived `Debug` text.
fn variant(e: &impl Debug) -> String {
    let text = format!("{e:?}");
    let end = text.find(|c: char| !c.is_alphanumeric()).unwrap_or(text.len());
    text[..end].to_owned()
}

impl Fault {
    /// Returns an error with the code `kind`.
    pub(crate) fn new(kind: &str, message: impl Into<String>) -> Self {
        Self::Native {
            kind: kind.to_owned(),
            message: message.into(),
            key: None,
            line: None,
        }
    }

    fn named(e: &(impl Debug + std::fmt::Display)) -> Self {
        Self::new(&variant(e), e.to_string())
    }

    /// Returns the error for a panic.
    pub(crate) fn panic(payload: &(dyn Any + Send)) -> Self {
        // The payload of a panic is a literal or a formatted text.
        let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        let text = text.unwrap_or_else(|| "without a word".into());
        Self::new(
            "InternalError",
            format!("a mistake in arlequin itself: {text}; please report it with what led to it"),
        )
    }

    /// Returns an error of a scene with the line of the scene file.
    pub(crate) fn of_scene(e: arlequin_scene::Error, source: &Source) -> Self {
        let (key, span) = e.place();
        // An error found after reading names a key; the source knows its line.
        let span = span.or_else(|| source.span_of(key?));
        let place = span.map(|s| {
            1 + source.text[..s.start.min(source.text.len())]
                .matches('\n')
                .count()
        });
        let (path, key) = (source.path.display().to_string(), key.map(str::to_owned));
        match Self::from(e) {
            Self::Native { kind, message, .. } => Self::Native {
                message: place.map_or_else(|| message.clone(), |n| format!("{path}:{n}: {message}")),
                kind,
                key,
                line: place,
            },
            python => python,
        }
    }
}

impl From<PyErr> for Fault {
    fn from(e: PyErr) -> Self {
        Self::Python(e)
    }
}

impl From<core::Error> for Fault {
    fn from(e: core::Error) -> Self {
        if let core::Error::Model { source, .. } = &e {
            // The exception of a user's model comes back as it was raised.
            if let Some(Raised(raised)) = source.downcast_ref() {
                return Self::Python(Python::attach(|py| raised.clone_ref(py)));
            }
            // Errors of the models keep their own names as codes.
            if let Some(inner) = source.downcast_ref::<dem_beam::Error>() {
                return Self::new(&variant(inner), e.to_string());
            }
            if let Some(inner) = source.downcast_ref::<cnem::Error>() {
                return Self::new(&variant(inner), e.to_string());
            }
            if let Some(inner) = source.downcast_ref::<arlequin_link::Error>() {
                return Self::new(&variant(inner), e.to_string());
            }
        }
        Self::named(&e)
    }
}

impl From<fem_ref::Error> for Fault {
    fn from(e: fem_ref::Error) -> Self {
        match e {
            fem_ref::Error::Core(e) => e.into(),
            e => Self::named(&e),
        }
    }
}

impl From<dem_beam::Error> for Fault {
    fn from(e: dem_beam::Error) -> Self {
        match e {
            dem_beam::Error::Core(e) => e.into(),
            e => Self::named(&e),
        }
    }
}

impl From<cnem::Error> for Fault {
    fn from(e: cnem::Error) -> Self {
        match e {
            cnem::Error::Core(e) => e.into(),
            e => Self::named(&e),
        }
    }
}

impl From<arlequin_link::Error> for Fault {
    fn from(e: arlequin_link::Error) -> Self {
        Self::named(&e)
    }
}

impl From<arlequin_scene::Error> for Fault {
    fn from(e: arlequin_scene::Error) -> Self {
        use arlequin_scene::Error;
        // The outer message names the key, the inner error gives the code.
        let message = e.to_string();
        let inner = match e {
            Error::Core { source, .. } => source.into(),
            Error::Fem { source, .. } => source.into(),
            Error::Dem { source, .. } => source.into(),
            Error::Cnem { source, .. } => source.into(),
            Error::Kept { source, .. } => Self::from(*source),
            e => Self::named(&e),
        };
        match inner {
            Self::Native { kind, .. } => Self::new(&kind, message),
            python => python,
        }
    }
}

impl From<Fault> for PyErr {
    fn from(e: Fault) -> Self {
        let (kind, message, key, line) = match e {
            Fault::Python(e) => return e,
            Fault::Native {
                kind,
                message,
                key,
                line,
            } => (kind, message, key, line),
        };
        let build = |py: Python<'_>| -> PyResult<Self> {
            let make = py.import("arlequin.errors")?.getattr("_make")?;
            Ok(Self::from_value(make.call1((&kind, &message, key, line))?))
        };
        Python::attach(|py| {
            build(py).unwrap_or_else(|e| {
                // Ctrl-C during a computation may arrive here.
                if e.is_instance_of::<PyKeyboardInterrupt>(py) {
                    return e;
                }
                // A plain error is better than none if the package's Python part fails.
                PyRuntimeError::new_err(message.clone())
            })
        })
    }
}

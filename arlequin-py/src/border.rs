//! What crosses from Python to Rust: without the interpreter's lock, and back without a panic.

use crate::error::Fault;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Time between two looks for Ctrl-C: no one waits that long, and no step is slowed down by it.
const LOOK: Duration = Duration::from_millis(50);

/// Computes without the interpreter's lock; errors and panics become exceptions.
pub(crate) fn outside<V: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<V, Fault> + Send,
) -> PyResult<V> {
    let made = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    made.unwrap_or_else(|payload| Err(Fault::panic(&*payload)))
        .map_err(PyErr::from)
}

/// Looks into the interpreter now and then.
#[derive(Debug)]
pub(crate) struct Pulse(Instant);

impl Pulse {
    /// From now on.
    pub(crate) fn new() -> Self {
        Self(Instant::now())
    }

    /// Whether it is time; Ctrl-C and the like are the error, of `then` as well.
    pub(crate) fn beat(&mut self, then: impl FnOnce(Python<'_>) -> PyResult<()>) -> PyResult<()> {
        if self.0.elapsed() < LOOK {
            return Ok(());
        }
        self.0 = Instant::now();
        Python::attach(|py| {
            py.check_signals()?;
            then(py)
        })
    }
}

/// For tests of the border: the mistake that must not be.
#[pyfunction]
pub(crate) fn _mistake(py: Python<'_>, text: String) -> PyResult<()> {
    outside(py, || std::panic::panic_any(text))
}

//! Border between Python and Rust: releases the interpreter's lock during computations and turns panics
//! into exceptions.

use crate::error::Fault;
use crate::threads::with_threads;
use pyo3::prelude::*;
use pyo3::{PyTraverseError, PyVisit};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two checks for Ctrl-C: short for a user, long enough to slow no step down.
const LOOK: Duration = Duration::from_millis(50);

thread_local! {
    /// Exception that Ctrl-C raised during a computation; [`outside`] raises it in the interpreter.
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
    /// Time of this thread's last check for Ctrl-C.
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Runs `work` without the interpreter's lock. Errors, panics and Ctrl-C become exceptions.
pub(crate) fn outside<V: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<V, Fault> + Send,
) -> PyResult<V> {
    let result = py.detach(|| catch_unwind(AssertUnwindSafe(|| with_threads(work).flatten())));
    // Ctrl-C comes first: an error of the computation is only its consequence.
    if let Some(raised) = raised() {
        return Err(raised);
    }
    result
        .unwrap_or_else(|payload| Err(Fault::panic(&*payload)))
        .map_err(PyErr::from)
}

/// Takes the exception that Ctrl-C raised while this thread computed.
pub(crate) fn raised() -> Option<PyErr> {
    RAISED.take()
}

/// Returns whether Ctrl-C was pressed, or another signal raised an exception. Long loops and waits of the
/// crates call this. The interpreter handles signals only on its main thread; on other threads the answer
/// is false.
pub(crate) fn is_interrupted() -> bool {
    if RAISED.with_borrow(Option::is_some) {
        return true;
    }
    // Each check takes the interpreter's lock, so checks are rare.
    if LOOKED.get().is_some_and(|last| last.elapsed() < LOOK) {
        return false;
    }
    LOOKED.set(Some(Instant::now()));
    // Signal handlers run here and may call this package, so nothing may be borrowed.
    let raised = Python::attach(|py| py.check_signals()).err();
    let stops = raised.is_some();
    if stops {
        RAISED.set(raised);
    }
    stops
}

/// Checks for signals at intervals of [`LOOK`].
#[derive(Debug)]
pub(crate) struct Pulse(Instant);

impl Pulse {
    /// Starts the first interval.
    pub(crate) fn new() -> Self {
        Self(Instant::now())
    }

    /// Checks for signals and calls `then` if the interval has passed. Exceptions of a signal or of `then`
    /// are the error.
    pub(crate) fn beat(&mut self, then: impl FnOnce(Python<'_>) -> PyResult<()>) -> PyResult<()> {
        // The crates may have taken the signal within the step.
        if let Some(raised) = raised() {
            return Err(raised);
        }
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

/// A reference to a Python object. The model in the core shares it with the subdomain or run that shows it
/// to the garbage collector: a second reference, not shown, would keep the object alive for ever.
pub(crate) type Shared = Arc<Py<PyAny>>;

/// Python objects that a subdomain or a run calls, and the slots where their exceptions wait.
#[derive(Debug, Default)]
pub(crate) struct Callbacks {
    objects: Vec<Shared>,
    pending: Vec<Pending>,
}

impl Callbacks {
    pub(crate) fn new(object: Option<Shared>, pending: Pending) -> Self {
        Self {
            objects: object.into_iter().collect(),
            pending: vec![pending],
        }
    }

    /// Adds the slot where the exceptions of a function wait.
    pub(crate) fn add_pending(&mut self, pending: Option<&Pending>) {
        self.pending.extend(pending.cloned());
    }

    /// Takes over all objects and slots of another subdomain or run.
    pub(crate) fn take(&mut self, other: Self) {
        self.objects.extend(other.objects);
        self.pending.extend(other.pending);
    }

    /// Takes the first exception that waits.
    pub(crate) fn raised(&self) -> Option<PyErr> {
        self.pending.iter().find_map(Pending::take)
    }

    /// Returns whether an exception waits.
    pub(crate) fn waits(&self) -> bool {
        self.pending.iter().any(Pending::waits)
    }

    /// Shows the objects to the garbage collector. There is nothing to clear: every cycle passes through a
    /// Python object that the collector can clear.
    pub(crate) fn show(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.objects.iter().try_for_each(|o| visit.call(&**o))
    }
}

/// Slot for an exception where the core accepts none. The run checks the slot after it has stopped.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pending(Arc<Mutex<Option<PyErr>>>);

impl Pending {
    pub(crate) fn keep(&self, e: PyErr) {
        // The first exception is the cause of later ones, so it stays.
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        slot.get_or_insert(e);
    }

    pub(crate) fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    pub(crate) fn waits(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }
}

/// Marks a Python object that holds weights or a state as used by one run. A second run would change both
/// without the first one noticing.
pub(crate) struct Claim(usize);

static CLAIMED: Mutex<BTreeSet<usize>> = Mutex::new(BTreeSet::new());

impl Claim {
    pub(crate) fn new(name: &str, object: &Py<PyAny>) -> Result<Self, Fault> {
        // The owner of the claim holds the object, so that no other gets its address meanwhile.
        let address = object.as_ptr() as usize;
        let mut claimed = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        if claimed.insert(address) {
            return Ok(Self(address));
        }
        let text = format!(
            "'{name}' is part of a subdomain or run that is still there; make another one, or delete that first"
        );
        Err(Fault::new("Unsupported", text))
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        CLAIMED
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .remove(&self.0);
    }
}

/// Panics on purpose; tests check that the panic becomes an exception.
#[pyfunction]
pub(crate) fn _mistake(py: Python<'_>, text: String) -> PyResult<()> {
    outside(py, || std::panic::panic_any(text))
}

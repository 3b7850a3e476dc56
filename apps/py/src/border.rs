//! What crosses from Python to Rust: without the interpreter's lock, and back without a panic.

use crate::error::Fault;
use crate::threads::with_threads;
use pyo3::prelude::*;
use pyo3::{PyTraverseError, PyVisit};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two looks for Ctrl-C: no one waits that long, and no step is slowed down by it.
const LOOK: Duration = Duration::from_millis(50);

thread_local! {
    /// What Ctrl-C raised while Rust computed; [`outside`] hands it to the interpreter.
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
    /// When this thread looked for Ctrl-C last.
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Computes without the interpreter's lock; errors, panics and Ctrl-C become exceptions.
pub(crate) fn outside<V: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<V, Fault> + Send,
) -> PyResult<V> {
    let made = py.detach(|| catch_unwind(AssertUnwindSafe(|| with_threads(work).flatten())));
    if let Some(raised) = raised() {
        return Err(raised);
    }
    made.unwrap_or_else(|payload| Err(Fault::panic(&*payload)))
        .map_err(PyErr::from)
}

/// Takes what Ctrl-C raised while this thread computed.
pub(crate) fn raised() -> Option<PyErr> {
    RAISED.take()
}

/// Whether Ctrl-C was pressed, or another signal raised an exception: for long loops and waits of the
/// crates. The interpreter handles signals on its main thread alone; elsewhere the answer is no.
pub(crate) fn is_interrupted() -> bool {
    if RAISED.with_borrow(Option::is_some) {
        return true;
    }
    if LOOKED.get().is_some_and(|at| at.elapsed() < LOOK) {
        return false;
    }
    LOOKED.set(Some(Instant::now()));
    // Handlers of signals run here, and may call this package: nothing is borrowed meanwhile.
    let raised = Python::attach(|py| py.check_signals()).err();
    let stops = raised.is_some();
    if stops {
        RAISED.set(raised);
    }
    stops
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

/// A reference to an object of Python: that of a model in the core, which the subdomain or run around it
/// shows to the interpreter's garbage collector. One reference for both: the collector counts.
pub(crate) type Shared = Arc<Py<PyAny>>;

/// What a subdomain or a run has in Python: objects that it asks, and where their exceptions wait.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    objects: Vec<Shared>,
    pending: Vec<Pending>,
}

impl Heard {
    pub(crate) fn of(object: Option<Shared>, pending: Pending) -> Self {
        Self {
            objects: object.into_iter().collect(),
            pending: vec![pending],
        }
    }

    /// Exceptions of a function wait there as well.
    pub(crate) fn hear(&mut self, pending: Option<&Pending>) {
        self.pending.extend(pending.cloned());
    }

    /// Takes over what another has.
    pub(crate) fn take(&mut self, other: Self) {
        self.objects.extend(other.objects);
        self.pending.extend(other.pending);
    }

    /// The exception that waits.
    pub(crate) fn raised(&self) -> Option<PyErr> {
        self.pending.iter().find_map(Pending::take)
    }

    pub(crate) fn waits(&self) -> bool {
        self.pending.iter().any(Pending::waits)
    }

    /// Shows the objects to the garbage collector. There is nothing to clear: whatever refers back to a run
    /// is an object of Python that the collector can empty.
    pub(crate) fn show(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.objects.iter().try_for_each(|o| visit.call(&**o))
    }
}

/// An exception raised where the core takes none: the run looks here once it has stopped.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pending(Arc<Mutex<Option<PyErr>>>);

impl Pending {
    pub(crate) fn keep(&self, e: PyErr) {
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

/// An object of Python that keeps weights or a state, for as long as one run has it: a second run would
/// change them behind the back of the first.
pub(crate) struct Claim(usize);

static CLAIMED: Mutex<BTreeSet<usize>> = Mutex::new(BTreeSet::new());

impl Claim {
    pub(crate) fn of(name: &str, object: &Py<PyAny>) -> Result<Self, Fault> {
        let at = object.as_ptr() as usize;
        let mut all = CLAIMED.lock().unwrap_or_else(PoisonError::into_inner);
        if all.insert(at) {
            return Ok(Self(at));
        }
        let text = format!(
            "'{name}' is part of a subdomain or run that is still there; make another one, or delete that first"
        );
        Err(Fault::of("Unsupported", text))
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

/// For tests of the border: the mistake that must not be.
#[pyfunction]
pub(crate) fn _mistake(py: Python<'_>, text: String) -> PyResult<()> {
    outside(py, || std::panic::panic_any(text))
}

//! Threads for computations: their number, and new ones for a forked process.

use crate::error::Fault;
use arlequin_scene::threads;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// True if this process was forked from one that had loaded the package. The threads of that process do not
/// exist in this one, and work given to them would never end.
static FORKED: AtomicBool = AtomicBool::new(false);
/// Number of threads in a forked process; 0 for as many as in the process it was forked from.
static COUNT: AtomicUsize = AtomicUsize::new(0);
/// Pool of a forked process for work of all threads except its first.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

thread_local! {
    /// True on the first thread of a forked process.
    static FIRST: Cell<bool> = const { Cell::new(false) };
    /// True if this thread belongs to a pool of this forked process.
    static JOINED: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work` with threads of this process.
///
/// In a forked process the first thread becomes part of a new pool, so that it still receives Ctrl-C. Work
/// of other threads goes to a second pool.
pub(crate) fn with_threads<V: Send>(work: impl FnOnce() -> V + Send) -> Result<V, Fault> {
    if !FORKED.load(Ordering::Relaxed) || JOINED.get() {
        return Ok(work());
    }
    if FIRST.get() && join() {
        return Ok(work());
    }
    Ok(pool()?.install(work))
}

fn builder() -> ThreadPoolBuilder {
    let requested = COUNT.load(Ordering::Relaxed);
    let count = if requested > 0 {
        requested
    } else {
        rayon::current_num_threads()
    };
    ThreadPoolBuilder::new().num_threads(count)
}

/// Makes this thread part of a new pool that lasts as long as the process. Returns false if the thread
/// belongs to a pool already: that of the parent process, if the parent was forked as well.
fn join() -> bool {
    // One attempt only: a thread cannot be part of two pools.
    FIRST.set(false);
    let built = builder().use_current_thread().build();
    let joined = built.is_ok();
    JOINED.set(joined);
    // Dropping the pool would end it.
    std::mem::forget(built);
    joined
}

fn pool() -> Result<Arc<ThreadPool>, Fault> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = &*pool {
        return Ok(pool.clone());
    }
    let built = builder().build();
    let built =
        built.map_err(|e| Fault::new("System", format!("starting threads in a forked process: {e}")))?;
    Ok(pool.insert(Arc::new(built)).clone())
}

/// Called in a new forked process, by its only thread.
#[pyfunction]
pub(crate) fn _forked() {
    FORKED.store(true, Ordering::Relaxed);
    FIRST.set(true);
    JOINED.set(false);
    // The pool belongs to the parent process. Dropping it would wait for threads that do not exist.
    std::mem::forget(POOL.lock().unwrap_or_else(PoisonError::into_inner).take());
}

/// Sets the number of threads for computations: at most four per core.
#[pyfunction]
pub(crate) fn set_threads(count: usize) -> PyResult<()> {
    let most = threads::most();
    if !(1..=most).contains(&count) {
        let rule = format!(
            "threads = {count}: must be from 1 to {most}, {} for each of the {} cores of this machine",
            threads::PER_CORE,
            threads::cores()
        );
        return Err(Fault::new("InvalidParameter", rule).into());
    }
    start(count)
}

fn start(count: usize) -> PyResult<()> {
    if FORKED.load(Ordering::Relaxed) && FIRST.get() {
        // The pool of this process is built later, with this number.
        COUNT.store(count, Ordering::Relaxed);
        return Ok(());
    }
    let built = ThreadPoolBuilder::new().num_threads(count).build_global();
    built.map_err(|_| {
        let rule = "threads have been started already: call set_threads before anything else, or set RAYON_NUM_THREADS";
        Fault::new("System", rule).into()
    })
}

/// Starts as many threads as are useful if `RAYON_NUM_THREADS` asks for more. Returns the warning for the
/// user in that case.
#[pyfunction]
pub(crate) fn _bound_threads() -> PyResult<Option<String>> {
    let Some(requested) = threads::asked().filter(|n| *n > threads::most()) else {
        return Ok(None);
    };
    start(threads::most())?;
    Ok(Some(threads::too_many("RAYON_NUM_THREADS", requested)))
}

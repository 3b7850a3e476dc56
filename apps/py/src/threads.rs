//! Threads that compute: how many, and those of a process that was forked.

use crate::error::Fault;
use arlequin_scene::threads;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Whether this process was forked from one that had loaded the package: threads of that one do not exist
/// here, and work that is given to them never ends.
static FORKED: AtomicBool = AtomicBool::new(false);
/// Threads that a forked process computes with; 0 for as many as the process it was forked from.
static COUNT: AtomicUsize = AtomicUsize::new(0);
/// Threads of a forked process for work of other threads than its first one.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

thread_local! {
    /// Whether this is the first thread of a forked process.
    static FIRST: Cell<bool> = const { Cell::new(false) };
    /// Whether this thread shares its work with threads of this process, although it was forked.
    static JOINED: Cell<bool> = const { Cell::new(false) };
}

/// Does work with threads of this process.
///
/// In a forked process, the first thread becomes part of a new pool: it still hears Ctrl-C. Work of other
/// threads is handed to a second pool.
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
    let asked = COUNT.load(Ordering::Relaxed);
    let count = if asked > 0 {
        asked
    } else {
        rayon::current_num_threads()
    };
    ThreadPoolBuilder::new().num_threads(count)
}

/// Makes this thread part of a new pool that lasts as long as the process. False where it is part of one
/// already: that of the process from which this one was forked, if that one was forked as well.
fn join() -> bool {
    FIRST.set(false);
    let built = builder().use_current_thread().build();
    let joined = built.is_ok();
    JOINED.set(joined);
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
        built.map_err(|e| Fault::of("System", format!("starting threads in a forked process: {e}")))?;
    Ok(pool.insert(Arc::new(built)).clone())
}

/// Called in a process that was just forked, by the thread that goes on in it.
#[pyfunction]
pub(crate) fn _forked() {
    FORKED.store(true, Ordering::Relaxed);
    FIRST.set(true);
    JOINED.set(false);
    // That of the process it was forked from: dropped, it would wait for threads that do not exist.
    std::mem::forget(POOL.lock().unwrap_or_else(PoisonError::into_inner).take());
}

/// Computes with so many threads from now on: at most four per core.
#[pyfunction]
pub(crate) fn set_threads(count: usize) -> PyResult<()> {
    let most = threads::most();
    if !(1..=most).contains(&count) {
        let rule = format!(
            "threads = {count}: must be from 1 to {most}, {} for each of the {} cores of this machine",
            threads::PER_CORE,
            threads::cores()
        );
        return Err(Fault::of("InvalidParameter", rule).into());
    }
    start(count)
}

fn start(count: usize) -> PyResult<()> {
    if FORKED.load(Ordering::Relaxed) && FIRST.get() {
        COUNT.store(count, Ordering::Relaxed);
        return Ok(());
    }
    let built = ThreadPoolBuilder::new().num_threads(count).build_global();
    built.map_err(|_| {
        let rule = "threads have been started already: call set_threads before anything else, or set RAYON_NUM_THREADS";
        Fault::of("System", rule).into()
    })
}

/// Starts as many threads as are of use where `RAYON_NUM_THREADS` asks for more; what the user is told then.
#[pyfunction]
pub(crate) fn _bound_threads() -> PyResult<Option<String>> {
    let Some(asked) = threads::asked().filter(|n| *n > threads::most()) else {
        return Ok(None);
    };
    start(threads::most())?;
    Ok(Some(threads::too_many("RAYON_NUM_THREADS", asked)))
}

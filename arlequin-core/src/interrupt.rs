//! Ctrl-C and SIGTERM, for work that takes long before the first step: packing spheres, waiting for a solver.
//!
//! A library installs no signal handler. The program or the interpreter that has one registers a function
//! which says whether the user wants to end the process's work, and long loops of all crates ask
//! [`is_requested`].

use std::sync::OnceLock;

static ASKED: OnceLock<fn() -> bool> = OnceLock::new();

/// Registers the function that says whether the user wants to end the work of this process. It is called
/// often, also on the threads of a computation, and should take microseconds.
///
/// The first function stays; returns whether this was the first one.
pub fn listen(asked: fn() -> bool) -> bool {
    ASKED.set(asked).is_ok()
}

/// Returns whether the user wants to end the work of this process; false where no function is registered.
pub fn is_requested() -> bool {
    ASKED.get().is_some_and(|asked| asked())
}

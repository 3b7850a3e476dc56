//! How many threads are of use on this machine.

use std::num::NonZero;

/// Most threads per core: a few more than cores do no harm, many stop the machine.
pub const PER_CORE: usize = 4;

/// Cores that this process may use; one where the system does not tell.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

/// Most threads that are started.
pub fn most() -> usize {
    PER_CORE * cores()
}

/// What the environment variable `RAYON_NUM_THREADS` asks for, if it is a positive number.
pub fn asked() -> Option<usize> {
    let variable = std::env::var("RAYON_NUM_THREADS").ok()?;
    variable.trim().parse().ok().filter(|n| *n > 0)
}

/// What a user is told who asks for more than [`most`] by `name`.
pub fn too_many(name: &str, asked: usize) -> String {
    let (most, cores) = (most(), cores());
    format!(
        "{name} = {asked}: {most} are used, {PER_CORE} for each of the {cores} cores of this machine; more only slow it down"
    )
}

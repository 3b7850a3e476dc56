//! Number of threads that this machine can use.

use std::num::NonZero;

/// Largest number of threads per core: a few more threads than cores do no harm, many slow the machine down.
pub const PER_CORE: usize = 4;

/// Number of cores that this process may use; 1 if the system does not report it.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

/// Largest number of threads that are started.
pub fn most() -> usize {
    PER_CORE * cores()
}

/// Returns the value of the environment variable `RAYON_NUM_THREADS` if it is a positive number.
pub fn asked() -> Option<usize> {
    let variable = std::env::var("RAYON_NUM_THREADS").ok()?;
    variable.trim().parse().ok().filter(|n| *n > 0)
}

/// Returns the warning for a user who requests more than [`most`] threads by `name`.
pub fn too_many(name: &str, requested: usize) -> String {
    let (most, cores) = (most(), cores());
    format!(
        "{name} = {requested}: {most} are used, {PER_CORE} for each of the {cores} cores of this machine; more only slow it down"
    )
}

//! How many threads work: as many as asked for, within what the machine can run.

use crate::error::{Error, Result, value};
use crate::report;
use arlequin_scene::threads;

/// Number of threads for a wish, of the command line or else of `RAYON_NUM_THREADS`; one per core without a
/// wish. Says so where the machine bounds it.
pub(crate) fn bounded(wanted: Option<usize>) -> Result<usize> {
    if wanted == Some(0) {
        return Err(value("--threads", 0, "must be at least 1"));
    }
    let (name, n) = match (wanted, threads::asked()) {
        (Some(n), _) => ("--threads", n),
        (None, Some(n)) => ("RAYON_NUM_THREADS", n),
        // Ranks share the cores of their machine.
        (None, None) => return Ok((threads::cores() / crate::ranks::on_this_machine()).max(1)),
    };
    if n > threads::most() {
        report::warning(&threads::too_many(name, n));
    }
    Ok(n.min(threads::most()))
}

/// Starts the threads of this process; how many there are.
pub(crate) fn start(wanted: Option<usize>) -> Result<usize> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(bounded(wanted)?)
        .build_global()
        .map_err(|e| Error::System {
            what: "starting the threads",
            message: e.to_string(),
        })?;
    Ok(rayon::current_num_threads())
}

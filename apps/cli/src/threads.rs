//! Number of worker threads: as many as requested, at most as many as the machine can run.

use crate::error::{Error, Result, value};
use crate::report;
use arlequin_scene::threads;

/// Returns the number of threads: as requested on the command line, otherwise by `RAYON_NUM_THREADS`,
/// otherwise one per core. Warns if the machine's limit reduces it.
pub(crate) fn bounded(wanted: Option<usize>) -> Result<usize> {
    if wanted == Some(0) {
        return Err(value("--threads", 0, "must be at least 1"));
    }
    let (name, n) = match (wanted, threads::asked()) {
        (Some(n), _) => ("--threads", n),
        (None, Some(n)) => ("RAYON_NUM_THREADS", n),
        // The ranks on one machine share its cores.
        (None, None) => return Ok((threads::cores() / crate::ranks::on_this_machine()).max(1)),
    };
    if n > threads::most() {
        report::warning(&threads::too_many(name, n));
    }
    Ok(n.min(threads::most()))
}

/// Starts the threads of this process and returns their number.
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

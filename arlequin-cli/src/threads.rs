//! How many threads work: as many as asked for, within what the machine can run.

use crate::error::{Error, Result, value};
use crate::report;
use std::num::NonZero;

/// Most threads per core: a few more than cores do no harm, many stop the machine.
const PER_CORE: usize = 4;

/// Number of threads for a wish, of the command line or else of `RAYON_NUM_THREADS`; one per core without a wish. Says
/// so where the machine bounds it.
pub(crate) fn bounded(wanted: Option<usize>) -> Result<usize> {
    if wanted == Some(0) {
        return Err(value("--threads", 0, "must be at least 1"));
    }
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
    // Ranks share the cores of their machine.
    let share = (cores / crate::ranks::on_this_machine()).max(1);
    let most = PER_CORE * cores;
    let variable = std::env::var("RAYON_NUM_THREADS").ok();
    let variable = variable.and_then(|v| v.trim().parse().ok()).filter(|n| *n > 0);
    let (name, n) = match (wanted, variable) {
        (Some(n), _) => ("--threads", n),
        (None, Some(n)) => ("RAYON_NUM_THREADS", n),
        (None, None) => return Ok(share),
    };
    if n > most {
        report::warning(&format!(
            "{name} = {n}: {most} are used, {PER_CORE} for each of the {cores} cores of this machine; more only slow \
             it down"
        ));
    }
    Ok(n.min(most))
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

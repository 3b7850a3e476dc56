//! Runs on several ranks, started by `mpirun` or a batch system: which rank prints, and how all ranks end.

use crate::error::{Located, Result, value};
#[cfg(feature = "mpi")]
use crate::report;
use arlequin::core::ranks::Communicator;
use arlequin_mpi::Launched;
use clap::Args;
use std::process::ExitCode;
use std::sync::Arc;

/// Communicator to the other ranks; `None` if this process runs alone.
pub(crate) type OtherRanks = Option<Arc<dyn Communicator>>;

/// Default limit on waiting for another rank \[s\]. It must cover the writing of frames and checkpoints and
/// the different durations of the ranks' set-ups.
const WAIT: f64 = 600.0;

// No doc comment: clap would print it as the help of the program.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct Waiting {
    /// Under mpirun: longest time that a rank waits for another before all ranks end with an error
    /// [default: 600]
    #[arg(long, value_name = "SECONDS")]
    wait: Option<f64>,
}

impl Waiting {
    /// Returns the limit in seconds.
    fn seconds(self) -> Result<f64> {
        match self.wait {
            None => Ok(WAIT),
            // Larger values overflow the clock.
            Some(s) if s > 0.0 && s <= 1e9 => Ok(s),
            Some(s) => Err(value("--wait", s, "must be above 0 and at most 1e9 s")),
        }
    }
}

/// Returns the number of processes of this job on this machine, which share its cores.
pub(crate) fn on_this_machine() -> usize {
    // Set for each process by Open MPI, and by MPICH and Intel MPI.
    let names = ["OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS"];
    let count = names
        .iter()
        .find_map(|n| std::env::var(n).ok()?.trim().parse().ok());
    count.unwrap_or(1).max(1)
}

/// Returns whether this process prints: rank 0, or a process that runs alone.
pub(crate) fn leads() -> bool {
    Launched::from_environment().is_none_or(|l| l.rank == 0)
}

/// Time that rank 0 has to print an error of the start before the other ranks print it too \[s\].
const LEAD: u64 = 5;

/// Leaves rank 0 the time to print an error that all ranks have found before they communicate.
///
/// A launcher ends the whole job when the first process fails. If another rank failed first, it would end
/// rank 0 before the message is printed. A rank that is still there after the wait is the only one with
/// this error.
pub(crate) fn let_first_speak() {
    if !leads() {
        std::thread::sleep(std::time::Duration::from_secs(LEAD));
    }
}

/// Refuses a command that would do the same work on every rank.
pub(crate) fn refuse_several(command: &str) -> Result<()> {
    match Launched::from_environment() {
        Some(l) if l.ranks > 1 => Err(value(
            "ranks",
            l.ranks,
            &format!("run and resume go on several ranks, '{command}' on one: call it without mpirun"),
        )),
        _ => Ok(()),
    }
}

/// Runs `work`, as one of several ranks if a launcher started them.
#[cfg(feature = "mpi")]
pub(crate) fn run(
    waiting: Waiting,
    work: impl FnOnce(OtherRanks) -> Result<ExitCode, Located>,
) -> Result<ExitCode, Located> {
    use arlequin_mpi::processes::{self, Ending};
    let wait = waiting.seconds().inspect_err(|_| let_first_speak())?;
    if Launched::from_environment().is_none_or(|l| l.ranks == 1) {
        return work(None);
    }
    let ending = Ending {
        wait: std::time::Duration::from_secs_f64(wait),
        code: 1,
        report: |why| report::error(&format!("error: {why}\n")),
        echo: false,
    };
    let done = processes::run(ending, |communicator| match work(Some(communicator)) {
        Ok(code) => Ok(code),
        // Every rank has received this error, so the communication ends in order.
        Err(e) if e.is_everywhere() => Ok(e.report_once()),
        Err(e) => Err(e.plain()),
    });
    done.or_else(|e| {
        // MPI itself fails for every rank alike, and some launchers do not end the others.
        first_speaks(arlequin_scene::error::core("ranks")(e.into()).into())
    })
}

/// Runs `work` in a single process. Refuses several ranks, which would all write the same files.
#[cfg(not(feature = "mpi"))]
pub(crate) fn run(
    waiting: Waiting,
    work: impl FnOnce(OtherRanks) -> Result<ExitCode, Located>,
) -> Result<ExitCode, Located> {
    waiting.seconds().inspect_err(|_| let_first_speak())?;
    if let Some(Launched { ranks, .. }) = Launched::from_environment().filter(|l| l.ranks > 1) {
        let rule = "this program was built without MPI, and each rank would make the same run; build it with --features mpi, or \
                    call it without mpirun";
        return first_speaks(value("ranks", ranks, rule).into());
    }
    work(None)
}

/// Returns an error that every rank meets as rank 0's; the other ranks end with its code without a word.
fn first_speaks(error: Located) -> Result<ExitCode, Located> {
    let_first_speak();
    if leads() { Err(error) } else { Ok(error.code()) }
}

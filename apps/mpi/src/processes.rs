//! Ranks as processes that speak MPI.
//!
//! MPI has no time-outs, and guarantees nothing after an error. So every operation is non-blocking and polled
//! until a time limit. A rank that meets its limit, an error or a panic informs the others, reports what
//! happened, and ends the whole job ([`run`]). Waiting ranks yield their core: with more ranks than cores a
//! run is slow but not stuck.

use crate::launcher::Launched;
use ::mpi::Threading;
use ::mpi::collective::SystemOperation;
use ::mpi::point_to_point::Status;
use ::mpi::request::{LocalScope, Request, scope};
use ::mpi::topology::SimpleCommunicator;
use ::mpi::traits::{
    Communicator as _, CommunicatorCollectives as _, Destination as _, Equivalence as _, Source as _,
};
use arlequin_core::ranks::{Communicator, Message, RankError, Reduction};
use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Tag of messages with data of nodes.
const DATA: i32 = 1;
/// Tag of the report of a rank that ends the job.
const LAST_WORD: i32 = 2;

/// Time that a rank which ends the job leaves to others for their own reports.
const GRACE: Duration = Duration::from_millis(300);

/// Number of polls before the core is yielded.
const EAGER: u32 = 200;

/// How a job of several processes ends if one of them fails.
#[derive(Debug, Clone, Copy)]
pub struct Ending {
    /// Longest wait for another rank.
    pub wait: Duration,
    /// Exit code of the job.
    pub code: i32,
    /// Called with a description of the failure on every rank that notices it in time.
    pub report: fn(&str),
    /// True if a rank that ends because of another rank's failure reports as well.
    pub echo: bool,
}

/// Runs `work` as one rank of the job that `mpirun` started, or alone without a launcher. If `work` fails on
/// a rank, or a rank waits too long, each rank reports through [`Ending::report`] and the job ends with its
/// exit code: this function does not return then.
///
/// # Errors
/// [`RankError::Transport`] if MPI is in use already, if the MPI library lets only one thread call it, and if
/// the launcher started more processes than this library sees.
pub fn run<R, E: Display>(
    ending: Ending,
    work: impl FnOnce(Arc<dyn Communicator>) -> Result<R, E>,
) -> Result<R, RankError> {
    let transport = |what: &str| RankError::Transport {
        rank: 0,
        what: what.to_owned(),
    };
    // Whichever thread steps the model calls MPI, one call at a time.
    let started = ::mpi::initialize_with_threading(Threading::Serialized);
    let (_universe, threads) = started.ok_or_else(|| transport("MPI is in use already; start it once"))?;
    if !matches!(threads, Threading::Serialized | Threading::Multiple) {
        return Err(transport(
            "this MPI library lets one thread alone call it; take one with MPI_THREAD_SERIALIZED",
        ));
    }
    let world = SimpleCommunicator::world();
    // Before any work: a wrong launcher would make every process run the whole scene.
    check_launcher(world.size() as usize)?;
    let process = Arc::new(Process {
        rank: world.rank() as usize,
        ranks: world.size() as usize,
        ending,
    });
    let panics = Panics(&process);
    match work(process.clone()) {
        Ok(done) => {
            // The guard must not act on an orderly end.
            std::mem::forget(panics);
            Ok(done)
        }
        Err(e) => process.end(&e.to_string(), true),
    }
}

/// Refuses fewer ranks than the launcher started.
fn check_launcher(ranks: usize) -> Result<(), RankError> {
    // The `mpirun` of another MPI library leaves each process alone in a world of its own, and each would
    // make the whole run.
    let Some(launched) = Launched::from_environment().filter(|l| l.ranks > ranks) else {
        return Ok(());
    };
    let library = ::mpi::environment::library_version().unwrap_or_default();
    let library = library.lines().next().unwrap_or_default();
    let library = library.split(',').next().unwrap_or_default().trim();
    let (rank, started) = (launched.rank, launched.ranks);
    let what = format!(
        "the launcher started {started} processes, and MPI sees {ranks} in this one's world: the launcher belongs to another MPI \
         library than this program, which is linked with {library}; start it with the mpirun of that library (which mpirun tells \
         whose is found first)"
    );
    Err(RankError::Transport { rank, what })
}

/// Ends the job if `work` panics: finalising MPI would wait for ranks that wait for this one.
struct Panics<'a>(&'a Process);

impl Drop for Panics<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0
                .end(&format!("rank {}: the program panicked", self.0.rank), true);
        }
    }
}

/// Rank of an MPI job.
#[derive(Debug)]
struct Process {
    rank: usize,
    ranks: usize,
    ending: Ending,
}

type Open<'a, 'b, B> = Request<'a, B, &'b LocalScope<'a>>;

impl Process {
    /// Reports why, informs the other ranks if `inform`, and ends the job.
    fn end(&self, why: &str, inform: bool) -> ! {
        if inform || self.ending.echo {
            (self.ending.report)(why);
        }
        if inform {
            self.abandon(why);
        } else {
            // The rank that gave up gets the time for its own report.
            std::thread::sleep(GRACE);
        }
        SimpleCommunicator::world().abort(self.ending.code)
    }

    /// Polls `step` until it returns true. Ends the job if that takes too long, or if another rank sends its
    /// last words.
    fn look_after(&self, what: &'static str, peer: impl Fn() -> String, mut step: impl FnMut() -> bool) {
        let (mut looks, mut until) = (0_u32, None);
        while !step() {
            looks += 1;
            if looks < EAGER {
                std::hint::spin_loop();
                continue;
            }
            // The clock is first read after the eager polls, during which most messages arrive.
            let now = Instant::now();
            if now > *until.get_or_insert(now + self.ending.wait) {
                let silent = RankError::Silent {
                    rank: self.rank,
                    peer: peer(),
                    what,
                    seconds: self.ending.wait.as_secs_f64(),
                };
                self.end(&silent.to_string(), true);
            }
            // Looked for only while this rank waits: a rank at work is not disturbed.
            if let Some((by, why)) = last_word() {
                let rank = self.rank;
                self.end(&RankError::GaveUp { rank, by, why }.to_string(), false);
            }
            std::thread::yield_now();
        }
    }
}

/// Returns the last words of another rank, if any have arrived.
fn last_word() -> Option<(usize, String)> {
    let world = SimpleCommunicator::world();
    let (message, status) = world.any_process().immediate_matched_probe_with_tag(LAST_WORD)?;
    let mut words = vec![0_u8; usize::try_from(status.count(u8::equivalent_datatype())).unwrap_or_default()];
    message.matched_receive_into(&mut words[..]);
    let why = String::from_utf8_lossy(&words).into_owned();
    Some((status.source_rank() as usize, why))
}

/// Returns whether a request is complete; calls `complete` with its status at that moment.
fn is_done<'a, B: ?Sized>(request: &mut Option<Open<'a, '_, B>>, complete: &mut dyn FnMut(Status)) -> bool {
    match request.take().map(Request::test) {
        Some(Ok(status)) => {
            complete(status);
            true
        }
        Some(Err(open)) => {
            *request = Some(open);
            false
        }
        None => true,
    }
}

impl Communicator for Process {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.ranks
    }

    fn exchange(&self, messages: &mut [Message]) -> Result<(), RankError> {
        let world = SimpleCommunicator::world();
        let mut odd = None;
        scope(|scope| {
            let mut sends = Vec::with_capacity(messages.len());
            let mut receives = Vec::with_capacity(messages.len());
            for Message { peer, out, into } in messages.iter_mut() {
                let process = world.process_at_rank(*peer as i32);
                let expected = into.len();
                // Receives before sends, so that messages find their place.
                let receive = process.immediate_receive_into_with_tag(scope, &mut into[..], DATA);
                receives.push((*peer, expected, Some(receive)));
                sends.push((
                    *peer,
                    Some(process.immediate_send_with_tag(scope, &out[..], DATA)),
                ));
            }
            let mut check = |peer: usize, expected: usize, status: Status| {
                let received = usize::try_from(status.count(f64::equivalent_datatype())).unwrap_or_default();
                if received != expected {
                    odd.get_or_insert(RankError::Length {
                        rank: self.rank,
                        peer,
                        expected,
                        found: received,
                    });
                }
            };
            // All receives are awaited, whatever a length says: an open one would write into freed memory.
            for (peer, expected, request) in &mut receives {
                let (peer, expected) = (*peer, *expected);
                self.look_after(
                    "a message",
                    || format!("rank {peer}"),
                    || is_done(request, &mut |status| check(peer, expected, status)),
                );
            }
            for (peer, request) in &mut sends {
                let peer = *peer;
                let taken = || is_done(request, &mut |_| ());
                self.look_after("a message to be taken", || format!("rank {peer}"), taken);
            }
        });
        odd.map_or(Ok(()), Err)
    }

    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        let world = SimpleCommunicator::world();
        // MPI reads from one array and writes to another.
        let local = words.to_vec();
        let operation = match how {
            Reduction::Sum => SystemOperation::sum(),
            Reduction::Largest => SystemOperation::max(),
        };
        scope(|scope| {
            let mut request =
                Some(world.immediate_all_reduce_into(scope, &local[..], &mut *words, operation));
            let peer = || "other ranks".to_owned();
            self.look_after("a sum over all ranks", peer, || {
                is_done(&mut request, &mut |_| ())
            });
        });
        Ok(())
    }

    fn abandon(&self, why: &str) {
        let world = SimpleCommunicator::world();
        let words = why.as_bytes();
        let until = Instant::now() + GRACE;
        scope(|scope| {
            let other_ranks = (0..self.ranks).filter(|r| *r != self.rank);
            let send = |r: usize| {
                let process = world.process_at_rank(r as i32);
                Some(process.immediate_send_with_tag(scope, words, LAST_WORD))
            };
            let mut open: Vec<_> = other_ranks.map(send).collect();
            // Up to the time limit: ranks that wait look for this message.
            while Instant::now() < until {
                for o in &mut open {
                    is_done(o, &mut |_| ());
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            if open.iter().any(Option::is_some) {
                // A rank that does not take one short message will take nothing, and this one must not wait
                // for it.
                world.abort(self.ending.code);
            }
        });
    }
}

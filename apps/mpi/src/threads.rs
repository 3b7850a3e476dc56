//! Ranks as threads of one process.

use arlequin_core::ranks::{Communicator, Message, RankError, Reduction};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Runs `work` on `ranks` ranks at once, each on a thread of its own with a pool of `threads` for parallel
/// loops. No rank waits for another longer than `wait`. Returns the results in the order of ranks;
/// [`RankError::Lost`] for a rank that panicked.
///
/// ```
/// use arlequin_core::ranks::Reduction;
/// use std::time::Duration;
/// let sums = arlequin_mpi::threads::run(3, 1, Duration::from_secs(5), |communicator| {
///     let mut words = [communicator.rank() as i64];
///     communicator.reduce(&mut words, Reduction::Sum).map(|()| words[0])
/// });
/// assert_eq!(sums, [Ok(Ok(3)), Ok(Ok(3)), Ok(Ok(3))]);
/// ```
pub fn run<R: Send>(
    ranks: usize,
    threads: usize,
    wait: Duration,
    work: impl Fn(Arc<dyn Communicator>) -> R + Sync,
) -> Vec<Result<R, RankError>> {
    let shared = Arc::new(Shared {
        ranks,
        wait,
        state: Mutex::new(State::new(ranks)),
        changed: Condvar::new(),
    });
    let run_rank = |rank: usize| {
        let thread = Thread {
            rank,
            shared: shared.clone(),
        };
        // Marks this rank as ended, on return as well as on a panic, so that others do not wait for it.
        let _leaving = Leaving(&thread);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|e| RankError::Transport {
            rank,
            what: e.to_string(),
        })?;
        let communicator = Arc::new(thread.clone());
        Ok(pool.install(|| work(communicator)))
    };
    std::thread::scope(|s| {
        let run_rank = &run_rank;
        let handles: Vec<_> = (0..ranks).map(|rank| s.spawn(move || run_rank(rank))).collect();
        let ended = (0..).zip(handles).map(|(peer, thread)| {
            let lost = RankError::Lost { rank: peer, peer };
            thread.join().unwrap_or(Err(lost))
        });
        ended.collect()
    })
}

/// Rank on a thread.
#[derive(Debug, Clone)]
struct Thread {
    rank: usize,
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    ranks: usize,
    wait: Duration,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    /// Messages from rank `i` to rank `j`, at `i * ranks + j`.
    boxes: Vec<VecDeque<Vec<f64>>>,
    /// Words of the present reduction, number of ranks that have added theirs, and number of finished
    /// reductions.
    words: Vec<i64>,
    given: usize,
    done: usize,
    result: Vec<i64>,
    /// Ranks that have ended, and the first rank that gave up, with its reason.
    ended: Vec<bool>,
    gave_up: Option<(usize, String)>,
}

impl State {
    fn new(ranks: usize) -> Self {
        Self {
            boxes: vec![VecDeque::new(); ranks * ranks],
            words: Vec::new(),
            given: 0,
            done: 0,
            result: Vec::new(),
            ended: vec![false; ranks],
            gave_up: None,
        }
    }
}

/// Guard that marks a rank as ended when dropped.
struct Leaving<'a>(&'a Thread);

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        self.0.lock().ended[self.0.rank] = true;
        self.0.shared.changed.notify_all();
    }
}

impl Thread {
    /// Locks the state.
    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing panics while it holds the lock, so that a poisoned one does no harm.
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `ready` returns a value. `from`: ranks that have to act for that.
    fn wait<R>(
        &self,
        what: &'static str,
        from: std::ops::Range<usize>,
        mut ready: impl FnMut(&mut State) -> Option<R>,
    ) -> Result<R, RankError> {
        let rank = self.rank;
        let until = Instant::now() + self.shared.wait;
        let mut state = self.lock();
        loop {
            // Looked at first: a value that has come counts, even if its sender has ended since.
            if let Some(found) = ready(&mut state) {
                return Ok(found);
            }
            if let Some((by, why)) = &state.gave_up {
                let (by, why) = (*by, why.clone());
                return Err(RankError::GaveUp { rank, by, why });
            }
            // Only ranks that have to act: others may have ended in good order.
            if let Some(peer) = from.clone().find(|r| *r != rank && state.ended[*r]) {
                return Err(RankError::Lost { rank, peer });
            }
            let now = Instant::now();
            if now >= until {
                let single = from.len() == 1;
                return Err(RankError::Silent {
                    rank,
                    peer: if single {
                        format!("rank {}", from.start)
                    } else {
                        "other ranks".to_owned()
                    },
                    what,
                    seconds: self.shared.wait.as_secs_f64(),
                });
            }
            let changed = self.shared.changed.wait_timeout(state, until - now);
            state = changed.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Communicator for Thread {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.shared.ranks
    }

    fn exchange(&self, messages: &mut [Message]) -> Result<(), RankError> {
        let (rank, ranks) = (self.rank, self.shared.ranks);
        let mut state = self.lock();
        for m in &*messages {
            state.boxes[rank * ranks + m.peer].push_back(m.out.clone());
        }
        // Before any wait: no rank holds the state while it waits for another.
        drop(state);
        self.shared.changed.notify_all();
        for m in messages {
            let sender = m.peer..m.peer + 1;
            let numbers = self.wait("a message", sender, |s| {
                s.boxes[m.peer * ranks + rank].pop_front()
            })?;
            if numbers.len() != m.into.len() {
                return Err(RankError::Length {
                    rank,
                    peer: m.peer,
                    expected: m.into.len(),
                    found: numbers.len(),
                });
            }
            m.into = numbers;
        }
        Ok(())
    }

    fn reduce(&self, words: &mut [i64], how: Reduction) -> Result<(), RankError> {
        let (rank, ranks) = (self.rank, self.shared.ranks);
        let mut state = self.lock();
        // The first rank of a reduction gives the words, the others add theirs.
        if state.given == 0 {
            state.words = words.to_vec();
        } else if state.words.len() == words.len() {
            let pairs = state.words.iter_mut().zip(&*words);
            pairs.for_each(|(a, b)| {
                *a = match how {
                    Reduction::Sum => *a + *b,
                    Reduction::Largest => (*a).max(*b),
                };
            });
        } else {
            let expected = state.words.len();
            drop(state);
            return Err(RankError::Length {
                rank,
                peer: rank,
                expected,
                found: words.len(),
            });
        }
        state.given += 1;
        let turn = state.done;
        // The last one publishes the result; the others see the number of finished reductions grow.
        if state.given == ranks {
            let s = &mut *state;
            std::mem::swap(&mut s.words, &mut s.result);
            (s.given, s.done) = (0, turn + 1);
        }
        drop(state);
        self.shared.changed.notify_all();
        // The next result cannot replace this one before this rank has added its words to it.
        self.wait("a sum over all ranks", 0..ranks, |s| {
            (s.done > turn).then(|| words.copy_from_slice(&s.result))
        })
    }

    fn abandon(&self, why: &str) {
        self.lock().gave_up.get_or_insert((self.rank, why.to_owned()));
        self.shared.changed.notify_all();
    }
}

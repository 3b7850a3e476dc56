//! Ctrl-C while a run waits for the external solver. The signal reaches the whole process, so this test is a
//! program of its own.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[path = "it/support/mod.rs"]
mod support;

use arlequin::core::{Participant, interrupt};
use arlequin_link::wire::{HEADER, Kind, Message};
use arlequin_link::{Listener, Options, Remote};
use std::io::{Read, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};
use support::{bytes_of, connect, description, patient};

static STOP: AtomicBool = AtomicBool::new(false);
/// Lock that the running test holds, because Ctrl-C ends the waits of all tests.
static ALONE: Mutex<()> = Mutex::new(());

/// Presses Ctrl-C some time after `wait` has begun; returns the error of `wait` and its delay after Ctrl-C.
fn interrupted<V: std::fmt::Debug, E: std::fmt::Display + std::fmt::Debug>(
    wait: impl FnOnce() -> Result<V, E>,
) -> (String, Duration) {
    STOP.store(false, Ordering::Relaxed);
    let user = spawn(|| {
        sleep(Duration::from_millis(300));
        STOP.store(true, Ordering::Relaxed);
        Instant::now()
    });
    let error = wait().unwrap_err().to_string();
    let pressed = user.join().unwrap();
    (error, pressed.elapsed())
}

/// Returns the link to a solver that answers the greeting and afterwards sends *working* for ever, or
/// nothing.
fn stubborn(says_working: bool) -> Remote {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    spawn(move || {
        let mut stream = connect(&address);
        let mut hello = [0; HEADER];
        stream.read_exact(&mut hello).unwrap();
        stream.write_all(&bytes_of(&description())).unwrap();
        let mut working = Message::default();
        working.begin(Kind::Working);
        let working = working.finish().to_vec();
        while !says_working || stream.write_all(&working).is_ok() {
            sleep(Duration::from_millis(20));
        }
    });
    Remote::accept("fine", &listener, patient()).unwrap()
}

#[test]
fn ctrl_c_is_heard_while_a_link_waits_or_a_peer_says_working() {
    let _alone = ALONE.lock();
    assert!(interrupt::listen(|| STOP.load(Ordering::Relaxed)));
    // No solver comes, so the wait can end at once.
    let sleeper = ["sleep", "60"].map(String::from);
    let (error, late) = interrupted(|| Remote::start("fine", &sleeper, "".as_ref(), patient()));
    assert!(
        error.contains("interrupted while 'fine' (sleep 60) was waited for: a connection"),
        "{error}"
    );
    // The command is asked to end and has a second for it.
    assert!(late < Duration::from_secs(3), "{late:?}");
    // The solver has another second to answer the step.
    for says_working in [true, false] {
        STOP.store(false, Ordering::Relaxed);
        let mut solver = stubborn(says_working);
        let (error, late) = interrupted(|| solver.advance(0.0, 0.1));
        assert!(
            error.contains("interrupted while 'fine'") && error.contains("'state' was due"),
            "{error}"
        );
        assert!(
            late > Duration::from_millis(900) && late < Duration::from_secs(4),
            "{late:?}"
        );
        STOP.store(false, Ordering::Relaxed);
    }
}

#[test]
fn a_solver_may_take_longer_to_start_than_to_answer() {
    let _alone = ALONE.lock();
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    spawn(move || {
        sleep(Duration::from_millis(800));
        let mut stream = connect(&address);
        let mut hello = [0; HEADER];
        stream.read_exact(&mut hello).unwrap();
        stream.write_all(&bytes_of(&description())).unwrap();
        let _ = stream.read_to_end(&mut Vec::new());
    });
    let options = Options {
        start: Duration::from_secs(60),
        timeout: Duration::from_millis(400),
        ..Options::default()
    };
    let mut solver = Remote::accept("fine", &listener, options).unwrap();
    let begin = Instant::now();
    let error = solver.advance(0.0, 0.1).unwrap_err().to_string();
    assert!(error.contains("'state' was due within 0.4 s"), "{error}");
    assert!(begin.elapsed() < Duration::from_secs(10));
    assert!(Options::default().start >= Duration::from_secs(30));
}

//! An external solver that fails during a run gives an error that names the fault, in time, and leaves no
//! process or file behind.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::{
    BONDS, bytes_of, chain, chain_shape, connect, coupled, description, hasty, moving, other_side, patient,
};
use arlequin::core::snapshot::Record;
use arlequin::core::{DofLayout, OwnStep, Participant, Silent};
use arlequin::fem_ref::FemField;
use arlequin::prelude::*;
use arlequin_link::{Address, Description, Listener, Remote, Verlet, serve};
use spring_chain::Chain;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

#[test]
fn a_solver_is_sent_no_more_than_it_takes() {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let peer = std::thread::spawn(move || {
        let mut stream = connect(&address);
        let little = Description {
            limit: 100,
            ..description()
        };
        stream.write_all(&bytes_of(&little)).unwrap();
        let mut received = Vec::new();
        let _ = stream.read_to_end(&mut received);
        received.len()
    });
    let mut solver = Remote::accept("fine", &listener, hasty()).unwrap();
    let error = solver.kick(&vec![0.0; BONDS + 1]).unwrap_err().to_string();
    let length = 8 * (BONDS + 1);
    assert!(
        error.contains(&format!("this side sent 'impulse' of {length} bytes")) && error.contains("takes 100"),
        "{error}"
    );
    drop(solver);
    assert!(peer.join().unwrap() < 100, "the greeting alone");
}

/// Faults of a solver in the course of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    NotANumber,
    Hangs,
    Fails,
    Leaves,
    MovesAnotherMass,
    TellsAnotherMass,
    TellsNegativeMass,
    AsksForEver,
}

/// A chain with a fault.
struct Faulty {
    chain: Verlet,
    fault: Fault,
    steps: usize,
    weighed: usize,
}

impl Participant<f64> for Faulty {
    fn name(&self) -> &str {
        self.chain.name()
    }
    fn layout(&self) -> DofLayout {
        self.chain.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.chain.nodes()
    }
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.weighed += 1;
        while self.fault == Fault::AsksForEver
            && self.weighed > 1
            && weights.kinetic.value(&Point3::origin()).is_finite()
        {}
        self.chain.weigh(weights, inertia)?;
        if self.fault == Fault::TellsAnotherMass && self.weighed > 1 {
            inertia.iter_mut().for_each(|m| *m += 1.0);
        }
        if self.fault == Fault::TellsNegativeMass && self.weighed > 1 {
            inertia[4] = -1.0;
        }
        Ok(())
    }
    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        self.steps += 1;
        if self.steps > 5 {
            match self.fault {
                Fault::Hangs => std::thread::sleep(Duration::from_secs(3)),
                Fault::Fails => {
                    return Err(Error::Unsupported {
                        model: "chain".into(),
                        what: "go on: it is out of springs".into(),
                    });
                }
                Fault::Leaves => std::process::exit(3),
                _ => {}
            }
        }
        self.chain.advance(from, step)
    }
    fn velocities(&self, out: &mut [f64]) {
        self.chain.velocities(out);
        if self.fault == Fault::NotANumber && self.steps > 5 {
            out[7] = f64::NAN;
        }
    }
    fn displacements(&self, out: &mut [f64]) {
        self.chain.displacements(out);
    }
    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        let factor = if self.fault == Fault::MovesAnotherMass {
            0.5
        } else {
            1.0
        };
        self.chain
            .kick(&impulse.iter().map(|p| factor * p).collect::<Vec<_>>())
    }
    fn save(&self) -> Result<Record<f64>> {
        self.chain.save()
    }
}

fn faulty(fault: Fault) -> Faulty {
    let chain = Verlet::new(Box::new(chain()), vec![0.0; BONDS + 1], moving()).unwrap();
    Faulty {
        chain,
        fault,
        steps: 0,
        weighed: 0,
    }
}

/// Runs with a faulty solver in another thread; returns the error and the number of steps made before.
fn run_with(fault: Fault) -> (String, usize) {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let peer = std::thread::spawn(move || serve(&address, &mut faulty(fault), &chain_shape()).is_ok());
    let solver = Remote::accept("fine", &listener, hasty()).unwrap();
    let begin = Instant::now();
    let out = match coupled(Some(Box::new(solver)), OwnStep::Ratio(2)) {
        Err(e) => (e.to_string(), 0),
        Ok(mut run) => {
            let error = run.run(100, &mut Silent).unwrap_err().to_string();
            let energy = run.last_energy().unwrap();
            assert!(energy.invariant.is_finite(), "results are kept");
            (error, run.steps())
        }
    };
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    let orderly = peer.join().unwrap();
    assert!(!orderly, "the other side hears that the run is gone");
    out
}

#[test]
fn a_solver_that_goes_wrong_in_a_run_ends_it_with_a_reason_and_leaves_the_results() {
    // Two own steps in a macro step.
    let cases = [
        (Fault::NotANumber, 2, "velocities: entry 7 is NaN"),
        (Fault::Hangs, 2, "'state' was due within 0.7 s"),
        (
            Fault::Fails,
            2,
            "failed: model 'chain' cannot go on: it is out of springs",
        ),
        (Fault::MovesAnotherMass, 0, "let it tell the mass that it moves"),
        (Fault::TellsAnotherMass, 0, "more than 5e-1 without"),
        (Fault::AsksForEver, 0, "nothing new is asked"),
        (
            Fault::TellsNegativeMass,
            0,
            "inertia of unknown 4 is -1e0, below zero",
        ),
    ];
    for (fault, steps, word) in cases {
        let (error, steps_made) = run_with(fault);
        assert!(error.contains(word), "{fault:?}: {error}");
        assert!(error.contains("'fine'"), "{fault:?}: {error}");
        assert_eq!(steps_made, steps, "{fault:?}: {error}");
    }
}

#[test]
#[ignore = "the other side of tests in this file"]
fn a_chain_that_leaves() {
    let Some(address) = arlequin_link::given() else {
        return;
    };
    serve(
        &address.parse().unwrap(),
        &mut faulty(Fault::Leaves),
        &chain_shape(),
    )
    .unwrap();
}

#[test]
#[ignore = "the other side of tests in this file"]
fn a_chain_that_leaves_soon() {
    let Some(address) = arlequin_link::given() else {
        return;
    };
    std::thread::spawn(|| {
        std::thread::sleep(Duration::from_millis(200));
        std::process::exit(3)
    });
    let mut solver = faulty(Fault::Leaves);
    serve(&address.parse().unwrap(), &mut solver, &chain_shape()).unwrap();
}

#[test]
fn a_process_that_ends_too_early_is_named_with_the_way_it_ended() {
    let command = other_side("strangers::a_chain_that_leaves");
    let solver = Remote::start("fine", &command, "".as_ref(), patient()).unwrap();
    let mut run = coupled(Some(Box::new(solver)), OwnStep::Ratio(2)).unwrap();
    let error = run.run(100, &mut Silent).unwrap_err().to_string();
    assert!(
        error.contains("ended with exit status: 3 before its 'state'"),
        "{error}"
    );
    assert_eq!(run.steps(), 2);
    // The solver leaves between two requests; it does not read any more.
    let mut solver = Remote::start(
        "fine",
        &other_side("strangers::a_chain_that_leaves_soon"),
        "".as_ref(),
        patient(),
    )
    .unwrap();
    let mut mass = vec![0.0; BONDS + 1];
    solver.weigh(&Weights::uncoupled(), &mut mass).unwrap();
    std::thread::sleep(Duration::from_millis(400));
    let error = solver.advance(0.0, 0.1).unwrap_err().to_string();
    let due = [
        "status: 3 before its reading of 'advance'",
        "status: 3 before its 'state'",
    ];
    assert!(due.iter().any(|d| error.contains(d)), "{error}");
    let start = |command: &[&str]| {
        let command: Vec<_> = command.iter().map(|w| (*w).to_owned()).collect();
        Remote::start("fine", &command, "".as_ref(), hasty())
            .unwrap_err()
            .to_string()
    };
    let error = start(&["sh", "-c", "exit 5"]);
    assert!(
        error.contains("'sh -c 'exit 5'' ended with exit status: 5 before it connected"),
        "{error}"
    );
    let error = start(&["no-such-program-here"]);
    assert!(
        error.contains("'no-such-program-here' cannot be started"),
        "{error}"
    );
    assert!(start(&[]).contains("names no program"));
}

#[cfg(target_os = "linux")]
#[test]
fn nothing_that_a_command_started_is_left() {
    let folder = std::env::temp_dir().join(format!("arlequin-link-left-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    // The command does not connect, starts another process and ignores the request to end.
    let script = "trap '' TERM; sleep 100 & echo $! > other; echo $$ > own; while true; do sleep 1; done";
    let command = ["sh", "-c", script].map(String::from);
    let begin = Instant::now();
    let error = Remote::start("fine", &command, &folder, hasty())
        .unwrap_err()
        .to_string();
    assert!(error.contains("a connection to unix:"), "{error}");
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    assert_ended(&folder, &["own", "other"]);
    // The command ends by itself and leaves a child process.
    let command = ["sh", "-c", "sleep 100 & echo $! > other; exit 5"].map(String::from);
    let error = Remote::start("fine", &command, &folder, hasty()).unwrap_err();
    assert!(
        error.to_string().contains("exit status: 5 before it connected"),
        "{error}"
    );
    assert_ended(&folder, &["other"]);
    std::fs::remove_dir_all(&folder).unwrap();
    let entries = std::fs::read_dir(std::env::temp_dir())
        .unwrap()
        .filter_map(|f| f.ok());
    let prefix = format!("arlequin-{}-", std::process::id());
    let sockets: Vec<_> = entries
        .filter(|f| f.file_name().to_string_lossy().starts_with(&prefix))
        .filter(|f| f.path().join("link").exists())
        .collect();
    // Other tests of this process may have a socket at the same time.
    assert!(sockets.len() <= 8, "{sockets:?}");
}

/// Asserts that no process with a number in one of these files is left.
#[cfg(target_os = "linux")]
fn assert_ended(folder: &std::path::Path, files: &[&str]) {
    for file in files {
        let number = std::fs::read_to_string(folder.join(file)).unwrap();
        let state = || std::fs::read_to_string(format!("/proc/{}/stat", number.trim())).unwrap_or_default();
        // A zombie is as good as ended; a killed process takes a moment to disappear.
        let remaining = || Some(state()).filter(|s| !s.is_empty() && !s.contains(") Z "));
        let until = Instant::now() + Duration::from_secs(2);
        while remaining().is_some() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(remaining(), None, "{file} {number} is still there");
    }
}

#[test]
fn positions_beside_the_overlap_are_refused_as_those_of_a_model_are() {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let peer = std::thread::spawn(move || {
        let far = Chain::new("chain", 5000.0, 1.0, BONDS, 1.0, 1.0).unwrap();
        let mut solver = Verlet::new(Box::new(far), vec![0.0; BONDS + 1], vec![0.0; BONDS + 1]).unwrap();
        serve(&address, &mut solver, &chain_shape()).unwrap();
    });
    let solver = Remote::accept("fine", &listener, patient()).unwrap();
    let field = FemField::on_line(solver.nodes().to_vec(), 1.0).unwrap();
    let error = crate::support::coupled_in(Some(Box::new(solver)), OwnStep::Same, Arc::new(field), moving())
        .unwrap_err();
    peer.join().unwrap();
    let error = error.to_string();
    assert!(
        error.contains("let both models fill the whole overlap"),
        "{error}"
    );
}

#[test]
fn addresses_of_other_machines_are_refused_unless_they_are_asked_for() {
    let parse = |text: &str| text.parse::<Address>();
    for good in [
        "tcp:127.0.0.1:7007",
        "tcp:[::1]:7007",
        "tcp-open:192.168.1.4:7007",
        "unix:/run/link",
    ] {
        assert_eq!(parse(good).unwrap().to_string(), good);
    }
    assert_eq!(parse("tcp:localhost:7").unwrap().to_string(), "tcp:127.0.0.1:7");
    for (bad, word) in [
        ("tcp:192.168.1.4:7007", "write tcp-open"),
        ("tcp:0.0.0.0:7007", "is not of this machine"),
        ("tcp:127.0.0.1", "needs an IP address and a port"),
        ("tcp:example.org:80", "needs an IP address and a port"),
        ("unix:", "has no path"),
        ("/run/link", "must be unix:PATH or tcp:127.0.0.1:PORT"),
        ("ssh:there", "must be unix:PATH"),
    ] {
        let error = parse(bad).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains(bad), "{error}");
    }
    let door = Listener::bind(&"tcp:127.0.0.1:0".parse().unwrap()).unwrap();
    let error = Listener::bind(door.address()).unwrap_err().to_string();
    assert!(error.contains("in use"), "{error}");
}

//! The other side is not what it should be: an error that names it, in time, and nothing left behind.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

mod support;

use arlequin::core::Uniform;
use arlequin::core::snapshot::Record;
use arlequin::core::{DofLayout, OwnStep, Participant, Silent};
use arlequin::fem_ref::FemField;
use arlequin::prelude::*;
use arlequin_link::wire::{HEADER, Header, Kind, Message};
use arlequin_link::{Address, Description, Fields, Listener, Options, Remote, Shape, Verlet, serve};
use spring_chain::Chain;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};
use support::{BONDS, chain, chain_shape, coupled, moving, other_side, patient};

fn hasty() -> Options {
    Options {
        timeout: Duration::from_millis(700),
        ..Options::default()
    }
}

fn description() -> Description {
    let (mut inertia, nodes) = (vec![0.0; BONDS + 1], chain().nodes().to_vec());
    chain().lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
    Description {
        limit: 1 << 20,
        offers: Fields::MOTION,
        name: "chain".into(),
        kind: "stranger".into(),
        layout: chain().layout(),
        nodes,
        shape: chain_shape(),
        inertia,
        critical_step: 1.0,
    }
}

fn bytes_of(d: &Description) -> Vec<u8> {
    let mut message = Message::default();
    d.write(&mut message);
    message.finish().to_vec()
}

fn connect(to: &Address) -> UnixStream {
    match to {
        Address::Unix(path) => UnixStream::connect(path).unwrap(),
        Address::Tcp(_) => unreachable!("private listeners are files here"),
    }
}

/// The error of a run that a stranger answers with these bytes when greeted, and how long it took.
fn greeted_with(answer: Vec<u8>, closes: bool) -> (String, Duration) {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let other = std::thread::spawn(move || {
        let mut stream = connect(&address);
        let mut hello = [0; HEADER];
        stream.read_exact(&mut hello).unwrap();
        let _ = stream.write_all(&answer);
        if !closes {
            // Until the run has had enough.
            let _ = stream.read_to_end(&mut Vec::new());
        }
    });
    let begin = Instant::now();
    let error = Remote::accept("fine", &listener, hasty())
        .unwrap_err()
        .to_string();
    let took = begin.elapsed();
    drop(listener);
    other.join().unwrap();
    (error, took)
}

/// A description with its payload changed, and the length in its header with it.
fn changed(d: &Description, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut payload = bytes_of(d).split_off(HEADER);
    change(&mut payload);
    let length = payload.len() as u64;
    let kind = Kind::Description;
    [Header { kind, length }.bytes().to_vec(), payload].concat()
}

/// A name, what a stranger answers, and words of the error.
type Case = (&'static str, Vec<u8>, &'static [&'static str]);

/// Answers that are no message of this protocol, or another one than is due.
fn other_messages() -> Vec<Case> {
    let good = description();
    let mut other_version = bytes_of(&good);
    other_version[4] = 7;
    let mut huge = bytes_of(&good);
    huge[8..16].copy_from_slice(&10_000_000_000_u64.to_le_bytes());
    let mut other_kind = bytes_of(&good);
    other_kind[6] = Kind::State as u8;
    let mut unknown_kind = bytes_of(&good);
    unknown_kind[6] = 200;
    let mut failure = Message::default();
    failure.begin(Kind::Failed).text("no licence\x1b[2J left", 100);
    vec![
        (
            "web",
            b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(),
            &["does not speak this protocol", "[72, 84, 84, 80]"],
        ),
        (
            "version",
            other_version,
            &["speaks version 7", "this side version 1"],
        ),
        ("10 GB", huge, &["10000000000 bytes", "1073741824 is the limit"]),
        ("kind", other_kind, &["sent 'state' where 'description' was due"]),
        ("unknown kind", unknown_kind, &["unknown kind 200"]),
        (
            "failure",
            failure.finish().to_vec(),
            &["failed: no licence [2J left"],
        ),
    ]
}

/// Descriptions that make no sense.
fn other_descriptions() -> Vec<Case> {
    let good = description();
    let with = |change: &dyn Fn(&mut Description)| {
        let mut d = good.clone();
        change(&mut d);
        bytes_of(&d)
    };
    vec![
        (
            "short",
            changed(&good, |b| b.truncate(b.len() - 4)),
            &["'description' of", "more were due"],
        ),
        (
            "long",
            changed(&good, |b| b.push(0)),
            &["'description' of", "were due"],
        ),
        ("empty", changed(&good, Vec::clear), &["0 bytes", "more were due"]),
        (
            "nodes",
            changed(&good, |b| b[16..24].copy_from_slice(&(1_u64 << 61).to_le_bytes())),
            &["2305843009213693952 nodes", "room for"],
        ),
        (
            "elements",
            changed(&good, |b| b[24..32].fill(255)),
            &["elements or pairs are announced"],
        ),
        ("components", changed(&good, |b| b[12] = 9), &["9 displacements"]),
        ("shape", changed(&good, |b| b[14] = 9), &["the shape is 9"]),
        (
            "position",
            with(&|d| d.nodes[3].y = f64::NAN),
            &["positions: entry 10 is NaN"],
        ),
        (
            "mass",
            with(&|d| d.inertia[4] = -1.0),
            &["inertia of unknown 4 is -1e0"],
        ),
        (
            "infinite mass",
            with(&|d| d.inertia[4] = f64::INFINITY),
            &["inertia: entry 4 is inf"],
        ),
        (
            "step",
            with(&|d| d.critical_step = f64::NAN),
            &["critical step is NaN"],
        ),
        (
            "name",
            changed(&good, |b| b[48..52].copy_from_slice(&1025_u32.to_le_bytes())),
            &["the name has 1025 bytes, more than 1024"],
        ),
        (
            "offers",
            with(&|d| d.offers = Fields(1)),
            &["velocities or displacements are not offered"],
        ),
        (
            "element",
            with(&|d| d.shape = lines_to(BONDS as u32 + 1)),
            &["names node 61 of 61"],
        ),
        (
            "section",
            with(&|d| d.shape = section(f64::NAN)),
            &["the cross-section is NaN"],
        ),
    ]
}

#[test]
fn what_a_stranger_may_say_of_itself_is_refused_by_name_and_in_time() {
    for (name, answer, words) in other_messages().into_iter().chain(other_descriptions()) {
        let (error, took) = greeted_with(answer, false);
        assert!(took < Duration::from_secs(2), "{name}: {took:?}");
        for word in [&["'fine' (unix:"], words].concat() {
            assert!(error.contains(word), "{name}: '{word}' is not in: {error}");
        }
    }
}

fn lines_to(node: u32) -> Shape {
    let mut shape = chain_shape();
    if let Shape::Mesh { connectivity, .. } = &mut shape {
        connectivity[7] = node;
    }
    shape
}

fn section(of: f64) -> Shape {
    let mut shape = chain_shape();
    if let Shape::Mesh { section, .. } = &mut shape {
        *section = of;
    }
    shape
}

#[test]
fn a_stranger_that_is_silent_or_leaves_in_the_midst_of_a_message_is_named() {
    let half = bytes_of(&description())[..500].to_vec();
    for (answer, closes, word) in [
        (Vec::new(), false, "'description' was due within 0.7 s"),
        (half.clone(), false, "'description' was due within 0.7 s"),
        (Vec::new(), true, "closed the link where 'description' was due"),
        (half, true, "closed the link where 'description' was due"),
    ] {
        let (error, took) = greeted_with(answer, closes);
        assert!(error.contains(word), "{error}");
        assert!(took < Duration::from_secs(2), "{took:?}");
    }
}

#[test]
fn who_says_that_he_is_still_at_it_may_take_longer() {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let other = std::thread::spawn(move || {
        let mut stream = connect(&address);
        for _ in 0..5 {
            std::thread::sleep(Duration::from_millis(300));
            stream
                .write_all(Message::default().begin(Kind::Working).finish())
                .unwrap();
        }
        stream.write_all(&bytes_of(&description())).unwrap();
        let _ = stream.read_to_end(&mut Vec::new());
    });
    let solver = Remote::accept("fine", &listener, hasty()).unwrap();
    assert_eq!(solver.nodes().len(), BONDS + 1);
    drop(solver);
    other.join().unwrap();
}

#[test]
fn a_solver_is_sent_no_more_than_it_takes() {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let other = std::thread::spawn(move || {
        let mut stream = connect(&address);
        let little = Description {
            limit: 100,
            ..description()
        };
        stream.write_all(&bytes_of(&little)).unwrap();
        let mut heard = Vec::new();
        let _ = stream.read_to_end(&mut heard);
        heard.len()
    });
    let mut solver = Remote::accept("fine", &listener, hasty()).unwrap();
    let error = solver.kick(&vec![0.0; BONDS + 1]).unwrap_err().to_string();
    let length = 8 * (BONDS + 1);
    assert!(
        error.contains(&format!("this side sent 'impulse' of {length} bytes")) && error.contains("takes 100"),
        "{error}"
    );
    drop(solver);
    assert!(other.join().unwrap() < 100, "the greeting alone");
}

/// What goes wrong with a solver in the course of a run.
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
            && weights.kinetic.at(&Point3::origin()).is_finite()
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

/// A run with a faulty solver in a thread of its own: the error, and the steps that were made before.
fn run_with(fault: Fault) -> (String, usize) {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let other = std::thread::spawn(move || serve(&address, &mut faulty(fault), &chain_shape()).is_ok());
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
    let orderly = other.join().unwrap();
    assert!(!orderly, "the other side hears that the run is gone");
    out
}

#[test]
fn a_solver_that_goes_wrong_in_a_run_ends_it_with_a_reason_and_leaves_the_results() {
    // Two own steps in a step of the run.
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
        let (error, made) = run_with(fault);
        assert!(error.contains(word), "{fault:?}: {error}");
        assert!(error.contains("'fine'"), "{fault:?}: {error}");
        assert_eq!(made, steps, "{fault:?}: {error}");
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
    let command = other_side("a_chain_that_leaves");
    let solver = Remote::start("fine", &command, "".as_ref(), patient()).unwrap();
    let mut run = coupled(Some(Box::new(solver)), OwnStep::Ratio(2)).unwrap();
    let error = run.run(100, &mut Silent).unwrap_err().to_string();
    assert!(
        error.contains("ended with exit status: 3 before its 'state'"),
        "{error}"
    );
    assert_eq!(run.steps(), 2);
    // It leaves while nothing is asked of it: then it does not read any more.
    let mut solver = Remote::start(
        "fine",
        &other_side("a_chain_that_leaves_soon"),
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
    // It does not connect, starts another process and takes no notice of being asked to leave.
    let script = "trap '' TERM; sleep 100 & echo $! > other; echo $$ > own; while true; do sleep 1; done";
    let command = ["sh", "-c", script].map(String::from);
    let begin = Instant::now();
    let error = Remote::start("fine", &command, &folder, hasty())
        .unwrap_err()
        .to_string();
    assert!(error.contains("a connection to unix:"), "{error}");
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    for file in ["own", "other"] {
        let number = std::fs::read_to_string(folder.join(file)).unwrap();
        // One that init has yet to reap does nothing any more.
        let state = std::fs::read_to_string(format!("/proc/{}/stat", number.trim())).unwrap_or_default();
        let gone = state.is_empty() || state.contains(") Z ");
        assert!(gone, "{file} {number} is still there: {state}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
    let left = std::fs::read_dir(std::env::temp_dir())
        .unwrap()
        .filter_map(|f| f.ok());
    let mine = format!("arlequin-{}-", std::process::id());
    let sockets: Vec<_> = left
        .filter(|f| f.file_name().to_string_lossy().starts_with(&mine))
        .filter(|f| f.path().join("link").exists())
        .collect();
    // Other tests of this process may have one at the moment.
    assert!(sockets.len() <= 8, "{sockets:?}");
}

#[test]
fn positions_beside_the_overlap_are_refused_as_those_of_a_model_are() {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let other = std::thread::spawn(move || {
        let far = Chain::new("chain", 5000.0, 1.0, BONDS, 1.0, 1.0).unwrap();
        let mut solver = Verlet::new(Box::new(far), vec![0.0; BONDS + 1], vec![0.0; BONDS + 1]).unwrap();
        serve(&address, &mut solver, &chain_shape()).unwrap();
    });
    let solver = Remote::accept("fine", &listener, patient()).unwrap();
    let field = FemField::on_line(solver.nodes().to_vec(), 1.0).unwrap();
    let error =
        support::coupled_in(Some(Box::new(solver)), OwnStep::Same, Arc::new(field), moving()).unwrap_err();
    other.join().unwrap();
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
    let door = Listener::at(&"tcp:127.0.0.1:0".parse().unwrap()).unwrap();
    let error = Listener::at(door.address()).unwrap_err().to_string();
    assert!(error.contains("in use"), "{error}");
}

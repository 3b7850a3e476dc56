//! A wrong greeting of the external solver gives an error that names the fault, in time.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::{BONDS, bytes_of, chain_shape, connect, description, hasty};
use arlequin::core::Participant;
use arlequin_link::wire::{HEADER, Header, Kind, Message};
use arlequin_link::{Description, Fields, Listener, Remote, Shape};
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// Returns the error of a run whose greeting a wrong solver answers with these bytes, and the time until
/// then.
fn greeted_with(answer: Vec<u8>, closes: bool) -> (String, Duration) {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let peer = std::thread::spawn(move || {
        let mut stream = connect(&address);
        let mut hello = [0; HEADER];
        stream.read_exact(&mut hello).unwrap();
        let _ = stream.write_all(&answer);
        if !closes {
            // Reads until the run closes the connection.
            let _ = stream.read_to_end(&mut Vec::new());
        }
    });
    let begin = Instant::now();
    let error = Remote::accept("fine", &listener, hasty())
        .unwrap_err()
        .to_string();
    let took = begin.elapsed();
    drop(listener);
    peer.join().unwrap();
    (error, took)
}

/// Returns a description with a changed payload and the matching length in its header.
fn changed(d: &Description, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut payload = bytes_of(d).split_off(HEADER);
    change(&mut payload);
    let length = payload.len() as u64;
    let kind = Kind::Description;
    [Header { kind, length }.bytes().to_vec(), payload].concat()
}

/// Name of a case, the answer of the solver, and words of the error.
type Case = (&'static str, Vec<u8>, &'static [&'static str]);

/// Answers that are no message of this protocol, or not the expected one.
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

/// Descriptions of models that cannot exist.
fn other_descriptions() -> Vec<Case> {
    let good = description();
    let described = |change: &dyn Fn(&mut Description)| {
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
            described(&|d| d.nodes[3].y = f64::NAN),
            &["positions: entry 10 is NaN"],
        ),
        (
            "mass",
            described(&|d| d.inertia[4] = -1.0),
            &["inertia of unknown 4 is -1e0"],
        ),
        (
            "infinite mass",
            described(&|d| d.inertia[4] = f64::INFINITY),
            &["inertia: entry 4 is inf"],
        ),
        (
            "step",
            described(&|d| d.critical_step = f64::NAN),
            &["critical step is NaN"],
        ),
        (
            "name",
            changed(&good, |b| b[48..52].copy_from_slice(&1025_u32.to_le_bytes())),
            &["the name has 1025 bytes, more than 1024"],
        ),
        (
            "offers",
            described(&|d| d.offers = Fields(1)),
            &["velocities or displacements are not offered"],
        ),
        (
            "element",
            described(&|d| d.shape = lines_to(BONDS as u32 + 1)),
            &["names node 61 of 61"],
        ),
        (
            "section",
            described(&|d| d.shape = section(f64::NAN)),
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

fn section(value: f64) -> Shape {
    let mut shape = chain_shape();
    if let Shape::Mesh { section, .. } = &mut shape {
        *section = value;
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
    let peer = std::thread::spawn(move || {
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
    peer.join().unwrap();
}

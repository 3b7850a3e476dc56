//! Mutated messages from the external solver are read or refused with bounded memory, and messages as they
//! are written can be read again.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use arlequin::core::geometry::{Cell, Polyhedron};
use arlequin::core::nalgebra::Point3;
use arlequin::core::snapshot::Record;
use arlequin::core::{DofLayout, Share};
use arlequin_link::wire::{Content, HEADER, Header, Kind, Message};
use arlequin_link::{Ask, Description, Element, Fields, Places, Shape, read_record, write_record};
use proptest::prelude::*;
use reader_fuzz::Corpus;

reader_fuzz::counted!();

fn description(n: usize, particles: bool, rotations: usize) -> Description {
    let layout = DofLayout {
        nodes: n,
        components: 3,
        rotations,
    };
    let ends = (1..n as u32).map(|k| [k - 1, k]);
    Description {
        limit: 1 << 20,
        offers: Fields::MOTION.and(Fields::INVARIANT),
        name: "näme".into(),
        kind: "fuzz".into(),
        layout,
        nodes: (0..n).map(|k| Point3::new(k as f64, 0.5, -1e-9)).collect(),
        shape: if particles {
            Shape::Particles {
                volumes: vec![0.5; n],
                pairs: ends.collect(),
            }
        } else {
            Shape::Mesh {
                element: Element::Line,
                connectivity: ends.flatten().collect(),
                section: 2.0,
            }
        },
        inertia: (0..layout.dofs()).map(|k| 1.0 + k as f64).collect(),
        critical_step: f64::INFINITY,
    }
}

fn written(write: impl FnOnce(&mut Message)) -> Vec<u8> {
    let mut message = Message::default();
    write(&mut message);
    message.finish().to_vec()
}

fn cube() -> Cell<f64> {
    let p = [0, 1, 3, 2, 4, 5, 7, 6]
        .map(|k| Point3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)));
    Cell::Polyhedron(Polyhedron::hexahedron(p))
}

fn seeds() -> Vec<Vec<u8>> {
    let line = Cell::Segment {
        ends: [Point3::origin(), Point3::new(1.0, 0.0, 0.0)],
        section: 1.0,
    };
    let record = Record {
        numbers: vec![1.0, f64::NAN],
        integers: vec![3, u64::MAX],
    };
    vec![
        written(|m| description(7, true, 3).write(m)),
        written(|m| description(9, false, 0).write(m)),
        written(|m| Ask::write_point(m, Share::Kinetic, &Point3::origin())),
        written(|m| Ask::write_cell(m, Share::Internal, &line)),
        written(|m| Ask::write_cell(m, Share::External, &cube())),
        written(|m| write_record(m, Kind::Record, &record)),
        written(|m| {
            m.begin(Kind::Failed).text("no licence", 100);
        }),
    ]
}

/// Reads a message as either end would; returns whether it was accepted.
fn read(bytes: &[u8]) -> bool {
    let Some((head, payload)) = bytes.split_at_checked(HEADER) else {
        return false;
    };
    let Ok(header) = Header::read(head.try_into().unwrap(), "fuzz") else {
        return false;
    };
    let Some(body) = usize::try_from(header.length).ok().and_then(|n| payload.get(..n)) else {
        return false;
    };
    let mut content = Content::new("fuzz", header.kind, body);
    match header.kind {
        Kind::Description => Description::read(content).is_ok(),
        Kind::Ask => Ask::read(content).is_ok_and(|a| a.count() < 1 << 20),
        Kind::Record => read_record(content).is_ok(),
        Kind::Failed => content
            .text("the reason", 100)
            .and_then(|_| content.end())
            .is_ok(),
        _ => false,
    }
}

#[test]
fn mutated_messages_are_read_or_refused() {
    let _alone = ALONE.lock();
    let corpus = Corpus {
        seeds: seeds(),
        tokens: &[
            "ARLQ",
            "\0\0\0\0",
            "\u{1}\0",
            "A\0",
            "B\0",
            "E\0",
            "H\0",
            "\0\0\u{7f}",
        ],
        floor: 1 << 16,
        per_byte: 40,
    };
    corpus.run("link", &allocated, &read);
}

/// Messages with mutated content but right lengths are read or refused; mutation of whole messages seldom
/// keeps the lengths right.
#[test]
fn messages_of_the_right_length_with_mutated_content_are_read_or_refused() {
    let _alone = ALONE.lock();
    let bodies = seeds()
        .into_iter()
        .map(|s| s[6..8].iter().chain(&s[HEADER..]).copied().collect());
    let corpus = Corpus {
        seeds: bodies.collect(),
        tokens: &["\0\0\0\0\0\0\0\0", "\u{1}\0\0\0", "\0\0\0\0\0\0\u{7f}", "A\0"],
        floor: 1 << 16,
        per_byte: 40,
    };
    corpus.run("link content", &allocated, &|bytes| {
        let Some((kind, body)) = bytes.split_at_checked(2) else {
            return false;
        };
        let Some(kind) = Kind::of(u16::from_le_bytes([kind[0], kind[1]])) else {
            return false;
        };
        let length = body.len() as u64;
        read(&[&Header { kind, length }.bytes(), body].concat())
    });
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(200))]

    #[test]
    fn headers_are_read_as_they_are_written(k in 0_usize..17, length: u64) {
        let kind = (1..=9).chain(65..=72).filter_map(Kind::of).nth(k).unwrap();
        let header = Header { kind, length };
        prop_assert_eq!(Header::read(&header.bytes(), "p").unwrap(), header);
    }

    #[test]
    fn numbers_are_read_as_they_are_written(x in proptest::collection::vec(-1e300_f64..1e300, 0..200), word in ".{0,40}") {
        let bytes = written(|m| { m.begin(Kind::State).u64(x.len() as u64).numbers(&x).text(&word, 1024); });
        let mut content = Content::new("p", Kind::State, &bytes[HEADER..]);
        let count = content.count("numbers", 8).unwrap();
        let plain: String = word.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        prop_assert_eq!(content.vector("numbers", count).unwrap(), x);
        prop_assert_eq!(content.text("a word", 1024).unwrap(), plain);
        content.end().unwrap();
    }

    #[test]
    fn descriptions_are_read_as_they_are_written(n in 1_usize..50, particles: bool, turns: bool) {
        let d = description(n, particles, if turns { 3 } else { 0 });
        let bytes = written(|m| d.write(m));
        prop_assert_eq!(Description::read(Content::new("p", Kind::Description, &bytes[HEADER..])).unwrap(), d);
    }

    #[test]
    fn records_are_read_with_the_bits_they_are_written_with(bits: Vec<u64>, integers: Vec<u64>) {
        let record = Record { numbers: bits.iter().map(|b| f64::from_bits(*b)).collect(), integers };
        let bytes = written(|m| write_record(m, Kind::Restore, &record));
        let decoded = read_record(Content::new("p", Kind::Restore, &bytes[HEADER..])).unwrap();
        prop_assert_eq!(decoded.numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>(), bits);
        prop_assert_eq!(decoded.integers, record.integers);
    }
}

#[test]
fn cells_are_read_as_they_are_written() {
    let _alone = ALONE.lock();
    let bytes = written(|m| Ask::write_cell(m, Share::Kinetic, &cube()));
    let ask = Ask::read(Content::new("p", Kind::Ask, &bytes[HEADER..])).unwrap();
    let Places::Cells(cells) = &ask.places else {
        panic!("{ask:?}")
    };
    assert_eq!((ask.share, ask.count()), (Share::Kinetic, 1));
    assert_eq!(cells[0].corners(), cube().corners());
}

//! The cost of an exchange over a link, beside 50 µs + bytes/2.5 GB/s: a step (velocities, displacements and
//! invariant come back) and an impulse, with a solver that does nothing in another thread.
//!
//! `cargo bench -p arlequin-link`; the shortest of many, as others may load the machine.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use arlequin_core::nalgebra::Point3;
use arlequin_core::{DofLayout, Participant, Result, Weights};
use arlequin_link::{Address, Listener, Options, Remote, Shape, serve};
use std::time::{Duration, Instant};

/// Numbers that stay as they are.
struct Idle(Vec<Point3<f64>>, Vec<f64>);

impl Participant<f64> for Idle {
    fn name(&self) -> &str {
        "idle"
    }
    fn layout(&self) -> DofLayout {
        DofLayout {
            nodes: self.0.len(),
            components: 3,
            rotations: 0,
        }
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.0
    }
    fn weigh(&mut self, _: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        inertia.fill(1.0);
        Ok(())
    }
    fn advance(&mut self, _: f64, _: f64) -> Result<()> {
        Ok(())
    }
    fn velocities(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.1);
    }
    fn displacements(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.1);
    }
    fn kick(&mut self, _: &[f64]) -> Result<()> {
        Ok(())
    }
    fn invariant(&self) -> Option<f64> {
        Some(0.0)
    }
}

/// A solver of so many nodes behind a link at an address.
fn linked(address: Option<&str>, nodes: usize) -> Remote {
    let parse = |a: &str| a.parse::<Address>().expect("an address");
    let listener = match address {
        Some(a) => Listener::bind(&parse(a)),
        None => Listener::private(),
    };
    let listener = listener.expect("a door");
    let at = listener.address().clone();
    std::thread::spawn(move || {
        let points: Vec<_> = (0..nodes).map(|k| Point3::new(k as f64, 0.0, 0.0)).collect();
        let shape = Shape::Particles {
            volumes: vec![1.0; nodes],
            pairs: Vec::new(),
        };
        serve(&at, &mut Idle(points, vec![0.0; 3 * nodes]), &shape)
    });
    Remote::accept("idle", &listener, Options::default()).expect("a link")
}

fn shortest(mut what: impl FnMut()) -> Duration {
    (0..400)
        .map(|_| {
            let begin = Instant::now();
            what();
            begin.elapsed()
        })
        .min()
        .unwrap_or_default()
}

fn main() {
    println!("exchange       unknowns     bytes  shortest    bound");
    for (name, address) in [("unix", None), ("tcp", Some("tcp:127.0.0.1:0"))] {
        for nodes in [1, 1_000, 10_000, 100_000] {
            let mut solver = linked(address, nodes);
            let zero = vec![0.0; 3 * nodes];
            let step = shortest(|| solver.advance(0.0, 1.0).expect("a step"));
            let impulse = shortest(|| solver.kick(&zero).expect("an impulse"));
            for (what, took, bytes) in [
                ("step", step, 2 * 24 * nodes + 16 + 24 + 32),
                ("impulse", impulse, 24 * nodes + 32),
            ] {
                let bound = 50.0 + bytes as f64 / 2.5e3;
                println!(
                    "{name:<5} {what:<8} {:>8} {bytes:>9} {:>6.1} µs {bound:>6.1} µs",
                    3 * nodes,
                    took.as_secs_f64() * 1e6
                );
            }
        }
    }
}

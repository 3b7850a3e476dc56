//! A solver in single precision is not mistaken for one with wrong masses.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::{BONDS, chain, chain_shape, coupled_in, moving, patient};
use arlequin::core::{OwnStep, Participant, Silent};
use arlequin::prelude::*;
use arlequin_link::{Listener, Remote, serve};

/// Chain of unit masses and springs with velocity Verlet in 32-bit numbers.
struct Single {
    nodes: Vec<Point3<f64>>,
    shares: Vec<f32>,
    inertia: Vec<f32>,
    q: Vec<f32>,
    v: Vec<f32>,
    /// Ratio of the velocity change that an impulse causes to the correct one.
    answer: f32,
    time: f64,
}

fn single(speed: f32, answer: f32) -> Single {
    Single {
        nodes: chain().nodes().to_vec(),
        shares: vec![1.0; BONDS],
        inertia: Vec::new(),
        q: vec![0.0; BONDS + 1],
        v: moving().iter().map(|v| speed + *v as f32).collect(),
        answer,
        time: 0.0,
    }
}

impl Single {
    fn half_kick(&mut self, step: f32) {
        for (bond, share) in self.shares.iter().enumerate() {
            let impulse = 0.5 * step * share * (self.q[bond + 1] - self.q[bond]);
            self.v[bond] += impulse / self.inertia[bond];
            self.v[bond + 1] -= impulse / self.inertia[bond + 1];
        }
    }
}

fn wide(from: &[f32], out: &mut [f64]) {
    out.iter_mut().zip(from).for_each(|(o, x)| *o = f64::from(*x));
}

impl Participant<f64> for Single {
    fn name(&self) -> &str {
        "single"
    }
    fn layout(&self) -> DofLayout {
        chain().layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.inertia = vec![0.0; BONDS + 1];
        for (bond, ends) in self.nodes.windows(2).enumerate() {
            let section = 1.0;
            let cell = arlequin::core::geometry::Cell::Segment {
                ends: [ends[0], ends[1]],
                section,
            };
            self.shares[bond] = weights.internal.mean(&cell) as f32;
            let half = 0.5 * weights.kinetic.mean(&cell) as f32;
            self.inertia[bond] += half;
            self.inertia[bond + 1] += half;
        }
        wide(&self.inertia, inertia);
        Ok(())
    }
    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        assert!(
            (from - self.time).abs() < 1e-9,
            "told to go on from {from} s at {} s",
            self.time
        );
        self.time += step;
        let step = step as f32;
        self.half_kick(step);
        self.q.iter_mut().zip(&self.v).for_each(|(q, v)| *q += step * v);
        self.half_kick(step);
        Ok(())
    }
    fn velocities(&self, out: &mut [f64]) {
        wide(&self.v, out);
    }
    fn displacements(&self, out: &mut [f64]) {
        wide(&self.q, out);
    }
    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        for ((v, p), m) in self.v.iter_mut().zip(impulse).zip(&self.inertia) {
            *v += self.answer * (*p as f32) / m;
        }
        Ok(())
    }
    fn critical_step(&self) -> Option<f64> {
        Some(1.0)
    }
}

fn behind_a_link(mut solver: Single) -> (Remote, std::thread::JoinHandle<bool>) {
    let listener = Listener::private().unwrap();
    let address = listener.address().clone();
    let peer = std::thread::spawn(move || serve(&address, &mut solver, &chain_shape()).is_ok());
    (Remote::accept("single", &listener, patient()).unwrap(), peer)
}

#[test]
fn a_chain_in_single_precision_runs_and_is_ours_to_its_digits() {
    let (solver, peer) = behind_a_link(single(0.0, 1.0));
    let own_step = OwnStep::Same;
    let mut remote = coupled_in(Some(Box::new(solver)), own_step, chain().fine_field(), Vec::new()).unwrap();
    let mut local = coupled_in(None, own_step, chain().fine_field(), moving()).unwrap();
    for run in [&mut remote, &mut local] {
        run.run(500, &mut Silent).unwrap();
    }
    let gap = crate::support::gap(&remote, &local);
    assert!(gap < 1e-4 && gap > 1e-9, "{gap:e}");
    drop(remote);
    assert!(peer.join().unwrap());
}

/// Impulses that round-off may hide show nothing of the mass and are accepted; the first impulse that is
/// large enough is checked.
#[test]
fn faint_impulses_on_a_fast_solver_are_let_pass_and_strong_ones_with_another_mass_are_not() {
    for (answer, refused) in [(1.0, false), (1.00002, true), (0.5, true)] {
        let (mut solver, peer) = behind_a_link(single(1e3, answer));
        let mut mass = vec![0.0; BONDS + 1];
        solver.weigh(&Weights::uncoupled(), &mut mass).unwrap();
        let kick = |speed: f64| mass.iter().map(|m| m * speed).collect::<Vec<_>>();
        // A unit in the last place of the velocity is 6e-5.
        for faint in [1e-6, 1e-5, 1e-4] {
            solver.kick(&kick(faint)).unwrap();
        }
        let outcome = solver.kick(&kick(1e5)).map_err(|e| e.to_string());
        assert_eq!(outcome.is_err(), refused, "{answer}: {outcome:?}");
        if let Err(text) = outcome {
            assert!(text.contains("let it tell the mass that it moves"), "{text}");
        }
        drop(solver);
        peer.join().unwrap();
    }
}

//! Solvers that lose, create or hide energy are warned of, and end the run if the amount is large; sound ones
//! are not.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::core::snapshot::Record;
use arlequin::core::{Error, L2, Observer, Participant, Silent, StepReport, Suspect, Warning};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use arlequin::prelude::*;
use spring_chain::{Chain, ChainSolver};
use std::ops::ControlFlow;
use std::sync::Arc;

const BONDS: usize = 60;

fn chain(mass: f64) -> Chain {
    Chain::new("chain", -20.0, 1.0, BONDS, mass, 1.0).unwrap()
}

/// Fault of a solver.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    Sound,
    /// The solver takes this share of each impulse.
    Takes(f64),
    /// Nodes move by this share of the velocity change.
    Moves(f64),
    /// Velocities relative to the mean grow by this share in each step.
    Heats(f64),
    /// The solver ignores a restored state.
    Forgets,
    /// Goes back to where it was, at rest.
    Stops,
    /// Has its nodes elsewhere.
    Elsewhere,
}

/// The chain as a solver with a fault. `tells`: whether it reports its energy.
struct Faulty {
    solver: ChainSolver,
    inertia: Vec<f64>,
    nodes: Vec<Point3<f64>>,
    fault: Fault,
    tells: bool,
    heat: Vec<f64>,
}

impl Faulty {
    fn new(mass: f64, fault: Fault, tells: bool) -> Self {
        let v: Vec<f64> = (0..=BONDS)
            .map(|k| (0.3 * k as f64).sin() + 0.2 * (1.9 * k as f64).cos())
            .collect();
        let solver = ChainSolver::new(chain(mass), vec![0.0; v.len()], v.clone()).unwrap();
        let shift = if fault == Fault::Elsewhere { 0.5 } else { 0.0 };
        let moved = |x: &Point3<f64>| Point3::new(x.x + shift, x.y, x.z);
        Self {
            nodes: solver.nodes().iter().map(moved).collect(),
            solver,
            inertia: vec![0.0; v.len()],
            heat: vec![0.0; v.len()],
            fault,
            tells,
        }
    }
}

impl Participant<f64> for Faulty {
    fn name(&self) -> &str {
        "chain"
    }
    fn layout(&self) -> DofLayout {
        self.solver.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.solver.weigh(weights, inertia)?;
        self.inertia.copy_from_slice(inertia);
        Ok(())
    }
    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        self.solver.advance(from, step)?;
        if let Fault::Heats(share) = self.fault {
            self.solver.velocities(&mut self.heat);
            let nodes = self.heat.iter().zip(&self.inertia);
            let [p, m] = nodes.fold([0.0; 2], |[p, m], (v, w)| [p + v * w, m + w]);
            let nodes = self.heat.iter_mut().zip(&self.inertia);
            nodes.for_each(|(v, w)| *v = share * w * (*v - p / m));
            self.solver.kick(&self.heat)?;
        }
        Ok(())
    }
    fn velocities(&self, out: &mut [f64]) {
        self.solver.velocities(out);
    }
    fn displacements(&self, out: &mut [f64]) {
        self.solver.displacements(out);
    }
    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        match self.fault {
            Fault::Takes(share) => {
                let part: Vec<f64> = impulse.iter().map(|p| share * p).collect();
                self.solver.kick(&part)
            }
            Fault::Moves(share) => {
                self.solver.kick(impulse)?;
                let mut record = self.solver.save()?;
                for (k, p) in impulse.iter().enumerate() {
                    record.numbers[k] += share * p / self.inertia[k];
                }
                self.solver.restore(&record)
            }
            _ => self.solver.kick(impulse),
        }
    }
    fn accelerations(&self, out: &mut [f64]) -> bool {
        self.solver.accelerations(out)
    }
    fn invariant(&self) -> Option<f64> {
        self.tells.then(|| self.solver.invariant()).flatten()
    }
    fn save(&self) -> Result<Record<f64>> {
        self.solver.save()
    }
    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        if self.fault == Fault::Forgets {
            return Ok(());
        }
        let mut record = from.clone();
        if self.fault == Fault::Stops {
            let n = self.inertia.len();
            record.numbers[n..2 * n].fill(0.0);
        }
        self.solver.restore(&record)
    }
}

/// Returns a bar from −100 to 0 coupled with a moving solver that begins at −20.
fn coupled(mass: f64, fault: Fault, tells: bool) -> Result<Coupled<f64>> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Arc::new(Slab::between(point(0.0), point(-20.0))?);
    let coarse = Weights::from_weight(Arc::new(Ramp::new(slab, Profile::Cubic, 1e-6)?));
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let bar = FemModel::new(
        "bar",
        generate::bar(-100.0, 0.0, 10, 1.0)?,
        Elastic::new(1.0, 0.0, 1.0)?,
    )?;
    let field = chain(1.0).fine_field();
    let solver = Faulty::new(mass, fault, tells);
    let solver = Subdomain::participant(Box::new(solver), field, fine)?;
    let solver = solver.with_partition(Partition::Unchecked);
    let bar = Subdomain::coarse(bar, coarse).with_partition(Partition::Unchecked);
    let mediator = Arc::new(FemField::new(generate::bar(-20.0, 0.0, 2, 1.0)?));
    let tie = InterfaceSpec::new("overlap", 0, 1, mediator, L2);
    Coupled::new(vec![bar, solver], vec![tie], TimeStep::Seconds(0.5), None)
}

/// Observer that keeps each warning with the step after which it came.
#[derive(Default)]
struct Listener {
    heard: Vec<(usize, Warning)>,
    steps: usize,
}

impl Observer<f64> for Listener {
    fn warning(&mut self, warning: &Warning) {
        self.heard.push((self.steps, warning.clone()));
    }
    fn observe(&mut self, _: &Coupled<f64>, report: &StepReport<f64>) -> Result<ControlFlow<()>> {
        self.steps = report.step;
        Ok(ControlFlow::Continue(()))
    }
}

/// Warnings reach an observer once each; those of the set-up come before the first step.
#[test]
fn observers_hear_each_warning_once_the_moment_it_happens() {
    let mut listener = Listener::default();
    let mut run = coupled(1.0, Fault::Takes(0.99), false).unwrap();
    run.run(2_000, &mut listener).unwrap();
    assert_eq!(listener.heard.len(), run.warnings().len());
    assert!(matches!(&listener.heard[0], (0, Warning::EnergyUnknown { model }) if model == "chain"));
    let first = |w: &&(usize, Warning)| matches!(w.1, Warning::ImpulseMissed { .. });
    assert_eq!(listener.heard.iter().find(first).map(|w| w.0), Some(0));
    // A restored run repeats no warning.
    let saved = run.snapshot().unwrap();
    let mut again = Listener::default();
    let mut restored = coupled(1.0, Fault::Takes(0.99), false).unwrap();
    restored.restore(&saved).unwrap();
    restored.run(100, &mut again).unwrap();
    assert!(again.heard.is_empty() && restored.warnings().len() == run.warnings().len());
}

/// E.1: a run that loses much energy ends by name, one that loses little is warned of, and a sound one has no
/// warning.
#[test]
fn lossy_solvers_are_warned_of_and_ended_by_name_and_sound_ones_are_not() {
    let mut sound = coupled(1.0, Fault::Sound, true).unwrap();
    sound.run(20_000, &mut Silent).unwrap();
    assert!(
        sound.drift() < 1e-12 && sound.warnings().is_empty(),
        "{:?}",
        sound.warnings()
    );
    for fault in [Fault::Takes(0.0), Fault::Takes(0.5)] {
        let mut run = coupled(1.0, fault, true).unwrap();
        let ended = run.run(20_000, &mut Silent).unwrap_err();
        assert!(
            matches!(&ended, Error::EnergyLoss { .. } | Error::EnergyGrowth { .. }),
            "{fault:?}: {ended}"
        );
    }
    for fault in [Fault::Takes(1.0 - 1e-6), Fault::Moves(1e-4)] {
        let mut run = coupled(1.0, fault, true).unwrap();
        run.run(2_000, &mut Silent).unwrap();
        let drift = run.warnings().iter().find_map(|w| match w {
            Warning::EnergyDrift {
                share,
                limit,
                suspect: Suspect::Solver(s),
                ..
            } if s == "chain" => Some([*share, *limit]),
            _ => None,
        });
        let [share, limit] = drift.unwrap();
        assert!(
            share > 1e-9 && share < 0.05 && limit < 1e-8,
            "{fault:?}: {share:e}"
        );
        assert!((share / run.drift() - 1.0).abs() < 1e-12, "{share:e}");
    }
}

/// E.1: a solver that says its energy and loses it in its own steps ends as a loss, above 5 % of all there
/// was, and says how much.
#[test]
fn a_solver_that_cools_down_ends_as_a_loss_of_energy() {
    let mut run = coupled(1.0, Fault::Heats(-1e-3), true).unwrap();
    let ended = run.run(20_000, &mut Silent).unwrap_err();
    let Error::EnergyLoss {
        missing,
        bound,
        percent,
        ..
    } = &ended
    else {
        panic!("{ended}")
    };
    assert!(
        missing > bound && *missing < 1.5 * bound && (*percent - 5.0).abs() < 1e-12,
        "{ended}"
    );
    assert!(
        run.warnings()
            .iter()
            .any(|w| matches!(w, Warning::EnergyDrift { .. }))
    );
}

/// E.2: the report of a solver without an invariant says that its energy is unknown, and its impulses are
/// checked.
#[test]
fn a_solver_that_tells_no_energy_is_named_and_held_to_its_impulses() {
    let mut sound = coupled(1.0, Fault::Sound, false).unwrap();
    sound.run(2_000, &mut Silent).unwrap();
    let unknown = Warning::EnergyUnknown {
        model: "chain".into(),
    };
    assert_eq!(sound.warnings(), std::slice::from_ref(&unknown));
    assert_eq!(sound.unknown_energies(), ["chain"]);
    assert!(
        unknown
            .to_string()
            .starts_with("the energy of 'chain' is not known")
    );
    // Energy created within its steps cannot be seen; the warning that its energy is unknown remains.
    let mut hot = coupled(1.0, Fault::Heats(1e-3), false).unwrap();
    hot.run(1_000, &mut Silent).unwrap();
    assert!(hot.warnings().contains(&unknown));
    for share in [0.0, 0.5] {
        let mut run = coupled(1.0, Fault::Takes(share), false).unwrap();
        let ended = run.run(2_000, &mut Silent).unwrap_err();
        let Error::ImpulseMissed {
            model, share: missed, ..
        } = ended
        else {
            panic!("{ended}");
        };
        assert!(
            model == "chain" && (missed - (1.0 - share)).abs() < 1e-9,
            "{missed}"
        );
        assert!(run.steps() <= 10);
    }
    let mut run = coupled(1.0, Fault::Takes(0.99), false).unwrap();
    run.run(2_000, &mut Silent).unwrap();
    let missed = |w: &&Warning| matches!(w, Warning::ImpulseMissed { model, share, .. } if model == "chain" && (share - 0.01).abs() < 1e-9);
    assert!(
        run.warnings().iter().find(missed).is_some(),
        "{:?}",
        run.warnings()
    );
}

/// E.3: a run resumes with the solver that was saved, and with no other.
#[test]
fn another_solver_than_the_one_of_the_checkpoint_is_refused_by_name() {
    let mut first = coupled(1.0, Fault::Sound, true).unwrap();
    first.run(50, &mut Silent).unwrap();
    let saved = first.snapshot().unwrap();
    let mut restored = coupled(1.0, Fault::Sound, true).unwrap();
    restored.restore(&saved).unwrap();
    for run in [&mut first, &mut restored] {
        run.run(50, &mut Silent).unwrap();
    }
    let state = |c: &Coupled<f64>| c.subdomains()[1].state().q.clone();
    assert_eq!(state(&first), state(&restored));
    for (mass, fault, words) in [
        (2.0, Fault::Sound, "'chain': its inertia of unknown"),
        (1.0, Fault::Forgets, "'chain': its displacement of unknown"),
        (1.0, Fault::Stops, "'chain': its velocity of unknown"),
        (1.0, Fault::Elsewhere, "'chain': its centre of mass along axis"),
    ] {
        let mut refusing = coupled(mass, fault, true).unwrap();
        let refused = refusing.restore(&saved).unwrap_err();
        assert!(matches!(refused, Error::NotRestored { .. }), "{refused}");
        let text = refused.to_string();
        assert!(text.contains(words) && text.contains("another solver"), "{text}");
    }
}

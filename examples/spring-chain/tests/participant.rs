//! The chain as a solver gives the same results as the chain as a model.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use arlequin::core::snapshot::Record;
use arlequin::core::{L2, OwnStep, Participant, Silent, conformance};
use arlequin::fem_ref::{Elastic, FemField, FemModel, generate};
use arlequin::prelude::*;
use spring_chain::{Chain, ChainSolver};

const BONDS: usize = 60;

fn chain() -> Chain {
    Chain::new("chain", -20.0, 1.0, BONDS, 1.0, 1.0).unwrap()
}

/// The chain as a solver that does not report its energy.
struct Mute(ChainSolver);

impl Participant<f64> for Mute {
    fn name(&self) -> &str {
        self.0.name()
    }
    fn layout(&self) -> DofLayout {
        self.0.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.0.nodes()
    }
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.0.weigh(weights, inertia)
    }
    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        self.0.advance(from, step)
    }
    fn velocities(&self, out: &mut [f64]) {
        self.0.velocities(out);
    }
    fn displacements(&self, out: &mut [f64]) {
        self.0.displacements(out);
    }
    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        self.0.kick(impulse)
    }
    fn accelerations(&self, out: &mut [f64]) -> bool {
        self.0.accelerations(out)
    }
    fn critical_step(&self) -> Option<f64> {
        self.0.critical_step()
    }
    fn save(&self) -> Result<Record<f64>> {
        self.0.save()
    }
    fn restore(&mut self, from: &Record<f64>) -> Result<()> {
        self.0.restore(from)
    }
}

/// The chain as a solver that makes other steps than requested, or reports wrong accelerations.
struct Changed {
    solver: ChainSolver,
    steps: &'static [f64],
    force: f64,
}

impl Participant<f64> for Changed {
    fn name(&self) -> &str {
        self.solver.name()
    }
    fn layout(&self) -> DofLayout {
        self.solver.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.solver.nodes()
    }
    fn weigh(&mut self, weights: &Weights<f64>, inertia: &mut [f64]) -> Result<()> {
        self.solver.weigh(weights, inertia)
    }
    fn advance(&mut self, from: f64, step: f64) -> Result<()> {
        let mut steps = self.steps.iter();
        steps.try_for_each(|share| self.solver.advance(from, share * step))
    }
    fn velocities(&self, out: &mut [f64]) {
        self.solver.velocities(out);
    }
    fn displacements(&self, out: &mut [f64]) {
        self.solver.displacements(out);
    }
    fn kick(&mut self, impulse: &[f64]) -> Result<()> {
        self.solver.kick(impulse)
    }
    fn accelerations(&self, out: &mut [f64]) -> bool {
        let known = self.solver.accelerations(out);
        out.iter_mut().for_each(|a| *a *= self.force);
        known
    }
    fn invariant(&self) -> Option<f64> {
        self.solver.invariant()
    }
}

/// Role of the chain in the coupling.
#[derive(Debug, Clone, Copy)]
enum Part {
    Model,
    Solver,
    Mute,
}

/// Returns a bar from −100 to 0 coupled with a moving chain that begins at −20. `weight`: whether the weights
/// vary across the overlap.
fn coupled(part: Part, step: OwnStep<f64>, weight: bool) -> Result<Coupled<f64>> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Arc::new(Slab::between(point(0.0), point(-20.0))?);
    // A solver that cannot weight itself gets nearly the whole weight in the overlap.
    let coarse: Weights<f64> = if weight {
        Weights::from_weight(Arc::new(Ramp::new(slab, Profile::Cubic, 1e-6)?))
    } else {
        Weights::from_weight(Arc::new(Ramp::new(slab, Profile::Constant(1e-6), 1e-6)?))
    };
    let fine = Weights::complement_of(std::slice::from_ref(&coarse));
    let bar = FemModel::new(
        "bar",
        generate::bar(-100.0, 0.0, 10, 1.0)?,
        Elastic::new(1.0, 0.0, 1.0)?,
    )?;
    let bar = Subdomain::coarse(bar, coarse);
    let v: Vec<f64> = (0..=BONDS)
        .map(|k| (0.3 * k as f64).sin() + 0.2 * (1.9 * k as f64).cos())
        .collect();
    let q = vec![0.0; v.len()];
    let field = chain().fine_field();
    let chain = match part {
        Part::Model => Subdomain::fine(chain(), fine).with_initial(q, v)?,
        Part::Solver => Subdomain::participant(Box::new(ChainSolver::new(chain(), q, v)?), field, fine)?,
        Part::Mute => Subdomain::participant(Box::new(Mute(ChainSolver::new(chain(), q, v)?)), field, fine)?,
    };
    let mediator = Arc::new(FemField::new(generate::bar(-20.0, 0.0, 2, 1.0)?));
    let tie = InterfaceSpec::new("overlap", 0, 1, mediator, L2);
    let steps = TimeStep::Seconds(2.4);
    Coupled::new(vec![bar, chain.with_step(step)], vec![tie], steps, None)
}

fn states(c: &Coupled<f64>) -> Vec<f64> {
    let states = c.subdomains().iter().map(|s| s.state());
    states.flat_map(|s| s.q.iter().chain(&s.v)).copied().collect()
}

#[test]
fn a_solver_in_the_place_of_a_model_gives_the_same_motion_and_the_same_ledger() {
    let step = OwnStep::Ratio(3);
    let [mut model, mut solver] = [Part::Model, Part::Solver].map(|p| coupled(p, step, true).unwrap());
    for run in [&mut model, &mut solver] {
        run.run(1000, &mut Silent).unwrap();
        assert!(run.drift() < 1e-13, "{:e}", run.drift());
    }
    let (a, b) = (states(&model), states(&solver));
    let top = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let gap = a.iter().zip(&b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
    assert!(gap < 1e-12 * top, "{gap:e} of {top}");
    let energy = |c: &Coupled<f64>| c.last_energy().unwrap().invariant;
    assert!((energy(&model) / energy(&solver) - 1.0).abs() < 1e-12);
}

/// Returns the chain between two bars whose overlaps meet in one of its nodes, so that their multipliers are
/// solved for together.
fn between(solver: bool) -> Coupled<f64> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let share = |end: f64| {
        let slab = Arc::new(Slab::between(point(0.0), point(end)).unwrap());
        Weights::from_weight(Arc::new(Ramp::new(slab, Profile::Cubic, 1e-6).unwrap()))
    };
    let shares = [-20.0, 20.0].map(share);
    let middle = Weights::complement_of(&shares);
    let bar = |name: &str, from: f64, to: f64| {
        let mesh = generate::bar(from, to, 10, 1.0).unwrap();
        FemModel::new(name, mesh, Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap()
    };
    let [left, right] = shares;
    let chain = Chain::new("chain", -20.0, 1.0, 40, 1.0, 1.0).unwrap();
    let v: Vec<f64> = (0..=40)
        .map(|k| (0.3 * f64::from(k)).sin() + 0.2 * (1.9 * f64::from(k)).cos())
        .collect();
    let (q, field) = (vec![0.0; v.len()], chain.fine_field());
    let chain = if solver {
        Subdomain::participant(Box::new(ChainSolver::new(chain, q, v).unwrap()), field, middle).unwrap()
    } else {
        Subdomain::fine(chain, middle).with_initial(q, v).unwrap()
    };
    let bodies = vec![
        Subdomain::coarse(bar("west", -100.0, 0.0), left),
        chain.with_step(OwnStep::Ratio(3)),
        Subdomain::coarse(bar("east", 0.0, 100.0), right),
    ];
    let tie = |name: &str, coarse, from: f64| {
        let mediator = Arc::new(FemField::new(generate::bar(from, from + 20.0, 2, 1.0).unwrap()));
        InterfaceSpec::new(name, coarse, 1, mediator, L2)
    };
    let ties = vec![tie("left", 0, -20.0), tie("right", 2, 0.0)];
    Coupled::new(bodies, ties, TimeStep::Seconds(2.4), None).unwrap()
}

#[test]
fn a_solver_in_two_interfaces_that_are_solved_for_together_moves_as_the_model_does() {
    let [mut model, mut solver] = [false, true].map(between);
    assert_eq!(solver.interfaces()[0].report().together, ["right"]);
    for run in [&mut model, &mut solver] {
        run.run(1000, &mut Silent).unwrap();
        assert!(run.drift() < 1e-13, "{:e}", run.drift());
        assert!(
            run.constraint_residual() < 1e-12,
            "{:e}",
            run.constraint_residual()
        );
    }
    let (a, b) = (states(&model), states(&solver));
    let top = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let gap = a.iter().zip(&b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
    assert!(gap < 1e-12 * top, "{gap:e} of {top}");
}

#[test]
fn a_solver_without_weights_of_its_own_is_coupled_as_well() {
    let mut run = coupled(Part::Solver, OwnStep::Ratio(3), false).unwrap();
    run.run(1000, &mut Silent).unwrap();
    assert!(run.drift() < 1e-12, "{:e}", run.drift());
    // Masses under a multiplier differ by 1e6 here, which costs the multiplier as many digits.
    assert!(
        run.constraint_residual() < 1e-10,
        "{:e}",
        run.constraint_residual()
    );
}

/// The bar is at rest at first: impulses bring it all its energy. The energy of a solver that does not report
/// it follows from the same impulses.
#[test]
fn impulses_tell_the_energy_of_a_solver_that_does_not_know_it() {
    let step = OwnStep::Ratio(3);
    let [mut reporting, mut mute] = [Part::Solver, Part::Mute].map(|p| coupled(p, step, true).unwrap());
    for _ in 0..10 {
        for run in [&mut reporting, &mut mute] {
            run.run(100, &mut Silent).unwrap();
            assert!(run.drift() < 1e-12, "{:e}", run.drift());
        }
        let [a, b] = [&reporting, &mute].map(|c| c.last_energy().unwrap());
        assert!((a.invariant / b.invariant - 1.0).abs() < 1e-12);
        let held = |c: &Coupled<f64>| c.subdomains()[1].internal_energy();
        let gap = (held(&reporting) - held(&mute)).abs() / a.invariant;
        assert!(gap < 1e-12, "{gap:e}");
    }
    assert_eq!(states(&reporting), states(&mute));
    let bar = mute.subdomains()[0].kinetic_energy() + mute.subdomains()[0].internal_energy();
    let share = bar / mute.last_energy().unwrap().invariant;
    assert!(share > 1e-3, "{share} went over");
}

#[test]
fn a_run_with_a_solver_goes_on_with_the_same_bits() {
    for part in [Part::Solver, Part::Mute] {
        let build = || coupled(part, OwnStep::Ratio(3), true).unwrap();
        let mut whole = build();
        whole.run(40, &mut Silent).unwrap();
        let snapshot = whole.snapshot().unwrap();
        whole.run(40, &mut Silent).unwrap();
        let mut second = build();
        second.run(3, &mut Silent).unwrap();
        second.restore(&snapshot).unwrap();
        second.run(40, &mut Silent).unwrap();
        let bits = |c: &Coupled<f64>| {
            let energy = c.last_energy().unwrap();
            let energies = [energy.invariant, energy.drift, energy.internal];
            let numbers = states(c).into_iter().chain(energies);
            numbers.map(f64::to_bits).collect::<Vec<_>>()
        };
        assert_eq!(bits(&whole), bits(&second), "{part:?}");
        assert!(second.drift() < 1e-12, "{part:?}: {:e}", second.drift());
    }
}

#[test]
fn the_solver_keeps_what_the_coupling_relies_on() {
    let v: Vec<f64> = (0..=BONDS).map(|k| (0.7 * k as f64).sin()).collect();
    let mut solver = ChainSolver::new(chain(), vec![0.0; v.len()], v).unwrap();
    // The critical step is 1.
    for step in [0.8, 0.999] {
        let d = conformance::participant(&mut solver, step, 200).unwrap();
        assert!(
            d.kick < 1e-15 && d.moved == 0.0 && d.drift < 1e-13 && d.work < 1e-13,
            "{d:?}"
        );
        assert!(d.resumed == 0.0, "{d:?}");
        assert!(d.travelled < 0.04 && d.gained < 1e-12, "{d:?}");
    }
}

#[test]
fn steps_that_are_not_made_made_by_half_or_made_twice_are_seen() {
    let v: Vec<f64> = (0..=BONDS).map(|k| (0.7 * k as f64).sin()).collect();
    for (steps, travelled) in [(&[][..], 1.0), (&[0.5], 0.5), (&[1.0, 1.0], 1.0), (&[1.1], 0.1)] {
        let solver = ChainSolver::new(chain(), vec![0.0; v.len()], v.clone()).unwrap();
        let d = conformance::participant(
            &mut Changed {
                solver,
                steps,
                force: 1.0,
            },
            0.4,
            20,
        )
        .unwrap();
        assert!((d.travelled - travelled).abs() < 0.03, "{steps:?}: {d:?}");
        // Wrong steps conserve energy too: neither drift nor kicks show them.
        assert!(d.drift < 1e-13 && d.kick < 1e-15, "{steps:?}: {d:?}");
    }
    // Wrong accelerations: scaled like a force, or of the opposite sign.
    for (force, gained) in [(2.0, 0.5), (-1.0, 2.0)] {
        let solver = ChainSolver::new(chain(), vec![0.0; v.len()], v.clone()).unwrap();
        let d = conformance::participant(
            &mut Changed {
                solver,
                steps: &[1.0],
                force,
            },
            0.4,
            20,
        )
        .unwrap();
        assert!((d.gained - gained).abs() < 1e-12, "{force}: {d:?}");
    }
}

#[test]
fn what_a_solver_cannot_have_of_the_core_and_a_step_above_its_own_are_refused_by_name() {
    let build = |step| {
        coupled(Part::Solver, step, true)
            .map(|_| ())
            .unwrap_err()
            .to_string()
    };
    let text = build(OwnStep::Ratio(2));
    for word in [
        "1.2e0 s exceeds the critical step",
        "'chain'",
        "at least 3 own steps",
    ] {
        assert!(text.contains(word), "{text}");
    }
    let text = build(OwnStep::Implicit);
    assert!(
        text.contains("'chain' cannot have the core's implicit scheme"),
        "{text}"
    );
}

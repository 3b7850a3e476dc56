//! Steps at the stability limit, a million steps, sudden loads, inconsistent initial states.

use super::naive::{Naive, Rule};
use super::{HardCase, Outcome, critical, step_of_blow_up};
use crate::line::{FINE, Line, rest, run};
use crate::waves::random_state;
use arlequin::core::effect::Load;
use arlequin::core::{Coupled, Error, InterfaceOptions, Result, Silent, TimeFunction, TimeStep, Weighting};

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "step at 0.999 and 1.001 of the critical one",
        why: "one part in a thousand separates a bounded run from one that explodes",
        naive: "1.001 of the critical step: blow-up",
        promise: "bounded below, refused above",
        fast: true,
        run: edge_of_stability,
    },
    HardCase {
        name: "a million steps",
        why: "round-off and any flaw of the scheme add up",
        naive: "weights at nodes: energy from nowhere",
        promise: "the invariant drifts by round-off only",
        fast: false,
        run: million,
    },
    HardCase {
        name: "a shock of one step",
        why: "all the load acts at one instant; every frequency is hit",
        naive: "work as force times the displacement of the past step; energy at whole steps as measure",
        promise: "the ledger closes to round-off",
        fast: true,
        run: shock,
    },
    HardCase {
        name: "initial state that violates the constraint",
        why: "velocity Verlet carries the first acceleration on for ever",
        naive: "the multipliers change sign in every step",
        promise: "displacements, velocities and accelerations are projected once, what it changed is reported",
        fast: true,
        run: inconsistent,
    },
];

fn line() -> Line {
    Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        ..Line::default()
    }
}

fn with_step(step: TimeStep<f64>) -> Result<Coupled<f64>> {
    random_state(&Line { step, ..line() }, [2, 1])
}

fn edge_of_stability() -> Result<Outcome> {
    let mut out = Outcome::default();
    let limit = critical(&with_step(TimeStep::Fraction(0.5))?);
    let mut below = with_step(TimeStep::Seconds(0.999 * limit))?;
    run(&mut below, 50_000)?;
    out.add("drift after 50 000 steps at 0.999", below.drift(), 0.0..=1e-8);
    out.add_refusal("1.001", with_step(TimeStep::Seconds(1.001 * limit)), |e| {
        matches!(e, Error::UnstableStep { .. })
    });
    let mut above = with_step(TimeStep::Unchecked(1.001 * limit))?;
    let end = step_of_blow_up(&mut above, 50_000)?;
    out.add("step at which the guard ends the run at 1.001", end, 1.0..=5000.0);
    let mut naive = Naive::new(
        &with_step(TimeStep::Fraction(0.5))?,
        &*line().mediator_space()?,
        0.0,
        Rule::Refined,
    )?;
    let grown = naive.run(1.001 * limit, 1000).growth;
    out.add_naive(
        "energy over that of the start after 1000 steps at 1.001",
        grown,
        1e6..=f64::INFINITY,
    );
    Ok(out)
}

fn million() -> Result<Outcome> {
    let mut out = Outcome::default();
    let small = Line {
        coarse_elements: 6,
        fine_bonds: 50,
        overlap: 20.0,
        ..Line::default()
    };
    let mut c = random_state(&small, [2, 1])?;
    run(&mut c, 1_000_000)?;
    out.add("drift", c.drift(), 0.0..=1e-9);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-11);
    let [_, displacement] = c.jumps(0);
    out.add("displacement jump at the end (m)", displacement, 0.0..=1e-7);
    let mut nodal = random_state(
        &Line {
            weighting: Weighting::Nodal,
            step: TimeStep::Fraction(0.5),
            ..small
        },
        [2, 1],
    )?;
    let end = step_of_blow_up(&mut nodal, 1_000_000)?;
    out.add_naive("step at which the energy has grown tenfold", end, 1.0..=1e6);
    Ok(out)
}

fn shock() -> Result<Outcome> {
    let mut out = Outcome::default();
    let deck = line();
    let last = deck.fine_bonds;
    let dt = 0.5;
    // A triangle of two steps: the load is at its peak at one instant.
    let hit = TimeFunction::Table(vec![(0.0, 0.0), (dt, 1e6), (2.0 * dt, 0.0)]);
    let [bar, chain] = deck.subdomains(&rest, &rest)?;
    let chain = chain.with_effect(Box::new(Load::on_dofs("hit", vec![(last, 1.0)], hit)?));
    let mut c = deck.build_with(vec![bar, chain])?;
    // Only the first step sees the load, at its peak.
    c.advance(&mut Silent)?;
    let moved = c.subdomains()[FINE].state().q[last];
    let mut plain = [f64::INFINITY, 0.0f64];
    for _ in 0..4000 {
        c.advance(&mut Silent)?;
        let e = c.energy();
        plain = [plain[0].min(e), plain[1].max(e)];
    }
    let work = c.works()[0].work;
    out.add("work of the shock (J)", work, 1e9..=1e12);
    out.add("drift", c.drift(), 0.0..=1e-11);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-11);
    out.add_naive(
        "share of the work seen as force times displacement of the past step",
        1e6 * moved / work,
        0.0..=0.0,
    );
    out.add_naive(
        "oscillation of the energy at whole steps over the work",
        (plain[1] - plain[0]) / work,
        0.01..=1.0,
    );
    Ok(out)
}

fn inconsistent() -> Result<Outcome> {
    let mut out = Outcome::default();
    // The initial displacements and velocities of the models disagree on purpose.
    let options = InterfaceOptions {
        start_jump: 1.0,
        ..InterfaceOptions::default()
    };
    let deck = Line { options, ..line() };
    let mut c = deck.build(&|x| (0.01 * x, 1.0), &|_| (0.0, -1.0))?;
    out.add(
        "kinetic energy taken out by the projection (J)",
        c.start_loss(),
        1.0..=100.0,
    );
    let [velocity, displacement] = c.jumps(0);
    out.add("velocity jump after it", velocity, 0.0..=1e-12);
    out.add("displacement jump after it (m)", displacement, 0.0..=1e-13);
    c.advance(&mut Silent)?;
    let steps = 400;
    let mut flips = 0;
    // Multipliers of the first step are the reference for the signs.
    let mut before = c.interfaces()[0].multipliers().to_vec();
    for _ in 0..steps {
        c.advance(&mut Silent)?;
        let now = c.interfaces()[0].multipliers();
        let top = (0..now.len()).fold(0, |t, i| if now[i].abs() > now[t].abs() { i } else { t });
        flips += usize::from(now[top] * before[top] < 0.0);
        before.copy_from_slice(now);
    }
    out.add("drift", c.drift(), 0.0..=1e-11);
    out.add(
        "share of steps in which the largest multiplier changes sign",
        flips as f64 / f64::from(steps),
        0.0..=0.4,
    );
    let raw = deck.subdomains(&|x| (0.01 * x, 1.0), &|_| (0.0, -1.0))?;
    let naive = Naive::new(&c, &*deck.mediator_space()?, 0.0, Rule::Refined)?;
    let mut naive = naive.started_from(&raw);
    let trace = naive.run(0.5, steps as usize);
    out.add_naive(
        "share of steps in which the largest multiplier changes sign",
        trace.flips,
        0.9..=1.0,
    );
    Ok(out)
}

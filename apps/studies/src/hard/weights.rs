//! Small weights, and weights of different shape.

use super::naive::{Naive, Rule};
use super::{HardCase, Outcome, critical, shaken, step_of_blow_up};
use crate::line::{Line, rest, run};
use crate::waves::random_state;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Complement, Coupled, Error, Profile, Ramp, Result, Slab, Subdomain, TimeStep, Weight, Weighting, Weights,
};
use arlequin::fem_ref::{Elastic, FemModel, generate};
use std::sync::Arc;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "epsilon 0, 1e-6, 1e-12, weights of elements",
        why: "weighted masses at the border vanish with epsilon",
        naive: "stiffness with means, masses with weights at nodes: the critical step falls with epsilon",
        promise: "critical step unchanged, invariant kept, also for epsilon = 0",
        fast: true,
        run: epsilon_energy,
    },
    HardCase {
        name: "epsilon 0, 1e-6, 1e-12, weights at nodes",
        why: "the law of the literature is neither symmetric nor bounded below in mass",
        naive: "stiffness with means, masses with weights at nodes, half of the unweighted critical step: blow-up",
        promise: "epsilon = 0 and too large steps are refused; growth ends the run with a named error",
        fast: true,
        run: epsilon_nodal,
    },
    HardCase {
        name: "alpha and beta of different shape",
        why: "stiffness without the mass that belongs to it",
        naive: "the step of the unweighted models: blow-up",
        promise: "the critical step is computed from both weights; above it the run is refused, below it the invariant is kept",
        fast: true,
        run: different_shapes,
    },
];

/// Returns the line of most of these cases: cubic weight over four coarse elements.
fn line(epsilon: f64, weighting: Weighting) -> Line {
    Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        profile: Profile::Cubic,
        epsilon,
        weighting,
        ..Line::default()
    }
}

fn free(line: &Line) -> Line {
    Line {
        step: TimeStep::Fraction(0.9),
        ..line.clone()
    }
}

fn epsilon_energy() -> Result<Outcome> {
    let mut out = Outcome::default();
    for epsilon in [0.0, 1e-6, 1e-12] {
        let energy = line(epsilon, Weighting::Energy);
        let mut c = random_state(&energy, [2, 1])?;
        run(&mut c, 5000)?;
        out.add(
            format!("critical step, epsilon {epsilon:e}"),
            critical(&c),
            0.9999..=1.001,
        );
        out.add(
            format!("drift of the invariant, epsilon {epsilon:e}"),
            c.drift(),
            0.0..=1e-11,
        );
        let condition = c.interfaces()[0].report().condition;
        out.add(format!("condition, epsilon {epsilon:e}"), condition, 1.0..=1e3);
        if epsilon > 0.0 {
            let high = if epsilon > 1e-9 { 0.1 } else { 1e-3 };
            let naive = naive(epsilon)?.critical_step();
            out.add_naive(format!("critical step, epsilon {epsilon:e}"), naive, 0.0..=high);
        }
    }
    Ok(out)
}

/// Couples stiffness with mean weights to masses with weights at the nodes.
fn naive(epsilon: f64) -> Result<Naive> {
    let linear = |weighting| {
        free(&Line {
            profile: Profile::Linear,
            ..line(epsilon, weighting)
        })
    };
    let means = random_state(&linear(Weighting::Energy), [2, 1])?;
    let nodes = linear(Weighting::Nodal).build(&rest, &rest)?;
    let mediator = line(epsilon, Weighting::Energy).mediator_space()?;
    Ok(Naive::new(&means, &*mediator, 0.0, Rule::Refined)?.with_masses_of(&nodes))
}

fn epsilon_nodal() -> Result<Outcome> {
    let mut out = Outcome::default();
    let zero = free(&line(0.0, Weighting::Nodal)).build(&rest, &rest);
    out.add_refusal("epsilon = 0", zero, |e| matches!(e, Error::ZeroMass { .. }));
    let narrow = line(1e-12, Weighting::Nodal).build(&rest, &rest);
    out.add_refusal(
        "half of the unweighted critical step, epsilon 1e-12,",
        narrow,
        |e| matches!(e, Error::UnstableStep { .. }),
    );
    for epsilon in [1e-6, 1e-12] {
        let mut coupled = random_state(&free(&line(epsilon, Weighting::Nodal)), [2, 1])?;
        out.add(
            format!("critical step, epsilon {epsilon:e}"),
            critical(&coupled),
            0.01..=0.9,
        );
        let end = step_of_blow_up(&mut coupled, 20_000)?;
        // Both outcomes are acceptable: the drift stays below the guard's bound, or the guard ends the run.
        let top = if end.is_finite() { 0.0 } else { coupled.drift() };
        out.add(
            format!("drift at 0.9 of its own critical step, epsilon {epsilon:e} (0: ended by the guard)"),
            top,
            0.0..=10.0,
        );
    }
    out.add_naive(
        "energy over that of the start after 200 steps of half the unweighted critical step, epsilon 1e-12",
        naive(1e-12)?.run(0.5, 200).growth,
        1e6..=f64::INFINITY,
    );
    Ok(out)
}

/// Builds bar and chain that share internal energy equally and mass by a linear ramp.
fn halves_and_ramp(step: TimeStep<f64>, floor: f64) -> Result<Coupled<f64>> {
    let base = Line {
        step,
        ..line(floor, Weighting::Energy)
    };
    let slab = Arc::new(Slab::between(
        Point3::origin(),
        Point3::new(-base.overlap, 0.0, 0.0),
    )?);
    let ramp =
        |profile| -> Result<Arc<dyn Weight<f64>>> { Ok(Arc::new(Ramp::new(slab.clone(), profile, floor)?)) };
    let (halves, linear) = (ramp(Profile::Constant(0.5))?, ramp(Profile::Linear)?);
    let rest_of =
        |w: &Arc<dyn Weight<f64>>| -> Arc<dyn Weight<f64>> { Arc::new(Complement(vec![w.clone()])) };
    let weights = Weights {
        internal: halves.clone(),
        kinetic: linear.clone(),
        external: linear.clone(),
        weighting: Weighting::Energy,
    };
    let fine_weights = Weights {
        internal: rest_of(&halves),
        kinetic: rest_of(&linear),
        external: rest_of(&linear),
        weighting: Weighting::Energy,
    };
    let x: Vec<f64> = (0..=base.coarse_elements)
        .rev()
        .map(|j| -base.h * j as f64)
        .collect();
    let bar = FemModel::new("bar", generate::bar_at(&x, 1.0)?, Elastic::new(1.0, 0.0, 1.0)?)?;
    let chain = spring_chain::Chain::new("chain", -base.overlap, 1.0, base.fine_bonds, 1.0, 1.0)?;
    base.build_with(shaken(
        [
            Subdomain::coarse(bar, weights),
            Subdomain::fine(chain, fine_weights),
        ],
        5,
    )?)
}

fn different_shapes() -> Result<Outcome> {
    let mut out = Outcome::default();
    for floor in [0.05, 1e-3] {
        let mut coupled = halves_and_ramp(TimeStep::Fraction(0.9), floor)?;
        run(&mut coupled, 5000)?;
        out.add(
            format!("critical step, floor {floor:e}"),
            critical(&coupled),
            0.01..=0.6,
        );
        out.add(format!("drift, floor {floor:e}"), coupled.drift(), 0.0..=1e-11);
        out.add_refusal(
            &format!("0.9 of the unweighted critical step, floor {floor:e},"),
            halves_and_ramp(TimeStep::Seconds(0.9), floor),
            |e| matches!(e, Error::UnstableStep { .. }),
        );
        let mut naive = halves_and_ramp(TimeStep::Unchecked(0.9), floor)?;
        out.add_naive(
            format!("step at which the run leaves all bounds, floor {floor:e}"),
            step_of_blow_up(&mut naive, 1000)?,
            1.0..=100.0,
        );
    }
    Ok(out)
}

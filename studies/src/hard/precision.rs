//! The same method in 32-bit numbers.

use super::{HardCase, Outcome, shaken};
use crate::solid;
use arlequin::core::interface::InterfaceOptions;
use arlequin::core::junction::{H1Gradient, Junction, L2};
use arlequin::core::observer::Silent;
use arlequin::core::subdomain::PrescribedMotion;
use arlequin::core::weight::Profile;
use arlequin::core::{Coupled, Error, Result, TimeStep};
use arlequin::fem_ref::ElementKind;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "32-bit numbers",
        why: "seven digits for masses that differ by 1e6 and more",
        naive: "the rank tolerance of 64 bits: null modes are taken for multipliers",
        promise: "drift and constraint to some hundred times the precision, for epsilon = 0 and dependent multipliers, too",
        fast: true,
        run: single,
    },
    HardCase {
        name: "32-bit numbers, 100 000 steps",
        why: "round-off adds up",
        naive: "a body that is free to leave: digits of the strains go to the way it has made",
        promise: "drift of a held body stays below one per cent; a free one is ended by the guard",
        fast: false,
        run: single_long,
    },
];

fn coupled(
    epsilon: f64,
    counts: [usize; 3],
    junction: Box<dyn Junction<f32>>,
    tolerance: Option<f32>,
) -> Result<Coupled<f32>> {
    let bodies = solid::bodies::<f32>(Profile::Cubic, epsilon)?;
    let mediator = solid::mediator::<f32>(ElementKind::Hex8, solid::OVERLAP, counts)?;
    let mut interface = solid::spec(mediator, junction);
    if let Some(rank_tolerance) = tolerance {
        interface.options = InterfaceOptions {
            rank_tolerance,
            ..interface.options
        };
    }
    Coupled::new(shaken(bodies, 7)?, vec![interface], TimeStep::Fraction(0.8), None)
}

fn naive_residual() -> Result<f64> {
    // 64-bit tolerance in 32-bit numbers; the guard may end the run, which counts as infinite.
    let mut c = match coupled(0.0, [4, 4, 4], Box::new(L2), Some(1e-10)) {
        Ok(c) => c,
        Err(_) => return Ok(f64::INFINITY),
    };
    let top = c.interfaces()[0].report().condition;
    Ok(match c.run(400, &mut Silent) {
        Ok(_) => top,
        Err(_) => f64::INFINITY,
    })
}

fn single() -> Result<Outcome> {
    let mut out = Outcome::default();
    for epsilon in [0.05, 1e-6, 0.0] {
        let mut c = coupled(epsilon, [2, 2, 2], Box::new(L2), None)?;
        c.run(400, &mut Silent)?;
        out.add(
            format!("drift, epsilon {epsilon:e}"),
            f64::from(c.drift()),
            0.0..=1e-4,
        );
        let jump = f64::from(c.constraint_residual());
        out.add(format!("velocity jump, epsilon {epsilon:e}"), jump, 0.0..=1e-4);
    }
    for ratio in [1.0, 100.0] {
        let mut h1 = coupled(0.01, [2, 2, 2], Box::new(H1Gradient::new(0.5 * ratio)?), None)?;
        h1.run(400, &mut Silent)?;
        out.add(
            format!("drift, H1 with l = {ratio} h_B"),
            f64::from(h1.drift()),
            0.0..=1e-3,
        );
    }
    let mut dependent = coupled(0.0, [4, 4, 4], Box::new(L2), None)?;
    dependent.run(400, &mut Silent)?;
    out.add("drift, fine mediator", f64::from(dependent.drift()), 0.0..=1e-3);
    let report = dependent.interfaces()[0].report();
    out.add("condition, fine mediator", report.condition, 1.0..=1e6);
    out.add_naive(
        "condition of what is inverted, fine mediator (infinite: the run ends)",
        naive_residual()?,
        1.0..=f64::INFINITY,
    );
    Ok(out)
}

fn single_long() -> Result<Outcome> {
    let mut out = Outcome::default();
    let steps = 100_000;
    let [left, right] = solid::bodies::<f32>(Profile::Cubic, 1e-6)?;
    let wall = left
        .model()
        .nodes()
        .iter()
        .enumerate()
        .filter(|(_, x)| x.x < 1e-6);
    let fixed = wall.flat_map(|(k, _)| 3 * k..3 * k + 3).collect();
    let left = left.with_support(PrescribedMotion::fixed(fixed));
    let mediator = solid::mediator::<f32>(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    let interface = solid::spec(mediator, Box::new(L2));
    let mut held = Coupled::new(
        shaken([left, right], 7)?,
        vec![interface],
        TimeStep::Fraction(0.8),
        None,
    )?;
    held.run(steps, &mut Silent)?;
    out.add("drift", f64::from(held.drift()), 0.0..=1e-2);
    out.add("velocity jump", f64::from(held.constraint_residual()), 0.0..=1e-3);
    let mut free = coupled(1e-6, [2, 2, 2], Box::new(L2), None)?;
    let end = match free.run(steps, &mut Silent) {
        Err(Error::EnergyGrowth { step, .. } | Error::Diverged { step, .. }) => step as f64,
        other => other.map(|_| f64::INFINITY)?,
    };
    out.add_naive(
        "step at which the guard ends the run of a free body",
        end,
        1.0..=100_000.0,
    );
    Ok(out)
}

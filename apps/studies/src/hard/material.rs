//! Models of very different stiffness and density, and nearly incompressible bodies.

use super::{HardCase, Outcome, critical, shaken, step_of_blow_up};
use crate::line::{Line, run};
use crate::solid;
use arlequin::core::nalgebra::Point3;
use arlequin::core::{Coupled, Error, L2, Profile, Ramp, Result, Silent, Slab, Subdomain, TimeStep, Weights};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel, generate};
use std::sync::Arc;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "stiffness ratio 1e-4 and 1e4, density ratio 1e-3 and 1e3",
        why: "either model may own the fastest wave, and masses in one multiplier row differ by 1e4",
        naive: "the step of the particles, as if the fine model always limited it: blow-up",
        promise: "the step of the faster model is found, the invariant and the constraint are kept",
        fast: true,
        run: contrasts,
    },
    HardCase {
        name: "Poisson's ratio 0.4999",
        why: "the pressure wave is 41 times faster than the bar wave",
        naive: "a step of h/sqrt(E/rho): blow-up",
        promise: "the critical step is that of the assembled matrices, the invariant is kept (elements of first order lock: not cured)",
        fast: true,
        run: incompressible,
    },
];

/// Builds the small line with another Young's modulus and density of the bar.
fn contrast(young: f64, density: f64, step: TimeStep<f64>) -> Result<Coupled<f64>> {
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        profile: Profile::Cubic,
        step,
        ..Line::default()
    };
    let slab = Slab::between(Point3::origin(), Point3::new(-line.overlap, 0.0, 0.0))?;
    let weights = Weights::from_weight(Arc::new(Ramp::new(
        Arc::new(slab),
        line.profile.clone(),
        line.epsilon,
    )?));
    let x: Vec<f64> = (0..=line.coarse_elements)
        .rev()
        .map(|j| -line.h * j as f64)
        .collect();
    let bar = FemModel::new(
        "bar",
        generate::bar_at(&x, 1.0)?,
        Elastic::new(young, 0.0, density)?,
    )?;
    let chain = spring_chain::Chain::new("chain", -line.overlap, 1.0, line.fine_bonds, 1.0, 1.0)?;
    let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    line.build_with(shaken(
        [
            Subdomain::coarse(bar, weights),
            Subdomain::fine(chain, fine_weights),
        ],
        9,
    )?)
}

fn contrasts() -> Result<Outcome> {
    let mut out = Outcome::default();
    for (young, density) in [
        (1e4, 1.0),
        (1e-4, 1.0),
        (1.0, 1e3),
        (1.0, 1e-3),
        (1e4, 1e-3),
        (1e-4, 1e3),
    ] {
        let name = format!("E ratio {young:e}, density ratio {density:e}");
        let mut c = contrast(young, density, TimeStep::Fraction(0.9))?;
        // Highest frequencies: 2c/h for the free bar, 2 for the free chain.
        let expected = (10.0 / (young / density).sqrt()).min(1.0);
        out.add(
            format!("critical step over the exact one, {name}"),
            critical(&c) / expected,
            0.999..=1.002,
        );
        run(&mut c, 5000)?;
        out.add(format!("drift, {name}"), c.drift(), 0.0..=1e-10);
        out.add(
            format!("velocity jump, {name}"),
            c.constraint_residual(),
            0.0..=1e-10,
        );
        // Only then is the step of the particles too long.
        if expected < 0.9 {
            let refused = contrast(young, density, TimeStep::Seconds(0.9));
            out.add_refusal(
                &format!("the particles' step, {name},"),
                refused,
                |e| matches!(e, Error::UnstableStep { model, .. } if model == "bar"),
            );
            let mut naive = contrast(young, density, TimeStep::Unchecked(0.9))?;
            out.add_naive(
                format!("step at which the run leaves all bounds, {name}"),
                step_of_blow_up(&mut naive, 1000)?,
                1.0..=200.0,
            );
        }
    }
    Ok(out)
}

const POISSON: f64 = 0.4999;

fn soft_rubber(step: TimeStep<f64>) -> Result<Coupled<f64>> {
    let material = || Elastic::new(1.0, POISSON, 1.0);
    let weights = solid::weights(Profile::Cubic, 0.05)?;
    let left = solid::block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?;
    let right = solid::block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3])?;
    let fine_weights = Weights::complement_of(std::slice::from_ref(&weights));
    let bodies = [
        Subdomain::coarse(FemModel::new("left", left, material()?)?, weights),
        Subdomain::fine(FemModel::new("right", right, material()?)?, fine_weights),
    ];
    let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    Coupled::new(
        shaken(bodies, 5)?,
        vec![solid::spec(mediator, Box::new(L2))],
        step,
        None,
    )
}

fn incompressible() -> Result<Outcome> {
    let mut out = Outcome::default();
    let mut c = soft_rubber(TimeStep::Fraction(0.9))?;
    let critical_step = critical(&c);
    c.run(1500, &mut Silent)?;
    out.add("drift", c.drift(), 0.0..=1e-10);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-10);
    // The shortest edge belongs to the tetrahedra: 2/7. With E = rho = 1 this is also the time.
    let naive = 2.0 / 7.0;
    out.add_refusal(
        "a step of h/sqrt(E/rho)",
        soft_rubber(TimeStep::Seconds(naive)),
        |e| matches!(e, Error::UnstableStep { .. }),
    );
    out.add_naive(
        "step of h/sqrt(E/rho) over the critical one",
        naive / critical_step,
        10.0..=1000.0,
    );
    let mut run = soft_rubber(TimeStep::Unchecked(naive))?;
    out.add_naive(
        "step at which the run leaves all bounds",
        step_of_blow_up(&mut run, 200)?,
        1.0..=20.0,
    );
    Ok(out)
}

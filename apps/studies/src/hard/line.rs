//! Mediators, junction lengths and overlaps of extreme size, on the line.

use super::naive::{Naive, Rule};
use super::{HardCase, Outcome, shaken};
use crate::line::{COARSE, FINE, Line, Product, peak, pulse, rest, run};
use crate::waves::{patch, random_state, top_reflection, wavelengths};
use arlequin::core::{Coupled, InterfaceOptions, InterfaceSpec, L2, Partition, Profile, Result, Weighting};
use arlequin::fem_ref::{FemField, generate};
use std::sync::Arc;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "L2, mediator as fine as the particles and finer",
        why: "more multipliers than independent jumps: the operator is singular, long waves are reflected",
        naive: "inverting the singular operator; coupling at full strength without a word",
        promise: "null modes are dropped and reported, the reflection is warned of, the invariant is kept",
        fast: true,
        run: fine_mediator,
    },
    HardCase {
        name: "H1 junction, l from 0 to 100 h_B",
        why: "the gradient part outweighs the values by l^2/h_B^2",
        naive: "condition grows as l^4",
        promise: "the invariant and the constraint are kept for every l",
        fast: true,
        run: lengths,
    },
    HardCase {
        name: "overlap of half an element, of one, and of the whole domain",
        why: "the weight changes within one element, or nothing is left outside of the overlap",
        naive: "weights at nodes do not see the overlap: mass is lost or gained",
        promise: "mass is exact and the invariant is kept",
        fast: true,
        run: widths,
    },
    HardCase {
        name: "two interfaces close together",
        why: "interfaces are usually solved one after the other, which is exact only if they share no unknown",
        naive: "the second solve breaks the constraint of the first",
        promise: "interfaces that share a node are solved together; one element apart works as well",
        fast: true,
        run: neighbours,
    },
    HardCase {
        name: "meshes that are not nested, ratios 1:1 to 1:50",
        why: "no node coincides, and an element of the coarse model covers up to fifty particles",
        naive: "Gauss points of the mediator miss most particles",
        promise: "patch test and invariant exact at every ratio",
        fast: true,
        run: ratios,
    },
];

fn small() -> Line {
    Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        ..Line::default()
    }
}

fn fine_mediator() -> Result<Outcome> {
    let mut out = Outcome::default();
    let wide = |mediator| Line {
        profile: Profile::Cubic,
        epsilon: 1e-6,
        overlap: 80.0,
        mediator,
        ..Line::default()
    };
    let long = wavelengths(4.2, 40.0, 60);
    for (mediator, multipliers) in [(1.0, 41.0), (0.5, 81.0)] {
        let line = Line { mediator, ..small() };
        let mut c = random_state(&line, [2, 1])?;
        run(&mut c, 5000)?;
        let report = c.interfaces()[0].report();
        let name = format!("h_B = {mediator} r");
        out.add(
            format!("multipliers, {name}"),
            report.multipliers as f64,
            multipliers..=multipliers,
        );
        // The chain has 41 particles in the overlap, so at most 41 jumps are independent.
        out.add(
            format!("independent ones, {name}"),
            report.rank as f64,
            41.0..=41.0,
        );
        out.add(
            format!("warnings, {name}"),
            report.warnings.len() as f64,
            1.0..=9.0,
        );
        out.add(format!("drift, {name}"), c.drift(), 0.0..=1e-10);
        // The reflection is physical and no factorisation removes it, so the library warns.
        out.add_naive(
            format!("largest amplitude of long waves that comes back, L_O = 8 h, {name}"),
            top_reflection(&wide(mediator), &long)?,
            0.03..=0.5,
        );
        let mut naive = Naive::new(&c, &*line.mediator_space()?, 0.0, Rule::Refined)?;
        if mediator < 1.0 {
            out.add_naive(
                format!("condition of the operator, {name}"),
                naive.condition(),
                1e12..=f64::INFINITY,
            );
            out.add_naive(
                format!("velocity jump after 200 steps, {name} (NaN counted as infinite)"),
                naive_residual(&mut naive),
                1e3..=f64::INFINITY,
            );
        }
    }
    let reflected = top_reflection(&wide(10.0), &long)?;
    out.add(
        "largest amplitude of long waves that comes back, L_O = 8 h, h_B = h_C",
        reflected,
        0.0..=0.0075,
    );
    Ok(out)
}

fn naive_residual(naive: &mut Naive) -> f64 {
    naive.run(0.5, 200);
    let r = naive.residual();
    if r.is_nan() { f64::INFINITY } else { r }
}

fn lengths() -> Result<Outcome> {
    let mut out = Outcome::default();
    let (mut drift, mut residual, mut top, mut dropped) = (0.0f64, 0.0f64, 0.0f64, 0);
    let mut conditions = Vec::new();
    for ratio in [0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0] {
        let line = Line {
            junction: Product::H1(ratio * 5.0),
            mediator: 5.0,
            ..small()
        };
        let mut c = random_state(&line, [2, 1])?;
        run(&mut c, 2000)?;
        drift = drift.max(c.drift());
        residual = residual.max(c.constraint_residual());
        let report = c.interfaces()[0].report();
        top = top.max(report.condition);
        dropped = dropped.max(report.null_modes.len());
        // The power of the growth shows at large lengths only.
        if ratio >= 10.0 {
            let naive = Naive::new(&c, &*line.mediator_space()?, ratio * 5.0, Rule::Refined)?;
            conditions.push((ratio, naive.condition()));
        }
    }
    out.add("largest drift", drift, 0.0..=1e-9);
    out.add("largest velocity jump", residual, 0.0..=1e-7);
    out.add("largest condition in the scaling of the library", top, 1.0..=1e11);
    out.add("most multipliers dropped", dropped as f64, 0.0..=8.0);
    let ((a, low), (b, high)) = (conditions[0], conditions[conditions.len() - 1]);
    out.add_naive("condition at l = 100 h_B", high, 1e7..=1e14);
    out.add_naive(
        "power of l with which the condition grows",
        (high / low).ln() / (b / a).ln(),
        3.5..=4.5,
    );
    Ok(out)
}

fn total_mass(c: &Coupled<f64>) -> f64 {
    c.subdomains().iter().flat_map(|s| s.inertia()).sum()
}

fn widths() -> Result<Outcome> {
    let mut out = Outcome::default();
    let length = 200.0;
    for (name, overlap, mediator, fine_bonds) in [
        ("half an element", 5.0, 5.0, 100),
        ("one element", 10.0, 10.0, 100),
        ("the whole domain", length, 10.0, length as usize),
    ] {
        for epsilon in [0.0, 0.05] {
            let line = Line {
                overlap,
                mediator,
                fine_bonds,
                profile: Profile::Cubic,
                epsilon,
                coarse_elements: (length / 10.0) as usize,
                ..Line::default()
            };
            let mut c = random_state(&line, [2, 1])?;
            // Both models share the mass of the overlap, which counts once.
            let exact = length + fine_bonds as f64 - overlap;
            out.add(
                format!("relative error of the mass, {name}, epsilon {epsilon}"),
                (total_mass(&c) / exact - 1.0).abs(),
                0.0..=1e-13,
            );
            run(&mut c, 4000)?;
            out.add(
                format!("drift, {name}, epsilon {epsilon}"),
                c.drift(),
                0.0..=1e-11,
            );
            out.add(
                format!("velocity jump, {name}, epsilon {epsilon}"),
                c.constraint_residual(),
                0.0..=1e-11,
            );
        }
        if overlap < 10.0 {
            let nodal = Line {
                overlap,
                mediator,
                fine_bonds,
                weighting: Weighting::Nodal,
                coarse_elements: 20,
                step: arlequin::core::TimeStep::Fraction(0.9),
                ..Line::default()
            };
            let c = nodal.build(&rest, &rest)?;
            // Error of the mass, in units of the overlap's own mass.
            let exact = length + fine_bonds as f64 - overlap;
            out.add_naive(
                format!("error of the mass over that of the overlap, {name}"),
                (total_mass(&c) - exact).abs() / overlap,
                0.05..=1.0,
            );
        }
    }
    Ok(out)
}

fn two(gap_elements: usize) -> Result<Coupled<f64>> {
    let line = small();
    let border = -20.0 - 10.0 * gap_elements as f64;
    let interface = |name: &str, ends: [f64; 2]| -> Result<InterfaceSpec<f64>> {
        Ok(InterfaceSpec {
            name: name.into(),
            coarse: COARSE,
            fine: FINE,
            mediator: Arc::new(FemField::new(generate::bar(ends[0], ends[1], 2, 1.0)?)),
            junction: Box::new(L2),
            options: InterfaceOptions::default(),
        })
    };
    let interfaces = vec![
        interface("west", [border - 20.0, border])?,
        interface("east", [-20.0, 0.0])?,
    ];
    let wide = Line {
        overlap: 60.0,
        ..line.clone()
    };
    // The interfaces leave parts of the overlap untied on purpose.
    let bodies = wide.subdomains(&rest, &rest)?;
    let bodies = bodies.map(|s| s.with_partition(Partition::Unchecked));
    Coupled::new(shaken(bodies, 3)?, interfaces, line.step, None)
}

fn neighbours() -> Result<Outcome> {
    let mut out = Outcome::default();
    for (between, where_) in [(0, "a shared node"), (1, "one element apart")] {
        let mut c = two(between)?;
        run(&mut c, 4000)?;
        out.add(format!("drift, {where_}"), c.drift(), 0.0..=1e-11);
        out.add(
            format!("velocity jump, {where_}"),
            c.constraint_residual(),
            0.0..=1e-11,
        );
    }
    let line = small();
    let c = random_state(&line, [2, 1])?;
    let half = |ends: [f64; 2]| -> Result<Naive> {
        let mediator = FemField::new(generate::bar(ends[0], ends[1], 2, 1.0)?);
        let mut side = Naive::new(&c, &mediator, 0.0, Rule::Refined)?;
        // A velocity jump of one between bar and chain.
        side.v
            .iter_mut()
            .enumerate()
            .for_each(|(k, v)| *v = f64::from(u8::from(k <= 20)));
        Ok(side)
    };
    let (mut west, mut east) = (half([-40.0, -20.0])?, half([-20.0, 0.0])?);
    // Solves one interface after the other, without a common solution.
    west.project();
    east.take_velocity(&west);
    east.project();
    west.take_velocity(&east);
    out.add_naive(
        "jump of the first interface after the second was solved, of 1",
        west.residual(),
        0.01..=1.0,
    );
    Ok(out)
}

/// Returns the reflected amplitudes of a pulse of half width 150: naive, ours.
fn echoes(line: &Line) -> Result<[f64; 2]> {
    let incoming = pulse(200.0, 150.0, 0.0, -1.0);
    let mut ours = line.build(&rest, &incoming)?;
    let mut naive = Naive::new(&ours, &*line.mediator_space()?, 0.0, Rule::Mediator)?;
    let steps = 900;
    run(&mut ours, steps)?;
    naive.run(0.5, steps);
    Ok([
        naive.peak_of_chain(&ours, 60.0).abs(),
        peak(&ours, FINE, |x| x > 60.0).abs(),
    ])
}

fn ratios() -> Result<Outcome> {
    let mut out = Outcome::default();
    for h in [1.07, 3.3, 9.7, 23.3, 50.3] {
        let overlap = if h < 5.0 { 20.0 } else { (2.2f64 * h).floor() };
        let line = Line {
            h,
            overlap,
            mediator: 0.5 * overlap,
            epsilon: 0.0,
            coarse_elements: ((overlap / h) as usize + 10).max(12),
            fine_bonds: overlap as usize + 60,
            ..Line::default()
        };
        out.add(format!("patch test, 1:{h}"), patch(&line)?, 0.0..=1e-11);
        let mut c = random_state(&line, [2, 1])?;
        run(&mut c, 4000)?;
        out.add(format!("drift, 1:{h}"), c.drift(), 0.0..=1e-10);
        if h > 50.0 {
            let naive = Naive::new(&c, &*line.mediator_space()?, 0.0, Rule::Mediator)?;
            out.add_naive(
                "share of the particles that feel no multiplier, 1:50.3",
                naive.untouched(&c, [-overlap, 0.0]),
                0.8..=1.0,
            );
        }
    }
    let [naive, ours] = echoes(&Line {
        h: 50.3,
        overlap: 110.0,
        mediator: 55.0,
        coarse_elements: 40,
        fine_bonds: 700,
        ..Line::default()
    })?;
    out.add(
        "amplitude of a long pulse that comes back, 1:50.3",
        ours,
        0.0..=0.04,
    );
    out.add_naive(
        "amplitude of a long pulse that comes back, 1:50.3",
        naive,
        0.04..=1.0,
    );
    Ok(out)
}

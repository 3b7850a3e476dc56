//! Restarted runs, and bonds that break in the overlap.

use super::particles::{coupled_with, spec};
use super::{HardCase, Outcome, shaken};
use crate::line::{Line, pulse, rest, run};
use crate::solid;
use arlequin::core::{Coupled, L2, Profile, Real, Result, Silent, TimeStep};
use arlequin::dem_beam::fracture::locked;
use arlequin::dem_beam::{Criterion, Fracture};
use arlequin::fem_ref::ElementKind;

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "coupled restart in the middle of a wave",
        why: "accelerations carry the multipliers of the last step; the pulse stands in the overlap",
        naive: "displacements and velocities alone, as an initial state: other bits, the ledger starts anew",
        promise: "every number has the same bits as in the run that was not interrupted, in 64 and 32 bits",
        fast: true,
        run: restart,
    },
    HardCase {
        name: "bonds breaking in the overlap",
        why: "stiffness vanishes where two models share it and multipliers hold the pieces",
        naive: "bonds leave without an account: energy is missing",
        promise: "the ledger closes, the constraint holds, nothing is other than finite",
        fast: true,
        run: breaking,
    },
];

/// Counts the numbers of two runs that differ in any bit.
fn different<T: Real>(a: &Coupled<T>, b: &Coupled<T>) -> usize {
    // The conversion from 32 to 64 bits is exact.
    let bits = |x: &T| x.as_f64().to_bits();
    let states = |c: &Coupled<T>| -> Vec<u64> {
        let state_bits = |s: &arlequin::core::Subdomain<T>| {
            let s = s.state();
            s.q.iter().chain(&s.v).chain(&s.a).map(bits).collect::<Vec<_>>()
        };
        let mut numbers: Vec<u64> = c.subdomains().iter().flat_map(state_bits).collect();
        numbers.extend(
            c.interfaces()
                .iter()
                .flat_map(|i| i.multipliers().iter().map(bits)),
        );
        numbers.extend(
            [c.drift(), c.constraint_residual(), c.energy(), c.time()]
                .iter()
                .map(bits),
        );
        numbers
    };
    let (a, b) = (states(a), states(b));
    a.iter().zip(&b).filter(|(x, y)| x != y).count() + a.len().abs_diff(b.len())
}

/// Compares a run of `steps` with one that is interrupted and restored in the middle; returns the number of
/// different values.
fn interrupted<T: Real>(build: &dyn Fn() -> Result<Coupled<T>>, steps: usize) -> Result<usize> {
    let mut whole = build()?;
    whole.run(steps, &mut Silent)?;
    let mut first = build()?;
    first.run(steps / 2, &mut Silent)?;
    let snapshot = first.snapshot()?;
    let mut second = build()?;
    // Steps before the restore must leave no trace.
    second.run(7, &mut Silent)?;
    second.restore(&snapshot)?;
    second.run(steps - steps / 2, &mut Silent)?;
    Ok(different(&whole, &second))
}

fn solids<T: Real>() -> Result<Coupled<T>> {
    let bodies = shaken(solid::bodies::<T>(Profile::Cubic, 0.0)?, 7)?;
    let mediator = solid::mediator::<T>(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2])?;
    let interface = solid::spec(mediator, Box::new(L2));
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(T::of(0.8)), None)
}

fn restart() -> Result<Outcome> {
    let mut out = Outcome::default();
    let line = Line {
        coarse_elements: 40,
        fine_bonds: 240,
        overlap: 40.0,
        ..Line::default()
    };
    // At half time the pulse is in the overlap.
    let wave = pulse(80.0, 60.0, 0.0, -1.0);
    let build = || line.build(&rest, &wave);
    out.add(
        "different numbers, line, 64 bits",
        interrupted(&build, 400)? as f64,
        0.0..=0.0,
    );
    out.add(
        "different numbers, solids, 64 bits",
        interrupted(&solids::<f64>, 200)? as f64,
        0.0..=0.0,
    );
    out.add(
        "different numbers, solids, 32 bits",
        interrupted(&solids::<f32>, 200)? as f64,
        0.0..=0.0,
    );
    let mut whole = build()?;
    run(&mut whole, 200)?;
    // The naive restart: displacements and velocities as a new initial state, without accelerations.
    let raw = line.subdomains(&rest, &rest)?;
    let mut again = Vec::new();
    for (s, old) in raw.into_iter().zip(whole.subdomains()) {
        again.push(s.with_initial(old.state().q.clone(), old.state().v.clone())?);
    }
    let mut naive = line.build_with(again)?;
    run(&mut whole, 200)?;
    run(&mut naive, 200)?;
    out.add_naive(
        "different numbers, line, 64 bits",
        different(&whole, &naive) as f64,
        1.0..=1e4,
    );
    Ok(out)
}

fn breaking() -> Result<Outcome> {
    let mut out = Outcome::default();
    let packing = spec(600)?.build()?;
    let mut log = None;
    let mut c = coupled_with(&packing, TimeStep::Fraction(0.8), &mut |model| {
        let model = model.with_fracture(Fracture::new(Criterion::Rankine, 0.4))?;
        log = Some(model.break_log());
        Ok(model)
    })?;
    let nodes = c.subdomains()[1].model().nodes().to_vec();
    c.run(1500, &mut Silent)?;
    let Some(log) = log else { return Ok(out) };
    let log = locked(&log);
    let inside = |pair: [u32; 2]| pair.iter().all(|k| nodes[*k as usize].x < solid::OVERLAP[1]);
    let broken = log.events().iter().filter(|b| inside(b.pair)).count();
    out.add("bonds broken in the overlap", broken as f64, 10.0..=1e4);
    out.add("drift", c.drift(), 0.0..=1e-9);
    out.add("velocity jump", c.constraint_residual(), 0.0..=1e-9);
    let finite = c
        .subdomains()
        .iter()
        .flat_map(|s| s.state().q.iter().chain(&s.state().v));
    out.add(
        "numbers that are not finite",
        finite.filter(|x| !x.is_finite()).count() as f64,
        0.0..=0.0,
    );
    let play = c.last_energy().map_or(0.0, |e| e.invariant + log.released());
    out.add_naive(
        "share of the energy that is missing",
        log.released() / play,
        1e-3..=1.0,
    );
    Ok(out)
}

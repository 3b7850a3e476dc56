//! Breaking bonds in a body on several ranks: the same breaks as on one rank, bit by bit.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{Results, WAIT, bar, bits, first, same_on, shared, unknowns};
use arlequin_core::effect::StiffnessDamping;
use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Communicator, Division};
use arlequin_core::{
    Coupled, Guard, Model, Partition, PrescribedMotion, Silent, Subdomain, TimeStep, Uniform, Weight, Weights,
};
use arlequin_mpi::threads;
use dem_beam::fracture::{Criterion, Fracture, Scatter, SharedLog};
use std::sync::Arc;

/// Weight of one up to two thirds of the body, then down to 0.2.
#[derive(Debug)]
struct Ending;

impl Weight<f64> for Ending {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * ((x.x - 4e-3) / 2e-3).clamp(0.0, 1.0)
    }
}

/// Case of breaking bonds.
#[derive(Debug, Clone, Copy)]
struct Case {
    spec: Fracture,
    finite: bool,
    /// True if bonds are compared with their strengths one by one, not within the force kernel.
    plainly: bool,
    /// True if the end of the body lies in an overlap.
    weighted: bool,
}

fn broken(case: Case, ranks: Option<Arc<dyn Communicator>>) -> (Coupled<f64>, SharedLog) {
    let model = bar(case.finite).with_fracture(case.spec).unwrap();
    let model = if case.plainly {
        model.with_plain_checks()
    } else {
        model
    };
    let log = model.break_log();
    let v = unknowns(&model, [12.0, 4e4]);
    let weights = if case.weighted {
        Weights::from_weight(Arc::new(Ending))
    } else {
        Weights::from_weight(Arc::new(Uniform(1.0)))
    };
    let held = PrescribedMotion::fixed(Vec::new());
    let side = Subdomain::fine(model, weights)
        .with_partition(Partition::Unchecked)
        .with_support(held)
        .with_effect(Box::new(StiffnessDamping::new(1e-10).unwrap()));
    let n = v.len();
    let side = side.with_initial(vec![0.0; n], v).unwrap();
    let side = shared(side, ranks);
    let guard = Guard {
        interval: 4,
        growth: 0.5,
    };
    let step = TimeStep::Fraction(0.4);
    (
        Coupled::new(vec![side], Vec::new(), step, Some(guard)).unwrap(),
        log,
    )
}

/// Returns state, ledger and all breaks in their order.
fn results(run: (Coupled<f64>, SharedLog)) -> Results {
    results_after(run, 30)
}

fn results_after((mut run, log): (Coupled<f64>, SharedLog), steps: usize) -> Results {
    run.run(steps, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![e.invariant, e.internal, e.work, e.drift, run.energy()];
    sums.extend(run.works().iter().map(|w| w.work));
    sums.extend(run.effects().iter().flat_map(|e| e.facts.iter().map(|f| f.1)));
    for e in log.read().unwrap().events() {
        let numbers = [e.bond, e.pair[0], e.pair[1], e.mode as u32, u32::from(e.overlap)];
        sums.extend(numbers.map(f64::from));
        sums.extend([e.time, e.released, e.distance, e.place.x, e.place.y, e.place.z]);
    }
    let (log, bonds) = (log.read().unwrap(), bar(false).body().pairs().len());
    sums.extend((0..bonds).map(|b| log.damage(b)));
    let s = &run.subdomains()[0];
    (bits(s.model(), &[&s.state().q, &s.state().v, &s.state().a]), sums)
}

fn cases() -> [Case; 8] {
    let spec = |criterion, strength| Fracture {
        scatter: Scatter::Weibull { modulus: 5.0 },
        ..Fracture::new(criterion, strength)
    };
    let case = |spec| Case {
        spec,
        finite: false,
        plainly: false,
        weighted: false,
    };
    let rankine = spec(Criterion::Rankine, 1.2e9);
    let particles = spec(Criterion::Hydrostatic, 150e6);
    let soft = Fracture {
        dissipated: Some(40.0),
        ..spec(Criterion::TensileEnergy, 16.0)
    };
    [
        case(rankine),
        Case {
            finite: true,
            ..case(Fracture {
                scatter: Scatter::None,
                ..spec(Criterion::Mises, 1.2e9)
            })
        },
        Case {
            weighted: true,
            ..case(Fracture {
                every: 3,
                spare_overlap: true,
                ..rankine
            })
        },
        Case {
            plainly: true,
            finite: true,
            weighted: true,
            ..case(rankine)
        },
        case(particles),
        case(soft),
        Case {
            finite: true,
            weighted: true,
            ..case(Fracture {
                every: 2,
                scatter: Scatter::None,
                ..soft
            })
        },
        Case {
            finite: true,
            weighted: true,
            ..case(Fracture {
                every: 2,
                spare_overlap: true,
                ..particles
            })
        },
    ]
}

#[test]
fn breaks_are_those_of_one_rank_in_the_same_step_and_order() {
    for case in cases() {
        let (run, log) = broken(case, None);
        let whole = results((run, log.clone()));
        let log = log.read().unwrap();
        let bonds = bar(false).body().pairs().len();
        let count = log.events().len();
        assert!((10..bonds / 2).contains(&count), "{count} of {bonds}: {case:?}");
        // Some breaks are between ranks, whichever of the two ends carries the larger load.
        let m = bar(false);
        let halves = Division::bisect(m.nodes().len(), &m.units(), 2).unwrap();
        let apart = |p: &[u32; 2]| halves.owner(p[0] as usize) != halves.owner(p[1] as usize);
        let between = log.events().iter().filter(|e| apart(&e.pair)).count();
        assert!(
            between > 0,
            "{count} of {bonds}, none between two ranks: {case:?}"
        );
        same_on(&[1, 2, 3, 4, 8], &case, &whole, |c| {
            results(broken(case, Some(c)))
        });
    }
}

/// Saves on three ranks in the middle of all breaks.
#[test]
fn what_broke_on_three_ranks_stays_broken_on_others() {
    for case in cases() {
        let (run, log) = broken(case, None);
        let whole = results((run, log.clone()));
        let before = log.read().unwrap().events().len();
        let (saved, count) = first(3, |c| {
            let (mut run, log) = broken(case, Some(c));
            run.run(12, &mut Silent).unwrap();
            let count = log.read().unwrap().events().len();
            (run.snapshot().unwrap(), count)
        });
        assert!((1..before).contains(&count), "{count} of {before}: {case:?}");
        same_on(&[1, 2, 4], &case, &whole, |c| {
            let (mut run, log) = broken(case, Some(c));
            run.restore(&saved).unwrap();
            results_after((run, log), 18)
        });
    }
}

/// Closes the energy balance to round-off in spite of breaks on any rank.
#[test]
fn what_breaks_takes_its_energy_out_of_the_balance_of_all_ranks() {
    let case = cases()[0];
    let energies = threads::run(3, 1, WAIT, |c| {
        let (mut run, log) = broken(case, Some(c));
        run.run(30, &mut Silent).unwrap();
        let e = run.last_energy().unwrap().clone();
        let released = log.read().unwrap().released();
        (e.drift, e.invariant, released)
    });
    for k in energies {
        let (drift, invariant, released) = k.unwrap();
        assert!(released > 1e-4 * invariant, "{released:e} of {invariant:e}");
        assert!(drift.abs() < 1e-12 * invariant, "{drift:e} of {invariant:e}");
    }
}

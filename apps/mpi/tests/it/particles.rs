//! A body of particles on several ranks: the bits of one rank, for any division.
#![allow(clippy::float_cmp, reason = "works are whole numbers")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{Along, Results, WAIT, bar, bits, part, same_on, unknowns};
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::ranks::{Communicator, Division, RankError};
use arlequin_core::{
    Coupled, Error, Guard, Model, Partition, PrescribedMotion, Relaxation, Silent, Subdomain, TimeStep,
    Weight, Weights,
};
use arlequin_mpi::threads;
use dem_beam::{DemModel, LoadShare};
use std::sync::Arc;
use std::time::Duration;

/// Returns energy and critical step, and forces computed in two ways, at large displacements.
fn evaluated(mut model: DemModel) -> Results {
    model.set_internal_weight(&Along).unwrap();
    let n = model.layout().dofs();
    let mut inertia = vec![0.0; n];
    model.lumped_inertia(&Along, &mut inertia).unwrap();
    let inverse: Vec<f64> = inertia.iter().map(|m| 1.0 / m).collect();
    let mut sums = vec![model.critical_step(&inverse).unwrap()];
    let [q, later] = [1e-6, 2e-6].map(|s| unknowns(&model, [s, 3e4 * s]));
    let [mut forces_later, mut forces] = [vec![0.0; n], vec![0.0; n]];
    sums.push(model.advance_with_energy(&q, &mut forces).unwrap());
    model.add_internal_forces(&later, &mut forces_later).unwrap();
    sums.extend([model.internal_energy(&q), model.internal_energy(&later)]);
    (bits(&model, &[&inertia, &forces_later, &forces]), sums)
}

#[test]
fn forces_energies_and_critical_steps_have_the_bits_of_one_rank() {
    for finite in [false, true] {
        let whole = evaluated(bar(finite));
        assert!(whole.1.iter().all(|x| *x > 0.0 && x.is_finite()), "{:?}", whole.1);
        same_on(&[1, 2, 3, 4, 8], &finite, &whole, |c| {
            evaluated(part(bar(finite), c))
        });
    }
}

/// Returns a run with everything in motion and the ledger drawn every 7 steps. `held`: whether a face is
/// held.
fn run(model: DemModel, held: bool) -> Coupled<f64> {
    let n = model.layout().dofs();
    let face = if held {
        model.select(|x| x.x < 4e-4)
    } else {
        Vec::new()
    };
    let support = PrescribedMotion::fixed(model.clamped(&face));
    let mut v = unknowns(&model, [1.0, 2e3]);
    support.dofs.iter().for_each(|d| v[*d] = 0.0);
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Along)))
        .with_partition(Partition::Unchecked)
        .with_support(support)
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let guard = Guard {
        interval: 7,
        growth: 0.05,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap()
}

fn stepped(model: DemModel, held: bool) -> Results {
    let mut run = run(model, held);
    run.run(50, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let [p, l] = run.momentum();
    let mut sums = vec![
        run.dt(),
        run.energy(),
        e.invariant,
        e.kinetic,
        e.internal,
        e.drift,
        run.drift(),
    ];
    sums.extend(p.iter().chain(&l));
    sums.extend(run.bodies()[0].drift);
    let s = &run.subdomains()[0];
    (bits(s.model(), &[&s.state().q, &s.state().v, &s.state().a]), sums)
}

#[test]
fn steps_and_the_ledger_have_the_bits_of_one_rank() {
    for (finite, held) in [(false, true), (true, true), (true, false)] {
        let whole = stepped(bar(finite), held);
        same_on(&[1, 2, 3, 4, 8], &(finite, held), &whole, |c| {
            stepped(part(bar(finite), c), held)
        });
    }
}

#[test]
fn a_free_body_on_three_ranks_keeps_its_momenta_and_its_invariant() {
    for finite in [false, true] {
        let drifts = threads::run(3, 1, WAIT, |c| {
            let mut run = run(part(bar(finite), c), false);
            run.run(400, &mut Silent).unwrap();
            (run.drift(), run.bodies()[0].drift)
        });
        for k in drifts {
            let (invariant, [linear, angular]) = k.unwrap();
            // Exact for the linear law only; with the other one the energy swings with the square of the
            // step.
            let limit = if finite { 1e-6 } else { 1e-12 };
            assert!(invariant < limit, "{invariant:e}");
            assert!(linear < 1e-12 && angular < 1e-12, "{linear:e} {angular:e}");
        }
    }
}

/// A rank receives only particles that are bonded with its own, once each.
#[test]
fn halos_are_what_bonds_ask_for() {
    let bonds = bar(false).body().pairs().to_vec();
    let count = bar(false).nodes().len();
    let parts = threads::run(3, 1, WAIT, |c| {
        let m = part(bar(false), c);
        let p = m.owned();
        let owned: Vec<usize> = (0..p.nodes()).map(|i| p.global(i)).collect();
        assert!(owned.iter().enumerate().all(|(i, g)| p.local(*g) == Some(i)));
        (
            owned,
            m.halo().unwrap().ghosts().to_vec(),
            m.halo().unwrap().sent(),
            m.body().len(),
        )
    });
    let parts: Vec<_> = parts.into_iter().map(Result::unwrap).collect();
    let (mut held, mut sent, mut received) = (0, 0, 0);
    for (owned, ghosts, out, body) in &parts {
        let is_owned = |i: u32| owned.binary_search(&(i as usize)).is_ok();
        let mut asked: Vec<u32> = bonds
            .iter()
            .filter(|p| is_owned(p[0]) != is_owned(p[1]))
            .flatten()
            .copied()
            .filter(|i| !is_owned(*i))
            .collect();
        asked.sort_unstable();
        asked.dedup();
        let mut ghosts = ghosts.clone();
        ghosts.sort_unstable();
        assert_eq!(ghosts, asked);
        assert_eq!(*body, owned.len() + ghosts.len());
        held += owned.len();
        sent += out;
        received += ghosts.len();
    }
    assert_eq!((held, sent), (count, received));
}

/// Weight of one up to two thirds of the body, then down to 0.2.
#[derive(Debug)]
struct Ending;

impl Weight<f64> for Ending {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * ((x.x - 4e-3) / 2e-3).clamp(0.0, 1.0)
    }
}

#[test]
fn particles_of_an_overlap_count_for_more_work() {
    let mut m = bar(false);
    let work = |m: &DemModel| m.units().iter().map(|u| u.work).sum::<f64>();
    let alone = work(&m);
    m.set_internal_weight(&Ending).unwrap();
    let mut coupled = vec![false; m.nodes().len()];
    for pair in m.body().pairs().iter().map(|p| p.map(|i| i as usize)) {
        let inside = pair.iter().any(|i| m.nodes()[*i].x > 4e-3);
        pair.iter().for_each(|i| coupled[*i] |= inside);
    }
    let count = coupled.iter().filter(|c| **c).count();
    assert!((400..600).contains(&count), "{count}");
    assert_eq!(work(&m) - alone, 7.0 * count as f64);
    // Coupled particles take more work, so their rank gets fewer particles.
    let halves = Division::bisect(m.nodes().len(), &m.units(), 2).unwrap();
    assert!(halves.imbalance() < 0.2, "{}", halves.imbalance());
}

fn error<R>(outcome: &Result<Result<R, Error>, RankError>) -> String {
    match outcome {
        Ok(Err(e)) => e.to_string(),
        Ok(Ok(_)) => "none".to_owned(),
        Err(e) => e.to_string(),
    }
}

#[test]
fn what_cannot_be_shared_out_is_refused_by_name_on_every_rank() {
    // The ranks have different bodies.
    let differ = threads::run(2, 1, WAIT, |c| {
        let m = bar(c.rank() == 1);
        let division = Division::bisect(m.nodes().len(), &m.units(), 2).unwrap();
        Ok(m.partition_among(&division, c).map(|_| ())?)
    });
    for (rank, outcome) in differ.iter().enumerate() {
        assert!(
            error(outcome).starts_with(&format!("rank {rank}: ranks differ in the bodies of particles")),
            "{}",
            error(outcome)
        );
    }
    let n = bar(false).nodes().len();
    let units = bar(false).units();
    assert_eq!(
        Division::bisect(n, &units, n + 1).unwrap_err(),
        RankError::TooMany {
            ranks: n + 1,
            nodes: n,
            units: 6
        }
    );
    let wrong = threads::run(2, 1, WAIT, |c| {
        let m = bar(false);
        let three = Division::bisect(n, &units, 3).unwrap();
        let refused = m.partition_among(&three, c.clone()).unwrap_err().to_string();
        assert!(refused.contains("expects 2 numbers"), "{refused}");
        let m = part(bar(false), c.clone());
        let refused = m
            .force(&[0], Vector3::x(), LoadShare::Mass)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("needs the whole body"), "{refused}");
        let again = m
            .partition_among(&Division::bisect(n, &units, 2).unwrap(), c)
            .unwrap_err();
        assert!(
            again.to_string().starts_with("sharing out needs the whole body"),
            "{again}"
        );
    });
    wrong.into_iter().for_each(|w| w.unwrap());
}

#[test]
fn what_parts_cannot_do_in_a_run_is_refused_by_name() {
    let outcomes = threads::run(2, 1, WAIT, |c| {
        // Snapshots are those of the whole body: tests/it/interfaces.rs resumes from them.
        let mut still = run(part(bar(false), c), false);
        let refusal = still.settle(0.0, 1.0, &Relaxation::default());
        let refusal = refusal.unwrap_err().to_string();
        assert!(
            refusal.contains("cannot be brought to rest while it is in parts on several ranks"),
            "{refusal}"
        );
    });
    outcomes.into_iter().for_each(|t| t.unwrap());
}

/// One rank stops before its steps: the others report which rank and why, within the time limit.
#[test]
fn a_rank_that_gives_up_hangs_or_is_gone_ends_the_others_by_name() {
    let stopped = |how: &(dyn Fn(Arc<dyn Communicator>) + Sync), wait: f64| {
        let outcomes = threads::run(3, 1, Duration::from_secs_f64(wait), |c| {
            let mut run = run(part(bar(false), c.clone()), false);
            if c.rank() == 1 {
                run.run(3, &mut Silent)?;
                how(c);
                return Ok(());
            }
            run.run(1000, &mut Silent).map(|_| ())
        });
        [error(&outcomes[0]), error(&outcomes[2])]
    };
    let gave_up = stopped(&|c| c.abandon("the disk is full"), 20.0);
    assert_eq!(
        gave_up[0],
        "rank 0 stops because rank 1 gave up: the disk is full"
    );
    assert_eq!(
        gave_up[1],
        "rank 2 stops because rank 1 gave up: the disk is full"
    );
    let gone = stopped(&|_| (), 20.0);
    assert!(gone.iter().all(|e| e.contains("is gone")), "{gone:?}");
    let silent = stopped(&|_| std::thread::sleep(Duration::from_secs_f64(1.5)), 0.5);
    assert!(
        silent
            .iter()
            .any(|e| e.contains("has waited 0.5 s for rank 1 (a message)")),
        "{silent:?}"
    );
}

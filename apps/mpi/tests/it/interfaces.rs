//! A partitioned body of particles between two whole bars of finite elements: the bits of one rank, for any
//! division.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::nalgebra::Point3;
use arlequin_core::ranks::{Communicator, RankError};
use arlequin_core::{
    Coupled, Error, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Junction, L2, Model, OwnStep,
    Partition, PrescribedMotion, Profile, Ramp, Sampling, Silent, Slab, Solver, Subdomain, TimeFunction,
    TimeStep, Weighting, Weights,
};
use arlequin_mpi::threads;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, DemModel};
use fem_ref::{Elastic, ElementKind, FemField, FemModel, generate};
use std::sync::Arc;
use std::time::Duration;

const WAIT: Duration = Duration::from_secs(20);

/// Case of a coupled run.
#[derive(Debug, Clone, Copy)]
struct Case {
    finite: bool,
    /// End of the left bar, and start of the right one; particles fill -0.05 to 3.95.
    ends: [f64; 2],
    /// Own steps of the particles per macro step.
    steps: usize,
    /// True if both sides of the left overlap are held there, and true if they are moved.
    held: bool,
    moved: bool,
    sort: Sort,
    /// Particles along a radius over those of the plain case, and mediator elements along 0.5.
    finer: usize,
    elements: usize,
    /// True if the bodies are coupled.
    tied: bool,
}

/// Junction and solver of a case.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sort {
    Values,
    Strains,
    Gradients,
    Iterated,
    Lumped,
}

const PLAIN: Case = Case {
    finite: false,
    ends: [1.05, 2.85],
    steps: 1,
    held: false,
    moved: false,
    sort: Sort::Values,
    finer: 1,
    elements: 1,
    tied: true,
};

fn point(x: f64) -> Point3<f64> {
    Point3::new(x, 0.0, 0.0)
}

fn bar(name: &str, start: f64, end: f64) -> FemModel<f64> {
    let corner = |x: f64, y: f64| Point3::new(x, y, y);
    let counts = [((end - start) / 0.25).round() as usize, 2, 2];
    let mesh = generate::block(ElementKind::Hex8, corner(start, -0.05), corner(end, 0.55), counts).unwrap();
    FemModel::new(name, mesh, Elastic::new(1.0, 0.2, 1.0).unwrap()).unwrap()
}

/// Weights of a bar: one at `alone`, falling towards `border`.
fn fading(alone: f64, border: f64) -> Weights<f64> {
    let slab = Slab::between(point(border), point(alone)).unwrap();
    Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 0.05).unwrap()))
}

fn spec(name: &str, coarse: usize, [from, to]: [f64; 2], case: Case) -> InterfaceSpec<f64> {
    let corner = |x: f64, y: f64| Point3::new(x, y, y);
    let counts = [((to - from) / 0.5).round() as usize, 1, 1].map(|n| n * case.elements);
    let mesh = generate::block(ElementKind::Hex8, corner(from, -0.05), corner(to, 0.55), counts).unwrap();
    let junction: Box<dyn Junction<f64>> = match case.sort {
        Sort::Strains => Box::new(H1Strain::new(0.1).unwrap()),
        Sort::Gradients => Box::new(H1Gradient::new(0.1).unwrap()),
        _ => Box::new(L2),
    };
    let iterated = Solver::ConjugateGradients {
        tolerance: 1e-9,
        max_iterations: 40,
    };
    InterfaceSpec {
        options: InterfaceOptions {
            sampling: Sampling::Particles,
            solver: match case.sort {
                Sort::Iterated => iterated,
                _ => Solver::Auto,
            },
            lumped: case.sort == Sort::Lumped,
            ..InterfaceOptions::default()
        },
        junction,
        ..InterfaceSpec::new(name, coarse, 1, Arc::new(FemField::new(mesh)), L2)
    }
}

/// Gives both models the same smooth displacement, and each its own velocities.
fn moving(s: Subdomain<f64>, held: &[usize]) -> Subdomain<f64> {
    let layout = s.model().layout();
    let mut q = vec![0.0; layout.dofs()];
    for (k, x) in s.model().nodes().iter().enumerate() {
        (0..3).for_each(|c| q[3 * k + c] = 1e-3 * (0.8 * x.x + c as f64).sin());
    }
    let mut v: Vec<f64> = (0..layout.dofs())
        .map(|d| 1e-3 * (1.7 * d as f64).sin())
        .collect();
    held.iter().for_each(|d| (q[*d], v[*d]) = (0.0, 0.0));
    s.with_initial(q, v).unwrap()
}

/// Returns the displacement unknowns of nodes near the lower face of the left overlap.
fn lower(model: &dyn Model<f64>, held: bool) -> Vec<usize> {
    let near = |x: &Point3<f64>| held && x.y < 0.02 && (0.0..0.5).contains(&x.x);
    let nodes = model.nodes().iter().enumerate().filter(|n| near(n.1));
    nodes.flat_map(|(k, _)| 3 * k..3 * k + 3).collect()
}

fn run(case: Case, communicator: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    let packing = lattice(
        Lattice::Cubic,
        [40, 6, 6].map(|n| n * case.finer),
        0.05 / case.finer as f64,
    )
    .unwrap();
    let beam = BeamMaterial {
        young: 1.0,
        ..BeamMaterial::SILICA
    };
    let particles = DemModel::new("particles", &packing, beam, 1.0).unwrap();
    let particles = if case.finite {
        particles.with_finite_rotations()
    } else {
        particles
    };
    let [end, begin] = case.ends;
    let weights = [fading(-0.05, end), fading(3.95, begin)];
    let middle = Weights::complement_of(&weights);
    let [left, right] = weights;
    let bodies = [
        Subdomain::coarse(bar("left", -1.05, end), left),
        Subdomain::fine(particles, middle).with_step(OwnStep::Ratio(case.steps)),
        Subdomain::coarse(bar("right", begin, 4.95), right),
    ];
    let bodies = bodies.into_iter().map(|s| {
        let held = lower(s.model(), case.held);
        let s = moving(s.with_partition(Partition::Unchecked), &held);
        // The motion lies in the overlap, where multipliers do work on it.
        let motion = PrescribedMotion {
            amplitude: if case.moved { 1e-3 } else { 0.0 },
            time: TimeFunction::Ramp { duration: 10.0 },
            dofs: held,
        };
        s.with_support(motion)
    });
    let mut bodies: Vec<_> = bodies.collect();
    if let Some(c) = communicator {
        let particles = bodies.remove(1).shared(c);
        bodies.insert(1, particles);
    }
    let mut interfaces = vec![
        spec("left", 0, [-0.05, end], case),
        spec("right", 2, [begin, 3.95], case),
    ];
    interfaces.retain(|_| case.tied);
    Coupled::new(bodies, interfaces, TimeStep::Fraction(0.4), None).unwrap()
}

/// Bits of the particles by their numbers in the whole body, then numbers that are the same on every rank.
type Results = (Vec<(usize, Vec<u64>)>, Vec<f64>);

fn results(case: Case, communicator: Option<Arc<dyn Communicator>>) -> Results {
    let mut run = run(case, communicator);
    let mut shared: Vec<f64> = run.critical_steps().to_vec();
    shared.extend([run.dt(), run.start_loss()]);
    run.run(25, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    shared.extend([
        e.invariant,
        e.kinetic,
        e.internal,
        e.work,
        e.drift,
        e.constraint_residual,
    ]);
    shared.extend([run.energy(), run.drift(), run.constraint_residual()]);
    shared.extend(run.works().iter().map(|w| w.work));
    shared.extend(
        run.displacement_jumps()
            .iter()
            .flat_map(|j| [j.largest, j.amplitude]),
    );
    shared.extend((0..2).flat_map(|k| run.jumps(k)));
    shared.extend(
        run.momentum()
            .iter()
            .flat_map(|p| p.iter().copied().collect::<Vec<_>>()),
    );
    for i in run.interfaces() {
        shared.extend(i.multipliers());
        shared.push(i.report().start_jump);
        shared.push(i.report().start_moved);
    }
    for s in [0, 2].map(|k| &run.subdomains()[k]) {
        shared.extend(s.state().q.iter().chain(&s.state().v));
    }
    let s = &run.subdomains()[1];
    let n = s.model().layout().nodes;
    let particle_bits = |i: usize| {
        let six = |x: &Vec<f64>| [&x[3 * i..3 * i + 3], &x[3 * (n + i)..3 * (n + i) + 3]].concat();
        let vectors = [&s.state().q, &s.state().v, &s.state().a];
        let bits = vectors.into_iter().flat_map(six).map(f64::to_bits);
        (s.owned().global(i), bits.collect())
    };
    ((0..n).map(particle_bits).collect(), shared)
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn check(case: Case, ranks: &[usize]) {
    let whole = results(case, None);
    assert!(whole.1.iter().all(|x| x.is_finite()));
    for &ranks in ranks {
        let mut particles = Vec::new();
        for (rank, outcome) in threads::run(ranks, 1, WAIT, |c| results(case, Some(c)))
            .into_iter()
            .enumerate()
        {
            let (owned, same): Results = outcome.unwrap();
            assert_eq!(bits(&same), bits(&whole.1), "rank {rank} of {ranks}, {case:?}");
            particles.extend(owned);
        }
        particles.sort();
        assert!(particles == whole.0, "{ranks} ranks, {case:?}");
    }
}

#[test]
fn coupled_steps_have_the_bits_of_one_rank() {
    check(PLAIN, &[1, 2, 3, 4]);
    let finite = Case {
        finite: true,
        ..PLAIN
    };
    check(finite, &[3]);
}

/// Strains couple components, and forty iterations do not reach the tolerance.
#[test]
fn junctions_and_solvers_have_the_bits_of_one_rank() {
    for sort in [Sort::Strains, Sort::Gradients, Sort::Iterated, Sort::Lumped] {
        check(Case { sort, ..PLAIN }, &[3]);
    }
    // Rows of the operator are longer here than those of both sides: it is applied by the sides, on all ranks
    // together.
    let fine = Case {
        sort: Sort::Iterated,
        elements: 4,
        ..PLAIN
    };
    check(fine, &[2, 4]);
}

#[test]
fn own_steps_and_supports_in_the_overlap_have_the_bits_of_one_rank() {
    let case = Case {
        steps: 3,
        held: true,
        ..PLAIN
    };
    check(case, &[2, 4]);
    check(Case { moved: true, ..case }, &[3]);
}

#[test]
fn interfaces_that_share_particles_have_the_bits_of_one_rank() {
    let case = Case {
        ends: [2.25, 1.65],
        ..PLAIN
    };
    assert!(!run(case, None).interfaces()[0].report().together.is_empty());
    check(case, &[2, 3, 4]);
    let iterated = Case {
        sort: Sort::Iterated,
        ..case
    };
    check(iterated, &[4]);
}

/// Returns the bytes per step that interfaces add on a rank, in messages and in reductions (the most of four
/// ranks); the multiplier unknowns; and the coupled particles.
fn bytes_of_a_step(case: Case) -> ([f64; 2], f64, f64) {
    let steps = 8;
    let count = |tied: bool| {
        let counts = threads::run(4, 1, WAIT, |c| {
            let counted = crate::support::Counted::new(c);
            let mut run = run(Case { tied, ..case }, Some(counted.clone()));
            // The ledger is drawn in the first step and in the tenth.
            run.run(1, &mut Silent).unwrap();
            counted.take();
            run.run(steps, &mut Silent).unwrap();
            let total = |n: &dyn Fn(&arlequin_core::InterfaceReport) -> usize| {
                let counts = run.interfaces().iter().map(|i| n(i.report()));
                counts.sum::<usize>() as f64
            };
            let bytes = counted.take().map(|b| b / steps as f64);
            (bytes, total(&|r| r.multipliers), total(&|r| r.coupled_nodes[1]))
        });
        counts.into_iter().map(Result::unwrap).collect::<Vec<_>>()
    };
    let (with, without) = (count(true), count(false));
    let most_added = |k: usize| {
        let differences = with.iter().zip(&without).map(|(a, b)| a.0[k] - b.0[k]);
        differences.fold(0.0, f64::max)
    };
    ([most_added(0), most_added(1)], with[0].1, with[0].2)
}

#[test]
fn interfaces_tell_of_multipliers_and_not_of_particles() {
    let [plain, small, fine] = [(1, 1), (2, 1), (1, 2)].map(|(finer, elements)| {
        bytes_of_a_step(Case {
            finer,
            elements,
            ..PLAIN
        })
    });
    for (bytes, multipliers, _) in [plain, small, fine] {
        // Sums of multipliers and, for each of two interfaces, an exact sum of the kick's kinetic energy.
        assert!(bytes[1].to_bits() == (8.0 * (multipliers + 2.0 * 67.0)).to_bits());
    }
    let bytes = |case: &([f64; 2], f64, f64)| case.0[0] + case.0[1];
    // Pieces are as many as units of 256 particles. Sending all particles to another rank took 24 bytes each.
    let growth = [bytes(&small) / bytes(&plain), small.2 / plain.2];
    assert!(
        growth[1] > 8.0 && growth[0] < 0.5 * growth[1],
        "{plain:?} {small:?}"
    );
    assert!(bytes(&small) < 24.0 * small.2 / 30.0, "{small:?}");
    let growth = [fine.0[0] / plain.0[0], fine.1 / plain.1];
    assert!(growth[0] < growth[1], "{plain:?} {fine:?}");
}

/// Case of narrow overlaps at the ends of six units.
const NARROW: Case = Case {
    ends: [0.55, 3.35],
    ..PLAIN
};

/// On six ranks some own particles of neither overlap, and some of one only; on eight two own nothing at all.
#[test]
fn ranks_without_coupled_particles_and_ranks_without_particles_have_the_bits_of_one_rank() {
    let coupled = threads::run(8, 1, WAIT, |c| {
        let run = run(NARROW, Some(c));
        let nodes = run.subdomains()[1].model().nodes();
        let within = |low: f64, high: f64| nodes.iter().filter(|x| x.x >= low && x.x <= high).count();
        [within(-0.1, 0.55), within(3.35, 4.0), nodes.len()]
    });
    let coupled: Vec<[usize; 3]> = coupled.into_iter().map(Result::unwrap).collect();
    assert_eq!(coupled.iter().filter(|c| c[2] == 0).count(), 2, "{coupled:?}");
    assert!(
        coupled.iter().any(|c| c[2] > 0 && c[0] + c[1] == 0),
        "{coupled:?}"
    );
    assert!(coupled.iter().any(|c| c[0] > 0 && c[1] == 0), "{coupled:?}");
    check(NARROW, &[6, 8]);
    // With few blocks of multipliers most ranks own none.
    let iterated = Case {
        sort: Sort::Iterated,
        ..NARROW
    };
    check(iterated, &[8]);
}

/// A run saved on three ranks resumes on one, two and four as if it had never stopped.
#[test]
fn a_run_goes_on_from_its_snapshot_on_another_number_of_ranks() {
    for finite in [false, true] {
        let case = Case { finite, ..PLAIN };
        let saved = threads::run(3, 1, WAIT, |c| {
            let mut run = run(case, Some(c));
            run.run(13, &mut Silent).unwrap();
            let saved = run.snapshot().unwrap();
            run.run(12, &mut Silent).unwrap();
            (saved, run.energy())
        });
        let mut saved = saved.into_iter().map(Result::unwrap);
        let (saved, last) = saved.next().unwrap();
        let go_on = |c: Option<Arc<dyn Communicator>>| {
            let mut run = run(case, c);
            run.restore(&saved).unwrap();
            run.run(12, &mut Silent).unwrap();
            run.energy()
        };
        assert_eq!(go_on(None).to_bits(), last.to_bits(), "one, finite {finite}");
        for ranks in [2, 4] {
            for energy in threads::run(ranks, 1, WAIT, |c| go_on(Some(c))) {
                assert_eq!(
                    energy.unwrap().to_bits(),
                    last.to_bits(),
                    "{ranks} ranks, finite {finite}"
                );
            }
        }
    }
}

#[test]
fn what_cannot_be_shared_out_is_refused_by_name_on_every_rank() {
    let refused = threads::run(2, 1, WAIT, |c| {
        let weights = Weights::uncoupled().with_weighting(Weighting::Nodal);
        let bar = Subdomain::coarse(bar("bar", 0.0, 1.0), weights).shared(c);
        Coupled::new(vec![bar], Vec::new(), TimeStep::Fraction(0.5), None).map(|_| ())
    });
    for r in refused {
        let e = r.unwrap().unwrap_err();
        assert!(
            matches!(&e, Error::Unsupported { model, .. } if model == "bar"),
            "{e}"
        );
        assert!(e.to_string().contains("in parts on 2 ranks"), "{e}");
    }
    let refused = threads::run(300, 1, WAIT, |c| {
        let packing = lattice(Lattice::Cubic, [6, 6, 6], 0.05).unwrap();
        let model = DemModel::new("few", &packing, BeamMaterial::SILICA, 1.0).unwrap();
        let few = Subdomain::fine(model, Weights::uncoupled()).shared(c);
        Coupled::new(vec![few], Vec::new(), TimeStep::Fraction(0.5), None).map(|_| ())
    });
    let e = refused.into_iter().next().unwrap().unwrap().unwrap_err();
    assert!(
        matches!(
            e,
            Error::Rank(RankError::TooMany {
                ranks: 300,
                nodes: 216,
                ..
            })
        ),
        "{e}"
    );
}

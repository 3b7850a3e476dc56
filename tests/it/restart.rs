//! The report of a run: the sample of the ledger, and every ledger line after a restart.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid::{self, bodies, couple, mediator};
use arlequin::core::effect::{
    AnyEffect, HostPair, Instant, PairEffect, PairEffectSpec, PairSpec, Prestress, StepDemand,
};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, L2, Model, Observer, OwnStep, Partition, Parts, PrescribedMotion, Profile, Silent, StepReport,
    Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, Criterion, DemModel, Fracture};
use arlequin::fem_ref::ElementKind;
use arlequin_studies::line::{COARSE, FINE, Line, rest};
use std::ops::ControlFlow;

/// Asserts that a second run resumed from a snapshot has every ledger line of the uninterrupted run; returns
/// the second run.
fn same_ledger(build: impl Fn() -> Coupled<f64>, [first, then]: [usize; 2]) -> Coupled<f64> {
    let mut whole = build();
    whole.run(first, &mut Silent).unwrap();
    let saved = whole.snapshot().unwrap();
    let mut resumed = build();
    resumed.restore(&saved).unwrap();
    let figures = |run: &Coupled<f64>| {
        let works = run.works().into_iter().map(|w| (w.name, w.work.to_bits()));
        (
            works.collect::<Vec<_>>(),
            run.start_loss().to_bits(),
            run.drift().to_bits(),
            run.constraint_residual().to_bits(),
        )
    };
    assert_eq!(figures(&whole), figures(&resumed), "right after the restart");
    whole.run(then, &mut Silent).unwrap();
    resumed.run(then, &mut Silent).unwrap();
    assert_eq!(figures(&whole), figures(&resumed), "some steps later");
    let samples = [&whole, &resumed].map(|r| r.last_energy().unwrap().clone());
    assert_eq!(samples[0], samples[1]);
    assert!(resumed.drift() < 1e-9, "drift {:e}", resumed.drift());
    resumed
}

#[test]
fn a_restart_keeps_the_loss_of_an_inconsistent_start() {
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 100,
        ..Line::default()
    };
    let loss = std::cell::Cell::new(0.0);
    let run = same_ledger(
        || {
            // The resumed run may have been given another start: the loss is stored in the snapshot.
            let speed = if loss.get() > 0.0 { 0.0 } else { 1.0 };
            let run = line.build(&|_| (0.0, speed), &|_| (0.0, -speed)).unwrap();
            loss.set(run.start_loss().max(loss.get()));
            run
        },
        [30, 30],
    );
    assert!(loss.get() > 0.0);
    assert_eq!(run.start_loss().to_bits(), loss.get().to_bits());
}

/// A spring between the last node of one bar and the first node of another.
#[derive(Default)]
struct Spring {
    last: usize,
    force: f64,
    stiffness: f64,
}

impl PairEffectSpec<f64> for Spring {
    fn name(&self) -> &str {
        "spring"
    }
    fn attach(
        mut self: Box<Self>,
        host: &HostPair<'_, f64>,
    ) -> arlequin::core::Result<Box<dyn PairEffect<f64>>> {
        self.last = host.sides[0].model.layout().nodes - 1;
        self.stiffness = 0.05;
        Ok(self)
    }
}

impl AnyEffect<f64> for Spring {
    fn name(&self) -> &str {
        "spring"
    }
}

impl PairEffect<f64> for Spring {
    fn add_forces(
        &mut self,
        instants: [&Instant<'_, f64>; 2],
        f: [&mut [f64]; 2],
    ) -> arlequin::core::Result<()> {
        self.force = self.stiffness * (instants[1].q[0] - instants[0].q[self.last]);
        f[0][self.last] += self.force;
        f[1][0] -= self.force;
        Ok(())
    }
    fn power(&self, v: [&[f64]; 2]) -> f64 {
        self.force * (v[0][self.last] - v[1][0])
    }
    fn step_demand(&self) -> [StepDemand<f64>; 2] {
        let demand = StepDemand {
            stiffness: 0.4,
            ..StepDemand::none()
        };
        [demand, demand]
    }
}

#[test]
fn a_restart_keeps_the_work_of_pair_effects() {
    let build = || {
        let [bar, chain] = Line::default()
            .subdomains(&|_| (0.0, 1.0), &|_| (0.0, -1.0))
            .unwrap();
        let parts = Parts {
            start: 0.0,
            end: None,
            // Weighted models without a tie: each lacks the other's share on purpose.
            subdomains: vec![bar, chain]
                .into_iter()
                .map(|s| s.with_partition(Partition::Unchecked))
                .collect(),
            interfaces: Vec::new(),
            pairs: vec![PairSpec {
                sides: [0, 1],
                effect: Box::new(Spring::default()),
            }],
        };
        Coupled::from_parts(parts, TimeStep::Fraction(0.5), None).unwrap()
    };
    let run = same_ledger(build, [60, 60]);
    let work = run.works()[0].work;
    assert!(work < -1e-3, "the spring took energy: {work}");
}

#[test]
fn a_restart_keeps_the_work_of_a_model_that_evolves() {
    for (criterion, strength) in [(Criterion::Rankine, 100e6), (Criterion::Hydrostatic, 10e6)] {
        evolving_work_is_kept(Fracture::new(criterion, strength));
    }
    evolving_work_is_kept(Fracture {
        dissipated: Some(60.0),
        ..Fracture::new(Criterion::TensileEnergy, 20.0)
    });
}

fn evolving_work_is_kept(fracture: Fracture) {
    let build = || {
        let packing = lattice(Lattice::Cubic, [12, 2, 2], 1e-3).unwrap();
        let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        let model = model.with_fracture(fracture).unwrap();
        let ends = [0.0, 1.0].map(|end| {
            let far = model
                .nodes()
                .iter()
                .fold(f64::NEG_INFINITY, |m, x| m.max(x.x * (2.0 * end - 1.0)));
            model.select(|x| x.x * (2.0 * end - 1.0) > far - 0.5e-3)
        });
        let pull = model.translations(&ends[1], [true, false, false]);
        let held = model.clamped(&ends[0]);
        let body = Subdomain::fine(model, Weights::uncoupled())
            .with_support(PrescribedMotion::fixed(held))
            .with_support(PrescribedMotion {
                dofs: pull,
                amplitude: 4.0,
                time: TimeFunction::Table(vec![(0.0, 0.0), (1.0, 1.0)]),
            });
        Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.8), None).unwrap()
    };
    let run = same_ledger(build, [5_000, 1_000]);
    let line = &run.works()[0];
    assert!(line.name == "bar/fracture" && line.work < 0.0, "{line:?}");
}

/// The balanced prestress is part of the state: a resumed run that was given another start stays in the first
/// run's equilibrium.
#[test]
fn a_restart_keeps_the_state_that_prestress_balances() {
    let built = std::cell::Cell::new(0);
    // A stretch, which both meshes can represent, so that the start needs no projection.
    let stretch = |k: usize, x: &Point3<f64>| 0.01 * (1 + k) as f64 * x.x;
    let build = || {
        let start = built.replace(built.get() + 1);
        let space = mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
        let parts = bodies(Profile::Cubic, 0.05).map(|s| {
            let nodes = s.model().nodes();
            let q: Vec<f64> = nodes.iter().flat_map(|x| [stretch(start, x), 0.0, 0.0]).collect();
            let still = vec![0.0; q.len()];
            let s = s.with_effect(Box::new(Prestress));
            s.with_initial(q, still).unwrap()
        });
        couple(parts.into(), space, Box::new(L2)).unwrap()
    };
    let run = same_ledger(build, [20, 20]);
    assert_eq!(built.get(), 2);
    for s in run.subdomains() {
        // The run starts in its equilibrium and stays there.
        let moved = s.state().q.chunks_exact(3).zip(s.model().nodes());
        let moved = moved.fold(0.0_f64, |m, (q, x)| m.max((q[0] - stretch(0, x)).abs()));
        assert!(moved < 1e-15, "'{}' moved by {moved:e} m", s.model().name());
    }
}

#[test]
fn the_sample_of_the_ledger_holds_half_m_v_squared() {
    // A coupled body of 4 kg in steady flight: every sample is ½ m v².
    let v = Vector3::new(0.5, -2.0, 1.0);
    let fly = |s: Subdomain<f64>| {
        let n = s.model().layout().dofs();
        s.with_initial(vec![0.0; n], (0..n).map(|k| v[k % 3]).collect())
            .unwrap()
    };
    let space = mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
    let parts = bodies(Profile::Cubic, 0.05).map(fly);
    let mut run = couple(parts.into(), space, Box::new(L2)).unwrap();
    run.run(50, &mut Silent).unwrap();
    let expected = 0.5 * 4.0 * v.norm_squared();
    let sample = run.last_energy().unwrap();
    for (name, value) in [
        ("kinetic", sample.kinetic),
        ("total", sample.total()),
        ("invariant", sample.invariant),
    ] {
        assert!(
            (value / expected - 1.0).abs() < 1e-12,
            "{name}: {value} {expected}"
        );
    }
    assert!(sample.internal.abs() < 1e-12, "{:e}", sample.internal);
}

/// Observer that ends a run after its third step.
struct Third(usize);

impl Observer<f64> for Third {
    fn observe(
        &mut self,
        run: &Coupled<f64>,
        report: &StepReport<f64>,
    ) -> arlequin::core::Result<ControlFlow<()>> {
        self.0 += 1;
        assert_eq!((report.step, run.steps()), (self.0, self.0));
        Ok(if self.0 < 3 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        })
    }
}

#[test]
fn an_observer_ends_a_run_after_the_step_it_saw() {
    let mut run = Line::default().build(&|_| (0.0, 1.0), &|_| (0.0, 1.0)).unwrap();
    assert_eq!(run.run(10, &mut Third(0)).unwrap(), 3);
    assert_eq!(run.steps(), 3);
}

/// The reported jump follows from `B` and the displacements, the largest over both sides, and survives a
/// restart.
#[test]
fn the_reported_jump_is_that_of_the_displacements_and_survives_a_restart() {
    let build = || {
        let line = Line {
            step: TimeStep::Seconds(4.0),
            own: [OwnStep::Same, OwnStep::Ratio(5)],
            coarse_elements: 20,
            fine_bonds: 120,
            overlap: 40.0,
            ..Line::default()
        };
        // Short waves, which only the chain can carry.
        let short = |x: f64| (0.0, (2.0 * x).sin());
        line.build(&rest, &short).unwrap()
    };
    let mut c = build();
    let matrices = [COARSE, FINE].map(|k| c.interfaces()[0].coupling_matrix(k).unwrap());
    let (mut largest, mut amplitude) = (0.0_f64, 0.0_f64);
    let mut snapshot = None;
    for step in 0..80 {
        if step == 50 {
            snapshot = Some(c.snapshot().unwrap());
        }
        if c.advance(&mut Silent).unwrap().energy.is_none() {
            continue;
        }
        // On a line nothing turns: the common motion is the mean one.
        let masses = [COARSE, FINE].map(|k| {
            let mut held: Vec<usize> = matrices[k].iter().map(|(_, (_, j))| j).collect();
            held.sort_unstable();
            held.dedup();
            let s = &c.subdomains()[k];
            held.into_iter()
                .map(|j| (s.inertia()[j], s.state().q[j]))
                .collect::<Vec<_>>()
        });
        let masses = masses.concat();
        let mean = masses.iter().map(|(m, q)| m * q).sum::<f64>() / masses.iter().map(|m| m.0).sum::<f64>();
        amplitude = masses.iter().fold(amplitude, |a, (_, q)| a.max((q - mean).abs()));
        let rows = matrices[0].rows();
        let (mut jump, mut measure) = (vec![0.0; rows], vec![0.0; rows]);
        for (k, sign) in [(COARSE, 1.0), (FINE, -1.0)] {
            let q = &c.subdomains()[k].state().q;
            for (b, (i, j)) in matrices[k].iter() {
                jump[i] += sign * b * q[j];
                measure[i] += if k == COARSE { b.abs() } else { 0.0 };
            }
        }
        let nodal = jump.iter().zip(&measure).map(|(j, m)| (j / m).abs());
        largest = nodal.fold(largest, f64::max);
    }
    let reported = c.displacement_jumps()[0];
    assert!(largest > 1e-6 && (reported.largest / largest - 1.0).abs() < 1e-12);
    assert!(
        (reported.amplitude / amplitude - 1.0).abs() < 1e-12,
        "{reported:?}: {amplitude}"
    );
    // The run resumed from step 50; its largest jump lies before or after the restart.
    let mut resumed = build();
    resumed.restore(&snapshot.unwrap()).unwrap();
    let before = resumed.displacement_jumps()[0];
    assert!(before.largest > 0.0 && before.largest <= reported.largest);
    resumed.run(30, &mut Silent).unwrap();
    assert_eq!(resumed.displacement_jumps()[0], reported);
}

//! Steps that the model makes itself: the bits of the core's steps, and energies from the model's own sums.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin_core::{
    Coupled, DofLayout, Guard, Model, ParticleField, Partition, PrescribedMotion, Silent, Subdomain,
    TimeFunction, TimeStep, Views, Weight, Weights,
};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, Criterion, DemModel, Fracture};
use nalgebra::Point3;
use std::sync::Arc;

/// Wraps the model without its own stepping.
struct Plain(DemModel);

impl Model<f64> for Plain {
    fn name(&self) -> &str {
        self.0.name()
    }
    fn kind(&self) -> &str {
        self.0.kind()
    }
    fn layout(&self) -> DofLayout {
        self.0.layout()
    }
    fn nodes(&self) -> &[Point3<f64>] {
        self.0.nodes()
    }
    fn lumped_inertia(&self, weight: &dyn Weight<f64>, out: &mut [f64]) -> arlequin_core::Result<()> {
        self.0.lumped_inertia(weight, out)
    }
    fn set_internal_weight(&mut self, alpha: &dyn Weight<f64>) -> arlequin_core::Result<()> {
        self.0.set_internal_weight(alpha)
    }
    fn add_internal_forces(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        self.0.add_internal_forces(q, f)
    }
    fn advance(&mut self, q: &[f64], f: &mut [f64]) -> arlequin_core::Result<()> {
        self.0.advance(q, f)
    }
    fn views(&self) -> Views<'_, f64> {
        let mut views = Views::default();
        views.arms = self.0.views().arms;
        views
    }
    fn internal_energy(&self, q: &[f64]) -> f64 {
        self.0.internal_energy(q)
    }
    fn critical_step(&mut self, inverse_inertia: &[f64]) -> arlequin_core::Result<f64> {
        self.0.critical_step(inverse_inertia)
    }
}

/// Weight that falls from 1 to 0.2 along the body.
#[derive(Debug)]
struct Along;

impl Weight<f64> for Along {
    fn value(&self, x: &Point3<f64>) -> f64 {
        1.0 - 0.8 * (x.x / 2e-3).clamp(0.0, 1.0)
    }
}

/// Returns a body of two particles per cell; their number is no multiple of the kernel's blocks.
fn model(cells: usize, finite: bool) -> DemModel {
    let cube = lattice(Lattice::BodyCentred, [cells; 3], 1e-4).unwrap();
    let m = DemModel::new("cube", &cube, BeamMaterial::SILICA, 2200.0).unwrap();
    if finite { m.with_finite_rotations() } else { m }
}

/// Returns a run with everything in motion and one face held; the ledger is drawn every `interval` steps.
fn run(model: DemModel, own: bool, interval: usize) -> Coupled<f64> {
    let n = model.layout().dofs();
    let size = |i: usize| if i < n / 2 { 1.0 } else { 2e3 };
    let v = (0..n).map(|i| (1.7 * i as f64).sin() * size(i)).collect();
    let face = model.select(|x| x.x < 1.5e-4);
    let mut held = vec![false; n];
    let support = PrescribedMotion::fixed(model.clamped(&face));
    support.dofs.iter().for_each(|d| held[*d] = true);
    let v: Vec<f64> = Vec::into_iter(v)
        .zip(held)
        .map(|(v, h)| if h { 0.0 } else { v })
        .collect();
    let volumes = vec![1e-12; model.nodes().len()];
    let field = Arc::new(ParticleField::new(model.nodes().to_vec(), &volumes).unwrap());
    let model: Box<dyn Model<f64>> = if own {
        Box::new(model)
    } else {
        Box::new(Plain(model))
    };
    let side = Subdomain::new(model, field, Weights::from_weight(Arc::new(Along)))
        .with_partition(Partition::Unchecked)
        .with_support(support)
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let guard = Guard {
        interval,
        growth: 0.05,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap()
}

fn bits(run: &Coupled<f64>) -> Vec<u64> {
    let s = run.subdomains()[0].state();
    let values = s.q.iter().chain(&s.v).chain(&s.a);
    values.map(|x| x.to_bits()).collect()
}

#[test]
fn steps_of_the_model_have_the_bits_of_the_core_on_any_number_of_threads() {
    for (cells, finite) in [(5, false), (5, true), (15, false), (15, true)] {
        let bits_with = |own_steps: bool, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut run = run(model(cells, finite), own_steps, 7);
                run.run(30, &mut Silent).unwrap();
                let last = run.last_energy().unwrap().invariant;
                (bits(&run), last)
            })
        };
        let (plain, invariant) = bits_with(false, 1);
        let (serial, serial_invariant) = bits_with(true, 1);
        assert!(serial == plain, "{cells} cells, finite {finite}");
        assert!(
            (serial_invariant / invariant - 1.0).abs() < 1e-12,
            "{serial_invariant:e} {invariant:e}"
        );
        for threads in [2, 3] {
            let (many, many_invariant) = bits_with(true, threads);
            assert!(
                many == serial && many_invariant.to_bits() == serial_invariant.to_bits(),
                "{cells} {finite} {threads}"
            );
        }
    }
}

#[test]
fn the_ledger_of_every_step_closes_with_energies_from_the_pass() {
    for (finite, tolerance) in [(false, 1e-12), (true, 1e-6)] {
        let mut run = run(model(6, finite), true, 1);
        for _ in 0..50 {
            run.run(1, &mut Silent).unwrap();
            let sample = run.last_energy().unwrap();
            let plain = run.subdomains()[0].internal_energy();
            assert!(
                (sample.internal / plain - 1.0).abs() < 1e-12,
                "{:e} {plain:e}",
                sample.internal
            );
        }
        assert!(run.drift() < tolerance, "{finite}: {:e}", run.drift());
    }
}

#[test]
fn energies_on_the_way_are_those_of_the_plain_law() {
    for finite in [false, true] {
        for strength in [None, Some(1e12)] {
            let mut m = model(6, finite);
            if let Some(s) = strength {
                m = m.with_fracture(Fracture::new(Criterion::Rankine, s)).unwrap();
            }
            m.set_internal_weight(&Along).unwrap();
            let n = m.layout().dofs();
            // Orientations return to within some last digits, and strains of this size remain.
            let (mut top, digits) = (0.0_f64, 10.0 * f64::EPSILON);
            for (u, turn) in [(1e-8, 1e-4), (1e-6, 0.3), (0.0, 0.0)] {
                let size = |i: usize| if i < n / 2 { u } else { turn };
                let q: Vec<f64> = (0..n).map(|i| (1.3 * i as f64).sin() * size(i)).collect();
                let (mut f, mut g) = (vec![0.0; n], vec![0.0; n]);
                let energy = m.advance_with_energy(&q, &mut f).unwrap();
                let plain = m.internal_energy(&q);
                top = top.max(plain);
                assert!(
                    (energy - plain).abs() <= 1e-12 * plain + digits * digits * top,
                    "{finite} {energy:e} {plain:e} {top:e}"
                );
                m.advance(&q, &mut g).unwrap();
                assert!(
                    f.iter()
                        .zip(&g)
                        .all(|(f, g)| (f - g).abs() <= 1e-12 * f.abs().max(1.0))
                );
            }
        }
    }
}

/// With breaks, the energy of each ledger sample is that of the remaining bonds.
#[test]
fn energies_on_the_way_leave_out_what_broke() {
    let spec = Fracture::new(Criterion::Axial, 2e7);
    let model = model(6, false).with_fracture(spec).unwrap();
    let log = model.break_log();
    let mut run = run(model, true, 1);
    for _ in 0..60 {
        run.run(1, &mut Silent).unwrap();
        let sample = run.last_energy().unwrap();
        let plain = run.subdomains()[0].internal_energy();
        assert!(
            (sample.internal / plain - 1.0).abs() < 1e-12,
            "{:e} {plain:e}",
            sample.internal
        );
    }
    let broken = dem_beam::fracture::locked(&log).events().len();
    assert!(broken > 20, "{broken}");
    assert!(run.drift() < 1e-12, "{:e}", run.drift());
}

#[test]
fn a_resumed_run_draws_the_same_ledger() {
    for interval in [1, 7] {
        let mut whole = run(model(5, true), true, interval);
        whole.run(20, &mut Silent).unwrap();
        let snapshot = whole.snapshot().unwrap();
        whole.run(22, &mut Silent).unwrap();
        let mut resumed = run(model(5, true), true, interval);
        resumed.restore(&snapshot).unwrap();
        resumed.run(22, &mut Silent).unwrap();
        let last = |r: &Coupled<f64>| r.last_energy().unwrap().invariant.to_bits();
        assert!(bits(&whole) == bits(&resumed) && last(&whole) == last(&resumed));
    }
}

#[test]
fn a_face_that_moves_is_followed_and_its_work_closes_the_ledger() {
    let cube = model(4, false);
    let face: Vec<usize> = cube.select(|x| x.x < 1.5e-4).iter().map(|k| 3 * k).collect();
    let (first, amplitude) = (face[0], 1e-7);
    let pull = PrescribedMotion {
        dofs: face,
        amplitude,
        time: TimeFunction::Ramp { duration: 2e-7 },
    };
    let side = Subdomain::fine(cube, Weights::uncoupled()).with_support(pull);
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    run.run((4e-7 / run.dt()) as usize, &mut Silent).unwrap();
    let moved = run.subdomains()[0].state().q[first];
    assert!((moved / amplitude - 1.0).abs() < 1e-12, "{moved:e}");
    assert!(
        run.works()[0].work > 0.0 && run.drift() < 1e-11,
        "{:e}",
        run.drift()
    );
}

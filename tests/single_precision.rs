//! Runs that are set up in 64-bit numbers and step in 32-bit ones, [`Coupled::narrowed`].

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

#[allow(dead_code, reason = "each test binary uses its part")]
mod support;

use arlequin::core::effect::{
    Absorber, BodyForce, BulkViscosity, Load, LocalDamping, MassDamping, Prestress, StiffnessDamping,
};
use arlequin::core::junction::{H1Strain, Junction, L2};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::observer::Silent;
use arlequin::core::snapshot::Snapshot;
use arlequin::core::subdomain::PrescribedMotion;
use arlequin::core::time::TimeFunction;
use arlequin::core::weight::Profile;
use arlequin::core::{Coupled, Error, InterfaceOptions, Partition, Subdomain, TimeStep, Weighting, Weights};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, Criterion, DemModel, Fracture};
use arlequin::fem_ref::{ElementKind, FemModel};
use std::sync::Arc;
use support::solid;

/// Two coupled blocks with an absorber and a body force, shaken.
fn coupled(junction: Box<dyn Junction<f64>>) -> Coupled<f64> {
    let space = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
    let rate = Arc::new(|x: &Point3<f64>| 0.5 * (3.0 - x.x).clamp(0.0, 1.0));
    let [left, right] = solid::bodies(Profile::Cubic, 0.01);
    let left = left.with_effect(Box::new(BodyForce::new(Vector3::new(0.0, -0.1, 0.0)).unwrap()));
    let right = right.with_effect(Box::new(Absorber::new(space.clone(), rate)));
    let bodies = solid::shaken([left, right], 17);
    Coupled::new(
        bodies,
        vec![solid::spec(space, junction)],
        TimeStep::Fraction(0.8),
        None,
    )
    .unwrap()
}

/// Largest difference of displacements between two runs, relative to the largest displacement.
fn difference(wide: &Coupled<f64>, narrow: &Coupled<f32>) -> f64 {
    let (mut top, mut apart) = (0.0_f64, 0.0_f64);
    for (a, b) in wide.subdomains().iter().zip(narrow.subdomains()) {
        for (a, b) in a.state().q.iter().zip(&b.state().q) {
            top = top.max(a.abs());
            apart = apart.max((a - f64::from(*b)).abs());
        }
    }
    apart / top
}

#[test]
fn a_coupled_run_with_absorber_goes_the_same_way() {
    let make = || coupled(Box::new(H1Strain::new(0.2).unwrap()));
    let (mut wide, mut narrow) = (make(), make().narrowed().unwrap());
    assert_eq!(
        wide.interfaces()[0].report().rank,
        narrow.interfaces()[0].report().rank
    );
    wide.run(300, &mut Silent).unwrap();
    narrow.run(300, &mut Silent).unwrap();
    let apart = difference(&wide, &narrow);
    assert!(apart > 1e-9 && apart < 1e-4, "{apart:e}");
    assert!(narrow.drift() < 1e-4, "{:e}", narrow.drift());
    assert!(narrow.constraint_residual() < 1e-4);
    // Works of the ledger, absorber and body force among them.
    for (a, b) in wide.works().iter().zip(narrow.works()) {
        assert_eq!(a.name, b.name);
        assert!(
            (a.work - f64::from(b.work)).abs() < 1e-4 * wide.energy(),
            "{a:?} {b:?}"
        );
    }
}

/// A held block under all further effects and a moving support.
fn loaded() -> Coupled<f64> {
    let mesh = solid::block::<f64>(ElementKind::Hex8, [0.0, 2.0], [8, 3, 3]);
    let at = |x: f64| -> Vec<usize> {
        let nodes = mesh.nodes().iter().enumerate();
        nodes
            .filter(|(_, p)| (p.x - x).abs() < 1e-9)
            .map(|(k, _)| k)
            .collect()
    };
    let (held, moved) = (at(0.0), at(2.0));
    let all = |nodes: &[usize]| {
        nodes
            .iter()
            .flat_map(|n| (0..3).map(move |c| 3 * n + c))
            .collect()
    };
    let along: Vec<usize> = moved.iter().map(|n| 3 * n).collect();
    let model = FemModel::new("block", mesh, solid::material()).unwrap();
    let field = model.field();
    let ramp = PrescribedMotion {
        dofs: along,
        amplitude: 1e-3,
        time: TimeFunction::SmoothPulse { duration: 3.0 },
    };
    let push = Load::on_dofs(
        "push",
        vec![(3 * moved[0] + 1, 1e-4)],
        TimeFunction::Table(vec![(0.0, 0.0), (1.0, 1.0)]),
    );
    let body = Subdomain::coarse(model, Weights::uncoupled())
        .with_support(PrescribedMotion::fixed(all(&held)))
        .with_support(ramp)
        .with_effect(Box::new(push.unwrap()))
        .with_effect(Box::new(BodyForce::new(Vector3::new(0.0, 1e-4, 0.0)).unwrap()))
        .with_effect(Box::new(MassDamping::new(0.1).unwrap()))
        .with_effect(Box::new(StiffnessDamping::new(1e-3).unwrap()))
        .with_effect(Box::new(BulkViscosity::new(field, 0.06, 1.0).unwrap()))
        .with_effect(Box::new(Prestress::new()))
        .with_effect(Box::new(LocalDamping::new(0.1).unwrap()));
    Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.8), None).unwrap()
}

#[test]
fn every_effect_of_the_core_and_a_moving_support_go_along() {
    let (mut wide, mut narrow) = (loaded(), loaded().narrowed().unwrap());
    for _ in 0..4 {
        wide.run(50, &mut Silent).unwrap();
        narrow.run(50, &mut Silent).unwrap();
        let apart = difference(&wide, &narrow);
        assert!(apart < 1e-4, "{apart:e}");
    }
    assert!(narrow.drift() < 1e-4, "{:e}", narrow.drift());
    for (a, b) in wide.works().iter().zip(narrow.works()) {
        let scale = wide.works().iter().map(|w| w.work.abs()).fold(0.0, f64::max);
        assert!((a.work - f64::from(b.work)).abs() < 1e-3 * scale, "{a:?} {b:?}");
    }
}

#[test]
fn a_snapshot_survives_double_precision() {
    let make = || coupled(Box::new(L2)).narrowed().unwrap();
    let mut whole = make();
    whole.run(40, &mut Silent).unwrap();
    let kept: Snapshot<f64> = whole.snapshot().rounded();
    whole.run(40, &mut Silent).unwrap();
    let mut again = make();
    again.restore(&kept.rounded()).unwrap();
    again.run(40, &mut Silent).unwrap();
    assert_eq!(whole.snapshot(), again.snapshot());
}

fn grains() -> DemModel {
    let packing = lattice(Lattice::Cubic, [8, 4, 4], 1e-3).unwrap();
    DemModel::new("grains", &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

#[test]
fn linear_particles_step_by_their_matrix_and_are_still_watched() {
    let run = |model: DemModel| {
        let n = arlequin::core::Model::<f64>::layout(&model).dofs();
        // Turned by half a radian: beyond what small rotations allow.
        let mut v = vec![0.0; n];
        v[n / 2..].iter_mut().for_each(|w| *w = 1e5);
        let body = Subdomain::fine(model, Weights::uncoupled());
        let body = body.with_initial(vec![0.0; n], v).unwrap();
        Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.8), None).unwrap()
    };
    let (mut wide, mut narrow) = (run(grains()), run(grains()).narrowed().unwrap());
    wide.run(200, &mut Silent).unwrap();
    narrow.run(200, &mut Silent).unwrap();
    let apart = difference(&wide, &narrow);
    assert!(apart < 1e-3, "{apart:e}");
    let names = |found: Vec<(String, arlequin::core::effect::Finding)>| -> Vec<_> {
        found.into_iter().map(|f| f.1.effect).collect()
    };
    assert_eq!(names(narrow.watch()), ["finite-rotations"]);
    assert_eq!(names(wide.watch()), names(narrow.watch()));

    let breakable = grains()
        .with_fracture(Fracture::new(Criterion::Axial, 1e9))
        .unwrap();
    let e = run(breakable).narrowed().unwrap_err();
    assert!(
        matches!(&e, Error::DoubleOnly { what, .. } if what == "model 'grains' (dem)"),
        "{e}"
    );
    let e = run(grains().with_finite_rotations()).narrowed().unwrap_err();
    assert!(e.to_string().contains("run in double precision"), "{e}");
}

#[test]
fn dependent_multipliers_need_the_tolerance_of_single_precision() {
    let run = |options: fn(InterfaceOptions<f64>) -> InterfaceOptions<f64>| {
        let bodies = solid::shaken(solid::bodies(Profile::Cubic, 1e-6), 3);
        let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [4, 4, 4]);
        let mut spec = solid::spec(mediator, Box::new(L2));
        spec.options = options(spec.options);
        Coupled::new(bodies, vec![spec], TimeStep::Fraction(0.8), None).unwrap()
    };
    let tight = run(|o| InterfaceOptions {
        rank_tolerance: 1e-10,
        ..o
    });
    let single = run(InterfaceOptions::single);
    let e = tight.narrowed().unwrap_err();
    assert!(e.to_string().contains("set rank_tolerance"), "{e}");
    let mut single = single.narrowed().unwrap();
    single.run(400, &mut Silent).unwrap();
    assert!(single.drift() < 1e-4, "{:e}", single.drift());
}

#[test]
fn nodal_weighting_has_no_matrix_to_step_with() {
    let w = solid::weights(Profile::Cubic, 0.05).with_weighting(Weighting::Nodal);
    let mesh = solid::block::<f64>(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]);
    // A share of a body, alone on purpose.
    let body = Subdomain::coarse(FemModel::new("left", mesh, solid::material()).unwrap(), w)
        .with_partition(Partition::Unchecked);
    let run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    assert!(matches!(run.narrowed(), Err(Error::DoubleOnly { .. })));
}

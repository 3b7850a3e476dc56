//! Couplings of solids in space: momenta, patch test, sampling choices, several interfaces, prescribed
//! motion, effects in the ledger, single precision.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid::{self, bodies, couple, junctions, material, mediator, shaken, spec};
use arlequin::core::effect::{Absorber, BodyForce, Load, MassDamping};
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin::core::{
    Complement, Coupled, Error, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Junction, L2, Needs,
    NoMediator, Parts, PrescribedMotion, Profile, Ramp, Sampling, ShapeFunction, ShapeRow, Silent, Slab,
    Subdomain, TimeFunction, TimeStep, Weight, Weights, conformance,
};
use arlequin::fem_ref::{ElementKind, FemModel, Mesh};
use arlequin_studies::solid::{kept, momentum_scale};
use std::sync::Arc;

/// Product `∫ κ(x) (λ·v + l² ε(λ):ε(v))`, in which `κ` grows twentyfold across the overlap and with the
/// height.
struct Graded;

impl Junction<f64> for Graded {
    fn name(&self) -> &'static str {
        "graded"
    }
    fn needs(&self) -> Needs {
        Needs::ValuesAndGradients
    }
    fn block(&self, x: &Point3<f64>, row: &ShapeFunction<f64>, col: &ShapeFunction<f64>) -> Matrix3<f64> {
        let strain = H1Strain::new(0.15).unwrap();
        strain.block(x, row, col) * (1.0 + 19.0 * (x.x - solid::OVERLAP[0]) + x.z * x.z)
    }
}

#[test]
fn a_junction_that_varies_in_space_sees_no_jump_in_rigid_motion_and_action_is_reaction() {
    let space = || mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
    let fly = |s: Subdomain<f64>| {
        let (t, r) = (Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.1, 0.4, -0.3));
        let v: Vec<f64> = conformance::rigid_motion(s.model(), t, r);
        s.with_initial(vec![0.0; v.len()], v).unwrap()
    };
    let mut c = couple(
        bodies(Profile::Cubic, 0.05).map(fly).into(),
        space(),
        Box::new(Graded),
    )
    .unwrap();
    c.advance(&mut Silent).unwrap();
    let [jump, _] = c.jumps(0);
    assert!(jump < 1e-13, "jump {jump:e} m/s");
    let mut c = couple(shaken(bodies(Profile::Cubic, 0.05), 7), space(), Box::new(Graded)).unwrap();
    let [force, moment] = conformance::interface_momentum(&c);
    assert!(force < 1e-13 && moment < 1e-13, "{force:e} {moment:e}");
    let conserved = kept(&mut c).unwrap();
    assert!(
        conserved.momentum[0] <= 1e-12 && conserved.momentum[1] <= 1e-12,
        "{conserved:?}"
    );
    assert!(
        conserved.drift < 1e-11 && conserved.residual < 1e-11,
        "{conserved:?}"
    );
}

#[test]
fn overhanging_mediator_is_refused_with_the_measure_outside() {
    let space = mediator::<f64>(ElementKind::Hex8, [2.0, 3.25], [2, 2, 2]);
    let e = couple::<f64>(bodies(Profile::Cubic, 0.05).into(), space, Box::new(L2)).unwrap_err();
    let Error::OverhangingMediator {
        model,
        outside,
        total,
        ..
    } = &e
    else {
        panic!("{e}")
    };
    assert_eq!(model, "left");
    assert!((outside - 0.25).abs() < 1e-9 && (total - 1.25).abs() < 1e-9);
    let space = mediator(ElementKind::Hex8, [4.5, 5.0], [2, 2, 2]);
    let e = couple::<f64>(bodies(Profile::Cubic, 0.05).into(), space, Box::new(L2)).unwrap_err();
    assert!(matches!(e, Error::EmptyOverlap { .. }), "{e}");
}

/// Pieces that share no place with each other need no mediator; models that share one do.
#[test]
fn models_without_a_common_place_are_not_tied() {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Slab::between(point(1.5), point(2.5)).unwrap();
    let first = Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), Profile::Cubic, 0.0).unwrap()));
    let second = Weights::complement_of(std::slice::from_ref(&first));
    let build = |pieces: [[f64; 2]; 2]| {
        let [coarse, fine] = pieces.map(|x| solid::block(ElementKind::Hex8, x, [4, 1, 1]));
        let model = |name: &str, mesh| FemModel::new(name, mesh, material()).unwrap();
        let parts = Parts {
            start: 0.0,
            end: None,
            subdomains: vec![
                Subdomain::coarse(model("long", coarse), second.clone()).with_sleep(),
                Subdomain::fine(model("short", fine), first.clone()).with_sleep(),
            ],
            interfaces: vec![InterfaceSpec::new("tie", 0, 1, Arc::new(NoMediator), L2)],
            pairs: Vec::new(),
        };
        Coupled::from_parts(parts, TimeStep::Fraction(0.5), None)
    };
    let apart = build([[0.0, 1.0], [3.0, 4.0]]).unwrap();
    assert_eq!(apart.interfaces()[0].report().multipliers, 0);
    let e = build([[0.0, 4.0], [0.0, 4.0]]).unwrap_err();
    assert!(matches!(e, Error::EmptyOverlap { .. }), "{e}");
}

/// Returns the deviation from uniform tension of a bar fixed at the left and pulled at the right, in
/// displacement and in strain.
fn patch(coarse: ElementKind, fine: ElementKind, profile: Profile<f64>, epsilon: f64) -> [f64; 2] {
    let left = solid::block(coarse, [0.0, 3.0], [7, 2, 2]);
    patch_of(left, solid::block(fine, [2.0, 4.0], [9, 3, 3]), profile, epsilon).0
}

/// Like [`patch`] on given meshes; also returns the warnings of the interface.
fn patch_of(
    left: Mesh<f64>,
    right: Mesh<f64>,
    profile: Profile<f64>,
    epsilon: f64,
) -> ([f64; 2], Vec<String>) {
    let w = solid::weights(profile, epsilon);
    let coarse = left.kind();
    let left = FemModel::new("left", left, material()).unwrap();
    let right = FemModel::new("right", right, material()).unwrap();
    // u = ε (x, −ν y, −ν z): rollers on three faces, a displacement at the far end.
    let support = |model: &FemModel<f64>, group: &str, axis: usize, amplitude: f64| {
        let dofs = model
            .mesh()
            .group_nodes(group)
            .unwrap()
            .into_iter()
            .map(|n| 3 * n + axis)
            .collect();
        PrescribedMotion {
            dofs,
            amplitude,
            time: TimeFunction::Step,
        }
    };
    let mut supports = [Vec::new(), Vec::new()];
    for (m, model) in [&left, &right].into_iter().enumerate() {
        supports[m].push(support(model, "y-min", 1, 0.0));
        supports[m].push(support(model, "z-min", 2, 0.0));
    }
    supports[0].push(support(&left, "x-min", 0, 0.0));
    supports[1].push(support(&right, "x-max", 0, 0.04));
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let [a, b] = supports;
    let left = a
        .into_iter()
        .fold(Subdomain::coarse(left, w), Subdomain::with_support);
    let right = b
        .into_iter()
        .fold(Subdomain::fine(right, complement), Subdomain::with_support);
    let mut c = couple(
        vec![left, right],
        mediator(coarse, solid::OVERLAP, [2, 2, 2]),
        Box::new(L2),
    )
    .unwrap();
    let e = c.equilibrium(0.0).unwrap();
    let mut worst: f64 = 0.0;
    for (s, q) in c.subdomains().iter().zip(&e.displacements) {
        for (x, u) in s.model().nodes().iter().zip(q.chunks(3)) {
            let exact = 0.01 * Vector3::new(x.x, -0.25 * x.y, -0.25 * x.z);
            worst = worst.max((Vector3::new(u[0], u[1], u[2]) - exact).norm());
        }
    }
    let mut strain: f64 = 0.0;
    let mut row = ShapeRow::default();
    for (s, q) in c.subdomains().iter().zip(&e.displacements) {
        for cell in s.field().cells() {
            let corners = cell.corners();
            let sum = corners.iter().fold(Vector3::zeros(), |s, p| s + p.coords);
            let centre = Point3::from(sum / corners.len() as f64);
            s.field().shape_at(&centre, true, &mut row).unwrap();
            let terms = row.nodes.iter().zip(&row.gradients);
            let xx: f64 = terms.map(|(n, g)| q[3 * n] * g.x).sum();
            strain = strain.max((xx / 0.01 - 1.0).abs());
        }
    }
    (
        [worst / 0.04, strain],
        c.interfaces()[0].report().warnings.clone(),
    )
}

#[test]
fn warped_hexahedra_are_warned_of_with_their_warp_and_the_patch_test_says_by_how_much() {
    // Inner nodes of both blocks are moved in all directions, so that element faces are warped.
    let mesh = |x: [f64; 2], counts, amount: f64| {
        let inside = move |p: &Point3<f64>, k: usize| p[k] > 1e-9 && p[k] < 1.0 - 1e-9;
        let moved = move |p: &Point3<f64>| {
            let bulge = (3.0 * p.x).sin() * (2.0 * p.y + 5.0 * p.z).cos() * amount;
            let free = |k: usize| if inside(p, k) { bulge } else { 0.0 };
            let along = if p.x > x[0] + 1e-9 && p.x < x[1] - 1e-9 {
                bulge
            } else {
                0.0
            };
            Point3::new(p.x + along, p.y + free(1), p.z - free(2))
        };
        solid::block(ElementKind::Hex8, x, counts).mapped(moved).unwrap()
    };
    let mut last = 0.0;
    for amount in [0.005, 0.02, 0.05] {
        let ([displacement, strain], warnings) = patch_of(
            mesh([0.0, 3.0], [7, 4, 4], amount),
            mesh([2.0, 4.0], [9, 5, 5], amount),
            Profile::Linear,
            0.0,
        );
        assert!(
            warnings.iter().any(|w| w.contains("leave their planes by up to")),
            "{warnings:?}"
        );
        // About 0.01 of the warp in displacement (2.6 times the shift of the nodes), 0.1 of it in strain.
        assert!(
            displacement > last && displacement < 0.03 * amount && strain < 0.3 * amount,
            "{amount}: {displacement:e} {strain:e}"
        );
        last = displacement;
    }
    let (flat, warnings) = patch_of(
        mesh([0.0, 3.0], [7, 4, 4], 0.0),
        mesh([2.0, 4.0], [9, 5, 5], 0.0),
        Profile::Linear,
        0.0,
    );
    assert!(
        flat[0] < 1e-11 && flat[1] < 1e-10 && warnings.is_empty(),
        "{flat:?} {warnings:?}"
    );
}

#[test]
fn patch_test_in_space() {
    // Exact with a linear weight whose gradient lies in the mediator space and with element means: simplices
    // and aligned boxes.
    for (coarse, fine) in [
        (ElementKind::Tet4, ElementKind::Tet4),
        (ElementKind::Hex8, ElementKind::Hex8),
        (ElementKind::Hex8, ElementKind::Tet4),
    ] {
        let [defect, strain] = patch(coarse, fine, Profile::Linear, 0.0);
        assert!(defect < 1e-11, "{coarse:?} | {fine:?}: {defect:e}");
        assert!(strain < 1e-10, "{coarse:?} | {fine:?}: strain {strain:e}");
    }
    let [cubic, strain] = patch(ElementKind::Tet4, ElementKind::Tet4, Profile::Cubic, 0.05);
    assert!(cubic > 1e-6 && cubic < 0.02, "{cubic:e}");
    assert!(strain > cubic && strain < 0.5, "{strain:e}");
}

#[test]
fn projection_sampling_conserves_momentum_and_energy_too() {
    let options = InterfaceOptions {
        sampling: Sampling::Projection,
        ..InterfaceOptions::default()
    };
    for junction in junctions() {
        let interface = InterfaceSpec {
            options,
            ..spec(mediator(ElementKind::Tet4, solid::OVERLAP, [2, 2, 2]), junction)
        };
        let bodies = shaken(bodies(Profile::Linear, 0.05), 3);
        let mut c = Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.9), None).unwrap();
        let (before, scale) = (c.momentum(), momentum_scale(&c));
        c.run(300, &mut Silent).unwrap();
        let after = c.momentum();
        assert!((0..2).all(|k| (after[k] - before[k]).norm() <= 1e-12 * scale[k]));
        assert!(c.drift() < 1e-11);
    }
}

/// Couples coarse | fine | coarse by two disjoint interfaces.
fn sandwich(gap: f64) -> Result<Coupled<f64>, Error> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let ramp = |fine: f64, coarse: f64| -> Arc<dyn Weight<f64>> {
        Arc::new(
            Ramp::new(
                Arc::new(Slab::between(point(fine), point(coarse)).unwrap()),
                Profile::Cubic,
                1e-3,
            )
            .unwrap(),
        )
    };
    let (left, right) = (ramp(3.0, 2.0), ramp(3.0 + gap, 4.0 + gap));
    let middle = Weights::from_weight(Arc::new(Complement(vec![left.clone(), right.clone()])));
    let model =
        |name, kind, x, counts| FemModel::new(name, solid::block(kind, x, counts), material()).unwrap();
    let subdomains = vec![
        Subdomain::coarse(
            model("left", ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]),
            Weights::from_weight(left),
        ),
        Subdomain::coarse(
            model("right", ElementKind::Hex8, [3.0 + gap, 6.0 + gap], [6, 2, 2]),
            Weights::from_weight(right),
        ),
        Subdomain::fine(
            model("middle", ElementKind::Hex8, [2.0, 4.0 + gap], [10, 4, 4]),
            middle,
        ),
    ];
    let interface = |name: &str, coarse, x| InterfaceSpec {
        name: name.into(),
        coarse,
        fine: 2,
        mediator: mediator(ElementKind::Hex8, x, [2, 2, 2]),
        junction: Box::new(L2),
        options: InterfaceOptions::default(),
    };
    let interfaces = vec![
        interface("west", 0, [2.0, 3.0]),
        interface("east", 1, [3.0 + gap, 4.0 + gap]),
    ];
    let subdomains = subdomains.into_iter().map(|s| {
        let v = s
            .model()
            .nodes()
            .iter()
            .flat_map(|x| [(-(x.x - 1.0).powi(2) * 4.0).exp(), 0.0, 0.0])
            .collect();
        let n = s.model().layout().dofs();
        s.with_initial(vec![0.0; n], v)
    });
    Coupled::new(
        subdomains.collect::<Result<_, _>>()?,
        interfaces,
        TimeStep::Fraction(0.9),
        None,
    )
}

#[test]
fn fine_zone_in_the_middle_with_two_interfaces() {
    let mut c = sandwich(1.0).unwrap();
    let mass: f64 = c
        .subdomains()
        .iter()
        .map(|s| s.inertia().iter().step_by(3).sum::<f64>())
        .sum();
    assert!(
        (mass - 7.0).abs() < 1e-12,
        "weights of three models sum to one: {mass}"
    );
    let before = c.momentum();
    c.run(600, &mut Silent).unwrap();
    let change = (c.momentum()[0] - before[0]).norm() / before[0].norm();
    // The body drifts by some metres; K u of this rigid motion leaves round-off in every step.
    assert!(change < 1e-11, "momentum changes by {change:e}");
    assert!(c.drift() < 1e-11 && c.constraint_residual() < 1e-11);
    let arrived = c.subdomains()[1].kinetic_energy() + c.subdomains()[1].internal_energy();
    assert!(arrived > 0.02 * c.energy(), "the pulse crosses both interfaces");
}

#[test]
fn every_effect_is_one_line_of_a_closed_ledger() {
    let [left, right] = bodies(Profile::Cubic, 0.05);
    let model = FemModel::<f64>::new(
        "tip",
        solid::block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3]),
        material(),
    )
    .unwrap();
    let pull = |_: &arlequin::core::effect::SurfaceFacet<f64>| Vector3::new(0.01, 0.0, 0.0);
    let traction = Load::traction(
        "pull",
        model.mesh().surface("x-max").unwrap(),
        &pull,
        TimeFunction::Ramp { duration: 3.0 },
    );
    let driven = PrescribedMotion {
        dofs: (0..9).map(|n| 3 * n).collect(),
        amplitude: 0.02,
        time: TimeFunction::SmoothPulse { duration: 4.0 },
    };
    let rate = Arc::new(|x: &Point3<f64>| 0.5 * (3.0 - x.x).clamp(0.0, 1.0));
    let left = left
        .with_support(driven)
        .with_effect(Box::new(BodyForce::new(Vector3::new(0.0, -1e-3, 0.0)).unwrap()));
    let right = right
        .with_effect(Box::new(traction.unwrap()))
        .with_effect(Box::new(MassDamping::new(0.05).unwrap()))
        .with_effect(Box::new(Absorber::new(
            mediator(ElementKind::Tet4, solid::OVERLAP, [1, 1, 1]),
            rate,
        )));
    let junction = Box::new(H1Gradient::new(0.2).unwrap());
    let mut c = couple(
        vec![left, right],
        mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]),
        junction,
    )
    .unwrap();
    c.run(2000, &mut Silent).unwrap();
    let works = c.works();
    let names: Vec<&str> = works.iter().map(|w| w.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "left/body-force",
            "right/pull",
            "right/mass-damping",
            "right/absorber",
            "supports",
            "constraint"
        ]
    );

    let work_of = |name: &str| works.iter().find(|w| w.name.ends_with(name)).unwrap().work;
    assert!(
        work_of("pull") > 0.0
            && work_of("mass-damping") < 0.0
            && work_of("absorber") < 0.0
            && work_of("supports").abs() > 0.0
    );
    assert!(
        work_of("constraint").abs() < 1e-12 * work_of("pull"),
        "the constraint does no work: {:e}",
        work_of("constraint")
    );
    assert!(c.drift() < 1e-11, "{:e}", c.drift());
}

#[test]
fn effects_that_are_absent_leave_no_line() {
    let c = couple::<f64>(
        bodies(Profile::Cubic, 0.05).into(),
        mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]),
        Box::new(L2),
    );
    let names: Vec<String> = c.unwrap().works().into_iter().map(|w| w.name).collect();
    assert_eq!(names, ["constraint"]);
}

#[test]
fn lumping_is_offered_for_l2_only() {
    let options = InterfaceOptions {
        lumped: true,
        ..InterfaceOptions::default()
    };
    let space = || mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
    let interface = InterfaceSpec {
        options,
        ..spec(space(), Box::new(L2))
    };
    let bodies = || shaken::<f64>(bodies(Profile::Cubic, 0.05), 5);
    let mut c = Coupled::new(bodies(), vec![interface], TimeStep::Fraction(0.8), None).unwrap();
    c.run(500, &mut Silent).unwrap();
    let last = c.last_energy().unwrap();
    // The lumped constraint holds only in the mean and takes energy out; the ledger states how much.
    assert!(
        c.works()[0].work < 0.0 && last.relative_drift.abs() < 1e-11,
        "{last:?}"
    );
    let interface = InterfaceSpec {
        options,
        ..spec(space(), Box::new(H1Strain::new(0.1).unwrap()))
    };
    let e = Coupled::new(bodies(), vec![interface], TimeStep::Fraction(0.8), None).unwrap_err();
    assert!(e.to_string().contains("lumping an H1 junction diverges"), "{e}");
    // The name leads to the key of a scene.
    assert!(matches!(e, Error::InvalidOption { name: "lumped", .. }), "{e}");
    let options = InterfaceOptions {
        sampling: Sampling::Particles,
        ..InterfaceOptions::default()
    };
    let interface = InterfaceSpec {
        options,
        ..spec(space(), Box::new(L2))
    };
    let e = Coupled::new(bodies(), vec![interface], TimeStep::Fraction(0.8), None).unwrap_err();
    assert!(matches!(e, Error::InvalidOption { name: "sampling", .. }), "{e}");
}

/// Couples the two bodies in 32-bit numbers.
fn single(epsilon: f64, counts: [usize; 3], junction: Box<dyn Junction<f32>>) -> Coupled<f32> {
    let space = mediator::<f32>(ElementKind::Hex8, solid::OVERLAP, counts);
    let mut c = couple(shaken(bodies(Profile::Cubic, epsilon), 11), space, junction).unwrap();
    c.run(400, &mut Silent).unwrap();
    c
}

#[test]
fn single_precision_couples_as_well() {
    for epsilon in [0.05, 1e-6, 0.0] {
        let c = single(epsilon, [2, 2, 2], Box::new(L2));
        let [drift, jump] = [c.drift(), c.constraint_residual()];
        assert!(
            drift < 1e-4 && jump < 1e-4,
            "epsilon {epsilon}: {drift:e} {jump:e}"
        );
    }
    for length in [0.5, 50.0] {
        let c = single(0.01, [2, 2, 2], Box::new(H1Gradient::new(length).unwrap()));
        assert!(c.drift() < 1e-3, "l = {length}: {:e}", c.drift());
    }
    // Dependent multipliers are dropped with the tolerance of 32-bit numbers.
    let c = single(0.0, [4, 4, 4], Box::new(L2));
    assert!(c.drift() < 1e-3 && c.interfaces()[0].report().condition < 1e6);
}

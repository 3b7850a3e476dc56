//! Surfaces of finite and natural elements against rigid bodies: drops, rest, slopes, free bodies,
//! random pairs of shapes.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::blocks::{E, H, RHO, against, bits, cube, depth_in, material, moving, random, spheres};
use arlequin::core::contact::{
    ContactLaw, LARGEST_TURN, Motion, RigidBody, RigidShape, SharedBody, Solid, SurfaceObstacle,
};
use arlequin::core::effect::{BodyForce, EffectLine, MassDamping};
use arlequin::core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin::core::{Coupled, Silent, Subdomain, TimeFunction, TimeStep, Uniform, Weights};
use arlequin::dem_beam::Obstacle;
use arlequin::fem_ref::{ElementKind, FemModel, Mesh, generate};
use std::sync::Arc;

pub(crate) fn fem(name: &str, mesh: Mesh<f64>) -> FemModel<f64> {
    FemModel::new(name, mesh, material()).unwrap()
}

pub(crate) fn rigid(shape: RigidShape, motion: Motion) -> SharedBody {
    SharedBody::new(RigidBody::new("tool", shape, motion).unwrap())
}

pub(crate) fn run_of(bodies: Vec<Subdomain<f64>>, fraction: f64) -> Coupled<f64> {
    Coupled::new(bodies, Vec::new(), TimeStep::Fraction(fraction), None).unwrap()
}

/// A cube of `n³` elements, or of spheres half as large, that touches a rigid body.
fn cube_against(kind: &str, n: usize, body: &SharedBody, law: ContactLaw) -> Subdomain<f64> {
    if kind != "dem" {
        return against(cube(kind, n), body, law);
    }
    let model = spheres("block", Vector3::zeros(), [n; 3], H, Vector3::zeros());
    let contact = Obstacle::of_body(&model, body, law).unwrap();
    Subdomain::fine(model, Weights::uncoupled()).with_effect(Box::new(contact))
}

/// Deepest place of a node inside the rigid body \[m\].
fn depth(run: &Coupled<f64>, body: &SharedBody) -> f64 {
    let rigid = body.lock();
    depth_in(run.subdomains().iter(), rigid.shape(), &rigid.moved())
}

/// Kinetic energy of all subdomains \[J\].
fn kinetic(run: &Coupled<f64>) -> f64 {
    let of = |s: &Subdomain<f64>| -> f64 {
        let v = s.state().v.iter();
        v.zip(s.inertia()).map(|(v, m)| 0.5 * m * v * v).sum()
    };
    run.subdomains().iter().map(of).sum()
}

/// Number of closed contacts of an effect.
fn contacts(line: &EffectLine<f64>) -> f64 {
    let contacts = line.facts.iter().find(|f| f.0 == "contacts");
    contacts.map_or(0.0, |f| f.1)
}

/// Elastic drop, corner first, at two step ratios: the block comes back, no energy is created, and the floor
/// is not entered by more than a part of an element.
#[test]
fn a_block_falls_on_a_floor_corner_first() {
    let normal = Vector3::new(1.0, 1.3, 1.7).normalize();
    for kind in ["hex", "tet", "cnem"] {
        for fraction in [0.3, 0.9] {
            let point = Point3::from(normal * -1e-4);
            let body = rigid(RigidShape::Plane { point, normal }, Motion::Fixed);
            let law = ContactLaw::elastic(E);
            let s = against(cube(kind, 4), &body, law);
            let mut run = run_of(vec![moving(s, normal * -20.0)], fraction);
            let before = kinetic(&run);
            let (mut deepest, mut touched) = (0.0_f64, false);
            for _ in 0..400 {
                run.run((0.5 / fraction).ceil() as usize, &mut Silent).unwrap();
                deepest = deepest.max(depth(&run, &body));
                let force = run.effects()[0]
                    .facts
                    .iter()
                    .find(|f| f.0 == "contacts")
                    .unwrap()
                    .1;
                touched |= force > 0.0;
            }
            assert!(touched && deepest < 0.3 * H, "{kind} {fraction}: {deepest:e} m");
            let [momentum, _] = run.momentum();
            assert!(momentum.dot(&normal) > 0.0, "{kind} {fraction}: it comes back");
            assert!(
                run.created() <= 1e-13 * before,
                "{kind} {fraction}: {:e}",
                run.created() / before
            );
            assert!(run.drift() < 1e-11, "{kind} {fraction}: drift {:e}", run.drift());
        }
    }
}

/// A block that rests on a floor, with damping: the force is its weight.
#[test]
fn the_force_of_a_block_at_rest_is_its_weight() {
    for kind in ["hex", "tet", "cnem"] {
        let shape = RigidShape::Plane {
            point: Point3::origin(),
            normal: Vector3::z(),
        };
        let body = rigid(shape, Motion::Fixed);
        let law = ContactLaw {
            restitution: 0.3,
            ..ContactLaw::elastic(E)
        };
        let s = against(cube(kind, 3), &body, law);
        let gravity = Vector3::new(0.0, 0.0, -9.81e3);
        let s = s
            .with_effect(Box::new(BodyForce::new(gravity).unwrap()))
            .with_effect(Box::new(MassDamping::new(2e5).unwrap()));
        let mut run = run_of(vec![s], 0.8);
        while run.time() < 1.5e-4 {
            run.run(100, &mut Silent).unwrap();
        }
        let force = run.effect_resultant(0, "tool", &Point3::origin()).unwrap().force;
        let weight = RHO * (3.0 * H).powi(3) * 9.81e3;
        assert!(
            (force.z / weight - 1.0).abs() < 1e-6,
            "{kind}: {}",
            force.z / weight - 1.0
        );
        assert!(force.xy().norm() < 1e-6 * weight);
    }
}

/// On a slope below the angle of friction a block sticks and the floor carries it; above, the ratio of the
/// forces is the coefficient: the threshold is right to four digits.
#[test]
fn a_block_sticks_on_a_slope_up_to_the_angle_of_friction() {
    let mu = 0.3;
    for kind in ["hex", "tet", "cnem", "dem"] {
        for slope in [0.29995, 0.30005_f64] {
            let shape = RigidShape::Plane {
                point: Point3::origin(),
                normal: Vector3::z(),
            };
            let body = rigid(shape, Motion::Fixed);
            let law = ContactLaw {
                friction: mu,
                restitution: 0.3,
                ..ContactLaw::elastic(E)
            };
            let s = cube_against(kind, 3, &body, law);
            let mass: f64 = {
                let mut inertia = vec![0.0; s.model().layout().dofs()];
                s.model().lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
                (0..s.model().nodes().len()).map(|n| inertia[3 * n]).sum()
            };
            let g = Vector3::new(slope, 0.0, -1.0) * 9.81e3;
            let ramp = TimeFunction::Ramp { duration: 2e-5 };
            let s = s
                .with_effect(Box::new(BodyForce::new(g).unwrap().over_time(ramp).unwrap()))
                .with_effect(Box::new(MassDamping::new(2e5).unwrap()));
            let mut run = run_of(vec![s], 0.8);
            while run.time() < 1e-3 {
                run.run(100, &mut Silent).unwrap();
            }
            let force = run.effect_resultant(0, "tool", &Point3::origin()).unwrap().force;
            let ratio = -force.x / force.z;
            let expected = slope.min(mu);
            assert!((ratio - expected).abs() < 1e-5, "{kind} {slope}: {ratio}");
            // Terminal velocity against the damping, or rest.
            let [momentum, _] = run.momentum();
            let speed = momentum.x / mass;
            let sliding = (slope - mu).max(0.0) * 9.81e3 / 2e5;
            assert!(
                (speed - sliding).abs() < 0.05 * 5e-5 * 9.81e3 / 2e5,
                "{kind} {slope}: {speed:e}"
            );
        }
    }
}

/// A block strikes a plate on a spring: no energy is created, and the plate swings on with the frequency
/// `√(k/m)`.
#[test]
fn a_plate_on_a_spring_takes_a_blow_and_swings_at_its_frequency() {
    let (mass, stiffness) = (2e-3, 2e8);
    let centre = Point3::new(2.0 * H, 2.0 * H, -0.5 * H);
    let shape = RigidShape::cuboid(centre, Vector3::new(6.0, 6.0, 1.0) * H, Vector3::zeros());
    let motion = Motion::Free {
        mass,
        velocity: Vector3::zeros(),
        inertia: None,
    };
    let body = rigid(shape, motion);
    body.lock().set_spring(stiffness).unwrap();
    let s = against(cube("hex", 4), &body, ContactLaw::elastic(E));
    let mut run = run_of(vec![moving(s, Vector3::new(0.0, 0.0, -10.0))], 0.5);
    let before = kinetic(&run);
    let swing = |body: &SharedBody| {
        let rigid = body.lock();
        (rigid.moved().z, rigid.velocity()[0].z)
    };
    let mut parted = 0;
    while parted < 20 {
        run.run(1, &mut Silent).unwrap();
        parted = if contacts(&run.effects()[0]) == 0.0 {
            parted + 1
        } else {
            0
        };
    }
    assert!(run.created() <= 1e-13 * before, "{:e}", run.created() / before);
    assert!(run.effects()[0].dissipated().unwrap() > -1e-13 * before);
    // What the plate has, the block has lost.
    let (x, v) = swing(&body);
    let energy = 0.5 * mass * v * v + 0.5 * stiffness * x * x;
    assert!(
        energy > 0.01 * before,
        "the plate took {energy:e} J of {before:e} J"
    );
    // Half a period from one zero of the displacement to the next.
    let omega = (stiffness / mass).sqrt();
    let end = run.time() + 2.2 * std::f64::consts::PI / omega;
    let (mut zeros, mut last) = (Vec::new(), x);
    while run.time() < end && contacts(&run.effects()[0]) == 0.0 {
        let then = run.time();
        run.run(1, &mut Silent).unwrap();
        let (x, _) = swing(&body);
        if last * x < 0.0 {
            zeros.push(then + (run.time() - then) * last / (last - x));
        }
        last = x;
    }
    let half = (zeros[1] - zeros[0]) * omega / std::f64::consts::PI;
    assert!(
        (half - 1.0).abs() < 1e-3,
        "half a period over that of the spring: {half}"
    );
    let error = body_on_spring(Motion::Fixed);
    assert!(
        error.contains("spring") && error.contains("give the obstacle a mass"),
        "{error}"
    );
}

fn body_on_spring(motion: Motion) -> String {
    let shape = RigidShape::Plane {
        point: Point3::origin(),
        normal: Vector3::z(),
    };
    rigid(shape, motion)
        .lock()
        .set_spring(1.0)
        .unwrap_err()
        .to_string()
}

/// A block starts turned about one of its edges, with the opposite edge in a floor: the run knows the angle.
#[test]
fn the_turn_of_a_touching_surface_is_known() {
    let angle = 0.2;
    let shape = RigidShape::Plane {
        point: Point3::new(0.0, 0.0, -1e-4),
        normal: Vector3::z(),
    };
    let body = rigid(shape, Motion::Fixed);
    let s = against(cube("hex", 2), &body, ContactLaw::elastic(E));
    let turn = Rotation3::new(Vector3::x() * -angle);
    let q: Vec<f64> = s
        .model()
        .nodes()
        .iter()
        .flat_map(|x| <[f64; 3]>::from(turn * x.coords - x.coords))
        .collect();
    let v = vec![0.0; q.len()];
    let run = run_of(vec![s.with_initial(q, v).unwrap()], 0.5);
    let line = &run.effects()[0];
    let told = line.facts.iter().find(|f| f.0 == LARGEST_TURN).unwrap().1;
    assert!(contacts(line) > 0.0);
    assert!((told - angle).abs() < 1e-12, "{told}");
}

/// A free ball strikes the edge that two blocks share: one body under the forces of both.
fn struck(friction: f64, fraction: f64) -> (Coupled<f64>, SharedBody) {
    let radius = 2e-3;
    let shape = RigidShape::Sphere {
        centre: Point3::new(0.0, 2e-3, 4e-3 + radius + 1e-6),
        radius,
    };
    let motion = Motion::Free {
        mass: 1e-4,
        velocity: Vector3::new(0.3, 0.1, -10.0),
        inertia: None,
    };
    let body = rigid(shape, motion);
    let law = ContactLaw {
        friction,
        ..ContactLaw::elastic(E)
    };
    let side = |name: &str, x: [f64; 2], kind| {
        let high = Point3::new(x[1], 4e-3, 4e-3);
        let mesh = generate::block(kind, Point3::new(x[0], 0.0, 0.0), high, [4; 3]).unwrap();
        against(
            Subdomain::coarse(fem(name, mesh), Weights::uncoupled()),
            &body,
            law,
        )
    };
    let bodies = vec![
        side("left", [-4e-3, 0.0], ElementKind::Hex8),
        side("right", [0.0, 4e-3], ElementKind::Tet4),
    ];
    (run_of(bodies, fraction), body)
}

#[test]
fn a_free_ball_and_two_blocks_keep_momentum_and_create_no_energy() {
    let start = Vector3::new(0.3, 0.1, -10.0) * 1e-4;
    for (friction, fraction) in [(0.0, 0.9), (0.4, 0.5)] {
        let (mut run, body) = struck(friction, fraction);
        // Up to the parting of the ball: later, the drift of round-off in a flying block grows with its way.
        let mut parted = 0;
        while parted < 20 {
            run.run(1, &mut Silent).unwrap();
            let contacts = run.effects().iter().map(contacts).sum::<f64>();
            let flies = contacts == 0.0 && body.lock().velocity()[0].z > 0.0;
            parted = if flies { parted + 1 } else { 0 };
        }
        let [velocity, spin] = body.lock().velocity();
        let [momentum, _] = run.momentum();
        let total = momentum + velocity * 1e-4;
        assert!(velocity.z > 0.0, "the ball rebounds");
        assert!(
            (total - start).norm() < 1e-12 * start.norm(),
            "{:e}",
            (total - start).norm()
        );
        assert!(
            (spin.norm() > 1.0) == (friction > 0.0),
            "friction turns the ball: {spin}"
        );
        let before = 0.5 * 1e-4 * (100.0 + 0.1);
        assert!(run.created() < 1e-13 * before, "{:e}", run.created() / before);
        for line in run.effects() {
            assert!(line.dissipated().unwrap() > -1e-13 * before, "{line:?}");
        }
    }
}

#[test]
fn threads_and_restarts_keep_the_bits_of_a_shared_ball() {
    let bits = |run: &Coupled<f64>, body: &SharedBody| -> Vec<u64> {
        let [v, w] = body.lock().velocity();
        let motion = v.iter().chain(w.iter()).map(|x| x.to_bits());
        bits(run).into_iter().chain(motion).collect()
    };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let (mut run, body) = struck(0.4, 0.8);
            run.run(300, &mut Silent).unwrap();
            bits(&run, &body)
        })
    };
    let serial = on(1);
    assert_eq!(serial, on(3), "three threads");
    let (mut first, _) = struck(0.4, 0.8);
    // Within the contact: springs, budgets and the motion of the ball are resumed.
    first.run(120, &mut Silent).unwrap();
    let saved = first.snapshot().unwrap();
    let (mut resumed, body) = struck(0.4, 0.8);
    resumed.restore(&saved).unwrap();
    resumed.run(180, &mut Silent).unwrap();
    assert_eq!(serial, bits(&resumed, &body), "after a restart");
}

/// Random rigid shapes, turned, are shot at blocks of elements: none passes through, whatever the step.
#[test]
fn ten_random_turned_shapes_do_not_pass_through() {
    shoot_random_shapes(10);
}

#[test]
#[ignore = "half a minute"]
fn forty_random_turned_shapes_do_not_pass_through() {
    shoot_random_shapes(40);
}

fn shoot_random_shapes(count: usize) {
    let mut random = random(7);
    for k in 0..count {
        let turn = Vector3::new(random(), random(), random()) * 3.0;
        let axis = Rotation3::new(turn) * Vector3::z();
        // Above the middle of the block, whatever its shape.
        let centre = Point3::new(1.5e-3 + 0.8e-3 * random(), 1.5e-3 + 0.8e-3 * random(), 5.6e-3);
        let tetrahedron = || {
            let x = [
                [1.0, 1.0, 1.0],
                [-1.0, -1.0, 1.0],
                [-1.0, 1.0, -1.0],
                [1.0, -1.0, -1.0],
            ];
            let x = x.map(|x| centre + Rotation3::new(turn) * Vector3::from(x) * 0.7e-3);
            let faces = [[0, 1, 3], [0, 2, 1], [0, 3, 2], [1, 2, 3]];
            Solid::new(faces.map(|f| f.map(|i: usize| x[i])).to_vec())
        };
        let shape = match k % 5 {
            0 => RigidShape::Sphere {
                centre,
                radius: 0.5e-3 + 0.5e-3 * random(),
            },
            1 => RigidShape::cuboid(centre, Vector3::new(1.2e-3, 0.9e-3, 1.5e-3), turn),
            2 => RigidShape::Cone {
                tip: centre - axis * 0.7e-3,
                axis,
                height: 1.4e-3,
                radius: 0.8e-3,
            },
            3 => RigidShape::Cylinder {
                point: centre,
                axis: axis.cross(&Vector3::z()),
                radius: 0.7e-3,
            },
            _ => RigidShape::Solid(Arc::new(tetrahedron().unwrap())),
        };
        let motion = Motion::Free {
            mass: 5e-5,
            velocity: Vector3::new(0.0, 0.0, -40.0),
            inertia: None,
        };
        let body = rigid(shape, motion);
        let fraction = 0.1 + 0.85 * random();
        let kind = ["hex", "tet", "cnem"][k % 3];
        let law = ContactLaw {
            friction: 0.2,
            ..ContactLaw::elastic(E)
        };
        let s = against(cube(kind, 4), &body, law);
        let mut run = run_of(vec![s], fraction);
        let start = 0.5 * 5e-5 * 1600.0;
        // Until it has come back: the block is free as well and lighter, so it leaves faster.
        let mut deepest = 0.0_f64;
        while run.time() < 4e-4 {
            run.run(20, &mut Silent).unwrap();
            deepest = deepest.max(depth(&run, &body));
        }
        assert!(
            deepest < 0.5 * H,
            "{k} {kind} at {fraction:.2}: {deepest:e} m deep"
        );
        let [velocity, _] = body.lock().velocity();
        let [momentum, _] = run.momentum();
        let mass = RHO * (4.0 * H).powi(3);
        assert!(momentum.z / mass < velocity.z, "{k} {kind}: they part");
        assert!(
            run.created() < 1e-13 * start,
            "{k} {kind}: {:e}",
            run.created() / start
        );
        // The forces of elements on a block that has flown away have the round-off of its way.
        let total = momentum + velocity * 5e-5;
        assert!(
            (total.z / (-40.0 * 5e-5) - 1.0).abs() < 1e-8,
            "{k} {kind} at {fraction}: {:e} with {} contacts",
            total.z / (-40.0 * 5e-5) - 1.0,
            contacts(&run.effects()[0])
        );
    }
}

/// A block and a packing that a soft plate would let through end the run.
#[test]
fn a_plate_that_is_too_soft_ends_the_run() {
    for kind in ["hex", "dem"] {
        let plate = RigidShape::cuboid(
            Point3::new(2.0, 2.0, -0.25) * H,
            Vector3::new(8.0, 8.0, 0.4) * H,
            Vector3::zeros(),
        );
        let soft = ContactLaw::elastic(1e-4 * E);
        let s = cube_against(kind, 4, &rigid(plate, Motion::Fixed), soft);
        let mut run = run_of(vec![moving(s, Vector3::z() * -20.0)], 0.5);
        let error = run.run(100_000, &mut Silent).unwrap_err().to_string();
        assert!(
            error.contains("obstacle 'tool'") && error.contains("modulus"),
            "{error}"
        );
    }
}

#[test]
fn surfaces_are_refused_by_name() {
    let floor = |z: f64, normal: f64| {
        let shape = RigidShape::Plane {
            point: Point3::new(0.0, 0.0, z),
            normal: Vector3::new(0.0, 0.0, normal),
        };
        rigid(shape, Motion::Fixed)
    };
    let block = cube("hex", 4);
    let law = ContactLaw::elastic(E);
    let refuse = |body: &SharedBody| {
        let error = SurfaceObstacle::new(block.model(), body, law).unwrap_err();
        error.to_string()
    };
    for body in [floor(0.0, -1.0), floor(1e-3, 1.0)] {
        let error = refuse(&body);
        assert!(error.contains("model 'block' at obstacle 'tool'"), "{error}");
        assert!(
            error.contains("points start inside") && error.contains("turn the normal"),
            "{error}"
        );
    }
    let speck = RigidShape::Sphere {
        centre: Point3::new(0.0, 0.0, -1e-3),
        radius: 1e-6,
    };
    let error = refuse(&rigid(speck, Motion::Fixed));
    assert!(
        error.contains("longest facet") && error.contains("refine"),
        "{error}"
    );
    // A ball within the block, which no point of its surface sees.
    let enclosed = RigidShape::Sphere {
        centre: Point3::new(1.7, 1.9, 2.1) * H,
        radius: 0.8 * H,
    };
    let error = refuse(&rigid(enclosed, Motion::Fixed));
    assert!(
        error.contains("the obstacle starts inside") && error.contains("'tool'"),
        "{error}"
    );
    let bar = FemModel::new("bar", generate::bar(0.0, 1.0, 4, 1.0).unwrap(), material()).unwrap();
    let error = SurfaceObstacle::new(&bar, &floor(-1.0, 1.0), law)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("'bar'") && error.contains("has no surface"),
        "{error}"
    );
}

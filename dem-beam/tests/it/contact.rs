//! Contact and obstacles: collisions against theory, friction, searches only when needed, no creation of
//! energy.
#![allow(clippy::unwrap_used, reason = "a test may")]

use approx::assert_abs_diff_eq;
use arlequin_core::{Coupled, Model, Silent, Subdomain, TimeStep, Watching, Weights};
use dem_beam::fracture::locked;
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{
    BeamMaterial, Contact, ContactLaw, Criterion, DemModel, Fracture, Matter, Motion, Obstacle, RigidShape,
};
use nalgebra::{Point3, Vector3};

const R: f64 = 1e-3;
const E: f64 = 70e9;

/// Returns dumbbells (two bonded spheres across y) at the given x positions, so that every particle has a
/// bond.
fn dumbbells(x: &[f64], radii: &[f64]) -> DemModel {
    let mut positions = Vec::new();
    let mut all_radii = Vec::new();
    let mut pairs = Vec::new();
    for (x, r) in x.iter().zip(radii) {
        let n = positions.len() as u32;
        positions.extend([Vector3::new(*x, -r, 0.0), Vector3::new(*x, *r, 0.0)]);
        all_radii.extend([*r, *r]);
        pairs.push([n, n + 1]);
    }
    let matter = Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: all_radii
            .iter()
            .map(|r| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3))
            .sum(),
    };
    DemModel::from_spheres("grains", &positions, &all_radii, &pairs, &matter).unwrap()
}

/// Returns a run of dumbbells with a velocity along x for each.
fn flying(model: DemModel, speeds: &[f64], law: ContactLaw, fraction: f64) -> Coupled<f64> {
    let contact = Contact::new(&model, law).unwrap();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    for (old, place) in model.places().iter().enumerate() {
        v[3 * *place as usize] = speeds[old / 2];
    }
    let subdomain = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(contact))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(fraction), None).unwrap()
}

fn speed(run: &Coupled<f64>, model_place: usize) -> f64 {
    run.subdomains()[0].state().v[3 * model_place]
}

#[test]
fn two_bodies_rebound_with_the_coefficient_of_restitution() {
    for e in [1.0, 0.8, 0.4] {
        let model = dumbbells(&[0.0, 2.1 * R], &[R, R]);
        let places: Vec<usize> = model.places().iter().map(|p| *p as usize).collect();
        let law = ContactLaw {
            restitution: e,
            ..ContactLaw::elastic(E)
        };
        let mut run = flying(model, &[1.0, 0.0], law, 0.1);
        let before = run.energy();
        while run.time() < 4e-4 {
            run.advance(&mut Silent).unwrap();
        }
        let parting = speed(&run, places[2]) - speed(&run, places[0]);
        assert!((parting - e).abs() < 0.02, "e = {e}: {parting}");
        let line = run.effects().into_iter().next().unwrap();
        let dissipated = line.dissipated().unwrap();
        assert!(
            line.stored.abs() < 1e-30 && dissipated > -1e-4 * before,
            "created {}",
            -dissipated
        );
        assert!((run.energy() + dissipated - before).abs() < 1e-3 * before);
        let [p, _] = run.momentum();
        let whole = run.subdomains()[0].inertia()[0] * 2.0;
        assert!((p.x - whole).abs() < 1e-12 * whole, "momentum {}", p.x);
    }
}

#[test]
fn a_pair_with_radius_ratio_one_to_twenty_collides_without_creating_energy() {
    let model = dumbbells(&[0.0, 9.5 * R], &[R, 20.0 * R]);
    let places: Vec<usize> = model.places().iter().map(|p| *p as usize).collect();
    let mut run = flying(model, &[10.0, 0.0], ContactLaw::elastic(E), 0.9);
    let before = run.energy();
    while run.time() < 3e-4 {
        run.advance(&mut Silent).unwrap();
    }
    let line = &run.effects()[0];
    let dissipated = line.dissipated().unwrap();
    assert!(dissipated.abs() < 2e-2 * before, "{dissipated} of {before}");
    assert!(
        run.subdomains()[0].state().v[3 * places[0]] < 9.0,
        "the small one is deflected"
    );
    assert!(run.drift() < 1e-10);
}

#[test]
fn friction_stops_a_sliding_body_at_the_rate_of_coulomb() {
    // Gravity presses a cube of particles on a plane, and it slides along x: v = v0 - mu g t.
    let packing = lattice(Lattice::Cubic, [3, 3, 3], R).unwrap();
    let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let bottom = model.nodes().iter().fold(f64::INFINITY, |m, x| m.min(x.z)) - R;
    let (mu, g, v0) = (0.3, 5e5, 20.0);
    let law = ContactLaw {
        friction: mu,
        restitution: 0.2,
        ..ContactLaw::elastic(E)
    };
    let plane = RigidShape::Plane {
        point: Point3::new(0.0, 0.0, bottom),
        normal: Vector3::z(),
    };
    let floor = Obstacle::new("floor", &model, plane, Motion::Fixed, law).unwrap();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    (0..n / 6).for_each(|i| v[3 * i] = v0);
    let gravity = arlequin_core::effect::BodyForce::new(Vector3::new(0.0, 0.0, -g)).unwrap();
    let damping = arlequin_core::effect::StiffnessDamping::new(2e-8).unwrap();
    let subdomain = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(floor))
        .with_effect(Box::new(gravity))
        .with_effect(Box::new(damping))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    while run.time() < 6e-5 {
        run.advance(&mut Silent).unwrap();
    }
    let mass: f64 = run.subdomains()[0].inertia()[..n / 2].iter().sum::<f64>() / 3.0;
    let mean = run.momentum()[0].x / mass;
    let expected = v0 - mu * g * run.time();
    assert_abs_diff_eq!(mean, expected, epsilon = 0.05 * (v0 - expected));
    let floor = &run.effects()[0];
    assert_eq!((floor.name.as_str(), floor.supplied), ("cube/floor", Some(0.0)));
    assert!(floor.dissipated().unwrap() > 0.0);
    assert!(run.drift() < 1e-9, "{}", run.drift());
}

#[test]
fn a_free_ball_gives_the_energy_and_momentum_that_the_body_gets() {
    let packing = lattice(Lattice::Cubic, [4, 4, 4], R).unwrap();
    let model = DemModel::new("block", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
    let top = model.nodes().iter().fold(f64::NEG_INFINITY, |m, x| m.max(x.z)) + R;
    let ball = RigidShape::Sphere {
        centre: Point3::new(4.0 * R, 4.0 * R, top + 2.1 * R),
        radius: 2.0 * R,
    };
    let (mass, v0) = (1e-4, 10.0);
    let motion = Motion::Free {
        mass,
        velocity: Vector3::new(0.0, 0.0, -v0),
        inertia: None,
    };
    let ball = Obstacle::new("ball", &model, ball, motion, ContactLaw::elastic(E)).unwrap();
    let subdomain = Subdomain::fine(model, Weights::uncoupled()).with_effect(Box::new(ball));
    let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    while run.time() < 2e-4 {
        run.advance(&mut Silent).unwrap();
    }
    let line = run.effects().into_iter().next().unwrap();
    let fact = |name: &str| line.facts.iter().find(|f| f.0 == name).unwrap().1;
    let lost = mass * (v0 + fact("velocity z [m/s]"));
    let got = run.momentum()[0].z;
    assert!((lost + got).abs() < 1e-6 * lost, "{lost} {got}");
    let (supplied, work) = (line.supplied.unwrap(), line.work.unwrap());
    assert!(supplied > 0.1 * 0.5 * mass * v0 * v0 && fact("largest force [N]") > 0.0);
    assert!(
        (supplied - work - line.stored).abs() < 1e-2 * supplied,
        "{supplied} {work}"
    );
}

/// Particles that are too soft for a blow end the run before they pass through each other.
#[test]
fn particles_that_would_pass_through_end_the_run() {
    let pair = dumbbells(&[0.0, 2.5 * R], &[R; 2]);
    let mut run = flying(pair, &[20.0, -20.0], ContactLaw::elastic(1e-5 * E), 0.5);
    let error = run.run(100_000, &mut Silent).unwrap_err().to_string();
    assert!(
        error.contains("overlap of two particles") && error.contains("enlarge the modulus"),
        "{error}"
    );
}

#[test]
fn an_indenter_at_supersonic_speed_ends_in_a_named_error_or_a_closed_balance() {
    let strike = |speed: f64, fraction: f64, modulus: f64| {
        let packing = lattice(Lattice::Cubic, [4, 4, 6], R).unwrap();
        let model = DemModel::new("block", &packing, BeamMaterial::SILICA, 2200.0)
            .unwrap()
            .with_fracture(Fracture::new(Criterion::Mises, 500e6))
            .unwrap();
        let top = model.nodes().iter().fold(f64::NEG_INFINITY, |m, x| m.max(x.z)) + R;
        let law = ContactLaw {
            restitution: 0.5,
            friction: 0.2,
            ..ContactLaw::elastic(modulus)
        };
        let shape = RigidShape::Sphere {
            centre: Point3::new(4.0 * R, 4.0 * R, top + 3.01 * R),
            radius: 3.0 * R,
        };
        let motion = Motion::Velocity(Vector3::new(0.0, 0.0, -speed));
        let indenter = Obstacle::new("indenter", &model, shape, motion, law).unwrap();
        let contact = Contact::new(&model, law).unwrap();
        let subdomain = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(contact))
            .with_effect(Box::new(indenter));
        let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(fraction), None).unwrap();
        let steps = (3.0 * R / speed / run.dt()) as usize;
        run.run(steps.max(10), &mut Silent).map(|_| run)
    };
    // Beams of silica carry waves at 10 km/s.
    let run = strike(15_000.0, 0.3, 4.0 * E).unwrap();
    assert!(run.drift() < 1e-9, "{}", run.drift());
    for line in run.effects() {
        let (dissipated, supplied) = (line.dissipated().unwrap(), run.effects()[2].supplied.unwrap());
        assert!(
            dissipated > -1e-3 * supplied,
            "{}: created {} of {supplied}",
            line.name,
            -dissipated
        );
    }
    let error = strike(15_000.0, 0.3, E).unwrap_err().to_string();
    assert!(
        error.contains("in obstacle 'indenter'") && error.contains("enlarge the modulus"),
        "{error}"
    );
    let error = strike(1e6, 0.9, E).unwrap_err().to_string();
    assert!(
        error.contains("step of obstacle 'indenter'") && error.contains("jump over particles"),
        "{error}"
    );
}

#[test]
fn the_search_is_repeated_only_when_motion_asks_for_it() {
    let packing = lattice(Lattice::Cubic, [5, 5, 5], R).unwrap();
    let searches = |speed: f64| {
        let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        let n = model.layout().dofs();
        let contact = Contact::new(&model, ContactLaw::elastic(E)).unwrap();
        let mut v = vec![0.0; n];
        (0..n / 6).for_each(|i| v[3 * i] = speed);
        let subdomain = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(contact))
            .with_initial(vec![0.0; n], v)
            .unwrap();
        let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Seconds(1e-8), None).unwrap();
        run.run(100, &mut Silent).unwrap();
        let facts = run.effects()[0].facts.clone();
        let fact = |name: &str| facts.iter().find(|f| f.0 == name).unwrap().1 as usize;
        assert_eq!(fact("calls"), 101);
        fact("neighbour searches")
    };
    assert_eq!(searches(0.0), 1);
    // 1e-6 s at 1 km/s is 1 mm: half of the skin of 0.4 mm is used up after each 0.2 mm.
    assert!((5..=6).contains(&searches(1000.0)));
}

#[test]
fn a_bond_that_breaks_becomes_a_contact_without_a_jump() {
    let packing = lattice(Lattice::Cubic, [6, 2, 2], R).unwrap();
    let model = DemModel::new("bar", &packing, BeamMaterial::SILICA, 2200.0)
        .unwrap()
        .with_fracture(Fracture::new(Criterion::Energy, 20.0))
        .unwrap();
    let log = model.break_log();
    let contact = Contact::new(&model, ContactLaw::elastic(E)).unwrap();
    let n = model.layout().dofs();
    // Under compression bonds break under pressure; the contacts then start from zero force.
    let mut v = vec![0.0; n];
    for (i, x) in model.nodes().iter().enumerate() {
        v[3 * i] = -4e3 * (x.x - 6.0 * R);
    }
    let subdomain = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(contact))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
    let before = run.energy();
    run.run(1_000, &mut Silent).unwrap();
    assert!(!locked(&log).events().is_empty());
    assert!(run.drift() < 1e-9);
    for line in run.effects() {
        assert!(line.dissipated().unwrap() > -5e-3 * before, "{line:?}");
    }
    let released = locked(&log).released();
    assert!(
        run.energy() + released < 1.02 * before,
        "{} + {released} of {before}",
        run.energy()
    );
}

#[test]
fn overlap_without_contact_is_reported() {
    let model = dumbbells(&[0.0, 2.1 * R], &[R, R]);
    let mut state = arlequin_core::State::zero(model.layout().dofs());
    assert!(model.watch(&state).is_empty());
    let moved = model.places()[2] as usize;
    state.q[3 * moved] = -0.3 * R;
    let warnings = model.watch(&state);
    assert!(
        warnings
            .iter()
            .any(|f| f.effect == "contact" && f.message.contains("overlap, by up to 10.0 %")),
        "{warnings:?}"
    );
}

#[test]
fn bad_laws_and_shapes_are_refused_by_name() {
    let model = dumbbells(&[0.0], &[R]);
    let law = ContactLaw::elastic(E);
    let refuse = |law: ContactLaw| Contact::new(&model, law).unwrap_err().to_string();
    assert!(refuse(ContactLaw { modulus: 0.0, ..law }).contains("contact modulus = 0"));
    assert!(
        refuse(ContactLaw {
            restitution: 0.0,
            ..law
        })
        .contains("coefficient of restitution = 0")
    );
    assert!(
        refuse(ContactLaw {
            friction: -0.1,
            ..law
        })
        .contains("friction coefficient = -0.1")
    );
    assert!(
        refuse(ContactLaw {
            rolling: f64::NAN,
            ..law
        })
        .contains("rolling resistance")
    );
    assert!(refuse(ContactLaw { skin: 0.0, ..law }).contains("skin of the neighbour list = 0"));
    let shape = RigidShape::Plane {
        point: Point3::origin(),
        normal: Vector3::zeros(),
    };
    let error = Obstacle::new("wall", &model, shape, Motion::Fixed, law)
        .unwrap_err()
        .to_string();
    assert!(error.contains("normal of an obstacle"), "{error}");
}

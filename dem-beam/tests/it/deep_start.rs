//! Bodies that start inside obstacles or inside each other are refused with depth and place; bodies that
//! touch are accepted.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::effect::PairSpec;
use arlequin_core::{Coupled, Model, Parts, Subdomain, TimeFunction, TimeStep, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{
    BeamMaterial, ContactBetween, ContactBody, ContactLaw, DemModel, Error, Motion, Obstacle, RigidShape,
};
use nalgebra::{Point3, Vector3};

const R: f64 = 1e-3;

fn law() -> ContactLaw {
    ContactLaw::elastic(70e9)
}

/// Returns 4 × 4 × 4 spheres, the lowest corner sphere at `corner`.
fn block(corner: Vector3<f64>) -> DemModel {
    let mut packing = lattice(Lattice::Cubic, [4, 4, 4], R).unwrap();
    let low = packing.positions[0];
    packing.positions.iter_mut().for_each(|x| *x += corner - low);
    DemModel::new("block", &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

fn start(shape: RigidShape, motion: Motion) -> Result<Obstacle, Error> {
    Obstacle::new("tool", &block(Vector3::zeros()), shape, motion, law())
}

fn floor(height: f64, normal: f64) -> RigidShape {
    RigidShape::Plane {
        point: Point3::new(0.0, 0.0, height),
        normal: Vector3::z() * normal,
    }
}

fn sphere(centre: [f64; 3], radius: f64) -> RigidShape {
    RigidShape::Sphere {
        centre: centre.into(),
        radius,
    }
}

fn roller(height: f64, radius: f64) -> RigidShape {
    RigidShape::Cylinder {
        point: Point3::new(0.0, 3.0 * R, height),
        axis: Vector3::x(),
        radius,
    }
}

/// Obstacles that contain sphere centres at the start are refused with the number of centres and the depth of
/// the deepest sphere. Layers of centres lie at 0, 2, 4 and 6 radii.
#[test]
fn obstacles_that_hold_centres_at_the_start_are_refused_with_depth_and_place() {
    for (what, shape, count, depth) in [
        ("sunken floor", floor(0.1 * R, 1.0), 16, 1.1),
        ("floor sunken to the middle", floor(3.0 * R, 1.0), 32, 4.0),
        ("reversed wall", floor(-R, -1.0), 64, 8.0),
        (
            "ball inside",
            sphere([2.0 * R, 2.0 * R, 2.0 * R], 1.5 * R),
            1,
            2.5,
        ),
        (
            "ball in a gap",
            sphere([3.0 * R, 3.0 * R, 3.0 * R], 1.8 * R),
            8,
            1.8 - 3.0_f64.sqrt() + 1.0,
        ),
        (
            "roller between rows",
            roller(3.0 * R, 1.5 * R),
            16,
            1.5 - 2.0_f64.sqrt() + 1.0,
        ),
    ] {
        let refused = start(shape, Motion::Fixed).unwrap_err();
        let Error::StartsInside {
            count: found,
            depth: deepest,
            limit,
            place,
            ..
        } = &refused
        else {
            panic!("{what}: {refused}");
        };
        assert_eq!(*found, count, "{what}");
        assert!((deepest / R - depth).abs() < 1e-6, "{what}: {deepest:e}");
        assert!((limit / R - 1.0).abs() < 1e-6 && place[2] > -1e-6 * R, "{what}");
        let text = refused.to_string();
        assert!(
            text.contains("obstacle 'tool'") && text.contains("turn the normal"),
            "{text}"
        );
    }
}

/// A ball a tenth as large as a particle is refused once it overlaps the particle by its own radius, and
/// accepted if it overlaps by less.
#[test]
fn small_balls_inside_a_particle_are_refused() {
    for (distance, refused) in [(0.35, true), (0.95, true), (1.05, false)] {
        let result = start(sphere([-distance * R, 0.0, 0.0], 0.1 * R), Motion::Fixed);
        match result {
            Ok(_) => assert!(!refused, "{distance}"),
            Err(Error::StartsInside { depth, limit, .. }) => {
                assert!(
                    refused && (depth / R - 1.1 + distance).abs() < 1e-6,
                    "{distance}: {depth:e}"
                );
                assert!((limit / R - 0.1).abs() < 1e-6, "{limit:e}");
            }
            Err(other) => panic!("{other}"),
        }
    }
}

/// Bodies whose centres lie just in front of an obstacle's surface are accepted, although their spheres reach
/// behind it.
#[test]
fn bodies_that_touch_an_obstacle_start() {
    for (what, shape) in [
        ("floor below", floor(-R, 1.0)),
        ("floor at nine tenths of a radius", floor(-0.1 * R, 1.0)),
        ("wall above", floor(6.1 * R, -1.0)),
        ("ball on top", sphere([3.0 * R, 3.0 * R, 9.0 * R], 2.0 * R)),
        ("ball in a gap", sphere([3.0 * R, 3.0 * R, 3.0 * R], 1.7 * R)),
        ("roller on top", roller(8.2 * R, 2.0 * R)),
    ] {
        assert!(start(shape, Motion::Fixed).is_ok(), "{what}");
    }
}

#[test]
fn a_driven_obstacle_is_where_its_motion_begins() {
    let motion = |amplitude: f64| Motion::Prescribed {
        amplitude: Vector3::z() * amplitude,
        time: TimeFunction::Step,
    };
    assert!(start(floor(-2.0 * R, 1.0), motion(1.9 * R)).is_ok());
    let refused = start(floor(-2.0 * R, 1.0), motion(2.1 * R)).unwrap_err();
    assert!(
        matches!(refused, Error::StartsInside { count: 16, .. }),
        "{refused}"
    );
}

/// Particles that initial displacements put into an obstacle are refused when the run is set up.
#[test]
fn particles_displaced_into_an_obstacle_are_refused_before_the_first_step() {
    let set_up = |depth: f64| {
        let model = block(Vector3::zeros());
        let wall = Obstacle::new("floor", &model, floor(-R, 1.0), Motion::Fixed, law()).unwrap();
        let n = model.layout().dofs();
        let shift = |k: usize| if k < n / 2 && k % 3 == 2 { -depth } else { 0.0 };
        let s = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(wall))
            .with_initial((0..n).map(shift).collect(), vec![0.0; n])
            .unwrap();
        Coupled::new(vec![s], Vec::new(), TimeStep::Fraction(0.5), None).map(|_| ())
    };
    assert!(set_up(0.9 * R).is_ok());
    let text = set_up(1.1 * R).unwrap_err().to_string();
    assert!(
        text.contains("16 particles start inside obstacle 'floor'"),
        "{text}"
    );
}

/// Sets up two bodies whose nearest layers are `apart` radii apart, the upper one displaced down by `pushed`
/// \[m\]; returns the error.
fn pair(distance: f64, pushed: f64) -> Result<(), String> {
    let below = block(Vector3::zeros());
    let above = block(Vector3::new(0.0, 0.0, (6.0 + distance) * R));
    let contact = ContactBetween::new(
        ContactBody::from_model(&below),
        ContactBody::from_model(&above),
        law(),
    )
    .unwrap();
    let n = below.layout().dofs();
    let side = |model: DemModel, depth: f64| {
        let shift = |k: usize| if k < n / 2 && k % 3 == 2 { -depth } else { 0.0 };
        Subdomain::fine(model, Weights::uncoupled())
            .with_initial((0..n).map(shift).collect(), vec![0.0; n])
            .unwrap()
    };
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![side(below, 0.0), side(above, pushed)],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    let run = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None);
    run.map(|_| ()).map_err(|e| e.to_string())
}

#[test]
fn bodies_that_start_inside_each_other_are_refused_and_those_that_touch_start() {
    assert_eq!(pair(2.0, 0.0), Ok(()));
    assert_eq!(pair(1.1, 0.0), Ok(()));
    for refused in [pair(0.9, 0.0), pair(2.0, 1.1 * R)] {
        let text = refused.unwrap_err();
        assert!(
            text.contains("16 particles start inside particles of the other body"),
            "{text}"
        );
        assert!(text.contains("1.100e-3 m behind"), "{text}");
    }
    // Half of one body lies in the other.
    assert!(pair(-2.5, 0.0).unwrap_err().contains("start inside"));
}

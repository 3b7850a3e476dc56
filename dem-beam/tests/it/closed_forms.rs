//! Criteria, contact and masses against textbook formulas.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::effect::BodyForce;
use arlequin_core::{Coupled, Interpolation, Model, Silent, Subdomain, TimeStep, Weights};
use dem_beam::fracture::locked;
use dem_beam::{
    BeamMaterial, Contact, ContactLaw, Criterion, DemModel, Fracture, Matter, Motion, Obstacle, RigidShape,
};
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

const R: f64 = 1e-3;

fn matter(radii: &[f64]) -> Matter {
    let spheres: f64 = radii.iter().map(|r| 4.0 / 3.0 * PI * r.powi(3)).sum();
    Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: spheres,
    }
}

/// Returns two spheres of radius R along x, joined by one beam of length 2R.
fn beam() -> DemModel {
    let x = [Vector3::zeros(), Vector3::new(2.0 * R, 0.0, 0.0)];
    DemModel::from_spheres("beam", &x, &[R, R], &[[0, 1]], &matter(&[R, R])).unwrap()
}

/// Returns the displacements of an elongation, a twist and opposite end rotations of the beam.
fn deformed(model: &DemModel, [stretch, twist, bend]: [f64; 3]) -> Vec<f64> {
    let [a, b] = [0, 1].map(|k: usize| model.places()[k] as usize);
    let mut q = vec![0.0; 12];
    q[3 * b] = stretch;
    q[6 + 3 * b] = twist;
    (q[6 + 3 * a + 1], q[6 + 3 * b + 1]) = (bend, -bend);
    q
}

/// Returns whether the beam breaks at once in this deformation.
fn breaks(criterion: Criterion, strength: f64, deformation: [f64; 3]) -> bool {
    let model = beam().with_fracture(Fracture::new(criterion, strength)).unwrap();
    let (log, q) = (model.break_log(), deformed(&model, deformation));
    let body = Subdomain::fine(model, Weights::uncoupled())
        .with_initial(q.clone(), vec![0.0; q.len()])
        .unwrap();
    let step = TimeStep::Fraction(1e-4);
    let mut run = Coupled::new(vec![body], Vec::new(), step, None).unwrap();
    run.run(1, &mut Silent).unwrap();
    !locked(&log).events().is_empty()
}

/// A bond breaks at the stress of beam theory. A round beam of radius r = 0.71 R and length 2R has tension
/// `E u/l`, bending `2 E r φ/l` at the rim if the ends turn by `±φ` (curvature `2φ/l`), and shear `G r θ/l`
/// at the rim if one end is twisted by `θ`.
#[test]
fn bonds_break_at_the_stress_of_beam_theory() {
    let (young, poisson) = (265e9, 0.3);
    let (r, l, shear) = (0.71 * R, 2.0 * R, young / (2.0 * (1.0 + poisson)));
    for [stretch, twist, bend] in [
        [1e-6, 0.0, 0.0],
        [0.0, 0.0, 1e-3],
        [0.0, 2e-3, 0.0],
        [1e-6, 2e-3, 0.0],
        [1e-6, 1e-3, 1e-3],
        [-1e-6, 2e-3, 2e-3],
    ] {
        let normal = young * stretch / l;
        let bending = 2.0 * young * r * bend.abs() / l;
        let tau = shear * r * twist.abs() / l;
        // Largest principal stress at the rim, and the von Mises stress there.
        let tension = normal + bending;
        let rankine = tension / 2.0 + (tension * tension / 4.0 + tau * tau).sqrt();
        let mises = ((normal.abs() + bending).powi(2) + 3.0 * tau * tau).sqrt();
        for (criterion, stress) in [(Criterion::Rankine, rankine), (Criterion::Mises, mises)] {
            let breaks_at = |factor: f64| breaks(criterion, stress * factor, [stretch, twist, bend]);
            assert!(
                !breaks_at(1.001) && breaks_at(0.999),
                "{criterion:?} under {stretch} m, {twist} rad, {bend} rad: not at {stress:e} Pa"
            );
        }
        if normal > 0.0 {
            let breaks_at = |factor: f64| breaks(Criterion::Axial, normal * factor, [stretch, twist, bend]);
            assert!(
                !breaks_at(1.001) && breaks_at(0.999),
                "axial: not at {normal:e} Pa"
            );
        }
    }
}

/// By the energy with a tension split, a beam that bends and is compressed breaks at `U_M/S ((b - p)/b)^2`,
/// where `U_M = E I/(2 l) (2φ)²` is its energy of bending, `b` the bending stress and `p` the compression. It
/// does not break where `p > b`.
#[test]
fn compressed_beams_break_by_the_tension_that_is_left() {
    let (young, r, l) = (265e9, 0.71 * R, 2.0 * R);
    let bend = 1e-3;
    let bending = 2.0 * young * r * bend / l;
    let energy = young * r * r / 4.0 * (2.0 * bend).powi(2) / (2.0 * l);
    for share in [0.0, 0.3, 0.8] {
        let left: f64 = 1.0 - share;
        let deformation = [-share * bending * l / young, 0.0, bend];
        let breaks_at = |factor: f64| {
            breaks(
                Criterion::TensileEnergy,
                energy * left * left * factor,
                deformation,
            )
        };
        assert!(!breaks_at(1.001) && breaks_at(0.999), "compressed by {share} b");
    }
    let crushed = [-1.01 * bending * l / young, 0.0, bend];
    assert!(!breaks(Criterion::TensileEnergy, 1e-6 * energy, crushed));
    assert!(breaks(Criterion::Energy, energy, crushed));
}

/// Spheres of 1 and 2 mm have masses and volumes as the cubes of their radii, and inertias of two fifths of
/// `m r²`.
#[test]
fn masses_volumes_and_inertias_are_those_of_spheres() {
    let radii = [R, 2.0 * R, 1.5 * R];
    let x = [0.0, 3.0 * R, 6.5 * R].map(|x| Vector3::new(x, 0.0, 0.0));
    let volume = 5e-8;
    let matter = Matter {
        volume,
        ..matter(&radii)
    };
    let model = DemModel::from_spheres("row", &x, &radii, &[[0, 1], [1, 2]], &matter).unwrap();
    let cubes: f64 = 1.0 + 8.0 + 3.375;
    let field = model.particle_field();
    let near = |measured: f64, expected: f64, what: &str| {
        assert!(
            (measured / expected - 1.0).abs() < 1e-14,
            "{what}: {measured:e} {expected:e}"
        );
    };
    for (k, r) in radii.iter().enumerate() {
        let place = model.places()[k] as usize;
        let share = volume * (r / R).powi(3) / cubes;
        near(model.masses()[place], 2200.0 * share, "mass");
        near(field.samples().unwrap()[place].measure, share, "volume");
        near(model.inertias()[place], 0.4 * 2200.0 * share * r * r, "inertia");
        near(
            model.body().inertia()[place],
            0.4 * 2200.0 * share * r * r,
            "inertia",
        );
    }
}

/// Returns pairs of equal spheres joined side by side across y; each pair moves as one.
fn pairs(centres: &[Vector3<f64>]) -> DemModel {
    let side = Vector3::y() * R;
    let x: Vec<_> = centres.iter().flat_map(|x| [x - side, x + side]).collect();
    let radii = vec![R; x.len()];
    let bonds: Vec<[u32; 2]> = (0..centres.len() as u32).map(|k| [2 * k, 2 * k + 1]).collect();
    DemModel::from_spheres("pairs", &x, &radii, &bonds, &matter(&radii)).unwrap()
}

/// A collision of two free spheres lasts half a period of `k = E R` and the reduced mass `m/2`. The velocity
/// follows `½ v (1 + cos ω t)`, from 0.9 to 0.1 of its initial value in `2 asin(0.8)/ω`.
#[test]
fn a_collision_lasts_half_a_period_of_its_spring() {
    let young = 70e9;
    let model = pairs(&[Vector3::zeros(), Vector3::x() * (2.0 * R + 1e-6)]);
    let (mass, first) = (model.masses()[0], model.places()[0] as usize);
    let contact = Contact::new(&model, ContactLaw::elastic(young)).unwrap();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    model.places()[..2].iter().for_each(|p| v[3 * *p as usize] = 1.0);
    let body = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(contact))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.05), None).unwrap();
    let (mut before, mut crossed) = (1.0, Vec::new());
    while run.time() < 5e-5 && crossed.len() < 2 {
        run.run(1, &mut Silent).unwrap();
        let now = run.subdomains()[0].state().v[3 * first];
        let level = [0.9, 0.1][crossed.len()];
        if now < level {
            crossed.push(run.time() - run.dt() * (level - now) / (before - now));
        }
        before = now;
    }
    let expected = 2.0 * 0.8f64.asin() / (young * R / (0.5 * mass)).sqrt();
    let duration = crossed[1] - crossed[0];
    assert!(
        (duration / expected - 1.0).abs() < 0.01,
        "{duration:e} s, {expected:e} s"
    );
}

/// Rolling resistance with the moment `μ R m g` slows a sphere that rolls on a plane without sliding at the
/// rate `μ g/(1 + 2/5)` for any contact springs: `v̇ (m + I/R²) = −μ m g`.
#[test]
fn rolling_resistance_stops_a_rolling_sphere_at_the_rate_of_its_moment() {
    let (friction, rolling, g, v0) = (0.8, 0.05, 2e4, 5.0);
    let model = pairs(&[Vector3::zeros()]);
    let law = ContactLaw {
        friction,
        rolling,
        restitution: 0.2,
        ..ContactLaw::elastic(7e8)
    };
    // The depth at which the spring carries the weight.
    let depth = model.masses()[0] * g / (2.0 * 7e8 * R);
    let plane = RigidShape::Plane {
        point: Point3::new(0.0, 0.0, -R + depth),
        normal: Vector3::z(),
    };
    let floor = Obstacle::new("floor", &model, plane, Motion::Fixed, law).unwrap();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    for k in 0..2 {
        v[3 * k] = v0;
        v[6 + 3 * k + 1] = v0 / R;
    }
    let body = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(floor))
        .with_effect(Box::new(BodyForce::new(Vector3::new(0.0, 0.0, -g)).unwrap()))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    let speeds = |run: &Coupled<f64>| {
        let v = &run.subdomains()[0].state().v;
        [v[0], v[6 + 1] * R]
    };
    let slope = 5.0 / 7.0 * rolling * g;
    while run.time() < 0.5 * v0 / slope {
        run.run(1, &mut Silent).unwrap();
    }
    let [speed, rim] = speeds(&run);
    let expected = v0 - slope * run.time();
    assert!(
        (speed - expected).abs() < 0.02 * (v0 - expected),
        "{speed} m/s, {expected} m/s"
    );
    assert!(
        (rim - speed).abs() < 0.02 * speed,
        "rolls without sliding: {rim} {speed}"
    );
}

//! Collisions of spheres of very different size, and a supersonic rigid ball that hits a coupled body.

use super::breakage::{Cloud, Start, Torn, coupled};
use super::{HardCase, Outcome};
use arlequin::core::effect::EffectSpec;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Result, Silent, TimeStep};
use arlequin::dem_beam::fracture::locked;
use arlequin::dem_beam::{Contact, ContactLaw, Criterion, DemModel, Fracture, Motion, Obstacle, RigidShape};

pub(super) const CASES: &[HardCase] = &[
    HardCase {
        name: "contact of radius ratio 1:20",
        why: "masses differ by 8000, the dashpot must follow the lighter end",
        naive: "dashpot of the mean mass: unstable",
        promise: "the spheres part, nothing is created, balance and momentum are kept; 1:21 is refused",
        fast: true,
        run: sizes,
    },
    HardCase {
        name: "an indenter at supersonic speed",
        why: "no wave warns the particles, bonds break by the hundred, a step may jump over spheres",
        naive: "positions at whole steps only: it passes through the body without a touch",
        promise: "the balance closes and no effect creates energy; a jump over particles is an error by name",
        fast: true,
        run: supersonic,
    },
];

const LAW: ContactLaw = ContactLaw {
    modulus: 1.4,
    restitution: 0.5,
    friction: 0.2,
    shear_ratio: 0.5,
    rolling: 0.0,
    skin: 0.4,
};

/// Returns the smallest energy that an effect has dissipated, over `scale`. A negative value is created
/// energy.
fn least_dissipated(torn: &Torn, scale: f64) -> f64 {
    let lines = torn.run.effects();
    let dissipated = lines.iter().filter_map(|e| e.dissipated());
    dissipated.fold(f64::INFINITY, f64::min) / scale
}

/// Returns the lattice with two small bonded spheres beside its far end.
fn with_pebbles(ratio: f64) -> Cloud {
    let mut cloud = Cloud::lattice(0.25, 2.125);
    let (n, r) = (cloud.radii.len() as u32, cloud.radii[0] / ratio);
    for side in [-1.0, 1.0] {
        cloud
            .positions
            // Leaves a gap of a tenth of the small radius.
            .push(Vector3::new(4.0 + 1.1 * r, 0.375 + side * r, 0.375));
        cloud.radii.push(r);
    }
    cloud.pairs.push([n, n + 1]);
    cloud
}

fn sizes() -> Result<Outcome> {
    let mut out = Outcome::default();
    let cloud = with_pebbles(20.0);
    let n = cloud.radii.len();
    let speed = Vector3::new(-0.1, 0.0, 0.0);
    let start = Start {
        step: TimeStep::Fraction(0.5),
        velocity: &|i, _| if i + 2 >= n { speed } else { Vector3::zeros() },
        ..Start::default()
    };
    let touching =
        |m: &DemModel| -> Result<Vec<Box<dyn EffectSpec<f64>>>> { Ok(vec![Box::new(Contact::new(m, LAW)?)]) };
    let mut torn = coupled(&cloud, Fracture::new(Criterion::Rankine, 1e3), &start, &touching)?;
    let (before, energy) = (torn.run.momentum()[0], torn.run.energy());
    torn.run.run(6000, &mut Silent)?;
    let contacts = |torn: &Torn, name: &str| {
        let facts = torn.run.effects().swap_remove(1).facts;
        facts.into_iter().find(|f| f.0 == name).map_or(f64::NAN, |f| f.1)
    };
    out.add(
        "most contacts at a time",
        contacts(&torn, "most contacts"),
        2.0..=4.0,
    );
    out.add("contacts at the end", contacts(&torn, "contacts"), 0.0..=0.0);
    let v = &torn.run.subdomains()[1].state().v;
    let parting = v[3 * torn.places[n - 1] as usize] / 0.1;
    out.add("speed of the small spheres over that before", parting, 0.3..=0.7);
    let change = (torn.run.momentum()[0] - before).norm() / before.norm();
    out.add("change of the linear momentum", change, 0.0..=1e-10);
    out.add(
        "least energy dissipated by an effect over all",
        least_dissipated(&torn, energy),
        -1e-9..=1.0,
    );
    out.add("drift", torn.run.drift(), 0.0..=1e-10);
    let wide = coupled(
        &with_pebbles(21.0),
        Fracture::new(Criterion::Rankine, 1e3),
        &start,
        &touching,
    );
    out.add_refusal("a radius ratio of 1:21", wide.map(|t| t.run), |e| {
        e.to_string().contains("21.0 times the smallest")
    });
    let [small, large] = [1.0, 8000.0];
    out.add_naive(
        "energy after over before",
        mean_mass_dashpot(small, large),
        1e3..=f64::INFINITY,
    );
    Ok(out)
}

/// Returns the energy after a collision over that before, if the dashpot is 0.2 of the critical damping of
/// the mean mass. The step is 0.9 of the spring's limit.
fn mean_mass_dashpot(small: f64, large: f64) -> f64 {
    // The relative motion has the reduced mass, which is close to that of the small sphere.
    let reduced = small * large / (small + large);
    let c = 2.0 * 0.2 * (0.5 * (small + large)).sqrt();
    let dt = 0.9 * 2.0 * reduced.sqrt();
    let (mut gap, mut v) = (0.0, 1.0f64);
    for _ in 0..20 {
        gap += v * dt;
        if gap < 0.0 {
            break;
        }
        v -= dt * (gap + c * v) / reduced;
    }
    v * v
}

/// Builds a run in which a ball flies towards the far end of the body.
fn strike(speed: f64, step: TimeStep<f64>) -> Result<Torn> {
    let cloud = Cloud::lattice(0.25, 2.125);
    let start = Start {
        step,
        ..Start::default()
    };
    let ball = RigidShape::Sphere {
        centre: Point3::new(4.41, 0.5, 0.5),
        radius: 0.4,
    };
    let motion = Motion::Velocity(Vector3::new(-speed, 0.0, 0.0));
    let extra = |m: &DemModel| -> Result<Vec<Box<dyn EffectSpec<f64>>>> {
        let indenter = Obstacle::new("indenter", m, ball.clone(), motion.clone(), LAW)?;
        Ok(vec![Box::new(Contact::new(m, LAW)?), Box::new(indenter)])
    };
    coupled(&cloud, Fracture::new(Criterion::Mises, 0.05), &start, &extra)
}

fn supersonic() -> Result<Outcome> {
    let mut out = Outcome::default();
    // The bar wave has velocity 1, the wave along a beam 1.9.
    let speed = 3.0;
    let mut torn = strike(speed, TimeStep::Fraction(0.3))?;
    let steps = (1.0 / speed / torn.run.dt()) as usize;
    torn.run.run(steps, &mut Silent)?;
    let supplied = torn.run.effects().swap_remove(2).supplied.unwrap_or(f64::NAN);
    out.add(
        "bonds broken",
        locked(&torn.log).events().len() as f64,
        50.0..=400.0,
    );
    out.add("energy it brought", supplied, 1e-3..=1e3);
    out.add(
        "least energy dissipated by an effect over that",
        least_dissipated(&torn, supplied),
        -1e-3..=1.0,
    );
    let gained = torn.run.energy() / supplied;
    out.add("energy of the bodies over that", gained, 0.0..=1.0);
    out.add("drift", torn.run.drift(), 0.0..=1e-11);
    out.add("velocity jump", torn.run.constraint_residual(), 0.0..=1e-10);
    let mut fast = strike(100.0 * speed, TimeStep::Fraction(0.9))?;
    let jump = fast
        .run
        .run(100, &mut Silent)
        .err()
        .map_or_else(String::new, |e| e.to_string());
    let named = jump.contains("step of obstacle 'indenter'") && jump.contains("jump over particles");
    out.add(
        "a hundred times faster is refused by name",
        f64::from(u8::from(named)),
        1.0..=1.0,
    );
    // The naive check: positions at whole steps against spheres at rest.
    let way = 100.0 * speed * fast.run.dt();
    let cloud = Cloud::lattice(0.25, 2.125);
    let touched = (0..100).any(|k| {
        let centre = Vector3::new(4.41 - 5.0 * way * f64::from(k), 0.5, 0.5);
        cloud.positions.iter().any(|x| (x - centre).norm() < 0.4 + 0.125)
    });
    out.add_naive(
        "touches at five times that speed",
        f64::from(u8::from(touched)),
        0.0..=0.0,
    );
    Ok(out)
}

//! Free obstacles that turn, and runs resumed while an obstacle is in contact.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::effect::BodyForce;
use arlequin_core::{Coupled, Model, Silent, Subdomain, TimeFunction, TimeStep, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, ContactLaw, Criterion, DemModel, Fracture, Motion, Obstacle, RigidShape};
use nalgebra::{Point3, Vector3};

const R: f64 = 1e-3;
const E: f64 = 70e9;

const MASS: f64 = 2e-4;

/// Run of free spheres (their bonds break in the first step) that a ball strikes off centre.
struct Stroke {
    run: Coupled<f64>,
    centre: Point3<f64>,
    velocity: Vector3<f64>,
    inertia: f64,
    first_spin: Vector3<f64>,
    field: Vector3<f64>,
}

impl Stroke {
    fn new(law: ContactLaw, inertia: Option<f64>) -> Self {
        Self::in_field(law, inertia, Vector3::zeros(), Vector3::zeros())
    }

    /// Like [`Stroke::new`], with an initial spin of the ball and a field of acceleration on ball and
    /// spheres.
    fn in_field(
        law: ContactLaw,
        inertia: Option<f64>,
        first_spin: Vector3<f64>,
        field: Vector3<f64>,
    ) -> Self {
        let packing = lattice(Lattice::Cubic, [4, 4, 4], R).unwrap();
        let model = DemModel::new("block", &packing, BeamMaterial::SILICA, 2200.0)
            .unwrap()
            .with_fracture(Fracture::new(Criterion::Energy, 1e-30))
            .unwrap();
        let n = model.layout().dofs();
        // A uniform strain breaks all bonds at once.
        let mut q = vec![0.0; n];
        for (i, x) in model.nodes().iter().enumerate() {
            (0..3).for_each(|c| q[3 * i + c] = 1e-9 * x[c]);
        }
        let top = model.nodes().iter().fold(f64::NEG_INFINITY, |m, x| m.max(x.z)) + R;
        let centre = Point3::new(4.3 * R, 3.1 * R, top + 2.05 * R);
        let velocity = Vector3::new(3.0, 1.0, -20.0);
        let motion = Motion::Free {
            mass: MASS,
            velocity,
            inertia,
        };
        let shape = RigidShape::Sphere {
            centre,
            radius: 2.0 * R,
        };
        let ball = Obstacle::new("ball", &model, shape, motion, law)
            .unwrap()
            .with_spin(first_spin)
            .unwrap()
            .with_acceleration(field, TimeFunction::Step);
        let subdomain = Subdomain::fine(model, Weights::uncoupled())
            .with_effect(Box::new(ball))
            .with_effect(Box::new(BodyForce::new(field).unwrap()))
            .with_initial(q, vec![0.0; n])
            .unwrap();
        let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.3), None).unwrap();
        run.run(400, &mut Silent).unwrap();
        Self {
            run,
            centre,
            velocity,
            inertia: inertia.unwrap_or(0.4 * MASS * 4.0 * R * R),
            first_spin,
            field,
        }
    }

    fn ball(&self, what: &str, unit: &str) -> Vector3<f64> {
        let facts = self.run.effects().swap_remove(1).facts;
        let fact = |name: &str| facts.iter().find(|f| f.0 == name).map_or(0.0, |f| f.1);
        Vector3::from(["x", "y", "z"].map(|a| fact(&format!("{what} {a} [{unit}]"))))
    }

    fn spin(&self) -> Vector3<f64> {
        self.ball("spin", "rad/s")
    }

    /// Returns the losses of momentum and angular momentum, relative to the ball's at the start.
    fn lost(&self) -> [f64; 2] {
        let side = &self.run.subdomains()[0];
        let (s, m, half) = (side.state(), side.inertia(), 0.5 * self.run.dt());
        let vector = |x: &[f64], k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
        let flight = self.ball("velocity", "m/s") * MASS;
        let place = self.centre + self.ball("displacement", "m");
        let mut momentum = [flight, place.coords.cross(&flight) + self.spin() * self.inertia];
        for (i, x) in side.model().nodes().iter().enumerate() {
            // Velocities of half a step ago, like the ball's.
            let v = |k: usize| vector(&s.v, k) - vector(&s.a, k) * half;
            let p = v(3 * i) * m[3 * i];
            let o = s.q.len() / 2 + 3 * i;
            momentum[0] += p;
            momentum[1] += (x.coords + vector(&s.q, 3 * i)).cross(&p) + v(o) * m[o];
        }
        let p = self.velocity * MASS;
        let mass: f64 = MASS + (0..side.model().nodes().len()).map(|i| m[3 * i]).sum::<f64>();
        let pulled = self.field * (mass * (self.run.time() - half));
        let start = [
            p + pulled,
            self.centre.coords.cross(&p) + self.first_spin * self.inertia,
        ];
        [0, 1].map(|k: usize| (momentum[k] - start[k]).norm() / start[k].norm())
    }

    /// Returns the energy that contacts dissipated, relative to the ball's at the start.
    fn dissipated(&self) -> f64 {
        let line = self.run.effects().swap_remove(1);
        line.dissipated().unwrap() / (0.5 * MASS * self.velocity.norm_squared())
    }
}

/// With friction the ball starts to turn, and the spheres lose the angular momentum that it gains.
#[test]
fn a_free_ball_turns_and_keeps_the_angular_momentum() {
    let law = ContactLaw {
        friction: 0.3,
        restitution: 0.5,
        ..ContactLaw::elastic(E)
    };
    for inertia in [None, Some(1e-11)] {
        let stroke = Stroke::new(law, inertia);
        let (spin, lost, dissipated) = (stroke.spin().norm(), stroke.lost(), stroke.dissipated());
        let drift = stroke.run.drift();
        assert!(spin > 10.0, "{spin}");
        assert!(lost[0] < 1e-12 && lost[1] < 1e-12, "{lost:?}");
        assert!(
            dissipated > 0.0 && dissipated < 1.0 && drift < 1e-10,
            "{dissipated} {drift}"
        );
    }
    let elastic = ContactLaw {
        friction: 0.3,
        ..ContactLaw::elastic(E)
    };
    let stroke = Stroke::new(elastic, None);
    let (spin, lost, dissipated) = (stroke.spin().norm(), stroke.lost(), stroke.dissipated());
    // Without dashpots only friction takes energy.
    assert!(
        spin > 10.0 && lost[1] < 1e-12 && dissipated > -1e-3,
        "{spin} {lost:?} {dissipated}"
    );
    let spin = Stroke::new(ContactLaw::elastic(E), None).spin().norm();
    assert!(spin <= 0.0, "without friction nothing turns it: {spin}");
}

#[test]
fn a_ball_that_spins_at_first_gives_its_angular_momentum_to_what_it_rubs() {
    let law = ContactLaw {
        friction: 0.3,
        restitution: 0.5,
        ..ContactLaw::elastic(E)
    };
    let first = Vector3::new(300.0, -5000.0, 4000.0);
    let stroke = Stroke::in_field(law, None, first, Vector3::zeros());
    let (change, lost, drift) = ((stroke.spin() - first).norm(), stroke.lost(), stroke.run.drift());
    assert!(change > 10.0, "{change}");
    assert!(lost[0] < 1e-12 && lost[1] < 1e-12, "{lost:?}");
    assert!(drift < 1e-10, "{drift}");
    // Without friction the ball keeps its spin.
    let smooth = Stroke::in_field(ContactLaw::elastic(E), None, first, Vector3::zeros());
    assert!((smooth.spin() - first).norm() <= 0.0);
}

/// A field that acts on ball and spheres alike changes nothing between them: momentum grows by weight times
/// time, their interaction is that without the field, and the ledger misses no energy.
#[test]
fn a_free_ball_falls_with_what_it_strikes() {
    let law = ContactLaw {
        friction: 0.3,
        restitution: 0.5,
        ..ContactLaw::elastic(E)
    };
    let field = Vector3::new(2e4, -1e4, -3e5);
    let [still, falling] =
        [Vector3::zeros(), field].map(|f| Stroke::in_field(law, None, Vector3::zeros(), f));
    let (lost, drift) = (falling.lost(), falling.run.drift());
    assert!(lost[0] < 1e-12 && drift < 1e-10, "{lost:?} {drift}");
    let (dt, steps) = (falling.run.dt(), 400.0);
    assert!((dt / still.run.dt() - 1.0).abs() < 1e-14);
    let fall = field * (0.5 * (steps * dt).powi(2));
    let moved = [&still, &falling].map(|s| s.ball("displacement", "m"));
    let error = (moved[1] - moved[0] - fall).norm() / moved[0].norm();
    assert!(
        fall.norm() > 0.05 * moved[0].norm() && error < 1e-9,
        "{error} {fall} {}",
        moved[0]
    );
    let spun = (falling.spin() - still.spin()).norm() / still.spin().norm();
    assert!(spun < 1e-7, "{spun}");
}

#[test]
fn planes_and_cylinders_do_not_turn() {
    let model = DemModel::new(
        "block",
        &lattice(Lattice::Cubic, [2, 2, 2], R).unwrap(),
        BeamMaterial::SILICA,
        2200.0,
    )
    .unwrap();
    let motion = Motion::Free {
        mass: 1.0,
        velocity: Vector3::zeros(),
        inertia: Some(1.0),
    };
    let roller = RigidShape::Cylinder {
        point: Point3::new(0.0, 0.0, 5.0 * R),
        axis: Vector3::y(),
        radius: R,
    };
    let refuse = |shape, motion| {
        let result = Obstacle::new("it", &model, shape, motion, ContactLaw::elastic(E));
        result.unwrap_err().to_string()
    };
    let fixed = Obstacle::new(
        "it",
        &model,
        roller.clone(),
        Motion::Fixed,
        ContactLaw::elastic(E),
    )
    .unwrap();
    let error = fixed.with_spin(Vector3::x()).unwrap_err().to_string();
    assert!(
        error.contains("make the obstacle a sphere with a mass"),
        "{error}"
    );
    let error = refuse(roller, motion);
    assert!(
        error.contains("moves without turning") && error.contains("make the obstacle a sphere"),
        "{error}"
    );
    let ball = RigidShape::Sphere {
        centre: Point3::new(0.0, 0.0, 5.0 * R),
        radius: R,
    };
    let flat = Motion::Free {
        mass: 1.0,
        velocity: Vector3::zeros(),
        inertia: Some(0.0),
    };
    assert!(refuse(ball, flat).contains("moment of inertia of an obstacle"));
}

/// A ball resumed from a snapshot in the middle of a stroke goes on with the same bits, although its list of
/// near particles is built anew.
#[test]
fn a_stroke_goes_on_with_the_same_bits() {
    let packing = lattice(Lattice::Cubic, [5, 5, 5], R).unwrap();
    let build = || {
        let model = DemModel::new("block", &packing, BeamMaterial::SILICA, 2200.0).unwrap();
        let top = model.nodes().iter().fold(f64::NEG_INFINITY, |m, x| m.max(x.z)) + R;
        let law = ContactLaw {
            friction: 0.3,
            restitution: 0.6,
            ..ContactLaw::elastic(E)
        };
        let shape = RigidShape::Sphere {
            centre: Point3::new(4.3 * R, 5.1 * R, top + 2.05 * R),
            radius: 2.0 * R,
        };
        let motion = Motion::Free {
            mass: 1e-4,
            velocity: Vector3::new(30.0, 0.0, -40.0),
            inertia: None,
        };
        let ball = Obstacle::new("ball", &model, shape, motion, law)
            .unwrap()
            .with_spin(Vector3::new(0.0, 900.0, 0.0))
            .unwrap()
            .with_acceleration(
                Vector3::new(0.0, 0.0, -1e5),
                TimeFunction::Ramp { duration: 1e-5 },
            );
        let side = Subdomain::fine(model, Weights::uncoupled()).with_effect(Box::new(ball));
        Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.3), None).unwrap()
    };
    let bits = |run: &Coupled<f64>| {
        let s = run.subdomains()[0].state();
        let facts = run.effects().swap_remove(0).facts;
        let values =
            s.q.iter()
                .chain(&s.v)
                .copied()
                .chain(facts.into_iter().map(|f| f.1));
        values.map(f64::to_bits).collect::<Vec<_>>()
    };
    let mut whole = build();
    whole.run(600, &mut Silent).unwrap();
    for cut in [7, 150, 401] {
        let mut first = build();
        first.run(cut, &mut Silent).unwrap();
        let mut second = build();
        second.run(33, &mut Silent).unwrap();
        second.restore(&first.snapshot().unwrap()).unwrap();
        second.run(600 - cut, &mut Silent).unwrap();
        assert!(bits(&whole) == bits(&second), "cut at {cut}");
    }
}

//! Contacts that last through changes of the weights of a zone that moves along a bar in space.

use crate::rezoning_space::{Bar, Fine, NESTED, lattice, place, weights};
use crate::support::solid::material;
use arlequin::core::contact::{
    self, ContactLaw, Exterior, RigidBody, RigidShape, SharedBody, SurfaceContact, SurfaceObstacle,
};
use arlequin::core::effect::{PairEffectSpec, PairSpec};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{Coupled, Rezoning, Silent, Subdomain, Weights};
use arlequin::dem_beam::packing::{Lattice, lattice as cubic};
use arlequin::dem_beam::{BeamMaterial, ContactBetween, ContactBody, DemModel};
use arlequin::fem_ref::{ElementKind, FemModel, generate};

fn still() -> impl FnMut(&Point3<f64>) -> [Vector3<f64>; 4] {
    |_| [Vector3::zeros(); 4]
}

/// An elastic law, one with damping, and one with friction.
fn laws() -> [ContactLaw; 3] {
    let elastic = ContactLaw::elastic(1.0);
    let damped = ContactLaw {
        restitution: 0.3,
        ..elastic
    };
    let rough = ContactLaw {
        friction: 0.5,
        ..elastic
    };
    [elastic, damped, rough]
}

/// Bits or numbers of the state of all models.
fn state(run: &Coupled<f64>) -> Vec<f64> {
    let states = run.subdomains().iter().map(Subdomain::state);
    states.flat_map(|s| s.q.iter().chain(&s.v)).copied().collect()
}

/// Largest speed of a node \[m/s\].
fn top_speed(run: &Coupled<f64>) -> f64 {
    let speeds = |s: &Subdomain<f64>| {
        let moving = &s.state().v[..s.model().layout().translations()];
        let speed = |v: &[f64; 3]| Vector3::from(*v).norm();
        moving.as_chunks().0.iter().map(speed).fold(0.0, f64::max)
    };
    run.subdomains().iter().map(speeds).fold(0.0, f64::max)
}

/// Asserts that two runs have the same state but for the round-off of the step, which a change keeps.
fn assert_alike(moved: &Coupled<f64>, built: &Coupled<f64>) {
    let (a, b) = (state(moved), state(built));
    let top = b.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let apart = a.iter().zip(&b).fold(0.0, |m: f64, (x, y)| m.max((x - y).abs()));
    let works: Vec<f64> = built.effects().iter().filter_map(|e| e.work).collect();
    println!("apart by {apart:e} of {top:e}, works {works:?}");
    assert!(
        works.len() == 2 && works.iter().all(|w| w.abs() > 1e-6),
        "{works:?}"
    );
    assert!(apart <= 1e-9 * top, "{apart:e} of {top:e}");
}

/// Lets both models touch one cylinder that flies across the bar, over its whole length.
fn struck([bar, fine]: [Subdomain<f64>; 2], law: ContactLaw) -> [Subdomain<f64>; 2] {
    let shape = RigidShape::Cylinder {
        point: Point3::new(0.0, 0.5, 3.01),
        axis: Vector3::x(),
        radius: 2.0,
    };
    let flies = contact::Motion::Free {
        mass: 0.5,
        velocity: Vector3::new(0.1, 0.0, -0.2),
        inertia: None,
    };
    let body = SharedBody::new(RigidBody::new("roller", shape, flies).unwrap());
    [bar, fine].map(|s| {
        let contact = SurfaceObstacle::new(s.model(), &body, law).unwrap();
        s.with_effect(Box::new(contact))
    })
}

/// Contacts that stay through a change act like contacts that are made for the new weights: those with
/// damping know the masses, and the budgets of those without know how nodes will move.
#[test]
fn contacts_that_stay_know_the_new_weights() {
    for law in laws() {
        let bar = Bar {
            counts: NESTED,
            step: 0.8,
            ..Bar::new(Fine::Hexahedra, 1)
        };
        let build = |from| {
            bar.build_of(
                struck(bar.bodies(from, &mut still()), law).into(),
                from,
                Vec::new(),
            )
        };
        let (mut moved, mut built) = (build(place(1)), build(place(2)));
        let [coarse, fine] = weights(place(2));
        let change = Rezoning::new(bar.interfaces(place(2)))
            .with_weights(0, coarse)
            .with_weights(1, fine)
            .with_kept_effect(0)
            .with_kept_effect(1);
        let work = moved.rezone(change).unwrap().work;
        assert!(work == 0.0, "{work:e}");
        for run in [&mut moved, &mut built] {
            run.run(1000, &mut Silent).unwrap();
        }
        assert_alike(&moved, &built);
    }
}

/// A roller on the bar while the zone goes to and fro below it: no node is thrown that has become light.
#[test]
fn a_roller_on_a_zone_that_goes_to_and_fro_throws_nothing() {
    for law in laws() {
        let bar = Bar {
            counts: NESTED,
            ..Bar::new(Fine::Hexahedra, 1)
        };
        let bodies = struck(bar.bodies(place(0), &mut still()), law);
        let mut run = bar.build_of(bodies.into(), place(0), Vec::new());
        let mut speed = 0.0_f64;
        for n in 1..=10 {
            run.run(12, &mut Silent).unwrap();
            let [coarse, fine] = weights(place(n));
            let change = Rezoning::new(bar.interfaces(place(n)))
                .with_weights(0, coarse)
                .with_weights(1, fine)
                .with_kept_effect(0)
                .with_kept_effect(1);
            run.rezone(change).unwrap();
            run.run(1, &mut Silent).unwrap();
            speed = speed.max(top_speed(&run));
        }
        println!("speed {speed:e}, created {:e}", run.created());
        assert!(speed < 0.6, "{speed:e}");
        assert!(run.created() < 1e-12, "{:e}", run.created());
    }
}

/// What strikes the bar from above.
#[derive(Debug, Clone, Copy)]
enum Striker {
    Hexahedra,
    Spheres,
}

/// A striker with its exterior, and its spheres if it has any.
struct Body {
    side: Subdomain<f64>,
    exterior: Exterior,
    spheres: Option<ContactBody>,
}

impl Striker {
    /// Makes a block over most of the bar, `gap` above it.
    fn build(self, gap: f64) -> Body {
        let low = Point3::new(0.3, 0.1, 1.0 + gap);
        match self {
            Self::Hexahedra => {
                let high = low + Vector3::new(9.0, 0.7, 0.5);
                let mesh = generate::block(ElementKind::Hex8, low, high, [18, 2, 1]).unwrap();
                let model = FemModel::new("striker", mesh, material()).unwrap();
                Body {
                    exterior: Exterior::surface(&model).unwrap(),
                    side: Subdomain::coarse(model, Weights::uncoupled()),
                    spheres: None,
                }
            }
            Self::Spheres => {
                let mut packing = cubic(Lattice::Cubic, [30, 3, 2], 0.15).unwrap();
                let first = low.coords.add_scalar(0.15) - packing.positions[0];
                packing.positions.iter_mut().for_each(|x| *x += first);
                let beam = BeamMaterial {
                    young: 1.0,
                    poisson: 0.3,
                    radius_ratio: 0.7,
                };
                let model = DemModel::new("striker", &packing, beam, 1.0).unwrap();
                let spheres = ContactBody::from_model(&model);
                Body {
                    exterior: spheres.exterior(),
                    side: Subdomain::fine(model, Weights::uncoupled()),
                    spheres: Some(spheres),
                }
            }
        }
    }
}

/// A bar with a zone and a striker that touches both, with its velocity.
struct Blow {
    bar: Bar,
    striker: Striker,
    law: ContactLaw,
    velocity: Vector3<f64>,
}

impl Blow {
    fn contact(
        &self,
        first: [&Exterior; 2],
        spheres: [Option<ContactBody>; 2],
    ) -> Box<dyn PairEffectSpec<f64>> {
        match spheres {
            [Some(a), Some(b)] => Box::new(ContactBetween::new(a, b, self.law).unwrap()),
            _ => Box::new(SurfaceContact::new(first[0], first[1], self.law).unwrap()),
        }
    }

    fn build(&self, from: f64) -> Coupled<f64> {
        let [bar, fine] = self.bar.bodies(from, &mut still());
        let Body {
            side,
            exterior,
            spheres,
        } = self.striker.build(5e-3);
        let layout = side.model().layout();
        let mut v = vec![0.0; layout.dofs()];
        v[..layout.translations()]
            .chunks_mut(3)
            .for_each(|v| v.copy_from_slice(self.velocity.as_slice()));
        let side = side.with_initial(vec![0.0; v.len()], v).unwrap();
        let of_fine = matches!(self.bar.fine, Fine::Spheres).then(|| ContactBody::from_model(&lattice()));
        let fine_exterior = match &of_fine {
            Some(spheres) => spheres.exterior(),
            None => Exterior::surface(fine.model()).unwrap(),
        };
        let bar_exterior = Exterior::surface(bar.model()).unwrap();
        let pairs = vec![
            PairSpec {
                sides: [0, 2],
                effect: self.contact([&bar_exterior, &exterior], [None, spheres.clone()]),
            },
            PairSpec {
                sides: [2, 1],
                effect: self.contact([&exterior, &fine_exterior], [spheres, of_fine]),
            },
        ];
        self.bar.build_of(vec![bar, fine, side], from, pairs)
    }

    fn rezone(&self, run: &mut Coupled<f64>, from: f64) -> f64 {
        let [coarse, fine] = weights(from);
        let change = Rezoning::new(self.bar.interfaces(from))
            .with_weights(0, coarse)
            .with_weights(1, fine);
        run.rezone(change).unwrap().work
    }
}

/// Contacts between models that stay through a change act like those that are made for the new weights.
#[test]
fn contacts_between_models_that_stay_know_the_new_weights() {
    for (fine, striker) in [
        (Fine::Hexahedra, Striker::Hexahedra),
        (Fine::Spheres, Striker::Hexahedra),
        (Fine::Spheres, Striker::Spheres),
    ] {
        for law in laws() {
            let bar = Bar {
                counts: NESTED,
                ..Bar::new(fine, 1)
            };
            let velocity = Vector3::new(0.05, 0.0, -0.1);
            let blow = Blow {
                bar,
                striker,
                law,
                velocity,
            };
            let (mut moved, mut built) = (blow.build(place(1)), blow.build(place(2)));
            let work = blow.rezone(&mut moved, place(2));
            assert!(work == 0.0, "{work:e}");
            for run in [&mut moved, &mut built] {
                run.run(150, &mut Silent).unwrap();
            }
            assert_alike(&moved, &built);
        }
    }
}

/// A striker rests on the bar while the zone goes to and fro below it: all that is kept without changes is
/// kept, and no contact creates energy.
#[test]
fn a_striker_on_a_zone_that_goes_to_and_fro_keeps_momenta_and_creates_no_energy() {
    for (fine, striker) in [
        (Fine::Hexahedra, Striker::Hexahedra),
        (Fine::Tetrahedra, Striker::Hexahedra),
        (Fine::Spheres, Striker::Hexahedra),
        (Fine::Spheres, Striker::Spheres),
    ] {
        for law in laws() {
            let bar = Bar {
                counts: NESTED,
                ..Bar::new(fine, 1)
            };
            let velocity = Vector3::new(0.02, 0.01, -0.1);
            let blow = Blow {
                bar,
                striker,
                law,
                velocity,
            };
            let mut run = blow.build(place(0));
            let (start, energy) = (run.momentum()[0], run.energy());
            let (mut changed, mut speed) = (0.0_f64, 0.0_f64);
            for n in 1..=10 {
                run.run(12, &mut Silent).unwrap();
                blow.rezone(&mut run, place(n));
                run.run(1, &mut Silent).unwrap();
                changed = changed.max((run.momentum()[0] - start).norm() / start.norm());
                speed = speed.max(top_speed(&run));
            }
            run.run(12, &mut Silent).unwrap();
            let works: Vec<f64> = run.effects().iter().filter_map(|e| e.work).collect();
            let drift = run.last_energy().unwrap().drift / energy;
            println!(
                "{fine:?} {striker:?}: momentum {changed:e}, works {works:?}, drift {drift:e}, created {:e}, speed {speed:e}",
                run.created()
            );
            assert!(works.iter().all(|w| w.abs() > 1e-6 * energy), "{works:?}");
            assert!(changed < 1e-12, "{changed:e}");
            assert!(speed < 3.0 * velocity.norm(), "{speed:e}");
            assert!(drift.abs() < 1e-11, "{drift:e}");
            assert!(run.created() <= 1e-12 * energy, "{:e}", run.created());
        }
    }
}

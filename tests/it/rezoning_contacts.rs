//! Contacts that last through changes of the weights of a zone that moves along a bar in space.
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

use crate::rezoning_space::{Bar, Fine, NESTED, lattice, place, weights, weights_of};
use crate::support::solid::material;
use arlequin::core::contact::{
    self, ContactLaw, Exterior, RigidBody, RigidShape, SharedBody, SurfaceContact, SurfaceObstacle,
};
use arlequin::core::effect::{EffectSpec, PairEffectSpec, PairSpec};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, OwnStep, Parts, Profile, Rezoned, Rezoning, Silent, Subdomain, TimeStep, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice as cubic};
use arlequin::dem_beam::{BeamMaterial, ContactBetween, ContactBody, DemModel, Obstacle};
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

/// Displacements and velocities of all models.
fn state(run: &Coupled<f64>) -> Vec<f64> {
    let states = run.subdomains().iter().map(Subdomain::state);
    states.flat_map(|s| s.q.iter().chain(&s.v)).copied().collect()
}

/// Returns the change of weights that moves the zone of a bar, without effects.
fn change(bar: &Bar, from: f64) -> Rezoning<f64> {
    let [coarse, fine] = weights(from);
    let change = Rezoning::new(bar.interfaces(from));
    change.with_weights(0, coarse).with_weights(1, fine)
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

const ROLLER: f64 = 0.5;

/// Lets both models touch one cylinder that flies across the bar, over its whole length.
fn struck([bar, fine]: [Subdomain<f64>; 2], law: ContactLaw) -> [Subdomain<f64>; 2] {
    let shape = RigidShape::Cylinder {
        point: Point3::new(0.0, 0.5, 3.01),
        axis: Vector3::x(),
        radius: 2.0,
    };
    let flies = contact::Motion::Free {
        mass: ROLLER,
        velocity: Vector3::new(0.1, 0.0, -0.2),
        inertia: None,
    };
    let body = SharedBody::new(RigidBody::new("roller", shape, flies).unwrap());
    [bar, fine].map(|s| {
        let contact: Box<dyn EffectSpec<f64>> = match s.model().layout().turns() {
            true => Box::new(Obstacle::of_body(&lattice(), &body, law).unwrap()),
            false => Box::new(SurfaceObstacle::new(s.model(), &body, law).unwrap()),
        };
        s.with_effect(contact)
    })
}

/// Momentum \[kg m/s\] of all models and of the roller across the bar.
fn momentum_with_roller(run: &Coupled<f64>) -> f64 {
    let effects = run.subdomains().iter().flat_map(Subdomain::effects);
    let facts = effects.filter(|e| e.rigid().is_some()).last().unwrap().facts();
    let fact = |name: &str| facts.iter().find(|f| f.0 == name).unwrap().1;
    // Its velocity is that of half a step before.
    let kick = fact("force on it z [N]") * 0.5 * run.dt();
    run.momentum()[0].z + ROLLER * fact("velocity z [m/s]") + kick
}

/// Contacts that stay through a change act like contacts that are made for the new weights: those with
/// damping know the masses, and the budgets of those without know how nodes will move.
#[test]
fn contacts_that_stay_know_the_new_weights() {
    for law in laws() {
        let bar = Bar {
            counts: NESTED,
            step: TimeStep::Fraction(0.8),
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
        let change = change(&bar, place(2)).with_kept_effect(0).with_kept_effect(1);
        let work = moved.rezone(change).unwrap().work;
        assert!(work == 0.0, "{work:e}");
        for run in [&mut moved, &mut built] {
            run.run(1000, &mut Silent).unwrap();
        }
        assert_alike(&moved, &built);
    }
}

/// A roller on the bar while the zone goes to and fro below it: momentum is kept, and no node is thrown that
/// has become light.
#[test]
fn a_roller_on_a_zone_that_goes_to_and_fro_throws_nothing() {
    for fine in [Fine::Hexahedra, Fine::Spheres] {
        for law in laws() {
            let bar = Bar {
                counts: NESTED,
                ..Bar::new(fine, 1)
            };
            let bodies = struck(bar.bodies(place(0), &mut still()), law);
            let mut run = bar.build_of(bodies.into(), place(0), Vec::new());
            let (mut speed, mut changed) = (0.0_f64, 0.0_f64);
            let start = ROLLER * -0.2;
            for n in 1..=10 {
                run.run(12, &mut Silent).unwrap();
                let change = change(&bar, place(n)).with_kept_effect(0).with_kept_effect(1);
                run.rezone(change).unwrap();
                run.run(1, &mut Silent).unwrap();
                speed = speed.max(top_speed(&run));
                changed = changed.max((momentum_with_roller(&run) / start - 1.0).abs());
            }
            println!(
                "{fine:?}: speed {speed:e}, momentum {changed:e}, created {:e}",
                run.created()
            );
            assert!(speed < 0.24, "{speed:e}");
            assert!(changed < 1e-12, "{changed:e}");
            assert!(run.created() < 1e-12, "{:e}", run.created());
        }
    }
}

/// Kinds of bodies that strike the bar from above.
#[derive(Debug, Clone, Copy)]
enum Striker {
    Hexahedra,
    /// A shorter block of hexahedra, over a part of the bar where the fine model sleeps.
    Short,
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
            Self::Hexahedra | Self::Short => {
                let (low, length) = match self {
                    Self::Short => (low + Vector3::x() * 7.7, 1.5),
                    _ => (low, 9.0),
                };
                let high = low + Vector3::new(length, 0.7, 0.5);
                let counts = [(2.0 * length) as usize, 2, 1];
                let mesh = generate::block(ElementKind::Hex8, low, high, counts).unwrap();
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
        let (subdomains, pairs) = self.parts(self.bar.bodies(from, &mut still()));
        self.bar.build_of(subdomains, from, pairs)
    }

    /// The bar, the fine model and the striker, and the contacts of the striker with both.
    fn parts(&self, [bar, fine]: [Subdomain<f64>; 2]) -> (Vec<Subdomain<f64>>, Vec<PairSpec<f64>>) {
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
        let fine_spheres =
            matches!(self.bar.fine, Fine::Spheres).then(|| ContactBody::from_model(&lattice()));
        let fine_exterior = match &fine_spheres {
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
                effect: self.contact([&exterior, &fine_exterior], [spheres, fine_spheres]),
            },
        ];
        (vec![bar, fine, side], pairs)
    }

    fn rezone(&self, run: &mut Coupled<f64>, from: f64) -> Rezoned<f64> {
        run.rezone(change(&self.bar, from)).unwrap()
    }
}

/// Runs up to `seconds` from now.
fn pass(run: &mut Coupled<f64>, seconds: f64) {
    run.run((seconds / run.dt()).ceil() as usize, &mut Silent)
        .unwrap();
}

const KINDS: [(Fine, Striker); 4] = [
    (Fine::Hexahedra, Striker::Hexahedra),
    (Fine::Tetrahedra, Striker::Hexahedra),
    (Fine::Spheres, Striker::Hexahedra),
    (Fine::Spheres, Striker::Spheres),
];

/// Returns a bar with a zone, and a striker that comes down on it; both touch by `law`.
fn blow((fine, striker): (Fine, Striker), law: ContactLaw) -> Blow {
    Blow {
        bar: Bar {
            counts: NESTED,
            ..Bar::new(fine, 1)
        },
        striker,
        law,
        velocity: Vector3::new(0.02, 0.01, -0.1),
    }
}

/// Contacts between models that stay through a change act like those that are made for the new weights.
#[test]
fn contacts_between_models_that_stay_know_the_new_weights() {
    for kinds in [KINDS[0], KINDS[2], KINDS[3]] {
        for law in laws() {
            let mut blow = blow(kinds, law);
            // So short that the striker is not there in the first step: what gained weight begins its
            // contacts in that step without a force.
            blow.bar.step = TimeStep::Fraction(0.4);
            let mut moved = blow.build(place(1));
            // A change keeps the step, and critical steps depend on the weights.
            blow.bar.step = TimeStep::Seconds(moved.dt());
            let mut built = blow.build(place(2));
            let work = blow.rezone(&mut moved, place(2)).work;
            assert!(work == 0.0, "{work:e}");
            for run in [&mut moved, &mut built] {
                run.run(150, &mut Silent).unwrap();
            }
            assert_alike(&moved, &built);
        }
    }
}

/// A striker rests on the bar while the zone goes to and fro below it: a change leaves the striker alone,
/// momentum is kept, no contact creates energy, and nothing is thrown.
#[test]
fn a_striker_on_a_zone_that_goes_to_and_fro_keeps_momenta_and_creates_no_energy() {
    for kinds in KINDS {
        for law in laws() {
            let blow = blow(kinds, law);
            let mut run = blow.build(place(0));
            let (start, energy) = (run.momentum()[0], run.energy());
            let (mut changed, mut speed) = (0.0_f64, 0.0_f64);
            for n in 1..=10 {
                run.run(12, &mut Silent).unwrap();
                let before = run.subdomains()[2].state().v.clone();
                let motions = blow.rezone(&mut run, place(n)).motions;
                assert_eq!(motions.len(), 2, "the bar with its zone, and the striker");
                assert!(before == run.subdomains()[2].state().v);
                run.run(1, &mut Silent).unwrap();
                changed = changed.max((run.momentum()[0] - start).norm() / start.norm());
                speed = speed.max(top_speed(&run));
            }
            run.run(12, &mut Silent).unwrap();
            let works: Vec<f64> = run.effects().iter().filter_map(|e| e.work).collect();
            let drift = run.last_energy().unwrap().drift / energy;
            println!(
                "{kinds:?}: momentum {changed:e}, works {works:?}, drift {drift:e}, created {:e}, speed {speed:e}",
                run.created()
            );
            assert!(works.iter().all(|w| w.abs() > 1e-6 * energy), "{works:?}");
            assert!(changed < 1e-12, "{changed:e}");
            assert!(speed < 3.0 * blow.velocity.norm(), "{speed:e}");
            assert!(drift.abs() < 1e-11, "{drift:e}");
            assert!(run.created() <= 1e-12 * energy, "{:e}", run.created());
        }
    }
}

/// Contacts of nodes that gain weight under a striker begin without a force, and an overlap that was allowed
/// then is allowed later as well.
#[test]
fn contacts_between_models_begin_anew_with_what_gains_weight() {
    for kinds in [KINDS[0], KINDS[2], KINDS[3]] {
        let blow = blow(kinds, laws()[1]);
        let mut run = blow.build(place(0));
        pass(&mut run, 0.5);
        // Energies of the contacts with the fine model and with the bar.
        let stored = |run: &Coupled<f64>| [1, 0].map(|k: usize| run.effects()[k].stored);
        let before = stored(&run);
        blow.rezone(&mut run, place(7));
        let change = stored(&run);
        run.run(2, &mut Silent).unwrap();
        let after = stored(&run);
        pass(&mut run, 0.1);
        blow.rezone(&mut run, place(6));
        run.run(2, &mut Silent).unwrap();
        let last = stored(&run);
        println!("{kinds:?}: {before:?}, change {change:?}, after {after:?}, last {last:?}");
        assert!((0..2).all(|k| change[k] <= before[k]), "{change:?} of {before:?}");
        assert!(after[0] < 0.06 * before[0], "{after:?} of {before:?}");
        assert!(after[1] < 0.4 * before[1], "{after:?} of {before:?}");
        if let Striker::Spheres = kinds.1 {
            assert!(last[0] < 0.12 * before[0], "{last:?} of {before:?}");
        }
    }
}

/// A run that is resumed at a change, or a little later, goes on with the same bits.
#[test]
fn contacts_between_models_outlive_a_restart_beside_a_change() {
    for kinds in [KINDS[2], KINDS[3]] {
        for steps in [0, 5] {
            let blow = blow(kinds, laws()[2]);
            let mut whole = blow.build(place(0));
            pass(&mut whole, 0.35);
            for n in 1..3 {
                blow.rezone(&mut whole, place(n));
                pass(&mut whole, 0.1);
            }
            blow.rezone(&mut whole, place(3));
            whole.run(steps, &mut Silent).unwrap();
            let saved = whole.snapshot().unwrap();
            let mut resumed = blow.build(place(3));
            resumed.restore(&saved).unwrap();
            for run in [&mut whole, &mut resumed] {
                run.run(6, &mut Silent).unwrap();
                blow.rezone(run, place(4));
                run.run(20, &mut Silent).unwrap();
            }
            assert!(state(&whole) == state(&resumed), "{kinds:?}, {steps} steps");
        }
    }
}

/// A striker over elements whose spheres sleep touches the elements alone.
#[test]
fn facets_and_spheres_that_sleep_touch_nothing() {
    for fine in [Fine::Hexahedra, Fine::Tetrahedra, Fine::Spheres] {
        let mut run = blow((fine, Striker::Short), laws()[0]).build(place(0));
        pass(&mut run, 0.5);
        let most = [0, 1].map(|k: usize| {
            let facts = &run.effects()[k].facts;
            facts.iter().find(|f| f.0 == "most contacts").unwrap().1
        });
        assert!(most[0] > 0.0 && most[1] == 0.0, "{most:?}");
    }
}

/// The step bears contacts of what sleeps, too: it may wake.
#[test]
fn the_step_bears_contacts_of_what_sleeps() {
    for kinds in [KINDS[0], KINDS[2], KINDS[3]] {
        let blow = blow(kinds, laws()[2]);
        let whole = [Weights::uncoupled(), Weights::uncoupled()];
        let bodies = blow.bar.weighted_bodies(whole, &mut still());
        let (subdomains, pairs) = blow.parts(bodies);
        let parts = Parts {
            start: 0.0,
            end: None,
            subdomains,
            interfaces: Vec::new(),
            pairs,
        };
        let whole = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None).unwrap();
        let [zone, whole] = [&blow.build(place(0)), &whole].map(|run| run.critical_steps()[2]);
        assert!((zone / whole - 1.0).abs() < 1e-12, "{zone:e} and {whole:e} s");
    }
}

/// Models between which an interface acts have tied nodes, which change with the weights.
#[test]
fn contacts_between_tied_models_are_refused_by_name() {
    let bar = Bar {
        counts: NESTED,
        ..Bar::new(Fine::Hexahedra, 1)
    };
    let [coarse, fine] = bar.bodies(place(0), &mut still());
    let exteriors = [&coarse, &fine].map(|s| Exterior::surface(s.model()).unwrap());
    let contact = SurfaceContact::new(&exteriors[0], &exteriors[1], laws()[0]).unwrap();
    let pair = PairSpec {
        sides: [0, 1],
        effect: Box::new(contact),
    };
    let mut run = bar.build_of(vec![coarse, fine], place(0), vec![pair]);
    let message = run
        .rezone(change(&bar, place(1)))
        .map(|_| ())
        .unwrap_err()
        .to_string();
    assert!(message.contains("an interface ties"), "{message}");
}

/// New weights that need more own steps give them to all models that touch each other.
#[test]
fn models_that_touch_get_the_same_own_steps_in_a_change() {
    let mut blow = blow(KINDS[0], laws()[0]);
    blow.bar.step = TimeStep::Fraction(0.95);
    let bodies = blow.bar.bodies(place(0), &mut still());
    let (subdomains, pairs) = blow.parts(bodies.map(|s| s.with_step(OwnStep::Same)));
    let mut run = blow.bar.build_of(subdomains, place(0), pairs);
    run.run(20, &mut Silent).unwrap();
    // Stiffness where there is little mass.
    let [heavy, stiff] = [Profile::Quintic, Profile::Linear].map(|profile| weights_of(place(1), &profile));
    let [coarse, fine] = [0, 1].map(|k: usize| Weights {
        internal: stiff[k].internal.clone(),
        ..heavy[k].clone()
    });
    let change = Rezoning::new(blow.bar.interfaces(place(1)));
    run.rezone(change.with_weights(0, coarse).with_weights(1, fine))
        .unwrap();
    let steps: Vec<usize> = run.subdomains().iter().map(Subdomain::own_steps).collect();
    assert_eq!(steps, [2, 2, 2]);
    run.run(50, &mut Silent).unwrap();
}

/// A model without effects, whose kernel makes its steps, goes on as it was when others change their weights.
#[test]
fn a_model_that_makes_its_steps_itself_is_left_alone() {
    let blow = blow(KINDS[3], laws()[0]);
    let run = |changes: &[usize]| {
        let (mut bodies, _) = blow.parts(blow.bar.bodies(place(0), &mut still()));
        let layout = bodies[2].model().layout();
        let mut v = vec![0.0; layout.dofs()];
        // Not a rigid motion.
        v[..layout.translations()]
            .iter_mut()
            .step_by(5)
            .for_each(|v| *v = 0.1);
        let free = bodies.remove(2).with_initial(vec![0.0; v.len()], v).unwrap();
        bodies.push(free);
        let mut run = blow.bar.build_of(bodies, place(0), Vec::new());
        run.run(20, &mut Silent).unwrap();
        for n in changes {
            blow.rezone(&mut run, place(*n));
            run.run(20, &mut Silent).unwrap();
        }
        run.run(20 * (2 - changes.len()), &mut Silent).unwrap();
        run.subdomains()[2].state().q.clone()
    };
    let (moved, still) = (run(&[1, 2]), run(&[]));
    let top = still.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let apart = moved
        .iter()
        .zip(&still)
        .fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(top > 1e-3 && apart < 1e-12 * top, "{apart:e} of {top:e}");
}

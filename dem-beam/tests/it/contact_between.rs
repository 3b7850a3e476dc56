//! Contact between two models: momentum, energy, restarts, threads, and runs without it.
#![allow(clippy::unwrap_used, reason = "a test may")]

use approx::assert_abs_diff_eq;
use arlequin_core::effect::{Host, HostPair, Instant, PairEffect, PairEffectSpec, PairSpec};
use arlequin_core::{
    Arms, Claim, Coupled, DofLayout, Model, Observer, Parts, Phase, Silent, StepReport, Subdomain, TimeStep,
    Weights, conformance,
};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{BeamMaterial, ContactBetween, ContactBody, ContactLaw, DemModel};
use nalgebra::Vector3;
use std::ops::ControlFlow;

const R: f64 = 1e-3;
const E: f64 = 70e9;

/// Returns a lattice block of `cells` whose lowest corner sphere lies at `corner`.
fn block(name: &str, cells: [usize; 3], radius: f64, corner: Vector3<f64>) -> DemModel {
    let mut packing = lattice(Lattice::Cubic, cells, radius).unwrap();
    let low = packing.positions[0];
    packing.positions.iter_mut().for_each(|x| *x += corner - low);
    DemModel::new(name, &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

/// Returns a large block and a small one of finer spheres above it, shifted.
fn bodies() -> [DemModel; 2] {
    let below = block("target", [6, 6, 3], R, Vector3::zeros());
    let above = block(
        "ball",
        [4, 4, 4],
        0.7 * R,
        Vector3::new(2.3 * R, 2.9 * R, 4.0 * R + 1.72 * R),
    );
    [below, above]
}

fn side(model: DemModel, velocity: [f64; 3]) -> Subdomain<f64> {
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    (0..n / 2).for_each(|i| v[i] = velocity[i % 3]);
    Subdomain::fine(model, Weights::uncoupled())
        .with_initial(vec![0.0; n], v)
        .unwrap()
}

fn impact(law: ContactLaw, fraction: f64) -> Coupled<f64> {
    impact_of(bodies(), law, fraction)
}

fn impact_of([a, b]: [DemModel; 2], law: ContactLaw, fraction: f64) -> Coupled<f64> {
    let contact = ContactBetween::new(ContactBody::from_model(&a), ContactBody::from_model(&b), law).unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![side(a, [0.0; 3]), side(b, [3.0, -1.0, -20.0])],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    Coupled::from_parts(parts, TimeStep::Fraction(fraction), None).unwrap()
}

/// When bodies collide with friction, angular momentum is conserved. Finite laws balance about the present
/// positions, as contact does; linear laws about the positions at rest, and the ledger says so.
#[test]
fn angular_momentum_is_kept_when_bodies_that_turn_collide_with_friction() {
    let law = ContactLaw {
        restitution: 0.5,
        friction: 0.3,
        rolling: 0.1,
        ..ContactLaw::elastic(E)
    };
    let mut run = impact_of(bodies().map(DemModel::with_finite_rotations), law, 0.8);
    run.run((3e-5 / run.dt()) as usize, &mut Silent).unwrap();
    let body = run.bodies().remove(0);
    assert_eq!(body.models, ["target", "ball"]);
    assert_eq!((body.arms, &body.claim), (Arms::Current, &Claim::Both));
    assert!(body.drift.iter().all(|d| *d < 1e-13), "{:?}", body.drift);
    assert!(run.effects()[2].dissipated().unwrap() > 0.05 * run.energy());
    assert!(run.warnings().is_empty());
    let mut run = impact(law, 0.8);
    run.run((3e-5 / run.dt()) as usize, &mut Silent).unwrap();
    let body = run.bodies().remove(0);
    let Claim::Linear(reason) = &body.claim else {
        panic!("{:?}", body.claim);
    };
    assert!(
        reason.starts_with("the law of 'target' balances about the positions at rest, 'contact "),
        "{reason}"
    );
    assert!(body.drift[0] < 1e-13 && body.drift[1] > 1e-9, "{:?}", body.drift);
}

#[test]
fn momentum_is_kept_and_no_energy_gained_when_two_packings_collide() {
    for (restitution, friction) in [(1.0, 0.0), (0.5, 0.3)] {
        let law = ContactLaw {
            restitution,
            friction,
            ..ContactLaw::elastic(E)
        };
        let mut run = impact(law, 0.8);
        let (before, [p, turn]) = (run.energy(), run.momentum());
        let (mut created, mut top) = (0.0_f64, 0.0_f64);
        while run.time() < 3e-5 {
            run.advance(&mut Silent).unwrap();
            created = created.max(run.created() / before);
            top = top.max(run.effects()[0].facts[0].1);
        }
        let [q, spin] = run.momentum();
        assert!((q - p).norm() < 1e-12 * p.norm(), "{}", (q - p).norm() / p.norm());
        // About the origin at rest positions it changes only through the displacements.
        assert!((spin - turn).norm() < 0.05 * turn.norm(), "{spin} {turn}");
        assert!(
            created < 1e-14 && run.drift() < 1e-12,
            "{created:e} {:e}",
            run.drift()
        );
        assert!(top >= 4.0, "{top} contacts");
        let line = run.effects().remove(0);
        assert_eq!(
            (line.name.as_str(), line.phase),
            ("contact target-ball", Some(Phase::Pair(0)))
        );
        let (dissipated, work) = (line.dissipated().unwrap(), line.work.unwrap());
        assert!(
            dissipated > -1e-14 * before && work < 1e-14 * before,
            "{dissipated} {work}"
        );
        // The bodies separate: the upper one flies up, and elastic contact returns all energy.
        let vz = run.subdomains()[1].momentum()[0].z;
        assert!(vz > 0.0, "{vz}");
        if restitution > 0.99 {
            assert!(
                line.stored <= 0.0 && dissipated < 1e-3 * before,
                "{} {dissipated}",
                line.stored
            );
        } else {
            assert!(dissipated > 0.05 * before, "{dissipated} of {before}");
        }
    }
}

#[test]
fn two_equal_bodies_change_their_velocities() {
    // Rods of four spheres: an elastic impact transfers the momentum and leaves a little ringing.
    let rod = |name: &str, position: f64| block(name, [4, 2, 2], R, Vector3::new(position, 0.0, 0.0));
    let (a, b) = (rod("left", 0.0), rod("right", 8.1 * R));
    let contact = ContactBetween::new(
        ContactBody::from_model(&a),
        ContactBody::from_model(&b),
        ContactLaw::elastic(E),
    )
    .unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![side(a, [2.0, 0.0, 0.0]), side(b, [0.0; 3])],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    let mut run = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None).unwrap();
    let p = run.momentum()[0].x;
    while run.time() < 1e-4 {
        run.advance(&mut Silent).unwrap();
    }
    let [left, right] = [0, 1].map(|k: usize| run.subdomains()[k].momentum()[0].x / p);
    assert_abs_diff_eq!(left + right, 1.0, epsilon = 1e-12);
    assert!(right > 0.8 && left < 0.2, "{left} {right}");
    assert!(run.created() < 1e-14 * run.energy());
}

fn bits(run: &Coupled<f64>) -> Vec<u64> {
    let states = run.subdomains().iter();
    let mut out: Vec<u64> = states
        .flat_map(|s| s.state().q.iter().chain(&s.state().v))
        .map(|x| x.to_bits())
        .collect();
    let line = run.effects().remove(0);
    out.extend([line.work.unwrap(), line.stored].map(f64::to_bits));
    out.extend(line.facts.iter().map(|f| f.1.to_bits()));
    out
}

fn rough() -> ContactLaw {
    ContactLaw {
        restitution: 0.6,
        friction: 0.4,
        rolling: 0.1,
        ..ContactLaw::elastic(E)
    }
}

#[test]
fn a_restart_in_mid_contact_goes_on_with_the_same_bits() {
    let mut whole = impact(rough(), 0.7);
    while whole.effects()[0].facts[0].1 < 4.0 {
        whole.advance(&mut Silent).unwrap();
    }
    whole.run(3, &mut Silent).unwrap();
    let saved = whole.snapshot().unwrap();
    assert!(whole.effects()[0].stored > 0.0);
    let mut resumed = impact(rough(), 0.7);
    resumed.restore(&saved).unwrap();
    assert_eq!(bits(&whole), bits(&resumed), "as restored");
    for run in [&mut whole, &mut resumed] {
        run.run(200, &mut Silent).unwrap();
    }
    assert_eq!(bits(&whole), bits(&resumed));
    let mut torn = saved.clone();
    torn.pairs[0].effect.numbers.pop();
    let error = impact(rough(), 0.7).restore(&torn).unwrap_err().to_string();
    assert!(error.contains("record of 'contact target-ball'"), "{error}");
    torn.pairs.clear();
    let error = impact(rough(), 0.7).restore(&torn).unwrap_err().to_string();
    assert!(error.contains("effects between two models"), "{error}");
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let bits_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut run = impact(rough(), 0.7);
            run.run(300, &mut Silent).unwrap();
            assert!(run.effects()[0].facts[1].1 > 3.0);
            bits(&run)
        })
    };
    let serial = bits_on(1);
    assert_eq!(serial, bits_on(2));
    assert_eq!(serial, bits_on(3));
}

#[test]
fn forces_are_equal_and_opposite() {
    let [a, b] = bodies();
    let contact =
        || ContactBetween::new(ContactBody::from_model(&a), ContactBody::from_model(&b), rough()).unwrap();
    let layouts = [a.layout(), b.layout()];
    let run = impact(rough(), 0.5);
    // The host as a run passes it.
    let uncoupled = Weights::uncoupled();
    let side = |k: usize| Host {
        model: run.subdomains()[k].model(),
        weights: &uncoupled,
        inertia: run.subdomains()[k].inertia(),
        inverse_inertia: run.subdomains()[k].inverse_inertia(),
        is_partitioned: false,
    };
    let attached = |tied: [Vec<bool>; 2]| {
        let sides = [side(0), side(1)];
        Box::new(contact()).attach(&HostPair { sides, tied }).unwrap()
    };
    let pressed = defect(&mut *attached([Vec::new(), Vec::new()]), layouts);
    assert!(pressed.0 < 1e-14 && pressed.1 > 3.0, "{pressed:?}");
    // Particles tied by an interface to the other model do not touch.
    let everywhere = layouts.map(|l: DofLayout| vec![true; l.nodes]);
    assert_eq!(defect(&mut *attached(everywhere), layouts), (0.0, 0.0));
}

/// Returns the unbalanced momentum of the forces and the number of contacts, with the upper body pushed into
/// the lower one.
fn defect(contact: &mut dyn PairEffect<f64>, layouts: [DofLayout; 2]) -> (f64, f64) {
    let q = layouts.map(|l| vec![0.0; l.dofs()]);
    let mut v = q.clone();
    let mut q = q;
    (0..layouts[1].nodes).for_each(|i| q[1][3 * i + 2] = -0.1 * R);
    v[1].iter_mut()
        .enumerate()
        .for_each(|(i, v)| *v = -1.0 + 0.3 * (i % 5) as f64);
    let zero = layouts.map(|l| vec![0.0; l.dofs()]);
    let instant = |k: usize| Instant {
        time: 1.0,
        q: &q[k],
        v_half: &v[k],
        dt: 1e-8,
        number: 1,
        internal: &zero[k],
        internal_before: &zero[k],
    };
    let unbalanced = conformance::reaction(contact, [&instant(0), &instant(1)], layouts).unwrap();
    (unbalanced, contact.facts()[0].1)
}

/// Observer that counts phases.
#[derive(Default)]
struct Counter {
    pair: usize,
    effect: usize,
}

impl Observer<f64> for Counter {
    fn phase(&mut self, phase: Phase) {
        match phase {
            Phase::Pair(_) => self.pair += 1,
            Phase::Effect(..) => self.effect += 1,
            _ => {}
        }
    }
    fn observe(&mut self, _: &Coupled<f64>, _: &StepReport<f64>) -> arlequin_core::Result<ControlFlow<()>> {
        Ok(ControlFlow::Continue(()))
    }
}

#[test]
fn without_contact_between_them_bodies_pass_and_nothing_is_called() {
    let [a, b] = bodies();
    let (below, above) = (ContactBody::from_model(&a), ContactBody::from_model(&b));
    let sides = vec![side(a, [0.0; 3]), side(b, [3.0, -1.0, -20.0])];
    let mut run = Coupled::new(sides, Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
    let mut counter = Counter::default();
    run.run(400, &mut counter).unwrap();
    assert_eq!((counter.pair, counter.effect), (0, 0));
    assert!(run.effects().is_empty() && run.works().is_empty() && run.snapshot().unwrap().pairs.is_empty());
    // The bodies went through each other, which the watchdog's figures show.
    let q = [0, 1].map(|k: usize| &run.subdomains()[k].state().q[..]);
    let (count, worst) = below.overlaps(&above, q, 0.01).unwrap();
    assert!(count > 9 && worst > 0.05, "{count} {worst}");
    let at_rest = [0, 1].map(|k: usize| vec![0.0; run.subdomains()[k].model().layout().dofs()]);
    assert_eq!(below.overlaps(&above, [&at_rest[0], &at_rest[1]], 0.0), None);
    let mut touching = impact(ContactLaw::elastic(E), 0.8);
    let mut counter = Counter::default();
    touching.run(10, &mut counter).unwrap();
    assert_eq!((counter.pair, counter.effect), (10, 0));
}

#[test]
fn contact_between_a_model_and_itself_is_refused() {
    let [a, b] = bodies();
    let contact =
        ContactBetween::new(ContactBody::from_model(&a), ContactBody::from_model(&b), rough()).unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![side(a, [0.0; 3]), side(b, [0.0; 3])],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [1, 1],
            effect: Box::new(contact),
        }],
    };
    let error = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("subdomains of 'contact target-ball' = 1 and 1") && error.contains("two different"),
        "{error}"
    );
    let [a, b] = bodies();
    let swapped =
        ContactBetween::new(ContactBody::from_model(&b), ContactBody::from_model(&a), rough()).unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![side(a, [0.0; 3]), side(b, [0.0; 3])],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(swapped),
        }],
    };
    let error = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("particles of contact ball-target"), "{error}");
}

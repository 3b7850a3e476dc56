//! Contact and obstacles of a body of particles on several ranks: the bits of one rank, and checkpoints for
//! any number of ranks.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::{Results, WAIT, bar, bits, first, part, same_on, shared};
use arlequin_core::effect::Absorber;
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::ranks::Communicator;
use arlequin_core::{Coupled, Guard, Partition, Silent, Subdomain, TimeStep, Uniform, Weights};
use arlequin_mpi::threads;
use dem_beam::fracture::{Criterion, Fracture, Scatter};
use dem_beam::{BeamMaterial, Contact, ContactLaw, DemModel, Matter, Motion, Obstacle, RigidShape};
use fem_ref::{ElementKind, FemField, generate};
use std::sync::Arc;

/// Returns a block of `n` spheres along each edge, bonded in pairs, with gaps of a twentieth of their size,
/// turned and shifted far.
fn dumbbells(n: usize) -> DemModel {
    let radius = 1e-4;
    let turn = arlequin_core::nalgebra::Rotation3::from_euler_angles(0.3, -0.5, 1.1);
    let shift = Vector3::new(2.0, -1.0, 0.5);
    let place = |k: usize| {
        let jitter = |c: usize| 4e-6 * (1.3 * (3 * k + c) as f64).sin();
        let [i, j, l] = [k % n, k / n % n, k / n / n].map(|i| 2.1 * radius * i as f64);
        shift + turn * Vector3::new(i + jitter(0), j + jitter(1), l + jitter(2))
    };
    let positions: Vec<Vector3<f64>> = (0..n * n * n).map(place).collect();
    let radii: Vec<f64> = (0..positions.len())
        .map(|k| radius * (1.0 - 0.05 * (0.7 * k as f64).cos()))
        .collect();
    let pairs: Vec<[u32; 2]> = (0..positions.len() as u32 / 2)
        .map(|k| [2 * k, 2 * k + 1])
        .collect();
    let matter = Matter {
        beam: BeamMaterial::SILICA,
        density: 2200.0,
        volume: radii.iter().map(|r| 4.19 * r.powi(3)).sum(),
    };
    DemModel::from_spheres("dumbbells", &positions, &radii, &pairs, &matter).unwrap()
}

fn collapse(ranks: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    collapse_of(10, ranks)
}

/// Returns a run in which spheres fly through each other's places and onto a wall that moves towards them; a
/// heavy ball follows.
fn collapse_of(edge: usize, ranks: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    let model = dumbbells(edge).with_finite_rotations();
    let n = model.body().len();
    let positions = model.body().positions();
    let middle = positions.iter().sum::<Vector3<f64>>() / n as f64;
    let law = ContactLaw {
        restitution: 0.6,
        friction: 0.4,
        rolling: 0.1,
        ..ContactLaw::elastic(72.5e9)
    };
    let contact = Contact::new(&model, law).unwrap();
    let law = ContactLaw { rolling: 0.0, ..law };
    let down = Vector3::new(0.3, -0.2, -1.0).normalize();
    // Wall and ball begin a little off the nearest spheres.
    let (gap, round) = (3e-6, 1.5e-3);
    let spheres = || positions.iter().map(|x| x - middle).zip(model.body().radii());
    let below = spheres().map(|(x, r)| x.dot(&down) + r).fold(0.0, f64::max);
    let above = spheres().filter_map(|(x, r)| {
        let t = x.dot(&down);
        let reach = (round + r + gap).powi(2) - (x.norm_squared() - t * t);
        (reach > 0.0).then(|| reach.sqrt() - t)
    });
    let wall = RigidShape::Plane {
        point: Point3::from(middle + down * (below + gap)),
        normal: -down,
    };
    let wall = Obstacle::new("wall", &model, wall, Motion::Velocity(-down * 20.0), law).unwrap();
    let ball = RigidShape::Sphere {
        centre: Point3::from(middle - down * above.fold(0.0, f64::max)),
        radius: round,
    };
    let motion = Motion::Free {
        mass: 2e-5,
        velocity: down * 120.0,
        inertia: None,
    };
    let ball = Obstacle::new("ball", &model, ball, motion, law).unwrap();
    let ball = ball.with_spin(Vector3::new(1e4, 0.0, 2e4)).unwrap();
    // Velocities point towards the middle.
    let speed = |k: usize| match k < 3 * n {
        true => -2e4 * (positions[k / 3][k % 3] - middle[k % 3]) + 30.0 * down[k % 3],
        false => 1e3 * (0.9 * k as f64).sin(),
    };
    let v = (0..6 * n).map(speed).collect();
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Uniform(1.0))))
        .with_partition(Partition::Unchecked)
        .with_effect(Box::new(contact))
        .with_effect(Box::new(wall))
        .with_effect(Box::new(ball))
        .with_initial(vec![0.0; 6 * n], v)
        .unwrap();
    let side = shared(side, ranks);
    let guard = Guard {
        interval: 5,
        growth: 0.5,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap()
}

fn results_after(run: Coupled<f64>, steps: usize) -> Results {
    results_with(run, steps, &["contact", "wall", "ball"])
}

fn results_with(mut run: Coupled<f64>, steps: usize, resultants: &[&str]) -> Results {
    run.run(steps, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![e.invariant, e.work, e.drift, run.energy()];
    sums.extend(run.works().iter().map(|w| w.work));
    for line in run.effects() {
        sums.extend([line.stored, line.supplied.unwrap_or_default()]);
        sums.extend(line.facts.iter().map(|f| f.1));
    }
    let about = Point3::new(2.0, -1.0, 0.5);
    for effect in resultants {
        let r = run.effect_resultant(0, effect, &about).unwrap();
        sums.extend(r.force.iter().chain(r.moment.iter()));
    }
    let s = &run.subdomains()[0];
    (bits(s.model(), &[&s.state().q, &s.state().v, &s.state().a]), sums)
}

const STEPS: usize = 240;

#[test]
fn contacts_and_obstacles_have_the_bits_of_one_rank() {
    let run = collapse(None);
    let mut probe = collapse(None);
    probe.run(STEPS, &mut Silent).unwrap();
    let fact = |effect: &str, fact: &str| {
        let lines = probe.effects();
        let line = lines.iter().find(|l| l.name.ends_with(effect)).unwrap();
        line.facts.iter().find(|f| f.0 == fact).unwrap().1
    };
    assert!(fact("contact", "most contacts") > 150.0, "{:?}", probe.effects());
    assert!(
        fact("contact", "neighbour searches") > 1.0,
        "{:?}",
        probe.effects()
    );
    for obstacle in ["wall", "ball"] {
        assert!(fact(obstacle, "largest force [N]") > 0.5, "{:?}", probe.effects());
    }
    let whole = results_after(run, STEPS);
    // The body has four units: four of eight ranks have none.
    same_on(&[1, 2, 3, 4, 8], &"", &whole, |c| {
        results_after(collapse(Some(c)), STEPS)
    });
}

#[test]
fn contacts_of_three_ranks_go_on_on_others() {
    let whole = results_after(collapse(None), STEPS);
    let half = STEPS / 2;
    let mut single = collapse(None);
    single.run(half, &mut Silent).unwrap();
    let single = single.snapshot().unwrap();
    let saved = first(3, |c| {
        let mut run = collapse(Some(c));
        run.run(half, &mut Silent).unwrap();
        run.snapshot().unwrap()
    });
    assert!(
        saved.subdomains[0].effects == single.subdomains[0].effects,
        "records differ"
    );
    same_on(&[1, 2, 4, 8], &"", &whole, |c| {
        let mut run = collapse(Some(c));
        run.restore(&saved).unwrap();
        results_after(run, STEPS - half)
    });
    // The record is that of another body.
    let mut foreign = saved;
    foreign.subdomains[0].effects[0].numbers.pop();
    let refused = threads::run(2, 1, WAIT, |c| {
        collapse(Some(c)).restore(&foreign).unwrap_err().to_string()
    });
    for e in refused {
        let e = e.unwrap();
        assert!(e.contains("record of contacts"), "{e}");
    }
}

/// Returns a bonded bar whose end a wall hits, so that it breaks there and its fragments touch, while the
/// other end is absorbed. Particles of most ranks touch nothing.
fn struck(ranks: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    let spec = Fracture {
        scatter: Scatter::Weibull { modulus: 5.0 },
        ..Fracture::new(Criterion::Rankine, 1.2e9)
    };
    let model = bar(true).with_fracture(spec).unwrap();
    let n = model.body().len();
    let law = ContactLaw {
        friction: 0.3,
        restitution: 0.7,
        ..ContactLaw::elastic(72.5e9)
    };
    let contact = Contact::new(&model, law).unwrap();
    let spheres = model.body().positions().iter().zip(model.body().radii());
    let end = spheres.map(|(x, r)| x.x - r).fold(f64::INFINITY, f64::min);
    let wall = RigidShape::Plane {
        point: Point3::new(end - 1e-6, 0.0, 0.0),
        normal: Vector3::x(),
    };
    let wall = Obstacle::new("wall", &model, wall, Motion::Velocity(150.0 * Vector3::x()), law).unwrap();
    let corners = [Point3::new(4e-3, -2e-3, -2e-3), Point3::new(7e-3, 2e-3, 2e-3)];
    let space = generate::block(ElementKind::Hex8, corners[0], corners[1], [2, 1, 1]).unwrap();
    let rate = |x: &Point3<f64>| 2e6 * (x.x / 4e-3 - 1.0);
    let absorber = Absorber::new(Arc::new(FemField::new(space)), Arc::new(rate));
    let side = Subdomain::fine(model, Weights::from_weight(Arc::new(Uniform(1.0))))
        .with_partition(Partition::Unchecked)
        .with_effect(Box::new(contact))
        .with_effect(Box::new(wall))
        .with_effect(Box::new(absorber));
    let side = side.with_initial(vec![0.0; 6 * n], vec![0.0; 6 * n]).unwrap();
    let side = shared(side, ranks);
    let guard = Guard {
        interval: 5,
        growth: 0.5,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.4), Some(guard)).unwrap()
}

#[test]
fn what_breaks_touches_and_is_absorbed_has_the_bits_of_one_rank_with_idle_ranks_as_well() {
    let mut probe = struck(None);
    probe.run(STRUCK, &mut Silent).unwrap();
    let lines = probe.effects();
    let line = |name: &str| lines.iter().find(|l| l.name.ends_with(name)).unwrap();
    let fact = |effect: &str, fact: &str| line(effect).facts.iter().find(|f| f.0 == fact).unwrap().1;
    assert!(fact("fracture", "broken bonds") > 20.0, "{lines:?}");
    assert!(fact("contact", "most contacts") > 10.0, "{lines:?}");
    assert!(line("absorber").work.unwrap() < 0.0, "{lines:?}");
    let about = ["contact", "wall"];
    let whole = results_with(struck(None), STRUCK, &about);
    // The body has six units: two of eight ranks are idle. Ranks in the middle have neither pairs nor wall
    // nor absorber.
    same_on(&[2, 3, 8], &"", &whole, |c| {
        results_with(struck(Some(c)), STRUCK, &about)
    });
}

const STRUCK: usize = 200;

/// The body has one unit on three ranks: the first rank, which writes snapshots, is idle.
#[test]
fn a_first_rank_without_particles_takes_part_and_saves_the_whole() {
    let whole = results_after(collapse_of(6, None), STEPS);
    let half = STEPS / 2;
    let mut single = collapse_of(6, None);
    single.run(half, &mut Silent).unwrap();
    let single = single.snapshot().unwrap();
    let saved = threads::run(3, 1, WAIT, |c| {
        let mut run = collapse_of(6, Some(c));
        let count = run.subdomains()[0].model().nodes().len();
        run.run(half, &mut Silent).unwrap();
        (count, run.snapshot().unwrap())
    });
    let saved: Vec<_> = saved.into_iter().map(Result::unwrap).collect();
    assert_eq!(saved.iter().map(|s| s.0).sum::<usize>(), 216);
    assert_eq!(saved[0].0, 0, "the first rank has particles");
    assert!(saved[0].1 == single, "snapshots differ");
    same_on(&[2, 3], &"", &whole, |c| {
        let mut run = collapse_of(6, Some(c));
        run.restore(&saved[0].1).unwrap();
        results_after(run, STEPS - half)
    });
}

#[test]
fn a_body_in_parts_before_its_run_has_no_contact() {
    let refused = threads::run(2, 1, WAIT, |c| {
        let whole = bar(false);
        let contact = Contact::new(&whole, ContactLaw::elastic(72.5e9)).unwrap();
        let side = Subdomain::fine(part(whole, c), Weights::from_weight(Arc::new(Uniform(1.0))))
            .with_partition(Partition::Unchecked)
            .with_effect(Box::new(contact));
        Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None)
            .unwrap_err()
            .to_string()
    });
    for e in refused {
        let e = e.unwrap();
        assert!(e.contains("'bar'") && e.contains("Subdomain::shared"), "{e}");
    }
}

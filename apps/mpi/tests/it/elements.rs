//! Bodies of finite elements on several ranks: the bits of one rank, for any division.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::continua::{Falling, bits, evaluated, unknowns};
use crate::support::{Results, WAIT, first, same_on, shared};
use arlequin_core::contact::{
    ContactLaw, Exterior, Motion, RigidBody, RigidShape, SharedBody, SurfaceContact, SurfaceObstacle,
};
use arlequin_core::effect::{
    BodyForce, EffectSpec, Load, LocalDamping, MassDamping, PairSpec, Prestress, StiffnessDamping,
};
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::ranks::{Communicator, RankError};
use arlequin_core::{
    Coupled, Elastic, Error, Guard, Materials, Model, Partition, Parts, PrescribedMotion, Real, Recovery,
    Silent, Subdomain, TimeFunction, TimeStep, Uniform, Weights, conformance,
};
use arlequin_mpi::threads;
use fem_ref::{ElementKind, FemModel, generate, gmsh};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Bodies of some 6 mm length: a box, tetrahedra of two materials, an L of warped hexahedra, a mesh of Gmsh,
/// bars.
const BODIES: [&str; 5] = ["box", "tets", "ell", "gmsh", "bars"];

fn body(kind: &str) -> FemModel<f64> {
    let [stone, rubber] = [(75e9, 0.17, 2200.0), (1e9, 0.3, 1100.0)]
        .map(|(young, poisson, density)| Elastic::new(young, poisson, density).unwrap());
    let far = Point3::new(6e-3, 1.6e-3, 1.6e-3);
    let block = |kind, counts| generate::block(kind, Point3::origin(), far, counts).unwrap();
    let plate = concat!(env!("CARGO_MANIFEST_DIR"), "/../cli/templates/plate.msh");
    let mesh = match kind {
        "box" => block(ElementKind::Hex8, [24, 8, 8]),
        "tets" => block(ElementKind::Tet4, [20, 7, 7]),
        "ell" => {
            let hole = [Point3::new(3e-3, 0.8e-3, -1.0), Point3::new(7e-3, 2e-3, 1.0)];
            generate::hollow_block(ElementKind::Hex8, Point3::origin(), far, [24, 8, 6], hole)
                .unwrap()
                .mapped(|x: &Point3<f64>| {
                    let (sin, cos) = (150.0 * x.x).sin_cos();
                    Point3::new(x.x, cos * x.y - sin * x.z, sin * x.y + cos * x.z)
                })
                .unwrap()
        }
        "gmsh" => gmsh::load(plate).unwrap().mapped(|x| x * 0.12).unwrap(),
        _ => generate::bar(0.0, 6e-3, 1500, 1e-6).unwrap(),
    };
    let count = mesh.element_count();
    let material = match kind {
        "tets" => {
            let materials = (0..count as u32).map(|e| u32::from(e % 7 == 3 || e > 3000));
            Materials::of_elements(vec![stone, rubber], materials.collect()).unwrap()
        }
        _ => stone.into(),
    };
    FemModel::new("body", mesh, material).unwrap()
}

fn part(kind: &str, c: &Arc<dyn Communicator>) -> FemModel<f64> {
    let mut model = body(kind);
    model.partition_among(c).unwrap();
    model
}

#[test]
fn forces_masses_stresses_and_critical_steps_have_the_bits_of_one_rank() {
    for kind in BODIES {
        let whole = evaluated(body(kind));
        assert!(whole.1.iter().all(|x| *x > 0.0 && x.is_finite()), "{:?}", whole.1);
        let ranks: &[usize] = if kind == "ell" {
            &[1, 2, 3, 4, 8]
        } else {
            &[2, 3, 8]
        };
        same_on(ranks, &kind, &whole, |c| evaluated(part(kind, &c)));
    }
}

/// Returns a run with all effects that elements have, its ends held and moved.
fn loaded(kind: &str, ranks: Option<Arc<dyn Communicator>>) -> Coupled<f64> {
    let model = body(kind);
    let c = model.layout().components;
    let end = model.nodes().iter().fold(0.0, |m: f64, x| m.max(x.x));
    let nodes = |start_share: f64, end_share: f64| -> Vec<usize> {
        let within = |x: &Point3<f64>| (start_share * end - 1e-9..=end_share * end + 1e-9).contains(&x.x);
        let numbered = model.nodes().iter().enumerate();
        numbered.filter(|n| within(n.1)).map(|n| n.0).collect()
    };
    let dofs = |nodes: Vec<usize>| nodes.into_iter().flat_map(move |k| c * k..c * k + c);
    let held = PrescribedMotion::fixed(dofs(nodes(0.0, 0.0)).collect());
    let pull = PrescribedMotion {
        dofs: dofs(nodes(1.0, 1.0)).collect(),
        amplitude: 1e-7,
        time: TimeFunction::SmoothPulse { duration: 4e-7 },
    };
    let pushed = dofs(nodes(0.7, 0.8)).map(|d| (d, 1.0 + (d % 3) as f64));
    let pulse = TimeFunction::SmoothPulse { duration: 1e-6 };
    let down = if c == 1 { Vector3::x() } else { -Vector3::z() };
    let mut effects: Vec<Box<dyn EffectSpec<f64>>> = vec![
        Box::new(BodyForce::new(down * 1e5).unwrap()),
        Box::new(Load::on_dofs("push", pushed.collect(), pulse).unwrap()),
        Box::new(MassDamping::new(1e4).unwrap()),
        Box::new(StiffnessDamping::new(1e-9).unwrap()),
        Box::new(LocalDamping::new(0.1).unwrap()),
    ];
    effects.push(Box::new(Prestress));
    let (mut q, mut v) = (unknowns(&model, 1e-9), unknowns(&model, 0.1));
    for d in held.dofs.iter().chain(&pull.dofs) {
        (q[*d], v[*d]) = (0.0, 0.0);
    }
    let side = Subdomain::coarse(model, Weights::from_weight(Arc::new(Falling)))
        .with_partition(Partition::Unchecked)
        .with_support(held)
        .with_support(pull)
        .with_initial(q, v)
        .unwrap();
    let side = effects.into_iter().fold(side, Subdomain::with_effect);
    let side = shared(side, ranks);
    let guard = Guard {
        interval: 7,
        growth: 0.5,
    };
    Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), Some(guard)).unwrap()
}

fn results(mut run: Coupled<f64>, steps: usize) -> Results {
    run.run(steps, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![run.dt(), run.energy(), e.invariant, e.kinetic, e.internal];
    sums.extend([e.work, e.drift, run.top_created()]);
    sums.extend(run.works().iter().map(|w| w.work));
    sums.extend(run.momentum().iter().flat_map(|p| [p.x, p.y, p.z]));
    let about = Point3::new(1e-3, 0.0, 0.0);
    let reactions = run.reactions(0).unwrap();
    for k in 0..2 {
        let r = run.support_resultant(0, k, &reactions, &about).unwrap();
        sums.extend(r.force.iter().chain(&r.moment));
    }
    let r = run.effect_resultant(0, "push", &about).unwrap();
    sums.extend(r.force.iter().chain(&r.moment));
    let s = &run.subdomains()[0];
    let state = s.state();
    (bits(s.model(), &[&state.q, &state.v, &state.a, &reactions]), sums)
}

#[test]
fn steps_under_effects_and_supports_have_the_bits_of_one_rank() {
    for kind in ["ell", "gmsh", "bars"] {
        let whole = results(loaded(kind, None), 30);
        assert!(whole.1.iter().all(|x| x.is_finite()), "{:?}", whole.1);
        // Every effect and support but the prestress did work, and the balance closes to round-off.
        assert!(whole.1[8..13].iter().all(|w| w.abs() > 1e-15), "{:?}", whole.1);
        assert!(whole.1[6].abs() < 1e-12 * whole.1[2], "{:?}", whole.1);
        same_on(&[2, 3, 8], &kind, &whole, |c| results(loaded(kind, Some(c)), 30));
    }
}

/// Runs half of the steps on two ranks and the other half on other numbers of ranks.
#[test]
fn a_snapshot_of_two_ranks_goes_on_on_any_number_of_them() {
    let whole = results(loaded("tets", None), 24);
    let saved = first(2, |c| {
        let mut run = loaded("tets", Some(c));
        run.run(12, &mut Silent).unwrap();
        run.snapshot().unwrap()
    });
    let mut alone = loaded("tets", None);
    alone.run(12, &mut Silent).unwrap();
    assert!(alone.snapshot().unwrap() == saved);
    alone.restore(&saved).unwrap();
    assert!(results(alone, 12).0 == whole.0);
    same_on(&[1, 3, 4], &"", &whole, |c| {
        let mut run = loaded("tets", Some(c));
        run.restore(&saved).unwrap();
        results(run, 12)
    });
}

/// Single precision: messages have more digits than the state.
#[test]
fn single_precision_has_the_bits_of_one_rank() {
    let model = || {
        let far = Point3::new(6.0_f32, 1.0, 1.0);
        let mesh = generate::block(ElementKind::Hex8, Point3::origin(), far, [40, 6, 6]).unwrap();
        FemModel::new("body", mesh, Elastic::new(3.0, 0.2, 1.0).unwrap()).unwrap()
    };
    let forces = |mut m: FemModel<f32>| {
        let place = |k: usize| m.owned().global(k / 3) * 3 + k % 3;
        let q: Vec<f32> = (0..m.layout().dofs())
            .map(|k| f32::of((place(k) as f64).sin()))
            .collect();
        let mut f = vec![0.0; q.len()];
        let energy = m.advance_with_energy(&q, &mut f).unwrap();
        let bits: Vec<(usize, u32)> = (0..f.len()).map(|k| (k, f[k].to_bits())).collect();
        let places = |(k, b)| (m.owned().global(k / 3) * 3 + k % 3, b);
        (bits.into_iter().map(places).collect::<Vec<_>>(), energy.to_bits())
    };
    let whole = forces(model());
    let parts = threads::run(3, 1, WAIT, |c| {
        let mut m = model();
        m.partition_among(&c).unwrap();
        forces(m)
    });
    let mut bits_of_ranks = Vec::new();
    for p in parts {
        let (bits, energy) = p.unwrap();
        assert_eq!(energy, whole.1);
        bits_of_ranks.extend(bits);
    }
    bits_of_ranks.sort_unstable();
    assert!(bits_of_ranks == whole.0);
}

/// A rank receives only nodes that share an element with its own, once each, and has the field of its
/// elements.
#[test]
fn halos_are_what_elements_ask_for() {
    for kind in ["ell", "gmsh"] {
        let mesh = body(kind).mesh().clone();
        let shared = threads::run(3, 1, WAIT, |c| {
            let m = part(kind, &c);
            let p = m.owned();
            let owned: BTreeSet<u32> = (0..p.nodes()).map(|i| p.global(i) as u32).collect();
            let halo = m.halo().unwrap();
            let mut ghosts = halo.ghosts().to_vec();
            ghosts.sort_unstable();
            let field = m.field();
            assert_eq!(field.mesh().nodes(), m.nodes());
            let inner = field.mesh();
            let middle = |e: usize| {
                let corners = inner.element(e).iter().map(|k| inner.nodes()[*k as usize].coords);
                Point3::from(corners.sum::<Vector3<f64>>() / inner.element(e).len() as f64)
            };
            let points: Vec<_> = (0..inner.element_count()).map(middle).collect();
            let defect = conformance::shapes(&*field, &points, true).unwrap();
            assert!(
                defect.unity < 1e-13 && defect.linear < 1e-13 && defect.gradient < 1e-9,
                "{defect:?}"
            );
            (owned, ghosts, halo.sent(), field.mesh().element_count())
        });
        let shared: Vec<_> = shared.into_iter().map(Result::unwrap).collect();
        let (mut held, mut sent, mut received) = (0, 0, 0);
        for (owned, ghosts, out, inner) in &shared {
            let elements = || (0..mesh.element_count()).map(|e| mesh.element(e));
            let touching = elements().filter(|e| e.iter().any(|k| owned.contains(k)));
            let asked: BTreeSet<u32> = touching
                .flatten()
                .copied()
                .filter(|k| !owned.contains(k))
                .collect();
            assert!(ghosts.iter().eq(&asked), "{kind}");
            let within = elements().filter(|e| e.iter().all(|k| owned.contains(k)));
            assert_eq!(within.count(), *inner);
            held += owned.len();
            sent += out;
            received += ghosts.len();
        }
        assert_eq!((held, sent), (mesh.nodes().len(), received));
    }
}

/// The forces of a rank whose neighbour has ended are an error that names the neighbour.
#[test]
fn forces_without_the_messages_of_another_rank_are_an_error_by_name() {
    for kind in ["box", "bars"] {
        let outcomes = threads::run(2, 1, WAIT, |c| {
            let mut model = part(kind, &c);
            if c.rank() == 1 {
                return Ok(());
            }
            let mut f = vec![0.0; model.layout().dofs()];
            model.add_internal_forces(&unknowns(&model, 1e-6), &mut f)
        });
        let lost = RankError::Lost { rank: 0, peer: 1 };
        assert_eq!(outcomes[0], Ok(Err(Error::Rank(lost))), "{kind}");
    }
}

#[test]
fn what_cannot_be_shared_out_is_refused_by_name_on_every_rank() {
    let error = |e: Result<String, RankError>| e.unwrap();
    let refused = threads::run(2, 1, WAIT, |c| {
        let mut differing = body(if c.rank() == 0 { "tets" } else { "box" });
        differing.partition_among(&c).err().unwrap().to_string()
    });
    for e in refused.into_iter().map(error) {
        assert!(
            e.contains("ranks differ in the mesh of 'body', its materials or its weights"),
            "{e}"
        );
    }
    let refused = threads::run(2, 1, WAIT, |c| {
        let mut weighted = body("tets");
        let weight = Uniform(if c.rank() == 0 { 1.0 } else { 0.5 });
        weighted.set_internal_weight(&weight).unwrap();
        weighted.partition_among(&c).err().unwrap().to_string()
    });
    for e in refused.into_iter().map(error) {
        assert!(e.contains("its materials or its weights"), "{e}");
    }
    let twice = threads::run(2, 1, WAIT, |c| {
        let mut m = part("box", &c);
        assert!(m.views().linear.is_none());
        let far = m.nodes().len();
        let beyond = m.recover(&unknowns(&m, 1e-6), &[far], &mut Vec::new());
        let beyond = beyond.unwrap_err().to_string();
        assert!(
            beyond.contains(&format!("'body' here has {far} nodes")),
            "{beyond}"
        );
        m.partition_among(&c).err().unwrap().to_string()
    });
    for e in twice.into_iter().map(error) {
        assert!(
            e.contains("'body'") && e.contains("is a part of a body already"),
            "{e}"
        );
    }
    let few = threads::run(60, 1, WAIT, |c| {
        let mesh = generate::block(
            ElementKind::Hex8,
            Point3::origin(),
            Point3::new(1.0, 1.0, 1.0),
            [2; 3],
        );
        let mut m = FemModel::new("few", mesh.unwrap(), Elastic::new(1.0, 0.2, 1.0).unwrap()).unwrap();
        m.partition_among(&c).map(|_| ()).unwrap_err()
    });
    for e in few {
        let (ranks, nodes, units) = (60, 27, 1);
        assert_eq!(
            e.unwrap(),
            Error::Rank(RankError::TooMany { ranks, nodes, units })
        );
    }
}

/// Contact needs the whole surface on every rank, and says so by name.
#[test]
fn a_body_in_parts_has_no_contact_of_its_surface() {
    let law = ContactLaw::elastic(75e9);
    let refused = threads::run(2, 1, WAIT, |c| {
        let floor = RigidShape::Plane {
            point: Point3::new(0.0, 0.0, -1e-3),
            normal: Vector3::z(),
        };
        let floor = RigidBody::new("floor", floor, Motion::Fixed).unwrap();
        let obstacle = SurfaceObstacle::new(&body("tets"), &SharedBody::new(floor), law).unwrap();
        let [one, two] = ["tets", "box"].map(|kind| Exterior::surface(&body(kind)).unwrap());
        let pair = SurfaceContact::new(&one, &two, law).unwrap();
        let side = |kind: &str| {
            let side = Subdomain::coarse(body(kind), Weights::uncoupled());
            shared(side.with_partition(Partition::Unchecked), Some(c.clone()))
        };
        let alone = side("tets").with_effect(Box::new(obstacle));
        let alone = Coupled::new(vec![alone], Vec::new(), TimeStep::Fraction(0.5), None);
        let parts = Parts {
            start: 0.0,
            end: None,
            subdomains: vec![side("tets"), side("box")],
            interfaces: Vec::new(),
            pairs: vec![PairSpec {
                sides: [0, 1],
                effect: Box::new(pair),
            }],
        };
        let two = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None);
        [alone.unwrap_err().to_string(), two.unwrap_err().to_string()]
    });
    for errors in refused {
        let [obstacle, pair] = errors.unwrap();
        assert!(
            obstacle.contains("'floor'") && obstacle.contains("leave it whole"),
            "{obstacle}"
        );
        assert!(
            pair.contains("'body'") && pair.contains("in parts on 2 ranks"),
            "{pair}"
        );
    }
}

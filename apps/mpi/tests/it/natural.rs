//! Bodies of natural elements on several ranks, with the whole geometry on each: the bits of one rank, for
//! any division.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use crate::support::continua::{Falling, bits, evaluated, unknowns};
use crate::support::{Results, WAIT, same_on, shared};
use arlequin_core::effect::{BodyForce, EffectSpec, StiffnessDamping};
use arlequin_core::nalgebra::{Point3, Vector3};
use arlequin_core::ranks::Communicator;
use arlequin_core::{
    Coupled, Elastic, Interpolation, Model, Partition, PrescribedMotion, ShapeRow, Silent, Subdomain,
    TimeStep, Weights,
};
use arlequin_mpi::threads;
use cnem::natural::Interpolant;
use cnem::{CnemModel, Domain, Inertia, Options, Stabilisation, Surface};
use std::sync::{Arc, LazyLock};

/// Returns a bar of 1 050 nodes in five units, none of them at its place in a grid. `plain`: with the mass of
/// cells around their centroids and without stabilisation.
fn body(plain: bool) -> CnemModel {
    static BODIES: LazyLock<[CnemModel; 2]> = LazyLock::new(|| {
        let inner = |k: usize, n: usize| f64::from(u8::from(k > 0 && k + 1 < n));
        let point = |k: usize| {
            let (i, [j, l]) = (k / 42, [k / 6 % 7, k % 6]);
            let off = |c: f64| 0.06e-3 * (c + 1.3 * k as f64).sin();
            Point3::new(
                0.24e-3 * i as f64 + inner(i, 25) * off(0.0),
                0.24e-3 * j as f64 + inner(j, 7) * off(1.0),
                0.24e-3 * l as f64 + inner(l, 6) * off(2.0),
            )
        };
        let nodes: Vec<Point3<f64>> = (0..1050).map(point).collect();
        let stone = Elastic::new(75e9, 0.17, 2200.0).unwrap();
        [true, false].map(|plain| {
            let options = Options {
                kind: if plain {
                    Interpolant::Laplace
                } else {
                    Interpolant::Sibson
                },
                stabilisation: if plain {
                    Stabilisation::default()
                } else {
                    Stabilisation::None
                },
                inertia: if plain { Inertia::Cells } else { Inertia::Centroids },
            };
            let domain = Domain::new(&nodes, &Surface::convex_hull()).unwrap();
            CnemModel::new("body", domain, stone, options).unwrap()
        })
    });
    BODIES[usize::from(!plain)].clone()
}

fn part(plain: bool, c: &Arc<dyn Communicator>) -> CnemModel {
    let mut model = body(plain);
    model.partition_among(c).unwrap();
    model
}

#[test]
fn forces_masses_stresses_and_critical_steps_have_the_bits_of_one_rank() {
    for plain in [true, false] {
        let whole = evaluated(body(plain));
        assert!(whole.1.iter().all(|x| *x > 0.0 && x.is_finite()), "{:?}", whole.1);
        same_on(&[1, 2, 3, 4, 8], &plain, &whole, |c| evaluated(part(plain, &c)));
    }
}

fn stepped(ranks: Option<Arc<dyn Communicator>>) -> Results {
    let model = body(true);
    let face = model.select_nodes(|x| x.x < 1e-9).unwrap();
    let held = PrescribedMotion::fixed(face.iter().flat_map(|k| 3 * k..3 * k + 3).collect());
    let (q, mut v) = (vec![0.0; model.layout().dofs()], unknowns(&model, 0.1));
    held.dofs.iter().for_each(|d| v[*d] = 0.0);
    let effects: [Box<dyn EffectSpec<f64>>; 2] = [
        Box::new(BodyForce::new(Vector3::new(0.0, 0.0, -1e5)).unwrap()),
        Box::new(StiffnessDamping::new(1e-9).unwrap()),
    ];
    let side = Subdomain::coarse(model, Weights::from_weight(Arc::new(Falling)))
        .with_partition(Partition::Unchecked)
        .with_support(held)
        .with_initial(q, v)
        .unwrap();
    let side = effects.into_iter().fold(side, Subdomain::with_effect);
    let side = shared(side, ranks);
    let mut run = Coupled::new(vec![side], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    run.run(30, &mut Silent).unwrap();
    let e = run.last_energy().unwrap().clone();
    let mut sums = vec![run.dt(), e.invariant, e.kinetic, e.internal, e.work, e.drift];
    sums.extend(run.works().iter().map(|w| w.work));
    let s = &run.subdomains()[0];
    (bits(s.model(), &[&s.state().q, &s.state().v, &s.state().a]), sums)
}

#[test]
fn steps_under_effects_and_supports_have_the_bits_of_one_rank() {
    let whole = stepped(None);
    assert!(whole.1[5].abs() < 1e-12 * whole.1[1], "{:?}", whole.1);
    same_on(&[2, 3, 5], &"", &whole, |c| stepped(Some(c)));
}

/// The field of a part names owned nodes only, or reports that a point is outside.
#[test]
fn fields_of_parts_know_their_own_nodes() {
    let counts = threads::run(2, 1, WAIT, |c| {
        let mut m = part(true, &c);
        let p = m.owned();
        let shared = Model::nodes(&m).len();
        assert_eq!((shared, p.nodes()), (shared, shared));
        let (whole, field) = (m.field(), arlequin_core::CoarseModel::coarse_field(&m));
        let [mut expected, mut row] = [ShapeRow::default(), ShapeRow::default()];
        let mut inside = 0;
        for k in 0..60 {
            let x = Point3::new(0.09e-3 * f64::from(k), 0.7e-3, 0.5e-3);
            whole.shape_at(&x, false, &mut expected).unwrap();
            if field.shape_at(&x, false, &mut row).is_err() {
                assert!(expected.nodes.iter().any(|n| p.local(*n).is_none()));
                continue;
            }
            inside += 1;
            assert!(
                row.nodes
                    .iter()
                    .map(|n| p.global(*n))
                    .eq(expected.nodes.iter().copied())
            );
            assert_eq!(row.values, expected.values);
        }
        let again = m.partition_among(&c).map(|_| ()).unwrap_err().to_string();
        assert!(again.contains("is a part of a body already"), "{again}");
        inside
    });
    let inside: Vec<usize> = counts.into_iter().map(Result::unwrap).collect();
    assert!(inside.iter().all(|n| (15..35).contains(n)), "{inside:?}");
}

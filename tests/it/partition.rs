//! The models share everything exactly once: the partition of unity is checked before the first step, and
//! errors state name and number.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid;
use approx::assert_abs_diff_eq;
use arlequin::cnem::NaturalField;
use arlequin::cnem::natural::Interpolant;
use arlequin::core::nalgebra::{self, Point3};
use arlequin::core::{
    Coupled, Error, InterfaceOptions, InterfaceSpec, L2, Model, Partition, Profile, Ramp, Result, Sampling,
    Silent, Slab, Subdomain, TimeStep, Uniform, Weight, Weights, conformance,
};
use arlequin::dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
use arlequin::fem_ref::generate::{self, Cylinder, Rim};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, Mesh};
use arlequin_studies::line::{Line, rest};
use std::sync::Arc;

fn on_axis(x: f64) -> Point3<f64> {
    Point3::new(x, 0.0, 0.0)
}

fn ramp(fine: f64, coarse: f64, profile: Profile<f64>) -> Weights<f64> {
    let slab = Slab::between(on_axis(fine), on_axis(coarse)).unwrap();
    Weights::from_weight(Arc::new(Ramp::new(Arc::new(slab), profile, 0.05).unwrap()))
}

/// Couples two bars with given ends, coarse and fine, over the overlap (2, 3) by a mediator.
fn bars(
    coarse: [f64; 2],
    fine: [f64; 2],
    mediator: [f64; 2],
    weights: [Weights<f64>; 2],
) -> Result<Coupled<f64>> {
    let bar = |name: &str, x: [f64; 2], h: f64| {
        let n = ((x[1] - x[0]) / h).round() as usize;
        FemModel::new(
            name,
            generate::bar(x[0], x[1], n, 2.0).unwrap(),
            Elastic::new(1.0, 0.0, 1.0).unwrap(),
        )
        .unwrap()
    };
    let [w, v] = weights;
    let bodies = vec![
        Subdomain::coarse(bar("coarse", coarse, 0.1), w),
        Subdomain::fine(bar("fine", fine, 0.02), v),
    ];
    let space = generate::bar(mediator[0], mediator[1], 5, 2.0).unwrap();
    let interface = InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator: Arc::new(FemField::new(space)),
        junction: Box::new(L2),
        options: InterfaceOptions::default(),
    };
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.8), None)
}

fn shared(profile: Profile<f64>) -> [Weights<f64>; 2] {
    let w = ramp(3.0, 2.0, profile);
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    [w, complement]
}

#[test]
fn a_model_that_ends_inside_the_overlap_is_refused_with_point_and_sum() {
    for profile in [Profile::Linear, Profile::Cubic, Profile::Constant(0.5)] {
        // All three ranges agree with the overlap.
        let run = bars([0.0, 3.0], [2.0, 5.0], [2.0, 3.0], shared(profile.clone())).unwrap();
        let report = &run.partition()[0];
        assert!(
            report.checked && (report.measure - 5.0).abs() < 1e-12 && (report.shared - 1.0).abs() < 1e-12
        );
        assert!(
            report.missing < 1e-12 && report.excess_mass.abs() < 1e-12,
            "{report:?}"
        );
        // The coarse bar ends inside of the overlap, or the fine one begins inside, by half of the overlap
        // down to a tenth of an element.
        for (coarse, fine) in [
            ([0.0, 2.5], [2.0, 5.0]),
            ([0.0, 3.0], [2.5, 5.0]),
            ([0.0, 2.99], [2.0, 5.0]),
        ] {
            let inner = [f64::max(2.0, fine[0]), f64::min(3.0, coarse[1])];
            let error = bars(coarse, fine, inner, shared(profile.clone())).unwrap_err();
            let Error::PartitionOfUnity {
                model,
                point,
                sum,
                present,
                ..
            } = &error
            else {
                panic!("{error}")
            };
            let lone = if coarse[1] < 3.0 { "fine" } else { "coarse" };
            assert_eq!(model, lone);
            assert!(point[0] > inner[1] || point[0] < inner[0], "{error}");
            assert!(
                *sum < 1.0 - 1e-6 && present.starts_with(&format!("'{lone}'")),
                "{error}"
            );
            assert!(error.to_string().contains("unchecked"), "{error}");
        }
    }
}

#[test]
fn weights_of_one_on_both_models_are_refused_with_the_excess() {
    let ones = || [Weights::uncoupled(), Weights::uncoupled()];
    let error = bars([0.0, 3.0], [2.0, 5.0], [2.0, 3.0], ones()).unwrap_err();
    let Error::PartitionOfUnity { sum, kind, point, .. } = &error else {
        panic!("{error}")
    };
    assert!(
        (sum - 2.0).abs() < 1e-12 && kind.to_string().contains("alpha") && (2.0..=3.0).contains(&point[0]),
        "{error}"
    );
    // One wrong weight of the three is found as well.
    for kind in 0..3 {
        let [mut w, v] = shared(Profile::Linear);
        let unit: Arc<dyn Weight<f64>> = Arc::new(Uniform(1.0));
        match kind {
            0 => w.internal = unit,
            1 => w.kinetic = unit,
            _ => w.external = unit,
        }
        let error = bars([0.0, 3.0], [2.0, 5.0], [2.0, 3.0], [w, v]).unwrap_err();
        let name = ["alpha", "beta", "gamma"][kind];
        assert!(error.to_string().contains(name), "{error}");
    }
    // Two ramps that are not complementary.
    let [w, _] = shared(Profile::Linear);
    let v = Weights::complement_of(&[ramp(3.1, 2.1, Profile::Linear)]);
    assert!(bars([0.0, 3.0], [2.0, 5.0], [2.0, 3.0], [w, v]).is_err());
}

#[test]
fn a_mediator_that_covers_a_part_of_the_overlap_is_refused_with_the_share() {
    for (to, outside) in [(2.25, 0.75), (2.7, 0.3)] {
        let error = bars([0.0, 3.0], [2.0, 5.0], [2.0, to], shared(Profile::Linear)).unwrap_err();
        let Error::UncoveredOverlap {
            outside: found,
            point,
            ..
        } = &error
        else {
            panic!("{error}")
        };
        assert!((found - outside).abs() < 0.01 && point[0] > to, "{error}");
    }
}

/// Couples two solids, the fine one from `fine_from` on.
fn solids(fine_from: f64, partition: Partition) -> Result<Coupled<f64>> {
    let w = solid::weights(Profile::Cubic, 0.05);
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let model = |name: &str, mesh: Mesh<f64>| FemModel::new(name, mesh, solid::material()).unwrap();
    let left = model("left", solid::block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]));
    let right = model(
        "right",
        solid::block(ElementKind::Tet4, [fine_from, 4.0], [7, 3, 3]),
    );
    let bodies = vec![
        Subdomain::coarse(left, w),
        Subdomain::fine(right, complement).with_partition(partition),
    ];
    solid::couple(
        bodies,
        solid::mediator(ElementKind::Hex8, [fine_from, 3.0], [2, 2, 2]),
        Box::new(L2),
    )
}

#[test]
fn gaps_in_space_are_refused_unless_the_study_says_so() {
    let run = solids(2.0, Partition::Checked).unwrap();
    let report = &run.partition()[0];
    assert!(
        (report.measure - 4.0).abs() < 1e-9 && (report.shared - 1.0).abs() < 1e-9,
        "{report:?}"
    );
    assert!(
        report.excess_mass.abs() < 1e-9 && report.missing < 1e-12,
        "{report:?}"
    );
    let error = solids(2.6, Partition::Checked).unwrap_err();
    assert!(matches!(error, Error::PartitionOfUnity { .. }), "{error}");
    // Declared as unchecked, the study runs.
    let run = solids(2.6, Partition::Unchecked).unwrap();
    assert!(!run.partition()[0].checked);
    let line = Line {
        everywhere: Some(0.3),
        ..Line::default()
    };
    assert!(!line.build(&rest, &rest).unwrap().partition()[0].checked);
    let [bar, chain] = line.subdomains(&rest, &rest).unwrap();
    let checked = [bar, chain].map(|s| s.with_partition(Partition::Checked));
    let error = line.build_with(checked.into()).unwrap_err();
    assert!(
        matches!(error, Error::PartitionOfUnity { sum, .. } if (sum - 0.3).abs() < 1e-12),
        "{error}"
    );
}

#[test]
fn structured_tetrahedra_have_an_overlap_of_the_exact_measure() {
    // Faces of the three meshes coincide up to round-off, at thirds and halves; turned, no faces coincide
    // exactly.
    let turn = nalgebra::Rotation3::new(nalgebra::Vector3::new(0.3, -0.5, 0.7));
    for turned in [false, true] {
        let mesh = |x: [f64; 2], counts: [usize; 3]| {
            let mesh = solid::block::<f64>(ElementKind::Tet4, x, counts);
            if !turned {
                return mesh;
            }
            mesh.mapped(|p| turn * p).unwrap()
        };
        let slab = |fine: f64, coarse: f64| {
            let placed = |x: f64| if turned { turn * on_axis(x) } else { on_axis(x) };
            Slab::between(placed(fine), placed(coarse)).unwrap()
        };
        let ramp = Ramp::new(Arc::new(slab(3.0, 2.0)), Profile::Linear, 0.05).unwrap();
        let w = Weights::from_weight(Arc::new(ramp));
        let complement = Weights::complement_of(std::slice::from_ref(&w));
        let model = |name: &str, mesh| FemModel::new(name, mesh, solid::material()).unwrap();
        let bodies = vec![
            Subdomain::coarse(model("left", mesh([0.0, 3.0], [9, 3, 3])), w),
            Subdomain::fine(model("right", mesh([2.0, 4.0], [12, 2, 6])), complement),
        ];
        let space = Arc::new(FemField::new(mesh([2.0, 3.0], [3, 3, 2])));
        let run = solid::couple(bodies, space, Box::new(L2)).unwrap();
        let excess = run.interfaces()[0].report().measure - 1.0;
        assert!(excess.abs() < 1e-12, "turned {turned}: {excess:e}");
    }
}

#[test]
fn a_model_alone_has_all_of_itself() {
    let build = |w: Weights<f64>, partition| {
        let model = FemModel::new(
            "alone",
            solid::block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]),
            solid::material(),
        );
        let body = Subdomain::coarse(model.unwrap(), w).with_partition(partition);
        Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.8), None)
    };
    assert!(build(Weights::uncoupled(), Partition::Checked).is_ok());
    for weight in [0.5, 1.5] {
        let part = || Weights::from_weight(Arc::new(Uniform(weight)));
        assert!(build(part(), Partition::Unchecked).is_ok());
        let error = build(part(), Partition::Checked).unwrap_err();
        assert!(
            matches!(&error, Error::PartitionOfUnity { model, sum, .. } if model == "alone" && (sum - weight).abs() < 1e-12),
            "{error}"
        );
    }
}

#[test]
fn bodies_that_nothing_ties_may_touch_and_overlap_what_is_not_theirs() {
    // Two pairs in one run, side by side: each is a group of its own.
    let pair = || {
        let [a, b] = solid::bodies(Profile::Cubic, 0.05);
        [a, b]
    };
    let [a, b] = pair();
    let [c, d] = pair();
    let spec = |coarse, fine| InterfaceSpec {
        coarse,
        fine,
        ..solid::spec(
            solid::mediator(ElementKind::Tet4, solid::OVERLAP, [2, 2, 2]),
            Box::new(L2),
        )
    };
    let run = Coupled::new(
        vec![a, b, c, d],
        vec![spec(0, 1), spec(2, 3)],
        TimeStep::Fraction(0.8),
        None,
    )
    .unwrap();
    assert_eq!(run.partition().len(), 2);
    assert!(
        run.interfaces()
            .iter()
            .all(|i| i.report().outside < 1e-12 && i.report().tied.iter().all(|t| *t > 0.999))
    );
}

/// Couples two cylinders with given numbers of core elements by an inscribed mediator over (2, 3).
fn cylinders(coarse: usize, fine: usize, from: f64) -> Result<Coupled<f64>> {
    let cylinder = |ends: [f64; 2], core: usize, layers: usize, rim| {
        let shape = Cylinder {
            ends,
            radius: 1.0,
            core,
            rings: core.div_ceil(2),
            layers,
            rim,
        };
        generate::cylinder(ElementKind::Hex8, &shape).unwrap()
    };
    let w = ramp(3.0, 2.0, Profile::Cubic);
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let model = |name: &str, mesh| FemModel::new(name, mesh, solid::material()).unwrap();
    let left = model("left", cylinder([0.0, 3.0], coarse, 6, Rim::EqualArea));
    let right = model("right", cylinder([from, 5.0], fine, 12, Rim::EqualArea));
    let bodies = vec![Subdomain::coarse(left, w), Subdomain::fine(right, complement)];
    let space = FemField::new(cylinder([2.0, 3.0], coarse, 2, Rim::Inscribed));
    solid::couple(bodies, Arc::new(space), Box::new(L2))
}

#[test]
fn facets_of_one_curved_surface_count_as_one_body_and_gaps_do_not() {
    for (coarse, fine, missing) in [(2, 4, 0.03), (3, 4, 0.015)] {
        let run = cylinders(coarse, fine, 2.0).unwrap();
        let report = &run.partition()[0];
        assert!(report.missing > 1e-4 && report.missing < missing, "{report:?}");
        // The missing volume is sampled and the mass is exact: they agree within 40 %.
        assert!(
            report.excess_mass < 0.0 && (report.excess_mass + report.missing).abs() < 0.4 * report.missing,
            "{report:?}"
        );
        let outside = run.interfaces()[0].report().outside;
        assert!(outside > 0.01 && outside < 0.12, "{outside}");
    }
    let error = cylinders(2, 4, 2.2).unwrap_err();
    assert!(
        matches!(
            error,
            Error::UnequalShapes { .. } | Error::PartitionOfUnity { .. }
        ),
        "{error}"
    );
}

#[test]
fn initial_displacements_are_made_to_agree_once_and_refused_when_they_are_another_body() {
    let wave = |x: f64| (1e-3 * (x / 40.0).cos(), 0.0);
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 120,
        overlap: 40.0,
        ..Line::default()
    };
    // Interpolation of a smooth field on two meshes: a small jump, which is projected and reported.
    let mut run = line.build(&wave, &wave).unwrap();
    let report = run.interfaces()[0].report().clone();
    assert!(
        report.start_jump > 1e-7 && report.start_jump < 1e-5,
        "{:e}",
        report.start_jump
    );
    assert!(
        report.start_moved > 1e-7 && report.start_moved < 2e-5,
        "{:e}",
        report.start_moved
    );
    assert!(run.jumps(0)[1] < 1e-17, "{:e}", run.jumps(0)[1]);
    run.run(2000, &mut Silent).unwrap();
    assert!(
        run.jumps(0)[1] < 1e-15 && run.drift() < 1e-11,
        "{:e} {:e}",
        run.jumps(0)[1],
        run.drift()
    );
    // Fields that agree are unchanged, bit by bit.
    let linear = |x: f64| (1e-3 * x, 0.0);
    let run = line.build(&linear, &linear).unwrap();
    assert!(run.interfaces()[0].report().start_moved < 1e-16);
    // Only one model is displaced: refused with the jump.
    let error = line.build(&|_| (1e-3, 0.0), &rest).unwrap_err();
    let Error::InitialJump { jump, largest, .. } = &error else {
        panic!("{error}")
    };
    assert!(
        (jump - 1e-3).abs() < 1e-6 && (largest - 1e-3).abs() < 1e-15,
        "{error}"
    );
}

#[test]
fn coupling_matrices_and_operator_can_be_read() {
    for junction in solid::junctions::<f64>() {
        let bodies = solid::shaken(solid::bodies(Profile::Linear, 0.05), 3);
        let space = solid::mediator(ElementKind::Tet4, solid::OVERLAP, [2, 2, 2]);
        let run = solid::couple(bodies, space, junction).unwrap();
        let i = &run.interfaces()[0];
        assert_eq!(i.report().degree, Some(4));
        let s = run.multiplier_operator(0).unwrap();
        let n = i.multipliers().len();
        assert_eq!((s.rows(), s.cols()), (n, n));
        let mut jump = vec![0.0_f64; n];
        for (m, sign) in [(0, 1.0), (1, -1.0)] {
            let b = i.coupling_matrix(m).unwrap();
            let side = &run.subdomains()[i.sides()[m]];
            assert_eq!((b.rows(), b.cols()), (n, side.model().layout().translations()));
            b.iter()
                .for_each(|(v, (r, c))| jump[r] += sign * v * side.state().v[c]);
        }
        // The start is consistent, and S is symmetric with a positive diagonal.
        assert!(jump.iter().all(|x| x.abs() < 1e-13));
        let top: f64 = s.iter().fold(0.0, |m: f64, (v, _)| m.max(f64::abs(*v)));
        for (v, (a, b)) in s.iter() {
            let transposed: f64 = *s.get(b, a).unwrap();
            assert_abs_diff_eq!(*v, transposed, epsilon = 1e-15 * top);
        }
        assert!((0..n).all(|k| *s.get(k, k).unwrap() > 0.0));
        assert!(i.coupling_matrix(2).is_none() && run.multiplier_operator(1).is_none());
    }
}

/// Couples a long cylinder of particles and another model by a mediator of the given spacing.
fn grains(coarse: Subdomain<f64>, fine: DemModel, core: usize) -> Coupled<f64> {
    let complement = Weights::complement_of(std::slice::from_ref(coarse.weights()));
    let shape = Cylinder {
        ends: [2e-3, 3e-3],
        radius: 0.5e-3,
        core,
        rings: 1,
        layers: 2,
        rim: Rim::Inscribed,
    };
    let space = FemField::new(generate::cylinder(ElementKind::Hex8, &shape).unwrap());
    let interface = InterfaceSpec {
        options: InterfaceOptions {
            sampling: Sampling::Particles,
            ..InterfaceOptions::default()
        },
        ..solid::spec(Arc::new(space), Box::new(L2))
    };
    let bodies = vec![coarse, Subdomain::fine(fine, complement)];
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.8), None).unwrap()
}

fn packed(name: &str, from: f64, count: usize) -> DemModel {
    let mut packing = PackingSpec::quench(Container::cylinder(3e-3, 0.5e-3).unwrap(), count, 1)
        .build()
        .unwrap();
    packing.positions.iter_mut().for_each(|x| x.x += from);
    DemModel::new(name, &packing, BeamMaterial::SILICA, 2200.0).unwrap()
}

#[test]
fn particles_that_stick_out_are_tied_and_momenta_stay_exact() {
    let weights = || ramp(3e-3, 2e-3, Profile::Cubic);
    let elements = || {
        let shape = Cylinder::with_size([0.0, 3e-3], 0.5e-3, 0.2e-3).unwrap();
        let mesh = generate::cylinder(ElementKind::Hex8, &shape).unwrap();
        let material = Elastic::new(72.5e9, 0.17, 2200.0).unwrap();
        Subdomain::coarse(FemModel::new("left", mesh, material).unwrap(), weights())
    };
    let spheres = || {
        let model = packed("left", 0.0, 700);
        let field = NaturalField::from_points(model.nodes(), Interpolant::Laplace).unwrap();
        Subdomain::new(Box::new(model), Arc::new(field), weights())
    };
    for (coarse, core) in [(elements(), 1), (elements(), 2), (spheres(), 1)] {
        let run = grains(coarse, packed("right", 2e-3, 2500), core);
        let report = run.interfaces()[0].report();
        // An inscribed square leaves out a third of the section, the hull of coarse particles a sixth.
        assert!(
            report.tied[1] > 0.93,
            "tied {:?}, outside {}",
            report.tied,
            report.outside
        );
        assert!(report.momentum_defect < 1e-12, "{:e}", report.momentum_defect);
        let [force, moment] = conformance::interface_momentum(&run);
        assert!(force < 1e-12 && moment < 1e-12, "{force:e} {moment:e}");
    }
}

#[test]
fn cells_that_overlap_each_other_are_refused() {
    let nodes: Vec<_> = (0..=30).map(|k| on_axis(2.0 + 0.1 * f64::from(k))).collect();
    let mut elements: Vec<u32> = (0..30).flat_map(|k| [k, k + 1]).collect();
    elements.extend([3, 5]);
    let mesh = Mesh::new(ElementKind::Bar2, nodes, elements)
        .unwrap()
        .with_section(2.0)
        .unwrap();
    let fine = FemModel::new("fine", mesh, Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap();
    let mesh = generate::bar(0.0, 3.0, 30, 2.0).unwrap();
    let coarse = FemModel::new("coarse", mesh, Elastic::new(1.0, 0.0, 1.0).unwrap()).unwrap();
    let [w, v] = shared(Profile::Linear);
    let bodies = vec![
        Subdomain::coarse(coarse, w),
        Subdomain::fine(fine, v).with_partition(Partition::Unchecked),
    ];
    let space = FemField::new(generate::bar(2.0, 3.0, 5, 2.0).unwrap());
    let error = solid::couple(bodies, Arc::new(space), Box::new(L2)).unwrap_err();
    let Error::CoveredTwice {
        model,
        covered,
        total,
        ..
    } = &error
    else {
        panic!("{error}")
    };
    assert_eq!(model, "fine");
    assert_abs_diff_eq!(covered / total, 1.2, epsilon = 1e-9);
}

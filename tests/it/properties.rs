//! Invariants on random meshes, weights, overlaps and states.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid;
use arlequin::core::nalgebra::{Point3, Unit, Vector3};
use arlequin::core::{
    Complement, H1Gradient, H1Strain, Junction, L2, Model, Overlap, Primitive, Profile, Ramp, Shell, Silent,
    Slab, Subdomain, Weight, Weights, conformance,
};
use arlequin::fem_ref::{ElementKind, FemField, FemModel, Mesh};
use arlequin_studies::noise;
use proptest::prelude::*;
use std::sync::Arc;

fn profile() -> impl Strategy<Value = Profile<f64>> {
    prop_oneof![
        (0.0..=1.0).prop_map(Profile::Constant),
        Just(Profile::Linear),
        Just(Profile::Cubic),
        Just(Profile::Quintic),
        prop::collection::vec(0.05..0.95f64, 1..5).prop_filter_map("distinct stations", |mut s| {
            s.extend([0.0, 1.0]);
            s.sort_by(f64::total_cmp);
            Profile::mediator_compatible(&s).ok()
        }),
    ]
}

fn overlap() -> impl Strategy<Value = Arc<dyn Overlap<f64>>> {
    let point = || prop::array::uniform3(-1.0..1.0f64).prop_map(Point3::from);
    prop_oneof![
        (point(), point()).prop_filter_map("distinct borders", |(a, b)| {
            (a != b).then(|| Arc::new(Slab::between(a, b).unwrap()) as Arc<dyn Overlap<f64>>)
        }),
        (point(), 0.1..0.5f64, 0.1..0.5f64).prop_map(|(centre, radius, width)| {
            let ball = |radius| Primitive::Ball { centre, radius };
            Arc::new(Shell {
                fine_core: ball(radius),
                fine_domain: ball(radius + width),
            }) as Arc<dyn Overlap<f64>>
        }),
        (0.1..0.5f64, 0.1..0.5f64).prop_map(|(half, width)| {
            let block = |h: f64| Primitive::Block {
                low: Point3::new(-h, -h, -h),
                high: Point3::new(h, h, h),
            };
            Arc::new(Shell {
                fine_core: block(half),
                fine_domain: block(half + width),
            }) as Arc<dyn Overlap<f64>>
        }),
        (0.1..0.5f64, 0.1..0.5f64).prop_map(|(radius, width)| {
            let pipe = |radius| Primitive::Cylinder {
                point: Point3::origin(),
                axis: Vector3::x_axis(),
                radius,
            };
            Arc::new(Shell {
                fine_core: pipe(radius),
                fine_domain: pipe(radius + width),
            }) as Arc<dyn Overlap<f64>>
        }),
        (-0.5..0.0f64, 0.1..0.5f64).prop_map(|(x, width)| {
            let half = |x: f64| Primitive::HalfSpace {
                point: Point3::new(x, 0.0, 0.0),
                normal: Unit::new_normalize(Vector3::new(1.0, 0.2, 0.0)),
            };
            Arc::new(Shell {
                fine_core: half(x),
                fine_domain: half(x + width),
            }) as Arc<dyn Overlap<f64>>
        }),
    ]
}

/// Returns the mesh with its inner nodes moved by up to `amount` of the spacing.
fn jittered(mesh: Mesh<f64>, amount: f64, seed: u64) -> Mesh<f64> {
    let next = std::cell::RefCell::new(noise(seed));
    let [low, high] = arlequin::core::geometry::bounds_of(mesh.nodes().iter());
    let h = mesh.spacing();
    mesh.mapped(|p| {
        let inside = (0..3).all(|k| p[k] > low[k] + 1e-9 && p[k] < high[k] - 1e-9);
        let d = Vector3::from_fn(|_, _| next.borrow_mut()()) * h * amount;
        if inside { p + d } else { *p }
    })
    .unwrap()
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(64))]

    #[test]
    fn weights_sum_to_one_and_stay_in_range(
        overlap in overlap(), profile in profile(), epsilon in 0.0..0.49f64,
        points in prop::collection::vec(prop::array::uniform3(-1.5..1.5f64), 1..40),
    ) {
        let points: Vec<_> = points.into_iter().map(Point3::from).collect();
        let coarse: Arc<dyn Weight<f64>> = Arc::new(Ramp::new(overlap, profile, epsilon).unwrap());
        let fine: Arc<dyn Weight<f64>> = Arc::new(Complement(vec![coarse.clone()]));
        prop_assert!(points.iter().all(|x| (0.0..=1.0).contains(&coarse.value(x))));
        prop_assert!(conformance::partition_of_unity(&[coarse, fine], &points) <= 1e-15);
    }

    #[test]
    fn element_means_of_a_slab_weight_are_exact(
        profile in profile(), a in -1.0..1.0f64, width in 0.05..2.0f64, epsilon in 0.0..0.4f64, seed in 0..1000u64,
    ) {
        let overlap = Arc::new(Slab::between(Point3::new(a, 0.0, 0.0), Point3::new(a - width, 0.0, 0.0)).unwrap());
        let w = Ramp::new(overlap, profile, epsilon).unwrap();
        let mesh = jittered(solid::block(ElementKind::Tet4, [-2.0, 2.0], [7, 2, 2]), 0.1, seed);
        // On any mesh the weighted volume is the integral of the weight over the box.
        let cells = FemField::new(mesh);
        let total: f64 = arlequin::core::Interpolation::cells(&cells).iter().map(|c| w.mean(c) * c.measure()).sum();
        let n = 200_000;
        let sum: f64 = (0..n).map(|k| w.value(&Point3::new(-2.0 + 4.0 * (f64::from(k) + 0.5) / f64::from(n), 0.0, 0.0))).sum();
        prop_assert!((total - 4.0 * sum / f64::from(n)).abs() < 3e-5, "{total} {}", 4.0 * sum / f64::from(n));
    }
}

proptest! {
    #![proptest_config(reader_fuzz::property_config(12))]

    #[test]
    fn any_admissible_coupling_is_adjoint_and_conserves_momentum_and_energy(
        profile in profile(), epsilon in 0.01..0.3f64, seed in 0..10_000u64, kind in 0..3usize, tets: bool,
        counts in prop::array::uniform3(1..4usize), length in 0.0..0.3f64,
    ) {
        let w = solid::weights(profile.clone(), epsilon);
        // A constant weight of 0 or 1 would leave one model without mass.
        prop_assume!(!matches!(profile, Profile::Constant(c) if !(0.05..=0.95).contains(&c)));
        let shape = |tets| if tets { ElementKind::Tet4 } else { ElementKind::Hex8 };
        let left = jittered(solid::block(shape(!tets), [0.0, 3.0], [6, 2, 2]), 0.12, seed);
        let right = jittered(solid::block(shape(tets), [2.0, 4.0], [6, 3, 3]), 0.12, seed + 1);
        let complement = Weights::complement_of(std::slice::from_ref(&w));
        let bodies = [
            Subdomain::coarse(FemModel::new("left", left, solid::material()).unwrap(), w),
            Subdomain::fine(FemModel::new("right", right, solid::material()).unwrap(), complement),
        ];
        let junction: Box<dyn Junction<f64>> = match kind {
            0 => Box::new(L2),
            1 => Box::new(H1Strain::new(length).unwrap()),
            _ => Box::new(H1Gradient::new(length).unwrap()),
        };
        let space = solid::mediator(shape(tets), solid::OVERLAP, counts);
        let mut c = solid::couple(solid::shaken(bodies, seed), space, junction).unwrap();
        prop_assert!(conformance::adjointness(&c) < 1e-12);
        let [force, moment] = conformance::interface_momentum(&c);
        prop_assert!(force < 1e-12 && moment < 1e-12, "{force:e} {moment:e}");
        c.run(100, &mut Silent).unwrap();
        prop_assert!(c.drift() < 1e-10, "drift {:e}", c.drift());
        prop_assert!(c.constraint_residual() < 1e-8, "residual {:e}", c.constraint_residual());
    }

    #[test]
    fn fem_passes_the_conformance_checks(seed in 0..10_000u64, tets: bool, profile in profile()) {
        let kind = if tets { ElementKind::Tet4 } else { ElementKind::Hex8 };
        let mesh = jittered(solid::block(kind, [0.0, 4.0], [6, 2, 3]), 0.12, seed);
        let mut model = FemModel::new("body", mesh, solid::material()).unwrap();
        prop_assert!(conformance::mass(&model, 4.0).unwrap() < 1e-13);
        let w = solid::weights(profile, 0.05);
        model.set_internal_weight(&*w.internal).unwrap();
        prop_assert!(conformance::rigid_forces(&mut model, 1.0).unwrap() < 1e-12);
        prop_assert!(conformance::forces_derive_from_energy(&mut model, 1e-2).unwrap() < 1e-6);
        prop_assert!(conformance::symmetric_forces(&mut model, 1.0).unwrap() < 1e-13);
        let mut next = noise(seed);
        let points: Vec<_> = (0..50).map(|_| Point3::new(2.0 + 2.0 * next(), 0.5 + 0.5 * next(), 0.5 + 0.5 * next())).collect();
        let d = conformance::shapes(&*model.field(), &points, true).unwrap();
        prop_assert!(d.unity < 1e-12 && d.linear < 1e-12 && d.gradient < 1e-10, "{d:?}");
    }
}

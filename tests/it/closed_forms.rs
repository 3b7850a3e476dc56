//! Numbers that follow from a formula on a sheet of paper: junctions, absorber, loads, viscosity, operator,
//! start.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::solid::{self, bodies, couple, material, mediator};
use approx::assert_relative_eq;
use arlequin::core::effect::{Absorber, BodyForce, BulkViscosity, Load};
use arlequin::core::nalgebra::{Matrix3, Point3, Vector3};
use arlequin::core::{
    Coupled, DofLayout, Error, H1Strain, InterfaceOptions, InterfaceSpec, Junction, JunctionKind, L2, Model,
    Profile, Ramp, ShapeFunction, Silent, Slab, Subdomain, TimeFunction, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, generate};
use arlequin_studies::line::{COARSE, Line, rest};
use arlequin_studies::solid::momentum_scale;
use std::sync::Arc;

/// Returns the four shape functions of a tetrahedron with unit edges along the axes: their gradients, without
/// values.
fn tetrahedron() -> [ShapeFunction<f64>; 4] {
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    [-(x + y + z), x, y, z].map(|gradient| ShapeFunction { value: 0.0, gradient })
}

/// Returns `⟨v, v⟩` of a velocity `v = G x` in the strain junction of length `l`, per volume and without the
/// part of the values.
fn strain_norm(l: f64, g: &Matrix3<f64>) -> f64 {
    let corners = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()];
    let (junction, shapes) = (H1Strain::new(l).unwrap(), tetrahedron());
    let mut sum = 0.0;
    for (a, p) in shapes.iter().zip(&corners) {
        for (b, q) in shapes.iter().zip(&corners) {
            sum += (g * p).dot(&(junction.block(&Point3::origin(), a, b) * (g * q)));
        }
    }
    sum
}

#[test]
fn the_strain_junction_measures_shear_and_is_blind_to_turning() {
    let l = 0.3;
    // ε:ε of a stretch, a simple shear (two components of one half), a dilatation, a spin.
    let cases = [
        ([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0),
        ([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.5),
        ([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2.0),
        ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 3.0),
        ([0.0, 1.0, -2.0, -1.0, 0.0, 3.0, 2.0, -3.0, 0.0], 0.0),
    ];
    for (rows, expected) in cases {
        let measured = strain_norm(l, &Matrix3::from_row_slice(&rows)) / (l * l);
        assert!(
            (measured - expected).abs() < 1e-13,
            "{rows:?}: {measured}, not {expected}"
        );
    }
}

#[test]
fn an_absorber_takes_energy_and_neither_momentum() {
    // A body alone, wholly in the region of the absorber, in a random motion on top of a steady one.
    let mesh = solid::block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3]);
    let space = mediator(ElementKind::Hex8, [2.0, 4.0], [2, 1, 1]);
    let rate = Arc::new(|x: &Point3<f64>| 0.5 * (4.0 - x.x));
    let body = Subdomain::fine(
        FemModel::new("body", mesh, material()).unwrap(),
        Weights::uncoupled(),
    )
    .with_effect(Box::new(Absorber::new(space, rate)));
    let n = body.model().layout().dofs();
    let mut next = arlequin_studies::noise(3);
    let v = (0..n).map(|k| next() + [1.0, 0.5, -0.5][k % 3]).collect();
    let body = body.with_initial(vec![0.0; n], v).unwrap();
    let mut run = Coupled::new(vec![body], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    let (before, scale, energy) = (run.momentum(), momentum_scale(&run), run.energy());
    run.run(200, &mut Silent).unwrap();
    let after = run.momentum();
    for k in 0..2 {
        let change = (after[k] - before[k]).norm() / scale[k];
        assert!(change < 1e-12, "momentum {k} changes by {change:e}");
    }
    let lost = 1.0 - run.energy() / energy;
    assert!(lost > 0.1, "only {lost} of the energy is absorbed");
}

#[test]
fn a_coupled_body_in_free_fall_weighs_what_it_weighs_once() {
    // Two bodies of 3 and 2 m³ that share 1 m³: 4 kg in all. Full weights on both would give 5 kg.
    let g = Vector3::new(0.3, -9.81, 0.1);
    let fall = |s: Subdomain<f64>| s.with_effect(Box::new(BodyForce::new(g).unwrap()));
    let parts = bodies(Profile::Cubic, 0.05).map(fall);
    let space = mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
    let mut run = couple(parts.into(), space, Box::new(L2)).unwrap();
    run.run(50, &mut Silent).unwrap();
    let expected = g * (4.0 * run.time());
    let [p, _] = run.momentum();
    assert!((p - expected).norm() < 1e-12 * expected.norm(), "{p} {expected}");
    // Every point falls alike, so no strain arises.
    for s in run.subdomains() {
        for v in s.state().v.chunks_exact(3) {
            let v = Vector3::from_column_slice(v);
            assert!(
                (v - g * run.time()).norm() < 1e-11 * (g * run.time()).norm(),
                "{v}"
            );
        }
    }
}

#[test]
fn bulk_viscosity_takes_b_rho_c_l_times_the_square_of_the_dilatation_rate() {
    // In cubes of edge h the power is b ρ c h (div v)² per volume; a shear dissipates nothing.
    let (b, impedance, h) = (0.06, 1.7, 0.5);
    let power = |rates: &Matrix3<f64>| {
        let mesh = solid::block(ElementKind::Hex8, [2.0, 4.0], [4, 2, 2]);
        let model = FemModel::new("body", mesh, material()).unwrap();
        let viscosity = BulkViscosity::new(model.field(), b, impedance).unwrap();
        let v: Vec<f64> = model
            .nodes()
            .iter()
            .flat_map(|x| <[f64; 3]>::from(rates * x.coords))
            .collect();
        let body = Subdomain::coarse(model, Weights::uncoupled())
            .with_effect(Box::new(viscosity))
            .with_initial(vec![0.0; v.len()], v)
            .unwrap();
        let step = TimeStep::Seconds(1e-9);
        let mut run = Coupled::new(vec![body], Vec::new(), step, None).unwrap();
        run.run(1, &mut Silent).unwrap();
        run.works()[0].work / run.dt()
    };
    let stretch: Matrix3<f64> = Matrix3::new(0.7, 0.4, 0.0, 0.0, -0.2, 0.3, 0.1, 0.0, 0.4);
    let expected = -b * impedance * h * 2.0 * stretch.trace().powi(2);
    let measured = power(&stretch);
    assert_relative_eq!(measured, expected, epsilon = 0.0, max_relative = 1e-6);
    let shear: Matrix3<f64> = Matrix3::new(0.7, 0.4, 0.0, 0.9, -0.3, 0.3, 0.1, 0.0, -0.4);
    assert!(power(&shear).abs() < 1e-12, "{}", power(&shear));
}

/// Couples two bars of unit elements and properties that share one element, which is also the mediator, with
/// weights of one half.
fn shared_element(stiffer: f64) -> Coupled<f64> {
    let bar = |name: &str, from: f64, density: f64| {
        let mesh = generate::bar(from, from + 4.0, 4, 1.0).unwrap();
        FemModel::new(name, mesh, Elastic::new(density, 0.0, density).unwrap()).unwrap()
    };
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Slab::between(point(1.0), point(0.0)).unwrap();
    let w = Weights::from_weight(Arc::new(
        Ramp::new(Arc::new(slab), Profile::Constant(0.5), 0.0).unwrap(),
    ));
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let parts = vec![
        Subdomain::coarse(bar("left", -3.0, 1.0), w),
        Subdomain::fine(bar("right", 0.0, stiffer), complement),
    ];
    let spec = InterfaceSpec {
        name: "joint".into(),
        coarse: 0,
        fine: 1,
        mediator: Arc::new(FemField::new(generate::bar(0.0, 1.0, 1, 1.0).unwrap())),
        junction: Box::new(L2),
        options: InterfaceOptions::default(),
    };
    Coupled::new(parts, vec![spec], TimeStep::Fraction(0.9), None).unwrap()
}

#[test]
fn the_condition_number_is_that_of_the_operator() {
    // B_C = B_D = G = [2 1; 1 2]/6, M_C = diag(3/4, 1/4), M_D = d diag(1/4, 3/4): S = G (M_C⁻¹ + M_D⁻¹) G.
    for d in [1.0, 5.0] {
        let m = [4.0 / 3.0 + 4.0 / d, 4.0 + 4.0 / (3.0 * d)];
        let g = [[2.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 6.0]];
        let entry = |i: usize, j: usize| (0..2).map(|k| g[i][k] * m[k] * g[k][j]).sum::<f64>();
        let (trace, det) = (
            entry(0, 0) + entry(1, 1),
            entry(0, 0) * entry(1, 1) - entry(0, 1).powi(2),
        );
        let root = (trace * trace / 4.0 - det).sqrt();
        let expected = (trace / 2.0 + root) / (trace / 2.0 - root);
        if (d - 1.0).abs() < f64::EPSILON {
            assert!((expected - 9.0).abs() < 1e-12, "the square of 3");
        }
        let condition = shared_element(d).interfaces()[0].report().condition;
        assert_relative_eq!(condition, expected, epsilon = 0.0, max_relative = 1e-3);
    }
}

#[test]
fn a_mediator_may_overhang_by_two_per_cent_and_no_more() {
    // The coarse body ends at 3; of a mediator from 2 to 3 + d the share d/(1 + d) lies outside.
    let overhanging = |share: f64| {
        let space = mediator::<f64>(ElementKind::Hex8, [2.0, 3.0 + share / (1.0 - share)], [2, 2, 2]);
        couple::<f64>(bodies(Profile::Cubic, 0.05).into(), space, Box::new(L2))
    };
    for share in [0.021, 0.05, 0.14] {
        let error = overhanging(share).unwrap_err();
        let Error::OverhangingMediator { outside, total, .. } = error else {
            panic!("{share}: {error}")
        };
        assert!((outside / total - share).abs() < 1e-9, "{outside} of {total}");
    }
}

#[test]
fn accelerations_of_the_start_satisfy_the_constraint() {
    // Only the bar is pulled: without the projection of accelerations the first step would part the two by
    // Δt²/2.
    let line = Line {
        coarse_elements: 20,
        fine_bonds: 100,
        ..Line::default()
    };
    let [bar, chain] = line.subdomains(&rest, &rest).unwrap();
    let bar = bar.with_effect(Box::new(BodyForce::new(Vector3::x()).unwrap()));
    let mut run = line.build_with(vec![bar, chain]).unwrap();
    let pulled = run.subdomains()[COARSE]
        .state()
        .a
        .iter()
        .fold(0.0, |m: f64, a| m.max(*a));
    assert!(pulled > 0.5, "the load acts from the start");
    for _ in 0..20 {
        run.run(1, &mut Silent).unwrap();
        let [velocity, displacement] = run.jumps(0);
        assert!(
            velocity < 1e-13 && displacement < 1e-13,
            "step {}: {velocity:e} m/s, {displacement:e} m",
            run.steps()
        );
    }
}

#[test]
fn junctions_and_layouts_are_those_that_their_names_say() {
    for (name, expected, length) in [
        ("l2", "L2", false),
        ("h1-strain", "H1 (strain)", true),
        ("h1-gradient", "H1 (gradient)", true),
        ("h1-seminorm", "H1 seminorm", true),
    ] {
        let kind: JunctionKind = name.parse().unwrap();
        assert_eq!(kind.junction(0.1).unwrap().name(), expected);
        assert_eq!((kind.name(), kind.has_length()), (name, length));
    }
    // Two particles: six displacements, then six rotations.
    let layout = DofLayout {
        nodes: 2,
        components: 3,
        rotations: 3,
    };
    let nodes: Vec<usize> = (0..layout.dofs()).map(|d| layout.node_of(d)).collect();
    assert_eq!(nodes, [0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1]);
    assert!(layout.turns());
}

/// A traction on both models along the whole body pushes it once, in the overlap as elsewhere: `dp/dt = t A`,
/// for loads on facets and on unknowns.
#[test]
fn a_load_over_an_overlap_counts_once() {
    let (traction, area) = (Vector3::new(0.25, -2.0, 0.5), 4.0);
    for on_facets in [true, false] {
        let w = solid::weights(Profile::Linear, 1e-9);
        let shares = [w.clone(), Weights::complement_of(&[w])];
        // Both meshes have nodes on the borders of the overlap, so that the rules at centres and at nodes are
        // exact.
        let meshes = [
            solid::block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]),
            solid::block(ElementKind::Tet4, [2.0, 4.0], [8, 3, 3]),
        ];
        let [left, right] = meshes.map(|mesh| {
            let facets = mesh.surface("y-max").unwrap();
            let load = if on_facets {
                Load::traction("wind", facets, &|_| traction, TimeFunction::Step)
            } else {
                let nodes = facets.iter().flat_map(|f| f.nodes.iter().zip(&f.shares));
                let forces = nodes.flat_map(|(n, a)| (0..3).map(move |c| (3 * n + c, traction[c] * a)));
                Load::on_dofs("wind", forces.collect(), TimeFunction::Step)
            };
            (mesh, load.unwrap())
        });
        let body = |name: &str, mesh| FemModel::new(name, mesh, material()).unwrap();
        let [coarse_share, fine_share] = shares;
        let coarse = Subdomain::coarse(body("left", left.0), coarse_share).with_effect(Box::new(left.1));
        let fine = Subdomain::fine(body("right", right.0), fine_share).with_effect(Box::new(right.1));
        let space = mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]);
        let mut run = couple(vec![coarse, fine], space, Box::new(L2)).unwrap();
        run.run(20, &mut Silent).unwrap();
        let [gained, expected] = [run.momentum()[0], traction * area * run.time()];
        assert!(
            (gained - expected).norm() < 1e-8 * expected.norm(),
            "on facets {on_facets}: {gained:?}, not {expected:?}"
        );
    }
}

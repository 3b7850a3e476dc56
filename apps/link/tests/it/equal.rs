//! A model of ours behind a link, in a second process, gives the same results as in one process.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::{BONDS, chain, chain_shape, coupled, gap, moving, patient, start};
use arlequin::core::nalgebra::Vector3;
use arlequin::core::{
    InterfaceOptions, L2, OwnStep, Participant, Sampling, Silent, Uniform, Weighting, conformance,
};
use arlequin::dem_beam::{BeamMaterial, Container, DemModel, PackingSpec};
use arlequin::fem_ref::{Elastic, ElementKind, FemModel};
use arlequin::prelude::*;
use arlequin_link::{Address, Element, Remote, Shape, Verlet, given, serve};
use arlequin_studies::solid;

/// Serves a model with initial velocities if this process was started for it.
fn serve_model(model: impl Model<f64> + 'static, v: Option<Vec<f64>>, shape: &Shape) {
    let Some(address) = given() else { return };
    let address: Address = address.parse().unwrap();
    let n = model.layout().dofs();
    let v = v.unwrap_or_else(|| vec![0.0; n]);
    let mut solver = Verlet::new(Box::new(model), vec![0.0; n], v).unwrap();
    serve(&address, &mut solver, shape).unwrap();
}

#[test]
#[ignore = "the other side of tests in this file"]
fn a_served_chain() {
    serve_model(chain(), Some(moving()), &chain_shape());
}

#[test]
#[ignore = "the other side of tests in this file"]
fn served_tetrahedra() {
    let model = tetrahedra();
    let shape = Shape::Mesh {
        element: Element::Tetrahedron,
        connectivity: model.mesh().connectivity().to_vec(),
        section: 1.0,
    };
    serve_model(model, None, &shape);
}

#[test]
#[ignore = "the other side of tests in this file"]
fn served_particles() {
    let model = particles();
    let volumes = model
        .views()
        .particles
        .unwrap()
        .iter()
        .map(|s| s.measure)
        .collect();
    let pairs = Vec::new();
    serve_model(model, None, &Shape::Particles { volumes, pairs });
}

fn tetrahedra() -> FemModel<f64> {
    let mesh = solid::block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3]).unwrap();
    FemModel::new("right", mesh, solid::material().unwrap()).unwrap()
}

fn particles() -> DemModel {
    let corner = |x, y| Vector3::new(x, y, y);
    let body = Container::cuboid(corner(2.0, 0.0), corner(4.0, 1.0)).unwrap();
    let packing = PackingSpec::quench(body, 500, 1).build().unwrap();
    let beam = BeamMaterial {
        young: 3.56,
        ..BeamMaterial::SILICA
    };
    DemModel::new("right", &packing, beam, 1.0).unwrap()
}

#[test]
fn a_chain_behind_a_link_moves_as_one_in_this_process_does_with_one_own_step_and_with_four() {
    for own_step in [1, 4].map(OwnStep::Ratio) {
        let solver = start("equal::a_served_chain", patient()).unwrap();
        let mut linked = coupled(Some(Box::new(solver)), own_step).unwrap();
        let mut local = coupled(None, own_step).unwrap();
        for run in [&mut linked, &mut local] {
            run.run(1000, &mut Silent).unwrap();
            assert!(run.drift() < 1e-13, "{:e}", run.drift());
        }
        let gap = gap(&linked, &local);
        assert!(gap < 1e-12, "{own_step:?}: {gap:e}");
        let energy = |c: &Coupled<f64>| c.last_energy().unwrap().invariant;
        assert!((energy(&linked) / energy(&local) - 1.0).abs() < 1e-12);
        let critical = |c: &Coupled<f64>| c.plan().models[1].4;
        assert!((critical(&linked) / critical(&local) - 1.0).abs() < 1e-12);
    }
}

/// Hexahedra in motion and a fine model at rest on their right, which may be behind a link.
fn solids(fine: Subdomain<f64>, m: usize, sampling: Sampling) -> Coupled<f64> {
    let weights = solid::weights(Profile::Cubic, 0.05).unwrap();
    let left = solid::block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]).unwrap();
    let left = FemModel::new("left", left, Elastic::new(1.0, 0.17, 1.0).unwrap()).unwrap();
    let n = left.layout().dofs();
    let v = (0..n).map(|i| (0.7 * i as f64).sin()).collect();
    let left = Subdomain::coarse(left, weights)
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mediator = solid::mediator(ElementKind::Hex8, solid::OVERLAP, [2, 2, 2]).unwrap();
    let options = InterfaceOptions {
        sampling,
        ..InterfaceOptions::default()
    };
    let tie = InterfaceSpec {
        options,
        ..solid::spec(mediator, Box::new(L2))
    };
    let step = TimeStep::Seconds(0.01 * m as f64);
    let fine = fine.with_step(OwnStep::Ratio(m));
    Coupled::new(vec![left, fine], vec![tie], step, None).unwrap()
}

fn fine_weights() -> Weights<f64> {
    let weights = solid::weights(Profile::Cubic, 0.05).unwrap();
    Weights::complement_of(&[weights])
}

fn same_in_space(test: &str, model: impl FineModel<f64> + 'static, m: usize, sampling: Sampling) {
    let field = model.fine_field();
    let solver = start(test, patient()).unwrap();
    assert_eq!(solver.nodes(), field.nodes());
    let solver = Subdomain::participant(Box::new(solver), field, fine_weights()).unwrap();
    let mut linked = solids(solver, m, sampling);
    let mut local = solids(Subdomain::fine(model, fine_weights()), m, sampling);
    linked.run(100, &mut Silent).unwrap();
    local.run(100, &mut Silent).unwrap();
    let gap = gap(&linked, &local);
    assert!(gap < 1e-12, "{test}, {m} own steps: {gap:e}");
    let fast = |c: &Coupled<f64>| {
        c.subdomains()[1]
            .state()
            .v
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()))
    };
    assert!(
        fast(&local) > 1e-2,
        "the other side does not move: {}",
        fast(&local)
    );
}

#[test]
fn tetrahedra_behind_a_link_move_as_those_in_this_process_do() {
    for m in [1, 4] {
        same_in_space(
            "equal::served_tetrahedra",
            tetrahedra(),
            m,
            Sampling::Intersection,
        );
    }
}

#[test]
fn particles_with_rotations_behind_a_link_move_as_those_in_this_process_do() {
    same_in_space("equal::served_particles", particles(), 4, Sampling::Particles);
}

#[test]
fn a_run_with_a_link_goes_on_with_the_same_bits_and_in_another_process() {
    let build = || {
        let solver = start("equal::a_served_chain", patient()).unwrap();
        coupled(Some(Box::new(solver)), OwnStep::Ratio(3)).unwrap()
    };
    let mut whole = build();
    whole.run(40, &mut Silent).unwrap();
    let snapshot = whole.snapshot().unwrap();
    whole.run(40, &mut Silent).unwrap();
    let mut second = build();
    second.run(3, &mut Silent).unwrap();
    second.restore(&snapshot).unwrap();
    second.run(40, &mut Silent).unwrap();
    let bits = |c: &Coupled<f64>| {
        crate::support::states(c)
            .iter()
            .map(|x| x.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&whole), bits(&second));
}

/// The weights of stiffness and mass are sent separately over the link, since each energy has its own.
#[test]
fn weights_of_stiffness_and_mass_go_over_the_link_each_for_itself() {
    let share = |w: f64| Arc::new(Uniform(w));
    let weights = Weights {
        internal: share(0.5),
        kinetic: share(0.125),
        external: share(1.0),
        weighting: Weighting::Energy,
    };
    let mut local = Verlet::new(Box::new(chain()), vec![0.0; BONDS + 1], moving()).unwrap();
    let mut remote = start("equal::a_served_chain", patient()).unwrap();
    let [mut a, mut b] = [(); 2].map(|()| vec![0.0; BONDS + 1]);
    local.weigh(&weights, &mut a).unwrap();
    remote.weigh(&weights, &mut b).unwrap();
    assert_eq!((a[5], &a), (0.125, &b));
    // Half the critical step of the unweighted chain.
    assert_eq!(remote.critical_step(), local.critical_step());
    assert!((remote.critical_step().unwrap() - 0.5).abs() < 1e-3);
}

#[test]
fn a_state_that_is_gone_back_to_has_its_energy_at_once() {
    let mut solver = start("equal::a_served_chain", patient()).unwrap();
    let mut inertia = vec![0.0; BONDS + 1];
    solver.weigh(&Weights::uncoupled(), &mut inertia).unwrap();
    solver.advance(0.0, 0.8).unwrap();
    let (state, energy) = (solver.save().unwrap(), solver.invariant().unwrap());
    solver.advance(0.8, 0.3).unwrap();
    assert!(
        (solver.invariant().unwrap() - energy).abs() > 1e-9 * energy,
        "another step keeps another energy"
    );
    solver.restore(&state).unwrap();
    assert_eq!(solver.invariant().unwrap().to_bits(), energy.to_bits());
}

#[test]
fn a_link_keeps_what_the_coupling_relies_on() {
    let mut solver: Remote = start("equal::a_served_chain", patient()).unwrap();
    assert_eq!(solver.shape(), &chain_shape());
    assert_eq!((solver.kind(), solver.name()), ("chain", "fine"));
    let d = conformance::participant(&mut solver, 0.8, 200).unwrap();
    assert!(
        d.kick < 1e-15 && d.moved == 0.0 && d.drift < 1e-13 && d.work < 1e-13 && d.resumed == 0.0,
        "{d:?}"
    );
}

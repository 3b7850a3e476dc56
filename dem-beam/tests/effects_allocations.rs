//! Active effects allocate nothing in a step without a break or a search. The file has one test, because the
//! counter is global.
#![allow(clippy::unwrap_used, reason = "a test may")]

use arlequin_core::effect::PairSpec;
use arlequin_core::{Coupled, Model, Parts, Silent, Subdomain, TimeStep, Weights};
use dem_beam::packing::{Lattice, lattice};
use dem_beam::{
    BeamMaterial, Contact, ContactBetween, ContactBody, ContactLaw, Criterion, DemModel, Fracture, Motion,
    Obstacle, RigidShape,
};
use nalgebra::{Point3, Vector3};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// All cases are one test, since the counter counts for all threads.
#[test]
fn steps_with_effects_allocate_nothing() {
    // The test harness allocates on its own thread while it starts.
    std::thread::sleep(std::time::Duration::from_millis(100));
    // In a pool of one thread, since handing work over to another thread allocates now and then.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        fracture_contact_and_an_obstacle();
        contact_between_two_models();
    });
}

fn contact_between_two_models() {
    let block = |name: &str, lift: f64| {
        let mut packing = lattice(Lattice::Cubic, [4, 4, 4], 1e-3).unwrap();
        packing.positions.iter_mut().for_each(|x| x.z += lift);
        DemModel::new(name, &packing, BeamMaterial::SILICA, 2200.0).unwrap()
    };
    let (below, above) = (block("below", 0.0), block("above", 8.0e-3));
    let law = ContactLaw {
        friction: 0.3,
        ..ContactLaw::elastic(70e9)
    };
    let contact = ContactBetween::new(
        ContactBody::from_model(&below),
        ContactBody::from_model(&above),
        law,
    )
    .unwrap();
    let n = above.layout().dofs();
    let mut v = vec![0.0; n];
    (0..n / 6).for_each(|i| v[3 * i + 2] = -0.1);
    let above = Subdomain::fine(above, Weights::uncoupled())
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![Subdomain::fine(below, Weights::uncoupled()), above],
        interfaces: Vec::new(),
        pairs: vec![PairSpec {
            sides: [0, 1],
            effect: Box::new(contact),
        }],
    };
    let mut run = Coupled::from_parts(parts, TimeStep::Fraction(0.5), None).unwrap();
    run.run(3, &mut Silent).unwrap();
    let region = Region::new(GLOBAL);
    run.run(5, &mut Silent).unwrap();
    assert_eq!(region.change().allocations, 0);
    assert!(run.effects()[0].stored > 0.0, "they touch");
}

fn fracture_contact_and_an_obstacle() {
    let packing = lattice(Lattice::Cubic, [6, 6, 6], 1e-3).unwrap();
    let model = DemModel::new("cube", &packing, BeamMaterial::SILICA, 2200.0)
        .unwrap()
        .with_fracture(Fracture::new(Criterion::Rankine, 1e9))
        .unwrap();
    let law = ContactLaw {
        friction: 0.3,
        ..ContactLaw::elastic(70e9)
    };
    let spheres = model.nodes().iter().zip(model.body().radii());
    let bottom = spheres.fold(f64::INFINITY, |m, (x, r)| m.min(x.z - r));
    let plane = RigidShape::Plane {
        point: Point3::new(0.0, 0.0, bottom),
        normal: Vector3::z(),
    };
    let contact = Contact::new(&model, law).unwrap();
    let floor = Obstacle::new("floor", &model, plane, Motion::Fixed, law).unwrap();
    let n = model.layout().dofs();
    let mut v = vec![0.0; n];
    (0..n / 6).for_each(|i| v[3 * i + 2] = -0.1);
    let subdomain = Subdomain::fine(model, Weights::uncoupled())
        .with_effect(Box::new(contact))
        .with_effect(Box::new(floor))
        .with_initial(vec![0.0; n], v)
        .unwrap();
    let mut run = Coupled::new(vec![subdomain], Vec::new(), TimeStep::Fraction(0.5), None).unwrap();
    // During these steps the lists reach their size.
    run.run(20, &mut Silent).unwrap();
    let region = Region::new(GLOBAL);
    run.run(50, &mut Silent).unwrap();
    assert_eq!(region.change().allocations, 0);
    let floor = &run.effects()[2];
    let force = floor.facts.iter().find(|f| f.0 == "largest force [N]").unwrap().1;
    assert!(force > 0.0, "the floor is touched");
}

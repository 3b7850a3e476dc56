//! A fragment of a zone falls back on the body of the zone: what an interface ties does not touch itself,
//! what has come loose does.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::blocks::{E, H, RHO, material};
use arlequin::core::contact::{ContactLaw, Exterior, SurfaceContact};
use arlequin::core::effect::PairSpec;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, InterfaceOptions, InterfaceSpec, L2, Model, Parts, Profile, Ramp, Sampling, Silent, Slab,
    Subdomain, TimeStep, Weights,
};
use arlequin::dem_beam::packing::{Lattice, lattice};
use arlequin::dem_beam::{BeamMaterial, ContactBody, DemModel};
use arlequin::fem_ref::{ElementKind, FemField, FemModel, generate};
use std::sync::Arc;

/// Ends of the overlap along x \[m\].
const OVERLAP: [f64; 2] = [4.0 * H, 6.0 * H];

/// Speed of the fragment \[m/s\].
const SPEED: f64 = 20.0;

/// Elements on (0, 6 H) and bonded spheres on (4 H, 8 H) that share the overlap; one more sphere of the zone
/// falls on the elements at x = 2.1 H.
fn body(contact: bool) -> Coupled<f64> {
    let point = |x: f64| Point3::new(x, 0.0, 0.0);
    let slab = Slab::between(point(OVERLAP[1]), point(OVERLAP[0])).unwrap();
    let ramp = Ramp::new(Arc::new(slab), Profile::Linear, 1e-2).unwrap();
    let weights = Weights::from_weight(Arc::new(ramp));
    let far = Point3::new(OVERLAP[1], 3.0 * H, 3.0 * H);
    let mesh = generate::block(ElementKind::Hex8, Point3::origin(), far, [6, 3, 3]).unwrap();
    let elements = FemModel::new("body", mesh, material()).unwrap();
    let surface = Exterior::surface(&elements).unwrap();
    let mut packing = lattice(Lattice::Cubic, [8, 6, 6], 0.25 * H).unwrap();
    let corner = Vector3::new(4.0, 0.0, 0.0) * H + Vector3::repeat(0.25 * H) - packing.positions[0];
    packing.positions.iter_mut().for_each(|x| *x += corner);
    let loose = Vector3::new(7.0, 1.4, 5.0) * H;
    packing.positions.push(loose);
    packing.radii.push(0.25 * H);
    packing.bodies.push(0);
    packing.loose = true;
    let zone = DemModel::new("zone", &packing, BeamMaterial::SILICA, RHO).unwrap();
    let balls = ContactBody::from_model(&zone).exterior();
    let (fragment, dofs) = (fragment(&zone), zone.layout().dofs());
    let [mut q, mut v] = [(); 2].map(|()| vec![0.0; dofs]);
    // It came loose from the zone and flew over the elements.
    [q[3 * fragment], q[3 * fragment + 2]] = [-4.9 * H, -1.7 * H];
    v[3 * fragment + 2] = -SPEED;
    let complement = Weights::complement_of(std::slice::from_ref(&weights));
    let fine = Subdomain::fine(zone, complement).with_initial(q, v).unwrap();
    let mediator = generate::block(ElementKind::Hex8, point(OVERLAP[0]), far, [2, 3, 3]).unwrap();
    let law = ContactLaw::elastic(E);
    let pair = PairSpec {
        sides: [0, 1],
        effect: Box::new(SurfaceContact::new(&surface, &balls, law).unwrap()),
    };
    let parts = Parts {
        start: 0.0,
        end: None,
        subdomains: vec![Subdomain::coarse(elements, weights), fine],
        interfaces: vec![InterfaceSpec {
            name: "overlap".into(),
            coarse: 0,
            fine: 1,
            mediator: Arc::new(FemField::new(mediator)),
            junction: Box::new(L2),
            options: InterfaceOptions {
                sampling: Sampling::Particles,
                ..InterfaceOptions::default()
            },
        }],
        pairs: if contact { vec![pair] } else { Vec::new() },
    };
    Coupled::from_parts(parts, TimeStep::Fraction(0.5), None).unwrap()
}

/// Number of the sphere that is loose: the highest one at rest.
fn fragment(zone: &dyn Model<f64>) -> usize {
    let nodes = zone.nodes();
    (0..nodes.len())
        .max_by(|a, b| nodes[*a].z.total_cmp(&nodes[*b].z))
        .unwrap()
}

#[test]
fn a_fragment_falls_back_on_its_body_and_what_is_tied_does_not_touch() {
    let mut run = body(true);
    let fact = |run: &Coupled<f64>, name: &str| {
        let lines = run.effects();
        let facts = lines.iter().flat_map(|l| &l.facts);
        facts.filter(|f| f.0 == name).map(|f| f.1).sum::<f64>()
    };
    let [start, _] = run.momentum();
    let before = run.energy();
    let (mut created, mut worst) = (0.0_f64, 0.0_f64);
    while run.time() < 2e-5 {
        run.run(1, &mut Silent).unwrap();
        created = created.max(run.created() / before);
        worst = worst.max((run.momentum()[0] - start).norm() / start.norm());
    }
    // The fragment alone touches, and comes back.
    assert!(
        (fact(&run, "most contacts") - 1.0).abs() < 0.5,
        "{}",
        fact(&run, "most contacts")
    );
    let zone = &run.subdomains()[1];
    let fragment = 3 * fragment(zone.model()) + 2;
    let speed = zone.state().v[fragment];
    assert!(speed > 0.2 * SPEED, "{speed} m/s");
    assert!(created <= 1e-13, "{created:e}");
    // Over the momentum of one sphere, among the round-off of all bonds.
    assert!(worst < 1e-11, "{worst:e}");
    // Without contact it passes through.
    let mut free = body(false);
    while free.time() < 2e-5 {
        free.run(20, &mut Silent).unwrap();
    }
    let speed = free.subdomains()[1].state().v[fragment];
    assert!((speed / SPEED + 1.0).abs() < 1e-12, "{speed} m/s");
}

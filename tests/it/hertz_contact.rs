//! The force of Hertz between a rigid ball and finite or natural elements.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::blocks::{E, H, against, material};
use crate::surface_contact::{fem, rigid, run_of};
use arlequin::cnem::constraint::Surface;
use arlequin::cnem::domain::Domain;
use arlequin::cnem::{CnemModel, Options};
use arlequin::core::contact::{ContactLaw, Motion, RigidShape};
use arlequin::core::effect::MassDamping;
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{PrescribedMotion, Silent, Subdomain, TimeFunction, Weights};
use arlequin::fem_ref::{ElementKind, Mesh, generate};

/// Coordinates of a mesh that is fine near the origin: [`H`], then each element half as long again.
fn graded(fine: usize, coarse: usize) -> Vec<f64> {
    let mut out = vec![0.0];
    let mut step = H;
    for k in 0..fine + coarse {
        if k >= fine {
            step *= 1.5;
        }
        out.push(out[k] + step);
    }
    out
}

/// Hertz, `F = 4/3 E/(1 − ν²) √R δ^1.5`: a rigid ball in a quarter of a half-space of hexahedra, with five
/// of them over the radius of contact. A contact ten times as stiff has less compliance of its own, and is
/// as quiet.
#[test]
#[ignore = "half a minute"]
fn a_ball_on_elements_feels_the_force_of_hertz() {
    for (modulus, limit) in [(E, 0.03), (10.0 * E, 0.05)] {
        let ratio = over_hertz(false, modulus);
        assert!((ratio - 1.0).abs() < limit, "modulus {modulus}: {ratio}");
    }
}

#[test]
#[ignore = "two minutes"]
fn a_ball_on_natural_elements_feels_the_force_of_hertz() {
    let ratio = over_hertz(true, E);
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
}

/// Force of the ball over that of Hertz.
fn over_hertz(natural: bool, modulus: f64) -> f64 {
    let x = graded(9, 11);
    let n = x.len() - 1;
    let unit = generate::block(
        ElementKind::Hex8,
        Point3::origin(),
        Point3::new(n as f64, n as f64, n as f64),
        [n; 3],
    );
    let unit: Mesh<f64> = unit.unwrap();
    let place = |c: f64| x[c.round() as usize];
    let nodes: Vec<Point3<f64>> = unit
        .nodes()
        .iter()
        // The loaded face is z = 0 and the body lies below it.
        .map(|p| Point3::new(place(p.x), place(p.y), -place(n as f64 - p.z)))
        .collect();
    let mesh = Mesh::new(ElementKind::Hex8, nodes.clone(), unit.connectivity().to_vec()).unwrap();
    let (radius, contact) = (100.0 * H, 5.0 * H);
    let depth = contact * contact / radius;
    let shape = RigidShape::Sphere {
        centre: Point3::new(0.0, 0.0, radius),
        radius,
    };
    let amplitude = Vector3::new(0.0, 0.0, -depth);
    let time = TimeFunction::Ramp { duration: 40e-6 };
    let body = rigid(shape, Motion::Prescribed { amplitude, time });
    let law = ContactLaw {
        restitution: 1.0,
        ..ContactLaw::elastic(modulus)
    };
    let far = x[n];
    let s = if natural {
        let domain = Domain::new(&nodes, &Surface::convex_hull()).unwrap();
        let model = CnemModel::new("half-space", domain, material(), Options::default()).unwrap();
        Subdomain::coarse(model, Weights::uncoupled())
    } else {
        Subdomain::coarse(fem("half-space", mesh), Weights::uncoupled())
    };
    let mut s = against(s, &body, law).with_effect(Box::new(MassDamping::new(1e5).unwrap()));
    for c in 0..3 {
        let held = |p: &Point3<f64>| if c < 2 { p[c] == 0.0 } else { p.z <= -far };
        let dofs = (0..nodes.len())
            .filter(|i| held(&nodes[*i]))
            .map(|i| 3 * i + c)
            .collect();
        s = s.with_support(PrescribedMotion::fixed(dofs));
    }
    let mut run = run_of(vec![s], 0.9);
    while run.time() < 250e-6 {
        run.run(50, &mut Silent).unwrap();
    }
    let force = run.effect_resultant(0, "tool", &Point3::origin()).unwrap().force;
    let whole = 4.0 * -force.z;
    let hertz = 4.0 / 3.0 * E / (1.0 - 0.04) * radius.sqrt() * depth.powf(1.5);
    whole / hertz
}

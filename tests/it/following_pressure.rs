//! A pressure that turns with the surface: force and moment on turned bodies, and agreement with a dead
//! pressure at rest.

#![allow(clippy::unwrap_used, reason = "a failed set-up is a failed test")]

use crate::support::blocks::{H, block};
use arlequin::core::contact::LARGEST_TURN;
use arlequin::core::effect::{FollowingPressure, MassDamping};
use arlequin::core::nalgebra::{Point3, Rotation3, Vector3};
use arlequin::core::{Coupled, Silent, Subdomain, TimeFunction, TimeStep};

const PRESSURE: f64 = 1e6;

fn cube(kind: &str) -> Subdomain<f64> {
    block(kind, "block", Vector3::zeros(), [3; 3], H, Vector3::zeros()).side
}

/// The cube turned by initial displacements, with a pressure on the faces with these centres.
fn pressed(kind: &str, turn: Vector3<f64>, loaded: impl Fn(&Vector3<f64>) -> bool) -> Coupled<f64> {
    let s = cube(kind);
    let nodes = s.model().nodes();
    let centre = |f: &[u32; 4]| f.iter().map(|n| nodes[*n as usize].coords).sum::<Vector3<f64>>() / 4.0;
    let faces = s.model().views().surface.unwrap().faces();
    let faces = faces.into_iter().filter(|f| loaded(&centre(f))).collect();
    let pressure = FollowingPressure::new("gas", faces, PRESSURE, TimeFunction::Step).unwrap();
    let turn = Rotation3::new(turn);
    let q: Vec<f64> = nodes
        .iter()
        .flat_map(|x| <[f64; 3]>::from(turn * x.coords - x.coords))
        .collect();
    let v = vec![0.0; q.len()];
    let s = s.with_effect(Box::new(pressure)).with_initial(q, v).unwrap();
    Coupled::new(vec![s], Vec::new(), TimeStep::Fraction(0.5), None).unwrap()
}

#[test]
fn the_force_turns_with_the_surface_and_sums_to_zero_around_a_body() {
    let turn = Vector3::new(0.3, -0.8, 0.5);
    let normal = Rotation3::new(turn) * Vector3::z();
    let whole = PRESSURE * (3.0 * H).powi(2);
    for kind in ["hex", "tet", "cnem"] {
        let mut run = pressed(kind, turn, |x| x.z > 2.99 * H);
        let force = run.effect_resultant(0, "gas", &Point3::origin()).unwrap().force;
        assert!((force + normal * whole).norm() < 1e-12 * whole, "{kind}: {force}");
        let angle = run.effects()[0]
            .facts
            .iter()
            .find(|f| f.0 == LARGEST_TURN)
            .unwrap()
            .1;
        assert!((angle - normal.z.acos()).abs() < 1e-7, "{kind}: {angle}");
        let mut run = pressed(kind, turn, |_| true);
        let force = run.effect_resultant(0, "gas", &Point3::origin()).unwrap().force;
        assert!(force.norm() < 1e-12 * whole, "{kind}: {force}");
    }
}

/// A pressure on all faces compresses a free body evenly: `ε = −p (1 − 2 ν)/E`. The functions of natural
/// elements are not linear on facets, so their corners get more or less than their share.
#[test]
fn a_body_under_pressure_from_all_sides_shrinks_evenly() {
    for (kind, limit) in [("hex", 1e-4), ("tet", 1e-4), ("cnem", 0.02)] {
        let s = cube(kind);
        let faces = s.model().views().surface.unwrap().faces();
        let ramp = TimeFunction::Ramp { duration: 1e-5 };
        let pressure = FollowingPressure::new("gas", faces, PRESSURE, ramp).unwrap();
        let s = s
            .with_effect(Box::new(pressure))
            .with_effect(Box::new(MassDamping::new(1e6).unwrap()));
        let mut run = Coupled::new(vec![s], Vec::new(), TimeStep::Fraction(0.8), None).unwrap();
        while run.time() < 8e-5 {
            run.run(50, &mut Silent).unwrap();
        }
        let s = &run.subdomains()[0];
        let far = |c: usize| {
            let ends = s.model().nodes().iter().zip(s.state().q.as_chunks::<3>().0);
            let [mut low, mut high] = [[0.0_f64; 2]; 2];
            for (x, u) in ends {
                if x[c] < 1e-9 {
                    low = [low[0] + u[c], low[1] + 1.0];
                } else if x[c] > 3.0 * H - 1e-9 {
                    high = [high[0] + u[c], high[1] + 1.0];
                }
            }
            (high[0] / high[1] - low[0] / low[1]) / (3.0 * H)
        };
        let expected = -PRESSURE * (1.0 - 0.4) / 70e9;
        for c in 0..3 {
            // The area shrinks with the body: a relative change of 2 ε.
            assert!(
                (far(c) / expected - 1.0).abs() < limit,
                "{kind}: {:e}",
                far(c) / expected - 1.0
            );
        }
    }
}

#[test]
fn pressures_without_faces_are_refused_by_name() {
    let error = FollowingPressure::new("gas", Vec::new(), 1.0, TimeFunction::Step).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("'gas'") && error.contains("selection"), "{error}");
    let error = FollowingPressure::new("gas", vec![[0, 1, 2, 2]], f64::NAN, TimeFunction::Step);
    assert!(error.unwrap_err().to_string().contains("finite"));
}

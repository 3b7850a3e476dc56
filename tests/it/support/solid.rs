//! The shared deck of solids, whose failures fail the test, and a large run with every effect.

use arlequin::core::effect::{Absorber, BodyForce};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::{
    Coupled, Guard, Junction, OwnStep, Profile, Real, Solver, Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, Mesh};
use arlequin_studies::solid as deck;
#[allow(unused_imports, reason = "each test binary uses its part")]
pub(crate) use deck::{OVERLAP, couple, spec};
use std::sync::Arc;

pub(crate) fn block<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Mesh<T> {
    deck::block(kind, x, counts).unwrap()
}

pub(crate) fn weights<T: Real>(profile: Profile<T>, epsilon: f64) -> Weights<T> {
    deck::weights(profile, epsilon).unwrap()
}

pub(crate) fn material<T: Real>() -> Elastic<T> {
    deck::material().unwrap()
}

pub(crate) fn mediator<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Arc<FemField<T>> {
    deck::mediator(kind, x, counts).unwrap()
}

pub(crate) fn junctions<T: Real>() -> Vec<Box<dyn Junction<T>>> {
    deck::junctions().unwrap()
}

pub(crate) fn bodies<T: Real>(profile: Profile<T>, epsilon: f64) -> [Subdomain<T>; 2] {
    deck::bodies(profile, epsilon).unwrap()
}

pub(crate) fn shaken<T: Real>(bodies: [Subdomain<T>; 2], seed: u64) -> Vec<Subdomain<T>> {
    deck::shaken(bodies, seed).unwrap()
}

/// Returns a run with effects, large enough that the models divide their work among threads.
pub(crate) fn busy(junction: Box<dyn Junction<f64>>) -> Coupled<f64> {
    stepping(junction, [OwnStep::Same; 2])
}

/// Like [`busy`], with own steps.
pub(crate) fn stepping(junction: Box<dyn Junction<f64>>, own_steps: [OwnStep<f64>; 2]) -> Coupled<f64> {
    solved(junction, own_steps, Solver::Auto)
}

/// Like [`busy`], with own steps and a solver.
pub(crate) fn solved(
    junction: Box<dyn Junction<f64>>,
    own_steps: [OwnStep<f64>; 2],
    solver: Solver<f64>,
) -> Coupled<f64> {
    let w = weights(Profile::Cubic, 0.01);
    let coarse = FemModel::new(
        "left",
        block(ElementKind::Hex8, [0.0, 3.0], [18, 6, 6]),
        material(),
    );
    let fine = FemModel::new(
        "right",
        block(ElementKind::Tet4, [2.0, 4.0], [20, 10, 10]),
        material(),
    );
    let complement = Weights::complement_of(std::slice::from_ref(&w));
    let space = mediator(ElementKind::Hex8, OVERLAP, [6, 6, 6]);
    let rate = Arc::new(|x: &Point3<f64>| 0.5 * (3.0 - x.x).clamp(0.0, 1.0));
    let fine =
        Subdomain::fine(fine.unwrap(), complement).with_effect(Box::new(Absorber::new(space.clone(), rate)));
    let coarse = Subdomain::coarse(coarse.unwrap(), w)
        .with_effect(Box::new(BodyForce::new(Vector3::new(0.0, -0.1, 0.0)).unwrap()));
    let bodies = shaken([coarse.with_step(own_steps[0]), fine.with_step(own_steps[1])], 17);
    let mut interface = spec(space, junction);
    interface.options.solver = solver;
    let guard = Guard {
        interval: 5,
        growth: 0.05,
    };
    Coupled::new(bodies, vec![interface], TimeStep::Fraction(0.8), Some(guard)).unwrap()
}

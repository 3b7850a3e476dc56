//! Three-dimensional setting: a coarse box on the left, a fine one on the right, non-coincident meshes in the overlap.

use arlequin::core::effect::{Absorber, BodyForce};
use arlequin::core::interface::{InterfaceOptions, InterfaceSpec};
use arlequin::core::junction::{H1Gradient, H1Strain, Junction, L2};
use arlequin::core::nalgebra::{Point3, Vector3};
use arlequin::core::overlap::Slab;
use arlequin::core::weight::{Profile, Ramp};
use arlequin::core::{Coupled, Guard, Real, Result, Subdomain, TimeStep, Weights};
use arlequin::fem_ref::{Elastic, ElementKind, FemMediator, FemModel, Mesh, generate};
use std::sync::Arc;

pub(crate) const OVERLAP: [f64; 2] = [2.0, 3.0];

pub(crate) fn block<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Mesh<T> {
    let p = |x: f64, y: f64| Point3::new(T::of(x), T::of(y), T::of(y));
    generate::block(kind, p(x[0], 0.0), p(x[1], 1.0), counts).unwrap()
}

pub(crate) fn weights<T: Real>(profile: Profile<T>, epsilon: f64) -> Weights<T> {
    let at = |x: f64| Point3::new(T::of(x), T::zero(), T::zero());
    let slab = Slab::between(at(OVERLAP[1]), at(OVERLAP[0])).unwrap();
    Weights::same(Arc::new(
        Ramp::new(Arc::new(slab), profile, T::of(epsilon)).unwrap(),
    ))
}

/// Steel-like numbers scaled to one.
pub(crate) fn material<T: Real>() -> Elastic<T> {
    Elastic::new(T::of(1.0), T::of(0.25), T::of(1.0)).unwrap()
}

pub(crate) fn mediator<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Arc<FemMediator<T>> {
    Arc::new(FemMediator::new(block(kind, x, counts)))
}

pub(crate) fn junctions<T: Real>() -> Vec<Box<dyn Junction<T>>> {
    let l = T::of(0.15);
    vec![
        Box::new(L2),
        Box::new(H1Strain::new(l).unwrap()),
        Box::new(H1Gradient::new(l).unwrap()),
    ]
}

pub(crate) fn spec<T: Real>(
    mediator: Arc<FemMediator<T>>,
    junction: Box<dyn Junction<T>>,
) -> InterfaceSpec<T> {
    InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator,
        junction,
        options: InterfaceOptions::default(),
    }
}

/// Hexahedra on (0, 3), tetrahedra on (2, 4), nothing coincides.
pub(crate) fn bodies<T: Real>(profile: Profile<T>, epsilon: f64) -> [Subdomain<T>; 2] {
    let w = weights(profile, epsilon);
    let coarse = FemModel::new(
        "left",
        block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2]),
        material(),
    )
    .unwrap();
    let fine = FemModel::new(
        "right",
        block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3]),
        material(),
    )
    .unwrap();
    let rest = Weights::complement_of(std::slice::from_ref(&w));
    [Subdomain::coarse(coarse, w), Subdomain::fine(fine, rest)]
}

/// The same with random velocities.
pub(crate) fn shaken<T: Real>(bodies: [Subdomain<T>; 2], seed: u64) -> Vec<Subdomain<T>> {
    let mut next = super::noise(seed);
    let shake = |s: Subdomain<T>| {
        let n = s.model().layout().dofs();
        let v = (0..n).map(|_| T::of(next())).collect();
        s.with_initial(vec![T::zero(); n], v).unwrap()
    };
    bodies.map(shake).into()
}

pub(crate) fn couple<T: Real>(
    bodies: Vec<Subdomain<T>>,
    mediator: Arc<FemMediator<T>>,
    junction: Box<dyn Junction<T>>,
) -> Result<Coupled<T>> {
    Coupled::new(
        bodies,
        vec![spec(mediator, junction)],
        TimeStep::Fraction(T::of(0.8)),
        None,
    )
}

/// A run with effects, large enough that the models split their work over threads.
pub(crate) fn busy(junction: Box<dyn Junction<f64>>) -> Coupled<f64> {
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
    let rest = Weights::complement_of(std::slice::from_ref(&w));
    let space = mediator(ElementKind::Hex8, OVERLAP, [6, 6, 6]);
    let rate = Arc::new(|x: &Point3<f64>| 0.5 * (3.0 - x.x).clamp(0.0, 1.0));
    let fine = Subdomain::fine(fine.unwrap(), rest).with_effect(Box::new(Absorber::new(space.clone(), rate)));
    let coarse = Subdomain::coarse(coarse.unwrap(), w)
        .with_effect(Box::new(BodyForce::new(Vector3::new(0.0, -0.1, 0.0)).unwrap()));
    let bodies = shaken([coarse, fine], 17);
    let guard = Guard {
        interval: 5,
        growth: 0.05,
    };
    Coupled::new(
        bodies,
        vec![spec(space, junction)],
        TimeStep::Fraction(0.8),
        Some(guard),
    )
    .unwrap()
}

//! Three-dimensional setting: a coarse block on the left, a fine block on the right, non-coincident meshes
//! in the overlap.

use arlequin::core::nalgebra::Point3;
use arlequin::core::{
    Coupled, H1Gradient, H1Strain, InterfaceOptions, InterfaceSpec, Junction, L2, Profile, Ramp, Real,
    Result, Silent, Slab, Subdomain, TimeStep, Weights,
};
use arlequin::fem_ref::{Elastic, ElementKind, FemField, FemModel, Mesh, generate};
use std::sync::Arc;

/// Ends of the overlap along x.
pub const OVERLAP: [f64; 2] = [2.0, 3.0];

/// Meshes a block with unit section from `x[0]` to `x[1]`.
///
/// # Errors
/// Errors of the mesh generator.
pub fn block<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Result<Mesh<T>> {
    let p = |x: f64, y: f64| Point3::new(T::of(x), T::of(y), T::of(y));
    Ok(generate::block(kind, p(x[0], 0.0), p(x[1], 1.0), counts)?)
}

/// Returns the weights of the coarse model.
///
/// # Errors
/// Errors of the profile.
pub fn weights<T: Real>(profile: Profile<T>, epsilon: f64) -> Result<Weights<T>> {
    let point = |x: f64| Point3::new(T::of(x), T::zero(), T::zero());
    let slab = Slab::between(point(OVERLAP[1]), point(OVERLAP[0]))?;
    Ok(Weights::from_weight(Arc::new(Ramp::new(
        Arc::new(slab),
        profile,
        T::of(epsilon),
    )?)))
}

/// Returns a steel-like material scaled to E = 1 and density 1.
///
/// # Errors
/// Never fails with these numbers.
pub fn material<T: Real>() -> Result<Elastic<T>> {
    Elastic::new(T::of(1.0), T::of(0.25), T::of(1.0))
}

/// Returns a multiplier space that fills the section.
///
/// # Errors
/// Errors of the mesh generator.
pub fn mediator<T: Real>(kind: ElementKind, x: [f64; 2], counts: [usize; 3]) -> Result<Arc<FemField<T>>> {
    Ok(Arc::new(FemField::new(block(kind, x, counts)?)))
}

/// Returns the junctions L2, H1 with strains, H1 with gradients.
///
/// # Errors
/// Never fails with these lengths.
pub fn junctions<T: Real>() -> Result<Vec<Box<dyn Junction<T>>>> {
    let l = T::of(0.15);
    Ok(vec![
        Box::new(L2),
        Box::new(H1Strain::new(l)?),
        Box::new(H1Gradient::new(l)?),
    ])
}

/// Returns the interface between subdomains 0 and 1 with default options.
pub fn spec<T: Real>(mediator: Arc<FemField<T>>, junction: Box<dyn Junction<T>>) -> InterfaceSpec<T> {
    InterfaceSpec {
        name: "overlap".into(),
        coarse: 0,
        fine: 1,
        mediator,
        junction,
        options: InterfaceOptions::default(),
    }
}

/// Builds hexahedra on (0, 3) and tetrahedra on (2, 4), without coincident nodes inside the overlap.
///
/// # Errors
/// Errors of the models.
pub fn bodies<T: Real>(profile: Profile<T>, epsilon: f64) -> Result<[Subdomain<T>; 2]> {
    let w = weights(profile, epsilon)?;
    // Spacings 1/2 and 2/7 along x, 1/2 and 1/3 across: no nodes coincide inside the overlap.
    let left = block(ElementKind::Hex8, [0.0, 3.0], [6, 2, 2])?;
    let right = block(ElementKind::Tet4, [2.0, 4.0], [7, 3, 3])?;
    let coarse = FemModel::new("left", left, material()?)?;
    let fine = FemModel::new("right", right, material()?)?;
    let fine_weights = Weights::complement_of(std::slice::from_ref(&w));
    Ok([Subdomain::coarse(coarse, w), Subdomain::fine(fine, fine_weights)])
}

/// Gives both bodies random velocities.
///
/// # Errors
/// Never fails for finite numbers.
pub fn shaken<T: Real>(bodies: [Subdomain<T>; 2], seed: u64) -> Result<Vec<Subdomain<T>>> {
    let mut next = crate::noise(seed);
    let shake = |s: Subdomain<T>| {
        let n = s.model().layout().dofs();
        let v = (0..n).map(|_| T::of(next())).collect();
        s.with_initial(vec![T::zero(); n], v)
    };
    bodies.map(shake).into_iter().collect()
}

/// Builds a run at 0.8 of the critical step.
///
/// # Errors
/// Errors of the set-up.
pub fn couple<T: Real>(
    bodies: Vec<Subdomain<T>>,
    mediator: Arc<FemField<T>>,
    junction: Box<dyn Junction<T>>,
) -> Result<Coupled<T>> {
    let step = TimeStep::Fraction(T::of(0.8));
    Coupled::new(bodies, vec![spec(mediator, junction)], step, None)
}

/// Conserved quantities of a free coupled body over 400 steps from a random state.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    /// Change of linear and of angular momentum, relative to the sum of their nodal moduli.
    pub momentum: [f64; 2],
    /// Largest drift of the invariant.
    pub drift: f64,
    /// Largest relative velocity jump.
    pub residual: f64,
    /// Condition number of the multiplier operator.
    pub condition: f64,
}

/// Returns the sums over all nodes of the moduli of momenta and of their moments, the scale for
/// conservation.
#[must_use]
pub fn momentum_scale(c: &Coupled<f64>) -> [f64; 2] {
    let (mut p, mut l) = (0.0, 0.0);
    for s in c.subdomains() {
        for (k, x) in s.model().nodes().iter().enumerate() {
            let m = (0..3)
                // Moduli before they cancel: momenta of a free body may sum to nothing.
                .map(|a| (s.inertia()[3 * k + a] * s.state().v[3 * k + a]).abs())
                .sum::<f64>();
            p += m;
            l += m * x.coords.norm();
        }
    }
    [p, l]
}

/// Runs 400 steps and compares the conserved quantities.
///
/// # Errors
/// Errors of the steps.
pub fn kept(c: &mut Coupled<f64>) -> Result<Kept> {
    let (before, scale) = (c.momentum(), momentum_scale(c));
    c.run(400, &mut Silent)?;
    let after = c.momentum();
    Ok(Kept {
        momentum: [0, 1].map(|k: usize| (after[k] - before[k]).norm() / scale[k]),
        drift: c.drift(),
        residual: c.constraint_residual(),
        condition: c.interfaces()[0].report().condition,
    })
}

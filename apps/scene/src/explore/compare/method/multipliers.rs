//! The method of this program, with its weights at nodes, and with multipliers that miss the constraint.

use super::{
    Case, MOST_OWN, Pace, Reflections, Result, System, Tie, congruence, diagonal, of_eigenvalues, transposed,
};
use arlequin::core::Weights;
use arlequin::core::nalgebra::DMatrix;

/// Penalty of augmented multipliers in units of the inverse of the largest eigenvalue of `S`.
const PENALTY: f64 = 10.0;
/// Iterations of augmented multipliers per step.
const ITERATIONS: i32 = 2;

/// Energies weighted by elements and bonds; multipliers by a function of the operator `S`, which its inverse
/// lets meet the constraint.
pub(super) fn energy(
    case: &mut Case,
    function: &dyn Fn(DMatrix<f64>) -> DMatrix<f64>,
) -> Result<Reflections> {
    let system = case.system(&case.weights.clone())?;
    let rows = case.coupling(&system)?;
    let operator = congruence(&transposed(&rows), &system.inverse);
    let tie = Tie::by(rows, &operator, function)?;
    let pace = Pace::split(&system, MOST_OWN)?;
    Ok(Reflections::new(system, tie, pace))
}

/// Multipliers by the row sums of the operator.
pub(super) fn lumped(case: &mut Case) -> Result<Reflections> {
    let inverse = |sum: f64| if sum > 0.0 { 1.0 / sum } else { 0.0 };
    energy(case, &|s| DMatrix::from_diagonal(&s.column_sum().map(inverse)))
}

/// Augmented multipliers `μ_{k+1} = μ_k + p (G v − S μ_{k+1})`, from zero. After `k` iterations a mode of `S`
/// with eigenvalue `s` has `μ = (1 − (1 + p s)^−k)/s` of its jump.
pub(super) fn augmented(case: &mut Case) -> Result<Reflections> {
    let iterated = |s: f64, top: f64| (1.0 - (1.0 + PENALTY * s / top).powi(-ITERATIONS)) / s;
    energy(case, &|s| of_eigenvalues(s, &iterated))
}

/// `β(x_i) M_i q̈_i = −α(x_i) (K q)_i`: forces and masses weighted at the nodes. A node on a border has the
/// weight of the floor (0.05), never zero.
pub(super) fn nodal(case: &mut Case) -> Result<Reflections> {
    let plain = case.system(&[Weights::uncoupled(), Weights::uncoupled()])?;
    let [coarse, fine] = &case.nodal;
    let alpha = case.nodal_values([&*coarse.internal, &*fine.internal]);
    let beta = case.nodal_values([&*coarse.kinetic, &*fine.kinetic]);
    let mass = plain.mass.iter().zip(&beta).map(|(m, b)| m * b).collect();
    let stiffness = &diagonal(alpha.into_iter()) * &plain.stiffness;
    let system = System::new((plain.places, plain.split), mass, &plain.mass, stiffness);
    let tie = Tie::exact(case.coupling(&system)?, &system.inverse)?;
    let pace = Pace::split(&system, MOST_OWN)?;
    Ok(Reflections {
        symmetric: false,
        ..Reflections::new(system, tie, pace)
    })
}

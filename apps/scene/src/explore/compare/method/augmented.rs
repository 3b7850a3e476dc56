//! Augmented multipliers: `μ_{k+1} = μ_k + p (G v − S μ_{k+1})`, a few iterations from zero per step.

use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::{Pace, Reflections};
use crate::explore::compare::sparse::{congruence, transposed};
use crate::explore::compare::tie::{Tie, of_eigenvalues};

/// Penalty in units of the inverse of the largest eigenvalue of `S`.
const PENALTY: f64 = 10.0;
/// Iterations per step.
const ITERATIONS: i32 = 2;

/// After `k` iterations a mode of `S` with eigenvalue `s` has `μ = (1 − (1 + p s)^−k)/s` of its jump.
pub(super) fn augmented(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights())?;
    let rows = case.coupling(&system)?;
    let operator = congruence(&transposed(&rows), &system.inverse);
    let iterated = |s: f64, top: f64| (1.0 - (1.0 + PENALTY * s / top).powi(-ITERATIONS)) / s;
    let tie = Tie::responding(rows, &operator, &|a| of_eigenvalues(a, &iterated))?;
    let pace = Pace::split(&system)?;
    Ok(Reflections::new(system, Some(tie), pace))
}

//! The method of this program, with its weights at nodes, and with a lumped operator.

use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::{Pace, Reflections};
use crate::explore::compare::sparse::scaled_rows;
use crate::explore::compare::system::System;
use crate::explore::compare::tie::Tie;

/// Energies weighted by elements and bonds; exact multipliers.
pub(super) fn energy(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights())?;
    let tie = Tie::exact(case.coupling(&system)?, &system.inverse)?;
    let pace = Pace::split(&system)?;
    Ok(Reflections::new(system, Some(tie), pace))
}

/// `β(x_i) M_i q̈_i = −α(x_i) (K q)_i`: forces and masses weighted at the nodes.
pub(super) fn nodal(case: &mut Case) -> Result<Reflections> {
    let plain = case.plain_system()?;
    let weights = case.nodal_weights()?;
    let alpha = case.nodal_values([&*weights[0].internal, &*weights[1].internal]);
    let beta = case.nodal_values([&*weights[0].kinetic, &*weights[1].kinetic]);
    let mass: Vec<f64> = plain.mass.iter().zip(&beta).map(|(m, b)| m * b).collect();
    let stiffness = scaled_rows(&plain.stiffness, &alpha);
    let system = System::new(plain.places.clone(), mass, &plain.mass, stiffness);
    let tie = Tie::exact(case.coupling(&system)?, &system.inverse)?;
    let pace = Pace::split(&system)?;
    Ok(Reflections::new(system, Some(tie), pace).without_energy())
}

/// Multipliers by the row sums of the operator.
pub(super) fn lumped(case: &mut Case) -> Result<Reflections> {
    let system = case.system(&case.weights())?;
    let tie = Tie::lumped(case.coupling(&system)?, &system.inverse);
    let pace = Pace::split(&system)?;
    Ok(Reflections::new(system, Some(tie), pace))
}

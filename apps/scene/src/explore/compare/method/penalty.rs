//! Springs between each particle of the overlap and the coarse field.

use super::edge::tied;
use crate::error::Result;
use crate::explore::compare::case::Case;
use crate::explore::compare::reflections::{Pace, Reflections};
use crate::explore::compare::sparse::congruence;
use crate::explore::compare::system::System;

/// `½ κ_i |N(x_i) u − d_i|²` with `κ_i` a multiple of the particle's own stiffness and of the smaller
/// weight, so that the springs vanish with the model that they act on.
pub(super) fn penalty(case: &mut Case, factor: f64) -> Result<Reflections> {
    let weights = case.weights();
    let system = case.system(&weights)?;
    let [alpha, beta] = [0, 1].map(|k| &*weights[k].internal);
    let (mine, theirs) = (case.nodal_values([alpha, beta]), case.nodal_values([beta, alpha]));
    let layer = case.followers(false, [0.0, case.width]);
    let (d, split) = (case.components(), case.places.split);
    let rows = tied(&layer, d, split, system.size());
    let springs = layer
        .iter()
        .flat_map(|(k, _)| (0..d).map(move |c| split + k * d + c));
    let springs = springs.map(|i| {
        let own = system.stiffness.get(i, i).copied().unwrap_or(0.0);
        // The weighted stiffness times the smaller weight over its own.
        factor * own * (theirs[i] / mine[i].max(f64::MIN_POSITIVE)).min(1.0)
    });
    let springs: Vec<f64> = springs.collect();
    let stiffness = &system.stiffness + &congruence(&rows, &springs);
    let system = System { stiffness, ..system };
    let pace = Pace::common(&system)?;
    Ok(Reflections::new(system, None, pace))
}
